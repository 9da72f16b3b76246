"""Whether a job fits: its tiles into memory, its output onto the disk."""

import math
import shutil
from concurrent.futures import Executor
from pathlib import Path

import numpy as np

from ._factors import describe_factors
from ._tile_program import tile_bytes
from ._tile_state import Unfinished
from ._tiling import Tiling
from .io import InputError
from .io._limits import describe_bytes, physical_memory

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
    each = _PROCESS_BYTES + tile_bytes(tiling, dtype.itemsize)
    if memory < each:
        raise InputError(
            f"memory must be at least {describe_bytes(each)} ({each} bytes) for tiles of this "
            f"method and factor, got {memory} bytes"
        )
    # More than one worker are processes of their own, beside this one.
    fit = (memory - _PROCESS_BYTES) // each
    return max(1, min(workers, fit)) if isinstance(workers, int) else workers


def _size(path: Path) -> int:
    """Bytes of a file, or of all files of a folder; 0 where there is neither."""
    if path.is_dir():
        return sum(_size(each) for each in path.iterdir())
    return path.stat().st_size if path.is_file() else 0
