"""Zarr folders, versions 3 and 2: a group as xarray writes it, or a plain array."""

import math
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr
from zarr.errors import ContainsGroupError, NodeTypeValidationError

from ._dataset import (
    choose_array,
    dataset_from_grid,
    grid_from_dataset,
    outline_from_dataset,
)
from ._errors import InputError
from ._grid import Grid, no_samples
from ._key import index_of, parse_key
from ._limits import check_memory
from ._missing import check_dtype

# Chunks have at most so many samples along each axis.
_CHUNK = {2: 1024, 3: 128}

# What the library says of a group that is opened as an array: of version 3, and of version 2.
_NO_ARRAY = (ContainsGroupError, NodeTypeValidationError, FileNotFoundError)

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
    except _NO_ARRAY:
        return _read_group(path, key)
    return _read_array(array, key)


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store a group of version 3 with one variable in chunks, and its coordinates."""
    data = dataset_from_grid(grid)
    most = _CHUNK.get(grid.ndim, 64)
    chunks = {"chunks": tuple(min(n, most) for n in grid.shape)}
    encoding = {name: {**each.encoding, **chunks} for name, each in data.items() if each.ndim}
    data.to_zarr(path, mode="w", zarr_format=3, consolidated=False, encoding=encoding)
    consolidate(path)
    return ()


def consolidate(path: Path) -> None:
    """Gather the metadata of all arrays of a finished group at its top, where xarray looks first.

    Version 3 has no word on that yet, of which the library warns; readers may pass over it.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Consolidated metadata is currently not part")
        zarr.consolidate_metadata(path)


def read_outline(path: Path, key: str | None) -> tuple[Grid, Any]:
    """A grid without its samples, and an array of these that reads what is sliced."""
    try:
        array = zarr.open_array(path, mode="r")
    except _NO_ARRAY:
        data = _open_group(path)
        chosen = choose_array(data, key)
        return outline_from_dataset(data, chosen), chosen
    if key is not None:
        raise InputError(f"holds one array of {array.ndim} axes; parts of it are not read in tiles")
    check_dtype(array.dtype)
    _check_codecs(array)
    values = no_samples(array.shape, array.dtype)
    return Grid(values, axes=tuple(_dims(array)), source_dtype=array.dtype), array


def outline_of_group(grid: Grid) -> tuple[xr.Dataset, str, tuple[str, ...], dict[str, Any]]:
    """What a group holds beside the samples of a grid, and their name, axes and attributes."""
    data = dataset_from_grid(grid)
    name = next(each for each, array in data.items() if array.ndim)
    variable = data[name]
    attributes = {
        str(k): v.tolist() if isinstance(v, np.ndarray) else v for k, v in variable.attrs.items()
    }
    if "grid_mapping" in variable.encoding:
        attributes["grid_mapping"] = variable.encoding["grid_mapping"]
    return data.drop_vars([name]), str(name), tuple(map(str, variable.dims)), attributes


def _read_group(path: Path, key: str | None) -> Grid:
    with _open_group(path) as data:
        return grid_from_dataset(data, key)


def _open_group(path: Path) -> xr.Dataset:
    group = zarr.open_group(path, mode="r", use_consolidated=False)
    texts = []
    for name, array in group.arrays():
        if array.dtype.kind in "biufc":
            _check_codecs(array)
        else:
            texts.append(name)
    return xr.open_zarr(
        path,
        consolidated=False,
        decode_times=False,
        decode_coords="all",
        chunks=None,
        drop_variables=texts,
    )


def _read_array(array: zarr.Array, key: str | None) -> Grid:
    """An array on its own says nothing about place; names of axes and attributes are kept."""
    check_dtype(array.dtype)
    _check_codecs(array)
    name, parts = parse_key(key)
    if name is not None:
        raise InputError(f"holds one array, so there is no {name!r} to choose")
    dims = _dims(array)
    index = index_of(parts, dims, array.shape)
    left = [dim for dim, part in zip(dims, index, strict=True) if isinstance(part, slice)]
    check_memory(8 * math.prod(array.shape), f"an array of shape {array.shape}")
    values = xr.DataArray(np.asarray(array[index]), dims=left, attrs=dict(array.attrs))
    whole = ",".join(f"{dim}=:" for dim in left)
    return grid_from_dataset(values.to_dataset(name="data"), f"data,{whole}" if left else "data")


def _dims(array: zarr.Array) -> list[str]:
    spatial = ("z", "y", "x")[-array.ndim :]
    plain = ("",) * (array.ndim - len(spatial)) + spatial
    named = getattr(array.metadata, "dimension_names", None) or plain
    return [named[k] if k < len(named) and named[k] else f"axis{k}" for k in range(array.ndim)]


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
