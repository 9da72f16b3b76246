"""Parts of cells are the same field; extreme values are those of dense samples."""

import itertools

import numpy as np
import pytest

from contourfair_jax._bezier import subdivision
from contourfair_jax._bezier.bernstein import bernstein


def at(points, place):
    """Values of cells (4, ..., 4, n) at one place in [0, 1]^d."""
    for t in place:
        points = np.tensordot(bernstein(3, np.array(t)), points, 1)
    return points


def places(ndim):
    return np.random.default_rng(1).uniform(size=(4, ndim))


def test_halves_meet_and_are_the_cubic(rng):
    points = rng.normal(size=(4, 5))
    low, high = subdivision.halves(points)
    np.testing.assert_array_equal(low[3], high[0])
    np.testing.assert_array_equal([low[0], high[3]], points[[0, 3]])
    for t in (0.0, 0.3, 1.0):
        np.testing.assert_allclose(at(low, [t]), at(points, [t / 2]))
        np.testing.assert_allclose(at(high, [t]), at(points, [(1 + t) / 2]))


@pytest.mark.parametrize("ndim", [1, 2, 3])
def test_children_are_the_field_in_all_parts_the_last_axis_fastest(ndim, rng):
    points = rng.normal(size=(4,) * ndim + (3,))
    parts = list(subdivision.children(points))
    assert [bits for bits, _, _ in parts] == list(itertools.product((0, 1), repeat=ndim))
    for bits, part, whose in parts:
        np.testing.assert_array_equal(whose, [0, 1, 2])
        for place in places(ndim):
            expected = at(points, (place + bits) / 2)
            np.testing.assert_allclose(at(part, place), expected, atol=1e-12)


@pytest.mark.parametrize("ndim", [2, 3])
def test_children_that_are_wanted(ndim, rng):
    """Those that hold 1 somewhere, by all their points: the same as choosing at the end."""
    points = rng.normal(size=(4,) * ndim + (20,)) + np.linspace(-1, 3, 20)

    def holds(pieces):
        return (pieces.min(0) <= 1) & (pieces.max(0) > 1)

    every = list(subdivision.children(points))
    for (bits, part, whose), (same, all_parts, _) in zip(
        subdivision.children(points, holds), every, strict=True
    ):
        assert bits == same
        kept = np.flatnonzero(holds(all_parts.reshape(4**ndim, -1)))
        np.testing.assert_array_equal(whose, kept)
        np.testing.assert_array_equal(part, all_parts[..., kept])


@pytest.mark.parametrize("depth", [0, 1, 3])
def test_parts_of_any_depth_in_one_step(depth, rng):
    points = rng.normal(size=(4, 4, 6))
    place = rng.integers(0, 1 << depth, (6, 2))
    parts = subdivision.dyadic_parts(points, place, depth)
    for t in places(2):
        expected = [at(points[..., k], (place[k] + t) / 2**depth) for k in range(len(place))]
        np.testing.assert_allclose(at(parts, t), expected, atol=1e-12)


@pytest.mark.parametrize("shape", [(7,), (7, 10), (4, 7, 7)])
def test_extrema_are_those_of_dense_samples(shape, rng):
    net = rng.normal(size=shape)
    low, high = subdivision.extrema(net)
    dense = net
    weights = bernstein(3, np.linspace(0, 1, 33))
    for axis in range(net.ndim):
        along = np.moveaxis(dense, axis, 0)
        cells = [np.tensordot(weights, along[k : k + 4], 1) for k in range(0, len(along) - 1, 3)]
        dense = np.moveaxis(np.concatenate(cells), 0, axis)
    assert dense.max() <= high + 1e-9 < dense.max() + 0.02 * np.ptp(dense)
    assert dense.min() >= low - 1e-9 > dense.min() - 0.02 * np.ptp(dense)


def test_extrema_within_a_cell_and_beside_cells_without_values():
    """A parabola with its top at 1/4, over two cells of which one holds NaN."""
    top = np.linalg.solve(bernstein(3, np.arange(4) / 3), 2 - (np.arange(4) / 3 - 0.25) ** 2)
    low, high = subdivision.extrema(np.concatenate([top, [np.nan, 50.0, 50.0]]))
    assert high == pytest.approx(2.0, abs=1e-9)
    assert low == pytest.approx(2 - 0.75**2)
    assert np.isnan(subdivision.extrema(np.full((4, 4), np.nan))).all()
