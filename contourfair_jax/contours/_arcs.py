"""Arcs of level sets in the leaves of the subdivision: their ends and the vertices between.

In a leaf the level set of a level is the graph a = g(b) over one or two intervals of b.  Its ends
lie on the four edges, the vertices between where b is a multiple of 1 / strips.  All levels share
the strips of a leaf, and within a strip each arc is one chord between points of the border of the
strip, which do not interleave because the arcs do not cross: so chords do not cross either.

Crossings have one number each, the same from both sides of the edge.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from .._bezier.bernstein import bernstein
from .._bezier.roots import cubic_root
from .._support.arrays import ranges
from ._pieces import MAX_DEPTH, Cells, Leaves

# More than a level crosses a straight line within a cell in one direction: a cubic has three roots.
RANKS = 8


@dataclass(frozen=True)
class Codes:
    """Numbers for level, straight line, cell along it and direction; leaves room for a rank.

    Parameters
    ----------
    levels : int
        How many.
    cells : int
        Of the grid, along its longer axis.
    """

    levels: int
    cells: int

    def __post_init__(self) -> None:
        if self.levels * 4 * self._values * self.cells * RANKS >= 1 << 63:
            raise ValueError(
                f"levels: {self.levels} are too many for {self.cells} cells along an axis; "
                "call once for each part of them"
            )

    @property
    def _values(self) -> int:
        return (self.cells << MAX_DEPTH) + 1

    def encode(
        self,
        level: np.ndarray,
        axis: np.ndarray,
        value: np.ndarray,
        cell: np.ndarray,
        up: np.ndarray,
    ) -> np.ndarray:
        """The number of a crossing.

        Parameters
        ----------
        level : array of int
        axis : array of int
            The coordinate that is constant along the edge.
        value : array of int
            Its value, in units of `2**-MAX_DEPTH` cells.
        cell : array of int
            The cell of the grid along the edge.
        up : array of int
            1 where the line passes to larger values of this coordinate.
        """
        return (((level * 2 + axis) * self._values + value) * self.cells + cell) * 2 + up

    def decode(self, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Axis, value, cell and direction."""
        rest, up = np.divmod(codes, 2)
        rest, cell = np.divmod(rest, self.cells)
        rest, value = np.divmod(rest, self._values)
        return rest % 2, value, cell, up


# Edges of a leaf: a = 0, a = 1, b = 0, b = 1.
_LEFT, _RIGHT, _BOTTOM, _TOP = range(4)


@dataclass(frozen=True)
class Arcs:
    """Arcs directed so that the field is larger on their left, in units of cells.

    Parameters
    ----------
    level : array of int, shape (n,)
        Which level.
    count : array of int, shape (n,)
        Vertices of each arc but its last.
    points : array, shape (count.sum(), 2)
        Vertices of all arcs but their last.
    stops : array, shape (n, 2)
        The last vertices.
    codes : array of int, shape (n, 2)
        Numbers of the crossings of edges where an arc starts and stops; see `Codes`.
    """

    level: np.ndarray
    count: np.ndarray
    points: np.ndarray
    stops: np.ndarray
    codes: np.ndarray


@dataclass(frozen=True)
class _Pieces:
    """Arcs of one group of leaves that have equally many strips, in the axes of the leaves."""

    leaf: np.ndarray
    level: np.ndarray
    value: np.ndarray
    sides: np.ndarray  # edges of the lower and the upper end, (2, n)
    low: np.ndarray
    high: np.ndarray
    reverse: np.ndarray


def arcs(leaves: Leaves, levels: np.ndarray, codes: Codes) -> list[Arcs]:
    """The arcs of all levels in the leaves, one group for each number of strips."""
    found = []
    for strips in range(1, int(leaves.strips.max(initial=0)) + 1):
        chosen = np.flatnonzero(leaves.strips == strips)
        cells, swapped = leaves.cells.take(chosen), leaves.swapped[chosen]
        pieces = _pieces(cells, swapped, levels)
        if len(pieces.leaf):
            found.append(_arcs(cells, swapped, strips, pieces, codes))
    return found


def concatenate(found: list[Arcs]) -> Arcs:
    """All arcs in one; takes them out of the list, so that little is held twice."""
    columns = [
        [part.level for part in found],
        [part.count for part in found],
        [part.points for part in found],
        [part.stops for part in found],
        [part.codes for part in found],
    ]
    found.clear()
    empty = (np.empty(0, np.int32), np.empty(0, np.int8), *[np.empty((0, 2))] * 2)
    whole = []
    for none in (*empty, np.empty((0, 2), int)):
        whole.append(np.concatenate([none, *columns.pop(0)]))
    return Arcs(*whole)


