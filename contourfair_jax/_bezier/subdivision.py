"""Parts of Bezier cells, and the extreme values of a field by bounds on them.

The batch is last: Bezier points of n cells have the shape (4, ..., 4, n).
"""

import itertools
from collections.abc import Callable, Iterator

import numpy as np

from .bernstein import bernstein


def halves(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both halves of cubics along the first axis, by de Casteljau.

    The last point of the lower half is the first of the upper, bit for bit, and the end points are
    copied: pieces that share an edge agree on it exactly.
    """
    p0, p1, p2, p3 = points
    p01, p12, p23 = (p0 + p1) * 0.5, (p1 + p2) * 0.5, (p2 + p3) * 0.5
    p012, p123 = (p01 + p12) * 0.5, (p12 + p23) * 0.5
    middle = (p012 + p123) * 0.5
    return np.stack([p0, p01, p012, middle]), np.stack([middle, p123, p23, p3])


def children(
    points: np.ndarray, holds: Callable[[np.ndarray], np.ndarray] | None = None
) -> Iterator[tuple[tuple[int, ...], np.ndarray, np.ndarray]]:
    """The 2^d parts of cells that are halved along every axis, the last axis fastest.

    Parameters
    ----------
    points : array, shape (4, ..., 4, n)
    holds : callable
        Which of the pieces with these points, flat, shape (m, n), are wanted.  Asked after every
        halving: of what is not wanted no part is halved further.  By default all are.

    Yields
    ------
    tuple of int
        Which half along each axis.
    array, shape (4, ..., 4, m)
        Bezier points.
    array of int, shape (m,)
        Whose parts they are.
    """
    ndim = points.ndim - 1

    def below(
        axis: int, part: np.ndarray, whose: np.ndarray, bits: tuple[int, ...]
    ) -> Iterator[tuple[tuple[int, ...], np.ndarray, np.ndarray]]:
        if axis == ndim:
            yield bits, part, whose
            return
        for bit, half in enumerate(halves(np.moveaxis(part, axis, 0))):
            piece, owner = np.moveaxis(half, 0, axis), whose
            if holds is not None:
                kept = np.flatnonzero(holds(half.reshape(4**ndim, -1)))
                piece, owner = piece.take(kept, -1), whose[kept]
            yield from below(axis + 1, piece, owner, (*bits, bit))

    return below(0, points, np.arange(points.shape[-1]), ())


def dyadic_parts(points: np.ndarray, place: np.ndarray, depth: int) -> np.ndarray:
    """One part of each cell that was halved `depth` times, in one step.

    Parameters
    ----------
    points : array, shape (4, ..., 4, n)
    place : array of int, shape (n, ndim)
        Lower corner of the part in its cell, in units of its side.
    depth : int

    Returns
    -------
    array, shape (4, ..., 4, n)
    """
    matrices = _part_matrices(depth)
    for axis in range(points.ndim - 1):
        rows = matrices[place[:, axis]]
        p = np.moveaxis(points, axis, 0)
        points = np.moveaxis(np.einsum("nab,b...n->a...n", rows, p), 0, axis)
    return points


def _part_matrices(depth: int) -> np.ndarray:
    """Matrices from the points of a cubic to those of its `2**depth` parts: (parts, 4, 4)."""
    count = 1 << depth
    start = np.arange(count) / count
    at = start[:, None] + np.arange(4) / (3 * count)
    return np.linalg.inv(bernstein(3, np.arange(4) / 3)) @ bernstein(3, at)


_DEPTH = 20


def extrema(net: np.ndarray, relative: float = 1e-9) -> tuple[float, float]:
    """Least and largest value over all cells that hold no NaN, any dimension.

    Parameters
    ----------
    net : array, shape (3 (n_1 - 1) + 1, ...)
    relative : float
        What may be missed, relative to the range of the samples.
    """
    ndim = net.ndim
    net = np.asarray(net, dtype=np.float64)
    places = itertools.product(range(4), repeat=ndim)
    cells = np.stack(
        [net[tuple(slice(k, k - 3 or None, 3) for k in place)].ravel() for place in places]
    )
    cells = cells[:, np.isfinite(cells).all(0)]
    if not cells.size:
        return np.nan, np.nan
    error = relative * float(np.ptp(cells[[0, -1]]))
    low = -_largest(-cells, ndim, error)
    return low, _largest(cells, ndim, error)


def _largest(cells: np.ndarray, ndim: int, error: float) -> float:
    """Branch and bound: halve along all axes what may still hold a larger value."""
    corners = [
        sum(3 * bit * 4**axis for axis, bit in enumerate(bits))
        for bits in itertools.product((0, 1), repeat=ndim)
    ]
    best = float(cells[corners].max())
    for _ in range(_DEPTH):
        cells = cells[:, cells.max(0) > best + error]
        if not cells.size:
            break
        parts = [part for _, part, _ in children(cells.reshape((4,) * ndim + (-1,)))]
        cells = np.concatenate(parts, axis=-1).reshape(4**ndim, -1)
        best = max(best, float(cells[corners].max()))
    return best
