"""Adaptive grids: near to the field, continuous, balanced, and in VTK."""

import jax.numpy as jnp
import numpy as np
import pytest
from shape_checks import refused
from splines import catmull_rom

import contourfair_jax as cf
from contourfair_jax.adaptive import adaptive, uniform_error
from contourfair_jax.adaptive._tree import balance, split, whole


def bump(ndim, n=8):
    """A narrow hill off the middle."""
    axes = np.meshgrid(*[np.linspace(-1, 1, n)] * ndim, indexing="ij")
    return catmull_rom(np.exp(-15 * sum((x - 0.3) ** 2 for x in axes)), 2 / (n - 1), -1.0)


def noise(shape):
    return catmull_rom(np.random.default_rng(0).normal(size=shape), 0.5, 3.0)


FIELDS = {
    "hill": lambda: bump(2),
    "hill in 3-D": lambda: bump(3, 6),
    "noise": lambda: noise((6, 7)),
    "noise in 3-D": lambda: noise((4, 5, 4)),
}


@pytest.fixture(scope="module", params=FIELDS)
def case(request):
    field = FIELDS[request.param]()
    tolerance = 0.02 * float(np.ptp(np.asarray(field.samples)))
    return field, tolerance, field.adaptive(tolerance)


def boxes(grid):
    """Lower and upper corner of every leaf."""
    return grid.vertices[grid.leaves[:, 0]], grid.vertices[grid.leaves[:, -1]]


@pytest.mark.slow
def test_near_to_the_field(case):
    field, tolerance, grid = case
    low, high = boxes(grid)
    t = np.random.default_rng(1).random((4, *low.shape))
    points = (low + t * (high - low)).reshape(-1, field.ndim)[:60000]
    off = np.abs(grid(points) - np.asarray(field(jnp.asarray(points), outside="clamp")))
    assert off.max() <= grid.error * (1 + 1e-9) <= tolerance * (1 + 1e-9)
    assert off.max() >= 0.1 * tolerance  # not finer than it has to be


def test_leaves_fill_the_grid_and_neighbours_differ_by_one(case):
    field, _, grid = case
    low, high = boxes(grid)
    sides = np.asarray(field.spacing) * (np.array(field.shape) - 1)
    assert (high - low).prod(1).sum() == pytest.approx(sides.prod())
    assert grid.depths.max() >= 2
    step = 1e-6 * np.asarray(field.spacing)
    for direction in np.ndindex((3,) * field.ndim):
        towards = np.array(direction) - 1
        points = np.where(towards > 0, high + step, np.where(towards < 0, low - step, low + step))
        depth, _ = grid._tree.locate(
            (points - np.asarray(field.origin)) / np.asarray(field.spacing)
        )
        assert np.abs(depth - grid.depths)[depth >= 0].max() <= 1


def test_no_cracks(case):
    """On both sides of every face of every leaf the values are the same."""
    field, tolerance, grid = case
    low, high = boxes(grid)
    rng = np.random.default_rng(2)
    top = np.asarray(field.origin) + np.asarray(field.spacing) * (np.array(field.shape) - 1)
    for axis in range(field.ndim):
        points = low + rng.random(low.shape) * (high - low)
        step = 1e-9 * float(field.spacing[axis])
        points[:, axis] = high[:, axis]
        points = points[high[:, axis] < top[axis] - step]
        below, above = points.copy(), points.copy()
        below[:, axis] -= step
        above[:, axis] += step
        assert np.abs(grid(above) - grid(below)).max() <= 1e-6 * tolerance


def test_fewer_leaves_than_uniform_refinement():
    field, tolerance = bump(2), 0.005
    grid = field.adaptive(tolerance)
    depth = next(k for k in range(8) if uniform_error(field, k) <= tolerance)
    assert len(grid) < 0.5 * 4**depth * 49
    assert uniform_error(field, depth - 1) > tolerance


def test_samples_of_a_plane_need_no_refinement():
    x = np.arange(5.0)
    grid = catmull_rom(x[:, None] + 2 * x).adaptive(1e-9)
    assert len(grid) == 16
    assert grid.error < 1e-12
    assert "16 leaves" in repr(grid)
    np.testing.assert_allclose(grid([[1.25, 2.5], [4.0, 4.0], [4.1, 0.0]]), [6.25, 12, np.nan])


def test_cells_without_values_have_no_leaves():
    samples = np.asarray(bump(2).samples).copy()
    samples[0, 0] = np.nan
    field = catmull_rom(samples)
    grid = field.adaptive(0.01)
    assert np.isfinite(grid.values).all()
    valid = np.isfinite(np.asarray(field.bounds()[0]))
    middles = np.argwhere(np.ones_like(valid)) + 0.5
    assert np.array_equal(np.isfinite(grid(middles)), valid.ravel())
    assert len(catmull_rom(np.full((4, 4), np.nan)).adaptive(1.0)) == 0


