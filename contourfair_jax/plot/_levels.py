"""Contour lines with labels, and bands with their colour bar, on Matplotlib axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ._frame import Frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection, PathCollection

    from ..contours import Band, Bands, ContourLine


def draw_lines(
    lines: Sequence[ContourLine], ax: Axes, color: str | None = None, width: float = 0.8
) -> LineCollection:
    """Add lines to Matplotlib axes, axis 1 to the right; coloured by level unless told."""
    from matplotlib.collections import LineCollection

    drawn = LineCollection([line.points[:, ::-1] for line in lines], linewidths=width)
    if color is None:
        drawn.set_array(np.array([line.level for line in lines]))
    else:
        drawn.set_color(color)
    ax.add_collection(drawn)
    ax.autoscale_view()
    return drawn


def draw_filled(bands: Sequence[Band], ax: Axes) -> PathCollection:
    """Add bands to Matplotlib axes, axis 1 to the right, coloured from low to high."""
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Outline

    outlines = [
        Outline.make_compound_path(
            *(Outline(ring[:, ::-1], closed=True) for polygon in band.polygons for ring in polygon)
        )
        for band in bands
    ]
    drawn = PathCollection(outlines, linewidths=0)
    drawn.set_array(np.arange(len(bands), dtype=float))
    ax.add_collection(drawn)
    ax.autoscale_view()
    return drawn


LINE = "#1a1a1a"
SHADES = "viridis"
# How much of the colours is white, behind black lines.
_WHITE = 0.4
# At most so many levels are labelled, on lines of so many inches and labels so far apart.
_LABELLED, _LONG, _APART = 8, 1.6, 1.0
# Levels that the bar of the bands names.
_TICKS = 20


def level_colors(count: int) -> list[str]:
    """`count` colours from dark to light, as ``#rrggbb``."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    # The lightest fifth of the map cannot be seen on white.
    return [to_hex(colormaps[SHADES](at)) for at in np.linspace(0.0, 0.8, count)]


def line_width(count: int) -> float:
    """The width of lines of so many levels, in points."""
    return 1.0 if count <= 12 else 0.7 if count <= 25 else 0.45


def draw_levels(ax: Axes, lines: Sequence[ContourLine], frame: Frame, label: bool = False) -> None:
    """Lines that are traced; with `label`, long ones of some levels have a gap with the level.

    The limits of the axes are to be set before.
    """
    from matplotlib.contour import ContourSet

    levels = sorted({line.level for line in lines})
    if not levels:
        return
    number = {level: k for k, level in enumerate(levels)}
    pieces: list[list[np.ndarray]] = [[] for _ in levels]
    for line in lines:
        pieces[number[line.level]].append(frame.place(line.points)[:, ::-1])
    drawn = ContourSet(ax, levels, pieces, colors=LINE, linewidths=line_width(len(levels)))
    places = _label_places(ax, pieces) if label else []
    if places:
        ax.clabel(drawn, fmt="%g", fontsize=7, inline_spacing=3, manual=places)


def _label_places(ax: Axes, pieces: Sequence[Sequence[np.ndarray]]) -> list[tuple[float, float]]:
    """Places of labels: on the longest line of some levels, halfway, where none is near."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    ax.apply_aspect()
    to_inches = ax.transData + figure.dpi_scale_trans.inverted()
    chosen: list[np.ndarray] = []
    for lines in pieces[:: -(-len(pieces) // _LABELLED)]:
        drawn = [to_inches.transform(line) for line in lines]
        along = [np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum() for line in drawn]
        longest = int(np.argmax([lengths[-1] for lengths in along]))
        middle = drawn[longest][np.searchsorted(along[longest], along[longest][-1] / 2)]
        apart = all(np.linalg.norm(middle - place) > _APART for place in chosen)
        if along[longest][-1] > _LONG and apart:
            chosen.append(middle)
    back = to_inches.inverted()
    return [tuple(back.transform(place).tolist()) for place in chosen]


def fill_bands(ax: Axes, bands: Bands, frame: Frame, ends: tuple[float, float]) -> None:
    """The bands that hold values, each in one colour; `ends` are the extreme values."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm, ListedColormap

    kept = [band for band in bands if band.polygons]
    if not kept:
        return
    placed = [
        replace(band, polygons=tuple(tuple(map(frame.place, rings)) for rings in band.polygons))
        for band in kept
    ]
    # Extreme values are those of the samples drawn, which may miss what is in an outer band.
    least = 1e-3 * (ends[1] - ends[0])
    limits = np.array([kept[0].lower, *(band.upper for band in kept)])
    limits[0] = max(limits[0], min(ends[0], limits[1] - least))
    limits[-1] = min(limits[-1], max(ends[1], limits[-2] + least))
    colors = colormaps[SHADES](np.linspace(0.0, 1.0, len(kept)))
    drawn = draw_filled(placed, ax)
    drawn.set_cmap(ListedColormap(_WHITE + (1 - _WHITE) * colors))
    drawn.set_norm(BoundaryNorm(limits, len(kept)))
    drawn.set_array(0.5 * (limits[:-1] + limits[1:]))


def band_bar(ax: Axes, units: str) -> None:
    """A bar of the colours of the bands that were drawn, with their levels between them."""
    from matplotlib.colors import BoundaryNorm

    figure = ax.get_figure(root=True)
    assert figure is not None
    for drawn in ax.collections:
        if isinstance(drawn.norm, BoundaryNorm):
            ticks = drawn.norm.boundaries[:: -(-len(drawn.norm.boundaries) // _TICKS)]
            figure.colorbar(
                drawn, ax=ax, shrink=0.8, label=units, ticks=ticks, format="%.5g", drawedges=True
            )
