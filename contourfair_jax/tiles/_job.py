"""A job: planned from its arguments, checked against memory and disk, begun or resumed, run."""

import dataclasses
import math
import shutil
import uuid
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from .._fairing.global_fairing.method import GlobalFairing
from .._fairing.method import AbstractFairing
from .._grid.affine import describe_factors
from .._grid.grid import Grid, no_samples
from .._support import checks
from .._support.errors import InputError, one_line
from .._support.memory import describe_bytes, physical_memory
from .._support.results import Progress, untold
from .._version import __version__
from ..io._outputs import in_one_line
from ._gaps import is_cut, refusal
from ._program import tile_bytes, tiling_of
from ._run import Job, Stored, run_all
from ._source import (
    Source,
    ZarrMember,
    is_shared,
    read_block,
    slabs,
    source_at,
    source_of,
    survey,
)
from ._state import DONE, OPEN, UNCONVERGED, Unfinished
from ._store import store_for
from ._tiling import Tiling

# Memory of a process beside its tile: Python, JAX, the compiled program.
_PROCESS_BYTES = 512 * 2**20
# Zarr compresses, but samples with digits hardly ever to less than this part.
_SMALLEST_PART = {".zarr": 0.1}


def check_room(tiling: Tiling, computed: np.dtype, stored: np.dtype, state: Unfinished) -> None:
    """Refuse, before anything is read or written, a target or sizes that cannot do.

    Parameters
    ----------
    computed, stored
        The types of samples while they are computed and in the output.

    Raises
    ------
    InputError
        The target cannot be written, a tile does not fit into memory, or the output onto the disk.
    """
    state.check_target()
    tile, memory = tile_bytes(tiling, computed.itemsize), physical_memory()
    if tile > memory:
        raise InputError(
            f"one tile at factor {describe_factors(tiling.factors)} needs {describe_bytes(tile)} "
            f"of memory, this machine has {describe_bytes(memory)}; take a smaller --factor"
        )
    output = math.prod(tiling.fine_shape) * stored.itemsize
    least = int(output * _SMALLEST_PART.get(state.target.suffix.lower(), 1))
    disk = shutil.disk_usage(state.target.parent)
    there = disk.free + _size(state.data)
    if disk.total and least > there:  # file systems without a disk have no size
        shape = " x ".join(str(n) for n in tiling.fine_shape)
        raise InputError(
            f"{state.target}: {shape} samples are {describe_bytes(output)}, the disk has room for "
            f"{describe_bytes(there)}; take a smaller --factor, or another disk"
        )


def affordable(
    tiling: Tiling, dtype: np.dtype, workers: int | Executor, memory: int | None
) -> int | Executor:
    """As many workers as `memory` has room for.

    Raises
    ------
    InputError
        There is not enough for one.
    """
    if memory is None:
        return workers
    share = _PROCESS_BYTES + tile_bytes(tiling, dtype.itemsize)
    if memory < share:
        raise InputError(
            f"memory must be at least {describe_bytes(share)} ({share} bytes) for tiles of this "
            f"method and factor, got {memory} bytes"
        )
    # More than one worker are processes of their own, beside this one.
    fit = (memory - _PROCESS_BYTES) // share
    return max(1, min(workers, fit)) if isinstance(workers, int) else workers


