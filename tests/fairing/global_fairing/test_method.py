"""Global fairing: the engine against its twin, accuracy, convergence, holes, noise, gradients.

Every shape and static setting is another program of some seconds, so tests share them: `exact`
is one program for each shape and sharpness, `clean` another.
"""

import dataclasses
import functools
import time

import cases
import equinox as eqx
import global_twin
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close, samples_of
from shape_checks import refused

import contourfair_jax as cf
from contourfair_jax._fairing.global_fairing.border import LAYERS, LOUDEST, continue_samples
from contourfair_jax._fairing.global_fairing.cell_form import energy_form, structure_form
from contourfair_jax._fairing.global_fairing.noise import Springs, noise_of
from contourfair_jax._fairing.global_fairing.overshoot import limit_slopes
from contourfair_jax._fairing.global_fairing.renewals import Info
from contourfair_jax._support.xla import WorkingSet
from contourfair_jax.io import example

BOTH = pytest.mark.both_precisions
SLOW = pytest.mark.slow
FLAT, SOLID = cases.GRIDS[2][1], cases.GRIDS[3][1]
FIELDS = ("ridge", "sharp_step", "smooth_random", "noise", "constant")
SETTINGS = {
    "plain": {},
    "tension": {"tension": 3.0},
    "others": {"thin_plate_weight": 0.3, "coherence": 0.6, "tension": 0.5, "smoothness": 0.1},
    "hessian": {"thin_plate_weight": 0.05, "hessian_weight": 2.0, "norm": 1.3},
    "robust": {"tension": 0.5, "norm": 1.0},
}


def exact(sharpness=2, **settings):
    """Solved to rounding, to be compared."""
    return cf.GlobalFairing(sharpness=sharpness, iterations=2, tolerance=1e-12, **settings)


def clean(**settings):
    """For clean data with thin features: the settings of the accuracy figures."""
    usual = {"thin_plate_weight": 0.01, "sharpness": 2, "coherence": 1.2}
    return cf.GlobalFairing(**usual | settings)


def net_of(values, method, spacing=1.0):
    return np.asarray(cf.fair_field(values, spacing=spacing, method=method).control_points)


def twin_net(values, grid, method, **settings):
    return global_twin.fair_net(
        values, grid.spacing, sharpness=method.sharpness, iterations=method.iterations, **settings
    )


def rms(difference):
    return float(np.sqrt(np.mean(np.square(difference))))


def with_holes(values):
    """Missing: a corner, two neighbours inside, one on a border."""
    values = values.copy()
    for index in ((0, 0), (2, 1), (2, 2), (-1, 2)):
        values[index + (0,) * (values.ndim - 2)] = np.nan
    return values


# Against the twin ------------------------------------------------------------------------


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("sharpness", [1, 2])
def test_equals_the_twin(sharpness, name):
    method = exact(sharpness, **SETTINGS[name])
    for field in FIELDS:
        values = samples_of(field, FLAT)
        expected = twin_net(values, FLAT, method, **SETTINGS[name])
        assert_close(net_of(values, method, FLAT.spacing), expected, 1e-8)


@SLOW
@pytest.mark.parametrize("sharpness", [1, 2])
def test_equals_the_twin_in_3d(sharpness):
    names = {"plain": "ridge", "others": "noise", "robust": "ridge", "hessian": "ridge"}
    for name, field in names.items():
        method = exact(sharpness, **SETTINGS[name])
        values = samples_of(field, SOLID)
        expected = twin_net(values, SOLID, method, **SETTINGS[name])
        assert_close(net_of(values, method, SOLID.spacing), expected, 1e-8)


@SLOW
@pytest.mark.parametrize("grid", [FLAT, SOLID], ids=["2d", "3d"])
def test_equals_the_twin_with_missing_samples(grid):
    for field in ("ridge", "noise"):
        values = with_holes(samples_of(field, grid))
        expected = twin_net(values, grid, exact(), tension=0.5)
        assert_close(net_of(values, exact(tension=0.5), grid.spacing), expected, 1e-8)


@SLOW
def test_equals_the_twin_with_noise(rng):
    values = with_holes(samples_of("ridge", FLAT))
    sigma = rng.uniform(0.01, 0.1, FLAT.shape)
    ours = net_of(values, exact(sigma=sigma), FLAT.spacing)
    assert_close(ours, twin_net(values, FLAT, exact(), sigma=sigma), 1e-8)


@SLOW
def test_equals_the_twin_with_cell_weights(rng):
    values = samples_of("ridge", FLAT)
    weights = rng.uniform(0.2, 5.0, [n - 1 for n in FLAT.shape])
    ours = net_of(values, exact(cell_weights=weights), FLAT.spacing)
    assert_close(ours, twin_net(values, FLAT, exact(), cell_weights=weights), 1e-8)
    ones = net_of(values, exact(cell_weights=np.ones_like(weights)), FLAT.spacing)
    assert_close(ones, net_of(values, exact(), FLAT.spacing), 1e-10)
    assert np.abs(ours - ones).max() > 1e-3


# What the net promises -------------------------------------------------------------------


def assert_c1(net):
    tolerance = 30 * np.finfo(net.dtype).eps * max(np.abs(net).max(), 1e-30)
    for axis in range(net.ndim):
        for face in range(3, net.shape[axis] - 1, 3):
            before, at, after = (np.take(net, face + i, axis).astype(float) for i in (-1, 0, 1))
            np.testing.assert_allclose(after - at, at - before, rtol=0, atol=tolerance)


def samples_in(net):
    return net[(slice(None, None, 3),) * net.ndim]


@BOTH
def test_interpolates_exactly_and_is_c1():
    for name in cases.field_cases(2):
        values = np.float32(samples_of(name, FLAT))
        net = net_of(values, cf.GlobalFairing(), FLAT.spacing)
        assert net.dtype == np.float32
        np.testing.assert_array_equal(samples_in(net), values)
        assert_c1(net)


