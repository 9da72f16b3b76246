"""Sources of the samples of tiles: arrays that slice, and how a worker opens them again."""

import hashlib
import math
import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._grid.grid import Grid
from .._grid.missing import check_dtype
from .._support.checks import unmasked
from .._support.errors import InputError, one_line
from .._support.memory import describe_bytes, physical_memory
from ..io.formats.npy import read_header
from ._tiling import Slices

# Bytes of samples that are read at once where the order does not matter, and the most where whole
# chunks are.
_SLAB_BYTES, _CHUNKED_SLAB_BYTES = 2**25, 2**28
# Bytes of a chunk that are no burden, however small the array.
_SMALL_CHUNK = 2**28


@dataclass(frozen=True)
class MappedFile:
    """An array in a file that is mapped to memory, by where it lies."""

    path: str
    offset: int
    shape: tuple[int, ...]
    dtype: str
    order: str

    def open(self) -> np.ndarray:
        """The array, read-only."""
        return np.memmap(
            self.path,
            self.dtype,
            "r",
            self.offset,
            self.shape,
            self.order,  # pyright: ignore
        )


@dataclass(frozen=True)
class Held:
    """An array that is handed over as it is: picklable, as Zarr's, or used in this process only."""

    array: Any

    def open(self) -> Any:
        """The array."""
        return self.array


@dataclass(frozen=True)
class ZarrMember:
    """A Zarr array, or a variable of a group, by the path of its folder."""

    path: str
    key: str | None = None

    def open(self) -> "ZarrParts":
        """The array, of which parts are read when they are sliced."""
        return self.outline()[1]

    def outline(self) -> tuple[Grid, "ZarrParts"]:
        """The array and, without samples, the grid that it belongs to.

        Raises
        ------
        InputError
            The folder is damaged, or holds no such array, or one in chunks that are too large.
        """
        from ..io.formats.zarr import read_outline

        with _as_zarr(self.path):
            grid, array = read_outline(Path(self.path), self.key)
            parts = ZarrParts(self.path, array)
            parts.check_chunks()
        return grid, parts


class ZarrParts:
    """A Zarr array on the disk; what is wrong with the parts that are read is said in one line."""

    def __init__(self, path: str, array: Any) -> None:
        self._path, self._array = path, array
        self.shape, self.dtype = tuple(array.shape), np.dtype(array.dtype)
        stored = getattr(array, "encoding", {}).get("chunks") or getattr(array, "chunks", None)
        self._chunk = tuple(stored or ())
        # Of a part of a variable the chunks say nothing.
        self.chunks = self._chunk if len(self._chunk) == len(self.shape) else None

    def __getitem__(self, part: Slices) -> np.ndarray:
        with _as_zarr(self._path):
            return np.asarray(self._array[part])

    def check_chunks(self) -> None:
        """Refuse chunks that are far larger than the array, or than the memory: bombs."""
        size = math.prod(self._chunk) * self.dtype.itemsize
        whole = math.prod(self.shape) * self.dtype.itemsize
        if size > max(_SMALL_CHUNK, min(2 * whole, physical_memory())):
            raise InputError(
                f"has chunks of {describe_bytes(size)} for {describe_bytes(whole)} of samples; "
                "store it in smaller chunks"
            )


