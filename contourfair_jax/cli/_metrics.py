"""The command ``metrics``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count as counting
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
import typer

from .._grid.reference import length_unit
from ._console import Reporter
from ._levels import check_level_options
from ._options import (
    Count,
    Input,
    Interval,
    Json,
    Key,
    Levels,
    Quiet,
    Single,
    examples,
    with_options,
)
from ._recipe import Fairing, Recipe
from ._steps import check_fairable, check_suffix, fair, float_width, levels_of, load

if TYPE_CHECKING:
    from .._field import BezierField
    from .._grid.grid import Grid
    from .._support.results import Progress
    from ..metrics._parts import Change


Step: TypeAlias = Callable[[], None]
# Places where parts merge or split that are listed in words.
_LISTED = 10


@with_options
def metrics(
    source: Input,
    levels: Levels = None,
    interval: Interval = None,
    count: Count = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of the table, a .png.")] = None,
    *,
    fairing: Fairing,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Measure contours, or isosurfaces, level by level: bilinear (trilinear) beside fair.

    Below the table: what leaves the range of the samples, the largest jump of the slope, integrals
    over all levels, not only those of the table, and where parts merge or split, in coordinates of
    the file.
    """
    say = Reporter(quiet, as_json)
    if plot is not None:
        check_suffix(plot, (".png",))
    recipe = Recipe.parse(fairing, single)
    check_level_options(levels, interval, count)
    grid = load(source, key, plot, recipe, say)
    check_fairable(grid)
    chosen = levels_of(grid, levels, interval, count, say)
    with float_width(single), say.working("fairing and measuring") as progress:
        measures = _measured(grid, fair(grid, recipe), chosen, progress)
    if plot is not None:
        from ..plot import save_figure
        from ..plot._metrics import metrics_figure

        with say.working(f"drawing {plot}"):
            figure = metrics_figure(chosen, measures.header, measures.tables, source.name)
            save_figure(figure, plot)
    if as_json:
        say.result(measures.facts())
    else:
        measures.print()


@dataclass(frozen=True)
class _Measures:
    """Rows of every field by level, and figures of the whole fields."""

    levels: Sequence[float]
    header: tuple[str, ...]
    tables: dict[str, list[list[float]]]
    whole: dict[str, dict[str, float]]
    integrals: dict[str, float]
    units: dict[str, str]
    changes: list[Change]

    def facts(self) -> dict[str, Any]:
        """Levels, tables, integrals and changes by name, for ``--json``."""
        table = {
            name: [dict(zip(self.header, row, strict=True)) for row in rows]
            for name, rows in self.tables.items()
        }
        return {
            "levels": self.levels,
            "table": table,
            "whole": self.whole,
            "integrals": {"units": self.units, **self.integrals},
            "changes": [vars(change) for change in self.changes],
        }

    def print(self) -> None:
        """The table, the whole fields, and the first places where parts merge or split."""
        names = "".join(f"{name:>13}" for name in self.header)
        typer.echo(f"{'level':>12} {'field':<10}{names}")
        for k, level in enumerate(self.levels):
            for name, rows in self.tables.items():
                figures = "".join(f"{x:13.5g}" for x in rows[k])
                typer.echo(f"{level:12.6g} {name:<10}{figures}")
        for name, whole in self.whole.items():
            text = ", ".join(f"{what} {figure:.4g}" for what, figure in whole.items())
            typer.echo(f"{name}: {text}")
        text = ", ".join(f"{what} {x:.4g} {self.units[what]}" for what, x in self.integrals.items())
        typer.echo(f"fair, integrated over all levels, lowest to highest: {text}")
        for change in self.changes[:_LISTED]:
            typer.echo(str(change))
        if len(self.changes) > _LISTED:
            typer.echo(f"and {len(self.changes) - _LISTED} more places; --json lists all")


def _measured(
    grid: Grid, field: BezierField, levels: Sequence[float], progress: Progress
) -> _Measures:
    from ..metrics import bilinear_field
    from ..metrics._compare import COLUMNS
    from ..metrics._parts import changes

    # Each level of both fields is a step, and of the search for changes.
    done, steps = counting(1), 3 * len(levels)

    def moved() -> None:
        progress(next(done), steps)

    plain = "bilinear" if grid.ndim == 2 else "trilinear"
    fields = {plain: bilinear_field(field), "fair": field}
    return _Measures(
        levels=levels,
        header=tuple(COLUMNS[grid.ndim]),
        tables={name: _rows(one, levels, moved) for name, one in fields.items()},
        whole={name: _whole(one) for name, one in fields.items()},
        integrals=_integrals(field),
        units=_integral_units(grid),
        changes=[
            replace(change, position=tuple(grid.world(np.array(change.position)).tolist()))
            for change in changes(fields[plain], field, levels, moved)
        ],
    )


def _rows(field: BezierField, levels: Sequence[float], moved: Step) -> list[list[float]]:
    from ..metrics._compare import figures, measured

    measures = measured(field, levels, moved=moved)
    # A level too close to the one below counts as that one.
    same = np.searchsorted([measure.level for measure in measures], levels, side="right") - 1
    rows = [figures(measure, field.ndim) for measure in measures]
    return [rows[k] for k in same.tolist()]


def _whole(field: BezierField) -> dict[str, float]:
    """Figures of the whole field."""
    from ..metrics import c1_jump, overshoot

    return {"overshoot": overshoot(field), "slope jump": c1_jump(field)}


def _integrals(field: BezierField) -> dict[str, float]:
    """Integrals over all levels of a C1 field; kinks of a bilinear field would not be in them."""
    from ..metrics import Coarea, coarea

    sums = coarea(field)
    if isinstance(sums, Coarea):
        return {
            "length": sums.length,
            "turning/2pi": sums.turning / (2 * np.pi),
            "bending": sums.bending,
        }
    return {"area": sums.area, "bending/4pi": sums.bending / (4 * np.pi)}


def _integral_units(grid: Grid) -> dict[str, str]:
    """The units of the integrals: those of the values times those of what is integrated."""
    value, length = grid.units or "value", length_unit(grid) or "length"
    if grid.ndim == 3:
        return {"area": f"{value} × {length}²", "bending/4pi": value}
    return {"length": f"{value} × {length}", "turning/2pi": value, "bending": f"{value} / {length}"}


COMMANDS = {
    metrics: examples(
        "contourfair metrics dem.tif --interval 20",
        "contourfair metrics scan.nrrd --plot metrics.png",
    ),
}
