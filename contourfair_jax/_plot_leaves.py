"""Pictures of quadtrees and octrees with Matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ._plot_frame import frame_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .adaptive import AdaptiveField
    from .io import Grid


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
