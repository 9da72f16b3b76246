"""The command ``info``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import typer

from .._grid.affine import is_turned
from .._grid.grid import Grid
from .._grid.reference import crs_title
from ..io import read
from ._console import Reporter
from ._options import Input, Json, Key, Quiet, examples
from ._words import by, describe_missing


def information(grid: Grid) -> Iterator[tuple[str, str]]:
    """Names and texts, the lines that ``contourfair info`` shows."""
    yield "shape", f"{by(grid.shape)} ({', '.join(grid.axes)})"
    yield "type", grid.source_dtype.name + ("" if grid.source_dtype.isnative else ", byte-swapped")
    present = grid.values if grid.missing is None else grid.values[~grid.missing]
    units = f" {grid.units}" if grid.units else ""
    yield (
        "range",
        f"{present.min():g} to {present.max():g}{units}" if present.size else "no samples",
    )
    yield "spacing", " x ".join(f"{step:.9g}" for step in grid.spacing)
    yield from _place(grid)
    yield "nodata", "none" if grid.nodata is None else f"{grid.nodata:g}"
    yield "missing", describe_missing(grid)
    for name in ("title", "description"):
        if grid.metadata.get(name):
            yield name, grid.metadata[name]


def facts(grid: Grid) -> dict[str, Any]:
    """The same by name, with all digits, for ``contourfair info --json``."""
    present = grid.values if grid.missing is None else grid.values[~grid.missing]
    return {
        "shape": grid.shape,
        "axes": grid.axes,
        "type": grid.source_dtype.name,
        "units": grid.units,
        "range": [present.min().item(), present.max().item()] if present.size else None,
        "spacing": grid.spacing,
        "affine": None if grid.affine is None else grid.affine.tolist(),
        "crs": grid.crs,
        "nodata": None if grid.nodata is None else float(grid.nodata),
        "missing": grid.missing_count,
        "metadata": dict(grid.metadata),
    }


def _place(grid: Grid) -> Iterator[tuple[str, str]]:
    if grid.affine is not None and is_turned(grid.affine):
        yield "first", _coordinates(grid, grid.affine[:-1, -1])
        for name, step in zip(grid.axes, grid.affine[:-1, :-1].T, strict=True):
            yield f"step {name}", f"{_coordinates(grid, step)} (turned)"
    elif grid.affine is not None:
        ends = [np.zeros(grid.ndim), (np.array(grid.shape) - 1) * np.array(grid.spacing)]
        first, last = (grid.world(end + np.array(grid.origin)) for end in ends)
        for name, begin, end in zip(grid.axes, first, last, strict=True):
            yield name, f"{begin:.10g} to {end:.10g} (first to last sample)"
    yield "crs", "none" if grid.crs is None else crs_title(grid.crs)


def _coordinates(grid: Grid, position: np.ndarray) -> str:
    return ", ".join(f"{name} {x:.10g}" for name, x in zip(grid.axes, position, strict=True))


def info(source: Input, key: Key = None, quiet: Quiet = False, as_json: Json = False) -> None:
    """Show what a file holds: size, type, range, spacing, place, missing samples."""
    grid = read(source, key)
    say = Reporter(quiet, as_json)
    for note in grid.notes:
        say.note(note)
    if as_json:
        say.result(facts(grid))
        return
    for name, text in information(grid):
        typer.echo(f"{name:<12} {text}")


COMMANDS = {
    info: examples("contourfair info dem.tif"),
}
