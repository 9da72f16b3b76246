"""How arcs are joined, against loops over them."""

import numpy as np
import pytest

from contourfair_jax.contours import _trace
from contourfair_jax.contours._arcs import RANKS, Arcs, Codes
from contourfair_jax.contours._trace import Lines


def number_of(codes, *place):
    """The number of one crossing."""
    return int(codes.encode(*np.array(place)[:, None])[0])


def followed(follows):
    """First arc, rank and whether it is a loop, one arc after the other."""
    n = len(follows)
    before = {after: k for k, after in enumerate(follows) if after >= 0}
    head, rank, closed = [], [], []
    for k in range(n):
        path = [k]
        while path[-1] in before and before[path[-1]] != k:
            path.append(before[path[-1]])
        loop = path[-1] in before
        head.append(min(path) if loop else path[-1])
        rank.append(path.index(head[-1]))
        closed.append(loop)
    return head, rank, closed


@pytest.mark.parametrize("size", [1, 2, 7, 40])
def test_chains_are_followed(size, rng):
    for _ in range(20):
        follows = rng.permutation(size)
        follows[rng.uniform(size=size) < rng.choice([0, 0.1, 0.5])] = -1
        found = _trace.chains(follows)
        for ours, expected in zip(found, followed(follows), strict=True):
            np.testing.assert_array_equal(ours, expected)


def test_long_chains():
    follows = np.append(np.arange(1, 100), -1)
    head, rank, closed = _trace.chains(follows)
    assert not head.any()
    np.testing.assert_array_equal(rank, np.arange(100))
    assert not closed.any()
    head, rank, closed = _trace.chains(np.roll(np.arange(100), -1))
    assert not head.any()
    np.testing.assert_array_equal(rank, np.arange(100))
    assert closed.all()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("level", [0, 2])
def test_equal_crossings_are_ranked_along_the_edge(axis, level):
    """Also those of the first of all edges, whose number is 0."""
    codes = Codes(3, 4)
    at = np.array([[0.9, 0.2], [0.3, 0.5], [0.1, 0.8], [0.0, 0.0]])
    number = np.array(
        [number_of(codes, level, axis, 0, 0, 0)] * 3 + [number_of(codes, level, axis, 5, 1, 1)]
    )
    order, ranked = _trace._ranked(number, at, codes)
    np.testing.assert_array_equal(order, [0, 1, 2, 3] if axis == 0 else [2, 1, 0, 3])
    np.testing.assert_array_equal(ranked, number * RANKS + [0, 1, 2, 0])


def test_arcs_that_start_where_others_stop():
    starts, stops = np.array([10, 20, 30]), np.array([10, 25, 30])
    found = _trace._matches(np.array([2, 0, 1]), starts, np.array([1, 2, 0]), stops)
    np.testing.assert_array_equal(found, [1, 2, -1])


def test_arcs_become_lines_level_by_level():
    """A loop of two arcs at level 1, and at level 0 two arcs, the later first, that make a line."""
    codes = Codes(2, 9)
    a, b, c, d, e = (number_of(codes, 0, 0, k, 0, 1) for k in range(5))
    arcs = Arcs(
        level=np.array([1, 0, 1, 0], np.int32),
        count=np.array([2, 1, 1, 2], np.int8),
        points=np.array([[0.0, 0], [1, 0], [7, 0], [1, 1], [5, 0], [6, 0]]),
        stops=np.array([[1.0, 1], [8, 0], [0, 0], [7, 0]]),
        codes=np.array([[a, b], [d, e], [b, a], [c, d]]),
    )
    first, second = _trace.link(arcs, codes), None
    (lines,) = first
    np.testing.assert_array_equal(lines.level, [0, 1])
    np.testing.assert_array_equal(lines.closed, [False, True])
    one, two = lines.pieces()
    np.testing.assert_array_equal(one, [[5, 0], [6, 0], [7, 0], [8, 0]])
    np.testing.assert_array_equal(two, [[0, 0], [1, 0], [1, 1], [0, 0]])
    np.testing.assert_array_equal(lines.codes[0], [c, e])
    assert second is None


def test_lines_of_parts_in_one():
    def part(level, *sizes):
        bounds = np.cumsum([0, *sizes])
        return Lines(
            np.full((bounds[-1], 2), float(level)),
            bounds,
            np.full(len(sizes), level, np.int32),
            np.full(len(sizes), level == 1),
            np.full((len(sizes), 2), level),
        )

    both = _trace.join_lines([part(0, 3, 2), part(1, 4)])
    np.testing.assert_array_equal(both.bounds, [0, 3, 5, 9])
    np.testing.assert_array_equal(both.level, [0, 0, 1])
    np.testing.assert_array_equal(both.closed, [False, False, True])
    np.testing.assert_array_equal(both.points[:, 1], [0] * 5 + [1] * 4)
    assert both.codes.shape == (3, 2)
    nothing = _trace.join_lines([])
    assert (len(nothing.points), nothing.bounds.tolist(), nothing.pieces()) == (0, [0], [])


def test_repeated_vertices_go_but_not_across_lines():
    points = np.array([[0.0, 0], [0, 0], [0, 1], [0, 1], [2, 1], [2, 1]])
    kept, bounds = _trace._without_repeats(points, np.array([0, 3, 6]))
    np.testing.assert_array_equal(kept, [[0, 0], [0, 1], [0, 1], [2, 1]])
    np.testing.assert_array_equal(bounds, [0, 2, 4])
