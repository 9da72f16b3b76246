"""The command ``upsample``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ._console import Reporter
from ._factors import Factor
from ._options import (
    WRITABLE,
    Bands,
    Fill,
    Input,
    Iterations,
    Json,
    Key,
    Memory,
    Method,
    Periodic,
    Quiet,
    Resume,
    Sigma,
    Single,
    Weight,
    Workers,
    examples,
    output,
)
from ._recipe import Recipe
from ._upsample import upsample_whole
from ._upsample_tiles import Division, is_tiled, upsample_in_tiles
from .io import InputError


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
    method: Method = "local",
    iterations: Iterations = None,
    thin_plate_weight: Weight = None,
    sigma: Sigma = None,
    fill: Fill = False,
    periodic: Periodic = "",
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
    recipe = Recipe.parse(method, iterations, thin_plate_weight, sigma, fill, single, periodic)
    tiling = Division(workers, resume, memory)
    if bands and key is not None:
        raise InputError(f"--all-bands takes every band, so --key {key} has nothing to choose")
    if is_tiled(source, target, recipe, tiling) and not bands:
        made = upsample_in_tiles(source, target, key, finer, recipe, tiling, say)
    else:
        made = upsample_whole(source, target, key, finer, recipe, say, bands)
    say.done(target, str(made), shape=made.shape, type=made.dtype.name, missing=made.missing)


COMMANDS = {
    upsample: examples(
        "contourfair upsample dem.tif -o dem_4x.tif",
        "contourfair upsample image.tif -o image_2x.tif --all-bands --factor 2",
        "contourfair upsample scan.npz --key data -o scan_2x.npz --factor 2",
        "contourfair upsample head.nii.gz -o head_even.nii.gz --factor z=4",
        "contourfair upsample big.zarr -o big_4x.zarr --workers 2 --resume",
    ),
}
