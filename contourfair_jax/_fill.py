"""Bands between levels as polygons: contour lines closed along the border of the grid.

The border of a band {lower < f <= upper} follows lines of the lower level forwards, lines of the
upper level backwards, and the border of the grid from where one stops to where the next starts.
"""

from collections.abc import Sequence

import numpy as np

from ._border import border_ends, border_of
from ._codes import Codes
from ._lengths import signed_area
from ._link import Lines, chains, concatenate
from ._nest import parents

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
        lines = concatenate(parts)
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
