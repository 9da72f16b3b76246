"""The border of the cells that have values: loops of edges with these cells on the left."""

from dataclasses import dataclass

import numpy as np

from ._codes import Codes
from ._link import Lines, chains
from ._subdivide import MAX_DEPTH

# The four edges of a cell, each a left turn from the one before: where it starts, how it goes on,
# and which cell lies on its right.
_START = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
_STEP = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
_RIGHT = ((0, -1), (1, 0), (0, 1), (-1, 0))


@dataclass(frozen=True)
class Border:
    """Edges of the border in order, loop after loop.

    Parameters
    ----------
    start : array of int, shape (n, 2)
        Vertices of the grid.
    direction : array of int, shape (n,)
        Which of the four edges of its cell it is.
    bounds : array of int, shape (loops + 1,)
        Loop k has the edges `bounds[k]` up to `bounds[k + 1]`.
    """

    start: np.ndarray
    direction: np.ndarray
    bounds: np.ndarray

    def loop(self, edge: np.ndarray) -> np.ndarray:
        """Which loop edges belong to."""
        return np.searchsorted(self.bounds, edge, side="right") - 1

    def turns(self) -> np.ndarray:
        """Edges that start in a corner of their loop."""
        before = np.arange(len(self.start)) - 1
        before[self.bounds[:-1]] = self.bounds[1:] - 1
        return np.flatnonzero(self.direction != self.direction[before])


def border_of(valid: np.ndarray) -> Border:
    """The border of the cells where a mask is true; cells joined by a corner only stay apart."""
    inside = np.pad(valid, 1)
    starts, directions = [], []
    rows, columns = valid.shape
    for direction, (i, j) in enumerate(_RIGHT):
        right = inside[1 + i : 1 + i + rows, 1 + j : 1 + j + columns]
        cells = np.argwhere(valid & ~right)
        starts.append(cells + _START[direction])
        directions.append(np.full(len(cells), direction))
    start, direction = np.concatenate(starts), np.concatenate(directions)
    if not len(start):
        return Border(start, direction, np.zeros(1, int))
    end = start + _STEP[direction]
    follows = np.full(len(start), -1)
    for turn in (-1, 0, 1):  # Where there is a choice, the left turn: the last one stands.
        found = _find(start, direction, end, (direction + turn) % 4)
        follows = np.where(found >= 0, found, follows)
    head, rank, _ = chains(follows)
    order = np.lexsort((rank, head))
    bounds = np.append(np.flatnonzero(np.diff(head[order], prepend=-1)), len(order))
    return Border(start[order], direction[order], bounds)


def border_ends(border: Border, lines: Lines, codes: Codes) -> tuple[np.ndarray, np.ndarray]:
    """Where on the border lines that are not closed start and stop.

    Returns
    -------
    edge : array of int, shape (2, lines)
        Number of the edge; -1 for loops.
    rank : array of int, shape (2, lines)
        Ascends along the border.
    """
    points = np.stack([lines.points[lines.bounds[:-1]], lines.points[lines.bounds[1:] - 1]])
    edges, parts = np.full(points.shape[:2], -1), np.zeros(points.shape[:2])
    for stops in (0, 1):
        axis, value, cell, up = codes.decode(lines.codes[:, stops])
        below = up == stops  # The cell with values is on the lower side of the edge.
        direction = np.where(axis == 0, np.where(below, 1, 3), np.where(below, 2, 0))
        across, along = value >> MAX_DEPTH, cell + (direction >= 2)
        vertex = np.where(axis == 0, (across, along), (along, across)).T
        found = _find(border.start, border.direction, vertex, direction)
        edges[stops] = np.where(lines.closed, -1, found)
        parts[stops] = np.abs(points[stops] - vertex).sum(1)
    rank = np.empty(edges.size, int)
    rank[np.lexsort((parts.ravel(), edges.ravel()))] = np.arange(edges.size)
    return edges, rank.reshape(edges.shape)


def _find(
    start: np.ndarray, direction: np.ndarray, vertex: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """Numbers of the edges that start at given vertices in given directions, or -1."""
    codes, sought = (
        (at[:, 0] * (1 << 29) + at[:, 1]) * 4 + way
        for at, way in ((start, direction), (vertex, wanted))
    )
    order = np.argsort(codes)
    place = np.minimum(np.searchsorted(codes, sought, sorter=order), len(codes) - 1)
    return np.where(codes[order[place]] == sought, order[place], -1)
