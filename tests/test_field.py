"""Where points are in a field: far from zero, at the border, none at all; batches of fields.

Coordinates of maps have more digits than float32, in which samples often come and JAX computes.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import interpolate
from shape_checks import refused

import contourfair_jax as cf
from contourfair_jax import geometry
from contourfair_jax.inverse import Values, fit_samples

PLATE = cf.LocalFairing(iterations=0)
FAR = np.array([5_000_000.3, 499_999.9])  # as northing and easting, in metres


@pytest.fixture
def hill(rng):
    """Samples of a hill, float32."""
    x = np.arange(14.0)
    return np.float32(np.exp(-0.05 * ((x[:, None] - 6) ** 2 + (x - 7) ** 2)))


@pytest.mark.both_precisions
def test_far_from_zero_all_is_as_near_it(hill, rng, x64):
    near = cf.fair_field(hill, spacing=0.5)
    far = cf.fair_field(hill, spacing=0.5, origin=FAR)
    points = rng.uniform(0, 6.5, (50, 2))
    for ours, expected in zip(far.jet(points + FAR), near.jet(points), strict=True):
        np.testing.assert_allclose(ours, expected, atol=1e-4)
    (line,), (reference,) = far.contours(0.5), near.contours(0.5)
    np.testing.assert_allclose(line.points - FAR, reference.points, atol=1e-8)
    for measure in (geometry.length, geometry.area, geometry.bending):
        np.testing.assert_allclose(measure(far, [line]), measure(near, [reference]), rtol=1e-4)


@pytest.mark.both_precisions
@pytest.mark.parametrize("shape", [(5, 6), (3, 4, 5)])
@pytest.mark.parametrize("far", [0.0, 5e6])
def test_the_spline_of_scipy_is_the_field(shape, far, rng, x64):
    spacing, far = np.array([0.1, 0.7, 2.3])[: len(shape)], np.full(len(shape), far)
    values = rng.normal(size=shape).astype(float if x64 else np.float32)
    field = cf.fair_field(values, spacing=spacing, origin=far, method=PLATE)
    knots, coefficients = field.to_bspline()
    assert [len(each) for each in knots] == [2 * n + 4 for n in shape]
    points = rng.uniform(0, 1, (200, len(shape))) * spacing * (np.array(shape) - 1) + far
    spline = interpolate.NdBSpline(knots, np.asarray(coefficients, float), 3)
    tolerance = 1e-5 if coefficients.dtype == np.float32 else 1e-7 if far.any() else 1e-12
    np.testing.assert_allclose(spline(points), field(points), atol=tolerance)
    knots_inside_jit, _ = jax.jit(lambda field: field.to_bspline())(field)
    for ours, expected in zip(knots_inside_jit, knots, strict=True):
        np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@pytest.mark.both_precisions
def test_samples_are_found_far_from_zero(rng, x64):
    points = rng.uniform(0, 7, (120, 2))
    seen = Values(points + FAR, points.sum(axis=1), sigma=0.01)
    fit = fit_samples(seen, (8, 8), origin=FAR, method=PLATE)
    x = np.arange(8.0)
    np.testing.assert_allclose(fit.samples, x[:, None] + x, atol=0.01)
    np.testing.assert_allclose(fit.points[0], points + FAR, atol=1e-5)
    np.testing.assert_array_equal(fit.field.origin, FAR)


@pytest.mark.both_precisions
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_last_sample_is_inside_however_it_is_rounded(dtype, hill, rng, x64):
    for step, first in zip(rng.uniform(0.01, 9, 60), rng.uniform(-900, 900, 60), strict=True):
        field = cf.fair_field(hill, spacing=step, origin=first, method=PLATE)
        corners = np.array([[13, 13], [0, 13], [13, 0]])
        points = np.asarray(first, dtype) + np.asarray(step, dtype) * corners.astype(dtype)
        for given in (points, jnp.asarray(points)):
            np.testing.assert_allclose(field(given), hill[tuple(corners.T)], atol=1e-3)
        beyond = points + np.asarray(1e-3 * step + 1e-3, dtype)
        assert np.isnan(field(beyond)).all()


def test_points_at_infinity_are_outside(hill):
    points = np.array([[np.inf, 1.0], [1.0, -np.inf]])
    assert np.isnan(cf.fair_field(hill, method=PLATE)(points)).all()


@pytest.mark.parametrize("shape", [(0, 2), (3, 0, 2), (0, 5, 2)])
def test_no_points_have_no_values(shape, hill):
    field = cf.fair_field(hill, method=PLATE)
    sizes = [each.shape for each in field.jet(np.zeros(shape))]
    assert sizes == [shape[:-1], shape, (*shape, 2)]
    assert field.mean_curvature(jnp.zeros(shape)).shape == shape[:-1]


def test_points_of_all_kinds_of_numbers(hill):
    field = cf.fair_field(hill, method=PLATE)
    for points in ([[3, 4]], np.array([[3, 4]]), jnp.array([[3, 4]]), jnp.bfloat16([[3, 4]])):
        np.testing.assert_allclose(field(points), hill[3, 4])


@pytest.mark.both_precisions
@pytest.mark.parametrize("scale", [1e-30, 1e-15, 1e15, 1e30])
def test_curvature_does_not_depend_on_the_scale_of_values(scale, hill, x64):
    points = np.array([[3.2, 4.1], [8.0, 5.5]])
    expected = cf.fair_field(hill).mean_curvature(points)
    field = cf.fair_field(hill * np.float32(scale))
    np.testing.assert_allclose(field.mean_curvature(points), expected, rtol=1e-4)
    lines, reference = field.contours(0.5 * scale), cf.fair_field(hill).contours(0.5)
    bending = geometry.bending(field, lines)
    np.testing.assert_allclose(bending, geometry.bending(cf.fair_field(hill), reference), rtol=1e-3)


def test_a_batch_of_fields_is_not_taken_for_a_volume(hill):
    fields = jax.vmap(lambda v: cf.fair_field(v, method=PLATE))(jnp.stack([hill, 2 * hill]))
    for use in (
        lambda: fields(np.zeros(3)),
        lambda: fields.refine(2),
        lambda: fields.shape,
        lambda: fields.isosurface(0.5),
        lambda: fields.contours(0.5),
    ):
        with refused(ValueError, match="field must be one field, got a batch"):
            use()
    finer = jax.vmap(lambda field: field.refine(2))(fields)
    np.testing.assert_allclose(finer[1], 2 * finer[0], atol=1e-5)


@pytest.mark.parametrize("method", [PLATE, cf.GlobalFairing()])
def test_masked_and_infinite_samples_are_missing(method, hill):
    missing = hill.copy()
    missing[4, 5] = np.nan
    expected = cf.fair_field(missing, method=method).control_points
    masked = np.ma.masked_array(hill, mask=np.isnan(missing))
    infinite = np.where(np.isnan(missing), np.float32(np.inf), hill)
    for values in (masked, infinite):
        found = cf.fair_field(values, method=method).control_points
        np.testing.assert_array_equal(found, expected)


def test_masked_whole_numbers():
    values = np.ma.masked_equal(np.arange(30).reshape(6, 5), 12)
    samples = cf.fair_field(values, method=PLATE).samples
    np.testing.assert_array_equal(np.isnan(samples), values.mask)


def test_rows_of_different_lengths_are_refused_by_name(hill):
    with refused(ValueError, match=r"^values must be an array of numbers, got \[\[1"):
        cf.fair_field([[1.0, 2.0, 3.0], [1.0, 2.0], [1.0]])
    with refused(ValueError, match=r"^points must be an array of numbers"):
        cf.fair_field(hill, method=PLATE)([[1.0, 2.0], [3.0]])
    with refused(ValueError, match=r"^spacing must be an array of numbers"):
        cf.fair_field(hill, spacing=[1.0, [2.0, 3.0]])


@pytest.mark.parametrize(("spacing", "origin"), [(1e-46, 0.0), (1e300, 0.0), (1.0, 1e300)])
def test_what_does_not_fit_into_float32_is_refused(spacing, origin, hill):
    with pytest.raises(ValueError, match=r"must be finite.*in float32 too"):
        cf.fair_field(hill, spacing=spacing, origin=origin)


@pytest.mark.both_precisions
def test_fits_far_from_zero_are_evaluated_where_they_lie(rng, x64):
    """Also with a spacing that float32 does not have."""
    spacing, far = 7 / 15, np.full(2, 5e6)
    points = rng.uniform(0, 15 * spacing, (150, 2))
    values, at = np.sin(points.sum(axis=1)), points[:7]
    here, there = (
        fit_samples(
            Values(points + o, values, 0.01), (16, 16), spacing=spacing, origin=o, method=PLATE
        )
        for o in (0.0, far)
    )
    np.testing.assert_allclose(there.field(at + far), here.field(at), atol=1e-4)
    sure = [
        fit.standard_deviation(lambda field, p=p: field(p))
        for fit, p in ((here, at[0]), (there, at[0] + far))
    ]
    np.testing.assert_allclose(*sure, rtol=1e-2)


@pytest.mark.both_precisions
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_observations_at_the_border_are_inside_however_they_are_rounded(dtype, x64):
    grid = {"spacing": 0.7, "origin": 1e4, "method": PLATE}
    points = np.array([[1e4, 1e4], [1e4 + 350, 1e4 + 1.4], [1e4 + 9, 1e4 + 0.3]]).astype(dtype)
    assert fit_samples(Values(points, np.ones(3)), (501, 3), **grid).converged
    with pytest.raises(ValueError, match="1 of 3 points of Values lie outside"):
        fit_samples(Values(points + np.array([0, 0.1], dtype), np.ones(3)), (501, 3), **grid)
