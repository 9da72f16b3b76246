"""Local fairing: the engine against the twin, and what it must be invariant under."""

import functools

import cases
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import twin
from helpers import assert_close, net_of, samples_of

import contourfair_jax as cf
from contourfair_jax._fairing.local_fairing.windows import window_shape, window_starts
from contourfair_jax._support.xla import WorkingSet

GRIDS = [*cases.GRIDS[2], *cases.GRIDS[3]]
EVERY = pytest.mark.parametrize(("grid", "name"), cases.grid_field_cases(2, 3))
BOTH = pytest.mark.both_precisions


def on_uneven_grids(*marks_3d):
    """Parametrize over a 2-D and a 3-D grid of uneven spacing; a program in 3-D compiles long."""
    flat, solid = cases.GRIDS[2][1], cases.GRIDS[3][1]
    params = [pytest.param(flat, id="2d"), pytest.param(solid, id="3d", marks=marks_3d)]
    return pytest.mark.parametrize("grid", params)


@functools.cache
def twin_net(name, grid, iterations, quadrature_order=4):
    return twin.fair_net(
        samples_of(name, grid),
        grid.spacing,
        iterations=iterations,
        quadrature_order=quadrature_order,
    )


# Against the twin ------------------------------------------------------------------------


@EVERY
@pytest.mark.parametrize("iterations", [0, 3])
def test_equals_the_twin(grid, name, iterations):
    ours = net_of(samples_of(name, grid), grid.spacing, iterations=iterations)
    assert_close(ours, twin_net(name, grid, iterations), 1e-9)


@pytest.mark.slow
@on_uneven_grids()
@pytest.mark.parametrize(("iterations", "quadrature_order"), [(1, 3), (2, 2)])
def test_equals_the_twin_for_other_counts(grid, iterations, quadrature_order):
    settings = {"iterations": iterations, "quadrature_order": quadrature_order}
    for name in ("smooth_random", "step"):
        ours = net_of(samples_of(name, grid), grid.spacing, **settings)
        assert_close(ours, twin_net(name, grid, **settings), 1e-9)


@pytest.mark.parametrize("weight", [1e-3, 0.3, 1.0])
def test_equals_the_twin_for_other_weights(weight):
    grid = cases.GRIDS[2][1]
    values = samples_of("smooth_random", grid)
    ours = net_of(values, grid.spacing, thin_plate_weight=weight)
    assert_close(ours, twin.fair_net(values, grid.spacing, weight), 1e-9)


@pytest.mark.slow
def test_equals_the_twin_on_a_longer_field():
    """More vertices than one batch need not be, and an analytic field."""
    field = cases.ANALYTIC["disk"]
    ours = net_of(field.samples(), field.spacing)
    assert_close(ours, twin.fair_net(field.samples(), field.spacing), 1e-9)


# What the net promises -------------------------------------------------------------------


@BOTH
@EVERY
def test_interpolates_exactly_and_is_c1(grid, name, x64):
    dtype = np.float64 if x64 else np.float32
    samples = samples_of(name, grid).astype(dtype)
    net = net_of(samples, grid.spacing)
    assert net.dtype == dtype
    np.testing.assert_array_equal(net[(slice(None, None, 3),) * grid.ndim], samples)
    tolerance = 30 * np.finfo(dtype).eps * max(np.abs(net).max(), 1e-30)
    for axis, n in enumerate(grid.shape):
        for face in range(3, 3 * (n - 1), 3):
            before, at, after = (np.take(net, face + i, axis).astype(float) for i in (-1, 0, 1))
            np.testing.assert_allclose(after - at, at - before, rtol=0, atol=tolerance)


