"""Zarr folders, versions 3 and 2: groups as xarray writes them, groups in groups, plain arrays."""

import math
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
import zarr
from zarr.errors import ContainsGroupError, NodeTypeValidationError

from ..._grid.grid import Grid, no_samples
from ..._grid.missing import check_dtype
from ..._support.errors import InputError
from ..._support.memory import check_memory
from .datasets import choose_array, dataset_from_grid, grid_from_dataset, outline_from_dataset
from .keys import index_of, parse_key

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


class _Member(NamedTuple):
    """The member that a key chooses: an array that says nothing of its axes, or else a group.

    `key` is what of the key is left for the array or the group, `path` where the group is.
    """

    array: zarr.Array | None
    path: Path
    key: str | None


def read(path: Path, key: str | None) -> Grid:
    """A variable of a group, or the array."""
    member = _find(path, key)
    if member.array is not None:
        return _read_array(member.array, member.key)
    with _open_group(member.path) as data:
        return grid_from_dataset(data, member.key)


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store a group of version 3 with one variable in chunks, and its coordinates."""
    data = dataset_from_grid(grid)
    most = _CHUNK.get(grid.ndim, 64)
    chunks = {"chunks": tuple(min(n, most) for n in grid.shape)}
    encoding = {
        name: {**variable.encoding, **chunks} for name, variable in data.items() if variable.ndim
    }
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
    array, path, key = _find(path, key)
    if array is None:
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
    """All of a group but the samples of a grid, and the name, axes and attributes of these."""
    data = dataset_from_grid(grid)
    name = next(each for each, array in data.items() if array.ndim)
    variable = data[name]
    attributes = {
        str(k): v.tolist() if isinstance(v, np.ndarray) else v for k, v in variable.attrs.items()
    }
    if "grid_mapping" in variable.encoding:
        attributes["grid_mapping"] = variable.encoding["grid_mapping"]
    return data.drop_vars([name]), str(name), tuple(map(str, variable.dims)), attributes


def _find(path: Path, key: str | None) -> _Member:
    """The array or group that a key such as ``NAME,time=3`` or ``GROUP/NAME`` chooses from."""
    try:
        return _Member(zarr.open_array(path, mode="r"), path, key)
    except _NO_ARRAY:
        group = zarr.open_group(path, mode="r", use_consolidated=False)
    first, _, parts = (key or "").partition(",")
    name, rest = ("", key) if "=" in first else (first.strip("/ "), parts or None)
    known = dict(group.arrays())
    if not name and any(_is_field(each) and not _is_plain(each) for each in known.values()):
        return _Member(None, path, key)
    if name not in known:
        known = {
            each: array for each, array in group.members(None) if isinstance(array, zarr.Array)
        }
    if name and name not in known:
        listed = ", ".join(each for each, array in known.items() if array.ndim >= 2)
        raise InputError(f"holds no array {name!r}; it has {listed or 'none'}")
    if not name:
        fields = [each for each, array in known.items() if _is_field(array)]
        if not fields:
            return _Member(None, path, key)
        if len(fields) > 1:
            listed = ", ".join(fields)
            raise InputError(f"holds {len(fields)} fields, choose one with a key: {listed}")
        (name,) = fields
    if _is_plain(known[name]):
        return _Member(known[name], path, rest)
    inner, _, last = name.rpartition("/")
    return _Member(None, path / inner, last + (f",{rest}" if rest else ""))


def _is_field(array: zarr.Array) -> bool:
    return array.ndim >= 2 and array.dtype.kind in "biuf"


def _is_plain(array: zarr.Array) -> bool:
    """Whether the axes have no names, without which xarray does not open a group."""
    named = getattr(array.metadata, "dimension_names", None) or array.attrs.get("_ARRAY_DIMENSIONS")
    return array.ndim > 0 and not named


def _open_group(path: Path) -> xr.Dataset:
    group = zarr.open_group(path, mode="r", use_consolidated=False)
    left_out = []
    for name, array in group.arrays():
        if array.dtype.kind not in "biufc" or _is_plain(array):
            left_out.append(name)
        else:
            _check_codecs(array)
    return xr.open_zarr(
        path,
        consolidated=False,
        decode_times=False,
        decode_coords="all",
        chunks=None,
        drop_variables=left_out,
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
        for branch in tree:
            yield from _codec_names(branch)