@SLOW
def test_interpolates_exactly_and_is_c1_in_3d():
    for name in ("smooth_random", "spike", "integers"):
        values = samples_of(name, SOLID)
        net = net_of(values, exact(), SOLID.spacing)
        np.testing.assert_array_equal(samples_in(net), values)
        assert_c1(net)


@pytest.mark.parametrize("grid", [FLAT, SOLID], ids=["2d", "3d"])
def test_planes_are_reproduced_also_over_holes(grid):
    values = samples_of("plane", grid)
    axes = [np.linspace(0, n - 1, 3 * (n - 1) + 1) for n in grid.shape]
    slopes = [np.diff(values, axis=k).flat[0] for k in range(grid.ndim)]
    expected = values.flat[0] + sum(
        slope * x for slope, x in zip(slopes, np.meshgrid(*axes, indexing="ij"), strict=True)
    )
    for given in (values, with_holes(values)):
        assert_close(net_of(given, exact(), grid.spacing), expected, 1e-10)


def test_equivariance():
    values = samples_of("smooth_random", FLAT)
    net = net_of(values, exact(), FLAT.spacing)
    for axis in range(2):
        flipped = net_of(np.flip(values, axis), exact(), FLAT.spacing)
        assert_close(np.flip(flipped, axis), net, 1e-9)
    assert_close(net_of(values, exact(), np.multiply(FLAT.spacing, 1000)), net, 1e-9)
    assert_close(net_of(1 - 2 * values, exact(), FLAT.spacing), 1 - 2 * net, 1e-9)
    assert_close(net_of(values + 100, exact(), FLAT.spacing) - 100, net, 1e-9)
    tense = exact(tension=2.0, norm=1.5)
    net = net_of(values, tense, FLAT.spacing)
    assert_close(net_of(values, tense, np.multiply(FLAT.spacing, 1e-3)), net, 1e-9)
    assert_close(net_of(1e20 * values, tense, FLAT.spacing), 1e20 * net, 1e-9)


@SLOW
def test_axes_may_be_swapped():
    values = samples_of("smooth_random", FLAT)
    net = net_of(values, exact(), FLAT.spacing)
    assert_close(net_of(values.T, exact(), FLAT.spacing[::-1]).T, net, 1e-9)


@SLOW
def test_normals_from_second_derivatives_do_not_see_slopes():
    values = samples_of("ridge", FLAT)
    x, y = np.indices(FLAT.shape) * 2.0
    tilted = values + x - 0.5 * y
    u, v = (np.arange(3 * n - 2) / 3 * 2.0 for n in FLAT.shape)
    slope = u[:, None] - 0.5 * v

    def change(weight):
        method = exact(hessian_weight=weight)
        return np.abs(net_of(tilted, method) - slope - net_of(values, method)).max()

    assert change(1e6) < 1e-4 < 0.03 < change(0.0)


@SLOW
def test_normals_from_second_derivatives_suit_terrain():
    terrain = example("jacksboro").crop([(0, 161), (40, 201)]).values.astype(float)
    samples = terrain[::2, ::2]

    def error(**settings):
        method = cf.GlobalFairing(norm=1.0, tolerance=1e-3, **settings)
        return rms(np.asarray(cf.fair_field(samples, method=method).refine(2)) - terrain)

    both = error(thin_plate_weight=0.01, sharpness=2, hessian_weight=8.0)
    assert both < 0.97 * error(thin_plate_weight=0.01, sharpness=2)
    assert both < error(thin_plate_weight=1.0)


@BOTH
@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_scale_of_the_values(scale):
    values = np.float32(samples_of("ridge", FLAT))
    field = cf.fair_field(np.float32(scale) * values, method=cf.GlobalFairing())
    assert bool(field.report.converged)
    ours = np.asarray(field.control_points, float) / scale
    assert_close(ours, net_of(values, cf.GlobalFairing()), 1e-3)
    # A power of two changes nothing but exponents (and what is too small for float32).
    power = np.float32(2.0 ** round(np.log2(scale)))
    net = net_of(power * values, cf.GlobalFairing()) / power
    assert_close(net, net_of(values, cf.GlobalFairing()), 1e-7)


def test_noise_of_a_thin_plate_alone(rng):
    values = rng.normal(size=(9, 8))
    alone = cf.fair_field(values, method=cf.GlobalFairing(sigma=0.5, iterations=0))
    plate = cf.GlobalFairing(sigma=0.5, thin_plate_weight=1.0)
    assert_close(np.asarray(alone.control_points), net_of(values, plate), 1e-9)
    assert np.std(alone.samples - values) > 0.2


@BOTH
@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_scale_of_noisy_values_continued_beyond_the_border(scale, rng):
    values = np.float32(samples_of("ridge", FLAT)) + np.float32(rng.normal(0, 0.1, FLAT.shape))
    nets = [
        net_of(np.float32(s) * values, cf.GlobalFairing(sigma=0.1 * s, border_degree=2)) / s
        for s in (1.0, scale)
    ]
    assert_close(*nets, 1e-3)


@BOTH
def test_constants_and_one_outlier():
    constant = net_of(np.full(FLAT.shape, 3.7, np.float32), cf.GlobalFairing())
    np.testing.assert_array_equal(constant, np.float32(3.7))
    values = np.float32(samples_of("smooth_random", FLAT))
    values[2, 3] = 1e20
    field = cf.fair_field(values, method=cf.GlobalFairing())
    assert np.isfinite(field.control_points).all()
    np.testing.assert_array_equal(field.samples, values)


@SLOW
def test_float32_is_close_to_float64():
    for name in ("ridge", "disk", "smooth_random"):
        values = samples_of(name, FLAT)
        ours = net_of(np.float32(values), cf.GlobalFairing(), FLAT.spacing)
        assert_close(ours, net_of(values, cf.GlobalFairing(), FLAT.spacing), 1e-3)


