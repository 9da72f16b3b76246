"""Pictures of fields and their contours.

Matplotlib is imported when a picture is drawn, and drawn on plain `Figure` objects: no display is
needed, and nothing of `pyplot`'s state is touched.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ._bilinear import BilinearField as BilinearField
from ._plot_surface import draw_surface as draw_surface
from ._plot_surface import surface_figure as surface_figure
from .io import InputError, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LINE = "#1a1a1a"
_SHADES = "viridis"
# Samples are dotted where there are at most this many along the longer axis.
_DOTS = 24


class Refinable(Protocol):
    """What can be drawn: a `BezierField`, or a `BilinearField`."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Samples per axis."""
        ...

    def refine(self, factor: int) -> Any:
        """Values on the grid that is `factor` times finer."""
        ...


def plot_contours(
    field: Refinable,
    levels: Sequence[float],
    *,
    ax: Axes | None = None,
    refine: int | None = None,
    shade: bool = True,
    upward: bool = False,
    limits: tuple[float, float] | None = None,
    title: str = "",
) -> Axes:
    """Draw the contours of a 2-D field over its values.

    Parameters
    ----------
    field
        A `BezierField` or `BilinearField`.
    levels
        The values to draw lines at.
    ax
        Where to draw; by default on a new figure, ``ax.figure``.
    refine
        How much finer than the samples to draw; by default enough for a sharp picture.
    shade
        Whether the values are shown as colours behind the lines.
    upward
        Whether axis 0 points up; by default row 0 is at the top, as in an image.
    limits
        Values at the ends of the colour scale; by default the range of the field.
    title
        Text above the picture.

    Returns
    -------
    matplotlib.axes.Axes
    """
    if len(field.shape) != 2:
        raise ValueError(f"field must be 2-D to be drawn, got {len(field.shape)}-D")
    spacing, origin = _geometry(field)
    values = np.ma.masked_invalid(np.asarray(field.refine(refine or drawing_factor(field.shape))))
    if ax is None:
        ax = _new_axes(field)
    y, x = (
        np.linspace(start, start + step * (n - 1), size)
        for start, step, n, size in zip(origin, spacing, field.shape, values.shape, strict=True)
    )
    if shade:
        _shade(ax, x, y, values, limits or (values.min(), values.max()))
    inside = sorted({float(level) for level in levels if values.min() < level < values.max()})
    if inside:
        _draw_lines(ax, field, x, y, values, inside)
    if max(field.shape) <= _DOTS:
        _dots(ax, x, y, field.shape)
    ax.set_xlim(x[0], x[-1])
    ax.set_ylim(*((y[0], y[-1]) if upward else (y[-1], y[0])))
    ax.set_aspect("equal")
    ax.set_title(title)
    return ax


def contour_figure(
    field: Refinable,
    levels: Sequence[float],
    *,
    refine: int | None = None,
    shade: bool = True,
    upward: bool = False,
    units: str = "",
    title: str = "",
) -> Figure:
    """One field with its contours and a colour bar that marks the levels.

    Parameters
    ----------
    field, levels, refine, shade, upward, title
        As for `plot_contours`.
    units
        Text beside the colour bar.

    Returns
    -------
    matplotlib.figure.Figure
    """
    ax = plot_contours(field, levels, refine=refine, shade=shade, upward=upward, title=title)
    figure = ax.get_figure(root=True)
    assert figure is not None
    if ax.images:
        bar = figure.colorbar(ax.images[0], ax=ax, shrink=0.8, label=units)
        low, high = ax.images[0].get_clim()
        inside = [at for at in levels if low < at < high]
        bar.add_lines(inside, [_LINE] * len(inside), 0.8)
    return figure