def _size(path: Path) -> int:
    """Bytes of a file, or of all files of a folder; 0 where there is neither."""
    if path.is_dir():
        return sum(_size(each) for each in path.iterdir())
    return path.stat().st_size if path.is_file() else 0


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The outcome of a run.

    Parameters
    ----------
    shape
        Samples per axis of the output.
    tiles
        Number of tiles.
    resumed
        How many of them were there from an earlier run.
    unconverged
        How many did not meet the tolerance of global fairing.
    gaps
        Samples of the input that are missing.
    missing
        Samples of the output that are.
    cut
        Tiles of global fairing beside gaps that reach too far beyond them.
    """

    shape: tuple[int, ...]
    tiles: int
    resumed: int
    unconverged: int
    gaps: int
    missing: int
    cut: int


def open_input(given: Any, key: str | None = None) -> tuple[Grid, Source]:
    """The grid of an input without its samples, and where these are.

    Parameters
    ----------
    given : path or array
        As for `tiles.refine_to`.  A file, or an xarray `DataArray`, says where its samples lie; of
        other arrays nothing but the shape is known.
    key
        Which array of a Zarr folder.

    Raises
    ------
    InputError
        The file cannot be read.
    ValueError
        `given` does not hold real numbers.
    """
    source = source_at(given, key) if isinstance(given, Path) else source_of(given)
    if isinstance(source, ZarrMember):
        return source.outline()[0], source
    array: Any = source.open()
    shape, dtype = tuple(int(n) for n in array.shape), np.dtype(array.dtype)
    if dtype.kind not in "biuf":
        raise ValueError(f"source must hold real numbers, got dtype {dtype}; convert it first")
    if type(array).__module__.split(".")[0] == "xarray":
        from ..io.formats.datasets import outline_from_array

        return outline_from_array(array), source
    return Grid(no_samples(shape, dtype), source_dtype=dtype), source


def plan_job(
    grid: Grid,
    source: Source,
    factors: Sequence[int],
    method: AbstractFairing,
    computed: np.dtype,
    stored: np.dtype,
    fill: bool,
) -> Job:
    """A job that has no store yet.

    The one planner of tile jobs: with `run_job`, all that `tiles.refine_to` and the command
    ``upsample`` compute, and keep of the input's spacing, place, units and names, is decided here.

    Parameters
    ----------
    grid, source
        As from `open_input`.
    computed, stored
        The types of samples while they are computed, and in the output.

    Raises
    ------
    ValueError
        The method needs the whole grid at once.
    """
    tiling = tiling_of(method, grid.shape, tuple(factors))
    return Job(uuid.uuid4().hex, source, None, tiling, method, grid.spacing, computed, stored, fill)


def run_job(
    job: Job,
    grid: Grid,
    state: Unfinished,
    workers: int | Executor = 1,
    resume: bool = False,
    memory: int | None = None,
    progress: Progress = untold,
) -> Outcome:
    """Do a job of a grid, or what is left of it; the public face is `tiles.refine_to`."""
    check_room(job.tiling, job.dtype, job.stored, state)
    samples = no_samples(job.tiling.fine_shape, job.stored)
    finer = dataclasses.replace(grid.on_finer(samples, job.tiling.factors), nodata=None)
    job = dataclasses.replace(job, store=store_for(state.target, state.data, job.tiling, finer))
    if not isinstance(workers, Executor):
        checks.check_count(workers, 1, "workers")
    workers = affordable(job.tiling, job.dtype, workers, memory)
    with state.held():
        if state.started and not resume:
            raise InputError(
                f"{state.target}: an unfinished run is in {state.folder}; resume it, or delete "
                "that folder to start afresh"
            )
        surveyed = survey(job.source.open(), job.dtype)
        if surveyed.missing == math.prod(job.tiling.shape):
            raise InputError("every sample is missing, so there is nothing to fair")
        cut = _cut_tiles(job) if surveyed.missing else 0
        settings = settings_of(job, finer, surveyed.digest)
        if state.started:
            state.compare(settings)
        else:
            _begin(job, state, settings)
        tiles = len(job.tiling)
        resumed = int(np.count_nonzero(state.states(tiles)))
        with _kept(state):
            _run_rest(_shared(job, state, workers, surveyed.missing), state, workers, progress)
        failed = int(np.count_nonzero(state.states(tiles) == UNCONVERGED))
        missing = state.missing(tiles)
        with in_one_line(state.target):
            state.finish()
    if cut:
        warnings.warn(
            f"beside gaps that reach far beyond them, {cut} of {tiles} tiles have seams up to 1e-3 "
            "of the range; fair the whole grid with fair_field, or locally, to have none",
            UserWarning,
            stacklevel=3,
        )
    if failed:
        warnings.warn(
            f"global fairing did not converge in {failed} of {tiles} tiles; raise "
            "max_steps or thin_plate_weight",
            UserWarning,
            stacklevel=3,
        )
    return Outcome(job.tiling.fine_shape, tiles, resumed, failed, surveyed.missing, missing, cut)


def _cut_tiles(job: Job) -> int:
    """Number of tiles with gaps that reach too far beyond them; refused where they are filled."""
    if not isinstance(job.method, GlobalFairing):
        return 0
    array = job.source.open()
    cut = [
        tile
        for tile in job.tiling
        if is_cut(job.method, read_block(array, tile.block, job.dtype), tile, job.tiling, job.fill)
    ]
    if cut and job.fill:
        raise refusal(len(cut), cut[0])
    return len(cut)


def settings_of(job: Job, finer: Grid, digest: str) -> dict[str, Any]:
    """Settings that a result depends on, to the last bit, by names for messages.

    Parameters
    ----------
    finer
        The grid of the output.
    digest
        A hash of the samples.
    """
    array, method = job.source.open(), job.method
    of_method = {
        f"method.{field.name}": _plain(getattr(method, field.name))
        for field in dataclasses.fields(method)
    }
    return {
        "shape of the input": list(job.tiling.shape),
        "type of the input": np.dtype(array.dtype).str,
        "factor": describe_factors(job.tiling.factors),
        "method": type(method).__name__,
        **of_method,
        "spacing": list(job.spacing),
        "precision": job.dtype.name,
        "filled gaps": job.fill,
        "stored type": finer.values.dtype.name,
        "place of the output": {
            "affine": None if finer.affine is None else finer.affine.tolist(),
            "axes": list(finer.axes),
            "crs": finer.crs,
            "origin": list(finer.origin),
            "units": finer.units,
        },
        "tile": [job.tiling.cells, job.tiling.halo],
        "version of contourfair-jax": __version__,
        "version of jax": version("jax"),
        "content of the input": digest,
    }


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return np.asarray(value).tolist() if eqx.is_array_like(value) else repr(value)


def _begin(
    job: Job,
    state: Unfinished,
    settings: dict[str, Any],
) -> None:
    """An empty output, and the record of what it is to be."""
    assert job.store is not None
    with in_one_line(state.target):
        state.clear()
        job.store.create(job.tiling)
        state.begin(settings, len(job.tiling))


def _run_rest(
    job: Job,
    state: Unfinished,
    workers: int | Executor,
    progress: Progress,
) -> None:
    """The tiles that are not done."""
    states = state.states(len(job.tiling))
    count, total = int(np.count_nonzero(states)), len(states)
    rest = np.flatnonzero(states == OPEN).tolist()
    if not rest:
        return
    assert job.store is not None
    job.store.sweep()
    with state.marking() as mark:

        def done(number: int, stored: Stored) -> None:
            nonlocal count
            mark(number, DONE if stored.converged else UNCONVERGED, stored.missing)
            count += 1
            progress(count, total)

        progress(count, total)
        run_all(job, rest, workers, done)


def _shared(job: Job, state: Unfinished, workers: int | Executor, missing: int) -> Job:
    """The job with a source that other processes can open: an array in memory is stored first."""
    if workers == 1 or is_shared(job.source):
        return job
    array, path = job.source.open(), state.folder / "input.npy"
    kind = np.dtype(array.dtype)
    if missing and kind.kind != "f":  # masked whole numbers, of which NaN is none
        kind = job.dtype
    stored = np.lib.format.open_memmap(path, "w+", kind, tuple(array.shape))
    for slab in slabs(array):
        stored[slab] = checks.unmasked(array[slab])
    stored.flush()
    source: Source = source_of(path)
    return dataclasses.replace(job, source=source)


@contextmanager
def _kept(state: Unfinished) -> Iterator[None]:
    """Errors of writing in one line that says what is left."""
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{state.target}: cannot be written ({error.strerror or one_line(error)}); the tiles "
            f"that are done are kept in {state.folder}: mend it and resume"
        ) from error
