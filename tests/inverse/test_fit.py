"""Inverse problems: every kind of data, every optimiser, what is refused, real terrain."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import splines
from helpers import matrix_products
from scipy.interpolate import griddata
from shape_checks import refused
from skimage.measure import find_contours

import contourfair_jax as cf
from contourfair_jax.inverse import (
    BFGS,
    LBFGS,
    BoxAverages,
    ContourLines,
    Dogleg,
    GaussNewton,
    Masks,
    Slopes,
    ThinPlate,
    Values,
    fit_samples,
)
from contourfair_jax.inverse._extent import Extent, padded_count
from contourfair_jax.inverse._observations import along, interval_averages
from contourfair_jax.inverse._optimisers import search
from contourfair_jax.inverse._prior import cosines
from contourfair_jax.inverse._problem import deviation, pose
from contourfair_jax.io import example

BOTH = pytest.mark.both_precisions
SLOW = pytest.mark.slow
SHAPE = (8, 8)
LINEAR = splines.CatmullRom()
GRID = {"spacing": (2.0, 1.0), "origin": (-1.0, 3.0)}


def scattered(count=60, seed=0):
    """Points within the grid of `GRID`, coordinates in it, and a smooth function of them."""
    unit = np.random.default_rng(seed).uniform(0, 7, (count, 2))
    points = unit * GRID["spacing"] + GRID["origin"]
    return points, np.sin(unit[:, 0] / 2) + np.cos(unit[:, 1] / 3)


def fit(observations, **settings):
    return fit_samples(observations, SHAPE, **{**GRID, "method": LINEAR, **settings})


@pytest.fixture(scope="module")
def values_fit():
    points, values = scattered()
    return fit(Values(points, values, 0.01), optimiser=GaussNewton(1e-8))


# Against a dense solution ----------------------------------------------------------------


def dense_solution(problem):
    """Minimum of a linear problem by dense least squares, without the package's coordinates."""
    size = int(np.prod(SHAPE))

    def residuals(samples):
        parts = problem.residuals(problem.unknowns(samples.reshape(SHAPE)))
        return jnp.concatenate([part.ravel() for part in parts])

    zero = jnp.zeros(size)
    both = jax.jit(lambda z: (jax.jacfwd(residuals)(z), residuals(z)))(zero)
    matrix, right = map(np.asarray, both)
    return np.linalg.lstsq(matrix, -right, rcond=None)[0].reshape(SHAPE)


def test_the_minimum_is_that_of_dense_least_squares(values_fit):
    assert bool(values_fit.converged)
    np.testing.assert_allclose(values_fit.samples, dense_solution(values_fit.problem), atol=1e-4)


def test_one_step_for_a_linear_problem(values_fit):
    assert int(values_fit.steps) == 1
    losses = np.asarray(values_fit.losses)
    assert losses[1] < losses[0]
    assert np.isnan(losses[2:]).all()


@SLOW
@pytest.mark.parametrize(
    "optimiser", [Dogleg(1e-8), LBFGS(1e-8), BFGS(1e-8)], ids=lambda o: type(o).__name__
)
def test_all_optimisers_find_the_same_samples(optimiser, values_fit):
    points, values = scattered()
    found = fit(Values(points, values, 0.01), optimiser=optimiser)
    assert bool(found.converged)
    np.testing.assert_allclose(found.samples, values_fit.samples, atol=1e-3)


def test_the_field_is_the_fair_field_of_the_samples(values_fit):
    expected = cf.fair_field(values_fit.samples, method=LINEAR, **GRID)
    np.testing.assert_allclose(values_fit.field.control_points, expected.control_points, atol=1e-12)


def test_residuals_are_field_minus_data(values_fit):
    points, values = scattered()
    (residuals,), (where,) = values_fit.residuals, values_fit.points
    np.testing.assert_allclose(where, points, rtol=1e-12)
    np.testing.assert_allclose(
        residuals, values_fit.field(jnp.asarray(points)) - values, atol=1e-12
    )