def continued(values, degree):
    """Two more samples at either end of every axis, by one polynomial for every line."""
    for axis in range(values.ndim):
        lines = np.moveaxis(values, axis, 0)
        at = np.arange(len(lines))
        low, high = (
            np.polyfit(at[part], lines[part].reshape(degree + 1, -1), degree)
            for part in (slice(degree + 1), slice(-degree - 1, None))
        )
        before, after = (
            np.reshape([[np.polyval(p, x) for p in side.T] for x in places], (2, *lines.shape[1:]))
            for side, places in ((low, (-2, -1)), (high, at[-1] + [1, 2]))
        )
        values = np.moveaxis(np.concatenate([before, lines, after]), 0, axis)
    return values


def continued_sigma(sigma, degree):
    """Of the same samples, where noise is independent: squares add up, each with its weight's."""
    variance = 0.0
    for index in np.ndindex(sigma.shape):
        unit = np.zeros(sigma.shape)
        unit[index] = 1
        variance = variance + (continued(unit, degree) * sigma[index]) ** 2
    return np.sqrt(variance)


continued_by_package = jax.jit(continue_samples, static_argnums=2)


@pytest.mark.parametrize(("shape", "degree"), [((7, 6), 1), ((7, 6), 3), ((4, 5, 4), 2)])
def test_continued_samples_and_their_noise(shape, degree, rng):
    values, sigma = rng.normal(size=shape), rng.uniform(0.001, 0.02, shape)
    found = continued_by_package(values, sigma, degree)
    expected, spread = continued(values, degree), continued_sigma(sigma, degree)
    loud = spread > LOUDEST * np.ptp(values)
    assert not loud[(slice(LAYERS, -LAYERS),) * values.ndim].any()
    np.testing.assert_allclose(found.sigma, spread, rtol=1e-9)
    np.testing.assert_allclose(found.values, np.where(loud, np.nan, expected), atol=1e-9)


def test_noise_of_a_continued_line_by_hand():
    """A straight line through two samples, -1 and -2 times one and 2 and 3 times the other."""
    line = np.arange(7.0)[:, None] * np.ones(6)
    found = continued_by_package(line, np.full(line.shape, 0.01), 1)
    np.testing.assert_allclose(found.sigma[:2, 2:-2], 0.01 * np.sqrt([[13.0] * 6, [5.0] * 6]))
    np.testing.assert_allclose(found.values[:2, 2:-2], [[-2.0] * 6, [-1.0] * 6], atol=1e-12)


def test_noise_is_judged_at_the_samples_that_were_given():
    """Continued ones hold the field, but say nothing of its misfit; nor do missing ones."""
    sigma, missing = np.full((8, 7), 0.5), np.zeros((8, 7), bool)
    missing[3, 3] = missing[0, 0] = True
    for layers in (0, 2):
        noise = noise_of(jnp.asarray(sigma), jnp.asarray(missing), jnp.asarray(2.0), layers)
        given = ~missing
        np.testing.assert_allclose(noise.trust, np.where(given, 16.0, 0).ravel())
        given &= np.pad(np.ones([n - 2 * layers for n in sigma.shape], bool), layers)
        np.testing.assert_allclose(noise.judged, np.where(given, 16.0, 0).ravel())


def test_equals_the_twin_with_noise_and_a_continued_border(rng):
    """Continued samples are held within the noise that they have, and do not judge it."""
    grid = cases.Grid((5, 4), FLAT.spacing)
    values = samples_of("ridge", grid) + 0.05 * rng.normal(size=grid.shape)
    sigma = np.ptp(values) * rng.uniform(0.002, 0.008, grid.shape)
    wide, spread = continued(values, 2), continued_sigma(sigma, 2)
    wide[spread > LOUDEST * np.ptp(values)] = np.nan
    assert 4 <= np.isnan(wide).sum() <= 16  # loud: the outermost corners, and no more than corners
    ours = net_of(values, exact(sigma=sigma, border_degree=2), grid.spacing)
    expected = twin_net(wide, grid, exact(), sigma=spread, layers=LAYERS)
    assert_close(ours, expected[6:-6, 6:-6], 1e-8)


@SLOW
@pytest.mark.parametrize("shape", [(9, 7), (7, 6, 5)])
def test_a_continued_border_is_that_of_a_wider_grid(shape, rng):
    values = rng.normal(size=shape)
    method = exact(thin_plate_weight=0.2)
    wide = net_of(continued(values, 3), method)
    inside = tuple(slice(6, -6) for _ in shape)
    net = net_of(values, dataclasses.replace(method, border_degree=3))
    np.testing.assert_allclose(net, wide[inside], atol=1e-8 * np.ptp(values))


@SLOW
def test_a_continued_border_is_accurate_on_smooth_data():
    case = cases.ANALYTIC["franke"]
    plate = cf.GlobalFairing(thin_plate_weight=1.0, smoothness=0.02, iterations=0, tolerance=1e-6)
    errors = [
        rms(cf.fair_field(case.samples(24), method=method).refine(4) - case.samples(93))
        for method in (plate, dataclasses.replace(plate, border_degree=4))
    ]
    assert errors[1] < errors[0] / 5


@SLOW
def test_a_continued_border_with_holes_and_noise(rng):
    x = np.arange(12.0)
    smooth = np.sin(x[:, None] / 3) * np.cos(x / 4)
    holes = np.where(rng.uniform(size=smooth.shape) < 0.2, np.nan, smooth)
    holes[0, :] = np.nan
    method = cf.GlobalFairing(border_degree=4)
    field = cf.fair_field(holes, method=method)
    assert field.report.filled.shape == smooth.shape
    np.testing.assert_array_equal(field.report.filled, np.isnan(holes))
    assert rms(np.asarray(field.refine(1)) - smooth) < 0.05
    noisy = smooth + 0.1 * rng.normal(size=smooth.shape)
    fitted = cf.fair_field(noisy, method=dataclasses.replace(method, sigma=0.1)).refine(1)
    assert rms(fitted - smooth) < rms(noisy - smooth)
    weights = np.ones(tuple(n - 1 for n in smooth.shape))
    weighted = cf.fair_field(smooth, method=dataclasses.replace(method, cell_weights=weights))
    plain = cf.fair_field(smooth, method=method)
    np.testing.assert_allclose(weighted.refine(2), plain.refine(2), atol=1e-12)


