"""The command ``upsample``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from .._grid.grid import Grid
from .._support.errors import InputError
from ..io import check_writable, write_bands
from ._console import Reporter
from ._options import (
    WRITABLE,
    Bands,
    Input,
    Json,
    Key,
    Memory,
    Quiet,
    Resume,
    Single,
    Workers,
    examples,
    output,
    with_options,
)
from ._per_axis import Factor
from ._recipe import JoinedFairing, Recipe
from ._steps import (
    as_between,
    check_fairable,
    fair,
    float_width,
    load,
    load_bands,
    result_dtype,
    warn_narrowing,
)
from ._upsample_tiles import Division, is_tiled, upsample_in_tiles
from ._words import Output, by


def upsample_whole(
    source: Path,
    target: Path,
    key: str | None,
    factor: Factor,
    recipe: Recipe,
    say: Reporter,
    bands: bool = False,
) -> Output:
    """Read, refine and write; with `bands`, all of the file, each by itself.

    Raises
    ------
    InputError
        The file cannot be read, faired or written.
    """
    if bands:
        grids = load_bands(source, target, recipe, say)
    else:
        grids = (load(source, key, target, recipe, say),)
    factors = factor.of(grids[0])
    for grid in grids:
        check_fairable(grid, factors)
    dtype = np.result_type(*(result_dtype(grid, recipe.single) for grid in grids))
    check_writable(target, *(as_between(grid, dtype, max(factors) > 1) for grid in grids))
    warn_narrowing(grids[0], recipe.single, say)
    around = recipe.axes(grids[0])
    shape, count = grids[0].shape, len(grids)
    several: tuple[int, ...] = (count,) if count > 1 else ()
    size = by(several + shape)
    results: list[Grid] = []
    with float_width(recipe.single), say.working(f"fairing {size} samples") as move:
        for grid in grids:
            if several:
                move(len(results), len(grids))
            finer = np.asarray(fair(grid, recipe).refine(factors))
            for axis in around:  # the first sample of the next turn
                finer = np.delete(finer, -1, axis)
            results.append(grid.refined(finer.astype(dtype, copy=False), factors, around))
    with say.working(f"writing {target}"):
        notes = write_bands(target, results)
    for note in notes:
        say.note(note)
    return Output(several + results[0].shape, dtype, sum(grid.missing_count for grid in results))


@with_options
def upsample(
    source: Input,
    target: Annotated[Path, output(f"File for the finer samples: {WRITABLE}.")],
    factor: Annotated[
        str,
        typer.Option(
            "--factor",
            "-f",
            help="How many times finer; 1,1,4 for every axis in order, z=4 for one by its name.",
        ),
    ] = "4",
    *,
    fairing: JoinedFairing,
    key: Key = None,
    bands: Bands = False,
    single: Single = False,
    workers: Workers = 1,
    resume: Resume = False,
    memory: Memory = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Refine samples on the fair field: every sample is kept, and positions stay right.

    The result has [bold]factor * (n - 1) + 1[/] samples per axis, [bold]factor * n[/] where it is
    periodic.  Missing samples stay missing.

    Zarr folders, and large .npy files, are written part by part: they need not fit in memory.
    """
    say = Reporter(quiet, as_json)
    finer = Factor.parse(factor)
    recipe = Recipe.parse(fairing, single)
    tiling = Division(workers, resume, memory)
    if bands and key is not None:
        raise InputError(f"--all-bands takes every band, so --key {key} has nothing to choose")
    if is_tiled(source, target, recipe, tiling) and not bands:
        written = upsample_in_tiles(source, target, key, finer, recipe, tiling, say)
    else:
        written = upsample_whole(source, target, key, finer, recipe, say, bands)
    say.done(
        target, str(written), shape=written.shape, type=written.dtype.name, missing=written.missing
    )


COMMANDS = {
    upsample: examples(
        "contourfair upsample dem.tif -o dem_4x.tif",
        "contourfair upsample image.tif -o image_2x.tif --all-bands --factor 2",
        "contourfair upsample scan.npz --key data -o scan_2x.npz --factor 2",
        "contourfair upsample head.nii.gz -o head_even.nii.gz --factor z=4",
        "contourfair upsample big.zarr -o big_4x.zarr --workers 2 --resume",
    ),
}
