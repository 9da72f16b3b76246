"""Which axis of an xarray variable is which, and where its samples lie."""

from typing import Any

import numpy as np
import xarray as xr

from ._errors import InputError
from ._geometry import SKEWED, TURN, affine_from_axes, is_skewed, seam_note

_TIME_NAMES = frozenset(("time", "t", "month", "year", "valid_time"))


def ordered(array: xr.DataArray) -> xr.DataArray:
    """With y before x, whatever the file's order, where it says which is which."""
    ranks = [_rank(array, dim) for dim in array.dims]
    if None in ranks or len(set(ranks)) < len(ranks):
        return array
    return array.transpose(*(array.dims[k] for k in np.argsort(np.array(ranks))))


def _rank(array: xr.DataArray, dim: Any) -> int | None:
    """0 for time, 1 for height, 2 for y, 3 for x; None where the coordinate does not say."""
    if is_time(array, dim):
        return 0
    attributes = array.coords[dim].attrs if dim in array.coords else {}
    units, axis = str(attributes.get("units", "")), attributes.get("axis")
    if axis == "X" or units.startswith(("degrees_e", "degree_e")):
        return 3
    if axis == "Y" or units.startswith(("degrees_n", "degree_n")):
        return 2
    return 1 if axis == "Z" or "positive" in attributes else None


def is_time(array: xr.DataArray, dim: Any) -> bool:
    """Whether an axis is time, by its name or the attributes of its coordinate."""
    attributes = array.coords[dim].attrs if dim in array.coords else {}
    named = str(dim).lower() in _TIME_NAMES or attributes.get("axis") == "T"
    return named or " since " in str(attributes.get("units", ""))


def affine_of(array: xr.DataArray) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Index to world from the coordinates of the axes, and notes; None where there are none."""
    notes: tuple[str, ...] = ()
    stored = array.attrs.get("index_to_world")
    if stored is not None:
        affine = np.asarray(stored, np.float64).reshape(array.ndim + 1, array.ndim + 1)
        skewed = (SKEWED,)
        return affine, skewed if is_skewed(affine) else ()
    if not set(array.dims) & set(array.coords):
        curved = [str(name) for name, each in array.coords.items() if _is_curvilinear(each)]
        if curved:
            notes = (f"{', '.join(curved)} are curvilinear: sample numbers are used instead",)
        return None, notes
    along = []
    for dim in array.dims:
        if dim not in array.coords:
            along.append(np.arange(array.sizes[dim], dtype=np.float64))
            continue
        coordinate = array.coords[dim]
        if coordinate.dtype.kind not in "iuf":
            raise InputError(f"coordinate {dim!r} holds {coordinate.dtype}, not numbers")
        values, said = _unwrapped(coordinate)
        along.append(values)
        notes += said
    affine = affine_from_axes(along, [str(dim) for dim in array.dims])
    return affine, notes + _uneven_beside(array)


def _is_curvilinear(coordinate: xr.DataArray) -> bool:
    return coordinate.ndim > 1 and str(coordinate.attrs.get("units", "")).startswith("degree")


def _uneven_beside(array: xr.DataArray) -> tuple[str, ...]:
    """Notes about axes that only count, such as model levels, where what they count is uneven."""
    notes: tuple[str, ...] = ()
    for name, each in array.coords.items():
        beside = each.ndim == 1 and name not in array.dims and "positive" in each.attrs
        if beside and each.dims[0] in array.dims and each.dtype.kind in "iuf":
            try:
                affine_from_axes([each.to_numpy()], [str(name)])
            except InputError:
                notes += (f"{name} is not evenly spaced: {each.dims[0]} counts as the distance",)
    return notes


def _unwrapped(coordinate: xr.DataArray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Longitudes that go on where the file jumps by a turn, and notes about the seam."""
    values = coordinate.to_numpy()
    units = str(coordinate.attrs.get("units", ""))
    if not units.startswith(("degrees_e", "degree_e")) or len(values) < 3:
        return values, ()
    name = coordinate.name
    smooth = np.unwrap(values.astype(np.float64), period=TURN)
    if not np.allclose(smooth, values):
        return smooth, (f"{name} jumps by a turn in the file; here it goes on to {smooth[-1]:g}",)
    step = (values[-1] - values[0]) / (len(values) - 1)
    if abs(len(values) * abs(step) - TURN) < 0.01 * abs(step):
        return values, (seam_note(str(name)),)
    return values, ()
