"""Smallest and largest value of a field in Bezier form, by bounds and subdivision."""

import itertools

import numpy as np

from ._cells import halves

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
