"""Where cubics in Bezier form take a value: safeguarded Newton, all cubics at once."""

import numpy as np

# Newton steps for all cubics, before the few that need more are sorted out.
_STEPS = 4
# A cubic is solved in blocks of this size, to stay in the cache.
_BLOCK = 1 << 14
# Bisection alone reaches the spacing of floats in [0, 1] in as many steps.
_MOST = 60


def cubic_root(points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """One root in [0, 1] for cubics that are on both sides of a value at their ends.

    Parameters
    ----------
    points : array, shape (4, n)
        Bezier points.
    values : array, shape (n,)
        The cubics take their value; where both ends are on one side, the nearer end is the answer.

    Returns
    -------
    array, shape (n,)
    """
    roots = np.empty(values.shape)
    for start in range(0, len(values), _BLOCK):
        block = slice(start, start + _BLOCK)
        roots[block] = _solve(points[:, block] - values[block])
    return roots


def _solve(points: np.ndarray) -> np.ndarray:
    p0, p1, p2, p3 = points
    c1 = 3 * (p1 - p0)
    c2 = 3 * (p2 - p1) - c1
    cubic = np.stack([p0, c1, c2, p3 - p0 - c1 - c2])
    low, high = np.zeros_like(p0), np.ones_like(p0)
    rises = p3 > p0
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.nan_to_num(p0 / (p0 - p3), nan=0.5)
    t = np.clip(t, 0, 1)
    moved = high
    for _ in range(_STEPS):
        t, low, high, moved = _newton(cubic, rises, t, low, high)
    open_ = np.flatnonzero(moved > 1e-9)
    if len(open_):
        t[open_] = _finish(cubic[:, open_], rises[open_], t[open_], low[open_], high[open_])
    t[(p0 == 0) | ((p0 > 0) == (p3 > 0)) & (np.abs(p0) <= np.abs(p3))] = 0
    t[(p3 == 0) | ((p0 > 0) == (p3 > 0)) & (np.abs(p0) > np.abs(p3))] = 1
    return t


def _newton(cubic, rises, t, low, high):
    """One step, bisection where Newton leaves the bracket."""
    c0, c1, c2, c3 = cubic
    value = ((c3 * t + c2) * t + c1) * t + c0
    slope = (3 * c3 * t + 2 * c2) * t + c1
    below = (value < 0) == rises
    low, high = np.where(below, t, low), np.where(below, high, t)
    with np.errstate(divide="ignore", invalid="ignore"):
        step = t - value / slope
    step = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
    return step, low, high, np.abs(step - t)


def _finish(cubic, rises, t, low, high):
    for _ in range(_MOST):
        t, low, high, moved = _newton(cubic, rises, t, low, high)
        if moved.max() <= 1e-15:
            break
    return t
