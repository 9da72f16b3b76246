"""Pictures of quadtrees and octrees with Matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .adaptive import AdaptiveField


def leaf_figure(field: AdaptiveField, title: str = "", upward: bool = False) -> Figure:
    """The leaves, coloured by their mean value; of a volume, those in the middle of axis 0."""
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 8), layout="compressed")
    ax = figure.add_subplot()
    low, high = (field.vertices[field.leaves[:, k]] for k in (0, -1))
    values = field.values[field.leaves].mean(1)
    if field.vertices.shape[1] == 3:
        middle = 0.5 * (field.vertices[:, 0].min() + field.vertices[:, 0].max())
        cut = (low[:, 0] <= middle) & (middle < high[:, 0])
        low, high, values = low[cut, 1:], high[cut, 1:], values[cut]
    (bottom, left), (top, right) = low.T, high.T
    x, y = np.stack([left, right, right, left]), np.stack([bottom, bottom, top, top])
    drawn = PolyCollection(list(np.stack([x.T, y.T], axis=-1)), linewidths=0.25)
    drawn.set_array(values)
    drawn.set_edgecolor("#1a1a1a")
    ax.add_collection(drawn)
    ax.autoscale_view()
    ax.margins(0)
    if not upward:
        ax.invert_yaxis()
    ax.set_aspect("equal")
    ax.set_title(title)
    return figure
