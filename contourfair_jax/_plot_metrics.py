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
    """One panel for each measure, against the level; one line in it for each field.

    Lines lie on one another where fields are alike: each is drawn narrower than that before it.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(2.6 * len(names), 3.2), layout="compressed")
    for place, name in enumerate(names):
        ax = figure.add_subplot(1, len(names), place + 1)
        for number, (field, rows) in enumerate(tables.items()):
            width, shade = (4.0, 0.45) if number + 1 < len(tables) else (1.2, 1.0)
            figures = [row[place] for row in rows]
            ax.plot(
                levels,
                figures,
                ".-",
                linewidth=width,
                alpha=shade,
                markersize=4 + width,
                label=field,
            )
        if all(float(row[place]).is_integer() for rows in tables.values() for row in rows):
            ax.yaxis.set_major_locator(MaxNLocator(integer=True))
        ax.set_title(name, fontsize="medium")
        ax.set_xlabel("level")
        if place == 0:
            ax.legend(fontsize="small")
    figure.suptitle(title, fontsize="medium")
    return figure
