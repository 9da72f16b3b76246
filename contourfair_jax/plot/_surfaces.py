"""Pictures of isosurfaces, quadtrees and octrees with Matplotlib."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .._grid.affine import spacing_of
from ._frame import frame_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.axes3d import Axes3D

    from .._grid.grid import Grid
    from ..adaptive import AdaptiveField
    from ..isosurface import Isosurface


_COLOR = (0.93, 0.86, 0.74)


def draw_surface(
    mesh: Isosurface,
    ax: Axes3D,
    elevation: float = 20.0,
    azimuth: float = -60.0,
    color: tuple[float, float, float] = _COLOR,
) -> None:
    """Add a surface to 3-D axes, shaded by its normals, lit from the eye; axis 0 is up.

    The limits of the axes are set to those of the surface.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    up, around = np.radians(elevation), np.radians(azimuth)
    eye = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    light = eye + 0.5 * np.array([0.0, 0.0, 1.0])
    light /= np.linalg.norm(light)
    facing = mesh.normals[:, ::-1][mesh.triangles].mean(1)
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-12)
    # Both sides are lit: which one is seen depends on where the larger values are.
    shade = 0.18 + 0.82 * np.abs(facing @ light)
    places = mesh.vertices[:, ::-1]
    drawn = Poly3DCollection(places[mesh.triangles], linewidths=0, antialiased=False)
    drawn.set_facecolor(np.clip(shade[:, None] * np.array(color), 0, 1))
    ax.add_collection3d(drawn)
    if len(places):
        low, high = places.min(0), places.max(0)
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        ax.set_box_aspect(np.maximum(high - low, 1e-12))
    ax.view_init(elevation, azimuth)
    ax.set_axis_off()


def surface_figure(mesh: Isosurface, title: str = "", grid: Grid | None = None) -> Figure:
    """A picture of one isosurface, with its axes as in the file that the `grid` was read from.

    Axes that descend, or are turned, are drawn as they lie in the world; lengths are the field's.
    """
    from matplotlib.figure import Figure

    if grid is not None and grid.affine is not None:
        turn = grid.affine[:-1, :-1] / spacing_of(grid.affine)
        mesh = replace(mesh, vertices=mesh.vertices @ turn.T, normals=mesh.normals @ turn.T)

    figure = Figure(figsize=(7, 7), layout="constrained")
    ax = figure.add_subplot(projection="3d")
    draw_surface(mesh, ax)  # pyright: ignore[reportArgumentType]
    ax.set_title(title)
    return figure


def leaf_figure(field: AdaptiveField, grid: Grid, title: str = "") -> Figure:
    """The leaves, coloured by their mean value; of a volume, those in the middle of axis 0.

    Shown are the coordinates of the `grid` whose samples the field was made from.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    low, high = (field.vertices[field.leaves[:, k]] for k in (0, -1))
    values = field.values[field.leaves].mean(1)
    if field.vertices.shape[1] == 3:
        middle = 0.5 * (field.vertices[:, 0].min() + field.vertices[:, 0].max())
        cut = (low[:, 0] <= middle) & (middle < high[:, 0])
        low, high, values = low[cut, 1:], high[cut, 1:], values[cut]
    frame = frame_of(grid)
    (bottom, left), (top, right) = frame.place(low).T, frame.place(high).T
    x, y = np.stack([left, right, right, left]), np.stack([bottom, bottom, top, top])
    height, width = (high.max(0) - low.min(0)).tolist()
    figure = Figure(figsize=frame.size(height, width, 8.0), layout="compressed")
    ax = figure.add_subplot()
    drawn = PolyCollection(list(np.stack([x.T, y.T], axis=-1)), linewidths=0.25)
    drawn.set_array(values)
    drawn.set_edgecolor("#1a1a1a")
    ax.add_collection(drawn)
    frame.set_limits(ax, (y.min(), y.max()), (x.min(), x.max()))
    figure.colorbar(drawn, ax=ax, shrink=0.8, label=grid.units)
    ax.set_title(title)
    return figure
