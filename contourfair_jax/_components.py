"""Connected parts of the samples above a level, under the multilinear interpolant."""

import itertools
from collections.abc import Iterator

import numpy as np
from skimage.measure import label


def components(samples: np.ndarray, level: float) -> np.ndarray:
    """Number the connected parts of `{f > level}` at the samples; -1 at those not above.

    Of images and of volumes.  Neighbours along an axis that are both above are connected; those
    across a cell where the bilinear (trilinear) interpolant is above the level all the way between
    them.  NaN is not above.
    """
    above = samples > level
    # Each part of the interpolant within a cell holds a corner, as it grows along axes up to one.
    part = np.asarray(label(above, connectivity=1)) - 1
    pairs = []
    for axes in itertools.combinations(range(samples.ndim), 2):
        f, higher, number = (np.moveaxis(each, axes, (0, 1)) for each in (samples, above, part))
        pairs.append(_across_faces(f, higher, number, level))
    if samples.ndim == 3:
        pairs += _through_cells(samples, above, part, level)
    root = connect(int(part.max(initial=-1)) + 1, np.concatenate(pairs, axis=1))
    number = np.unique(root, return_inverse=True)[1]
    part[above] = number[part[above]]
    return part


def _across_faces(
    samples: np.ndarray, above: np.ndarray, part: np.ndarray, level: float
) -> np.ndarray:
    """Pairs of parts that meet in faces of the first two axes: above at two opposite corners."""
    views = slice(-1), slice(1, None)
    a00, a01, a10, a11 = (above[i, j] for i in views for j in views)
    pairs = [np.zeros((2, 0), part.dtype)]
    for mixed, one, other in (
        (a00 & a11 & ~a01 & ~a10, (0, 0), (1, 1)),
        (a01 & a10 & ~a00 & ~a11, (0, 1), (1, 0)),
    ):
        at = np.nonzero(mixed)
        f00, f01, f10, f11 = (
            samples[(at[0] + i, at[1] + j, *at[2:])] for i in (0, 1) for j in (0, 1)
        )
        with np.errstate(invalid="ignore"):
            saddle = (f00 * f11 - f01 * f10) / (f00 + f11 - f01 - f10) > level
        ends = [part[(at[0] + i, at[1] + j, *at[2:])][saddle] for i, j in (one, other)]
        pairs.append(np.stack(ends))
    return np.concatenate(pairs, axis=1)


def _through_cells(
    samples: np.ndarray, above: np.ndarray, part: np.ndarray, level: float
) -> Iterator[np.ndarray]:
    """Pairs of parts that meet within cells.

    They meet at a saddle of the cell, and so in the section across the last axis through it, where
    they are above at two opposite of the corners A, B, C, D, which run along edges of the cell.
    The section is bilinear: A and C meet in it where `A C > B D`, less the level, and A, C > 0.
    """
    ring = [(0, 0), (0, 1), (1, 1), (1, 0)]
    corner = [
        [tuple(slice(bit, bit - 1 or None) for bit in (*at, k)) for k in (0, 1)] for at in ring
    ]
    higher = [above[low] | above[high] for low, high in corner]
    parts = [np.where(above[low], part[low], part[high]) for low, high in corner]
    for a, b, c, d in ((0, 1, 2, 3), (1, 2, 3, 0)):
        at = np.nonzero(higher[a] & higher[c] & (parts[a] != parts[c]))
        ends = [[samples[view][at] - level for view in corner[k]] for k in (a, b, c, d)]
        met = _meet(*(np.stack(each) for each in ends))
        yield np.stack([parts[a][at][met], parts[c][at][met]])


def _meet(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Whether `A C > B D` for any t in [0, 1] with A, C > 0; each from its value at 0 and at 1."""
    start, stop = np.zeros(a.shape[1]), np.ones(a.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        for first, last in (a, c):
            zero = first / (first - last)
            start = np.where(first > 0, start, np.maximum(start, zero))
            stop = np.where(last > 0, stop, np.minimum(stop, zero))
        da, db, dc, dd = (last - first for first, last in (a, b, c, d))
        bend = da * dc - db * dd
        top = -(a[0] * dc + c[0] * da - b[0] * dd - d[0] * db) / (2 * bend)
        met = np.zeros(len(start), bool)
        for t in (start, stop, np.clip(top, start, stop)):
            met |= (a[0] + t * da) * (c[0] + t * dc) > (b[0] + t * db) * (d[0] + t * dd)
        return met & (start < stop)


def connect(n: int, pairs: np.ndarray) -> np.ndarray:
    """Least member of the part of each of `n` nodes: hook larger roots to smaller, halve paths."""
    root = np.arange(n)
    one, other = pairs
    while len(one):
        low, high = np.minimum(root[one], root[other]), np.maximum(root[one], root[other])
        apart = low != high
        one, other, low, high = one[apart], other[apart], low[apart], high[apart]
        np.minimum.at(root, high, low)
        while not np.array_equal(root, farther := root[root]):
            root = farther
    return root
