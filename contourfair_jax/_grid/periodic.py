"""Axes that go all the way round: parts of the turns beside are faired too, and then cut off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .affine import TURN

if TYPE_CHECKING:
    from .grid import Grid


# Samples added beyond the seam.
_MARGIN = 16


def margin_of(count: int) -> int:
    """Samples that are added before the first of `count`; after the last there is one more."""
    return min(_MARGIN, count)


def with_turns(values: Any, axis: int) -> Any:
    """`values` with parts of the turns before and after along `axis`: as much as `margin_of`."""
    margin = margin_of(values.shape[axis])
    return _wrapped(values, axis, margin, margin + 1)


def closed(grid: Grid, axes: Sequence[int]) -> Grid:
    """The grid with the first sample of the next turn at the end of `axes`."""
    values, missing = grid.values, grid.missing
    for axis in axes:
        values = _wrapped(values, axis, 0, 1)
        missing = None if missing is None else _wrapped(missing, axis, 0, 1)
    return replace(grid, values=values, missing=missing)


def check_turn(name: str, count: int, step: float, units: str) -> None:
    """Refuse an axis in degrees that is not all around.

    Raises
    ------
    ValueError
        Its samples cover more or less than 360 degrees.
    """
    covered = count * step
    if units.startswith("degree") and abs(covered - TURN) > 0.01 * step:
        raise ValueError(
            f"coordinate {name!r} covers {covered:g} degrees, not 360; it is not periodic"
        )


def _wrapped(values: Any, axis: int, before: int, after: int) -> Any:
    """`values` with samples of the turns before and after along `axis`."""
    n = values.shape[axis]
    return np.take(values, np.arange(-before, n + after) % n, axis)
