"""Pieces of cells that hold levels, halved until bounds prove what the contours in them look like.

Everything that traces contours works on the host in float64: how many cells, points and lines there
are depends on the data.  With the batch last, each of the 16 points of all cells is one contiguous
vector, and one line of code treats all cells.

A piece is *proved* for its levels when

- one partial derivative has Bezier coefficients of one sign, up to rounding.  Say it is that along
  axis a.  Then every level set in the piece is a graph a = g(b): no loop hides in it, and each of
  the two edges along a is crossed at most once;
- each level crosses each of the two edges along b at most once, because it passes between their
  Bezier points at most once.

The level set then is one or two arcs, told by the signs at the corners.  The bounds of the second
derivatives bound g'':

    |g''| <= (|f_bb| + 2 r |f_ab| + r^2 |f_aa|) / |f_a|,    r = |f_b| / |f_a|,

so that chords over strips of width 1 / k in b stay within |g''| / (8 k^2) of the arc.  Where f_a
comes near zero the bound says nothing; a piece no wider than the tolerance needs no bound.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .._bezier.nets import cell_extreme
from .._bezier.subdivision import children
from .._support.arrays import ranges

# Cells of the grid looked at in one go, and those with a level subdivided in one go: what is worked
# on stays in the caches of the processor.
_SCANNED = 1 << 17
BATCH = 1 << 15


@dataclass(frozen=True)
class Cells:
    """Square pieces of the field, all of the same size.

    Parameters
    ----------
    points : array, shape (4, 4, n)
        Bezier points, float64.
    corner : array of int, shape (2, n)
        Lower corners, in units of the side `2**-depth` of the pieces.
    depth : int
        How often the cells of the grid were halved.
    first, last : array of int, shape (n,)
        The sorted levels `first <= k < last` lie within the bounds of the piece.
    """

    points: np.ndarray
    corner: np.ndarray
    depth: int
    first: np.ndarray
    last: np.ndarray

    def __len__(self) -> int:
        return self.points.shape[-1]

    def take(self, chosen: np.ndarray) -> "Cells":
        """The cells with the given indices, or where a mask is true."""
        if chosen.dtype == bool:
            chosen = np.flatnonzero(chosen)
        points, corner = self.points.take(chosen, -1), self.corner.take(chosen, -1)
        return Cells(points, corner, self.depth, self.first[chosen], self.last[chosen])


def level_ranges(
    lower: np.ndarray, upper: np.ndarray, levels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """First and one past the last of the sorted levels with `lower <= level < upper`.

    A level that is not between the Bezier points of a piece has no line in it.  Where the bounds
    are NaN or infinite there is none.
    """
    first = np.searchsorted(levels, lower, side="left")
    last = np.searchsorted(levels, upper, side="left")
    last = np.where(np.isfinite(lower) & np.isfinite(upper), last, first)
    return first, last


def grid_cells(net: np.ndarray, levels: np.ndarray, middle: float) -> Iterator[Cells]:
    """The cells that may hold one of the sorted levels, batch by batch: of a net less `middle`."""
    rows, columns = ((points - 1) // 3 for points in net.shape)
    step = max(1, _SCANNED // columns)
    for start in range(0, rows, step):
        part = net[3 * start : 3 * min(start + step, rows) + 1]
        lower, upper = (
            cell_extreme(part, reduce).astype(np.float64) - middle
            for reduce in (np.minimum, np.maximum)
        )
        first, last = level_ranges(lower, upper, levels)
        i, j = np.nonzero(last > first)
        corners = np.stack([i + start, j])
        for begin in range(0, len(i), BATCH):
            corner = corners[:, begin : begin + BATCH]
            at = corner[0] - start, corner[1]
            yield Cells(_gather(part, *at) - middle, corner, 0, first[at], last[at])


def _gather(net: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """The 4 x 4 points of cells (i, j), float64, the cells last."""
    points = np.empty((4, 4, len(i)))
    lowest = 3 * i * net.shape[1] + 3 * j
    flat = net.reshape(-1)
    for a in range(4):
        for b in range(4):
            points[a, b] = flat[lowest + (a * net.shape[1] + b)]
    return points


def quarters(cells: Cells, levels: np.ndarray) -> Cells:
    """The four quarters of every cell, those that may hold a level."""
    parts = []
    for bits, quarter, _ in children(cells.points):
        flat = quarter.reshape(16, -1)
        first, last = level_ranges(flat.min(0), flat.max(0), levels)
        kept = np.flatnonzero(last > first)
        corner = 2 * cells.corner[:, kept] + np.array(bits)[:, None]
        parts.append((quarter.take(kept, -1), corner, first[kept], last[kept]))
    points, corner, first, last = (
        np.concatenate(arrays, -1) for arrays in zip(*parts, strict=True)
    )
    return Cells(points, corner, cells.depth + 1, first, last)


# Pieces that are not proved are left so, and counted: at this depth the last ones, and many at once
# already at the other, because they lie along a line on which the gradient vanishes.  Around
# plateaus of images several hundred are left at that depth, and proved a few depths later.
MAX_DEPTH = 18
MANY_DEPTH, MANY = 12, 1 << 14
# More strips than this: halve the piece instead, which sharpens its bounds.
MAX_STRIPS = 4


@dataclass(frozen=True)
class Leaves:
    """Pieces to draw the lines in.

    Parameters
    ----------
    cells : Cells
        Transposed where `swapped`, so that lines are graphs over the second axis.
    swapped : array of bool, shape (n,)
    strips : array of int, shape (n,)
        Chords per piece.
    proved : array of bool, shape (n,)
    """

    cells: Cells
    swapped: np.ndarray
    strips: np.ndarray
    proved: np.ndarray


def leaves(
    cells: Cells, levels: np.ndarray, tolerance: float, rounding: float = 0.0
) -> Iterator[Leaves]:
    """Subdivide cells until they are proved and keep to the tolerance.

    Parameters
    ----------
    cells : Cells
    levels : array
        Sorted.
    tolerance : float
        In cells of the grid.
    rounding : float
        By how much differences of Bezier points may have the wrong sign.
    """
    while len(cells):
        swapped, strips = _strips(cells, tolerance, rounding)
        many = cells.depth >= MANY_DEPTH and len(cells) > MANY
        last = many or cells.depth == MAX_DEPTH
        ready = np.flatnonzero(((strips > 0) & (strips <= MAX_STRIPS)) | last)
        swapped, strips = swapped[ready], strips[ready]
        turned = _transposed(cells.take(ready), swapped)
        proved = (strips > 0) & _edges_crossed_once(turned, levels)
        strips = np.clip(strips, 1, MAX_STRIPS)
        done = np.full_like(proved, True) if last else proved
        yield Leaves(turned.take(done), swapped[done], strips[done], proved[done])
        rest = np.full(len(cells), True)
        rest[ready[done]] = False
        cells = cells.take(rest)
        if len(cells):
            cells = quarters(cells, levels)


def _transposed(cells: Cells, swapped: np.ndarray) -> Cells:
    """The pieces with their axes swapped where it says so."""
    points = np.where(swapped, cells.points.swapaxes(0, 1), cells.points)
    return replace(cells, points=points, corner=np.where(swapped, cells.corner[::-1], cells.corner))


def _strips(cells: Cells, tolerance: float, rounding: float) -> tuple[np.ndarray, np.ndarray]:
    """The axis that lines are graphs over, and the number of chords that keeps to the tolerance.

    Returns
    -------
    swapped : array of bool
        Lines are graphs over the first axis.
    strips : array of int
        0 where neither is proved.
    """
    points = cells.points
    along, across = np.diff(points, axis=0), np.diff(points, axis=1)
    least_a, most_a = _extent(along)
    least_b, most_b = _extent(across)
    # The one that is proved; where both are, the one that bounds the slope |g'| better.
    swapped = least_b * most_b > least_a * most_a
    least, slope = np.where(swapped, least_b, least_a), np.where(swapped, most_a, most_b)
    second_a = _largest(np.diff(along, axis=0))
    second_b = _largest(np.diff(across, axis=1))
    mixed = _largest(np.diff(along, axis=1))
    second_a, second_b = (
        np.where(swapped, second_b, second_a),
        np.where(swapped, second_a, second_b),
    )
    width = 0.5**cells.depth
    bounded = least > rounding
    lowest = np.where(bounded, least, 1)
    slope = slope / lowest
    # Derivatives are 3 times first, 6 times pure and 9 times mixed second differences.
    bend = (2 * second_b + 6 * slope * mixed + 2 * slope**2 * second_a) / lowest
    needed = np.sqrt(np.where(bounded, bend, np.inf) * (width / (8 * tolerance)))
    if width <= tolerance:
        needed = np.ones_like(needed)
    strips = np.ceil(np.clip(needed, 1, MAX_STRIPS + 1)).astype(int)
    return swapped, np.where(least >= -rounding, strips, 0)


def _extent(differences: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest (below zero where the sign changes) and largest size of the given coefficients."""
    low, high = differences.min((0, 1)), differences.max((0, 1))
    return np.maximum(low, -high), np.maximum(high, -low)


def _largest(differences: np.ndarray) -> np.ndarray:
    return np.maximum(differences.max((0, 1)), -differences.min((0, 1)))


def _edges_crossed_once(cells: Cells, levels: np.ndarray) -> np.ndarray:
    """True for pieces whose levels pass at most once between the points of edges 0 and 3."""
    once = np.full(len(cells), True)
    for edge in (cells.points[0], cells.points[3]):
        steps = np.diff(edge, axis=0)
        unsure = np.flatnonzero((steps.min(0) < 0) & (steps.max(0) > 0) & once)
        count = (cells.last - cells.first)[unsure]
        piece = np.repeat(unsure, count)
        above = edge[:, piece] > levels[ranges(cells.first[unsure], count)]
        twice = np.count_nonzero(above[1:] != above[:-1], axis=0) > 1
        once[piece[twice]] = False
    return once
