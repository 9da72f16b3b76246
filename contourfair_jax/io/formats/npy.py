"""NumPy ``.npy`` files: the header is read and checked before any sample is."""

import io
import math
import os
from pathlib import Path
from typing import IO, TypeAlias

import numpy as np

from ..._grid.grid import Grid
from ..._grid.missing import check_dtype, mark_missing, numeric
from ..._support.errors import InputError, one_line
from ..._support.memory import check_memory, describe_bytes

# A file, or one inside an archive.
Stream: TypeAlias = IO[bytes] | io.BufferedIOBase

_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read(path: Path, key: str | None) -> Grid:
    """Samples of a ``.npy`` file; it says nothing about spacing, units or missing values."""
    if key is not None:
        raise InputError(f"holds one array, so there is no {key!r} to choose")
    with open(path, "rb") as stream:
        array = read_array(stream, os.fstat(stream.fileno()).st_size)
    values, missing, notes = mark_missing(numeric(array), None)
    return Grid(values, missing=missing, notes=notes, source_dtype=array.dtype)


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store the samples; missing ones stay NaN, for the format has no place for anything else."""
    with open(path, "wb") as stream:
        np.lib.format.write_array(stream, np.asarray(grid.values), allow_pickle=False)
    if grid.affine is None and set(grid.spacing) == {1.0}:
        return ()
    return (".npy keeps the samples only: spacing and coordinates are left out (.npz keeps them)",)


def read_array(stream: Stream, size: int) -> np.ndarray:
    """The array of numbers or text at the start of `stream`, which holds `size` bytes.

    Raises
    ------
    InputError
        Not a ``.npy`` file, pickled objects, or fewer bytes than the header promises.
    """
    shape, fortran, dtype = read_header(stream)
    if dtype.kind != "U":
        check_dtype(dtype)
    count = math.prod(shape)
    promised, present = count * dtype.itemsize, size - stream.tell()
    if promised > present:
        raise InputError(
            f"is truncated: its header promises {describe_bytes(promised)} of samples, "
            f"{describe_bytes(max(present, 0))} are there"
        )
    check_memory(promised, f"an array of shape {shape}")
    data = stream.read(promised)
    if len(data) != promised:
        raise InputError(f"is truncated: {describe_bytes(len(data))} of {describe_bytes(promised)}")
    flat = np.frombuffer(data, dtype=dtype, count=count)
    return flat.reshape(shape, order="F" if fortran else "C")


def read_header(stream: Stream) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether the order is Fortran's, and type, whatever it is."""
    try:
        version = np.lib.format.read_magic(stream)
    except ValueError as error:
        raise InputError("is not a .npy array (it does not begin like one)") from error
    if version not in _HEADERS:
        raise InputError(f"is a .npy file of version {version}; 1.0 and 2.0 are read")
    try:
        shape, fortran, dtype = _HEADERS[version](stream)
    except ValueError as error:
        raise InputError(f"has a damaged header ({one_line(error)})") from error
    if any(n < 0 for n in shape):
        raise InputError(f"has a damaged header (shape {shape})")
    return shape, fortran, dtype