def compare_figure(
    fields: Mapping[str, Refinable],
    levels: Sequence[float],
    *,
    refine: int | None = None,
    shade: bool = True,
    upward: bool = False,
    title: str = "",
) -> Figure:
    """Fields of the same samples side by side, with the same levels and colours.

    Parameters
    ----------
    fields
        Panels from left to right: heading to field.
    levels, refine, shade, upward
        As for `plot_contours`.
    title
        Text above all panels.

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.figure import Figure

    if not fields:
        raise ValueError("fields must hold at least one field, got none")
    first = next(iter(fields.values()))
    height, width = _extent(first)
    panel = 4.5
    tall = min(max(panel * height / width, 2.0), 9.0)
    figure = Figure(figsize=(panel * len(fields), tall + 0.7), layout="compressed")
    samples = np.ma.masked_invalid(np.asarray(first.refine(1)))
    limits = (float(samples.min()), float(samples.max()))
    for place, (name, field) in enumerate(fields.items(), 1):
        ax = figure.add_subplot(1, len(fields), place)
        plot_contours(
            field,
            levels,
            ax=ax,
            refine=refine,
            shade=shade,
            upward=upward,
            limits=limits,
            title=name,
        )
        ax.set_xticks([])
        ax.set_yticks([])
    if title:
        figure.suptitle(title, fontsize="medium")
    return figure


def save_figure(figure: Figure, path: str | os.PathLike[str], dpi: float = 150) -> None:
    """Store a figure as PNG; `path` is replaced when all is written."""
    if not os.fspath(path).lower().endswith(".png"):
        raise InputError(f"{path}: pictures are written as .png")
    with replacing(path) as partial:
        figure.savefig(partial, format="png", dpi=dpi, bbox_inches="tight")


def drawing_factor(shape: Sequence[int]) -> int:
    """How much finer than the samples to draw: about 1000 along the longer axis, 4 at least."""
    return min(max(4, math.ceil(1000 / max(shape))), 32)


def level_colors(count: int) -> list[str]:
    """`count` colours from dark to light, as ``#rrggbb``."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    # The lightest fifth of the map cannot be seen on white.
    return [to_hex(colormaps[_SHADES](at)) for at in np.linspace(0.0, 0.8, count)]


def _geometry(field: Refinable) -> tuple[list[float], list[float]]:
    spacing = np.broadcast_to(np.asarray(getattr(field, "spacing", 1.0)), (2,))
    origin = np.broadcast_to(np.asarray(getattr(field, "origin", 0.0)), (2,))
    return [float(step) for step in spacing], [float(start) for start in origin]


def _extent(field: Refinable) -> tuple[float, float]:
    spacing, _ = _geometry(field)
    height, width = (h * max(n - 1, 1) for h, n in zip(spacing, field.shape, strict=True))
    return height, width


def _new_axes(field: Refinable) -> Axes:
    from matplotlib.figure import Figure

    height, width = _extent(field)
    scale = 8.0 / max(height, width)
    size = (max(width * scale, 2.0), max(height * scale, 2.0) + 0.4)
    return Figure(figsize=size, layout="compressed").add_subplot()


def _shade(
    ax: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray, limits: tuple[float, float]
) -> None:
    """Values as colours, each pixel centred on its sample."""
    edge_y, edge_x = (y[1] - y[0]) / 2, (x[1] - x[0]) / 2
    ax.imshow(
        values,
        cmap=_SHADES,
        vmin=limits[0],
        vmax=limits[1],
        alpha=0.55,
        origin="lower",
        interpolation="nearest",
        extent=(x[0] - edge_x, x[-1] + edge_x, y[0] - edge_y, y[-1] + edge_y),
    )


def _draw_lines(
    ax: Axes,
    field: Refinable,
    x: np.ndarray,
    y: np.ndarray,
    values: np.ndarray,
    levels: Sequence[float],
) -> None:
    """The exact contours of a field that has them, else those of the refined values."""
    width = _line_width(len(levels))
    trace = getattr(field, "contours", None)
    if trace is None:
        ax.contour(x, y, values, levels=levels, colors=_LINE, linewidths=width)
    else:
        from .export import draw_lines

        draw_lines(trace(levels), ax, _LINE, width)


def _dots(ax: Axes, x: np.ndarray, y: np.ndarray, shape: Sequence[int]) -> None:
    """A dot on every sample."""
    rows, columns = (np.linspace(at[0], at[-1], n) for at, n in zip((y, x), shape, strict=True))
    dots_x, dots_y = np.meshgrid(columns, rows)
    ax.plot(dots_x.ravel(), dots_y.ravel(), ".", color=_LINE, markersize=2.5, alpha=0.6)


def _line_width(count: int) -> float:
    return 1.0 if count <= 12 else 0.7 if count <= 25 else 0.45
