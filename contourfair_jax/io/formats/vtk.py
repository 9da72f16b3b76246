"""VTK image data, ``.vti`` and the legacy ``.vtk``, with VTK's own readers and writers.

Text about the samples (units, CRS, nodata, metadata) is stored as field data.
"""

import json
import math
import os
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringArray, vtkStringOutputWindow
from vtkmodules.vtkCommonDataModel import vtkFieldData, vtkImageData
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOLegacy import vtkDataSetReader
from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLImageDataWriter

from ..._grid.grid import Grid
from ..._support.errors import InputError
from ..._support.memory import check_memory, describe_bytes
from .keys import parse_key
from .texts import single_line
from .volumes import (
    SLICE,
    SPATIAL,
    not_kept,
    select,
    to_store,
    to_xyz,
    volume_grid,
    without_place,
    zyx,
)

_COMPONENT = "component"
# Some errors come as warnings.
_SAID = re.compile(r"^(ERROR|.*Warning): In .*\n(?:\w+ \(0x[0-9a-f]+\): )?(.*)", re.MULTILINE)

_LEGACY_TYPES = {
    "int8": "char",
    "uint8": "unsigned_char",
    "int16": "short",
    "uint16": "unsigned_short",
    "int32": "int",
    "uint32": "unsigned_int",
    "int64": "vtktypeint64",
    "uint64": "vtktypeuint64",
    "float32": "float",
    "float64": "double",
}

# Where the size stands in a legacy file; the first bytes are looked through for it.
_DIMENSIONS = re.compile(rb"^\s*DIMENSIONS\s+(\d{1,18})\s+(\d{1,18})\s+(\d{1,18})\s", re.I | re.M)
_HEAD = 2**16
_TITLE_BYTES = 250  # of a legacy file, whose lines may have 256
_TEXTS = ("units", "crs", "nodata", "metadata")


def read(path: Path, key: str | None) -> Grid:
    """A point or cell array of a ``.vti``."""
    reader = vtkXMLImageDataReader()
    reader.SetFileName(os.fspath(path))
    with _Errors():
        reader.UpdateInformation()
    extent = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT())
    shape = [max(high - low + 1, 0) for low, high in zip(extent[::2], extent[1::2], strict=True)]
    arrays = reader.GetNumberOfPointArrays() + reader.GetNumberOfCellArrays()
    check_memory(8 * arrays * math.prod(shape), f"{arrays} arrays of shape {shape}")
    return _grid(_run(reader), key)


def read_legacy(path: Path, key: str | None) -> Grid:
    """A point or cell array of a ``.vtk`` with structured points."""
    _check_size(path)
    reader = vtkDataSetReader()
    reader.SetFileName(os.fspath(path))
    reader.ReadAllScalarsOn()
    reader.ReadAllVectorsOn()
    reader.ReadAllFieldsOn()
    return _grid(_run(reader), key)


