"""What the commands compute: a `Grid` in, samples of its fair field out.

The engine, and with it JAX, is imported when something is computed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ._factors import describe_factors
from ._periodic import one_turn, with_turns
from ._recipe import Recipe
from .io import Grid, InputError, check_memory, exact_float
from .io._geometry import refined_shape

if TYPE_CHECKING:
    from . import BezierField


def check_axes(grid: Grid, ndim: tuple[int, ...] = (2, 3)) -> None:
    """Refuse, in one line, what cannot be faired."""
    shape = " x ".join(str(n) for n in grid.shape)
    if grid.ndim not in ndim:
        wanted = " or ".join(f"{n}-D" for n in ndim)
        raise InputError(f"the samples are {grid.ndim}-D ({shape}); {wanted} data is needed")
    for name, n in zip(grid.axes, grid.shape, strict=True):
        if n < 3:
            raise InputError(
                f"axis {name!r} has {n} sample{'s' * (n > 1)} ({shape} in all); "
                "fairing needs at least 3 along every axis"
            )
    if grid.missing is not None and grid.missing.all():
        raise InputError("every sample is missing, so there is nothing to fair")


def check_fairable(
    grid: Grid, factors: Sequence[int] | None = None, ndim: tuple[int, ...] = (2, 3)
) -> None:
    """Refuse, in one line, what cannot be faired, or refined so, or would not fit in memory."""
    check_axes(grid, ndim)
    factors = (1,) * grid.ndim if factors is None else factors
    shape = " x ".join(str(n) for n in grid.shape)
    net = math.prod(3 * (n - 1) + 1 for n in grid.shape)
    finer, times = math.prod(refined_shape(grid.shape, factors)), describe_factors(factors)
    check_memory(8 * (2 * net + 2 * finer), f"fairing {shape} samples and refining by {times}")


def result_dtype(grid: Grid, single: bool) -> np.dtype:
    """float32 where it holds every sample of the source exactly, else float64."""
    return np.dtype(np.float32) if single else exact_float(grid.source_dtype)


@contextmanager
def precision(single: bool) -> Iterator[None]:
    """Work in float64 here, or in float32 where `single` asks for it, whatever the process does."""
    import jax

    with jax.enable_x64(not single):
        yield


def fair(grid: Grid, recipe: Recipe) -> BezierField:
    """The fair field of the samples, in field coordinates, in the present `precision`.

    Along periodic axes the field goes on to the first sample of the next turn.

    Raises
    ------
    InputError
        The samples cannot be faired so.
    """
    import jax
    import jax.numpy as jnp

    from . import fair_field
    from ._gaps import without_gaps

    around = recipe.axes(grid)
    values, missing = grid.values, grid.missing
    for axis in around:
        values = with_turns(values, axis)
        missing = None if missing is None else with_turns(missing, axis)
    chosen = recipe.choose(grid)
    try:
        field = fair_field(
            jnp.asarray(values, dtype=float),
            spacing=grid.spacing,
            origin=grid.origin,
            method=chosen,
        )
    except ValueError as error:
        raise InputError(str(error)) from error
    if missing is not None and not recipe.fill:
        field = replace(field, control_points=without_gaps(field.control_points, missing))
    if around:
        field = one_turn(field, [n if k in around else None for k, n in enumerate(grid.shape)])
    return jax.block_until_ready(field)
