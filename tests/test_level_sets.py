"""Levels that divide the range of the samples."""

import numpy as np

from contourfair_jax._level_sets import even_levels


def test_levels_divide_the_range_of_what_is_finite():
    samples = np.array([[0.0, np.nan, 10.0], [-np.inf, 3.0, np.inf]])
    np.testing.assert_array_equal(even_levels(samples, 4), [2.0, 4.0, 6.0, 8.0])
    assert len(even_levels(samples)) == 10


def test_levels_of_float32_have_all_digits():
    samples = np.array([0.0, 1.0], np.float32)
    assert even_levels(samples, 2).tolist() == np.linspace(0.0, 1.0, 4)[1:-1].tolist()


def test_where_there_is_no_range_there_is_no_level():
    assert not even_levels(np.ones((3, 3))).size
    assert not even_levels(np.full((3, 3), np.nan)).size
