"""NRRD with pynrrd: space directions, units and text; a header may name a data file beside it."""

import bz2
import contextlib
import gzip
import io
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import nrrd
import numpy as np

from ..._grid.grid import Grid
from ..._support.errors import InputError
from ..._support.memory import check_memory, describe_bytes
from .texts import header_lines, single_line
from .volumes import (
    SPATIAL,
    canonical_space,
    select,
    to_store,
    to_xyz,
    volume_grid,
    without_place,
    zyx,
)

# Kinds of axes along which space or the domain extends.
_DOMAIN = frozenset(("domain", "space", "???", "none"))

# Fields that are decoded or describe the layout; all others are kept as text.
_DECODED = frozenset(
    re.split(
        r",\s*",
        "type, dimension, sizes, endian, encoding, kinds, labels, units, spacings, thicknesses, "
        "centers, centerings, space, space dimension, space directions, space origin, space units, "
        "sample units, measurement frame, axis mins, axismins, axis maxs, axismaxs, data file, "
        "datafile, line skip, lineskip, byte skip, byteskip, number, min, max, old min, oldmin, "
        "old max, oldmax, nodata, crs",
    )
)

_COMPRESSED = {
    "gzip": gzip.open,
    "gz": gzip.open,
    "bzip2": bz2.open,
    "bz2": bz2.open,
}

_PIECE = 2**20


