"""Between `Grid` and xarray's data sets: what NetCDF and Zarr share.

Axes have coordinate variables where they are even; what the conventions for climate and forecast
data (CF) have no place for (turned axes, a metric spacing) is kept in attributes of the samples.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from ..._grid.affine import (
    SKEWED,
    TURN,
    affine_from_axes,
    axes_from_affine,
    is_skewed,
    seam_note,
    spacing_of,
)
from ..._grid.grid import Grid, no_samples
from ..._grid.missing import check_dtype, mark_missing, numeric, restore_nodata
from ..._grid.reference import axis_attributes
from ..._support.errors import InputError
from ..._support.memory import check_memory
from .keys import describe_axes, index_of, parse_key

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
    for name, coordinate in array.coords.items():
        beside = coordinate.ndim == 1 and name not in array.dims and "positive" in coordinate.attrs
        if beside and coordinate.dims[0] in array.dims and coordinate.dtype.kind in "iuf":
            try:
                affine_from_axes([coordinate.to_numpy()], [str(name)])
            except InputError:
                notes += (
                    f"{name} is not evenly spaced: {coordinate.dims[0]} counts as the distance",
                )
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


# Attributes of the samples that are fields of a grid, or false for other samples or other files.
_OWN = frozenset(
    re.split(
        r",\s*",
        "index_to_world, sample_spacing, sample_origin, units, grid_mapping, _FillValue, "
        "missing_value, valid_min, valid_max, valid_range, actual_range, coordinates, bounds, "
        "cell_measures, ancillary_variables, formula_terms",
    )
)

# What begins the names of attributes of the whole data set; the writer has its own conventions.
_GLOBAL, _CONVENTIONS = "global:", "Conventions"
# So many variables are named in a note.
_LISTED = 12
_AXIS_TEXTS = frozenset(("units", "axis", "standard_name", "long_name", "positive", "calendar"))


def grid_from_dataset(data: xr.Dataset, key: str | None) -> Grid:
    """The variable, or the part of one, that `key` chooses."""
    array = choose_array(data, key)
    check_memory(8 * array.size, f"an array of shape {array.shape}")
    samples = numeric(array.to_numpy())
    values, missing, notes = mark_missing(samples, _nodata(array))
    return _described(data, array, samples.dtype, values, missing, notes)


def outline_from_dataset(data: xr.Dataset, array: xr.DataArray) -> Grid:
    """A grid like that of `grid_from_dataset` whose values are one zero: nothing is read."""
    dtype = np.dtype(np.float32 if array.dtype.kind == "b" else array.dtype)
    return _described(data, array, dtype, no_samples(array.shape, dtype))


def outline_from_array(array: xr.DataArray) -> Grid:
    """As `outline_from_dataset`, of an array that is not a variable of a data set."""
    named = array.rename("data" if array.name in (None, *array.coords) else array.name)
    return outline_from_dataset(named.to_dataset(), named)


def choose_array(data: xr.Dataset, key: str | None) -> xr.DataArray:
    """The variable, or the part of one, that `key` chooses, with y before x; not read yet."""
    name, parts = parse_key(key)
    array = _choose(data, name)
    check_dtype(array.dtype)
    index = index_of(parts, [str(dim) for dim in array.dims], array.shape)
    array = ordered(array[index])
    thin = [dim for dim in array.dims if array.sizes[dim] == 1]
    array = array.isel(dict.fromkeys(thin[: max(array.ndim - 2, 0)], 0))
    _check_axes(array, set(parts))
    return array


def _described(
    data: xr.Dataset,
    array: xr.DataArray,
    dtype: np.dtype,
    values: np.ndarray,
    missing: np.ndarray | None = None,
    notes: tuple[str, ...] = (),
) -> Grid:
    nodata = _nodata(array)
    affine, more = affine_of(array)
    packed = {"scale_factor", "add_offset"} & set(array.encoding)
    source = dtype if packed else np.dtype(array.encoding.get("dtype", dtype))
    crs, mapping = _crs(data, array)
    attributes = array.attrs
    return Grid(
        values,
        axes=tuple(str(dim) for dim in array.dims),
        units=str(attributes.get("units", "")),
        crs=crs,
        affine=affine,
        spacing=_numbers(attributes, "sample_spacing", array.ndim),
        origin=_numbers(attributes, "sample_origin", array.ndim),
        nodata=None if packed else nodata,
        missing=missing,
        metadata=_metadata(data, array, crs) | mapping,
        notes=notes + more + _left_out(data, array),
        source_dtype=source if source.kind in "iuf" else dtype,
    )


def dataset_from_grid(grid: Grid) -> xr.Dataset:
    """A data set of one variable with its coordinates, attributes and nodata value."""
    stored, nodata = restore_nodata(grid)
    own: dict[str, Any] = {}
    coordinates: list[np.ndarray] | None = None
    if grid.affine is not None:
        coordinates = axes_from_affine(grid.affine, grid.shape)
        if coordinates is None or 1 in grid.shape:
            own["index_to_world"] = grid.affine.ravel()
        if not np.allclose(spacing_of(grid.affine), grid.spacing, rtol=1e-9):
            own["sample_spacing"] = np.array(grid.spacing)
    elif set(grid.spacing) != {1.0} or any(grid.origin):
        own |= {"sample_spacing": np.array(grid.spacing), "sample_origin": np.array(grid.origin)}
    texts = {name.replace("/", "_"): text for name, text in grid.metadata.items() if name}
    name = (texts.pop("name", "") or "data").replace("/", "_")
    mapping = texts.pop("grid_mapping", None)
    title = texts.pop("title", None)
    whole = _prefixed(texts, _GLOBAL)
    implied = axis_attributes(grid.crs, grid.axes)
    along = {
        axis: _completed(_prefixed(texts, f"{axis}:"), implied.get(axis, {})) for axis in grid.axes
    }
    if grid.units:
        texts["units"] = grid.units
    variable = xr.DataArray(stored, dims=grid.axes, name=name, attrs=texts | own)
    for axis, values in zip(grid.axes, coordinates or [], strict=coordinates is not None):
        variable = variable.assign_coords({axis: (axis, values, along[axis])})
        variable.coords[axis].encoding["_FillValue"] = None  # which the conventions forbid
    data = variable.to_dataset()
    if nodata is not None:
        data[name].encoding["_FillValue"] = stored.dtype.type(nodata)
    if grid.crs is not None or mapping is not None:
        described = json.loads(mapping or "{}")
        if grid.crs is not None:
            described |= {"crs_wkt": grid.crs, "spatial_ref": grid.crs}
        data["crs"] = ((), np.int32(0), described)
        data[name].encoding["grid_mapping"] = "crs"
    if title is not None:
        whole["title"] = title
    data.attrs = {**whole, _CONVENTIONS: "CF-1.8"}
    return data


def _completed(own: dict[str, str], implied: dict[str, str]) -> dict[str, str]:
    """The attributes of an axis, with those that its reference system implies."""
    agree = all(own.get(name, text) == text for name, text in implied.items())
    return implied | own if agree else own


def _prefixed(texts: dict[str, str], prefix: str) -> dict[str, str]:
    """The entries that begin with `prefix`, without it; they are taken out of `texts`."""
    names = [name for name in texts if name.startswith(prefix)]
    return {name.removeprefix(prefix): texts.pop(name) for name in names}


def _choose(data: xr.Dataset, name: str | None) -> xr.DataArray:
    fields = {str(each): array for each, array in data.data_vars.items() if array.ndim >= 2}
    known = ", ".join(f"{each} ({_axes(array)})" for each, array in fields.items())
    if name is not None:
        if name not in data.variables:
            raise InputError(f"holds no variable {name!r}; it has {known or 'none'}")
        return data[name]
    numbers = {each: array for each, array in fields.items() if array.dtype.kind in "biuf"}
    if len(numbers) != 1:
        raise InputError(f"holds {len(numbers)} fields, choose one with a key: {known or 'none'}")
    return next(iter(numbers.values()))


def _axes(array: xr.DataArray) -> str:
    return describe_axes([str(dim) for dim in array.dims], array.shape)


def _check_axes(array: xr.DataArray, chosen: set[str]) -> None:
    """Refuse time series and more than 3 axes unless the key says what of them is meant."""
    if array.ndim < 2:
        raise InputError(f"{array.name!r} has {array.ndim} axis left; 2 or 3 are needed")
    times = [str(dim) for dim in array.dims if is_time(array, dim) and str(dim) not in chosen]
    if array.ndim > 3:
        others = [str(dim) for dim in array.dims[: array.ndim - 2]]
        choice = ",".join(f"{dim}=0" for dim in others)
        raise InputError(
            f"{array.name!r} has the axes {_axes(array)}: choose with a key such as "
            f"{array.name},{choice}"
        )
    if times and array.ndim == 3:
        raise InputError(
            f"{array.name!r} is a time series ({_axes(array)}): choose with a key such as "
            f"{array.name},{times[0]}=0, or {array.name},{times[0]}=: for all as a volume"
        )


def _nodata(array: xr.DataArray) -> float | int | None:
    for name in ("_FillValue", "missing_value"):
        value = array.encoding.get(name, array.attrs.get(name))
        if value is not None and np.size(value) == 1 and np.asarray(value).dtype.kind in "iuf":
            nodata = np.asarray(value).reshape(()).item()
            return None if np.isnan(nodata) else nodata
    return None


def _crs(data: xr.Dataset, array: xr.DataArray) -> tuple[str | None, dict[str, str]]:
    """The CRS, or where it is written in CF's own terms those, as JSON."""
    name = array.encoding.get("grid_mapping", array.attrs.get("grid_mapping"))
    if name is None or name not in data.variables:
        return None, {}
    attributes = data[name].attrs
    for known in ("crs_wkt", "spatial_ref"):
        if attributes.get(known):
            return str(attributes[known]), {}
    plain = {str(name): _plain(value) for name, value in attributes.items()}
    return None, {"grid_mapping": json.dumps(plain)} if plain else {}


