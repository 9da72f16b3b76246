"""Zarr folders, versions 3 and 2: a group as xarray writes it, or a plain array."""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr
from zarr.errors import ContainsGroupError, NodeTypeValidationError

from ._dataset import dataset_from_grid, grid_from_dataset
from ._errors import InputError, one_line
from ._grid import Grid
from ._key import index_of, parse_key
from ._limits import check_memory
from ._missing import check_dtype

# Chunks have at most so many samples along each axis.
_CHUNK = {2: 1024, 3: 128}

# Codecs that turn bytes into numbers and nothing else: others can run code (numcodecs' pickle).
_CODECS = frozenset(
    re.split(
        r",\s*",
        "bytes, endian, transpose, sharding_indexed, shuffle, delta, packbits, astype, gzip, zlib, "
        "bz2, lzma, zstd, lz4, blosc, fixedscaleoffset, quantize, bitround, crc32, crc32c, "
        "adler32, fletcher32",
    )
)


def read(path: Path, key: str | None) -> Grid:
    """A variable of a group, or the array."""
    try:
        array = zarr.open_array(path, mode="r")
    except (ContainsGroupError, NodeTypeValidationError):
        return _read_group(path, key)
    return _read_array(array, key)


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store a group of version 3 with one variable in chunks, and its coordinates."""
    data = dataset_from_grid(grid)
    most = _CHUNK.get(grid.ndim, 64)
    chunks = {"chunks": tuple(min(n, most) for n in grid.shape)}
    encoding = {name: {**each.encoding, **chunks} for name, each in data.items() if each.ndim}
    data.to_zarr(path, mode="w", zarr_format=3, consolidated=False, encoding=encoding)
    return ()


def open_array(path: Path) -> zarr.Array:
    """A Zarr array on its own, for reading part by part; its codecs are checked.

    Raises
    ------
    InputError
        The folder is no such array.
    """
    try:
        array = zarr.open_array(path, mode="r")
    except Exception as error:
        raise InputError(f"{path}: is not a Zarr array ({one_line(error)})") from error
    check_dtype(array.dtype)
    _check_codecs(array)
    return array


def _read_group(path: Path, key: str | None) -> Grid:
    group = zarr.open_group(path, mode="r", use_consolidated=False)
    texts = []
    for name, array in group.arrays():
        if array.dtype.kind in "biufc":
            _check_codecs(array)
        else:
            texts.append(name)
    with xr.open_zarr(
        path,
        consolidated=False,
        decode_times=False,
        decode_coords="all",
        chunks=None,
        drop_variables=texts,
    ) as data:
        return grid_from_dataset(data, key)


def _read_array(array: zarr.Array, key: str | None) -> Grid:
    """An array on its own says nothing about place; names of axes and attributes are kept."""
    check_dtype(array.dtype)
    _check_codecs(array)
    name, parts = parse_key(key)
    if name is not None:
        raise InputError(f"holds one array, so there is no {name!r} to choose")
    named = getattr(array.metadata, "dimension_names", None) or ("z", "y", "x")[-array.ndim :]
    dims = [named[k] if k < len(named) and named[k] else f"axis{k}" for k in range(array.ndim)]
    index = index_of(parts, dims, array.shape)
    left = [dim for dim, part in zip(dims, index, strict=True) if isinstance(part, slice)]
    check_memory(8 * math.prod(array.shape), f"an array of shape {array.shape}")
    values = xr.DataArray(np.asarray(array[index]), dims=left, attrs=dict(array.attrs))
    whole = ",".join(f"{dim}=:" for dim in left)
    return grid_from_dataset(values.to_dataset(name="data"), f"data,{whole}" if left else "data")


def _check_codecs(array: zarr.Array) -> None:
    """Refuse codecs that are not known to be harmless, before any chunk is decoded."""
    metadata: Any = array.metadata.to_dict()
    used = [metadata.get(name) for name in ("codecs", "filters", "compressor")]
    for name in _codec_names(used):
        if name.removeprefix("numcodecs.") not in _CODECS:
            raise InputError(f"{array.name or 'it'} uses the codec {name!r}, which is not trusted")


def _codec_names(tree: Any) -> Iterator[str]:
    if isinstance(tree, dict):
        yield from (str(tree[name]) for name in ("name", "id") if name in tree)
        tree = list(tree.values())
    if isinstance(tree, list | tuple):
        for each in tree:
            yield from _codec_names(each)
