"""Stores of refined tiles: a Zarr array or a ``.npy`` file, written region by region.

Writers are safe against being killed: a tile that was not finished is written again as a whole.
Nothing is mapped to memory, for a full disk would then end the process instead of raising.
"""

import math
import os
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from .._grid.grid import Grid
from .._support.errors import InputError
from ..io._outputs import known_suffix
from ..io.formats.npy import read_header
from ._tiling import Slices, Tiling

_AFRESH = "delete {} to start afresh"


@dataclass(frozen=True)
class NpyStore:
    """A ``.npy`` file in C order."""

    path: Path
    shape: tuple[int, ...]
    dtype: np.dtype

    def create(self, tiling: Tiling) -> None:
        """The header, and room for all samples where the system can set it aside."""
        with open(self.path, "wb") as stream:
            header = {"descr": self.dtype.str, "fortran_order": False, "shape": self.shape}
            np.lib.format.write_array_header_1_0(stream, header)
            size = stream.tell() + math.prod(self.shape) * self.dtype.itemsize
            stream.flush()
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(stream.fileno(), 0, size)
            else:
                os.truncate(stream.fileno(), size)

    def open(self) -> "NpyWriter":
        """A writer of regions."""
        return NpyWriter(self)

    def sweep(self) -> None:
        """Nothing is left behind by writers that were killed."""


class NpyWriter:
    """Writes regions of a `NpyStore`."""

    def __init__(self, store: NpyStore) -> None:
        self._path, self._shape, self._dtype = store.path, store.shape, store.dtype
        size = math.prod(store.shape) * store.dtype.itemsize
        try:
            with open(self._path, "rb") as stream:
                read_header(stream)
                self._start = stream.tell()
        except InputError as error:
            raise InputError(
                f"{self._path}: {error}; {_AFRESH.format(self._path.parent)}"
            ) from error
        if self._path.stat().st_size != self._start + size:
            raise InputError(
                f"{self._path}: has not the size of the output; {_AFRESH.format(self._path.parent)}"
            )

    def write(self, region: Slices, values: np.ndarray) -> None:
        """Store `values` row by row."""
        values = np.ascontiguousarray(values, self._dtype)
        with open(self._path, "r+b", buffering=0) as stream:
            for row in product(*(range(n) for n in values.shape[:-1])):
                place = [part.start + k for part, k in zip(region, (*row, 0), strict=True)]
                index = int(np.ravel_multi_index(place, self._shape))
                stream.seek(self._start + index * self._dtype.itemsize)
                _write_all(stream, values[row].data.cast("B"))


def _write_all(stream: Any, data: memoryview) -> None:
    while len(data):
        data = data[stream.write(data) :]


@dataclass(frozen=True)
class ZarrStore:
    """A Zarr array of version 3, on its own or as a member of a group.

    Parameters
    ----------
    member : str or None
        Its name in the group.
    names, attributes
        Of its axes, and what is known about its samples.
    beside : xarray.Dataset or None
        What else is in the group: coordinates, the reference system.
    """

    path: Path
    shape: tuple[int, ...]
    dtype: np.dtype
    member: str | None = None
    names: tuple[str, ...] | None = None
    attributes: dict[str, Any] = field(default_factory=dict)
    beside: Any = None

    def create(self, tiling: Tiling) -> None:
        """The metadata, and what is beside the samples; every chunk belongs to one tile."""
        import zarr

        if self.beside is not None:
            self.beside.to_zarr(self.path, mode="w", zarr_format=3, consolidated=False)
        zarr.create_array(
            str(self.path),
            name=self.member,
            shape=self.shape,
            chunks=tiling.chunks,
            dtype=self.dtype,
            fill_value=math.nan,
            dimension_names=self.names,
            attributes=self.attributes,
            zarr_format=3,
            config={"write_empty_chunks": True},
        )
        if self.member is not None:
            from ..io.formats.zarr import consolidate

            consolidate(self.path)  # later there are only new samples

    def open(self) -> "ZarrWriter":
        """A writer of regions."""
        return ZarrWriter(self)

    def sweep(self) -> None:
        """Remove what writers that were killed left behind."""
        for partial in self.path.rglob("*.partial"):
            partial.unlink(missing_ok=True)


class ZarrWriter:
    """Writes regions of a `ZarrStore`."""

    def __init__(self, store: ZarrStore) -> None:
        import zarr

        self._array = zarr.open_array(
            str(store.path), path=store.member or "", mode="r+", config={"write_empty_chunks": True}
        )

    def write(self, region: Slices, values: np.ndarray) -> None:
        """Store `values`: whole chunks, each renamed into its place."""
        self._array[region] = values


Store = NpyStore | ZarrStore
# Endings of the names of what is written tile by tile.
STORES = (".zarr", ".npy")


def store_for(target: Path, path: Path, tiling: Tiling, finer: Grid) -> Store:
    """The kind of store that the name `target` asks for, at `path` while it is unfinished.

    In Zarr, samples with coordinates or a reference system become a member of a group, others an
    array on its own.

    Parameters
    ----------
    finer
        The grid of the output, without its samples.

    Raises
    ------
    InputError
        The name ends in neither ``.zarr`` nor ``.npy``.
    """
    shape, dtype = tiling.fine_shape, finer.values.dtype
    if known_suffix(target, STORES) == ".npy":
        return NpyStore(path, shape, dtype)
    from ..io.formats.zarr import outline_of_group

    beside, member, names, attributes = outline_of_group(finer)
    if not beside.variables:
        return ZarrStore(path, shape, dtype, None, names, attributes)
    return ZarrStore(path, shape, dtype, member, names, attributes, beside)