def read(path: Path, key: str | None) -> Grid:
    """A volume or an image; of further axes, such as time, the sample that `key` numbers."""
    with open(path, "rb") as stream:
        header = nrrd.read_header(stream)
        sizes = _check(header, path)
        if header.get("encoding") in _COMPRESSED:
            values = _inflated(header, sizes, stream, path)
        else:
            values = nrrd.read_data(header, stream, os.fspath(path), index_order="C")
    axes = _axes(header, len(sizes))
    index = select(key, axes, values.shape)
    spatial = [k for k, axis in enumerate(axes) if axis in SPATIAL]
    space = str(header.get("space", ""))
    metadata = {
        "space": canonical_space(space) or space,
        "space units": next(iter(header.get("space units", [])), ""),
        **{name: str(value) for name, value in header.items() if name not in _DECODED},
    }
    return volume_grid(
        values[index],
        [values.shape[k] for k in spatial],
        [index[k] for k in spatial],
        _affine(header, [len(sizes) - 1 - k for k in spatial[::-1]]),
        units=header.get("sample units", ""),
        crs=header.get("crs"),
        nodata=float(header["nodata"]) if "nodata" in header else None,
        metadata={name: text for name, text in metadata.items() if text},
        source_dtype=values.dtype,
    )


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store one compressed file; the nodata value and the CRS become text in its header."""
    return _write(path, grid, "gzip")


def write_header(path: Path, grid: Grid) -> tuple[str, ...]:
    """The same as a header with a ``.raw`` file of the plain samples beside it."""
    return _write(path, grid, "raw")


def _write(path: Path, grid: Grid, encoding: str) -> tuple[str, ...]:
    stored, nodata = to_store(grid)
    volume, affine, notes = to_xyz(grid, stored)
    space = grid.metadata.get("space", "")
    own = {"sample units": grid.units, "crs": grid.crs, "nodata": nodata}
    texts = header_lines(without_place(grid.metadata))
    texts = {name: text for name, text in texts.items() if name not in _DECODED}
    texts |= header_lines(own)
    plain = {_ascii(name): _ascii(text) for name, text in texts.items()}
    if plain != texts:
        notes += ("NRRD headers are ASCII: other characters of its texts are now ?",)
    header: dict[str, Any] = {
        **plain,
        **({"space": space} if canonical_space(space) else {"space dimension": 3}),
        "space directions": affine[:3, :3].T,
        "space origin": affine[:3, 3],
        "kinds": ["domain"] * 3,
        "encoding": encoding,
    }
    if "space units" in grid.metadata:
        length = _ascii(single_line(grid.metadata["space units"]).replace('"', ""))
        header["space units"] = [length] * 3
    nrrd.write(os.fspath(path), volume, header, index_order="F")  # two files for ``.nhdr``
    return notes


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode("ascii")


def _check(header: Mapping[str, Any], path: Path) -> list[int]:
    """The sizes; refuses what is damaged, too large, or names a data file that is none."""
    sizes = [int(n) for n in header.get("sizes", ())]
    if not sizes or min(sizes) < 1:
        raise InputError(f"has a damaged header (sizes {sizes})")
    check_memory(int(np.prod([8, *sizes], dtype=object)), f"an array of sizes {sizes}")
    beside = _field(header, "data file")
    if beside is not None and not (path.parent / beside).is_file():
        raise InputError(f"names the data file {beside!r}, which is not there; keep both together")
    return sizes


def _inflated(
    header: Mapping[str, Any], sizes: list[int], stream: IO[bytes], path: Path
) -> np.ndarray:
    """Compressed samples, slowest axis first.

    The library would inflate all that is there, which a small file can make any amount of.
    """
    plain = {"type": header["type"], "encoding": "raw", "dimension": 1, "sizes": np.array([1])}
    plain |= {"endian": header["endian"]} if "endian" in header else {}
    dtype = nrrd.read_data(plain, io.BytesIO(bytes(16))).dtype
    promised = dtype.itemsize * math.prod(sizes)
    lines, skipped = (int(_field(header, name) or 0) for name in ("line skip", "byte skip"))
    if min(lines, skipped) < 0:
        raise InputError(f"skips {lines} lines and {skipped} bytes of compressed samples")
    beside = _field(header, "data file")
    with contextlib.ExitStack() as opened:
        if beside is not None:
            stream = opened.enter_context(open(path.parent / beside, "rb"))
        for _ in range(lines):
            stream.readline()
        inflating = opened.enter_context(_COMPRESSED[header["encoding"]](stream))
        inflating.seek(skipped)
        data = bytearray()
        # One byte more, to see that there is none.
        while piece := inflating.read(min(promised + 1 - len(data), _PIECE)):
            data += piece
    if len(data) != promised:
        more = "more" if len(data) > promised else f"only {describe_bytes(len(data))}"
        raise InputError(f"promises {describe_bytes(promised)} of samples, but holds {more}")
    return np.frombuffer(data, dtype).reshape(sizes[::-1])


def _field(header: Mapping[str, Any], name: str) -> Any:
    """A field whose name may be written without its space; None where it is not there."""
    return header.get(name, header.get(name.replace(" ", "")))


def _axes(header: Mapping[str, Any], ndim: int) -> tuple[str, ...]:
    """Names of the array's axes, slowest first: x, y, z, and labels of the others."""
    kinds = header.get("kinds", ["domain"] * ndim)
    labels = header.get("labels", [""] * ndim)
    directions = header.get("space directions")
    names, free = [], ["z", "y", "x"]
    for k in range(ndim):
        spatial = kinds[k] in _DOMAIN and (directions is None or _is_direction(directions[k]))
        names.append(free.pop() if spatial and free else labels[k] or f"axis{k}")
    return tuple(names[::-1])


def _is_direction(vector: Any) -> bool:
    return vector is not None and bool(np.isfinite(vector).all())


def _affine(header: Mapping[str, Any], spatial: list[int]) -> np.ndarray | None:
    """Index to world of the axes `spatial` of the file, slowest first; None where unknown."""
    ndim = len(spatial)
    affine = np.eye(ndim + 1)
    if "space directions" in header:
        linear = np.array([header["space directions"][k] for k in spatial], np.float64).T
        if linear.shape == (ndim, ndim):
            affine[:ndim, :ndim] = linear
            affine[:ndim, ndim] = header.get("space origin", 0.0)
        else:
            affine[:ndim, :ndim] = np.diag(np.sqrt((linear**2).sum(axis=0)))
    elif "spacings" in header:
        steps = np.abs(np.asarray(header["spacings"], np.float64)[spatial])
        affine[:ndim, :ndim] = np.diag(np.where(np.isnan(steps), 1.0, steps))
    else:
        return None
    return zyx(affine)
