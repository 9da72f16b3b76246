"""MetaImage (``.mha``, and ``.mhd`` with its data beside it) with SimpleITK."""

import os
import re
from pathlib import Path

import numpy as np
import SimpleITK as sitk

from ..._grid.grid import Grid
from ..._support.errors import InputError
from ..._support.memory import check_memory
from .texts import header_lines
from .volumes import LPS, in_space, select, to_store, to_xyz, volume_grid, without_place, zyx

_IMAGE = "MetaImageIO"
_COMPONENT = "component"
# What the library adds of its own.
_OWN = re.compile(r"ITK_|Modality$")
# Fields of the header that say how the samples are read.
_LAYOUT = re.compile(r"Header|Element|Orientation$|DimSize$|NDims$")
# Bytes of a text: the library reads no header with longer lines.
_LONGEST = 32_000


def read(path: Path, key: str | None) -> Grid:
    """A volume or an image; of a time series or of vectors the part that `key` numbers."""
    _check_data_files(path)
    reader = sitk.ImageFileReader()
    reader.SetImageIO(_IMAGE)
    reader.SetFileName(os.fspath(path))
    reader.ReadImageInformation()
    sizes, components = list(reader.GetSize()), reader.GetNumberOfComponents()
    check_memory(int(np.prod([8, components, *sizes], dtype=object)), f"an array of {sizes}")
    image = reader.Execute()
    values = sitk.GetArrayFromImage(image)
    axes = ("t", "z", "y", "x")[-len(sizes) :]
    if components > 1:
        values, axes = np.moveaxis(values, -1, 0), (_COMPONENT, *axes)
    index = select(key, axes, values.shape)
    ndim = min(len(sizes), 3)
    texts = {name: image.GetMetaData(name) for name in image.GetMetaDataKeys()}
    nodata = texts.pop("nodata", None)
    metadata = {"space": LPS} if ndim == 3 else {}
    return volume_grid(
        values[index],
        values.shape[-ndim:],
        index[-ndim:],
        zyx(_affine(image, ndim)),
        units=texts.pop("units", ""),
        crs=texts.pop("crs", None),
        nodata=None if nodata is None else float(nodata),
        metadata=metadata | {name: texts[name] for name in texts if not _OWN.match(name)},
        source_dtype=values.dtype,
    )


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store one compressed file; units, CRS and nodata become text in its header."""
    return _write(path, grid, compressed=True)


def write_header(path: Path, grid: Grid) -> tuple[str, ...]:
    """The same as a header with a ``.raw`` file of the plain samples beside it."""
    return _write(path, grid, compressed=False)


def _write(path: Path, grid: Grid, compressed: bool) -> tuple[str, ...]:
    stored, nodata = to_store(grid)
    volume, affine, notes = to_xyz(grid, stored)
    affine = in_space(affine, grid, LPS)
    steps = np.sqrt((affine[:3, :3] ** 2).sum(axis=0))
    image = sitk.GetImageFromArray(np.ascontiguousarray(volume.T))
    image.SetSpacing(steps.tolist())
    image.SetOrigin(affine[:3, 3].tolist())
    image.SetDirection((affine[:3, :3] / steps).ravel().tolist())
    texts = {"units": grid.units, "crs": grid.crs, "nodata": nodata}
    texts |= without_place(grid.metadata)
    lines = header_lines(texts, _LONGEST)
    if lines != header_lines(texts):
        notes += (f"texts are cut to {_LONGEST} bytes, more than which MetaImage readers refuse",)
    for name, text in lines.items():
        if name != "space" and not _LAYOUT.match(name):
            image.SetMetaData(name, text)
    writer = sitk.ImageFileWriter()
    writer.SetImageIO(_IMAGE)
    writer.SetFileName(os.fspath(path))
    writer.SetUseCompression(compressed)
    writer.Execute(image)
    return notes


def _affine(image: sitk.Image, ndim: int) -> np.ndarray:
    """Index to world, x first, of the first `ndim` axes."""
    n = image.GetDimension()
    direction = np.reshape(image.GetDirection(), (n, n))[:ndim, :ndim]
    affine = np.eye(ndim + 1)
    affine[:ndim, :ndim] = direction * np.asarray(image.GetSpacing()[:ndim])
    affine[:ndim, ndim] = image.GetOrigin()[:ndim]
    return affine


def _check_data_files(path: Path) -> None:
    """Refuse a header whose data are not in regular files: a pipe would be waited for."""
    with open(path, "rb") as stream:
        head = stream.read(2**16).decode("latin-1")
    for line in head.splitlines():
        name, _, value = line.partition("=")
        value = value.strip()
        if name.strip() == "ElementDataFile" and value not in ("LOCAL", "Local", "local"):
            listed = value.split()[0] if value else ""
            if listed != "LIST" and "%" not in value and not (path.parent / value).is_file():
                raise InputError(f"names the data file {value!r}, which is not there")
            return