@BOTH
def test_a_power_of_two_is_least_squares_however_it_is_given():
    values = jnp.asarray(samples_of("ridge", FLAT), jnp.zeros(()).dtype)
    nets = [
        cf.fair_field(values, method=cf.GlobalFairing(norm=norm)).control_points
        for norm in (2.0, None, jnp.array(2.0))
    ]
    assert_close(nets[1], nets[0], 1e-5)
    assert_close(nets[2], nets[0], 1e-5)


@SLOW
@pytest.mark.parametrize(
    "settings", [{}, {"converge": 1e-3, "iterations": 20}], ids=["iterations", "limit"]
)
def test_derivatives_compile_as_fast_for_large_grids(settings):
    def seconds(shape):
        method = cf.GlobalFairing(**settings)
        program = jax.jit(
            jax.grad(lambda v: jnp.sum(cf.fair_field(v, method=method).control_points ** 2))
        )
        lowered = program.lower(jax.ShapeDtypeStruct(shape, jnp.float32))
        start = time.perf_counter()
        lowered.compile()
        return time.perf_counter() - start

    assert seconds((2000, 2001)) < 2.5 * seconds((40, 41))


def test_thin_plate_alone():
    """Weight 1, no iterations and a constant tensor are the same."""
    values = samples_of("smooth_random", FLAT)
    ours = net_of(values, exact(thin_plate_weight=1.0), FLAT.spacing)
    expected = global_twin.fair_net(values, FLAT.spacing, iterations=0)
    assert_close(ours, expected, 1e-8)


@pytest.mark.both_precisions
@pytest.mark.parametrize("method", [cf.GlobalFairing(border_degree=1), cf.LocalFairing()])
def test_precisions_follow_each_other_in_one_process(method, rng, x64):
    values = rng.normal(size=(5, 6)).astype(np.float32)
    nets = []
    for wide in (True, False, True):
        with jax.enable_x64(wide):
            nets.append(np.asarray(cf.fair_field(values, method=method).control_points))
    assert {net.dtype for net in nets} == {np.dtype(np.float32)}
    assert_close(nets[0], nets[1], 1e-3)
    np.testing.assert_array_equal(nets[0], nets[2])


# Accuracy and convergence ----------------------------------------------------------------


@functools.cache
def fit_of(name):
    """The field of an analytic case with the settings of the accuracy figures."""
    case = cases.ANALYTIC[name]
    return cf.fair_field(case.samples(), spacing=case.spacing, method=clean())


@SLOW
@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("ridge", 0.0110),
        ("step", 0.0060),
        ("disk", 0.0090),
        ("cone", 0.0053),
        ("franke", 0.0018),
        ("marschner_lobb_slice", 0.0078),
    ],
)
def test_accuracy(name, most):
    error = np.asarray(fit_of(name).refine(8)) - cases.ANALYTIC[name].refined(8)
    assert rms(error) < most + 0.00005  # figures are rounded to four places


@SLOW
@pytest.mark.parametrize(
    ("settings", "most"),
    [
        ({}, 0.0049),
        ({"thin_plate_weight": 0.001, "coherence": 1.5}, 0.0030),
        ({"thin_plate_weight": 0.001, "coherence": 1.5, "smoothness": 0.1}, 0.0018),
    ],
)
def test_accuracy_of_a_volume(settings, most):
    case = cases.ANALYTIC["marschner_lobb"]
    field = cf.fair_field(case.samples(), spacing=case.spacing, method=clean(**settings))
    error = np.asarray(field.refine(4)) - case.refined(4)
    assert rms(error[16:-16, 16:-16, 16:-16]) < most


@pytest.mark.parametrize(
    ("name", "most"), [("ridge", 0.0093), ("step", 0.0053), ("disk", 0.0054), ("cone", 0.0049)]
)
def test_power_one_is_more_accurate(name, most):
    case = cases.ANALYTIC[name]
    field = cf.fair_field(case.samples(), spacing=case.spacing, method=clean(norm=1.0))
    assert rms(np.asarray(field.refine(8)) - case.refined(8)) < most + 0.00005


@SLOW
def test_power_one_bends_in_fewer_places():
    """The sum of the powers of the energies is smaller with that power, and their sum larger."""
    values = cases.ANALYTIC["step"].samples()
    fields = [
        cf.fair_field(values, method=exact(1, thin_plate_weight=1.0, norm=p)) for p in (2.0, 1.0)
    ]
    points = np.stack(np.meshgrid(*[(np.arange(36) + 0.5) / 4] * 2, indexing="ij"), axis=-1)
    squares = [np.sum(np.asarray(field.hessian(points)) ** 2, axis=(-2, -1)) for field in fields]
    energies = [s.reshape(9, 4, 9, 4).sum(axis=(1, 3)) for s in squares]
    assert np.sqrt(energies[1]).sum() < 0.98 * np.sqrt(energies[0]).sum()
    assert energies[1].sum() > energies[0].sum()


@pytest.mark.parametrize("name", ["ridge", "step", "disk"])
def test_updates_shrink(name):
    report = fit_of(name).report
    updates = np.asarray(report.updates)
    assert bool(report.converged)
    assert updates.shape == report.steps.shape == report.residuals.shape == (4,)
    assert (np.asarray(report.residuals) <= 1e-4).all()
    assert (updates[2:] < updates[1:-1] / 2).all()
    assert not np.asarray(report.filled).any()


@SLOW
def test_a_step_limit_is_reported():
    method = cf.GlobalFairing(max_steps=1)
    values = cases.ANALYTIC["ridge"].samples()
    with pytest.warns(UserWarning, match="max_steps"):
        field = cf.fair_field(values, method=method)
    assert not bool(field.report.converged)
    assert float(field.report.residuals.max()) > 1e-4
    np.testing.assert_array_equal(field.report.steps, 1)
    np.testing.assert_array_equal(field.samples, values)
    # Inside jit the flag is all: a warning would fail here.
    report = jax.jit(lambda v: cf.fair_field(v, method=method).report)(values)
    assert not bool(report.converged)