@pytest.mark.parametrize("grid", GRIDS, ids=lambda grid: grid.name)
@pytest.mark.parametrize("iterations", [0, 3])
def test_planes_are_reproduced(grid, iterations):
    net = net_of(samples_of("plane", grid), grid.spacing, iterations=iterations)
    axes = [np.linspace(-1, 1, size) for size in net.shape]
    direction = [1.0, -0.6, 0.4][: grid.ndim]
    positions = np.meshgrid(*axes, indexing="ij")
    plane = 2.5 + 3 * sum(a * x for a, x in zip(direction, positions, strict=True))
    np.testing.assert_allclose(net, plane, atol=1e-11)


# Solvers ---------------------------------------------------------------------------------


@pytest.mark.slow
@BOTH
@on_uneven_grids()
def test_solvers_agree(grid, x64):
    for name in ("noise", "saddle", "constant"):
        samples = samples_of(name, grid).astype(np.float64 if x64 else np.float32)
        reference = net_of(samples, grid.spacing, solver=cf.LU())
        for solver in (cf.Cholesky(), cf.LeastSquares()):
            ours = net_of(samples, grid.spacing, solver=solver)
            assert_close(ours, reference, 1e-9 if x64 else 1e-3)


@BOTH
@pytest.mark.data
def test_solvers_agree_on_terrain(shared_data, x64):
    terrain = np.load(shared_data / "jacksboro_fault_dem.npz")["data"]
    for row, column in [(0, 0), (100, 200), (160, 90), (240, 310), (338, 398)]:
        samples = terrain[row : row + 6, column : column + 5].astype(float if x64 else np.float32)
        reference = net_of(samples, (92.5, 74.1), solver=cf.LU())
        for solver in (cf.Cholesky(), cf.LeastSquares()):
            ours = net_of(samples, (92.5, 74.1), solver=solver)
            assert_close(ours, reference, 1e-9 if x64 else 1e-3)


# Equivariance ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["noise", "smooth_random", "step"])
@on_uneven_grids()
def test_flips(grid, name):
    samples = samples_of(name, grid)
    net = net_of(samples, grid.spacing)
    for axis in range(grid.ndim):
        assert_close(np.flip(net_of(np.flip(samples, axis), grid.spacing), axis), net, 1e-10)


@pytest.mark.parametrize("name", ["noise", "smooth_random", "step"])
@on_uneven_grids(pytest.mark.slow)
def test_transposes(grid, name):
    samples = samples_of(name, grid)
    ours = net_of(samples.T, grid.spacing[::-1])
    assert_close(ours.T, net_of(samples, grid.spacing), 1e-10)


@BOTH
@pytest.mark.parametrize("name", ["noise", "step", "cone", "constant"])
@pytest.mark.parametrize("factor", [1e-30, -1e-3, 1e30])
@on_uneven_grids(pytest.mark.slow)
def test_value_scaling(grid, name, factor, x64):
    samples = samples_of(name, grid).astype(np.float64 if x64 else np.float32)
    net = net_of(samples, grid.spacing)
    scaled = net_of(samples * samples.dtype.type(factor), grid.spacing)
    assert_close(scaled.astype(float) / factor, net, 1e-9 if x64 else 1e-3)


@BOTH
@pytest.mark.parametrize("name", ["noise", "step"])
@on_uneven_grids()
def test_adding_a_constant(grid, name, x64):
    samples = samples_of(name, grid).astype(np.float64 if x64 else np.float32)
    # Samples that the sum holds exactly, so that only the method's own rounding counts.
    samples = np.round(samples * 64) / 64
    offset = samples.dtype.type(4096)
    ours = net_of(samples + offset, grid.spacing).astype(float) - float(offset)
    assert_close(ours, net_of(samples, grid.spacing), 1e-9 if x64 else 2e-3)


@pytest.mark.parametrize("factor", [1e-6, 1000 / 3, 1e12])
@on_uneven_grids()
def test_spacing_scaling(grid, factor):
    samples = samples_of("noise", grid)
    scaled = net_of(samples, tuple(factor * h for h in grid.spacing))
    assert_close(scaled, net_of(samples, grid.spacing), 1e-9)


