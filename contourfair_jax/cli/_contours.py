"""The command ``contours``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .._grid.periodic import closed
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
    output,
    with_options,
)
from ._recipe import JoinedFairing, Recipe
from ._steps import as_input, check_fairable, check_suffix, faired, float_width, levels_of, load

if TYPE_CHECKING:
    from .._field import BezierField
    from .._grid.grid import Grid
    from .._support.results import Progress
    from ..contours import Bands, Contours


_BANDS = (".geojson", ".json", ".gpkg", ".png")
_LINES = (".geojson", ".json", ".gpkg", ".csv", ".svg", ".png")


@with_options
def contours(
    source: Input,
    target: Annotated[
        Path, output("File for the lines: .geojson, .gpkg, .csv, .svg, or .png for a picture.")
    ],
    levels: Levels = None,
    interval: Interval = None,
    count: Count = None,
    filled: Annotated[
        bool,
        typer.Option("--filled", help="The areas between the levels: .geojson, .gpkg or .png."),
    ] = False,
    tolerance: Annotated[
        float, typer.Option("--tolerance", "-t", help="How far from the true contour, in cells.")
    ] = 0.01,
    plot: Annotated[Path | None, typer.Option(help="Picture of the lines besides, a .png.")] = None,
    *,
    fairing: JoinedFairing,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Draw or export fair contours: they lie on the fair field, are complete, and never cross.

    Give one of --levels, --interval and --count; by default there are 10 levels.  Samples that lie
    on a level count as below it; for whole numbers, levels halfway between them have no plateaus.
    Coordinates are those of the file.
    """
    from .._level_sets import check_tolerance
    from ..contours import Bands
    from ..plot import contour_figure, save_figure

    say = Reporter(quiet, as_json)
    check_suffix(target, _BANDS if filled else _LINES)
    if plot is not None:
        check_suffix(plot, (".png",))
    recipe = Recipe.parse(fairing, single)
    check_level_options(levels, interval, count)
    with as_input():
        check_tolerance(tolerance)
    grid = load(source, key, target, recipe, say)
    check_fairable(grid, ndim=(2,))
    chosen = levels_of(grid, levels, interval, count, say)
    field = faired(grid, recipe, say)
    with float_width(single):
        with say.working("tracing contours") as progress:
            traced = _traced(field, chosen, tolerance, filled, progress)
            shown = closed(grid, recipe.axes(grid))
            notes = traced.notes + _store(target, traced, shown)
        picture = target if target.suffix.lower() == ".png" else plot
        if picture is not None:
            with say.working(f"drawing {picture}"):
                draw = partial(contour_figure, field, chosen, grid=shown, title=source.name)
                figure = draw(bands=traced) if isinstance(traced, Bands) else draw(lines=traced)
                save_figure(figure, picture)
    for note in notes:
        say.note(note)
    text, facts = _described(traced)
    say.done(target, text, **facts)


def _traced(
    field: BezierField,
    levels: Sequence[float],
    tolerance: float,
    filled: bool,
    progress: Progress,
) -> Contours | Bands:
    """The lines, or if `filled` the bands below, between and above the levels."""
    from .. import contours as tracing

    with as_input():
        if filled:
            ends = [-float("inf"), *levels, float("inf")]
            return tracing.filled(field, ends, tolerance, progress=progress)
        return tracing.contours(field, levels, tolerance, progress=progress)


def _store(target: Path, traced: Contours | Bands, grid: Grid) -> tuple[str, ...]:
    """Store lines or bands, unless a picture is all that is asked for; notes on the file."""
    from ..contours import Bands
    from ..export import write_filled, write_lines, write_svg
    from ..plot import level_colors

    suffix = target.suffix.lower()
    if suffix == ".png":
        return ()
    if isinstance(traced, Bands):
        return write_filled(target, traced, grid)
    if suffix == ".svg":
        drawn = len({line.level for line in traced})
        return write_svg(target, traced, grid, level_colors(drawn))
    return write_lines(target, traced, grid)


def _described(traced: Contours | Bands) -> tuple[str, dict[str, Any]]:
    """A summary of lines or bands, in words and as numbers by name."""
    from ..contours import Bands

    if isinstance(traced, Bands):
        facts = {"levels": traced.levels[1:-1], "bands": len(traced), "unproved": traced.unproved}
        return f"{len(traced)} bands", facts
    facts = {
        "levels": traced.levels,
        "lines": len(traced),
        "vertices": sum(len(line.points) for line in traced),
        "unproved": traced.unproved,
    }
    return f"{len(traced)} contours at {len(traced.levels)} levels", facts


COMMANDS = {
    contours: examples(
        "contourfair contours dem.tif --interval 20 -o lines.geojson",
        "contourfair contours dem.npz --levels 250,300,350 -o lines.svg",
        "contourfair contours photo.png --count 8 -o picture.png",
        "contourfair contours dem.tif --interval 100 --filled -o bands.gpkg --plot bands.png",
    ),
}
