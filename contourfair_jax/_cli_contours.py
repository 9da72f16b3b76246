"""The command ``contours``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ._console import Reporter
from ._options import (
    Count,
    Fill,
    Input,
    Interval,
    Iterations,
    Json,
    Key,
    Levels,
    Method,
    Periodic,
    Quiet,
    Single,
    Weight,
    examples,
    output,
)
from ._periodic import closed
from ._run import Settings, check_fairable, fair, periodic_axes, precision
from ._steps import check_suffix, levels_of, load
from .io import InputError, write_svg

if TYPE_CHECKING:
    from ._field import BezierField
    from ._tracing import Progress
    from .io import Grid


_BANDS = (".geojson", ".json", ".gpkg")
_LINES = (*_BANDS, ".csv", ".svg", ".png")


def contours(
    source: Input,
    target: Annotated[
        Path, output("File for the lines: .geojson, .gpkg, .csv, .svg, or .png for a picture.")
    ],
    levels: Levels = None,
    interval: Interval = None,
    count: Count = None,
    filled: Annotated[
        bool, typer.Option("--filled", help="The areas between the levels: .geojson or .gpkg.")
    ] = False,
    tolerance: Annotated[
        float, typer.Option("--tolerance", "-t", help="How far from the true contour, in cells.")
    ] = 0.01,
    plot: Annotated[Path | None, typer.Option(help="Picture of the lines besides, a .png.")] = None,
    method: Method = "local",
    iterations: Iterations = None,
    thin_plate_weight: Weight = None,
    fill: Fill = False,
    periodic: Periodic = None,
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
    from .plot import contour_figure, save_figure

    say = Reporter(quiet, as_json)
    check_suffix(
        target, (".geojson", ".json", ".gpkg", *(() if filled else (".csv", ".svg", ".png")))
    )
    if plot is not None:
        check_suffix(plot, (".png",))
    grid = load(source, key, target, say, fill)
    check_fairable(grid, ndim=(2,))
    around = periodic_axes(grid, periodic)
    chosen = levels_of(grid, levels, interval, count, say)
    with precision(single):
        with say.working(f"fairing {' x '.join(map(str, grid.shape))} samples"):
            field = fair(grid, method, Settings(iterations, thin_plate_weight), fill, around)
        with say.working("tracing contours") as progress:
            store = _store_bands if filled else _store_lines
            shown = closed(grid, around)
            text, facts, notes = store(target, field, chosen, tolerance, shown, progress)
        picture = target if target.suffix.lower() == ".png" else plot
        if picture is not None:
            with say.working(f"drawing {picture}"):
                up, title = grid.rows_ascend, source.name
                figure = contour_figure(field, chosen, upward=up, units=grid.units, title=title)
                save_figure(figure, picture)
    for note in notes:
        say.note(note)
    say.done(target, text, **facts)


def _store_lines(
    target: Path,
    field: BezierField,
    levels: Sequence[float],
    tolerance: float,
    grid: Grid,
    progress: Progress,
) -> tuple[str, dict[str, Any], tuple[str, ...]]:
    """Store the lines; what there is in words and in numbers, and notes."""
    from .contours import contours
    from .export import write_lines
    from .plot import level_colors

    try:
        lines = contours(field, levels, tolerance, progress=progress)
    except ValueError as error:
        raise InputError(str(error)) from error
    notes = lines.notes
    if target.suffix.lower() == ".svg":
        drawn = len({line.level for line in lines})
        notes += write_svg(target, lines, grid, level_colors(drawn))
    elif target.suffix.lower() != ".png":
        notes += write_lines(target, lines, grid)
    vertices = sum(len(line.points) for line in lines)
    facts = {
        "levels": lines.levels,
        "lines": len(lines),
        "vertices": vertices,
        "unproved": lines.unproved,
    }
    return f"{len(lines)} contours at {len(lines.levels)} levels", facts, notes


def _store_bands(
    target: Path,
    field: BezierField,
    levels: Sequence[float],
    tolerance: float,
    grid: Grid,
    progress: Progress,
) -> tuple[str, dict[str, Any], tuple[str, ...]]:
    """Store what is below, between and above the levels; as for lines."""
    from .contours import filled
    from .export import write_bands

    ends = [-float("inf"), *levels, float("inf")]
    try:
        bands = filled(field, ends, tolerance, progress=progress)
    except ValueError as error:
        raise InputError(str(error)) from error
    notes = bands.notes + write_bands(target, bands, grid)
    facts = {"levels": bands.levels[1:-1], "bands": len(bands), "unproved": bands.unproved}
    return f"{len(bands)} bands", facts, notes


COMMANDS = {
    contours: examples(
        "contourfair contours dem.tif --interval 20 -o lines.geojson",
        "contourfair contours dem.npz --levels 250,300,350 -o lines.svg",
        "contourfair contours photo.png --count 8 -o picture.png",
        "contourfair contours dem.tif --interval 100 --filled -o bands.gpkg --plot bands.png",
    ),
}
