"""Borders of masks and rings within rings, against loops and rays."""

import itertools

import numpy as np
import pytest

from contourfair_jax.contours import _fill
from contourfair_jax.contours._line import signed_area


def rings_of(border):
    """The vertices of every loop."""
    return [border.start[a:b] for a, b in itertools.pairwise(border.bounds)]


@pytest.mark.parametrize("part", [0.0, 0.3, 0.7, 1.0])
def test_the_border_of_a_mask(part, rng):
    """Every edge between a cell and none, the cell on its left; loops turn and close."""
    valid = rng.uniform(size=(5, 6)) < part
    border = _fill.border_of(valid)
    inside = np.pad(valid, 1)
    expected = sum(int((np.diff(inside.astype(int), axis=axis) != 0).sum()) for axis in (0, 1))
    assert len(border.start) == border.bounds[-1] == expected
    area = 0.0
    for ring in rings_of(border):
        closed = np.append(ring, ring[:1], axis=0)
        np.testing.assert_array_equal(np.abs(np.diff(closed, axis=0)).sum(1), 1)
        area += signed_area(closed.astype(float))
    assert area == valid.sum()
    edges = np.arange(len(border.start))
    expected = [k for k, ring in enumerate(rings_of(border)) for _ in ring]
    np.testing.assert_array_equal(border.loop(edges), expected)
    for start, way in zip(border.start, border.direction, strict=True):
        left = start + [(0, 0), (-1, 0), (-1, -1), (0, -1)][way]
        right = start + [(0, -1), (0, 0), (-1, 0), (-1, -1)][way]
        assert inside[tuple(left + 1)]
        assert not inside[tuple(right + 1)]


def test_cells_that_share_a_corner_stay_apart_and_turns_are_corners():
    border = _fill.border_of(np.array([[True, False], [False, True]]))
    assert [len(ring) for ring in rings_of(border)] == [4, 4]
    np.testing.assert_array_equal(border.turns(), np.arange(8))
    border = _fill.border_of(np.ones((2, 3), bool))
    corners = {tuple(vertex) for vertex in border.start[border.turns()].tolist()}
    assert corners == {(0, 0), (2, 0), (2, 3), (0, 3)}
    ring = np.ones((3, 3), bool)
    ring[1, 1] = False
    border = _fill.border_of(ring)
    assert sorted(len(ring) for ring in rings_of(border)) == [4, 12]
    assert len(border.turns()) == 8


def square(x, y, size, hole=False):
    ring = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * size + (x, y)
    return ring[::-1] if hole else ring


def test_holes_are_given_to_the_ring_around_them():
    rings = [
        square(0.1, 0.1, 10.0),
        square(1.2, 1.3, 6.0, hole=True),
        square(2.2, 2.3, 3.0),
        square(3.0, 3.1, 1.0, hole=True),
        square(2.3, 7.7, 0.5, hole=True),  # the square hole is below it
        square(8.3, 6.4, 1.0, hole=True),
        square(20.1, 0.2, 2.0),
        square(20.4, 0.5, 0.3, hole=True),
        square(30.0, 1.0, 1.0, hole=True),  # within none
    ]
    holes = [1, 3, 4, 5, 7, 8]
    assert _fill.parents(rings, holes) == [0, 2, 0, 0, 6, -1]
    assert _fill.parents(rings, []) == []


def test_slanted_rings_are_seen_where_they_are():
    """Below the eye the triangle is nearer, beside it it would not be."""
    triangle = np.array([[0.0, 0], [10, 8], [0, 8.5], [0, 0]])
    below = square(3.5, -1.0, 0.5)
    eyes = square(4.0, 4.0, 0.5, hole=True)
    assert _fill.parents([triangle, below, eyes], [2]) == [0]
    outside = square(4.0, 2.0, 0.5, hole=True)  # under the slanted side, which is at 3.2
    around = square(-1.0, -5.0, 20.0)
    assert _fill.parents([triangle, around, outside], [2]) == [1]


@pytest.mark.parametrize("batch", [1 << 20, 1])
def test_what_is_seen_from_many_points(batch, rng, monkeypatch):
    monkeypatch.setattr(_fill, "_BATCH", batch)
    rings = []
    for k, size in enumerate(rng.uniform(0.5, 3, 12)):
        angle = np.linspace(0, 2 * np.pi, 8) + k
        ring = size * np.stack([np.cos(angle), np.sin(angle)], axis=1) + rng.uniform(0, 12, 2)
        ring[-1] = ring[0]
        rings.append(ring)
    eyes = rng.uniform(0, 12, (40, 2))
    for eye, seen in zip(eyes, _fill._seen(rings, eyes), strict=True):
        hits = [(-np.inf, -1)]
        for number, ring in enumerate(rings):
            for a, b in itertools.pairwise(ring):
                if min(a[0], b[0]) <= eye[0] < max(a[0], b[0]):
                    at = a[1] + (b[1] - a[1]) * (eye[0] - a[0]) / (b[0] - a[0])
                    hits += [(at, number)] if at < eye[1] else []
        assert seen == max(hits)[1]


def test_rings_that_come_back_to_a_corner():
    eight = np.array([[0, 0], [1, 0], [1, 1], [2, 1], [2, 2], [1, 2], [1, 1], [0, 1], [0, 0]])
    found = _fill._simple(eight.astype(float))
    assert sorted(len(ring) for ring in found) == [5, 5]
    assert sum(signed_area(ring) for ring in found) == 2
    assert all((ring[0] == ring[-1]).all() for ring in found)
    (same,) = _fill._simple(square(0.0, 0.0, 1.0))
    np.testing.assert_array_equal(same, square(0.0, 0.0, 1.0))
    # There and back again encloses nothing.
    assert _fill._simple(np.array([[0.0, 0], [1, 0], [2, 0], [1, 0], [0, 0]])) == []