# Holes -----------------------------------------------------------------------------------


def scattered(shape):
    return np.random.default_rng(1).uniform(size=shape) < 0.3


def nearly_all(shape):
    return np.random.default_rng(2).uniform(size=shape) < 0.85


def corners(shape):
    rows, columns = np.indices(shape)
    rows, columns = (np.minimum(k, n - 1 - k) for k, n in zip((rows, columns), shape, strict=True))
    return rows + columns < 3


def rows(shape):
    return np.isin(np.indices(shape)[0], (0, 5))


def block(shape):
    return (np.indices(shape) // 3 == 1).all(axis=0)


# Largest error on a smooth field over its spread.
# Corners and a row at the border are extrapolated.
HOLES = {block: 0.002, scattered: 0.05, rows: 0.08, corners: 0.12, nearly_all: 0.3}


def smooth_field():
    x, y = cases.ANALYTIC["ridge"].points()
    return np.sin(1.5 * x + 0.4) * np.cos(y)


@pytest.mark.parametrize("pattern", HOLES)
def test_holes_are_filled(pattern):
    truth = smooth_field()
    missing = pattern(truth.shape)
    field = cf.fair_field(np.where(missing, np.nan, truth), method=clean())
    assert bool(field.report.converged)
    np.testing.assert_array_equal(field.report.filled, missing)
    np.testing.assert_array_equal(np.asarray(field.samples)[~missing], truth[~missing])
    net = np.asarray(field.control_points)
    assert np.isfinite(net).all()
    assert_c1(net)
    assert np.abs(field.samples - truth).max() < HOLES[pattern] * np.ptp(truth)


@pytest.mark.parametrize("known", [1, 2])
def test_hardly_anything_is_known(known):
    values = np.full((10, 10), np.nan)
    values.flat[[34, 71][:known]] = [3.0, 4.0][:known]
    field = cf.fair_field(values, method=clean())
    net = np.asarray(field.control_points)
    assert np.isfinite(net).all()
    if known == 1:
        np.testing.assert_allclose(net, 3.0, atol=1e-6)


def test_nothing_is_known():
    with pytest.raises(ValueError, match=r"^values must hold at least one sample"):
        cf.fair_field(np.full((6, 5), np.nan), method=cf.GlobalFairing())


# Noise -----------------------------------------------------------------------------------


def noisy_field(sigma, size=24):
    """A smooth truth, the same with noise."""
    truth = cases.franke(*np.meshgrid(*[np.linspace(-1, 1, size)] * 2, indexing="ij"))
    return truth, truth + sigma * np.random.default_rng(5).normal(size=truth.shape)


@SLOW
@pytest.mark.parametrize(("sigma", "gain"), [(0.005, 1.5), (0.02, 1.8), (0.05, 2.5), (0.1, 3)])
def test_noise_is_met_and_removed(sigma, gain):
    truth, values = noisy_field(sigma)
    samples = np.asarray(cf.fair_field(values, method=cf.GlobalFairing(sigma=sigma)).samples)
    # Below 1 by the degrees of freedom of the field.
    assert 0.6 < rms(samples - values) / sigma < 1
    assert rms(samples - truth) < rms(values - truth) / gain


@SLOW
def test_the_true_noise_is_nearly_the_best():
    truth, values = noisy_field(0.05)
    errors = {
        part: rms(cf.fair_field(values, method=cf.GlobalFairing(sigma=0.05 * part)).samples - truth)
        for part in (0.25, 0.5, 1, 2, 4)
    }
    assert errors[1] == min(errors.values())


@SLOW
def test_more_iterations_follow_the_noise_neither_more_nor_less():
    _, values = noisy_field(0.05)
    misfits = [
        rms(cf.fair_field(values, method=cf.GlobalFairing(sigma=0.05, **given)).samples - values)
        for given in ({}, {"iterations": 12}, {"iterations": 60, "converge": 1e-3})
    ]
    assert misfits == pytest.approx([misfits[-1]] * 3, rel=0.08)


@SLOW
def test_little_noise_is_nearly_none():
    """Also for normals that an over-smooth first fit would lose for good."""
    values = cases.ANALYTIC["marschner_lobb_slice"].samples()
    method = cf.GlobalFairing(thin_plate_weight=0.001, sharpness=2, tension=1000.0)
    exact = cf.fair_field(values, method=method).refine(2)
    noise = 1e-3 * rms(values - values.mean())
    near = cf.fair_field(values, method=dataclasses.replace(method, sigma=noise)).refine(2)
    assert rms(near - exact) < 5 * noise


@SLOW
def test_degrees_of_freedom_are_those_of_the_linear_fit():
    """The misfit is `n - tr H`, with the trace from how the field follows many random signs."""
    _, values = noisy_field(0.05, size=9)
    method = cf.GlobalFairing(thin_plate_weight=1.0, sigma=0.05, iterations=30, tolerance=1e-8)

    @jax.jit
    def fitted(samples):
        return cf.fair_field(samples, method=method).samples.ravel()

    misfit = (np.asarray(fitted(values)) - values.ravel()) / 0.05
    step, rng, before, followed = 1e-5, np.random.default_rng(0), fitted(values), []
    for _ in range(100):
        signs = rng.choice([-1.0, 1.0], values.shape)
        change = np.asarray(fitted(values + step * signs) - before)
        followed.append(signs.ravel() @ change / step)
    trace = np.mean(followed)
    assert misfit @ misfit == pytest.approx(values.size - trace, rel=0.1)


@SLOW
def test_samples_that_are_continued_beyond_the_border_do_not_count_as_noise():
    _, values = noisy_field(0.05)
    free, continued = (
        rms(cf.fair_field(values, method=cf.GlobalFairing(sigma=0.05, **given)).samples - values)
        for given in ({"iterations": 20}, {"iterations": 20, "border_degree": 4})
    )
    assert continued == pytest.approx(free, rel=0.03)


@SLOW
def test_noise_that_varies():
    """Samples that are known better are followed more closely."""
    truth, _ = noisy_field(0)
    sigma = np.where(np.indices(truth.shape)[0] < 12, 0.005, 0.1)
    values = truth + sigma * np.random.default_rng(5).normal(size=truth.shape)
    samples = np.asarray(
        cf.fair_field(values, method=cf.GlobalFairing(sigma=sigma, iterations=6)).samples
    )
    assert 0.6 < rms((samples - values) / sigma) < 1
    for half in (slice(12), slice(12, None)):
        assert rms((samples - truth)[half]) < 0.8 * rms((values - truth)[half])


def test_quantised_data():
    truth, _ = noisy_field(0)
    step = 0.1
    values = step * np.round(truth / step)
    method = cf.GlobalFairing(sigma=step / np.sqrt(12))
    samples = np.asarray(cf.fair_field(values, method=method).samples)
    assert rms(samples - truth) < rms(values - truth) / 1.5
    assert np.abs(samples - values).max() < 1.5 * step


# The limiter -----------------------------------------------------------------------------


def cell_ranges(samples):
    """Smallest and largest sample of every cell, by a loop."""
    low = np.zeros([n - 1 for n in samples.shape])
    high = np.zeros_like(low)
    for cell in np.ndindex(*low.shape):
        corners = samples[tuple(slice(k, k + 2) for k in cell)]
        low[cell], high[cell] = corners.min(), corners.max()
    return low, high


def limited(dofs, shape):
    """Slopes of every vertex times the largest factor that keeps its points within their cells.

    The points lie a third of a cell along some of the axes from the vertex; each counts in every
    cell that it belongs to.
    """
    ndim = len(shape)
    parts = list(np.ndindex(*(2,) * ndim))
    low, high = cell_ranges(dofs[0].reshape(shape))
    dofs = dofs.reshape(-1, *shape).copy()
    for vertex in np.ndindex(*shape):
        slopes, value, factor = dict(zip(parts, dofs[(..., *vertex)], strict=True)), 0.0, 1.0
        value = slopes.pop((0,) * ndim)
        for side in np.ndindex(*(2,) * ndim):
            cell = tuple(v - 1 + s for v, s in zip(vertex, side, strict=True))
            if any(c < 0 or c >= n for c, n in zip(cell, low.shape, strict=True)):
                continue
            thirds = (2 * np.array(side) - 1) / 3
            for point in parts:
                rise = sum(
                    np.prod((thirds * point)[np.array(part, bool)]) * slope
                    for part, slope in slopes.items()
                )
                room = (high[cell] - value) if rise > 0 else (value - low[cell])
                if abs(rise) > room:
                    factor = min(factor, room / abs(rise))
        dofs[(slice(1, None), *vertex)] *= factor
    return dofs.reshape(len(dofs), -1)


@pytest.mark.parametrize("shape", [(6, 5), (4, 3, 4)])
def test_the_limiter_takes_no_more_than_it_has_to(shape, rng):
    values = rng.normal(size=shape).ravel()
    slopes = rng.normal(size=(2 ** len(shape) - 1, values.size)) * rng.uniform(0, 2, values.size)
    dofs = np.concatenate([values[None], slopes])
    ours = np.asarray(jax.jit(limit_slopes, static_argnums=1)(dofs, shape))
    expected = limited(dofs, shape)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12)
    untouched = (ours == dofs).all(axis=0).mean()
    assert 0.02 < untouched < 0.9


