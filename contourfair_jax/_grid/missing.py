"""Missing samples: file values to NaN on the way in, NaN to file values on the way out."""

import numpy as np

from .._support.errors import InputError
from .grid import Grid, exact_float


def numeric(values: np.ndarray) -> np.ndarray:
    """`values` as a native, C-ordered array of integers, float32 or float64.

    Raises
    ------
    InputError
        The array is empty, a single number, complex, or does not hold numbers.
    """
    check_dtype(values.dtype)
    if values.ndim == 0:
        raise InputError("holds a single number, not a grid")
    if values.size == 0:
        raise InputError(f"holds an empty array, shape {values.shape}")
    wanted = values.dtype.newbyteorder("=")
    if values.dtype.kind == "b":
        wanted = np.dtype(np.uint8)
    elif values.dtype == np.float16:
        wanted = np.dtype(np.float32)
    elif values.dtype.kind == "f" and values.dtype.itemsize > 8:
        wanted = np.dtype(np.float64)
    return np.ascontiguousarray(values, dtype=wanted)


def check_dtype(dtype: np.dtype) -> None:
    """Refuse what is not a real number."""
    if dtype.hasobject:
        raise InputError("holds pickled Python objects, which are never loaded; save plain numbers")
    if dtype.kind == "c":
        raise InputError("holds complex numbers; save the magnitude or one part")
    if dtype.kind not in "biuf":
        raise InputError(f"holds {dtype} values; real numbers are needed")


def mark_missing(
    values: np.ndarray, nodata: float | int | None, mask: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray | None, tuple[str, ...]]:
    """Samples with NaN where missing, the mask of those (or None), and notes.

    A sample is missing where `mask` is True, or it equals `nodata`, or it is not finite.
    """
    missing = np.zeros(values.shape, dtype=bool) if mask is None else np.array(mask, dtype=bool)
    if nodata is not None and not np.isnan(nodata):
        missing |= values == nodata
    notes: tuple[str, ...] = ()
    if values.dtype.kind == "f":
        infinite = int((np.isinf(values) & ~missing).sum())
        if infinite:
            notes = (f"{infinite} infinite samples are taken as missing",)
        missing |= ~np.isfinite(values)
    if not missing.any():
        return values, None, notes
    floats = values.astype(exact_float(values.dtype))
    floats[missing] = np.nan
    return floats, missing, notes


def restore_nodata(grid: Grid) -> tuple[np.ndarray, float | int | None]:
    """The array to store and its nodata value, such that missing samples and only they have it.

    The nodata value of the grid is kept unless a real sample equals it or the type of the samples
    cannot hold it; then it is NaN.
    """
    values, missing = grid.values, grid.missing
    floats = values.dtype.kind == "f"
    nodata = _representable(grid.nodata, values.dtype)
    if nodata is not None and not np.isnan(nodata):
        taken = values == nodata
        if missing is not None:
            taken &= ~missing
        if taken.any():
            nodata = None
    if missing is None:
        return values, nodata
    if nodata is None:
        if not floats:
            raise InputError("missing integer samples need a nodata value; set Grid.nodata")
        nodata = float("nan")
    stored = values.copy()
    stored[missing] = nodata
    return stored, nodata


def _representable(nodata: float | int | None, dtype: np.dtype) -> float | int | None:
    if nodata is None:
        return None
    if dtype.kind == "f":
        held = float(dtype.type(nodata)) if abs(nodata) <= np.finfo(dtype).max else float("nan")
        return held
    limits = np.iinfo(dtype)
    whole = np.isfinite(nodata) and float(nodata).is_integer()
    return int(nodata) if whole and limits.min <= nodata <= limits.max else None
