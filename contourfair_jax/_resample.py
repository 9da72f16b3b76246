"""The fair field at the samples of another grid, or cut to one turn of periodic axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ._grid.grid import Grid
from ._grid.periodic import margin_of
from ._grid.resample import NEAR

if TYPE_CHECKING:
    from ._field import BezierField


# Points that are evaluated at a time.
_BATCH = 1 << 18


def one_turn(field: BezierField, counts: Sequence[int | None]) -> BezierField:
    """The field from the first sample through that of the next turn.

    `counts` has the samples of one turn of each axis that was given its turns, else None.
    """
    part = tuple(
        slice(None) if n is None else slice(3 * margin_of(n), 3 * (margin_of(n) + n) + 1)
        for n in counts
    )
    return replace(field, control_points=field.control_points[part], report=None)


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
            places = np.where(abs(places - near) <= NEAR, near, places)
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