@SLOW
def test_standard_deviation_is_that_of_the_dense_covariance(values_fit):
    problem, z = values_fit.problem, values_fit.search.unknowns
    point = jnp.array([3.0, 5.5])

    def flat(z):
        return jnp.concatenate([part.ravel() for part in problem.residuals(z)])

    jacobian = np.asarray(jax.jit(jax.jacfwd(flat))(z)).reshape(-1, z.size)
    slope = np.asarray(jax.jit(jax.grad(lambda z: problem.field(z)(point)))(z)).ravel()
    expected = np.sqrt(slope @ np.linalg.solve(jacobian.T @ jacobian, slope))
    found = values_fit.standard_deviation(lambda field: field(point))
    np.testing.assert_allclose(found, expected, rtol=1e-3)
    assert 0.005 < float(found) < 0.1


def test_standard_deviations_of_samples_that_were_measured(rng):
    """Every sample with noise of its own, next to no prior: noise adds up as it does by hand."""
    spacing, origin = map(np.array, GRID.values())
    extent = Extent(SHAPE, spacing, origin, np.dtype(float))
    points = np.indices(SHAPE).transpose(1, 2, 0).reshape(-1, 2) * spacing + origin
    sigma = rng.uniform(0.1, 0.5, SHAPE)
    misfit, _ = Values(points, rng.normal(size=64), sigma.ravel()).prepare(extent)
    bases = (jnp.asarray(cosines(8)),) * 2
    problem = eqx.filter_jit(pose)((misfit,), extent, LINEAR, ThinPlate(weight=1e-9), bases)
    one = np.zeros(SHAPE)
    one[2, 5] = 1.0
    for weights in (one, np.ones(SHAPE), 1e3 * rng.normal(size=SHAPE)):
        gradient = jnp.zeros((22, 22)).at[::3, ::3].set(weights)
        found = deviation(problem, jnp.zeros(SHAPE), gradient, 500)
        expected = np.sqrt(np.sum((weights * sigma) ** 2))
        np.testing.assert_allclose(found, expected, rtol=1e-3)


@SLOW
@pytest.mark.parametrize("method", [cf.LocalFairing(), cf.GlobalFairing(iterations=1)])
def test_fairing(method):
    points, values = scattered()
    found = fit(Values(points, values, 0.01), method=method)
    assert bool(found.converged)
    assert np.abs(found.residuals[0]).max() < 0.02


@SLOW
def test_units_do_not_matter(values_fit):
    points, values = scattered()
    origin, spacing = np.array(GRID["origin"]), np.array(GRID["spacing"])
    found = fit(
        Values(1e3 * (points - origin), 1e4 * values + 5e5, 1e2),
        spacing=1e3 * spacing,
        origin=0.0,
    )
    np.testing.assert_allclose((found.samples - 5e5) / 1e4, values_fit.samples, atol=1e-3)


@SLOW
@BOTH
def test_precision_is_kept(x64):
    points, values = scattered()
    found = fit(Values(np.float32(points), np.float32(values), 0.01), dtype="float32")
    assert found.samples.dtype == found.residuals[0].dtype == jnp.float32
    assert bool(found.converged)
    assert np.abs(found.residuals[0]).max() < 0.01
    if not x64:
        with pytest.raises(ValueError, match=r"^dtype must be float32 while JAX"):
            fit(Values(points, values), dtype="float64")


@SLOW
def test_the_number_of_data_does_not_retrace():
    traces = []

    class Counted(splines.CatmullRom):
        def fit(self, values, spacing):
            traces.append(values.shape)
            return super().fit(values, spacing)

    method = Counted()
    sizes = []
    for count in (57, 60, 64):
        points, values = scattered(count)
        found = fit(Values(points, values), method=method)
        assert found.residuals[0].shape == (count,)
        sizes.append(len(traces))
    assert sizes[0] == sizes[1] == sizes[2]


