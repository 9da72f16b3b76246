"""A contour line and the area within, alone because files and pictures need no tracer."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class ContourLine:
    """One piece of a level set.

    Parameters
    ----------
    level
        The value along the line.
    points
        Field coordinates in array order (``y, x``), shape ``(n, 2)``.
    closed
        Whether the line is a loop; its last point then equals its first.
    """

    level: float
    points: np.ndarray
    closed: bool


def signed_area(ring: np.ndarray) -> float:
    """Area within a closed line; negative where it runs clockwise in the plane (0, 1)."""
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))
