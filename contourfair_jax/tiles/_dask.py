"""Refinement of dask arrays: one task for each tile; chunks are those of the input, refined."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .._fairing.method import AbstractFairing
from ._gaps import check_gaps
from ._program import Program, tiling_of
from ._source import read_block
from ._tiling import Tiling


@dataclass(frozen=True)
class _Task:
    """The tiling, method and types that all tiles of an array share."""

    tiling: Tiling
    method: AbstractFairing
    spacing: tuple[float, ...]
    dtype: np.dtype


def _refine(task: _Task, number: int, block: np.ndarray) -> np.ndarray:
    tile = task.tiling.tile(number)
    samples = read_block(block, (slice(None),) * block.ndim, task.dtype)
    check_gaps(task.method, samples, tile, task.tiling)
    program = Program(task.method, task.spacing, task.dtype)
    fine, _ = program(samples, tile.offset, task.tiling)
    return fine[tile.cut]


def refine_lazily(
    samples: Any,
    factors: tuple[int, ...],
    method: AbstractFairing,
    spacing: Sequence[float],
    dtype: np.dtype,
) -> Any:
    """The refined samples of a dask array, in chunks of one tile each; nothing is computed yet."""
    import dask.array as da
    from dask.delayed import delayed

    tiling = tiling_of(method, samples.shape, factors)
    task = _Task(tiling, method, tuple(spacing), dtype)
    parts = np.empty(tiling.counts, dtype=object)
    for tile in tiling:
        refine = delayed(partial(_refine, task, tile.number), traverse=False)
        shape = tuple(part.stop - part.start for part in tile.region)
        part = da.from_delayed(refine(samples[tile.block]), shape, dtype)
        parts[np.unravel_index(tile.number, tiling.counts)] = part
    return da.block(parts.tolist())


def refined_chunks(chunks: Sequence[int], factor: int, periodic: bool) -> tuple[int, ...]:
    """Chunks along a refined axis: those of the samples, the last of which ends the axis."""
    *first, last = chunks
    return (*(factor * n for n in first), factor * last if periodic else factor * (last - 1) + 1)


def each_member(samples: Any, ndim: int, refine: Any) -> Any:
    """`refine` applied to every member of the batch that the leading axes are."""
    import dask.array as da

    batch = samples.shape[: samples.ndim - ndim]
    if 0 in batch:
        like = refine(da.zeros(samples.shape[len(batch) :], samples.dtype))
        return da.zeros((*batch, *like.shape), like.dtype)
    members = [refine(samples[index]) for index in itertools.product(*map(range, batch))]
    return da.stack(members).reshape(*batch, *members[0].shape) if batch else members[0]
