"""xarray's labelled arrays as samples on a regular grid: which axes, where, all the way round."""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from .._bezier.linear import refine_axis_linearly
from .._grid.affine import TURN, affine_from_axes
from .._grid.periodic import check_turn, margin_of, with_turns
from ..io.formats.datasets import is_time


@dataclass(frozen=True)
class Axis:
    """A refined axis.

    Parameters
    ----------
    dim
        The dimension of the array.
    coordinate
        Its coordinate, or the sample numbers where it has none.
    step
        Distance of samples, negative where the coordinate descends.
    periodic
        Whether the sample after the last one is the first.
    """

    dim: Hashable
    coordinate: np.ndarray
    step: float
    periodic: bool

    @property
    def start(self) -> float:
        """The smallest coordinate."""
        return float(self.coordinate[0] if self.step > 0 else self.coordinate[-1])

    def upward(self, values: Any, axis: int) -> Any:
        """`values` with the coordinate ascending, and parts of the turns beside if it is periodic.

        The first sample is then at the index `margin`.
        """
        values = np.flip(values, axis) if self.step < 0 else values
        return with_turns(values, axis) if self.periodic else values

    @property
    def margin(self) -> int:
        """Samples before the first one in `upward`."""
        return margin_of(len(self.coordinate)) if self.periodic else 0

    def turned(self, finer: Any, axis: int, factor: int) -> Any:
        """Refined values of one ascending turn in the direction of the coordinate."""
        if not self.periodic:
            return np.flip(finer, axis) if self.step < 0 else finer
        n = len(self.coordinate)
        order = np.arange(factor * n)
        if self.step < 0:
            order = (factor * (n - 1) - order) % len(order)
        return np.take(finer, order, axis)

    def refined(self, factor: int) -> np.ndarray:
        """The coordinate on the finer grid; that of a sample is kept exactly."""
        n = len(self.coordinate)
        count = factor * n if self.periodic else factor * (n - 1) + 1
        at = np.arange(count) / factor
        wide = np.append(self.coordinate, self.coordinate[-1] + self.step)
        finer = np.interp(at, np.arange(n + 1), wide)
        kind = self.coordinate.dtype
        return finer.astype(kind) if kind.kind == "f" else finer

    def local(self, points: np.ndarray) -> np.ndarray | np.float64:
        """Coordinates counted from the smallest one, turned into the period where there is one."""
        away = np.asarray(points, np.float64) - self.start
        return away % (abs(self.step) * len(self.coordinate)) if self.periodic else away


def axes_of(
    array: xr.DataArray, dims: Sequence[Hashable] | None, periodic: Hashable | Iterable[Hashable]
) -> tuple[Axis, ...]:
    """The axes that are faired: `dims`, or all that are not time.

    Raises
    ------
    ValueError
        There are not 2 or 3, or one has an uneven coordinate, or one that is not all around.
    """
    chosen = [dim for dim in array.dims if not is_time(array, dim)] if dims is None else list(dims)
    unknown = [dim for dim in chosen if dim not in array.dims]
    if unknown or len(set(chosen)) != len(chosen) or len(chosen) not in (2, 3):
        raise ValueError(
            f"dims must name 2 or 3 dimensions of the array {tuple(array.dims)}, got {chosen}"
        )
    around = {periodic} if isinstance(periodic, str) else set(_each(periodic))
    if not around <= set(chosen):
        raise ValueError(f"periodic must name some of {chosen}, got {sorted(map(str, around))}")
    return tuple(_axis(array, dim, dim in around) for dim in array.dims if dim in chosen)


def _each(names: Hashable | Iterable[Hashable]) -> Iterable[Hashable]:
    return names if isinstance(names, Iterable) else (names,)


def _axis(array: xr.DataArray, dim: Hashable, periodic: bool) -> Axis:
    n = array.sizes[dim]
    if dim not in array.coords:
        return Axis(dim, np.arange(n, dtype=np.float64), 1.0, periodic)
    coordinate = array.coords[dim]
    values = coordinate.to_numpy()
    if values.dtype.kind not in "iuf":
        raise ValueError(
            f"coordinate {dim!r} holds {values.dtype}, which has no length; leave it out of dims"
        )
    step = float(affine_from_axes([values], [str(dim)])[0, 0])
    if periodic:
        check_turn(str(dim), n, abs(step), str(coordinate.attrs.get("units", "")))
    return Axis(dim, values, step, periodic)


def untouched_coordinates(
    array: xr.DataArray, axes: Sequence[Axis]
) -> dict[Hashable, xr.DataArray]:
    """The coordinates that do not vary along the axes."""
    along = {axis.dim for axis in axes}
    return {
        name: coordinate.reset_coords(drop=True)
        for name, coordinate in array.coords.items()
        if not along & set(coordinate.dims)
    }


def refined_coordinates(
    array: xr.DataArray, axes: Sequence[Axis], factors: Sequence[int]
) -> dict[Hashable, Any]:
    """All coordinates on the finer grid; those that are no real numbers are left out."""
    refined: dict[Hashable, Any] = dict(untouched_coordinates(array, axes))
    for axis, factor in zip(axes, factors, strict=True):
        if axis.dim in array.coords:
            attributes = array.coords[axis.dim].attrs
            refined[axis.dim] = (axis.dim, axis.refined(factor), attributes)
    around = {axis.dim for axis in axes if axis.periodic}
    for name, coordinate in array.coords.items():
        numbers = (
            coordinate.dtype.kind == "f"
            and name not in refined
            and not around & set(coordinate.dims)
        )
        if numbers and not _jumps(coordinate):
            values = coordinate.to_numpy()
            for axis, factor in zip(axes, factors, strict=True):
                if axis.dim in coordinate.dims:
                    values = refine_axis_linearly(values, coordinate.dims.index(axis.dim), factor)
            refined[name] = (coordinate.dims, values, coordinate.attrs)
    return refined


def _jumps(coordinate: xr.DataArray) -> bool:
    """Whether degrees jump by a turn somewhere, so that there is nothing between two samples."""
    values = coordinate.to_numpy()
    steps = [np.abs(np.diff(values, axis=k)).max(initial=0) for k in range(values.ndim)]
    degrees = str(coordinate.attrs.get("units", "")).startswith("degree")
    return degrees and bool(max(steps, default=0) > TURN / 2)
