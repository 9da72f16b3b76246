"""NIfTI with nibabel: the affine map, scaled values, one volume of a time series.

What else the header says of the samples (what their place refers to, their statistic, the range to
show) is kept as text under the names that NIfTI gives it.
"""

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from nibabel.arrayproxy import ArrayProxy
from nibabel.loadsave import load, save
from nibabel.nifti1 import Nifti1Header, Nifti1Image, unit_codes, xform_codes

from ..._grid.grid import Grid, exact_float
from ..._grid.missing import check_dtype
from ..._support.errors import InputError
from ..._support.memory import check_memory
from .volumes import RAS, in_space, not_kept, select, to_store, to_xyz, volume_grid, zyx

_AXES = ("x", "y", "z", "t", "u", "v", "w")
# Fields of the header: those of text, with their name here and most bytes, and those of numbers.
_TEXTS = {"descrip": ("description", 79), "intent_name": ("intent_name", 15)}
_NUMBERS = ("intent_code", "intent_p1", "intent_p2", "intent_p3", "cal_min", "cal_max")
_ALIGNED = "2"  # the place refers to another image: what is written where nothing is known


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
    scaled = (slope, inter) != (1.0, 0.0)
    if scaled:
        values = values.astype(exact_float(stored), copy=False)
        notes = (f"packed values are decoded: {slope:g} * stored + {inter:g}",)
    placed = bool(header["sform_code"] or header["qform_code"])
    steps = (*header.get_zooms(), 1.0, 1.0)[:3]
    affine = np.asarray(image.affine, np.float64) if placed else np.diag([*steps, 1.0])
    length, _ = header.get_xyzt_units()
    metadata = {
        "space": RAS if placed else "",
        "space units": "" if length == "unknown" else length,
        **_described(header),
    }
    if placed:
        codes, code_notes = _codes(header)
        metadata |= codes
        notes += code_notes
    if header.extensions:
        notes += (f"extensions of the header are left out: {len(header.extensions)}",)
    return volume_grid(
        values,
        shape[:3][::-1],
        index[-3:],
        zyx(affine),
        metadata={name: text for name, text in metadata.items() if text},
        notes=notes,
        source_dtype=None if scaled else stored,
    )


def write(path: Path, grid: Grid) -> tuple[str, ...]:
    """Store one volume, or an image as a volume of one slice; missing samples are NaN."""
    volume, affine, notes = to_xyz(grid, to_store(grid)[0])
    affine = in_space(affine, grid, RAS)
    image = Nifti1Image(volume, affine, dtype=volume.dtype)
    _place(image, affine, grid.metadata)
    length = grid.metadata.get("space units", "unknown")
    if length in unit_codes.value_set("label"):
        image.header.set_xyzt_units(length)
    _describe(image.header, grid.metadata)
    save(image, os.fspath(path))
    if not np.allclose(affine.astype(np.float32), affine, rtol=0, atol=1e-3 * min(grid.spacing)):
        notes += ("NIfTI keeps positions in single precision: here that moves samples",)
    return notes + not_kept(grid, "NIfTI", "units", "crs", "nodata")


def _codes(header: Nifti1Header) -> tuple[dict[str, str], tuple[str, ...]]:
    """Codes of the two maps of a header by name, and a note where only one map can be kept."""
    codes = {name: str(int(header[name])) for name in ("sform_code", "qform_code")}
    sform: Any = header.get_sform()
    qform: Any = header.get_qform()
    if "0" in codes.values() or np.allclose(sform, qform, atol=1e-3):
        return codes, ()
    return {**codes, "qform_code": "0"}, ("the qform is left out: the sform is another map",)


def _place(image: Nifti1Image, affine: np.ndarray, metadata: Mapping[str, str]) -> None:
    """Set both maps, with the codes of the file that the grid came from."""
    known = {str(code) for code in xform_codes.value_set("code")}
    sform, qform = (metadata.get(name, _ALIGNED) for name in ("sform_code", "qform_code"))
    if not {sform, qform} <= known or sform == qform == "0":
        sform = qform = _ALIGNED
    image.set_sform(affine, code=int(sform))
    image.set_qform(affine, code=int(qform))


def _described(header: Nifti1Header) -> dict[str, str]:
    """The fields that are set, as text."""
    texts = {
        name: bytes(header[field]).decode("latin-1").strip("\0 ")
        for field, (name, _) in _TEXTS.items()
    }
    numbers = {name: header[name].item() for name in _NUMBERS}
    return texts | {
        name: f"{value:.9g}" for name, value in numbers.items() if value and np.isfinite(value)
    }


def _describe(header: Nifti1Header, metadata: Mapping[str, str]) -> None:
    """Set the fields from text; numbers that are none are passed over."""
    for field, (name, most) in _TEXTS.items():
        header[field] = metadata.get(name, "").encode("ascii", "replace")[:most]
    for name in _NUMBERS:
        with suppress(ValueError, OverflowError):
            kind: Any = header[name].dtype.type
            header[name] = kind(float(metadata.get(name, 0)))
