"""The accessor ``fair``."""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import jax
import numpy as np
import xarray as xr

from .._fair import fair_field
from .._fairing.default import chosen_method
from .._fairing.method import AbstractFairing
from .._field import BezierField
from .._grid.grid import exact_float
from .._level_sets import Levels
from .._resample import one_turn
from .._support.checks import Scalar, check_factors
from ..contours import Contours, contours
from ._axes import Axis, axes_of, refined_coordinates, untouched_coordinates

Result = TypeVar("Result")


@xr.register_dataarray_accessor("fair")
class FairAccessor:
    """Fairing of labelled arrays; use it as ``array.fair``.

    All methods share these arguments.

    Parameters
    ----------
    dims : sequence of names
        The 2 or 3 dimensions of the field; by default all but time.  The others are a batch.
    method : LocalFairing or GlobalFairing
        How to fair, as for `fair_field`.
    periodic : name or names
        Dimensions whose last sample is followed by the first one, such as longitudes all around.

    Examples
    --------
    >>> import numpy as np, xarray as xr
    >>> import contourfair_jax.xarray
    >>> lat, lon = np.linspace(60.0, 40.0, 6), np.arange(9.0)
    >>> array = xr.DataArray(lat[:, None] + lon, coords={"lat": lat, "lon": lon}, name="t")
    >>> array.fair.upsample(4).sizes
    Frozen({'lat': 21, 'lon': 33})
    >>> float(array.fair.interp(lat=52.5, lon=1.25).round(6))
    53.75
    """

    def __init__(self, array: xr.DataArray) -> None:
        self._array = array

    def upsample(
        self,
        factor: int | Mapping[Any, int],
        *,
        dims: Sequence[Hashable] | None = None,
        method: AbstractFairing | None = None,
        periodic: Hashable | Iterable[Hashable] = (),
    ) -> xr.DataArray:
        """The array on the grid that is `factor` times finer; every sample is kept.

        An axis of n samples gets ``factor * (n - 1) + 1``, a periodic one ``factor * n``.  Other
        coordinates of real numbers along the axes are refined linearly, the rest is left out.

        Factors by dimension, as in ``{"z": 4}``, leave the samples along the others as they are.

        An array in dask chunks stays one, computed when it is asked for, in tiles of its own as by
        `contourfair_jax.tiles`: the chunks do not change the result.  Its chunks are refined too.

        Raises
        ------
        ValueError
            For a factor below 1, or of what is not a faired dimension, or coordinates that are not
            even.
        """
        array, axes = self._prepared(dims, periodic, lazily=True)
        factors = _factors(factor, axes)

        def refine(field: BezierField) -> np.ndarray:
            values = np.asarray(field.refine(factors))
            for k, axis in enumerate(axes):
                values = axis.turned(values, k, factors[k])
            return values

        if array.chunks is None:
            values = _of_each(array, axes, method, refine)
        else:
            values = _refined_lazily(array, axes, method, factors)
        finer = xr.DataArray(values, dims=array.dims, name=array.name, attrs=array.attrs)
        finer = finer.assign_coords(refined_coordinates(array, axes, factors))
        return finer.transpose(*self._array.dims)

    def interp(
        self,
        coords: Mapping[Any, Any] | None = None,
        *,
        dims: Sequence[Hashable] | None = None,
        method: AbstractFairing | None = None,
        periodic: Hashable | Iterable[Hashable] = (),
        outside: str = "nan",
        **coords_kwargs: Any,
    ) -> xr.DataArray:
        """Values at new coordinates, given and combined as for `xarray.DataArray.interp`.

        Numbers and arrays of one axis make a grid; arrays with common dimensions make points.  A
        dimension that is not named keeps its samples.  Other coordinates along the axes are left
        out.

        Parameters
        ----------
        coords, **coords_kwargs : mapping or keywords
            New coordinates by dimension.
        outside : str
            As for `BezierField`: "nan", "clamp" or "extend".

        Raises
        ------
        ValueError
            For a name that is not a faired dimension; otherwise as `upsample`.
        """
        array, axes = self._prepared(dims, periodic)
        wanted = {**(coords or {}), **coords_kwargs}
        known = [axis.dim for axis in axes]
        if set(wanted) - set(known):
            raise ValueError(f"coords must be along {known}, got {sorted(map(str, wanted))}")
        targets = [_target(array, axis, wanted.get(axis.dim, axis.coordinate)) for axis in axes]
        spread = xr.broadcast(*targets)
        points = np.stack(
            [axis.local(target.to_numpy()) for axis, target in zip(axes, spread, strict=True)], -1
        )

        def evaluate(field: BezierField) -> np.ndarray:
            return np.asarray(field(points, outside))

        values = _of_each(array, axes, method, evaluate)
        batch = array.dims[: array.ndim - len(axes)]
        interpolated = xr.DataArray(
            values, dims=(*batch, *spread[0].dims), name=array.name, attrs=array.attrs
        )
        along = {axis.dim: target.dims for axis, target in zip(axes, targets, strict=True)}
        order = [new for dim in self._array.dims for new in along.get(dim, (dim,))]
        interpolated = interpolated.transpose(*dict.fromkeys(order))
        new = {target.name: target for target in targets if target.name in array.coords}
        return interpolated.assign_coords({**untouched_coordinates(array, axes), **new})

    def contours(
        self,
        levels: Levels,
        *,
        method: AbstractFairing | None = None,
        periodic: Hashable | Iterable[Hashable] = (),
        tolerance: Scalar = 0.01,
    ) -> Contours:
        """The contour lines of a 2-D array, in its coordinates and in the order of its dimensions.

        Of a periodic axis, lines go on to the first sample of the next turn and end there.

        Raises
        ------
        ValueError
            As for `contourfair_jax.contours.contours` and `upsample`.
        """
        if self._array.ndim != 2:
            raise ValueError(
                f"contours are of a 2-D array, this has the dimensions {tuple(self._array.dims)}; "
                "choose from the others with isel"
            )
        array, axes = self._prepared(self._array.dims, periodic)
        traced = _with_field(
            array.to_numpy(), axes, method, lambda field: contours(field, levels, tolerance)
        )
        starts = np.array([axis.start for axis in axes])
        lines = tuple(replace(line, points=line.points + starts) for line in traced.lines)
        return replace(traced, lines=lines)

    def _prepared(
        self,
        dims: Sequence[Hashable] | None,
        periodic: Hashable | Iterable[Hashable],
        lazily: bool = False,
    ) -> tuple[xr.DataArray, tuple[Axis, ...]]:
        """The array with the faired dimensions last, and their axes."""
        array = self._array
        if array.chunks is not None and not lazily:
            raise ValueError("the array is in dask chunks; call .compute() on it first")
        if array.dtype.kind not in "biuf":
            raise ValueError(f"the array holds {array.dtype}; real numbers are needed")
        axes = axes_of(array, dims, periodic)
        faired = [axis.dim for axis in axes]
        others = [dim for dim in array.dims if dim not in faired]
        return array.transpose(*others, *faired), axes


