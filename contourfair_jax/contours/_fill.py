"""Bands between levels as polygons: contour lines closed along the border of the grid.

The border of a band {lower < f <= upper} follows lines of the lower level forwards, lines of the
upper level backwards, and the border of the grid from where one stops to where the next starts.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._support.arrays import batches, ranges
from ._arcs import Codes
from ._line import signed_area
from ._pieces import MAX_DEPTH
from ._trace import Lines, chains, join_lines

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
        """Numbers of the loops that edges belong to."""
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
    """Edges of the border at which lines that are not closed start and stop.

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


_BATCH = 1 << 20


def parents(rings: Sequence[np.ndarray], holes: Sequence[int]) -> list[int]:
    """For each hole the outer ring around it that is next to it.

    From the vertex of the hole that is lowest along axis 1 one looks down along this axis.  What is
    seen first is the outer ring, or another hole of the same polygon.

    Parameters
    ----------
    rings : sequence of arrays, shape (n, 2)
        Closed, in units of cells, and without a point in common.
    holes : sequence of int
        Which of the rings are holes.
    """
    if not len(holes):
        return []
    eyes = np.array([rings[hole][np.argmin(rings[hole][:, 1])] for hole in holes])
    seen = _seen(rings, eyes)
    above = dict(zip(holes, seen.tolist(), strict=True))
    found = []
    for hole in holes:
        ring = above[hole]
        while ring in above:
            ring = above[ring]
        found.append(ring)
    return found


def _seen(rings: Sequence[np.ndarray], eyes: np.ndarray) -> np.ndarray:
    """The ring met first from each point downwards along axis 1, -1 where there is none."""
    starts = np.concatenate([ring[:-1] for ring in rings])
    ends = np.concatenate([ring[1:] for ring in rings])
    number = np.repeat(np.arange(len(rings)), [len(ring) - 1 for ring in rings])
    low, high = np.minimum(starts[:, 0], ends[:, 0]), np.maximum(starts[:, 0], ends[:, 0])
    first, last = np.floor(low).astype(int), np.floor(high).astype(int)
    spans = last - first + 1
    segment = np.repeat(np.arange(len(low)), spans)
    row = ranges(first, spans)
    order = np.argsort(row, kind="stable")
    segment, row = segment[order], row[order]
    eye_row = np.floor(eyes[:, 0]).astype(int)
    begin, stop = np.searchsorted(row, eye_row), np.searchsorted(row, eye_row, side="right")
    seen, best = np.full(len(eyes), -1), np.full(len(eyes), -np.inf)
    for here in batches(stop - begin, _BATCH):
        count = stop[here] - begin[here]
        eye, candidate = np.repeat(here, count), segment[ranges(begin[here], count)]
        across = eyes[eye, 0]
        spanned = (low[candidate] <= across) & (across < high[candidate])
        eye, candidate = eye[spanned], candidate[spanned]
        a, b = starts[candidate], ends[candidate]
        at = a[:, 1] + (b[:, 1] - a[:, 1]) * ((eyes[eye, 0] - a[:, 0]) / (b[:, 0] - a[:, 0]))
        under = at < eyes[eye, 1]
        eye, candidate, at = eye[under], candidate[under], at[under]
        np.maximum.at(best, eye, at)
        nearest = at == best[eye]
        seen[eye[nearest]] = number[candidate[nearest]]
    return seen


Polygon = tuple[np.ndarray, ...]