def _metadata(data: xr.Dataset, array: xr.DataArray, crs: str | None) -> dict[str, str]:
    """Names and attributes as text; those of an axis begin with its name and a colon.

    What the reference system says of an axis is left out: it is written again.
    """
    implied = axis_attributes(crs, [str(dim) for dim in array.dims])
    metadata = {"name": str(array.name)}
    metadata |= {str(k): _text(v) for k, v in array.attrs.items() if k not in _OWN}
    for dim in array.dims:
        if dim in array.coords:
            texts = {k: _text(v) for k, v in array.coords[dim].attrs.items() if k in _AXIS_TEXTS}
            known = implied.get(str(dim), {})
            if known.items() <= texts.items():
                texts = {k: text for k, text in texts.items() if k not in known}
            metadata |= {f"{dim}:{k}": text for k, text in texts.items()}
    for name in _places(array):
        units = array.coords[name].attrs.get("units", "")
        metadata[f"at_{name}"] = f"{array.coords[name].item():.12g} {units}".strip()
    for name, value in data.attrs.items():
        if name != _CONVENTIONS:
            metadata[name if name == "title" else f"{_GLOBAL}{name}"] = _text(value)
    return metadata


def _places(array: xr.DataArray) -> list[str]:
    """The coordinates that are one number, such as the time of a map."""
    return [
        str(name)
        for name, coordinate in array.coords.items()
        if coordinate.ndim == 0 and coordinate.dtype.kind in "iuf" and _is_place(coordinate)
    ]


def _left_out(data: xr.Dataset, array: xr.DataArray) -> tuple[str, ...]:
    """A note that names the variables of which a grid keeps nothing."""
    mapping = array.encoding.get("grid_mapping", array.attrs.get("grid_mapping"))
    kept = {array.name, mapping, *map(str, array.dims), *_places(array)}
    names = [str(name) for name in data.variables if name not in kept]
    if not names:
        return ()
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return (f"variables that are left out: {', '.join(names[:_LISTED])}{more}",)


def _is_place(coordinate: xr.DataArray) -> bool:
    return "grid_mapping_name" not in coordinate.attrs and "crs_wkt" not in coordinate.attrs


def _numbers(attributes: Mapping[Any, Any], name: str, ndim: int) -> tuple[float, ...]:
    values = np.atleast_1d(attributes.get(name, ()))
    return tuple(float(value) for value in values) if len(values) == ndim else ()


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def _text(value: Any) -> str:
    plain = _plain(value)
    return plain if isinstance(plain, str) else json.dumps(plain, default=str)