@pytest.mark.parametrize("grid", [FLAT, pytest.param(SOLID, marks=SLOW)], ids=["2d", "3d"])
def test_limiter(grid):
    for name in ("sharp_step", "noise", "ridge", "spike"):
        values = samples_of(name, grid)
        field = cf.fair_field(values, spacing=grid.spacing, method=exact(limit=True))
        net = np.asarray(field.control_points)
        np.testing.assert_array_equal(samples_in(net), values)
        assert_c1(net)
        low, high = cell_ranges(values)
        lower, upper = (np.asarray(bound) for bound in field.bounds())
        assert (lower >= low - 1e-12).all()
        assert (upper <= high + 1e-12).all()
        free = cf.fair_field(values, spacing=grid.spacing, method=exact())
        assert (np.asarray(free.bounds()[1]) > high + 1e-3).any()


# Bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("thin_plate_weight", 0.0),
        ("thin_plate_weight", -0.1),
        ("thin_plate_weight", 1.5),
        ("thin_plate_weight", np.nan),
        ("thin_plate_weight", None),
        ("thin_plate_weight", "0.05"),
        ("thin_plate_weight", [0.1, 0.2]),
        ("thin_plate_weight", 1j),
        ("coherence", "a"),
        ("tension", None),
        ("sigma", "a"),
        ("converge", "a"),
        ("tolerance", "a"),
        ("limit", 3),
        ("coarse_grids", "a"),
        ("coherence", -0.1),
        ("coherence", 3.0),
        ("sharpness", 0),
        ("sharpness", 1.5),
        ("iterations", -1),
        ("tension", -1.0),
        ("smoothness", -1.0),
        ("hessian_weight", -1.0),
        ("border_degree", 6),
        ("border_degree", 1.5),
        ("norm", 0.9),
        ("norm", 2.1),
        ("tension", np.inf),
        ("sigma", 0.0),
        ("sigma", -1.0),
        ("sigma", np.array([1.0, np.nan])),
        ("cell_weights", np.zeros((5, 4))),
        ("cell_weights", -np.ones((5, 4))),
        ("tolerance", 0.0),
        ("max_steps", 0),
    ],
)
def test_settings_are_checked(name, value):
    with refused(ValueError, match=f"^{name} must .*got"):
        cf.GlobalFairing(**{name: value})


