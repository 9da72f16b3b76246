"""What the commands compute: a `Grid` in, samples of its fair field out.

The engine, and with it JAX, is imported when something is computed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .io import Grid, InputError, check_memory, exact_float

if TYPE_CHECKING:
    from . import BezierField
    from ._method import AbstractFairing


@dataclass(frozen=True)
class Settings:
    """The options that all methods share; None means the method's own default."""

    iterations: int | None = None
    thin_plate_weight: float | None = None


def _chosen(method: AbstractFairing, settings: Settings) -> AbstractFairing:
    """The method with the settings that were given."""
    given = {name: value for name, value in vars(settings).items() if value is not None}
    return replace(method, **given)


def _local(grid: Grid, settings: Settings) -> AbstractFairing:
    from . import LocalFairing

    return _chosen(LocalFairing(), settings)


def _global(grid: Grid, settings: Settings) -> AbstractFairing:
    from . import GlobalFairing

    return _chosen(GlobalFairing(), settings)


def _tuned(grid: Grid, settings: Settings) -> AbstractFairing:
    import jax.numpy as jnp

    from . import tune

    return _chosen(tune(jnp.asarray(grid.values, dtype=float), spacing=grid.spacing), settings)


# A method is chosen by its name; it may look at the samples.
METHODS: Mapping[str, Callable[[Grid, Settings], AbstractFairing]] = {
    "local": _local,
    "global": _global,
    "tune": _tuned,
}


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


def check_fairable(grid: Grid, factor: int = 1, ndim: tuple[int, ...] = (2, 3)) -> None:
    """Refuse, in one line, what cannot be faired or would not fit in memory."""
    check_axes(grid, ndim)
    shape = " x ".join(str(n) for n in grid.shape)
    net = math.prod(3 * (n - 1) + 1 for n in grid.shape)
    finer = math.prod(factor * (n - 1) + 1 for n in grid.shape)
    check_memory(8 * (2 * net + 2 * finer), f"fairing {shape} samples and refining by {factor}")


def result_dtype(grid: Grid, single: bool) -> np.dtype:
    """float32 where it holds every sample of the source exactly, else float64."""
    return np.dtype(np.float32) if single else exact_float(grid.source_dtype)


@contextmanager
def precision(single: bool) -> Iterator[None]:
    """Work in float64 here, or in float32 where `single` asks for it, whatever the process does."""
    import jax

    with jax.enable_x64(not single):
        yield


def choose_method(grid: Grid, method: str, settings: Settings) -> AbstractFairing:
    """The method of a name with the settings that were given.

    Raises
    ------
    InputError
        The method is unknown or a setting is out of its range.
    """
    if method not in METHODS:
        raise InputError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    try:
        return METHODS[method](grid, settings)
    except ValueError as error:
        raise InputError(str(error)) from error


def check_fill(method: str, fill: bool) -> None:
    """Refuse to fill gaps by a method that leaves them."""
    if fill and method == "local":
        raise InputError("--fill needs --method global or tune; local fairing leaves gaps")


def fair(grid: Grid, method: str, settings: Settings, fill: bool = False) -> BezierField:
    """The fair field of the samples, in field coordinates, in the present `precision`.

    Cells with a missing corner have no values, unless `fill` is set.

    Raises
    ------
    InputError
        The method is unknown or a setting is out of its range.
    """
    import jax
    import jax.numpy as jnp

    from . import fair_field
    from ._gaps import without_gaps

    check_fill(method, fill)
    values = jnp.asarray(grid.values, dtype=float)
    chosen = choose_method(grid, method, settings)
    try:
        field = fair_field(values, spacing=grid.spacing, origin=grid.origin, method=chosen)
    except ValueError as error:
        raise InputError(str(error)) from error
    if grid.missing is not None and not fill:
        net = without_gaps(field.control_points, grid.missing)
        field = replace(field, control_points=net)
    return jax.block_until_ready(field)