def test_balance_reaches_far():
    """One deep leaf makes rings of larger ones around it."""
    tree = whole(np.ones((9, 9), bool))
    for depth in range(5):
        chosen = [np.zeros(len(part), bool) for part in tree.corners]
        chosen[depth][tree.find(np.array([[(4 << depth), (4 << depth)]]), depth)] = True
        tree = split(tree, chosen)
    balanced = balance(tree)
    assert len(balanced) > len(tree)
    sizes = [len(part) / 4.0**k for k, part in enumerate(balanced.corners)]
    assert sum(sizes) == 81


@pytest.mark.parametrize("ndim", [2, 3])
def test_vtk_has_the_leaves(ndim):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter

    grid = bump(ndim, 5).adaptive(0.05)
    found = grid.to_vtk()
    assert found.GetNumberOfCells() == len(grid)
    np.testing.assert_array_equal(vtk_to_numpy(found.GetPointData().GetScalars()), grid.values)
    measure = vtkCellSizeFilter()
    measure.SetInputData(found)
    measure.Update()
    name = "Area" if ndim == 2 else "Volume"
    sizes = vtk_to_numpy(measure.GetOutput().GetCellData().GetArray(name))
    low, high = boxes(grid)
    np.testing.assert_allclose(sizes, (high - low).prod(1), rtol=1e-9)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, np.inf, "a", True])
def test_bad_errors(tolerance):
    with refused(ValueError, match="error must be above zero"):
        adaptive(bump(2), tolerance)


def test_an_error_that_is_too_small(monkeypatch):
    monkeypatch.setattr("contourfair_jax.adaptive._adaptive.MOST_DEPTH", 3)
    with pytest.raises(ValueError, match="halved more than 3 times"):
        noise((3, 3)).adaptive(1e-9)


@pytest.mark.parametrize(
    ("tolerance", "memory", "message"),
    [
        (1e-12, 1 << 40, "halved more than 10 times; allow a larger one"),
        (1e-5, 1 << 25, "an error of 1e-05, with about .* leaves, needs .* MiB"),
    ],
)
def test_what_cannot_be_reached_is_refused_early(monkeypatch, tolerance, memory, message):
    """The whole tree would have hundreds of thousands of leaves or more."""
    passes = []
    monkeypatch.setattr("contourfair_jax._support.memory.physical_memory", lambda: memory)
    monkeypatch.setattr(
        "contourfair_jax.adaptive._adaptive.split", lambda *tree: passes.append(1) or split(*tree)
    )
    with pytest.raises(ValueError, match=message):
        bump(2, 12).adaptive(tolerance)
    assert len(passes) <= 1


def test_no_tree_is_refused_that_fits(monkeypatch):
    estimates = []
    monkeypatch.setattr(
        "contourfair_jax.adaptive._adaptive.check_memory", lambda size, what: estimates.append(size)
    )
    for field, tolerance in ((bump(2), 1e-4), (noise((6, 7)), 1e-3), (bump(3, 5), 1e-2)):
        estimates.clear()
        needed = 1500 * len(field.adaptive(tolerance))
        assert 0.05 * needed < estimates[3] <= max(estimates) <= needed


def test_progress_is_told():
    told = []
    grid = adaptive(bump(2), 1e-3, progress=lambda done, total: told.append((done, total)))
    assert all(0 <= done <= total <= len(grid) for done, total in told)
    assert len(told) > 2


def test_the_border_is_inside_far_from_zero():
    x = np.arange(9.0)
    origin = np.array([5_000_000.3, 499_999.9])
    field = cf.fair_field(np.sin(x[:, None]) + x, spacing=0.7, origin=origin)
    grid = field.adaptive(0.1)
    corners = origin + 0.7 * np.array([[8, 8], [0, 8], [8, 0]])
    np.testing.assert_allclose(grid(corners), field(corners), atol=1e-6)
    assert np.isnan(grid(corners + 1e-4)).all()


@pytest.mark.parametrize("number", [np.float32(0.25), jnp.float32(0.25), np.array(0.25)])
def test_an_error_may_be_any_scalar(number):
    assert len(bump(2).adaptive(number)) == len(bump(2).adaptive(0.25))


def test_a_tolerance_is_the_former_name_of_the_error():
    for find in (bump(2).adaptive, lambda **given: adaptive(bump(2), **given)):
        with pytest.warns(DeprecationWarning, match=r"tolerance= of .*adaptive .* use error="):
            found = find(tolerance=0.25)
        assert len(found) == len(bump(2).adaptive(error=0.25))


def test_bad_points():
    with pytest.raises(ValueError, match="points must have shape"):
        catmull_rom(np.eye(4)).adaptive(0.5)(np.zeros((3, 3)))