@SLOW
def test_start_and_progress(values_fit, capsys):
    points, values = scattered()
    found = fit(Values(points, values, 0.01), start=values_fit.samples, progress=True)
    assert bool(found.converged)
    assert int(found.steps) <= 1
    np.testing.assert_allclose(found.samples, values_fit.samples, atol=1e-4)


def test_progress_is_told_as_by_all_long_calls():
    points, values = scattered()
    calls = []
    found = fit(
        Values(points, values, 0.01),
        optimiser=GaussNewton(max_steps=20),
        progress=lambda done, total: calls.append((done, total)),
    )
    assert sorted(calls) == [(step, 20) for step in range(int(found.steps) + 1)]


# Kinds of data ---------------------------------------------------------------------------


@SLOW
def test_all_kinds_of_data_together_recover_a_plane():
    """A plane has no thin plate energy, so all data fit exactly."""
    origin, spacing = np.array(GRID["origin"]), np.array(GRID["spacing"])
    plane = np.array([0.5, -2.0])
    points, _ = scattered(9)
    assert np.abs(points[:8] @ plane + 8.0).min() > 0.1
    ends = np.array([[0.0, 1.0], [3.0, 1.75]])
    boxes = origin + (np.indices((2, 3)).transpose(1, 2, 0) + 0.5) * [4.0, 2.0]
    values = boxes @ plane
    found = fit(
        [
            Values(points, points @ plane),
            Slopes(points[:3], np.tile(plane, (3, 1))),
            BoxAverages(values, size=(4.0, 2.0)),
            ContourLines([(ends[0] @ plane + origin @ plane, ends + origin)]),
            Masks(points[:8], points[:8] @ plane > -8.0, level=-8.0, sigma=0.05),
        ]
    )
    vertices = origin + np.indices(SHAPE).transpose(1, 2, 0) * spacing
    np.testing.assert_allclose(found.samples, vertices @ plane, atol=1e-3)
    for residuals, at in zip(found.residuals, found.points, strict=True):
        assert np.abs(residuals).max() < 1e-3
        assert (at is None) == (residuals.shape == (2, 3))


def test_box_averages_are_exact():
    rng = np.random.default_rng(1)
    net = rng.normal(size=3 * 6 - 2)
    field = splines.catmull_rom(np.outer(net[::3], np.ones(3)))
    edges = np.array([0.3, 0.9, 2.2, 5.0])
    found = interval_averages(edges, 6) @ np.asarray(field.control_points)[:, 0]
    for k in range(3):
        at = np.linspace(edges[k], edges[k + 1], 20001)
        values = np.asarray(field(jnp.asarray(np.stack([at, 0 * at], -1))))
        np.testing.assert_allclose(found[k], np.trapezoid(values, at) / np.ptp(at), atol=1e-7)


def test_points_along_a_line():
    corner = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]])
    points, step = along(corner, 0.9)
    assert step == pytest.approx(7 / 8)
    assert len(points) == 8
    on_first, on_second = points[:, 1] == 0, points[:, 0] == 3
    assert (on_first | on_second).all()
    single, _ = along(np.ones((3, 2)), 0.5)
    assert single.tolist() == [[1.0, 1.0]]


@pytest.mark.parametrize("step", [None, 0.4, 0.07])
def test_weights_of_contour_lines_are_their_lengths(step):
    """However they are cut: one over the square of sigma for each length of the least spacing."""
    bent = np.array([[0.0, 3.0], [3.0, 3.0], [3.0, 4.0]])  # of length 4
    lines = [(1.0, bent), (2.0, bent[1:]), (3.0, bent[:2])]
    spacing = np.array([2.0, 0.5])
    extent = Extent(SHAPE, spacing, np.array(GRID["origin"]), np.dtype(float))
    misfit, count = ContourLines(lines, 0.2, step).prepare(extent)
    weights, levels = (np.asarray(x)[:count] for x in (1 / misfit.sigma**2, misfit.values))
    for (level, _), length in zip(lines, (4.0, 1.0, 3.0), strict=True):
        assert weights[levels == level].sum() == pytest.approx(length / 0.5 / 0.2**2)
    assert np.isinf(misfit.sigma[count:]).all()


