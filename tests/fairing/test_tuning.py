"""Settings chosen by cross-validation: what is chosen, what is refused, and derivatives."""

import functools

import cases
import global_twin
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.stats import chi2
from shape_checks import refused

import contourfair_jax as cf
from contourfair_jax._fairing.tuning import (
    CANDIDATES,
    HANDICAP,
    NOISES,
    PROBE,
    SMOOTH,
    Errors,
    _exact,
    _noisy,
    errors_of,
)

BOTH = pytest.mark.both_precisions
SLOW = pytest.mark.slow
RIDGE = cases.ANALYTIC["ridge"].samples()
NOISE = np.random.default_rng(3).normal(size=RIDGE.shape)
HOLES = np.where(np.random.default_rng(4).uniform(size=RIDGE.shape) < 0.2, np.nan, RIDGE)


@functools.cache
def tuned(name):
    """The method chosen for a field; all have one shape, so one program serves them."""
    fields = {
        "ridge": RIDGE,
        "noise": NOISE,
        "constant": np.full(RIDGE.shape, 3.7),
        "holes": HOLES,
    }
    return cf.tune(fields[name])


def settings(method):
    return (
        float(method.thin_plate_weight),
        method.sharpness,
        float(method.tension),
        float(method.smoothness),
        float(method.norm),
        float(method.hessian_weight),
        float(method.coherence),
    )


@SLOW
@BOTH
def test_small_weights_for_a_ridge(x64):
    method = cf.tune(RIDGE if x64 else np.float32(RIDGE))
    assert isinstance(method, cf.GlobalFairing)
    assert method.sharpness == 2
    assert float(method.thin_plate_weight) <= 0.01


def test_deterministic():
    assert settings(cf.tune(RIDGE)) == settings(tuned("ridge"))


@SLOW
def test_no_worse_than_a_spline_on_smooth_fields():
    x = np.linspace(-1, 1, 49)
    smooth = np.sin(7 * x[:, None] + x) * np.cos(6 * x + 2 * x[:, None] ** 2)
    samples = smooth[::2, ::2]
    method = cf.tune(samples)
    assert method.border_degree > 0
    spline = make_interp_spline(x[::2], make_interp_spline(x[::2], samples)(x), axis=1)(x)
    error = np.abs(np.asarray(cf.fair_field(samples, method=method).refine(2)) - smooth)
    assert np.sqrt(np.mean(error**2)) < np.sqrt(np.mean((spline - smooth) ** 2))


@SLOW
def test_chosen_settings_are_more_accurate():
    case = cases.ANALYTIC["ridge"]
    errors = [
        np.sqrt(np.mean((cf.fair_field(RIDGE, method=m).refine(8) - case.refined(8)) ** 2))
        for m in (tuned("ridge"), cf.GlobalFairing(thin_plate_weight=1.0))
    ]
    assert errors[0] < errors[1] / 2


@SLOW
def test_waves_that_the_samples_just_resolve():
    """They look like noise where every other sample is dropped, but not where one in five is."""
    case = cases.ANALYTIC["marschner_lobb_slice"]
    waves, samples = case.refined(4), case.samples()
    field = cf.fair_field(samples, method=cf.tune(samples))
    plate = cf.fair_field(samples, method=cf.GlobalFairing(thin_plate_weight=1.0))
    ours, theirs = (np.std(each.refine(4) - waves) for each in (field, plate))
    assert ours < theirs / 5


@SLOW
def test_rings():
    """Along contours of one length scale smoothness pays, as small thin plate weights do."""
    x = np.linspace(-1, 1, 129)
    rings = np.cos(16 * np.pi / 3.5 * np.hypot(x[:, None] - 0.2, x + 0.1))
    samples = rings[::4, ::4]
    methods = cf.tune(samples), cf.GlobalFairing(), cf.GlobalFairing(thin_plate_weight=1.0)
    ours, default, plate = (
        np.std(cf.fair_field(samples, method=each).refine(4) - rings) for each in methods
    )
    assert ours < default / 2
    assert ours < plate / 4


def test_tension_for_noise():
    """Between samples that know nothing of each other, the flattest field is the best guess."""
    weight, _, tension, *_ = settings(tuned("noise"))
    assert weight == 1
    assert tension >= 4


