"""Roots by safeguarded Newton steps, all at once: of cubics in Bezier form, and along lines."""

import numpy as np

from .host import HostField

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


# Bisection alone reaches rounding in as many steps.
_MOST_STEPS = 60


def toward(
    field: HostField,
    points: np.ndarray,
    directions: np.ndarray,
    reach: np.ndarray,
    level: float,
    rounding: float,
) -> np.ndarray:
    """The points of a level on lines through others, on the side that the values of these ask for.

    Parameters
    ----------
    field : HostField
    points : array, shape (n, ndim)
        In grid coordinates.
    directions : array, shape (n, ndim)
        Unit vectors along which the field rises.
    reach : array, shape (n,)
        How far a root may be.
    level : float
    rounding : float
        Values this near to the level have it.

    Returns
    -------
    array, shape (n, ndim)
        NaN where both ends of the reach, cut at the border of the grid, are on one side.
    """
    value, slope = _value_and_slope(field, points, directions, level)
    side = np.where(value < 0, 1.0, -1.0)
    directions = side[:, None] * directions
    reach = np.minimum(reach, _to_border(field, points, directions))
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.fmin(2 * np.abs(value / slope), reach)
    # Within twice the first step of Newton's method mostly, else anywhere.
    end, _ = _value_and_slope(field, points + far[:, None] * directions, directions, level)
    far = np.where(side * end >= 0, far, reach)
    end, _ = _value_and_slope(field, points + far[:, None] * directions, directions, level)
    bracketed = side * end >= 0
    at = np.where(np.abs(value) <= rounding, 0.0, np.nan)
    open_ = np.flatnonzero(bracketed & ~(at == 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        start = far[open_] * np.abs(value[open_] / (value[open_] - end[open_]))
    at[open_] = _bracketed(
        field, points[open_], directions[open_], side[open_], start, far[open_], level, rounding
    )
    found = points + at[:, None] * directions
    return np.clip(found, 0.0, np.array(field.cells))


def _bracketed(field, points, directions, side, at, high, level, rounding) -> np.ndarray:
    """Steps of Newton's method, bisection where one leaves the bracket, which starts at zero."""
    low, high = np.zeros_like(high), high.copy()
    open_ = np.arange(len(at))
    for _ in range(_MOST_STEPS):
        t, direction = at[open_], directions[open_]
        value, slope = _value_and_slope(
            field, points[open_] + t[:, None] * direction, direction, level
        )
        before = side[open_] * value < 0
        low[open_], high[open_] = np.where(before, t, low[open_]), np.where(before, high[open_], t)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = t - value / slope
        within = (step > low[open_]) & (step < high[open_])
        going = ~(np.abs(value) <= rounding)
        step = np.where(within, step, 0.5 * (low[open_] + high[open_]))
        at[open_[going]] = step[going]
        open_ = open_[going]
        if not len(open_):
            break
    at[open_] = np.nan
    return at


def _value_and_slope(
    field: HostField, points: np.ndarray, directions: np.ndarray, level: float
) -> tuple[np.ndarray, np.ndarray]:
    value, gradient = field.jet(points, 1)
    return value[0] - level, (gradient.T * directions).sum(1)


def _to_border(field: HostField, points: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Distance to the border of the grid."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = np.where(directions > 0, np.array(field.cells) - points, points)
        return np.where(directions == 0, np.inf, ahead / np.abs(directions)).min(1)