@SLOW
def test_masks_put_the_contour_between_inside_and_outside():
    unit = np.stack(np.meshgrid(*[np.linspace(0, 7, 29)] * 2, indexing="ij"), -1).reshape(-1, 2)
    inside = np.hypot(*(unit - 3.5).T) < 2.2
    found = fit_samples(Masks(unit, inside), SHAPE, method=LINEAR)
    assert bool(found.converged)
    assert int(found.steps) > 1
    values = np.asarray(found.field(jnp.asarray(unit)))
    assert np.mean((values > 0.5) == inside) > 0.97


@SLOW
def test_contour_lines_weigh_by_length():
    """Twice the points on a line are no more evidence."""
    lines = [(k, np.array([[k, 0.0], [k, 7.0]])) for k in (1.0, 3.0, 6.0)]
    pair = [
        fit_samples([ContourLines(lines, step=step)], SHAPE, method=LINEAR) for step in (0.5, 0.25)
    ]
    np.testing.assert_allclose(pair[0].samples, pair[1].samples, atol=1e-3)


@SLOW
def test_volumes():
    unit = np.random.default_rng(2).uniform(0, 4, (80, 3))
    values = unit @ [1.0, -2.0, 0.5]
    found = fit_samples(Values(unit, values), (5, 5, 5), method=LINEAR)
    expected = np.indices((5, 5, 5)).transpose(1, 2, 3, 0) @ [1.0, -2.0, 0.5]
    np.testing.assert_allclose(found.samples, expected, atol=2e-3)


@SLOW
def test_batches_by_vmap(values_fit):
    points, values = scattered()
    batch = jnp.stack([jnp.asarray(values), 2 * jnp.asarray(values)])
    found = jax.vmap(lambda v: fit(Values(points, v, 0.01)).samples)(batch)
    np.testing.assert_allclose(found[0], values_fit.samples, atol=1e-3)
    np.testing.assert_allclose(found[1], 2 * values_fit.samples, atol=2e-3)


# Prior and coordinates -------------------------------------------------------------------


def test_cosines_are_orthonormal():
    basis = cosines(7)
    np.testing.assert_allclose(basis.T @ basis, np.eye(7), atol=1e-12)


def test_coordinates_there_and_back(values_fit):
    coordinates = values_fit.problem.coordinates
    z = jnp.asarray(np.random.default_rng(3).normal(size=SHAPE))
    np.testing.assert_allclose(coordinates.unknowns(coordinates.samples(z)), z, atol=1e-9)


def test_thin_plate_is_the_sum_of_squared_second_differences():
    values, spacing = np.random.default_rng(4).normal(size=(5, 6)), np.array([2.0, 1.0])
    found = sum(
        float(jnp.sum(part**2))
        for part in ThinPlate(tension=0.3).residuals(jnp.asarray(values), jnp.asarray(spacing))
    )
    xx, yy = np.diff(values, 2, axis=0) / 4, np.diff(values, 2, axis=1)
    xy = np.diff(np.diff(values, axis=0), axis=1) / 2
    slopes = np.sum((np.diff(values, axis=0) / 2) ** 2) + np.sum(np.diff(values, axis=1) ** 2)
    expected = np.sum(xx**2) + np.sum(yy**2) + 2 * np.sum(xy**2) + 0.3 * slopes
    assert found == pytest.approx(expected)


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_scale_of_the_data(scale, rng):
    points = rng.uniform(0, 7, (60, 2)).astype(np.float32)
    samples = [
        fit_samples(
            Values(points, s * points.sum(1), 0.01 * s),
            (8, 8),
            method=cf.LocalFairing(iterations=0),
            dtype="float32",
        ).samples.astype(float)
        / s
        for s in (1.0, scale)
    ]
    np.testing.assert_allclose(*samples, atol=1e-3)


