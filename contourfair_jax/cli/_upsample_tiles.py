"""``contourfair upsample`` in tiles, so that only parts of the samples are in memory."""

from __future__ import annotations

import math
import uuid
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._grid.affine import refined_shape
from .._grid.grid import Grid, no_samples
from .._grid.reference import degrees_note
from .._support.errors import InputError
from ..io._outputs import check_apart
from ..tiles._source import source_at, survey
from ..tiles._state import Unfinished
from ._console import Reporter
from ._per_axis import Factor
from ._recipe import Recipe
from ._steps import check_axes, load, result_dtype, warn_narrowing
from ._words import Output, by, describe_count, missing_note

if TYPE_CHECKING:
    from .._fairing.method import AbstractFairing
    from ..tiles import Outcome
    from ..tiles._run import Job
    from ..tiles._source import Source
    from ..tiles._store import Store
    from ..tiles._tiling import Tiling


# What is written part by part, and the bytes of a file from which on it is by itself.
_PARTS = (".npy", ".zarr")


_LARGE = 2**26


@dataclass(frozen=True)
class Division:
    """How work is to be divided: the options ``--workers``, ``--resume`` and ``--memory``."""

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
    whole = recipe.method == "tune" or recipe.settings.sigma is not None
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
    from ..tiles._job import check_room
    from ..tiles._run import Job
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
    chosen = recipe.choose(grid)
    tiling = _tiling(chosen, grid, factors, tuned=recipe.method == "tune")
    kind = np.dtype(np.float32 if recipe.single else np.float64)
    stored, state = result_dtype(grid, recipe.single), Unfinished(target)
    earlier = whole_output(source, state, tiling.fine_shape, stored) if division.resume else None
    if earlier is not None:
        say.note(
            "nothing to resume: the output is there, whole, from an earlier run, and is left as it "
            "is; without --resume it is computed anew"
        )
        return earlier
    if division.resume and not state.started:
        say.note("nothing to resume: there is no unfinished run, so all is computed")
    check_room(tiling, kind, stored, state)
    finer = _outline(grid, factors, stored)
    job = Job(uuid.uuid4().hex, opened, None, tiling, chosen, grid.spacing, kind, recipe.fill)
    outcome = _computed(replace(job, store=_store(job, state, finer)), state, division, finer, say)
    count = math.prod(grid.shape)
    if outcome.gaps and not isinstance(opened, Held):  # else the reader has told
        say.note(missing_note(describe_count(outcome.gaps, count), recipe.fill))
    if target.suffix.lower() == ".npy" and grid.affine is not None:
        say.note(".npy keeps the samples only: spacing and coordinates are left out")
    return Output(outcome.shape, stored, outcome.missing)


def _computed(
    job: Job, state: Unfinished, division: Division, finer: Grid, say: Reporter
) -> Outcome:
    """Run a job, and show how far it is."""
    from ..tiles._job import run_job

    shape = job.tiling.shape
    with (
        _warnings_as_notes(say),
        say.counting(f"fairing {by(shape)}", "samples", math.prod(shape)) as progress,
    ):
        return run_job(
            job,
            state,
            division.workers,
            division.resume,
            None if division.memory is None else int(division.memory * 2**30),
            progress=progress,
            prepare=None if state.data.suffix == ".npy" else lambda path: _group(path, finer),
        )


@contextmanager
def _warnings_as_notes(say: Reporter) -> Iterator[None]:
    """What is warned of inside is told afterwards, unless it fails."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield
    for each in caught:
        if each.category is UserWarning:
            say.note(str(each.message))


def _tiling(method: AbstractFairing, grid: Grid, factors: tuple[int, ...], tuned: bool) -> Tiling:
    """How the grid is cut; what cannot be cut is bad input here."""
    from ..tiles._program import tiling_of

    try:
        return tiling_of(method, grid.shape, factors)
    except ValueError as error:
        message = str(error)
        if tuned:
            message = (
                "--method tune chose settings that need the whole grid at once; leave out "
                "--workers, --resume and --memory, or take --method global"
            )
        raise InputError(message) from error


def _opened(
    source: Path, target: Path, key: str | None, recipe: Recipe, say: Reporter
) -> tuple[Grid, Source]:
    """The grid and where its samples are: on the disk where parts can be read from there."""
    from ..tiles._source import Held, ZarrMember, source_at

    if source.suffix.lower() not in _PARTS or recipe.method == "tune":
        grid = load(source, key, target, recipe, say)
        return grid, Held(grid.values)
    check_apart(source, target)
    opened = source_at(source, key)
    if isinstance(opened, ZarrMember):
        grid = opened.outline()[0]
    else:
        values = opened.open()
        grid = Grid(no_samples(values.shape, values.dtype))
    for note in grid.notes + degrees_note(grid):
        say.note(note)
    return grid, opened


def _outline(grid: Grid, factors: tuple[int, ...], dtype: np.dtype) -> Grid:
    """The refined grid without its samples; missing ones are NaN."""
    fine = refined_shape(grid.shape, factors)
    outline = grid.on_finer(no_samples(fine, dtype), factors)
    return replace(outline, nodata=None)


def _store(job: Job, state: Unfinished, finer: Grid) -> Store:
    """Where the samples go; in a group they get the name that its outline gives them."""
    from ..io.formats.zarr import outline_of_group
    from ..tiles._store import ZarrStore, store_for

    store = store_for(state.target, state.data, job.tiling, finer.values.dtype)
    if not isinstance(store, ZarrStore):
        return store
    _, name, names, attributes = outline_of_group(finer)
    return replace(store, member=name, names=names, attributes=attributes)


def _group(path: Path, finer: Grid) -> None:
    """Coordinates and the reference system, in a group of their own."""
    from ..io.formats.zarr import outline_of_group

    rest, *_ = outline_of_group(finer)
    rest.to_zarr(path, mode="w", zarr_format=3, consolidated=False)


def whole_output(
    source: Path, state: Unfinished, shape: tuple[int, ...], dtype: np.dtype
) -> Output | None:
    """What an earlier run has left at the target, or None where there is something to compute.

    Outputs appear whole or not at all, so one that is there, of this shape and type and not older
    than the source, is complete; with which settings it was computed is not known.
    """
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