class Filler:
    """Polygons of bands in units of cells, from one set of lines.

    Parameters
    ----------
    samples : array, shape (n_1, n_2)
    valid : array of bool, shape (n_1 - 1, n_2 - 1)
        Cells that have values.
    parts : sequence of Lines
        All lines of the levels.
    codes : Codes
    """

    def __init__(
        self, samples: np.ndarray, valid: np.ndarray, parts: Sequence[Lines], codes: Codes
    ) -> None:
        self._border = border_of(valid)
        self._turns = self._border.turns()
        lines = join_lines(parts)
        self._edge, self._rank = border_ends(self._border, lines, codes)
        self._level = lines.level
        self._pieces = lines.pieces()
        vertices = np.diff(lines.bounds)
        self._loops = np.flatnonzero(lines.closed & (vertices > 3))
        self._open = np.flatnonzero((vertices > 1) & (self._edge >= 0).all(0))
        first = self._border.start[self._border.bounds[:-1]]
        self._at_border = samples[first[:, 0], first[:, 1]]

    def band(self, lower: int, upper: int, limits: tuple[float, float]) -> list[Polygon]:
        """Outer ring (positive area) and holes (negative area) of each part of one band.

        Parameters
        ----------
        lower, upper : int
            Numbers of levels; others than those of the lines mean that there is no such line.
        limits : tuple of float
            Values of these levels as they were traced.
        """
        rings = [self._pieces[k] for k in self._loops[self._level[self._loops] == lower]]
        rings += [self._pieces[k][::-1] for k in self._loops[self._level[self._loops] == upper]]
        rings += self._along_border(lower, upper, limits)
        areas = [signed_area(ring) for ring in rings]
        holes = [k for k, area in enumerate(areas) if area < 0]
        members = {k: [ring] for k, ring in enumerate(rings) if areas[k] > 0}
        for hole, parent in zip(holes, parents(rings, holes), strict=True):
            if parent in members:
                members[parent].append(rings[hole])
        return [tuple(polygon) for polygon in members.values()]

    def _along_border(
        self, lower: int, upper: int, limits: tuple[float, float]
    ) -> list[np.ndarray]:
        """Rings that follow the border, at least in part."""
        forward = self._open[self._level[self._open] == lower]
        backward = self._open[self._level[self._open] == upper]
        pieces = [self._pieces[k] for k in forward] + [self._pieces[k][::-1] for k in backward]
        edge, rank = (
            np.concatenate([ends[:, forward], ends[::-1, backward]], axis=1)
            for ends in (self._edge, self._rank)
        )
        inside = (self._at_border > limits[0]) & (self._at_border <= limits[1])
        inside[self._border.loop(edge[0])] = False
        rings = []
        for loop in np.flatnonzero(inside).tolist():
            rings += _simple(self._whole(loop))
        follows = self._next(edge, rank)
        head, order_in, _ = chains(follows)
        order = np.lexsort((order_in, head)).tolist()
        parts: list[np.ndarray] = []
        for k, after in zip(order, [*order, -1][1:], strict=True):
            parts.append(pieces[k])
            follower = follows[k]
            if follower >= 0:
                wraps = bool(rank[0, follower] < rank[1, k])
                parts.append(self._walk(int(edge[1, k]), int(edge[0, follower]), wraps))
            if after < 0 or head[after] != head[k]:
                rings += _simple(np.concatenate([*parts, parts[0][:1]]))
                parts = []
        return rings

    def _next(self, edge: np.ndarray, rank: np.ndarray) -> np.ndarray:
        """The line that starts next, around the loop of the border, after each has stopped."""
        order = np.argsort(rank[0])
        loops = self._border.loop(edge)
        ordered = loops[0, order]
        place = np.searchsorted(rank[0, order], rank[1])
        same = np.append(ordered, -1)[place] == loops[1]
        place = np.where(same, place, np.searchsorted(ordered, loops[1]))
        found = np.append(ordered, -1)[place] == loops[1]
        return np.where(found, np.append(order, -1)[place], -1)

    def _walk(self, first: int, last: int, wraps: bool) -> np.ndarray:
        """Corners of the border from a place on one edge to a place on another."""
        begin, end = np.searchsorted(self._turns, (first, last), side="right")
        if not wraps:
            return self._corners(self._turns[begin:end])
        loop = self._border.loop(np.array([first]))[0]
        low, high = np.searchsorted(self._turns, self._border.bounds[loop : loop + 2])
        return self._corners(np.append(self._turns[begin:high], self._turns[low:end]))

    def _whole(self, loop: int) -> np.ndarray:
        """All corners of one loop of the border, the first repeated."""
        low, high = np.searchsorted(self._turns, self._border.bounds[loop : loop + 2])
        return self._corners(np.append(self._turns[low:high], self._turns[low]))

    def _corners(self, edges: np.ndarray) -> np.ndarray:
        return self._border.start[edges].astype(np.float64)


def _simple(ring: np.ndarray) -> list[np.ndarray]:
    """The loops of a ring that comes back to corners where cells without values touch."""
    if len(np.unique(ring[:-1], axis=0)) == len(ring) - 1:
        return [ring]
    found, path, place = [], [], {}
    for vertex in map(tuple, ring.tolist()):
        if vertex in place:
            begin = place[vertex]
            found.append(np.array([*path[begin:], vertex]))
            for left in path[begin + 1 :]:
                del place[left]
            del path[begin + 1 :]
        else:
            place[vertex] = len(path)
            path.append(vertex)
    return [loop for loop in found if len(loop) > 3]
