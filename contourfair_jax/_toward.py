"""Roots of a field along straight lines: Newton's method within a bracket, all lines at once."""

import numpy as np

from ._host import HostField

# Bisection alone reaches rounding in as many steps.
_MOST = 60


def toward(
    field: HostField,
    points: np.ndarray,
    directions: np.ndarray,
    reach: np.ndarray,
    level: float,
    rounding: float,
) -> np.ndarray:
    """Where the field has a level on the line through each point, on the side the value asks for.

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
    for _ in range(_MOST):
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
    """How far it is to the border of the grid."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = np.where(directions > 0, np.array(field.cells) - points, points)
        return np.where(directions == 0, np.inf, ahead / np.abs(directions)).min(1)
