"""Halves of Bezier cells, and the extreme values of a field by bounds on them."""

import itertools

import numpy as np


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
        for axis in range(ndim):
            stacked = np.moveaxis(cells.reshape((4,) * ndim + (-1,)), axis, 0)
            both = np.concatenate(halves(stacked), axis=-1)
            cells = np.moveaxis(both, 0, axis).reshape(4**ndim, -1)
        best = max(best, float(cells[corners].max()))
    return best
