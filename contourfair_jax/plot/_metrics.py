"""A picture of metrics against the level."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Where the largest figure is this many times a usual one, the others would all look like zero: as
# where a speck of a contour bends without end.
WIDE = 100


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
        shown = [float(row[place]) for rows in tables.values() for row in rows]
        if all(figure.is_integer() for figure in shown):
            ax.yaxis.set_major_locator(MaxNLocator(integer=True))
        elif max(shown) > WIDE * statistics.median(shown) > 0:
            ax.set_yscale("log", nonpositive="mask")
        ax.set_title(name, fontsize="medium")
        ax.set_xlabel("level")
        if place == 0:
            ax.legend(fontsize="small")
    figure.suptitle(title, fontsize="medium")
    return figure