def _check_size(path: Path) -> None:
    """Refuse a legacy header that promises what the machine or the file cannot hold."""
    with open(path, "rb") as stream:
        sizes = _DIMENSIONS.search(stream.read(_HEAD))
        present = os.fstat(stream.fileno()).st_size
    if not sizes:
        return  # VTK says what is wrong
    shape = [int(n) for n in sizes.groups()]
    check_memory(8 * math.prod(shape), f"an array of shape {shape}")
    # A sample takes a bit at least, and there are fewer cells than points.
    if math.prod(max(n - 1, 1) for n in shape) > 8 * present:
        raise InputError(
            f"is truncated: its header promises {math.prod(shape)} samples, "
            f"{describe_bytes(present)} are there"
        )


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store compressed point data; missing samples are NaN, or the nodata value of integers."""
    image, notes = _image(grid)
    writer = vtkXMLImageDataWriter()
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetHeaderTypeToUInt64()
    writer.SetFileName(os.fspath(path))
    writer.SetInputData(image)
    with _Errors():
        stored = writer.Write()
    if not stored:
        raise OSError(f"VTK could not write it, error {writer.GetErrorCode()}")
    return notes


def write_legacy(path: Path, grid: Grid) -> tuple[str, ...]:
    """The same as binary structured points, with axes that descend turned round.

    VTK's own writer would round positions to six digits.
    """
    stored = to_store(grid)[0]
    volume, affine, notes = to_xyz(grid, stored)
    if _turned(affine) and SLICE in grid.metadata:
        grid = replace(grid, metadata=without_place(grid.metadata))
        volume, affine, notes = to_xyz(grid, stored)
        notes += ("the place of the slice is left out: the legacy format has no turned axes",)
    linear = affine[:3, :3]
    if _turned(affine):
        raise InputError("the legacy format has no turned axes; use .vti")
    down = tuple(np.flatnonzero(np.diag(linear) < 0).tolist())
    first = affine[:3, 3] + linear @ ((np.array(volume.shape) - 1) * np.isin(range(3), down))
    volume = np.flip(volume, down)
    name = re.sub(r"\s+", "_", single_line(grid.metadata.get("name", "")) or "data")
    header = f"""# vtk DataFile Version 3.0
{single_line(grid.metadata.get("title", ""), _TITLE_BYTES) or "samples"}
BINARY
DATASET STRUCTURED_POINTS
DIMENSIONS {_numbers(volume.shape)}
SPACING {_numbers(np.abs(np.diag(linear)))}
ORIGIN {_numbers(first)}
POINT_DATA {volume.size}
SCALARS {name} {_LEGACY_TYPES[volume.dtype.name]} 1
LOOKUP_TABLE default
"""
    big_endian = volume.astype(volume.dtype.newbyteorder(">"), copy=False)
    path.write_bytes(header.encode() + big_endian.tobytes(order="F") + b"\n")
    return notes + not_kept(grid, "legacy VTK", "units", "crs", "nodata")


def _turned(affine: np.ndarray) -> bool:
    linear = affine[:3, :3]
    return bool(np.count_nonzero(linear) > 3 or not np.diag(linear).all())


class _Errors:
    """VTK only prints its errors; within this block the first one is raised at the end."""

    def __enter__(self) -> None:
        self._before = vtkOutputWindow.GetInstance()
        self._window = vtkStringOutputWindow()
        vtkOutputWindow.SetInstance(self._window)

    def __exit__(self, kind, error, trace) -> None:
        messages = _SAID.findall(self._window.GetOutput() or "")
        errors = [text for kind, text in messages if kind == "ERROR" or "error" in text.lower()]
        vtkOutputWindow.SetInstance(self._before)
        if error is None and errors:
            raise InputError(f"is damaged or no image data ({errors[0].strip()})")


def _run(reader) -> vtkImageData:
    with _Errors():
        reader.Update()
    image = reader.GetOutput()
    if not isinstance(image, vtkImageData):
        name = "nothing" if image is None else f"a {image.GetClassName()}"
        raise InputError(f"holds {name}; image data (structured points) is needed")
    return image


def _grid(image: vtkImageData, key: str | None) -> Grid:
    name, parts = parse_key(key)
    array, cells = _choose(image, name)
    shape = [max(n - cells, 1) for n in image.GetDimensions()][::-1]
    count = array.GetNumberOfComponents()
    if array.GetNumberOfTuples() != int(np.prod(shape)):
        raise InputError(f"is damaged: {array.GetName()!r} does not fit the image")
    values = vtk_to_numpy(array).reshape(*shape, count)
    axes, values = (_COMPONENT, *SPATIAL), np.moveaxis(values, -1, 0)
    rest = ",".join(f"{axis}={_written(part)}" for axis, part in parts.items())
    index = select(rest or None, axes, values.shape)
    texts = _texts(image.GetFieldData())
    notes = ("cell data: the samples lie at the centres of the cells",) if cells else ()
    metadata = json.loads(texts.get("metadata", "{}"))
    return volume_grid(
        values[index],
        shape,
        index[1:],
        zyx(_affine(image, cells)),
        units=texts.get("units", ""),
        crs=texts.get("crs"),
        nodata=float(texts["nodata"]) if "nodata" in texts else None,
        metadata={"name": array.GetName() or "data", **metadata},
        notes=notes,
    )


def _written(part: int | slice) -> str:
    if isinstance(part, int):
        return str(part)
    return f"{'' if part.start is None else part.start}:{'' if part.stop is None else part.stop}"


def _choose(image: vtkImageData, name: str | None):
    """The array called `name`, or the active scalars, or the only one; whether of cells."""
    arrays = [
        (data.GetArray(k), cells)
        for cells, data in enumerate((image.GetPointData(), image.GetCellData()))
        for k in range(data.GetNumberOfArrays())
        if data.GetArray(k) is not None
    ]
    known = ", ".join(
        f"{array.GetName()} ({array.GetNumberOfComponents()} per {'cell' if cells else 'point'})"
        for array, cells in arrays
    )
    if name is not None:
        arrays = [pair for pair in arrays if pair[0].GetName() == name]
        if not arrays:
            raise InputError(f"holds no array {name!r}; it has {known or 'none'}")
        return arrays[0]
    active = image.GetPointData().GetScalars()
    if active is not None:
        return active, 0
    if len(arrays) != 1:
        raise InputError(f"holds {len(arrays)} arrays, choose one with a key: {known}")
    return arrays[0]


def _affine(image: vtkImageData, cells: int) -> np.ndarray:
    """Index to world, x first; cells lie half a step beyond the point of the same index."""
    matrix = image.GetDirectionMatrix()
    direction = np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
    first = np.array(image.GetExtent()[::2], float)
    if cells:
        first += np.where(np.array(image.GetDimensions()) > 1, 0.5, 0.0)
    affine = np.eye(4)
    affine[:3, :3] = direction * np.array(image.GetSpacing())
    affine[:3, 3] = np.array(image.GetOrigin()) + affine[:3, :3] @ first
    return affine


def _texts(data: vtkFieldData) -> dict[str, str]:
    texts = {}
    for name in _TEXTS:
        array = data.GetAbstractArray(name)
        if isinstance(array, vtkStringArray) and array.GetNumberOfValues() == 1:
            texts[name] = array.GetValue(0)
    return texts


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(value) for value in np.asarray(values).tolist())


def _image(grid: Grid) -> tuple[vtkImageData, tuple[str, ...]]:
    """Point data with one array, and the texts."""
    stored, nodata = to_store(grid)
    volume, affine, notes = to_xyz(grid, stored)
    steps = np.sqrt((affine[:3, :3] ** 2).sum(axis=0))
    image = vtkImageData()
    image.SetDimensions(*volume.shape)
    image.SetSpacing(*steps)
    image.SetOrigin(*affine[:3, 3])
    image.SetDirectionMatrix(*(affine[:3, :3] / steps).ravel())
    array = numpy_to_vtk(volume.ravel(order="F"), deep=True)
    array.SetName(grid.metadata.get("name") or "data")
    image.GetPointData().SetScalars(array)
    metadata = without_place(grid.metadata)
    texts = {
        "units": grid.units,
        "crs": grid.crs,
        "nodata": nodata,
        "metadata": json.dumps(metadata) if metadata else "",
    }
    for name, text in texts.items():
        if text not in (None, ""):
            field = vtkStringArray()
            field.SetName(name)
            field.InsertNextValue(str(text))
            image.GetFieldData().AddArray(field)
    return image, notes