@pytest.mark.parametrize("iterations", [0, 3])
@pytest.mark.parametrize("ndim", [2, 3])
def test_spacing_ratios_matter(ndim, iterations):
    samples = samples_of("smooth_random", cases.GRIDS[ndim][0])
    even = net_of(samples, 1.0, iterations=iterations)
    uneven = net_of(samples, (3.0, *(1.0,) * (ndim - 1)), iterations=iterations)
    assert np.abs(even - uneven).max() > 1e-2 * np.ptp(even)


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "length"), [((9, 700), 10), ((6, 7, 260), 5)])
def test_tiles_with_a_halo_of_one_are_exact(shape, length, rng):
    """A field too large to be worked on at once, against tiles of it; one sample is missing."""
    values = rng.normal(size=shape)
    values[..., 3, shape[-1] // 2] = np.nan
    whole, n = net_of(values), shape[-1]
    for start in [*range(0, n - length, length - 2), n - length]:
        tile = net_of(values[..., start : start + length])
        first = 3 if start > 0 else 0
        last = tile.shape[-1] - (3 if start < n - length else 0)
        same = whole[..., 3 * start + first : 3 * start + last]
        np.testing.assert_allclose(tile[..., first:last], same, rtol=0, atol=1e-10)


@pytest.mark.parametrize("cores", [2, 3])
def test_how_the_vertices_are_divided_changes_nothing(monkeypatch, cores):
    values = np.random.default_rng(0).normal(size=(40, 30))
    method, spacing = cf.LocalFairing(iterations=1), jnp.ones(2)

    def net(cores, core_bytes):
        divided = WorkingSet(600, 2**20, cores, core_bytes)
        monkeypatch.setattr(
            "contourfair_jax._fairing.local_fairing.method.working_set", lambda: divided
        )
        return jax.jit(lambda v: method.fit(v, spacing)[0])(jnp.asarray(values))

    # One batch at a time, for which a core's share is too small, and one for every core.
    assert_close(net(cores, 2**21), net(cores, 1), 1e-13)


# Windows ---------------------------------------------------------------------------------


def net_in_windows(monkeypatch, values, vertices):
    """Thin plate net of a grid cut into windows of so many vertices at most; how many there are."""
    small = WorkingSet(vertices, 2**20, 1, 2**20)
    monkeypatch.setattr("contourfair_jax._fairing.local_fairing.method.working_set", lambda: small)
    method, spacing = cf.LocalFairing(iterations=0, quadrature_order=2), jnp.ones(values.ndim)
    net = jax.jit(lambda v: method.fit(v, spacing)[0])(jnp.asarray(values))
    window = window_shape(values.shape, vertices)
    return np.asarray(net), len(window_starts(values.shape, window))


@pytest.mark.parametrize(
    ("shape", "vertices", "count"), [((9, 7), 6, 9), ((8, 10), 12, 4), ((4, 6, 5), 8, 4)]
)
def test_windows_are_put_together_to_the_net_of_the_twin(monkeypatch, rng, shape, vertices, count):
    """The twin knows no windows; some of these overlap, since they do not divide the grid."""
    values = rng.normal(size=shape)
    net, windows = net_in_windows(monkeypatch, values, vertices)
    assert windows == count
    expected = twin.fair_net(values, (1.0,) * values.ndim, iterations=0, quadrature_order=2)
    assert_close(net, expected, 1e-9)


def test_a_grid_of_many_windows_is_c1(monkeypatch, rng):
    """Of the size that windows really have."""
    values = rng.normal(size=(100, 100))
    net, windows = net_in_windows(monkeypatch, values, 2048)
    assert windows > 4
    np.testing.assert_array_equal(net[::3, ::3], values)
    for axis in range(2):
        before, at, after = (np.take(net, np.arange(3, 297, 3) + k, axis) for k in (-1, 0, 1))
        np.testing.assert_allclose(after - at, at - before, rtol=0, atol=1e-13)
