"""``contourfair upsample`` in tiles, so that only parts of the samples are in memory."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._grid.grid import Grid
from .._grid.reference import degrees_note
from .._support.errors import InputError
from ..io._outputs import check_apart
from ._console import Reporter
from ._per_axis import Factor
from ._recipe import Recipe
from ._steps import check_axes, load, result_dtype, warn_narrowing
from ._words import Output, by, describe_count, missing_note

if TYPE_CHECKING:
    from ..tiles._run import Job
    from ..tiles._source import Source
    from ..tiles._state import Unfinished


# What is written part by part, and the bytes of a file from which on it is by itself.
_PARTS = (".npy", ".zarr")
_LARGE = 2**26


@dataclass(frozen=True)
class Division:
    """The division of the work: the options ``--workers``, ``--resume`` and ``--memory``."""

    workers: int = 1
    resume: bool = False
    memory: float | None = None

    @property
    def asked(self) -> bool:
        """Whether any of them was given."""
        return self != Division()


def is_tiled(source: Path, target: Path, recipe: Recipe, division: Division) -> bool:
    """Whether to work in tiles: into Zarr folders, into ``.npy`` if large, or where it is asked.

    Tuning and noise need all samples in memory, so that tiles have to be asked for with them.

    Raises
    ------
    InputError
        Work that is to be divided, for a format that is written as a whole.
    """
    kind = target.suffix.lower()
    if division.asked and kind not in _PARTS:
        raise InputError(
            f"{target}: --workers, --resume and --memory are for outputs in .zarr and .npy"
        )
    large = source.suffix.lower() in _PARTS and _size(source) > _LARGE
    large = large or kind == ".zarr"
    whole = recipe.method == "tune" or "sigma" in recipe.settings
    return kind in _PARTS and (division.asked or (large and not whole))


def _size(source: Path) -> int:
    """Bytes of a file; of a folder, more than any limit."""
    if source.is_dir():
        return 2**62
    return source.stat().st_size if source.exists() else 0


def upsample_in_tiles(
    source: Path,
    target: Path,
    key: str | None,
    factor: Factor,
    recipe: Recipe,
    division: Division,
    say: Reporter,
) -> Output:
    """Refine in tiles.

    Raises
    ------
    InputError
        As `contourfair_jax.tiles.refine_to` and the readers.
    """
    from ..tiles._job import run_job
    from ..tiles._source import Held
    from ..tiles._state import Unfinished

    if recipe.periodic:
        raise InputError(
            f"{target}: --periodic is for outputs that are written as a whole; from Python, "
            "xarray's .fair.upsample does it for Zarr"
        )
    if division.workers < 1:
        raise InputError(f"--workers must be 1 or more, got {division.workers}")
    grid, opened = _opened(source, target, key, recipe, say)
    check_axes(grid)
    factors = factor.of(grid)
    warn_narrowing(grid, recipe.single, say)
    job, state = _planned(grid, opened, factors, recipe), Unfinished(target)
    shape, stored = job.tiling.fine_shape, job.stored
    earlier = _whole_output(source, state, shape, stored) if division.resume else None
    if earlier is not None:
        say.note(
            "nothing to resume: the output is there, whole, from an earlier run, and is left as it "
            "is; without --resume it is computed anew"
        )
        return earlier
    if division.resume and not state.started:
        say.note("nothing to resume: there is no unfinished run, so all is computed")
    memory = None if division.memory is None else int(division.memory * 2**30)
    count = math.prod(grid.shape)
    with (
        _warnings_as_notes(say),
        say.counting(f"fairing {by(grid.shape)}", "samples", count) as progress,
    ):
        outcome = run_job(job, grid, state, division.workers, division.resume, memory, progress)
    if outcome.gaps and not isinstance(opened, Held):  # else the reader has told
        say.note(missing_note(describe_count(outcome.gaps, count), recipe.fill))
    if target.suffix.lower() == ".npy" and grid.affine is not None:
        say.note(".npy keeps the samples only: spacing and coordinates are left out")
    return Output(outcome.shape, stored, outcome.missing)


def _planned(grid: Grid, source: Source, factors: tuple[int, ...], recipe: Recipe) -> Job:
    """The job; what cannot be cut into tiles is bad input here."""
    from ..tiles._job import plan_job

    computed = np.dtype(np.float32 if recipe.single else np.float64)
    stored = result_dtype(grid, recipe.single)
    method = recipe.choose(grid)
    try:
        return plan_job(grid, source, factors, method, computed, stored, recipe.fill)
    except ValueError as error:
        message = str(error)
        if recipe.method == "tune":
            message = (
                "--method tune chose settings that need the whole grid at once; leave out "
                "--workers, --resume and --memory, or take --method global"
            )
        raise InputError(message) from error


@contextmanager
def _warnings_as_notes(say: Reporter) -> Iterator[None]:
    """Collect warnings while the block runs; if it succeeds, tell them as notes afterwards."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield
    for warning in caught:
        if warning.category is UserWarning:
            say.note(str(warning.message))


def _opened(
    source: Path, target: Path, key: str | None, recipe: Recipe, say: Reporter
) -> tuple[Grid, Source]:
    """The grid and where its samples are: on the disk where parts can be read from there."""
    from ..tiles._job import open_input
    from ..tiles._source import Held

    if source.suffix.lower() not in _PARTS or recipe.method == "tune":
        grid = load(source, key, target, recipe, say)
        return grid, Held(grid.values)
    check_apart(source, target)
    grid, opened = open_input(source, key)
    for note in grid.notes + degrees_note(grid):
        say.note(note)
    return grid, opened


def _whole_output(
    source: Path, state: Unfinished, shape: tuple[int, ...], dtype: np.dtype
) -> Output | None:
    """The output that an earlier run has left at the target; None where there is some to compute.

    Outputs appear whole or not at all, so one that is there, of this shape and type and not older
    than the source, is complete; with which settings it was computed is not known.
    """
    from ..tiles._source import source_at, survey

    target = state.target
    if state.started or not target.exists() or target.stat().st_mtime < source.stat().st_mtime:
        return None
    try:
        array = source_at(target).open()
    except InputError:
        return None
    if tuple(array.shape) != shape or np.dtype(array.dtype) != dtype:
        return None
    return Output(shape, dtype, survey(array, dtype).missing)