@pytest.mark.parametrize(
    ("name", "shape"), [("sigma", (5, 6)), ("sigma", (5,)), ("cell_weights", (6, 5))]
)
def test_shapes_of_settings_are_checked(name, shape):
    method = cf.GlobalFairing(**{name: np.ones(shape)})
    with pytest.raises(ValueError, match=f"^{name} must .*got shape"):
        cf.fair_field(np.ones((6, 5)), method=method)


@pytest.mark.parametrize(
    ("name", "shape"), [("sigma", (5, 6)), ("sigma", (5,)), ("cell_weights", (6, 5))]
)
def test_shapes_of_settings_are_checked_inside_jit(name, shape):
    method = cf.GlobalFairing(**{name: np.ones(shape)})
    with pytest.raises(ValueError, match=f"^{name} must .*got shape"):
        jax.eval_shape(lambda v: cf.fair_field(v, method=method), np.ones((6, 5)))


# Derivatives and batches -----------------------------------------------------------------

FACTORS = np.random.default_rng(7).normal(size=(16, 13))
ARGUMENTS = {
    "values": samples_of("smooth_random", FLAT),
    "spacing": np.array(FLAT.spacing),
    "thin_plate_weight": np.array(0.1),
    "coherence": np.array(1.2),
    "tension": np.array(0.3),
    "hessian_weight": np.array(0.4),
}


def loss(arguments):
    """A number that depends on every control point."""
    settings = {k: v for k, v in arguments.items() if k not in ("values", "spacing")}
    field = cf.fair_field(
        arguments["values"], spacing=arguments["spacing"], method=exact(**settings)
    )
    return jnp.sum(jnp.sin(field.control_points) * FACTORS)


gradient_of = jax.jit(jax.grad(loss))


@functools.cache
def gradient():
    return gradient_of(ARGUMENTS)


def direction_of(name):
    size = ARGUMENTS[name].shape
    return np.random.default_rng(8).normal(size=size) if size else np.array(1.0)


@SLOW
@pytest.mark.parametrize("name", ARGUMENTS)
def test_gradients(name):
    step = 1e-5
    direction = direction_of(name)
    ends = [
        float(loss(ARGUMENTS | {name: ARGUMENTS[name] + sign * step * direction}))
        for sign in (1, -1)
    ]
    difference = (ends[0] - ends[1]) / (2 * step)
    assert abs(difference) > 1e-3
    assert float(np.vdot(gradient()[name], direction)) == pytest.approx(difference, rel=1e-5)


@SLOW
def test_gradients_at_holes_and_flat_data_are_finite():
    for values in (with_holes(ARGUMENTS["values"]), np.full(FLAT.shape, 3.7)):
        found = gradient_of(ARGUMENTS | {"values": values})
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
        np.testing.assert_array_equal(np.asarray(found["values"])[np.isnan(values)], 0)


@pytest.mark.parametrize(
    "sigma", [pytest.param(None, marks=SLOW, id="exact"), pytest.param(0.3, id="noise")]
)
def test_earlier_solves_of_a_derivative_are_as_exact_as_the_last(sigma, monkeypatch, rng):
    """In reverse mode each hands down the size of its right-hand side, or a larger one before it.

    Sizes are in the norm of the inverse blocks of the vertices.  Beside a far larger size nothing
    is solved, as if the field were that of the samples with slopes that are given.
    """
    values, shape, stiffness = jnp.asarray(rng.normal(size=(4, 5))), (4, 5), 0.7
    dofs, pulled = (rng.normal(size=(4, 20)) for _ in range(2))
    method = cf.GlobalFairing(sigma=sigma, tolerance=1e-6)

    def iterate(values, weight, size):
        """The field, and the size, after one iteration from a field that is given."""
        found = []

        def renew(renewal, state, powers, _):
            springs = state.springs and Springs(*map(jnp.asarray, (stiffness, jnp.inf, 1.0)))
            before = state._replace(dofs=jnp.asarray(dofs), springs=springs, size=size)
            after, _ = renewal(before, powers._replace(thin_plate_weight=weight))
            found.extend((after.dofs, after.size))
            return state.dofs, Info(jnp.zeros(1), jnp.zeros(1, int), jnp.zeros(1))

        monkeypatch.setattr("contourfair_jax._fairing.global_fairing.method.renew", renew)
        method.fit(values, jnp.ones(2))
        return tuple(found)

    @jax.jit
    def pull(in_field, in_size):
        return jax.vjp(iterate, values, 0.05, 0.0)[1]((in_field, in_size))

    settings = global_twin.Settings()
    unknowns = dofs.T.ravel()
    tensors = global_twin.structure_tensors(unknowns, shape, (1.0, 1.0), 0.0)
    normals = global_twin.normal_tensors(global_twin.smoothed(tensors, 1.2, 2), 1, 2)
    matrix = global_twin.energy_matrix(normals, unknowns, shape, (1.0, 1.0), settings)
    blocks = np.array([matrix[k : k + 4, k : k + 4] for k in range(0, 80, 4)])
    first = 1
    if sigma:
        blocks[:, 0, 0] += stiffness * (np.ptp(values) / sigma) ** 2
        first = 0
    squares = [
        right[first:] @ np.linalg.solve(block[first:, first:], right[first:])
        for block, right in zip(blocks, pulled.T, strict=True)
    ]
    own = np.sqrt(np.sum(squares))

    alone = pulled[0].reshape(shape) / np.ptp(values)
    for given in own * np.array([0.0, 0.5, 2.0, 1e9]):
        in_values, _, size = pull(pulled, given)
        assert float(size) == pytest.approx(max(own, given), rel=1e-9)
        assert np.allclose(in_values, alone, rtol=1e-12) == (given == 1e9 * own)


@SLOW
def test_forward_and_reverse_agree():
    tangents = {name: direction_of(name) for name in ARGUMENTS}
    forward = jax.jit(lambda t: jax.jvp(loss, (ARGUMENTS,), (t,))[1])(tangents)
    reverse = sum(np.vdot(gradient()[name], tangents[name]) for name in ARGUMENTS)
    assert float(forward) == pytest.approx(float(reverse), rel=1e-8)


