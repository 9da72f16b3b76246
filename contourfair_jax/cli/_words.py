"""Grids and results in words, for the command line."""

import math
from dataclasses import dataclass

import numpy as np

from .._grid.grid import Grid


def describe_missing(grid: Grid) -> str:
    """Missing samples and their bounding box: ``3 of 63 (4.8%), within y 0..2, x 4..4``."""
    box = grid.missing_box()
    if box is None:
        return "none"
    where = ", ".join(
        f"{name} {first}..{last}" for name, (first, last) in zip(grid.axes, box, strict=True)
    )
    return f"{describe_count(grid.missing_count, grid.values.size)}, within {where}"


def describe_count(missing: int, size: int) -> str:
    """Number and share of missing samples: ``3 of 63 (4.8%)``."""
    return f"{missing} of {size} ({missing / size:.1%})"


def missing_note(described: str, fill: bool = False) -> str:
    """Note on gaps in the data that a command fairs."""
    fate = "they are filled" if fill else "they and the cells beside them stay missing"
    return f"missing samples: {described}; {fate}"


@dataclass(frozen=True)
class Output:
    """Samples that were written: their number per axis, type, and how many are missing."""

    shape: tuple[int, ...]
    dtype: np.dtype
    missing: int

    def __str__(self) -> str:
        share = self.missing / math.prod(self.shape)
        gaps = f", {share:.1%} missing" if self.missing else ""
        return f"{by(self.shape)} {self.dtype}{gaps}"


def by(shape: tuple[int, ...]) -> str:
    """Samples along each axis: ``3 x 4``."""
    return " x ".join(str(n) for n in shape)
