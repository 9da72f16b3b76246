"""Subdivision of cells until Bernstein bounds prove what the contours in them look like.

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

from ._cells import Cells, quarters
from ._ragged import ranges

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
    """Which axis the lines are graphs over, and how many chords keep to the tolerance.

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
    """Whether every level of a piece passes at most once between the points of edges 0 and 3."""
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
