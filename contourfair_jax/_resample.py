"""The fair field at the samples of another grid."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ._per_axis import PerAxis
from .io import Grid, InputError
from .io._cf import same_system
from .io._grid import no_samples

if TYPE_CHECKING:
    from ._field import BezierField

# Points that are evaluated at a time.
_BATCH = 1 << 18
# Points this near to samples along an axis, in steps, are there: coordinates are rounded.
_ROUNDED = 1e-6


def parse_spacing(text: str) -> PerAxis[float]:
    """What ``10``, ``2,1,1`` or ``z=1`` ask for.

    Raises
    ------
    InputError
        The text is none of these, or a number is not above zero.
    """
    wanted = (
        "a number such as 10, one for each axis such as 2,1,1, or given by names such as z=1, in "
        "the units of the coordinates"
    )
    given = PerAxis.parse("--spacing", text, float, wanted)
    if not all(0 < step < math.inf for step in given.numbers):
        raise InputError(f"--spacing must be above zero, got {text}")
    return given


def spaced(grid: Grid, steps: Sequence[float]) -> Grid:
    """An outline from the first sample of the grid on, with other steps, within its samples.

    Raises
    ------
    InputError
        A step is longer than the grid.
    """
    ratios = np.asarray(steps) / grid.steps
    last = np.asarray(grid.shape) - 1
    for name, step, whole in zip(grid.axes, steps, last * grid.steps, strict=True):
        if step > whole * (1 + _ROUNDED):
            raise InputError(
                f"--spacing {step:g} is longer than all of axis {name!r}, {whole:g} in the "
                "coordinates of the file"
            )
    shape = tuple(int(n) + 1 for n in np.floor(last / ratios + _ROUNDED))
    return grid.on_finer(no_samples(shape, grid.values.dtype), (1 / ratios).tolist())


def alike(grid: Grid, other: Grid) -> Grid:
    """An outline with what `grid` says of its samples, where those of `other` lie.

    Raises
    ------
    InputError
        The grids have no common coordinates.
    """
    if grid.ndim != other.ndim:
        raise InputError(f"--like is {other.ndim}-D, the samples are {grid.ndim}-D")
    if grid.axes != other.axes and set(grid.axes) == set(other.axes):
        raise InputError(
            f"--like has the axes {', '.join(other.axes)}, the samples {', '.join(grid.axes)}: "
            "both must be in one order"
        )
    if (grid.affine is None) != (other.affine is None):
        which = "the samples lie" if grid.affine is None else "those of --like lie"
        raise InputError(f"it is not known where {which}, so the files have no common coordinates")
    if grid.crs and other.crs and not same_system(grid.crs, other.crs):
        raise InputError("--like has another coordinate reference system; reproject one of them")
    ratios = np.asarray(grid.steps) / other.steps
    return replace(
        grid.on_finer(no_samples(other.shape, grid.values.dtype), ratios.tolist()),
        origin=other.origin if other.affine is None else (),
        affine=other.affine,
        crs=grid.crs or other.crs,
    )


def coarsening(grid: Grid, outline: Grid) -> float:
    """How many times farther apart the samples of the outline are, along the worst axis."""
    return float(np.divide(outline.steps, grid.steps).max())


def resampled(
    field: BezierField, grid: Grid, outline: Grid, periodic: Sequence[int] = ()
) -> tuple[np.ndarray, int]:
    """Values of the field of a grid at the samples of an outline, and how many lie outside.

    Outside they are NaN.  Along periodic axes of the grid the field is repeated; it goes on to the
    first sample of the next turn.  Positions are computed in float64, and with them the values.
    """
    import jax

    to_index = np.linalg.solve(grid.from_index(), outline.from_index())
    size = outline.values.size
    last = np.asarray(field.shape) - 1.0
    samples = np.asarray(field.samples, np.float64)
    values, outside = np.empty(size), 0
    with jax.enable_x64(True):
        evaluate = _evaluation(field, min(_BATCH, size))
        for start in range(0, size, _BATCH):
            numbers = np.arange(start, min(start + _BATCH, size))
            index = np.stack(np.unravel_index(numbers, outline.shape), -1)
            places = index @ to_index[:-1, :-1].T + to_index[:-1, -1]
            for axis in periodic:
                places[:, axis] %= grid.shape[axis]
            near = np.rint(places).clip(0, last)
            places = np.where(abs(places - near) <= _ROUNDED, near, places)
            outside += int(((places < 0) | (places > last)).any(-1).sum())
            values[numbers] = _beside_gaps(evaluate, samples, places, evaluate(places))
    return values.reshape(outline.shape), outside


def _evaluation(field: BezierField, count: int) -> Callable[[np.ndarray], np.ndarray]:
    """The field in float64 at sample numbers, at most so many at a time; NaN outside."""
    import jax
    import jax.numpy as jnp

    net, ndim = jnp.asarray(field.control_points, np.float64), field.ndim
    one, zero = np.ones(ndim), np.zeros(ndim)
    unit = replace(field, control_points=net, spacing=one, origin=zero, report=None)
    values_at = jax.jit(lambda field, points: field(points))

    def evaluate(places: np.ndarray) -> np.ndarray:
        padded = np.zeros((count, ndim))
        padded[: len(places)] = places
        return np.asarray(values_at(unit, padded))[: len(places)]

    return evaluate


def _beside_gaps(
    evaluate: Callable[[np.ndarray], np.ndarray],
    samples: np.ndarray,
    places: np.ndarray,
    values: np.ndarray,
) -> np.ndarray:
    """The values, but samples themselves, and on faces those of any cell: some have gaps.

    Outside, where there are no values either, none is found.
    """
    values, whole = values.copy(), np.rint(places)
    for sides in list(np.ndindex((2,) * places.shape[1]))[1:]:
        meet = ((places == whole) | (np.array(sides) == 0)).all(-1)
        open_ = np.flatnonzero(np.isnan(values) & meet)
        if len(open_):
            below = np.where(sides, np.nextafter(places[open_], -np.inf), places[open_])
            values[open_] = evaluate(below)
    last = np.asarray(samples.shape) - 1
    there = np.flatnonzero(((places == whole) & (whole >= 0) & (whole <= last)).all(-1))
    values[there] = samples[tuple(whole[there].astype(int).T)]
    return values
