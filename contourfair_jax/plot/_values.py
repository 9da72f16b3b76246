"""Fields in pictures: values as colours, samples as dots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from ._levels import LINE, SHADES

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@runtime_checkable
class Refinable(Protocol):
    """A field that can be drawn: a `BezierField`, or another that refines itself."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Samples per axis."""
        ...

    def refine(self, factor: int) -> Any:
        """Values on the grid that is `factor` times finer."""
        ...


def drawing_factor(shape: Sequence[int]) -> int:
    """Factor of the grid that is drawn: about 1000 along the longer axis, 4 at least."""
    return min(max(4, math.ceil(1000 / max(shape))), 32)


def drawn_values(field: Refinable, factor: int) -> np.ma.MaskedArray:
    """Values on the finer grid, masked outside the cells that have values throughout.

    A sample between cells that are missing has a value, and so has a side between two such cells:
    they would be drawn as dots and hairs.
    """
    values = np.asarray(field.refine(factor))
    known = np.isfinite(values)
    for axis, n in enumerate(field.shape):
        inner = [known.take(factor * np.arange(n - 1) + k, axis) for k in range(factor + 1)]
        known = np.logical_and.reduce(inner)
    for axis, size in enumerate(values.shape):
        at, last = np.arange(size), known.shape[axis] - 1
        before, after = np.maximum(at - 1, 0) // factor, np.minimum(at // factor, last)
        known = known.take(before, axis) | known.take(after, axis)
    return np.ma.masked_array(values, ~known)


def shade_values(
    ax: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray, limits: tuple[float, float]
) -> None:
    """Values as colours, each pixel centred on its sample."""
    edge_y, edge_x = (y[1] - y[0]) / 2, (x[1] - x[0]) / 2
    ax.imshow(
        values,
        cmap=SHADES,
        vmin=limits[0],
        vmax=limits[1],
        alpha=0.55,
        origin="lower",
        interpolation="nearest",
        extent=(x[0] - edge_x, x[-1] + edge_x, y[0] - edge_y, y[-1] + edge_y),
    )


def dot_samples(ax: Axes, x: np.ndarray, y: np.ndarray, shape: Sequence[int]) -> None:
    """A dot on every sample."""
    rows, columns = (np.linspace(at[0], at[-1], n) for at, n in zip((y, x), shape, strict=True))
    dots_x, dots_y = np.meshgrid(columns, rows)
    ax.plot(dots_x.ravel(), dots_y.ravel(), ".", color=LINE, markersize=2.5, alpha=0.6)
