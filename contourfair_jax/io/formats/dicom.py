"""DICOM with pydicom, read only: one image, a multi-frame volume, or a folder of slices.

Names and numbers of patients are left out of the metadata.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pydicom
from pydicom.dataset import Dataset
from pydicom.errors import InvalidDicomError

from ..._grid.grid import Grid, exact_float
from ..._support.errors import InputError
from ..._support.memory import check_memory
from .keys import Part
from .volumes import LPS, SPATIAL, select, volume_grid, zyx

# How far a slice may lie from its even place, in slices; how far directions may differ.
_UNEVEN, _TURNED = 0.02, 1e-3
_KEPT = {"Modality": "modality", "SeriesDescription": "description", "BodyPartExamined": "part"}

# Where files of many frames keep what others have at their top.
_GROUP = {
    "PixelSpacing": "PixelMeasuresSequence",
    "SliceThickness": "PixelMeasuresSequence",
    "SpacingBetweenSlices": "PixelMeasuresSequence",
    "ImageOrientationPatient": "PlaneOrientationSequence",
    "ImagePositionPatient": "PlanePositionSequence",
    "RescaleSlope": "PixelValueTransformationSequence",
    "RescaleIntercept": "PixelValueTransformationSequence",
    "RescaleType": "PixelValueTransformationSequence",
}


def read(path: Path, key: str | None) -> Grid:
    """One image, or the frames of one file as a volume."""
    image = pydicom.dcmread(path)
    values, positions = _samples(image), _positions(image)
    if len(values) == 1 or positions is not None:
        return _grid(image, values, positions, select(key, SPATIAL, values.shape))
    # Frames without places in space, such as a film: one is chosen.
    frame, *plane = select(key, ("frame", "y", "x"), values.shape)
    return _grid(image, values[frame][None], None, (slice(None), *plane))


def read_series(path: Path, key: str | None) -> Grid:
    """The slices of one series in a folder, sorted along their normal; `key` is its number."""
    name, _, rest = (key or "").partition(",")
    if "=" in name:
        name, rest = "", key or ""
    files = _choose(_series(path), name)
    grid = _read_files(files, rest or None)
    return replace(grid, notes=_left_out(path, files) + grid.notes)


def _read_files(files: list[Path], key: str | None) -> Grid:
    """One file, or one slice from each of several."""
    if len(files) == 1:
        return read(files[0], key)
    heads = [pydicom.dcmread(file, stop_before_pixels=True) for file in files]
    first, positions = heads[0], np.array([_position(head, 0) for head in heads], np.float64)
    shape = (len(files), first.Rows, first.Columns)
    if {(head.Rows, head.Columns) for head in heads} != {shape[1:]}:
        raise InputError("is a series of images of different sizes")
    turned = [np.abs(np.subtract(_directions(head), _directions(first))).max() for head in heads]
    if positions.shape != (len(files), 3) or max(turned) > _TURNED:
        raise InputError("is a series of images that do not lie behind one another")
    check_memory(8 * int(np.prod(shape, dtype=object)), f"a series of {shape} samples")
    slices = [_samples(pydicom.dcmread(file)) for file in files]
    if any(len(samples) != 1 for samples in slices):
        raise InputError("is a series of volumes; read them one by one")
    return _grid(first, np.concatenate(slices), positions, select(key, SPATIAL, shape))


def _left_out(folder: Path, files: list[Path]) -> tuple[str, ...]:
    """A note of what is read where that is not all that is in the folder."""
    others = sum(path.is_file() for path in folder.iterdir()) - len(files)
    if not others:
        return ()
    names = f"{files[0].name} alone is"
    if len(files) > 1:
        names = f"{len(files)} files, {files[0].name} to {files[-1].name}, are"
    return (f"{names} read; other files in the folder are left out: {others}",)


def _series(folder: Path) -> dict[str, tuple[str, list[Path]]]:
    """The series in a folder: what each is called, and its files."""
    series: dict[str, tuple[str, list[Path]]] = {}
    for file in sorted(path for path in folder.iterdir() if path.is_file()):
        try:
            head = pydicom.dcmread(file, stop_before_pixels=True)
        except InvalidDicomError:
            continue
        if "Rows" not in head:
            continue
        number = str(head.get("SeriesNumber") or head.get("SeriesInstanceUID", ""))
        uid = str(head.get("SeriesInstanceUID", ""))
        text = str(head.get("SeriesDescription", head.get("Modality", "")))
        series.setdefault(uid, (f"{number} {text}".strip(), []))[1].append(file)
    return series


def _choose(series: dict[str, tuple[str, list[Path]]], name: str) -> list[Path]:
    """The files of the series whose number, or unique identifier, is `name`."""
    if not series:
        raise InputError("is a folder without DICOM images")
    fitting = [
        files for uid, (text, files) in series.items() if name in ("", uid, text.partition(" ")[0])
    ]
    if len(fitting) != 1:
        known = "; ".join(f"{text}, {len(files)} images" for text, files in series.values())
        raise InputError(f"holds {len(series)} series, choose one by its number: {known}")
    return fitting[0]


def _samples(image: Dataset) -> np.ndarray:
    """Rescaled values, (frame, row, column); padding is NaN."""
    if "PixelData" not in image and "FloatPixelData" not in image:
        raise InputError("is a DICOM file without an image")
    colour = image.get("PhotometricInterpretation", "")
    if not colour.startswith("MONOCHROME"):
        raise InputError(f"holds a colour image ({colour}); grey values are needed")
    frames = int(image.get("NumberOfFrames") or 1)
    check_memory(8 * frames * image.Rows * image.Columns, f"an image of {frames} frames")
    raw = np.asarray(image.pixel_array).reshape(frames, image.Rows, image.Columns)
    dose = image.get("DoseGridScaling") or 1
    slopes = [float(_look(image, "RescaleSlope", k, dose)) for k in range(frames)]
    offsets = [float(_look(image, "RescaleIntercept", k, 0)) for k in range(frames)]
    if set(slopes) == {1.0} and all(offset.is_integer() for offset in offsets):
        values = _narrow(raw.astype(np.int64) + np.array(offsets, np.int64)[:, None, None])
    else:
        float_type = exact_float(raw.dtype)
        slope, offset = (np.array(each, float_type)[:, None, None] for each in (slopes, offsets))
        values = raw.astype(float_type) * slope + offset
    padding = raw == image.get("PixelPaddingValue")
    if "PixelPaddingValue" in image and padding.any():
        values = values.astype(exact_float(values.dtype))
        values[padding] = np.nan
    return values


def _narrow(values: np.ndarray) -> np.ndarray:
    """Whole numbers in the smallest type of 16 bits or more that holds them."""
    for dtype in (np.int16, np.int32):
        limits = np.iinfo(dtype)
        if limits.min <= values.min() and values.max() <= limits.max:
            return values.astype(dtype)
    return values


def _grid(
    image: Dataset, values: np.ndarray, positions: np.ndarray | None, index: Sequence[Part]
) -> Grid:
    affine = np.eye(4)
    across, down = np.split(_directions(image), 2)
    row_step, column_step = _spacing(image)
    affine[:3, 0], affine[:3, 1] = across * column_step, down * row_step
    affine[:3, 2] = np.cross(across, down)
    if positions is not None:
        order = np.argsort(positions @ affine[:3, 2], kind="stable")
        values, positions = values[order], positions[order]
        affine[:3, 3] = positions[0]
    if positions is not None and len(positions) > 1:
        affine[:3, 2] = _step(positions)
    else:
        affine[:3, 2] *= _thickness(image)
    metadata = {new: str(image.get(old) or "") for old, new in _KEPT.items()}
    metadata |= {"space": LPS if positions is not None else "", "space units": "mm"}
    kind = str(_look(image, "RescaleType", 0, image.get("DoseUnits") or ""))
    return volume_grid(
        values[tuple(index)],
        values.shape,
        index,
        zyx(affine),
        units=kind or ("HU" if image.get("Modality") == "CT" else ""),
        metadata={name: text for name, text in metadata.items() if text},
    )


def _step(positions: np.ndarray) -> np.ndarray:
    """The vector from slice to slice; refuses slices that are missing or lie on one another."""
    step = (positions[-1] - positions[0]) / (len(positions) - 1)
    length = np.linalg.norm(step)
    if not length or np.linalg.norm(np.diff(positions, axis=0), axis=1).min() < length / 100:
        raise InputError("holds several images at one place; a time series is not read")
    even = positions[0] + step * np.arange(len(positions))[:, None]
    stray = np.linalg.norm(positions - even, axis=1).max() / length
    if stray > _UNEVEN:
        raise InputError(f"has slices that are not evenly spaced (up to {stray:.2g} slices off)")
    return step


def _positions(image: Dataset) -> np.ndarray | None:
    """Position of the first sample of every frame; None where the file does not say."""
    frames = int(image.get("NumberOfFrames") or 1)
    offsets = image.get("GridFrameOffsetVector")
    places = [_position(image, k) for k in range(frames)]
    if any(place is None for place in places):
        return None
    positions = np.array(places, np.float64)
    if offsets is not None and len(offsets) == frames:
        across, down = np.split(_directions(image), 2)
        return positions + np.outer(np.asarray(offsets, np.float64), np.cross(across, down))
    several = frames > 1 and not np.ptp(positions, axis=0).any()
    return None if several else positions


def _position(image: Dataset, frame: int) -> Any:
    return _look(image, "ImagePositionPatient", frame, None)


def _directions(image: Dataset) -> np.ndarray:
    given = _look(image, "ImageOrientationPatient", 0, (1, 0, 0, 0, 1, 0))
    return np.asarray(given, np.float64).reshape(6)


def _spacing(image: Dataset) -> tuple[float, float]:
    given = _look(image, "PixelSpacing", 0, image.get("ImagerPixelSpacing") or (1, 1))
    row_step, column_step = (float(step) for step in given)
    return row_step, column_step


def _thickness(image: Dataset) -> float:
    """The distance between slices, or else how thick one is; 1 where the file says neither."""
    given = [_look(image, name, 0, None) for name in ("SpacingBetweenSlices", "SliceThickness")]
    known = [abs(float(distance)) for distance in given if distance is not None]
    return next((distance for distance in known if distance and np.isfinite(distance)), 1.0)


def _look(image: Dataset, name: str, frame: int, default: Any) -> Any:
    """An element at the top of the file, or in the group of a frame or that of all frames."""
    if image.get(name) is not None:
        return image.get(name)
    own = image.get("PerFrameFunctionalGroupsSequence") or []
    groups = [*own[frame : frame + 1], *(image.get("SharedFunctionalGroupsSequence") or [])]
    for group in groups:
        for item in group.get(_GROUP[name]) or []:
            if item.get(name) is not None:
                return item.get(name)
    return default
