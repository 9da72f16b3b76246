"""A picture of metrics against the level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def metrics_figure(
    levels: Sequence[float],
    names: Sequence[str],
    tables: Mapping[str, Sequence[Sequence[float]]],
    title: str = "",
) -> Figure:
    """One panel for each measure, against the level; one line in it for each field."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.6 * len(names), 3.2), layout="compressed")
    for place, name in enumerate(names):
        ax = figure.add_subplot(1, len(names), place + 1)
        for field, rows in tables.items():
            ax.plot(levels, [row[place] for row in rows], ".-", linewidth=1, label=field)
        ax.set_title(name, fontsize="medium")
        ax.set_xlabel("level")
        if place == 0:
            ax.legend(fontsize="small")
    figure.suptitle(title, fontsize="medium")
    return figure
