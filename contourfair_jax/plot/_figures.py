"""Figures of fields and their contours."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .._grid.grid import Grid
from .._support.errors import InputError
from ..io import replacing
from ._frame import Frame, frame_of
from ._levels import LINE, band_bar, draw_levels, fill_bands, line_width
from ._values import Refinable, dot_samples, drawing_factor, drawn_values, shade_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..contours import Bands, ContourLine


# Samples are dotted where there are at most this many along the longer axis.
_DOTS = 24
_LONGEST = 8.0


def plot_contours(
    field: Refinable,
    levels: Sequence[float],
    *,
    ax: Axes | None = None,
    grid: Grid | None = None,
    lines: Sequence[ContourLine] | None = None,
    bands: Bands | None = None,
    refine: int | None = None,
    shade: bool = True,
    label: bool = False,
    upward: bool = False,
    limits: tuple[float, float] | None = None,
    title: str = "",
) -> Axes:
    """Draw the contours of a 2-D field over its values, or over the bands between levels.

    Parameters
    ----------
    field
        A `BezierField`, as of `fair_field` or `metrics.bilinear_field`.
    levels
        The values to draw lines at.
    ax
        Where to draw; by default on a new figure, ``ax.figure``.
    grid
        Whose samples the field was made from: the axes then show its world coordinates, north up,
        with their names and units.  By default they show those of the field.
    lines
        The contours, where they are traced already.
    bands
        Drawn as areas of one colour each, in the place of the values.
    refine
        How much finer than the samples to draw; by default enough for a sharp picture.
    shade
        Whether the values are shown as colours behind the lines.
    label
        Whether long lines are labelled with their levels.
    upward
        Whether axis 0 points up; by default row 0 is at the top, as in an image.  Of a `grid`, its
        coordinates say so.
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
    frame = Frame(upward=upward) if grid is None else frame_of(grid)
    values = drawn_values(field, refine or drawing_factor(field.shape))
    if ax is None:
        ax = _new_axes(field, frame)
    spacing, origin = _geometry(field)
    y, x = (
        frame.along(k, start, start + step * (n - 1), size)
        for k, (start, step, n, size) in enumerate(
            zip(origin, spacing, field.shape, values.shape, strict=True)
        )
    )
    ends = (float(values.min()), float(values.max())) if values.count() else (0.0, 0.0)
    if bands is not None:
        fill_bands(ax, bands, frame, ends)
    elif shade:
        shade_values(ax, x, y, values, limits or ends)
    frame.set_limits(ax, (y[0], y[-1]), (x[0], x[-1]))
    inside = sorted({float(level) for level in levels if ends[0] < level < ends[1]})
    trace = getattr(field, "contours", None)
    if inside and trace is None:
        ax.contour(x, y, values, levels=inside, colors=LINE, linewidths=line_width(len(inside)))
    elif trace is not None:
        draw_levels(ax, trace(inside) if lines is None else lines, frame, label)
    if max(field.shape) <= _DOTS:
        dot_samples(ax, x, y, field.shape)
    ax.set_title(title)
    return ax


def contour_figure(
    field: Refinable,
    levels: Sequence[float],
    *,
    grid: Grid | None = None,
    lines: Sequence[ContourLine] | None = None,
    bands: Bands | None = None,
    refine: int | None = None,
    shade: bool = True,
    upward: bool = False,
    units: str = "",
    title: str = "",
) -> Figure:
    """One field with its contours, some of them labelled, and a colour bar that marks the levels.

    Parameters
    ----------
    field, levels, grid, lines, bands, refine, shade, upward, title
        As for `plot_contours`; the bar shows the colours of `bands` where they are given.
    units
        Text beside the colour bar; by default the units of `grid`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    ax = plot_contours(
        field,
        levels,
        grid=grid,
        lines=lines,
        bands=bands,
        refine=refine,
        shade=shade,
        label=True,
        upward=upward,
        title=title,
    )
    figure = ax.get_figure(root=True)
    assert figure is not None
    units = units or ("" if grid is None else grid.units)
    if bands is not None:
        band_bar(ax, units)
    elif ax.images:
        bar = figure.colorbar(ax.images[0], ax=ax, shrink=0.8, label=units)
        low, high = ax.images[0].get_clim()
        inside = [at for at in levels if low < at < high]
        bar.add_lines(inside, [LINE] * len(inside), 0.8)
    return figure


def compare_figure(
    fields: Mapping[str, Refinable],
    levels: Sequence[float],
    *,
    grid: Grid | None = None,
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
    levels, grid, refine, shade, upward
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
    frame = Frame() if grid is None else frame_of(grid)
    width, height = frame.size(*_extent(first), 1.0)
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
            grid=grid,
            refine=refine,
            shade=shade,
            upward=upward,
            limits=limits,
            title=name,
        )
        ax.set(xticks=[], yticks=[], xlabel="", ylabel="")
    if title:
        figure.suptitle(title, fontsize="medium")
    return figure


def save_figure(figure: Figure, path: str | os.PathLike[str], dpi: float = 150) -> None:
    """Store a figure as PNG; `path` is replaced when all is written."""
    if not os.fspath(path).lower().endswith(".png"):
        raise InputError(f"{path}: pictures are written as .png")
    with replacing(path) as partial:
        figure.savefig(partial, format="png", dpi=dpi, bbox_inches="tight")


def _geometry(field: Refinable) -> tuple[list[float], list[float]]:
    spacing = np.broadcast_to(np.asarray(getattr(field, "spacing", 1.0)), (2,))
    origin = np.broadcast_to(np.asarray(getattr(field, "origin", 0.0)), (2,))
    return [float(step) for step in spacing], [float(start) for start in origin]


def _extent(field: Refinable) -> tuple[float, float]:
    spacing, _ = _geometry(field)
    height, width = (h * max(n - 1, 1) for h, n in zip(spacing, field.shape, strict=True))
    return height, width


def _new_axes(field: Refinable, frame: Frame) -> Axes:
    from matplotlib.figure import Figure

    width, height = frame.size(*_extent(field), _LONGEST)
    size = (max(width, 2.0), max(height, 2.0) + 0.4)
    return Figure(figsize=size, layout="compressed").add_subplot()
