"""Linear interpolation between samples."""

import numpy as np
import pytest

from contourfair_jax._bezier.linear import BilinearField, refine_axis_linearly, refine_linearly


@pytest.mark.parametrize("factor", [1, 2, 5])
def test_equals_numpy_along_every_axis(factor, rng):
    values = rng.normal(size=(4, 3))
    fine = refine_linearly(values, factor)
    expected = values
    for axis, n in enumerate(values.shape):
        at = np.arange(factor * (n - 1) + 1) / factor
        expected = np.apply_along_axis(
            lambda v, at=at, n=n: np.interp(at, np.arange(n), v), axis, expected
        )
    np.testing.assert_allclose(fine, expected, atol=1e-15)
    np.testing.assert_array_equal(fine[::factor, ::factor], values)
    np.testing.assert_array_equal(BilinearField(values).refine(factor), fine)


def test_missing_samples_spoil_the_cells_beside_them_only():
    found = refine_axis_linearly(np.array([1.0, 2, np.nan, 4, 6]), 0, 2)
    np.testing.assert_array_equal(found, [1, 1.5, 2, np.nan, np.nan, np.nan, 4, 5, 6])


def test_one_sample_and_single_precision():
    np.testing.assert_array_equal(refine_axis_linearly(np.array([3.0]), 0, 4), [3.0])
    plateau = np.full(5, 0.1, np.float32)
    found = refine_axis_linearly(plateau, 0, 7)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, np.full(29, 0.1, np.float32))


def test_place_and_shape():
    field = BilinearField(np.zeros((2, 5)), (1.0, 0.5), (3.0, -1.0))
    assert field.shape == (2, 5)
    assert (field.spacing, field.origin) == ((1.0, 0.5), (3.0, -1.0))
    assert BilinearField(np.zeros((2, 5))).spacing == (1.0, 1.0)
    assert BilinearField(np.zeros((2, 5))).origin == (0.0, 0.0)
    with pytest.raises(ValueError, match="samples must be 2-D, got 3-D"):
        BilinearField(np.zeros((2, 2, 2)))