def _pieces(cells: Cells, swapped: np.ndarray, levels: np.ndarray) -> _Pieces:
    """Arcs from the signs at the corners and the crossings of edges a = 0 and a = 1."""
    count = cells.last - cells.first
    leaf, level = np.repeat(np.arange(len(cells)), count), ranges(cells.first, count)
    above = cells.points[::3, ::3].take(leaf, -1) > levels[level]
    mixed = above.any((0, 1)) & ~above.all((0, 1))
    leaf, level, above = leaf[mixed], level[mixed], above[..., mixed]
    value = levels[level]
    crossings = np.full((2, len(leaf)), np.inf)
    for side in (0, 1):
        crossed = np.flatnonzero(above[side, 0] != above[side, 1])
        edge = cells.points[3 * side].take(leaf[crossed], -1)
        crossings[side, crossed] = cubic_root(edge, value[crossed])
    right_first = crossings[1] < crossings[0]
    nearer, farther = np.sort(crossings, axis=0)
    from_bottom = above[0, 0] != above[1, 0]
    one, two = nearer < np.inf, farther < np.inf
    nearer_side = np.where(right_first, _RIGHT, _LEFT)
    farther_side = np.where(right_first, _LEFT, _RIGHT)
    # One arc in each: from the bottom or the first crossing, to the next crossing or the top.
    start = np.where(from_bottom, _BOTTOM, nearer_side)
    stop = np.where(
        from_bottom, np.where(one, nearer_side, _TOP), np.where(two, farther_side, _TOP)
    )
    low = np.where(from_bottom, 0, nearer)
    high = np.minimum(np.where(from_bottom, nearer, farther), 1)
    larger_right = np.where(
        from_bottom, above[1, 0], np.where(two & right_first | ~two, above[1, 1], above[1, 0])
    )
    # Where all four edges are crossed there is another, from the second crossing to the top.
    more = np.flatnonzero(from_bottom & two)
    return _Pieces(
        leaf=np.append(leaf, leaf[more]),
        level=np.append(level, level[more]),
        value=np.append(value, value[more]),
        sides=np.stack(
            [np.append(start, farther_side[more]), np.append(stop, np.full(len(more), _TOP))]
        ),
        low=np.append(low, farther[more]),
        high=np.append(high, np.ones(len(more))),
        reverse=np.append(larger_right, above[1, 1, more]) != swapped[np.append(leaf, leaf[more])],
    )


def _arcs(cells: Cells, swapped: np.ndarray, strips: int, pieces: _Pieces, codes: Codes) -> Arcs:
    """Solve for the vertices, leave the axes of the leaves, and give the direction."""
    shape = (strips + 1, len(pieces.leaf))
    along = np.zeros((2, *shape))
    used = np.full(shape, True)
    for row in range(strips + 1):
        b = row / strips
        if row == 0:
            solved = np.flatnonzero(pieces.sides[0] == _BOTTOM)
        elif row == strips:
            solved = np.flatnonzero(pieces.sides[1] == _TOP)
        else:
            used[row] = (pieces.low < b) & (b < pieces.high)
            solved = np.flatnonzero(used[row])
        section = np.einsum("b,abn->an", _weights(strips)[row], cells.points)
        along[0, row, solved] = cubic_root(
            section.take(pieces.leaf[solved], -1), pieces.value[solved]
        )
        along[1, row] = b
    for row, side, b in ((0, 0, pieces.low), (strips, 1, pieces.high)):
        at_side = np.flatnonzero(pieces.sides[side] <= _RIGHT)
        along[0, row, at_side] = pieces.sides[side, at_side]
        along[1, row, at_side] = b[at_side]
    along += cells.corner[:, None, pieces.leaf]
    along *= 0.5**cells.depth
    turned = swapped[pieces.leaf]
    along = np.where(turned, along[::-1], along)
    along = np.where(pieces.reverse, along[:, ::-1], along)
    used = np.where(pieces.reverse, used[::-1], used)
    starts = used[:-1].T
    return Arcs(
        level=pieces.level.astype(np.int32),
        count=starts.sum(1, dtype=np.int8),
        points=along[:, :-1].transpose(2, 1, 0)[starts],
        stops=np.ascontiguousarray(along[:, -1].T),
        codes=_crossings(cells, turned, pieces, codes),
    )


@cache
def _weights(strips: int) -> np.ndarray:
    """Bernstein polynomials at the borders of the strips."""
    return bernstein(3, np.arange(strips + 1) / strips)


def _crossings(cells: Cells, turned: np.ndarray, pieces: _Pieces, codes: Codes) -> np.ndarray:
    """Numbers of the crossings where arcs start and stop."""
    sides = np.where(pieces.reverse, pieces.sides[::-1], pieces.sides)
    constant, upper = sides >> 1, sides & 1
    corner = cells.corner[:, pieces.leaf]
    value = np.where(constant == 0, corner[0], corner[1]) + upper
    across = np.where(constant == 0, corner[1], corner[0])
    finest = MAX_DEPTH - cells.depth
    passes_up = upper == np.array([[0], [1]])
    axis, value, cell = constant ^ turned, value << finest, across >> cells.depth
    return codes.encode(pieces.level, axis, value, cell, passes_up).T
