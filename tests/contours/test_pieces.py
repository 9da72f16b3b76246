"""Pieces of cells that may hold levels, against loops; what is proved, by dense samples."""

import itertools

import numpy as np
import pytest
from splines import catmull_rom

from contourfair_jax._bezier.bernstein import bernstein
from contourfair_jax.contours import _pieces
from contourfair_jax.contours._pieces import Cells, grid_cells, level_ranges, quarters


def test_ranges_of_levels():
    levels = np.array([0.0, 1.0, 2.0])
    bounds = [(-1, 3), (0, 2), (0, 0), (0.5, 1), (0.5, 1.1), (2, 9), (3, 9), (-9, 0)]
    bounds += [(np.nan, np.nan), (-np.inf, 9), (-9, np.inf)]
    lower, upper = np.array(bounds).T
    first, last = level_ranges(lower, upper, levels)
    for k, (low, high) in enumerate(bounds):
        finite = np.isfinite([low, high]).all()
        expected = [n for n, v in enumerate(levels) if finite and low <= v < high]
        assert list(range(first[k], last[k])) == expected


@pytest.mark.parametrize(("scanned", "batch"), [(1 << 17, 1 << 15), (1, 1), (9, 2)])
def test_cells_of_the_grid_row_by_row(scanned, batch, rng, monkeypatch):
    monkeypatch.setattr(_pieces, "_SCANNED", scanned)
    monkeypatch.setattr(_pieces, "BATCH", batch)
    net = np.array(catmull_rom(rng.normal(size=(6, 5))).control_points)
    net[7, 4], levels, middle = np.nan, np.array([-0.7, 0.0, 0.4]), 0.25
    found = []
    for cells in grid_cells(net, levels, middle):
        assert cells.depth == 0
        assert 0 < len(cells) <= batch
        for k in range(len(cells)):
            i, j = cells.corner[:, k]
            points = net[3 * i : 3 * i + 4, 3 * j : 3 * j + 4] - middle
            np.testing.assert_array_equal(cells.points[..., k], points)
            expected = (points.min() <= levels) & (levels < points.max())
            assert list(range(cells.first[k], cells.last[k])) == np.flatnonzero(expected).tolist()
            found.append((int(i), int(j)))
    assert found == sorted(set(found))
    for i, j in itertools.product(range(5), range(4)):
        points = net[3 * i : 3 * i + 4, 3 * j : 3 * j + 4] - middle
        holds = ((points.min() <= levels) & (levels < points.max())).any()
        assert ((i, j) in found) == holds


def random_cells(rng, count=20, depth=2):
    points = rng.normal(size=(4, 4, count)) + 3 * rng.normal(size=count)
    corner = rng.integers(0, 9, (2, count))
    zeros = np.zeros(count, int)
    return Cells(points, corner, depth, zeros, zeros + 2)


def test_quarters_are_the_parts_that_may_hold_a_level(rng):
    cells, levels = random_cells(rng), np.array([-0.2, 0.3])
    parts = quarters(cells, levels)
    assert parts.depth == 3
    inside = (parts.points.min((0, 1)) <= levels[parts.first]) & (parts.first < parts.last)
    assert inside.all()
    weights = bernstein(3, np.array([0.0, 0.3, 1.0]))
    whole = bernstein(3, np.array([0.0, 0.15, 0.5, 0.5, 0.65, 1.0]))
    seen = 0
    for k, (a, b) in itertools.product(range(len(cells)), itertools.product((0, 1), repeat=2)):
        values = np.einsum("ia,jb,ab->ij", whole, whole, cells.points[..., k])
        values = values[3 * a : 3 * a + 3, 3 * b : 3 * b + 3]
        corner = 2 * cells.corner[:, k] + (a, b)
        for at in np.flatnonzero((corner == parts.corner.T).all(1)):
            again = np.einsum("ia,jb,ab->ij", weights, weights, parts.points[..., at])
            seen += np.allclose(values, again)
    assert seen == len(parts) < 4 * len(cells)


def test_cells_are_taken_by_number_and_by_mask(rng):
    cells = random_cells(rng)
    mask = np.arange(20) % 3 == 0
    for part in (cells.take(mask), cells.take(np.flatnonzero(mask))):
        np.testing.assert_array_equal(part.points, cells.points[..., mask])
        np.testing.assert_array_equal(part.corner, cells.corner[:, mask])
        assert (len(part), part.depth) == (7, 2)


def graph(slope, bend):
    """Bezier points of f = a - 1/4 - slope b - bend b^2 / 2: the line is a graph over b."""
    b = np.array([0, 1 / 3, 2 / 3, 1])
    square = np.array([0, 0, 1 / 3, 1])
    return (b[:, None] - 0.25 - slope * b - bend * square / 2)[..., None]


def pieces(points, depth=0):
    zero = np.zeros(1, int)
    return Cells(points, np.zeros((2, 1), int), depth, zero, zero + 1)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("bend", [0.0, 0.02, 0.06, 0.3])
def test_strips_are_as_many_as_the_bend_asks_for(bend, turned):
    """A chord over 1 / k of the cell is bend / (8 k^2) away from a parabola."""
    points = graph(0.5, bend)
    if turned:
        points = points.swapaxes(0, 1)
    swapped, strips = _pieces._strips(pieces(points), 0.002, 0.0)
    # The bound of the second differences is exact here; the slope of the graph is below 1.
    expected = np.ceil(np.sqrt(max(bend, 1e-9) / (8 * 0.002)))
    assert bool(swapped[0]) == turned
    assert strips[0] == min(max(expected, 1), _pieces.MAX_STRIPS + 1)
    # Half as deep a piece has half the width, and its bend is told in its own units.
    _, finer = _pieces._strips(pieces(points, 4), 0.002, 0.0)
    assert finer[0] == max(1, np.ceil(np.sqrt(bend / 16 / (8 * 0.002))))
    _, tiny = _pieces._strips(pieces(points, 9), 0.002, 0.0)
    assert tiny[0] == 1


def test_nothing_is_proved_where_both_derivatives_change_sign():
    x = np.linspace(-1, 1, 4)
    saddle = (x[:, None] ** 2 - x**2)[..., None]
    assert _pieces._strips(pieces(saddle), 0.01, 0.0)[1][0] == 0
    # Slopes that are zero but for rounding count as proved, and as bent without bound.
    flat = 1e-9 * np.indices((4, 4)).sum(0)[..., None] * (-1.0) ** np.arange(4)[:, None, None]
    assert _pieces._strips(pieces(flat), 0.01, 1e-7)[1][0] == _pieces.MAX_STRIPS + 1
    assert _pieces._strips(pieces(flat), 1.0, 1e-7)[1][0] == 1


def test_edges_that_a_level_may_cross_twice():
    edge = np.array([0.0, 1.0, -1.0, 0.5])
    points = np.zeros((4, 4, 3))
    points[0, :, 0], points[3, :, 1], points[1, :, 2] = edge, edge, edge
    cells = Cells(points, np.zeros((2, 3), int), 0, np.zeros(3, int), np.ones(3, int))
    once = _pieces._edges_crossed_once(cells, np.array([0.2]))
    np.testing.assert_array_equal(once, [False, False, True])
    once = _pieces._edges_crossed_once(cells, np.array([0.7]))
    np.testing.assert_array_equal(once, [False, False, True])
    once = _pieces._edges_crossed_once(cells, np.array([1.2]))
    np.testing.assert_array_equal(once, [True, True, True])