@SLOW
def test_without_compilation(rng):
    """`jax.disable_jit`, by which users look for their NaN, gives the same values and gradients."""
    method, values = exact(norm=1.5), rng.standard_normal((4, 5))

    def loss(values):
        return jnp.sum(cf.fair_field(values, method=method)(jnp.array([[1.5, 2.5], [0.2, 0.3]])))

    value, gradient = jax.value_and_grad(loss)(values)
    with jax.disable_jit():
        again, gradient_again = jax.value_and_grad(loss)(values)
    assert_close(again, value, 1e-10)
    assert_close(gradient_again, gradient, 1e-8)


@SLOW
def test_batches():
    batch = np.stack([samples_of(name, FLAT) for name in ("ridge", "noise", "smooth_random")])

    def net(values):
        return cf.fair_field(values, spacing=FLAT.spacing, method=exact()).control_points

    ours = jax.jit(jax.vmap(net))(batch)
    for values, one in zip(batch, ours, strict=True):
        assert_close(one, net_of(values, exact(), FLAT.spacing), 1e-9)


# The form --------------------------------------------------------------------------------


@BOTH
def test_structure_of_gentle_slopes_on_a_high_value(x64, rng):
    """A common value is no slope: in float32 its rounding errors would outweigh gentle ones."""
    form = structure_form(jnp.ones(2), (5, 4))
    dofs = jnp.asarray(1e-5 * rng.normal(size=(4, 20)), jnp.ones(()).dtype)
    lifted = dofs.at[0].set(-0.5)
    ours, expected = (
        np.asarray(form.densities(each)).reshape(3, 5, 4)[:, :-1, :-1]  # the last are no cells
        for each in (lifted, lifted.at[0].set(0.0))
    )
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


@SLOW
@pytest.mark.parametrize("shape", [(5, 4), (3, 4, 3)])
def test_the_form_is_symmetric_and_positive(shape, rng):
    """`apply` and `apply_in_place` are one symmetric matrix, without negative eigenvalues."""
    ndim = len(shape)
    form = energy_form(jnp.array([1.0, 1.5, 0.7][:ndim]), shape, 0.5, 0.1)
    vectors = rng.normal(size=(2, ndim))
    axes = [(a, b) for a in range(ndim) for b in range(a, ndim)]
    normals = vectors[0] / np.linalg.norm(vectors[0])
    tensor = [float(a == b) - 0.9 * normals[a] * normals[b] for a, b in axes]
    cells = np.pad(rng.uniform(0.5, 2, [n - 1 for n in shape]), [(0, 1)] * ndim).ravel()
    weights = jnp.asarray(np.multiply.outer(tensor, cells))
    size = 2**ndim * int(np.prod(shape))
    unit = jnp.eye(size).reshape(size, 2**ndim, -1)
    columns = jax.jit(jax.vmap(lambda x: form.apply(weights, x)))(unit)
    matrix = np.asarray(columns).reshape(size, size)
    scale = np.abs(matrix).max()
    np.testing.assert_allclose(matrix, matrix.T, rtol=0, atol=1e-13 * scale)
    eigenvalues = np.linalg.eigvalsh(matrix)
    assert eigenvalues[0] > -1e-12 * eigenvalues[-1]
    assert eigenvalues[1] > 1e-9 * eigenvalues[-1]  # only constants are free
    dofs = jnp.asarray(rng.normal(size=(2**ndim, int(np.prod(shape)))))
    expected = form.apply(weights, dofs)
    assert_close(form.apply_in_place(weights, dofs), expected, 1e-13)


@SLOW
@pytest.mark.parametrize("shape", [(5, 4), (3, 4, 3)])
def test_in_place_in_several_chunks(shape, rng, monkeypatch):
    form = structure_form(jnp.ones(len(shape)), shape)
    groups, twos, vertices = len(form.matrices), 2 ** len(shape), int(np.prod(shape))
    weights = jnp.asarray(rng.normal(size=(groups, vertices)))
    # Vertices on an upper border number no cell.
    inside = (np.indices(shape) < np.reshape(shape, (-1,) + (1,) * len(shape)) - 1).all(axis=0)
    weights = weights * jnp.asarray(inside.ravel()[None], weights.dtype)
    dofs = jnp.asarray(rng.normal(size=(twos, vertices)))
    whole = form.apply(weights, dofs)
    densities = form.densities(dofs)
    small = WorkingSet(window_vertices=10, batch_bytes=5_000, cores=1, core_bytes=5_000)
    monkeypatch.setattr(
        "contourfair_jax._fairing.global_fairing.cell_form.working_set", lambda: small
    )
    assert form._chunk_size() < vertices
    assert_close(form.apply(weights, dofs), whole, 1e-13)
    assert_close(form.apply_in_place(weights, dofs), whole, 1e-13)
    assert_close(form.densities(dofs), densities, 1e-13)


@SLOW
@BOTH
def test_no_foreign_calls():
    """Noise, weights and the limiter call no LAPACK either; a bare method: `test_watchdog`."""
    method = cf.GlobalFairing(sigma=0.1, cell_weights=np.ones((5, 4), np.float32), limit=True)

    def total(values):
        return cf.fair_field(values, method=method).control_points.sum()

    lowered = jax.jit(jax.value_and_grad(total)).lower(jax.ShapeDtypeStruct((6, 5), "float32"))
    assert "custom_call" not in lowered.as_text()


@BOTH
def test_report_is_of_the_samples_dtype():
    values = np.float32(samples_of("ridge", FLAT))
    report = cf.fair_field(values, method=cf.GlobalFairing()).report
    assert {str(leaf.dtype) for leaf in (report.updates, report.residuals)} == {"float32"}
    assert {report.converged.dtype.kind, report.filled.dtype.kind} == {"b"}
    assert eqx.tree_equal(report, cf.fair_field(values, method=cf.GlobalFairing()).report)
