"""The place of a picture: the coordinates of the file, their names, north up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .._grid.affine import axes_from_affine
from .._grid.reference import axis_units, has_own_spacing, in_degrees, middle_latitude

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .._grid.grid import Grid


# Near a pole, a degree of longitude is drawn at this part of one of latitude at least.
_NARROWEST = 0.1
_NAMES = {"y": "latitude", "x": "longitude"}


@dataclass(frozen=True)
class Frame:
    """The coordinates along the axes of a picture, those of the array: 0 vertical, 1 horizontal.

    Parameters
    ----------
    scale, offset
        Per axis: shown is ``offset + scale * field coordinate``.
    labels
        Texts beside the axes.
    upward
        Whether what is shown along axis 0 grows upwards.
    aspect
        How long a unit of axis 0 is drawn in those of axis 1; None where they do not compare, as
        height and longitude.
    """

    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    labels: tuple[str, str] = ("", "")
    upward: bool = False
    aspect: float | None = 1.0

    def place(self, points: np.ndarray) -> np.ndarray:
        """The places at which field coordinates, shape (..., 2), are shown."""
        return np.asarray(points) * self.scale + self.offset

    def along(self, axis: int, first: float, last: float, size: int) -> np.ndarray:
        """The numbers shown at `size` even steps between field coordinates of an axis."""
        scale, offset = self.scale[axis], self.offset[axis]
        return np.linspace(offset + scale * first, offset + scale * last, size)

    def set_limits(self, ax: Axes, y: tuple[float, float], x: tuple[float, float]) -> None:
        """Limits, directions, proportions and texts of axes that show what lies between."""
        ax.set_xlim(min(x), max(x))
        ax.set_ylim(*sorted(y, reverse=not self.upward))
        ax.set_aspect("auto" if self.aspect is None else self.aspect)
        ax.set_ylabel(self.labels[0])
        ax.set_xlabel(self.labels[1])
        ax.ticklabel_format(style="plain", useOffset=False)

    def size(self, height: float, width: float, longest: float) -> tuple[float, float]:
        """Width and height of a picture of field coordinates `height` by `width`."""
        tall, wide = abs(self.scale[0]) * height, abs(self.scale[1]) * width
        if self.aspect is None:
            return longest, 0.6 * longest
        tall *= self.aspect
        return longest * wide / max(tall, wide), longest * tall / max(tall, wide)


def frame_of(grid: Grid) -> Frame:
    """The coordinates of the file for the last two axes of a grid.

    Where these are turned against the axes of the array, distances along the latter are shown.
    """
    units, names = axis_units(grid)[-2:], grid.axes[-2:]
    comparable = len(set(units)) == 1 or "" in units
    if grid.affine is None or axes_from_affine(grid.affine, grid.shape) is None:
        turned = grid.affine is not None
        labels = [
            _label(f"distance along {n}" if turned else n, u if turned else "")
            for n, u in zip(names, units, strict=True)
        ]
        return Frame(labels=(labels[0], labels[1]), upward=grid.rows_ascend)
    steps = np.diag(grid.affine)[-3:-1]
    scale = steps / np.array(grid.spacing[-2:])
    offset = grid.affine[-3:-1, -1] - scale * np.array(grid.origin[-2:])
    aspect = abs(float(scale[1] / scale[0]))
    if in_degrees(grid):
        names = tuple(_NAMES.get(name, name) for name in names)
        if not has_own_spacing(grid):
            aspect = 1 / max(float(np.cos(np.radians(middle_latitude(grid)))), _NARROWEST)
    labels = [_label(name, unit) for name, unit in zip(names, units, strict=True)]
    return Frame(
        scale=(float(scale[0]), float(scale[1])),
        offset=(float(offset[0]), float(offset[1])),
        labels=(labels[0], labels[1]),
        upward=not grid.backward,
        aspect=aspect if comparable else None,
    )


def _label(name: str, unit: str) -> str:
    shown = "°" if unit == "degree" else unit
    return f"{name} ({shown})" if shown else name