def test_the_derivative_in_the_tension_is_finite_at_zero():
    values = jnp.asarray(np.random.default_rng(4).normal(size=(5, 6)))

    def energy(tension):
        return sum(jnp.sum(p**2) for p in ThinPlate(tension=tension).residuals(values, jnp.ones(2)))

    assert jax.grad(energy)(0.0) == 0
    slopes = [np.sum(np.diff(values, axis=k) ** 2) for k in (0, 1)]
    assert jax.grad(energy)(0.3) == pytest.approx(sum(slopes))


@SLOW
def test_larger_weights_are_smoother(values_fit):
    points, values = scattered()
    smooth = fit(Values(points, values, 0.01), regularisation=ThinPlate(weight=10.0))
    bend = [float(jnp.sum(jnp.diff(each.samples, 2, axis=0) ** 2)) for each in (values_fit, smooth)]
    assert bend[1] < bend[0]
    assert np.std(smooth.residuals[0]) > np.std(values_fit.residuals[0])


def test_padded_counts():
    counts = [padded_count(n) for n in (1, 8, 9, 64, 65, 100, 1000, 1025)]
    assert counts == [8, 8, 16, 64, 72, 104, 1024, 1152]


# What goes wrong -------------------------------------------------------------------------


@SLOW
def test_contradictory_contour_lines_are_reported():
    line = np.array([[0.0, 3.5], [7.0, 3.5]])
    found = fit_samples([ContourLines([(1.0, line), (3.0, line)])], SHAPE, method=LINEAR)
    assert bool(found.converged)
    (residuals,) = found.residuals
    half = len(residuals) // 2
    np.testing.assert_allclose(residuals[:half], 1.0, atol=1e-3)
    np.testing.assert_allclose(residuals[half:], -1.0, atol=1e-3)


@SLOW
def test_a_search_that_does_not_converge_says_so():
    points, values = scattered()
    with pytest.warns(UserWarning, match="did not converge: after 1 steps.*raise max_steps"):
        found = fit(Values(points, values, 0.01), optimiser=LBFGS(max_steps=1))
    assert not bool(found.converged)


@SLOW
def test_constant_data():
    points, _ = scattered()
    found = fit(Values(points, np.full(60, 7.25)))
    assert bool(found.converged)
    np.testing.assert_allclose(found.samples, 7.25, rtol=1e-12)


# Real terrain ----------------------------------------------------------------------------