def _of_each(
    array: xr.DataArray,
    axes: tuple[Axis, ...],
    method: AbstractFairing | None,
    use: Callable[[BezierField], np.ndarray],
) -> np.ndarray:
    """Results of `use` for the fields of all members of the batch, stacked."""
    values = array.to_numpy()
    batch = values.shape[: values.ndim - len(axes)]
    members = values.reshape(math.prod(batch), *values.shape[len(batch) :])
    # No members have a shape too, which that of one tells.
    like = members if len(members) else np.zeros((1, *members.shape[1:]), values.dtype)
    results = np.stack([_with_field(member, axes, method, use) for member in like])
    return results[: len(members)].reshape((*batch, *results.shape[1:]))


def _factors(factor: int | Mapping[Any, int], axes: tuple[Axis, ...]) -> tuple[int, ...]:
    """The factor of every axis, from one number or from a mapping by dimension."""
    known = [axis.dim for axis in axes]
    if not isinstance(factor, Mapping):
        return check_factors(factor, len(axes))
    if set(factor) - set(known):
        raise ValueError(f"factor must be along {known}, got {sorted(map(str, factor))}")
    return check_factors([factor.get(dim, 1) for dim in known], len(axes))


def _refined_lazily(
    array: xr.DataArray,
    axes: tuple[Axis, ...],
    method: AbstractFairing | None,
    factors: tuple[int, ...],
) -> Any:
    """The refined samples as a dask array, in the directions of the coordinates."""
    from ..tiles._dask import each_member, refine_lazily, refined_chunks

    samples, leading = array.data, array.ndim - len(axes)
    steps = [abs(axis.step) for axis in axes]
    method = chosen_method(method)

    def refine(member: Any) -> Any:
        for k, axis in enumerate(axes):
            member = axis.upward(member, k)
        fine = refine_lazily(member, factors, method, steps, exact_float(array.dtype))
        for k, (axis, factor) in enumerate(zip(axes, factors, strict=True)):
            if axis.periodic:
                first, last = factor * axis.margin, factor * (axis.margin + len(axis.coordinate))
                fine = fine[(slice(None),) * k + (slice(first, last + 1),)]
            fine = axis.turned(fine, k, factor)
        return fine

    fine = each_member(samples, len(axes), refine)
    along = zip(samples.chunks[leading:], factors, axes, strict=True)
    chunks = [refined_chunks(sizes, factor, axis.periodic) for sizes, factor, axis in along]
    return fine.rechunk((*samples.chunks[:leading], *chunks))


def _with_field(
    values: np.ndarray,
    axes: tuple[Axis, ...],
    method: AbstractFairing | None,
    use: Callable[[BezierField], Result],
) -> Result:
    """Result of `use` for the field, whose coordinates ascend from zero through one turn."""
    dtype = exact_float(values.dtype)
    values = np.ascontiguousarray(values, dtype)
    for k, axis in enumerate(axes):
        values = axis.upward(values, k)
    spacing = [abs(axis.step) for axis in axes]
    with jax.enable_x64(dtype == np.float64 or jax.config.read("jax_enable_x64")):
        field = fair_field(values, spacing=spacing, method=method)
        counts = [len(axis.coordinate) if axis.periodic else None for axis in axes]
        return use(one_turn(field, counts))


def _target(array: xr.DataArray, axis: Axis, wanted: Any) -> xr.DataArray:
    """New coordinates along an axis: with their own attributes, or those of the old ones."""
    if isinstance(wanted, xr.DataArray):
        return wanted.rename(axis.dim)
    values = np.asarray(wanted)
    if values.ndim > 1:
        raise ValueError(
            f"coords[{axis.dim!r}] must be a number, 1-D or a DataArray, got {values.ndim}-D"
        )
    target = xr.DataArray(values, dims=(axis.dim,) * values.ndim, name=axis.dim)
    if axis.dim in array.coords:
        target.attrs = dict(array.coords[axis.dim].attrs)
    return target
