"""A contour line."""

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
