"""NumPy ``.npz`` files: the array and, under fixed keys, its geometry.

Keys, all optional but the first: ``data`` (or the only array of two or more axes), ``dims`` (axis
names), ``units``, one coordinate array per axis under its name, ``affine``, ``spacing``,
``origin``, ``nodata`` and ``valid``, ``crs``, ``metadata`` (JSON).
"""

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..._grid.affine import SKEWED, affine_from_axes, axes_from_affine, is_skewed
from ..._grid.grid import Grid
from ..._grid.missing import mark_missing, numeric, restore_nodata
from ..._support.errors import InputError
from .npy import read_array, read_header

_KEYS = ("dims", "units", "affine", "spacing", "origin", "nodata", "valid", "crs", "metadata")
_RESERVED = frozenset(("data", *_KEYS))


def read(path: Path, key: str | None) -> Grid:
    """The array `key` with the geometry stored beside it."""
    with zipfile.ZipFile(path) as archive:
        headers = _headers(archive)
        name = _choose(headers, key)
        array = _member(archive, name)
        texts_and_numbers = {
            other
            for other, (_, dtype) in headers.items()
            if dtype.kind in "biufU" and other != name
        }
        beside = {other: _member(archive, other) for other in texts_and_numbers & set(_KEYS)}
        axes = _axes(beside, array.ndim)
        coordinates = {
            axis: _member(archive, axis)
            for axis in (texts_and_numbers & set(axes)) - _RESERVED
            if headers[axis][0] == (array.shape[axes.index(axis)],)
        }
    return _assemble(array, axes, beside, coordinates)


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store samples and geometry; missing samples get the nodata value and ``valid`` is False."""
    stored, nodata = restore_nodata(grid)
    entries: dict[str, np.ndarray] = {
        "data": stored,
        "dims": np.array(grid.axes),
        "units": np.array(grid.units),
        "spacing": np.array(grid.spacing),
        "origin": np.array(grid.origin),
    }
    if nodata is not None:
        entries["nodata"] = np.array(nodata)
    if grid.missing is not None:
        entries["valid"] = ~grid.missing
    if grid.crs is not None:
        entries["crs"] = np.array(grid.crs)
    if grid.metadata:
        entries["metadata"] = np.array(json.dumps(dict(grid.metadata)))
    entries |= _coordinates(grid)
    with open(path, "wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **entries)
    return ()


def _coordinates(grid: Grid) -> dict[str, np.ndarray]:
    if grid.affine is None:
        return {}
    coordinates = axes_from_affine(grid.affine, grid.shape)
    if coordinates is None or _RESERVED & set(grid.axes) or 1 in grid.shape:
        return {"affine": grid.affine}
    return dict(zip(grid.axes, coordinates, strict=True))


def _headers(archive: zipfile.ZipFile) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
    headers = {}
    for entry in archive.infolist():
        if entry.filename.endswith(".npy"):
            with archive.open(entry) as stream:
                shape, _, dtype = read_header(stream)
                headers[entry.filename[:-4]] = shape, dtype
    if not headers:
        raise InputError("holds no arrays")
    return headers


def _choose(headers: Mapping[str, tuple[tuple[int, ...], np.dtype]], key: str | None) -> str:
    known = ", ".join(f"{name} {shape}" for name, (shape, _) in headers.items())
    if key is not None:
        if key not in headers:
            raise InputError(f"holds no array {key!r}; it has {known}")
        return key
    if "data" in headers:
        return "data"
    if len(headers) == 1:
        return next(iter(headers))
    grids = [name for name, (shape, _) in headers.items() if len(shape) >= 2]
    if len(grids) != 1:
        raise InputError(f"holds several arrays, choose one with a key: {known}")
    return grids[0]


def _member(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    entry = archive.getinfo(f"{name}.npy")
    with archive.open(entry) as stream:
        return read_array(stream, entry.file_size)


def _axes(beside: Mapping[str, np.ndarray], ndim: int) -> tuple[str, ...]:
    axes = tuple(str(name) for name in beside["dims"].ravel()) if "dims" in beside else ()
    return axes if len(axes) == ndim else ()


def _assemble(
    array: np.ndarray,
    axes: tuple[str, ...],
    beside: Mapping[str, np.ndarray],
    coordinates: Mapping[str, np.ndarray],
) -> Grid:
    samples = numeric(array)
    nodata = beside["nodata"].item() if "nodata" in beside else None
    valid = beside.get("valid")
    if valid is not None and (valid.shape != samples.shape or valid.dtype != bool):
        raise InputError(f"has a 'valid' of {valid.dtype} {valid.shape}; bool {samples.shape} fits")
    values, missing, notes = mark_missing(samples, nodata, None if valid is None else ~valid)
    spacing = _numbers(beside, "spacing")
    affine = _affine(samples.shape, axes, spacing, beside, coordinates)
    if affine is not None and is_skewed(affine):
        notes += (SKEWED,)
    metadata = json.loads(_text(beside, "metadata") or "{}")
    return Grid(
        values,
        spacing=spacing,
        origin=_numbers(beside, "origin"),
        axes=axes,
        units=_text(beside, "units"),
        crs=_text(beside, "crs") or None,
        affine=affine,
        nodata=nodata,
        missing=missing,
        metadata={str(name): str(text) for name, text in metadata.items()},
        notes=notes,
        source_dtype=array.dtype,
    )


def _affine(
    shape: tuple[int, ...],
    axes: tuple[str, ...],
    spacing: tuple[float, ...],
    beside: Mapping[str, np.ndarray],
    coordinates: Mapping[str, np.ndarray],
) -> np.ndarray | None:
    """From ``affine``, or the axes' coordinates; an axis without counts in steps of its spacing."""
    if "affine" in beside:
        return np.asarray(beside["affine"], dtype=np.float64)
    if not coordinates:
        return None
    steps = spacing or (1.0,) * len(shape)
    along = [
        coordinates.get(axis, step * np.arange(n))
        for axis, n, step in zip(axes, shape, steps, strict=True)
    ]
    return affine_from_axes(along, axes)


def _numbers(beside: Mapping[str, np.ndarray], key: str) -> tuple[float, ...]:
    return tuple(float(value) for value in beside[key].ravel()) if key in beside else ()


def _text(beside: Mapping[str, np.ndarray], key: str) -> str:
    return str(beside[key].item()) if key in beside else ""
