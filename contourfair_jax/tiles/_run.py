"""Computing tiles: one job, described in full, and whoever works on it.

What is sent to other processes is a `Job` and numbers of tiles; every process opens the source, the
output and the program once.
"""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

from .._fairing.method import AbstractFairing
from .._support.errors import InputError
from ._gaps import check_gaps
from ._program import Program
from ._source import Source, read_block
from ._store import Store
from ._tiling import Tile, Tiling

# How often a worker looks whether the process that started it is still there, in seconds.
_WATCH = 0.5


@dataclass(frozen=True)
class Job:
    """All that is needed to compute and store any tile.

    Parameters
    ----------
    token
        Distinguishes jobs within a process.
    source, store
        Where samples come from and refined ones go to; None where they are not stored.
    tiling, method, spacing
        How the grid is cut and faired.
    dtype, stored
        The precision to compute in, and the type of the output.
    fill
        Whether what global fairing puts in the place of missing samples is kept.
    """

    token: str
    source: Source
    store: Store | None
    tiling: Tiling
    method: AbstractFairing
    spacing: tuple[float, ...]
    dtype: np.dtype
    stored: np.dtype
    fill: bool = True


class Worker:
    """A job with its source, output and program open."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._array = job.source.open()
        self._program = Program(job.method, job.spacing, job.dtype, job.fill)
        self._writer = None if job.store is None else job.store.open()

    def compute(self, tile: Tile) -> tuple[np.ndarray, bool]:
        """The refined samples of a tile, and whether the method converged."""
        job = self._job
        block = read_block(self._array, tile.block, job.dtype)
        if job.fill:
            check_gaps(job.method, block, tile, job.tiling)
        fine, converged = self._program(block, tile.offset, job.tiling)
        return fine[tile.cut], converged

    def run(self, number: int) -> "Stored":
        """Compute and store a tile."""
        tile = self._job.tiling.tile(number)
        values, converged = self.compute(tile)
        assert self._writer is not None
        self._writer.write(tile.region, values)
        return Stored(converged, int(np.count_nonzero(np.isnan(values))))


class Stored(NamedTuple):
    """State of a tile that is stored: whether the method converged, and missing samples."""

    converged: bool
    missing: int


_WORKERS: dict[str, Worker] = {}


def run_tile(job: Job, number: int) -> Stored:
    """`Worker.run` in any process."""
    worker = _WORKERS.get(job.token)
    if worker is None:
        worker = Worker(job)
        _WORKERS.clear()
        _WORKERS[job.token] = worker
    return worker.run(number)


def run_all(
    job: Job,
    numbers: Iterable[int],
    workers: int | Executor,
    done: Callable[[int, Stored], None],
) -> None:
    """Run tiles and report each, in whatever order they end.

    Parameters
    ----------
    workers
        1 for this process, more for as many processes of one thread each, or an executor.
    done
        Called with the number of a tile that is stored and what is said of it.
    """
    if workers == 1:
        worker = Worker(job)
        for number in numbers:
            done(number, worker.run(number))
        return
    count = workers if isinstance(workers, int) else _width(workers)
    with _pool(workers) as executor:
        _spread(executor, job, iter(numbers), 2 * count, done)


def _spread(
    executor: Executor,
    job: Job,
    numbers: Iterator[int],
    most: int,
    done: Callable[[int, Stored], None],
) -> None:
    """Keep at most so many tiles in the hands of the executor."""
    pending: dict[Any, int] = {}
    try:
        for number in numbers:
            pending[executor.submit(run_tile, job, number)] = number
            while len(pending) >= most:
                _collect(pending, done)
        while pending:
            _collect(pending, done)
    except BrokenProcessPool as error:
        raise InputError(
            "a worker process ended by itself, perhaps for want of memory; the tiles that are done "
            "are kept: resume with fewer workers"
        ) from error
    finally:
        for future in pending:
            future.cancel()


def _collect(pending: dict[Any, int], done: Callable[[int, Stored], None]) -> None:
    ended, _ = wait(pending, return_when=FIRST_COMPLETED)
    for future in ended:
        done(pending.pop(future), future.result())


@contextmanager
def _pool(workers: int | Executor) -> Iterator[Executor]:
    """The executor that was given, or new processes that end with this one, however it ends."""
    if isinstance(workers, Executor):
        with nullcontext(workers) as executor:
            yield executor
        return
    context = get_context("spawn")
    executor = ProcessPoolExecutor(workers, context, _watch_parent, (os.getpid(),))
    try:
        yield executor
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def _width(executor: Executor) -> int:
    """Tiles that an executor works on at the same time, as far as it says."""
    return int(getattr(executor, "_max_workers", 0) or os.cpu_count() or 1)


def _watch_parent(parent: int) -> None:
    """End this process when `parent` is gone: a killed parent cannot say so."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
