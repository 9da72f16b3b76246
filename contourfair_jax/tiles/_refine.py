"""Grids refined tile by tile, into a file or one tile after the other."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .._fairing.default import chosen_method
from .._fairing.method import AbstractFairing
from .._grid.grid import Grid, exact_float
from .._support import checks
from .._support.checks import Factors
from .._support.results import Progress, untold
from ..io._outputs import check_apart
from ._job import Outcome, open_input, plan_job, run_job
from ._run import Job, Worker
from ._state import Unfinished
from ._tiling import Slices


def refine_to(
    source: Any,
    target: str | os.PathLike[str],
    factor: Factors,
    *,
    method: AbstractFairing | None = None,
    spacing: float | Sequence[float] | None = None,
    dtype: Any = None,
    fill: bool = True,
    workers: int | Executor = 1,
    resume: bool = False,
    memory: int | None = None,
    progress: Progress = untold,
) -> Outcome:
    """Fair and refine a grid of any size into a file.

    The output is written beside `target`, into ``TARGET.partial``, and renamed over it at the end;
    until then an earlier output is untouched.  A run that was stopped, even by ``kill -9``, is
    continued by the same call with ``resume=True``.

    Parameters
    ----------
    source : path or array
        A ``.npy`` file or Zarr folder, by its path, or anything that slices: a NumPy array or
        memory map, a Zarr array, an xarray `DataArray`.  What is masked or infinite is missing.
    target : path
        A name ending in ``.zarr`` or ``.npy``.  In Zarr, place, units and names of the source are
        kept: a source with coordinates becomes a group, as xarray has it, any other an array.
    factor : int or sequence of ndim ints
        How many times finer, along each axis where they differ; one of n samples gets
        ``factor * (n - 1) + 1``.
    method : LocalFairing or GlobalFairing
        As for `fair_field`; settings that look at the whole grid are refused.
    spacing : float or sequence of ndim floats
        Distance of samples along each axis; by default that of the source, 1 where it says none.
    dtype : dtype
        float32 or float64, to compute and store in; by default it is computed in float64 and stored
        in the smaller one that holds every sample, as ``contourfair upsample`` does.
    fill : bool
        Whether global fairing fills missing samples; if not, cells with one at a corner are
        missing.
    workers : int or concurrent.futures.Executor
        Processes, of which each computes one tile at a time.  With more than one, scripts need the
        guard ``if __name__ == "__main__":``.  An executor can be that of a dask cluster,
        ``client.get_executor()``, whose processes see the same files.
    resume : bool
        Continue a run that was stopped.
    memory : int
        Bytes that all processes together may take; fewer workers are used where they would not
        fit.
    progress : callable
        Called with the number of tiles that are done and of all.

    Returns
    -------
    Outcome

    Raises
    ------
    ValueError
        For an argument that cannot be used.
    contourfair_jax.io.InputError
        The source cannot be read, or all its samples are missing, or those that are missing reach
        too far beyond a tile to be filled; the target is the source, or lies
        in it; it cannot be written, and then the tiles that are done stay in ``TARGET.partial``; a
        tile does not fit into memory, or the output onto the disk; an unfinished run is there and
        `resume` is not set, or it is damaged, or was one with other settings or another input: the
        message names the difference.

    Examples
    --------
    >>> import tempfile, numpy as np
    >>> from contourfair_jax import tiles
    >>> samples = np.hypot(*np.mgrid[-1:1:40j, -1:1:30j]).astype("float32")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     outcome = tiles.refine_to(samples, f"{folder}/fine.npy", 4)
    ...     np.load(f"{folder}/fine.npy").shape
    (157, 117)
    """
    if isinstance(source, str | os.PathLike):
        check_apart(Path(source), Path(target))
    state = Unfinished(target)
    job, grid = _planned(source, factor, method, spacing, dtype, fill)
    return run_job(job, grid, state, workers, resume, memory, progress)


def refine_tiles(
    source: Any,
    factor: Factors,
    *,
    method: AbstractFairing | None = None,
    spacing: float | Sequence[float] | None = None,
    dtype: Any = None,
    fill: bool = True,
) -> Iterator[tuple[Slices, np.ndarray]]:
    """The tiles of `refine_to`, one after the other, to be stored or used by the caller.

    Yields
    ------
    region : tuple of slices
        Where in the refined grid, of shape ``factor * (n - 1) + 1``.
    values : array
        The refined samples there.

    Raises
    ------
    ValueError
        For an argument that cannot be used, or gaps that reach too far beyond a tile to be filled.
    """
    job, _ = _planned(source, factor, method, spacing, dtype, fill)
    worker = Worker(job)
    return ((tile.region, worker.compute(tile)[0].astype(job.stored)) for tile in job.tiling)


def _planned(
    given: Any,
    factor: Factors,
    method: AbstractFairing | None,
    spacing: float | Sequence[float] | None,
    dtype: Any,
    fill: bool,
) -> tuple[Job, Grid]:
    """A job and its grid from public arguments; ValueError for what cannot be used."""
    grid, source = open_input(Path(given) if isinstance(given, str | os.PathLike) else given)
    if grid.ndim not in checks.DIMENSIONS or min(grid.shape) < 3:
        raise ValueError(
            "source must be 2-D or 3-D with at least 3 samples along every axis, got shape "
            f"{grid.shape}"
        )
    factors = checks.check_factors(factor, grid.ndim)
    stored = np.dtype(exact_float(grid.source_dtype) if dtype is None else dtype)
    if stored not in (np.float32, np.float64):
        raise ValueError(f"dtype must be float32 or float64, got {stored}")
    if spacing is not None:
        steps = checks.check_per_axis(spacing, grid.ndim, "spacing", positive=True)
        grid = replace(grid, spacing=tuple(np.asarray(steps).tolist()))
    computed = np.dtype(np.float64) if dtype is None else stored
    method = chosen_method(method)
    return plan_job(grid, source, factors, method, computed, stored, fill), grid
