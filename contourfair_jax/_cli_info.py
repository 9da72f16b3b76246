"""The command ``info``."""

from __future__ import annotations

import typer

from ._console import Reporter
from ._describe import facts, information
from ._options import (
    Input,
    Json,
    Key,
    Quiet,
    examples,
)
from .io import read


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
