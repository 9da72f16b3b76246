"""Properties of fields for any samples: scales of 1e-30 to 1e30, gaps, spacing, symmetries.

Few examples by default, hundreds under ``slow``.  Shapes are few, because each is compiled.
"""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import contourfair_jax as cf

METHODS = {"local": cf.LocalFairing(), "global": cf.GlobalFairing()}
SHAPES = [(3, 4), (6, 5)]
FEW = settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
MANY = settings(FEW, max_examples=400)
CASES = [
    pytest.param("local", (6, 5), FEW),
    pytest.param("global", (6, 5), FEW),
    *(
        pytest.param(name, shape, MANY, marks=pytest.mark.slow)
        for name in METHODS
        for shape in (*SHAPES, (4, 3, 5))
    ),
]


@st.composite
def samples(draw, shape, dtypes, gaps=False):
    """Noise, steps, ramps or a constant, at any scale, on any level, in float32 or float64."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    ramp = sum(np.indices(shape))
    kind = draw(st.sampled_from(["noise", "step", "ramp", "constant", "peak"]))
    values = {
        "noise": rng.standard_normal(shape),
        "step": np.where(ramp > sum(shape) / 3, 1.0, 0.0),
        "ramp": ramp / 3,
        "constant": np.ones(shape),
        "peak": np.exp(-(ramp**2.0)),
    }[kind]
    values = 10.0 ** draw(st.integers(-30, 30)) * (values + draw(st.sampled_from([0, 0, 1, -100])))
    values = values.astype(draw(st.sampled_from(dtypes)))
    if gaps:
        values[rng.random(shape) < draw(st.sampled_from([0.0, 0.05, 0.4]))] = np.nan
    return values


def dtypes(effort):
    """Every type is compiled: few examples are all float32, where less is certain."""
    return [np.float32] if effort is FEW else [np.float32, np.float64]


def spacings(ndim):
    """Steps of any size whose ratio is at most four."""
    return st.tuples(*[st.sampled_from([0.5, 1.0, 2.0])] * ndim)


def net(values, spacing, name):
    field = cf.fair_field(values, spacing=spacing, method=METHODS[name])
    assert field.dtype == values.dtype
    return np.asarray(field.control_points)


def spread(values):
    """The size of rounding: the range of the samples and a little of their level."""
    known = values[np.isfinite(values)].astype(float)
    noise = np.finfo(values.dtype).eps * np.abs(known).max() * 100
    return np.ptp(known) + noise + np.finfo(values.dtype).tiny


def kinks(points, axis):
    """Differences of the slopes on both sides of every inner vertex along an axis."""
    points = np.moveaxis(points.astype(float), axis, 0)
    vertex = points[3:-1:3]
    return (points[4::3] - vertex) - (vertex - points[2:-3:3])


@pytest.mark.parametrize(("name", "shape", "effort"), CASES)
def test_fields_pass_through_samples_are_finite_and_smooth(name, shape, effort):
    @effort
    @given(samples(shape, dtypes(effort)), spacings(len(shape)))
    def check(values, spacing):
        points = net(values, spacing, name)
        np.testing.assert_array_equal(points[(slice(None, None, 3),) * len(shape)], values)
        assert np.isfinite(points).all()
        rounding = 200 * np.finfo(values.dtype).eps * spread(values)
        for axis in range(len(shape)):
            assert np.abs(kinks(points, axis)).max(initial=0) <= rounding

    check()


@pytest.mark.parametrize(("name", "shape", "effort"), CASES)
def test_fields_turn_and_scale_with_the_samples(name, shape, effort):
    # Iterations of the local method amplify rounding where normals are undecided.
    tolerance = {"local": 1e-4, "global": 1e-3}[name]

    @effort
    @given(samples(shape, [np.float64]), spacings(len(shape)), st.integers(0, len(shape) - 1))
    def check(values, spacing, axis):
        points, size = net(values, spacing, name), spread(values)
        flipped = np.flip(net(np.flip(values, axis), spacing, name), axis)
        np.testing.assert_allclose(flipped / size, points / size, rtol=0, atol=tolerance)
        larger = net(4 * values, tuple(3 * step for step in spacing), name)
        np.testing.assert_allclose(larger / size, 4 * points / size, rtol=0, atol=4 * tolerance)

    check()


@pytest.mark.parametrize(("name", "shape", "effort"), CASES)
def test_gaps_stay_where_they_are_or_are_filled(name, shape, effort):
    @effort
    @given(samples(shape, dtypes(effort), gaps=True))
    def check(values):
        gaps = np.isnan(values)
        if gaps.all():
            return
        field = cf.fair_field(values, method=METHODS[name])
        points = np.asarray(field.control_points)
        known = points[(slice(None, None, 3),) * len(shape)]
        np.testing.assert_array_equal(known[~gaps], values[~gaps])
        if name == "global":
            assert np.isfinite(points).all()
            return
        finite = np.isfinite(np.asarray(field.bounds()[0])).ravel()
        np.testing.assert_array_equal(finite, ~spoiled(shape, gaps))

    check()


def spoiled(shape, gaps):
    """Cells that blend the patch of a vertex whose neighbourhood has a gap."""
    found = []
    for cell in np.ndindex(*(n - 1 for n in shape)):
        low = [min(max(k, 1), n - 2) - 1 for k, n in zip(cell, shape, strict=True)]
        high = [min(max(k + 1, 1), n - 2) + 2 for k, n in zip(cell, shape, strict=True)]
        found.append(gaps[tuple(slice(a, b) for a, b in zip(low, high, strict=True))].any())
    return np.array(found)