@contextmanager
def _as_zarr(path: str) -> Iterator[None]:
    """Errors of reading in one line."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except Exception as error:  # the libraries raise anything on damaged folders
        raise InputError(f"{path}: cannot be read as Zarr: {one_line(error)}") from error


Source = MappedFile | ZarrMember | Held


def source_of(given: Any) -> Source:
    """The source for `given`: the path of a ``.npy`` file or a Zarr array, or anything that slices.

    Raises
    ------
    InputError
        The path names no such file.
    ValueError
        `given` is not an array of real numbers.
    """
    if isinstance(given, str | os.PathLike):
        return source_at(Path(given))
    if isinstance(given, np.memmap) and isinstance(given.base, mmap.mmap) and given.filename:
        order = "C" if given.flags.c_contiguous else "F"
        path = os.path.abspath(str(given.filename))
        return MappedFile(path, given.offset, given.shape, given.dtype.str, order)
    if not all(hasattr(given, name) for name in ("shape", "dtype", "__getitem__")):
        given = np.asarray(given)
    return Held(given)


def source_at(path: Path, key: str | None = None) -> Source:
    """The source for a ``.npy`` file, or for the array `key` of a Zarr folder.

    Raises
    ------
    InputError
        There is no such file, it is damaged, or it does not hold real numbers.
    """
    if not path.exists():
        raise InputError(f"{path}: there is no such file")
    if path.is_dir():
        return ZarrMember(os.path.abspath(path), key)
    if path.suffix.lower() != ".npy":
        raise InputError(f"{path}: .npy files and .zarr folders are read in tiles")
    if key is not None:
        raise InputError(f"{path}: holds one array, so there is no {key!r} to choose")
    with open(path, "rb") as stream:
        try:
            shape, fortran, dtype = read_header(stream)
            check_dtype(dtype)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        offset = stream.tell()
    if offset + math.prod(shape) * dtype.itemsize > path.stat().st_size:
        raise InputError(f"{path}: is truncated: its header promises more samples than are there")
    return MappedFile(os.path.abspath(path), offset, shape, dtype.str, "F" if fortran else "C")


def is_shared(source: Source) -> bool:
    """Whether another process can open it for the price of a path."""
    if not isinstance(source, Held):
        return True
    return type(source.array).__module__.split(".")[0] == "zarr" and hasattr(
        getattr(source.array, "store", None), "root"
    )


def read_block(array: Any, block: Slices, dtype: np.dtype) -> np.ndarray:
    """Samples of a block in the type to compute in; masked and infinite ones are NaN."""
    values = _as_floats(unmasked(array[block]), dtype)
    values[~np.isfinite(values)] = np.nan
    return values


def _as_floats(values: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """A copy in `dtype`; what is too large for it becomes infinite, and is counted as missing."""
    with np.errstate(over="ignore"):
        return values.astype(dtype)


class Survey(NamedTuple):
    """A summary of all samples.

    Parameters
    ----------
    digest
        A hash of the samples and the mask, whatever the chunks.
    missing
        Number of samples that are masked, or not finite in the type to compute in.
    """

    digest: str
    missing: int


def survey(array: Any, dtype: np.dtype) -> Survey:
    """Read all samples once."""
    digest, masked, missing, done = (*(hashlib.blake2b(digest_size=16) for _ in "ab"), 0, 0)
    for slab in slabs(array):
        read = array[slab]
        values = np.ascontiguousarray(np.ma.filled(read, 0))
        digest.update(values.data)
        gone = np.ma.getmaskarray(read) if np.ma.is_masked(read) else np.zeros((), bool)
        masked.update((np.flatnonzero(gone) + done).astype("<i8").data)
        if values.dtype.kind == "f":
            gone = gone | ~np.isfinite(_as_floats(values, dtype))
        missing += int(np.count_nonzero(gone))
        done += values.size
    if masked.digest() != hashlib.blake2b(digest_size=16).digest():
        digest.update(masked.digest())
    return Survey(digest.hexdigest(), missing)


def slabs(array: Any) -> Iterator[Slices]:
    """Parts along the first axis, whole chunks where there are chunks."""
    row = max(1, math.prod(array.shape[1:]) * np.dtype(array.dtype).itemsize)
    rows = max(1, _SLAB_BYTES // row)
    chunks = getattr(array, "chunks", None)
    if chunks and isinstance(chunks[0], int):
        whole = max(chunks[0], rows // chunks[0] * chunks[0])
        rows = whole if whole * row <= _CHUNKED_SLAB_BYTES else rows
    for start in range(0, array.shape[0], rows):
        yield (slice(start, min(start + rows, array.shape[0])),)