@SLOW
def test_scale_spacing_and_offset_do_not_matter():
    for values, spacing in ((1e6 * RIDGE + 1e3, 1.0), (RIDGE, 30.0), (-RIDGE, (1.0, 1.0))):
        assert settings(cf.tune(values, spacing=spacing)) == settings(tuned("ridge"))


@SLOW
@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_squares_of_samples_may_leave_the_range_of_single_precision(scale):
    values = np.float32(RIDGE) + np.float32(0.1 * NOISE)
    ours, expected = (cf.tune(x, noisy=True) for x in (np.float32(scale) * values, values))
    assert settings(ours) == settings(expected)
    assert ours.sigma / scale == pytest.approx(expected.sigma, rel=1e-3)


def test_missing_samples():
    method = tuned("holes")
    assert float(method.tension) == 0
    filled = [
        np.asarray(cf.fair_field(HOLES, method=each).samples)[np.isnan(HOLES)]
        for each in (method, cf.GlobalFairing(thin_plate_weight=1.0))
    ]
    ours, plate = (np.sqrt(np.mean((each - RIDGE[np.isnan(HOLES)]) ** 2)) for each in filled)
    assert ours < 0.7 * plate


def test_constant():
    """Nothing tells the candidates apart: the first."""
    *setting, _ = settings(tuned("constant"))
    assert tuple(setting) == CANDIDATES[0][:6]


def test_sigma_is_passed_on():
    assert cf.tune(RIDGE, sigma=0.01).sigma == 0.01
    with pytest.raises(ValueError, match=r"^sigma must"):
        cf.tune(RIDGE, sigma=-1.0)
    with pytest.raises(ValueError, match=r"^noisy chooses sigma"):
        cf.tune(RIDGE, sigma=0.1, noisy=True)


@SLOW
def test_noise_is_found():
    x = np.linspace(-1, 1, 40)
    truth = np.tanh(6 * (np.hypot(x[:, None] - 0.1, x + 0.05) - 0.6))
    noise = np.random.default_rng(6).normal(size=truth.shape)
    for sigma in (0.02, 0.2):
        values = truth + sigma * noise
        method = cf.tune(values, noisy=True)
        assert float(method.sigma) == pytest.approx(sigma, rel=0.25)
        error = np.asarray(cf.fair_field(values, method=method).samples) - truth
        assert np.sqrt(np.mean(error**2)) < 0.7 * np.std(values - truth)


@SLOW
@BOTH
def test_samples_without_noise_are_met_as_exactly_as_they_are_known(x64):
    method = cf.tune(RIDGE if x64 else np.float32(RIDGE), noisy=True)
    assert method.sigma is None or float(method.sigma) < 0.01


def test_constant_samples_have_no_noise():
    assert cf.tune(np.full(RIDGE.shape, 3.7), noisy=True).sigma is None


@SLOW
def test_volume():
    x, y, z = np.meshgrid(*[np.linspace(-1, 1, 7)] * 3, indexing="ij")
    method = cf.tune(np.exp(-((4 * (x - 0.8 * y + 0.3 * z)) ** 2)))
    assert float(method.thin_plate_weight) < 1


# How errors are judged -------------------------------------------------------------------


def test_errors_at_dropped_samples_by_hand():
    """Everywhere, away from the border, and the mean square that normal errors have by median."""
    dropped = np.indices(RIDGE.shape).sum(axis=0) % 2 == 1
    given = np.where(dropped, np.nan, RIDGE)
    net = global_twin.fair_net(given, (1.0, 1.0), iterations=0, smoothness=PROBE.smoothness)
    squares = (net[::3, ::3] - RIDGE) ** 2
    inner = np.pad(np.ones((8, 8), bool), 1)
    found = errors_of(PROBE, jnp.asarray(RIDGE), jnp.ones(2), [jnp.asarray(dropped)])
    expected = (
        squares[dropped].mean(),
        squares[dropped & inner].mean(),
        np.median(squares[dropped]) / chi2.median(1),
    )
    np.testing.assert_allclose(found, expected, rtol=2e-3)
    assert abs(found.inside / found.everywhere - 1) > 0.05


@pytest.mark.parametrize("part", ["everywhere", "inside", "typical"])
def test_smooth_samples_are_recognised_away_from_the_border(part):
    """Where the probe is better there, whatever it is at the border; and nowhere else."""
    better, worse = (1 / HANDICAP - 0.01, 1 / HANDICAP + 0.01)

    def judge(candidate):
        return probed if candidate == PROBE else Errors(1.0, 1.0, 1.0)

    tried = list(CANDIDATES)
    probed = Errors(worse, worse, worse)._replace(**{part: better})
    assert (_exact(tried, judge, None)[0] == SMOOTH) == (part == "inside")
    probed = Errors(better, better, better)._replace(**{part: worse})
    assert (_exact(tried, judge, None)[0] == SMOOTH) == (part != "inside")


