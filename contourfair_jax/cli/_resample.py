"""The command ``resample``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from .._grid.grid import Grid
from .._grid.resample import alike, coarsening, spaced
from .._resample import resampled
from .._support.errors import InputError
from .._support.memory import check_memory
from ..io import check_writable, read, write
from ._console import Reporter
from ._options import (
    WRITABLE,
    Input,
    Json,
    Key,
    Quiet,
    Single,
    examples,
    output,
    with_options,
)
from ._per_axis import parse_spacing
from ._recipe import JoinedFairing, Recipe
from ._steps import as_between, check_fairable, faired, load, result_dtype, warn_narrowing
from ._words import Output, by, describe_count

# Samples that are farther apart than this many of the input leave some out.
_COARSE = 1.5


@with_options
def resample(
    source: Input,
    target: Annotated[Path, output(f"File for the samples: {WRITABLE}.")],
    like: Annotated[
        Path | None,
        typer.Option("--like", help="File whose samples lie where those of OUT are to lie."),
    ] = None,
    like_key: Annotated[
        str | None, typer.Option(help="Which array of that file; as --key.")
    ] = None,
    spacing: Annotated[
        str | None,
        typer.Option(
            "--spacing",
            help="Distance between samples, in the coordinates of the file; 2,1,1 for every axis "
            "in order, z=1 for one by its name.",
        ),
    ] = None,
    *,
    fairing: JoinedFairing,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Take samples of the fair field on the grid of another file, or with another spacing.

    With [bold]--spacing[/] the first sample stays where it is.  Samples that lie outside those of
    the file are missing.  A coarser grid gets values of the field at its samples, not means.
    """
    say = Reporter(quiet, as_json)
    recipe = Recipe.parse(fairing, single)
    if (like is None) == (spacing is None):
        raise InputError("give either --like or --spacing, to say where samples are to lie")
    steps = None if spacing is None else parse_spacing(spacing)
    grid = load(source, key, target, recipe, say)
    check_fairable(grid)
    if steps is not None:
        outline = spaced(grid, steps.of(grid, grid.steps))
    else:
        assert like is not None
        outline = alike(grid, read(like, like_key))
    size = by(outline.shape)
    check_memory(24 * math.prod(outline.shape), f"resampling to {size}")
    dtype = result_dtype(grid, recipe.single)
    # The values to come are not known, but those of the file are like them.
    expected = outline.with_values(np.resize(grid.values, outline.shape))
    check_writable(target, as_between(expected, dtype))
    warn_narrowing(grid, recipe.single, say)
    field = faired(grid, recipe, say)
    with say.working(f"resampling to {size}"):
        values, outside = resampled(field, grid, outline, recipe.axes(grid))
    for note in _notes(grid, outline, outside):
        say.note(note)
    samples = outline.with_values(values.astype(dtype, copy=False))
    with say.working(f"writing {target}"):
        for note in write(target, samples):
            say.note(note)
    done = Output(samples.shape, dtype, samples.missing_count)
    say.done(target, str(done), shape=done.shape, type=done.dtype.name, missing=done.missing)


def _notes(grid: Grid, outline: Grid, outside: int) -> Iterator[str]:
    """Notes on the new grid, `outside` samples of which lie outside the file.

    Raises
    ------
    InputError
        All of them lie outside.
    """
    size = outline.values.size
    if outside == size:
        raise InputError("no sample of the new grid lies within those of the file")
    if outside:
        yield f"outside the file, and so missing: {describe_count(outside, size)}"
    if coarsening(grid, outline) > _COARSE:
        yield (
            "the new grid is coarser: it has values of the field at its samples, not means around "
            "them"
        )


COMMANDS = {
    resample: examples(
        "contourfair resample dem.tif --like satellite.tif -o dem_there.tif",
        "contourfair resample dem.tif --spacing 10 -o dem_10m.tif",
        "contourfair resample head.nii.gz --spacing 1 -o head_1mm.nii.gz",
    ),
}