@SLOW
def test_terrain_from_its_contours_and_from_scattered_points():
    """Nearer to the truth than triangles between the same points."""
    truth = example("jacksboro").crop([(164, 196), (180, 212)]).values.astype(float)
    levels = np.arange(np.ceil(truth.min() / 20) * 20, truth.max(), 20) + 0.5
    lines = [(level, line) for level in levels for line in find_contours(truth, level)]
    rng = np.random.default_rng(5)
    chosen = rng.choice(truth.size, truth.size // 10, replace=False)
    places = np.stack(np.unravel_index(chosen, truth.shape), axis=-1).astype(float)
    data = {
        "contours": (
            ContourLines(lines, sigma=0.3),
            np.concatenate([line for _, line in lines]),
            np.concatenate([np.full(len(line), level) for level, line in lines]),
        ),
        "points": (Values(places, truth.ravel()[chosen], 0.3), places, truth.ravel()[chosen]),
    }
    for name, (observed, points, values) in data.items():
        found = fit_samples(observed, truth.shape, method=cf.LocalFairing(iterations=0))
        assert bool(found.converged), name
        flat = griddata(points, values, tuple(np.indices(truth.shape)), "linear")
        inside = np.isfinite(flat)
        errors = [np.sqrt(np.mean((z - truth)[inside] ** 2)) for z in (found.samples, flat)]
        assert errors[0] < 0.85 * errors[1], (name, errors)


@SLOW
def test_a_volume_from_every_third_slice():
    """Nearer to the truth than straight lines between the slices."""
    x = np.linspace(-1, 1, 13)
    truth = 1 / (1 + np.exp(8 * (np.sqrt(np.add.outer(np.add.outer(x**2, x**2), x**2)) - 0.6)))
    kept = np.zeros(truth.shape, bool)
    kept[::3] = True
    found = fit_samples(
        Values(np.argwhere(kept).astype(float), truth[kept], 0.01),
        truth.shape,
        method=cf.LocalFairing(iterations=0),
    )
    between = np.arange(13) / 3
    below = np.minimum(between.astype(int), 3)
    part = (between - below)[:, None, None]
    flat = (1 - part) * truth[::3][below] + part * truth[::3][below + 1]
    errors = [np.sqrt(np.mean((z - truth) ** 2)) for z in (found.samples, flat)]
    assert errors[0] < 0.8 * errors[1], errors


POINTS = np.array([[0.0, 3.0], [1.0, 4.0]])
VALUES = np.array([1.0, 2.0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Values(POINTS[:, :1], VALUES), r"^points of Values must have shape \(n, ndim\)"),
        (lambda: Values(POINTS[:0], VALUES[:0]), r"^points of Values must hold at least one"),
        (lambda: Values(POINTS * np.nan, VALUES), r"^points of Values must be finite, got 4 of 4"),
        (lambda: Values(POINTS, VALUES[:1]), r"^values of Values must have shape \(2,\)"),
        (lambda: Values(POINTS, [1.0, np.nan]), r"^values of Values must be finite, got 1 of 2"),
        (lambda: Values(POINTS, VALUES, 0.0), r"^sigma of Values must be above zero, got 0.0"),
        (lambda: Values(POINTS, VALUES, [1.0, -1.0]), r"^sigma of Values must be .* got -1.0"),
        (lambda: Values(POINTS, VALUES, np.nan), r"^sigma of Values must be above zero, got nan"),
        (lambda: Values(POINTS, VALUES, [1.0] * 3), r"^sigma of Values must be one number or"),
        (lambda: Values(POINTS, VALUES, np.inf), r"^sigma of Values must be finite for some"),
        (lambda: Values(POINTS, VALUES, "x"), r"^sigma of Values must be real numbers, got <U1"),
        (
            lambda: Values(POINTS, VALUES + 1j),
            r"^values of Values must be real numbers, got complex",
        ),
        (lambda: Values(POINTS, ["a", "b"]), r"^values of Values must be real numbers, got <U1"),
        (lambda: Slopes(POINTS, VALUES), r"^gradients of Slopes must have shape \(2, 2\)"),
        (lambda: ContourLines([]), r"^lines of ContourLines must hold at least one line"),
        (lambda: ContourLines([(np.nan, POINTS)]), r"^levels of ContourLines must be finite"),
        (lambda: ContourLines([(1.0, POINTS)], step=0.0), r"^step of ContourLines must be"),
        (lambda: ContourLines([POINTS]), r"^lines of ContourLines must be pairs \(level, points\)"),
        (
            lambda: Masks(POINTS, np.ones(2, bool), level=VALUES),
            r"^level of Masks must be one number, got shape \(2,\)",
        ),
        (lambda: Masks(POINTS, VALUES), r"^inside of Masks must be boolean, got float"),
        (lambda: Masks(POINTS, np.ones(2, bool), sigma=0), r"^sigma of Masks must be above zero"),
        (lambda: BoxAverages(VALUES, 1.0), r"^values of BoxAverages must be 2-D or 3-D"),
        (lambda: BoxAverages([[np.nan]], 1.0), r"^values of BoxAverages must be finite"),
        (lambda: LBFGS(tolerance=0.0), r"^tolerance must be a real number above 0"),
        (lambda: LBFGS(max_steps=0), r"^max_steps must be an integer that is at least 1"),
        (lambda: LBFGS(history=0), r"^history must be an integer"),
        (lambda: GaussNewton(inner_steps=0), r"^inner_steps must be an integer"),
        (lambda: ThinPlate(weight=0.0), r"^weight must be a real number above 0"),
        (lambda: ThinPlate(tension=-1.0), r"^tension must be a real number at least 0"),
    ],
)
def test_bad_data_and_settings(make, message):
    with refused(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("observations", "settings", "message"),
    [
        ([], {}, r"^observations must hold at least one observation, got none"),
        ([VALUES], {}, r"^observations must be objects such as Values"),
        (
            Values(POINTS + np.array([[0.0], [99.0]]), VALUES),
            {},
            r"^1 of 2 points of Values lie outside the grid, which goes from \(-1.0, 3.0\) to "
            r"\(13.0, 10.0\)",
        ),
        (ContourLines([(1.0, POINTS - 50)]), {}, r"points of ContourLines lie outside the grid"),
        (BoxAverages(np.ones((4, 4)), 9.0), {}, r"points of BoxAverages lie outside the grid"),
        (BoxAverages(np.ones((2, 2)), -1.0), {}, r"^size must be finite and above zero"),
        (BoxAverages(np.ones((2, 2, 2)), 1.0), {}, r"^values of BoxAverages must have 2 axes"),
        (Values(np.ones((2, 3)), VALUES), {}, r"^points of Values must have 2 coordinates"),
        (Values(POINTS, VALUES), {"method": "local"}, r"^method must be an object such as"),
        (Values(POINTS, VALUES), {"optimiser": "LBFGS"}, r"^optimiser must be an object such"),
        (Values(POINTS, VALUES), {"regularisation": 1.0}, r"^regularisation must be an object"),
        (Values(POINTS, VALUES), {"start": np.zeros((3, 3))}, r"^start must be of shape \(8, 8\)"),
        (Values(POINTS, VALUES), {"start": np.full(SHAPE, np.nan)}, r"^start must be finite"),
        (Values(POINTS, VALUES), {"spacing": -1.0}, r"^spacing must be finite and above zero"),
        (Values(POINTS, VALUES), {"dtype": "int32"}, r"^dtype must be float32 or float64"),
    ],
)
def test_bad_input(observations, settings, message):
    with refused(ValueError, match=message):
        fit(observations, **settings)


