"""Parts of a level set that pass between the points of its lattice: found, or counted.

A cube of the lattice whose corners are on one side of the level has no triangles, but may hold a
part of the level set.  Its Bezier points tell: pieces of the cube whose points are all on one side
hold nothing.  Pieces that are left and touch form clusters, which meet the rest of the level set
only where they touch a cube with corners on both sides: there the surface bulges out of the cube,
or passes through it.  The level set in every other cluster is apart from the mesh.  Where corners
of its pieces are on different sides, the pieces are a finer lattice of its own; where they are not,
smaller pieces are tried.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .._bezier.host import HostField
from .._bezier.subdivision import children
from ._mesh import connect

# Pieces per cell and axis, first and last; the last ones where there are not too many.
_FACTORS = (8, 32)
_MOST_CELLS = 1 << 11
_BATCH = 1 << 12


@dataclass(frozen=True)
class Pieces:
    """Equal parts of cells that may hold the level.

    Parameters
    ----------
    factor : int
        How many of them a cell has along each axis.
    corner : array of int, shape (n, 3)
        Lower corners, in units of `1 / factor` cells.
    above : array of bool, shape (n, 2, 2, 2)
        Which corners are above the level.
    outside : array of bool, shape (n,)
        Whether the corners of the cube of the lattice are.
    """

    factor: int
    corner: np.ndarray
    above: np.ndarray
    outside: np.ndarray

    def take(self, chosen: np.ndarray) -> "Pieces":
        """The pieces where a mask is true."""
        arrays = (self.corner, self.above, self.outside)
        return Pieces(self.factor, *(array[chosen] for array in arrays))


def small_parts(
    field: HostField, active: np.ndarray, mixed: np.ndarray, level: float
) -> tuple[list[Pieces], int]:
    """The clusters of pieces that hold a part apart from the mesh.

    Parameters
    ----------
    field : HostField
        3-D.
    active : array of bool, shape (n_1 - 1, ...)
        Cells that may hold the level.
    mixed : array of bool, shape (factor (n_1 - 1), ...)
        Cubes of the lattice with corners on both sides.
    level : float

    Returns
    -------
    list of Pieces
        Of different sizes.
    int
        Cells with clusters in which no part was found and that were not proved empty.
    """
    cells, within = np.argwhere(active), None
    apart_from_mesh: list[Pieces] = []
    for factor in _FACTORS:
        pieces = _pieces(field, cells, mixed, level, factor)
        if within is not None:
            step = factor // within.factor
            known = _keys(field, within.corner, within.factor)
            mine = _keys(field, pieces.corner // step, within.factor)
            pieces = pieces.take(np.isin(mine, known))
        cluster = _clusters(field, pieces)
        apart = ~_share(cluster, _touch(field, pieces, mixed))
        count = pieces.above.reshape(-1, 8).sum(1)
        holds = _share(cluster, (count > 0) & (count < 8))
        apart_from_mesh.append(pieces.take(apart & holds))
        within = pieces.take(apart & ~holds)
        cells = np.unique(within.corner // factor, axis=0)
        if not 0 < len(cells) <= _MOST_CELLS:
            break
    return [pieces for pieces in apart_from_mesh if len(pieces.corner)], len(cells)


def _pieces(
    field: HostField, cells: np.ndarray, mixed: np.ndarray, level: float, factor: int
) -> Pieces:
    """The pieces of all cells in cubes that are not mixed."""
    empty = np.zeros((0, 3), int), np.zeros((0, 2, 2, 2), bool), np.zeros(0, bool)
    parts = [empty, *_batches(field, cells, mixed, level, factor)]
    return Pieces(factor, *map(np.concatenate, zip(*parts, strict=True)))


def _batches(
    field: HostField, cells: np.ndarray, mixed: np.ndarray, level: float, factor: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """`corner`, `above` and `outside` of pieces."""
    lattice = mixed.shape[0] // field.cells[0]
    for start in range(0, len(cells), _BATCH):
        corner, reached = cells[start : start + _BATCH], 1
        points, outside = field.gather(corner), np.zeros(len(corner), bool)
        while reached < factor:
            points, corner, parent = _eighths(points, corner, level)
            outside, reached = outside[parent], 2 * reached
            if reached == lattice:
                kept = np.flatnonzero(~mixed[tuple(corner.T)])
                points, corner = points.take(kept, -1), corner[kept]
                outside = points[0, 0, 0] > level
        yield corner, np.moveaxis(points[::3, ::3, ::3] > level, -1, 0), outside


def _eighths(
    points: np.ndarray, corner: np.ndarray, level: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and corners of the eighths that may hold the level, and whose eighths they are."""

    def holds(pieces: np.ndarray) -> np.ndarray:
        return (pieces.min(0) <= level) & (pieces.max(0) > level)

    parts = [
        (eighth, 2 * corner[parent] + np.array(bits), parent)
        for bits, eighth, parent in children(points, holds)
    ]
    eighths, corners, parents = zip(*parts, strict=True)
    return np.concatenate(eighths, -1), np.concatenate(corners), np.concatenate(parents)


def _keys(field: HostField, corner: np.ndarray, factor: int) -> np.ndarray:
    """Corners inside the grid as numbers."""
    shape = tuple(factor * n for n in field.cells)
    return np.asarray(np.ravel_multi_index(tuple(corner.T), shape))


def _clusters(field: HostField, pieces: Pieces) -> np.ndarray:
    """The number of a member of its cluster for every piece; pieces touch across corners too."""
    keys = _keys(field, pieces.corner, pieces.factor)
    order = np.argsort(keys)
    ordered, upper = keys[order], pieces.factor * np.array(field.cells)
    pairs = [np.zeros((2, 0), int)]
    for step in itertools.product((-1, 0, 1), repeat=3):
        if step <= (0, 0, 0) or not len(keys):
            continue
        beside = pieces.corner + np.array(step)
        one = np.flatnonzero(((beside >= 0) & (beside < upper)).all(1))
        mine = _keys(field, beside[one], pieces.factor)
        at = np.minimum(np.searchsorted(ordered, mine), len(keys) - 1)
        there = ordered[at] == mine
        pairs.append(np.stack([one[there], order[at[there]]]))
    return connect(len(keys), np.concatenate(pairs, axis=1))


def _share(cluster: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """True for pieces in clusters with a chosen one."""
    marked = np.zeros(len(cluster), bool)
    marked[cluster[chosen]] = True
    return marked[cluster]


def _touch(field: HostField, pieces: Pieces, mixed: np.ndarray) -> np.ndarray:
    """True for pieces that touch a mixed cube."""
    touching = np.zeros(len(pieces.corner), bool)
    per_cube = pieces.factor * field.cells[0] // mixed.shape[0]
    for step in itertools.product((-1, 0, 1), repeat=3):
        beside = (pieces.corner + np.array(step)) // per_cube
        inside = ((beside >= 0) & (beside < np.array(mixed.shape))).all(1)
        touching[inside] |= mixed[tuple(beside[inside].T)]
    return touching
