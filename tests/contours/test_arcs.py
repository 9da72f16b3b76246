"""Numbers of crossings, and the arcs of planes and saddles."""

import itertools

import numpy as np
import pytest

from contourfair_jax.contours._arcs import RANKS, Arcs, Codes, arcs, concatenate
from contourfair_jax.contours._pieces import MAX_DEPTH, Cells, Leaves


def test_numbers_are_told_apart_and_read_back():
    codes = Codes(3, 2)
    highest = 2 << MAX_DEPTH
    places = list(
        itertools.product((0, 1, 2), (0, 1), (0, 1, highest - 1, highest), (0, 1), (0, 1))
    )
    numbers = codes.encode(*np.array(places).T)
    assert len(np.unique(numbers)) == len(places)
    assert numbers.min() == 0
    assert numbers.max() + 1 == 3 * 2 * (highest + 1) * 2 * 2
    np.testing.assert_array_equal(np.stack(codes.decode(numbers), 1), np.array(places)[:, 1:])


def test_as_many_levels_as_there_are_numbers():
    per_level = 4 * ((1000 << MAX_DEPTH) + 1) * 1000 * RANKS
    most = ((1 << 63) - 1) // per_level
    Codes(most, 1000)
    with pytest.raises(ValueError, match="are too many for 1000 cells"):
        Codes(most + 1, 1000)


def test_arcs_in_one():
    def part(level):
        one = np.array([level])
        return Arcs(one, one, np.full((level, 2), 0.5), np.zeros((1, 2)), np.zeros((1, 2), int))

    found = [part(1), part(2)]
    both = concatenate(found)
    assert found == []
    assert both.level.tolist() == both.count.tolist() == [1, 2]
    assert both.points.shape == (3, 2)
    nothing = concatenate([])
    assert [len(x) for x in vars(nothing).values()] == [0] * 5
    assert nothing.codes.shape == nothing.points.shape == nothing.stops.shape == (0, 2)


@pytest.mark.parametrize("strips", [1, 2, 4])
@pytest.mark.parametrize(("swapped", "rises"), list(itertools.product((False, True), repeat=2)))
def test_the_arc_of_a_plane(swapped, rises, strips):
    """a = 1/2 + b / 4 in a leaf with the lower corner (2, 3), larger values on its left."""
    nodes, sign = np.arange(4) / 3, 1 if rises else -1
    points = sign * (nodes[:, None] - nodes / 4)[..., None]
    count, codes = np.zeros(1, int), Codes(1, 9)
    cells = Cells(points, np.array([[2], [3]]), 0, count, count + 1)
    leaves = Leaves(cells, np.array([swapped]), np.array([strips]), np.array([True]))
    (found,) = arcs(leaves, np.array([sign * 0.5]), codes)
    assert found.level.tolist() == [0]
    assert found.count.tolist() == [strips]
    b = np.arange(strips + 1) / strips
    line = np.stack([2.5 + b / 4, 3 + b], axis=1)
    if swapped:  # a leaf that is turned has a as its second coordinate
        line = line[:, ::-1]
    forwards = rises == swapped
    expected = line if forwards else line[::-1]
    np.testing.assert_allclose(np.concatenate([found.points, found.stops]), expected, atol=1e-12)
    axis, value, cell, up = codes.decode(found.codes[0])
    assert axis.tolist() == [int(not swapped)] * 2
    assert (value / 2**MAX_DEPTH).tolist() == ([3, 4] if forwards else [4, 3])
    assert cell.tolist() == [2, 2]
    assert up.tolist() == [int(forwards)] * 2


@pytest.mark.parametrize("upper", [False, True])
def test_the_arcs_of_a_saddle(upper):
    """(a - 1/2) (b - 1/2) rises along a above b = 1/2 only: two arcs around the corners."""
    nodes = np.arange(4) / 3 - 0.5
    points = np.outer(nodes, nodes)[..., None]
    level = 0.04 if upper else -0.04
    count, codes = np.zeros(1, int), Codes(1, 1)
    cells = Cells(points, np.zeros((2, 1), int), 0, count, count + 1)
    leaves = Leaves(cells, np.array([False]), np.array([1]), np.array([True]))
    (found,) = arcs(leaves, np.array([level]), codes)
    assert found.count.tolist() == [1, 1]
    off = 0.04 / 0.5
    for start, stop in zip(found.points, found.stops, strict=True):
        ends = np.stack([start, stop]) - 0.5
        np.testing.assert_allclose(ends.prod(1), level, atol=1e-12)
        np.testing.assert_allclose(np.sort(np.abs(ends), axis=1), [[off, 0.5]] * 2)
        way = stop - start
        corner = np.sign(ends[0]) * 0.5
        # The corner has values above the positive level, and below the negative one.
        left = -way[1] * (corner - ends[0])[0] + way[0] * (corner - ends[0])[1]
        assert (left > 0) == upper
    # One is behind b = 1/2, and one before it.
    assert sorted(np.sign(found.points[:, 1] - 0.5)) == [-1, 1]


def test_no_arcs_where_all_corners_are_on_one_side():
    points = np.ones((4, 4, 1))
    points[1, 1], count = -1.0, np.zeros(1, int)
    cells = Cells(points, np.zeros((2, 1), int), 0, count, count + 1)
    leaves = Leaves(cells, np.array([False]), np.array([1]), np.array([True]))
    assert arcs(leaves, np.array([0.0]), Codes(1, 1)) == []