@SLOW
@pytest.mark.parametrize(
    "observations",
    [ContourLines([(1.0, POINTS)]), BoxAverages(np.ones((3, 3)), 1.5, corner=(0.0, 4.0))],
)
def test_fits_inside_jit(observations):
    """What is known outside is known inside; what is not, is asked for."""
    inside = jax.jit(lambda: fit(observations).samples)()
    np.testing.assert_allclose(inside, fit(observations).samples, atol=1e-6)
    with pytest.raises(ValueError, match=r"give .* as numbers"):
        jax.jit(lambda h: fit(observations, spacing=h).samples)(jnp.ones(2))


@pytest.mark.parametrize("shape", [(8,), (2, 8), (8, 8, 8, 8), (8.0, 8), 8])
def test_bad_shape(shape):
    with refused(ValueError, match=r"^shape "):
        fit_samples(Values(POINTS, VALUES), shape)


def test_quantity_must_be_a_scalar(values_fit):
    with pytest.raises(ValueError, match=r"^quantity must return a scalar, got shape \(8, 8\)"):
        values_fit.standard_deviation(lambda field: field.samples)


@SLOW
def test_a_deviation_that_did_not_converge_is_nan(values_fit):
    found = values_fit.standard_deviation(lambda field: field.samples[0, 0], max_steps=1)
    assert np.isnan(found)


@pytest.mark.parametrize("optimiser", [GaussNewton(), LBFGS()], ids=["newton", "lbfgs"])
def test_products_keep_float32(optimiser):
    """No product in the optimisers that a GPU may round to ten bits."""

    def run(z):
        return search(optimiser, lambda x: x * x - 1, z, jnp.ones((), z.dtype), None)

    products = matrix_products(run, jax.ShapeDtypeStruct((5,), jnp.float32))
    assert products
    assert all("precision = [HIGHEST, HIGHEST]" in line for line in products)
