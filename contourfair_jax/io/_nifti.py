"""NIfTI with nibabel: the affine map, scaled values, one volume of a time series."""

import os
from pathlib import Path

import numpy as np
from nibabel.arrayproxy import ArrayProxy
from nibabel.loadsave import load, save
from nibabel.nifti1 import Nifti1Image, unit_codes

from ._errors import InputError
from ._grid import Grid, exact_float
from ._limits import check_memory
from ._missing import check_dtype
from ._volume import RAS, in_space, not_kept, select, to_store, to_xyz, volume_grid, zyx

_AXES = ("x", "y", "z", "t", "u", "v", "w")


def read(path: Path, key: str | None) -> Grid:
    """A volume; of a time series the one that `key` numbers."""
    image = load(os.fspath(path))
    data = getattr(image, "dataobj", None)
    if not (isinstance(image, Nifti1Image) and isinstance(data, ArrayProxy)):
        raise InputError(f"holds a {type(image).__name__}, not a NIfTI image")
    header, stored = image.header, image.header.get_data_dtype()
    check_dtype(stored)
    shape = image.shape + (1,) * (3 - len(image.shape))
    if min(shape) < 1 or len(shape) > len(_AXES):
        raise InputError(f"has a damaged header (shape {shape})")
    axes = _AXES[: len(shape)][::-1]
    index = select(key, axes, shape[::-1])
    check_memory(int(np.prod(shape[:3], dtype=object)) * 8, f"a volume of {shape[:3]} samples")
    values = np.asarray(data.reshape(shape)[index[::-1]]).T
    slope, inter = data.slope, data.inter
    notes: tuple[str, ...] = ()
    if (slope, inter) != (1.0, 0.0):
        values = values.astype(exact_float(stored), copy=False)
        notes = (f"packed values are decoded: {slope:g} * stored + {inter:g}",)
    placed = bool(header["sform_code"] or header["qform_code"])
    steps = (*header.get_zooms(), 1.0, 1.0)[:3]
    affine = np.asarray(image.affine, np.float64) if placed else np.diag([*steps, 1.0])
    length, _ = header.get_xyzt_units()
    metadata = {
        "space": RAS if placed else "",
        "space units": "" if length == "unknown" else length,
        "description": bytes(header["descrip"]).decode("latin-1").strip("\0 "),
    }
    return volume_grid(
        values,
        shape[:3][::-1],
        index[-3:],
        zyx(affine),
        metadata={name: text for name, text in metadata.items() if text},
        notes=notes,
        source_dtype=None if notes else stored,
    )


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store one volume, or an image as a volume of one slice; missing samples are NaN."""
    volume, affine, notes = to_xyz(grid, to_store(grid)[0])
    affine = in_space(affine, grid, RAS)
    image = Nifti1Image(volume, affine, dtype=volume.dtype)
    image.set_sform(affine, code=2)
    image.set_qform(affine, code=2)
    length = grid.metadata.get("space units", "unknown")
    if length in unit_codes.value_set("label"):
        image.header.set_xyzt_units(length)
    image.header["descrip"] = grid.metadata.get("description", "").encode("ascii", "replace")[:79]
    save(image, os.fspath(path))
    if not np.allclose(affine.astype(np.float32), affine, rtol=0, atol=1e-3 * min(grid.spacing)):
        notes += ("NIfTI keeps positions in single precision: here that moves samples",)
    return notes + not_kept(grid, "NIfTI", "units", "crs", "nodata")