@pytest.mark.parametrize("least", ["everywhere", "typical"])
def test_noise_is_tried_beside_the_errors_that_it_has_everywhere(least):
    """Parts of the root of the smaller mean square: features with large errors are no noise."""
    exact = Errors(9.0, 1e-3, 9.0)._replace(**{least: 4.0})
    seen = []

    def judge(candidate):
        seen.append(candidate.sigma)
        return exact

    assert _noisy(CANDIDATES[0], judge).sigma == 0
    np.testing.assert_allclose(seen[-len(NOISES) :], 2 * np.array(NOISES))


# Bad input -------------------------------------------------------------------------------


def test_too_few_samples():
    values = np.full((6, 5), np.nan)
    values.flat[:7] = 1.0
    with pytest.raises(ValueError, match=r"^values must hold at least 8 samples"):
        cf.tune(values)


def test_not_inside_jit():
    with pytest.raises(ValueError, match=r"^values must be known.*jit"):
        jax.jit(lambda v: cf.tune(v).thin_plate_weight)(RIDGE)


@pytest.mark.parametrize(
    ("values", "spacing", "name"),
    [
        (np.zeros(8), 1.0, "values"),
        (np.zeros((2, 8)), 1.0, "values"),
        (np.zeros((4, 8)), 0.0, "spacing"),
        (np.zeros((4, 8)), (1.0, 1.0, 1.0), "spacing"),
    ],
)
def test_bad_input(values, spacing, name):
    with pytest.raises(ValueError, match=f"^{name} must"):
        cf.tune(values, spacing=spacing)


def test_a_method_that_fills_nothing_has_no_cross_validation_error():
    with refused(ValueError, match="method must be GlobalFairing"):
        cf.cross_validation_error(cf.LocalFairing(), RIDGE)


# Derivatives -----------------------------------------------------------------------------


def error(parameters):
    method = cf.GlobalFairing(
        thin_plate_weight=parameters[0],
        coherence=parameters[1],
        tension=parameters[2],
        iterations=2,
        sharpness=2,
        tolerance=1e-12,
    )
    return cf.cross_validation_error(method, jnp.asarray(RIDGE), jnp.ones(2))


@SLOW
def test_cross_validation_error_is_differentiable_in_the_settings():
    at, step = np.array([0.05, 1.2, 0.3]), 1e-5
    value, gradient = jax.jit(jax.value_and_grad(error))(at)
    value_of = jax.jit(error)
    assert float(value) == pytest.approx(float(value_of(at)), rel=1e-9)
    for k in range(3):
        ends = [float(value_of(at + sign * step * np.eye(3)[k])) for sign in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step)
        assert abs(difference) > 1e-8
        assert float(gradient[k]) == pytest.approx(difference, rel=1e-4)


@SLOW
def test_cross_validation_error_by_hand():
    """Drop either colour, fit, compare there."""
    colour = np.indices(RIDGE.shape).sum(axis=0) % 2
    method = cf.GlobalFairing(thin_plate_weight=0.01, sharpness=2)
    squares = []
    for dropped in (0, 1):
        field = cf.fair_field(np.where(colour == dropped, np.nan, RIDGE), method=method)
        squares.extend(((np.asarray(field.samples) - RIDGE) ** 2)[colour == dropped])
    ours = cf.cross_validation_error(method, RIDGE)
    assert float(ours) == pytest.approx(np.mean(squares), rel=1e-6)


def test_what_fills_wide_holes_badly_is_left_out():
    x = np.linspace(-1.0, 1.0, 13)
    smooth = np.exp(-(x[:, None] ** 2) - (x[None, :] - 0.2) ** 2)
    holed = np.where(np.add.outer(np.arange(13), np.arange(13)) < 5, np.nan, smooth)
    whole, filling = cf.tune(smooth), cf.tune(holed)
    assert whole.border_degree > 0
    assert filling.border_degree == 0
    assert filling.tension == 0
    error = np.asarray(cf.fair_field(holed, method=filling).samples) - smooth
    assert np.abs(error).max() < 0.1
