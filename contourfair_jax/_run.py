"""What the commands compute: a `Grid` in, samples of its fair field out.

The engine, and with it JAX, is imported when something is computed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ._factors import describe_factors
from ._periodic import check_turn, one_turn, with_turns
from .io import Grid, InputError, check_memory, exact_float
from .io._geometry import refined_shape, spacing_of

if TYPE_CHECKING:
    from . import BezierField
    from ._method import AbstractFairing


@dataclass(frozen=True)
class Settings:
    """The options for methods; None means the method's own default.

    `noisy` asks for the noise `sigma` that suits the samples best.
    """

    iterations: int | None = None
    thin_plate_weight: float | None = None
    sigma: float | None = None
    noisy: bool = False

    @staticmethod
    def parse(iterations: int | None, weight: float | None, sigma: str | None) -> Settings:
        """Settings of the command line, where sigma is a number or ``auto``."""
        if sigma is None or sigma.strip().lower() == "auto":
            return Settings(iterations, weight, noisy=sigma is not None)
        try:
            return Settings(iterations, weight, float(sigma))
        except ValueError:
            raise InputError(
                f"--sigma must be a number, in the units of the samples, or auto, got {sigma!r}"
            ) from None


def _chosen(method: AbstractFairing, settings: Settings) -> AbstractFairing:
    """The method with the settings that were given."""
    given = {name: value for name, value in vars(settings).items() if value is not None}
    del given["noisy"]
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

    values = jnp.asarray(grid.values, dtype=float)
    return _chosen(tune(values, spacing=grid.spacing, noisy=settings.noisy), settings)


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


def choose_method(grid: Grid, method: str, settings: Settings) -> AbstractFairing:
    """The method of a name with the settings that were given.

    Raises
    ------
    InputError
        The method is unknown or a setting is out of its range.
    """
    check_options(method, settings)
    try:
        return METHODS[method](grid, settings)
    except ValueError as error:
        raise InputError(str(error)) from error


def check_options(method: str, settings: Settings, fill: bool = False) -> None:
    """Refuse what no samples could be faired with, before any are read.

    Raises
    ------
    InputError
        The method is unknown, a setting is out of its range, or the method fills no gaps.
    """
    if method not in METHODS:
        raise InputError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    check_fill(method, fill)
    if method == "local" and (settings.noisy or settings.sigma is not None):
        raise InputError(
            "--sigma needs --method global or tune; local fairing passes through every sample"
        )
    if settings.noisy and method != "tune":
        raise InputError("--sigma auto needs --method tune; with others give a number")
    if settings == Settings():
        return
    from . import GlobalFairing, LocalFairing

    try:
        _chosen(LocalFairing() if method == "local" else GlobalFairing(), settings)
    except ValueError as error:
        raise InputError(str(error)) from error


def check_fill(method: str, fill: bool) -> None:
    """Refuse to fill gaps by a method that leaves them."""
    if fill and method == "local":
        raise InputError("--fill needs --method global or tune; local fairing leaves gaps")


def periodic_names(names: str | None) -> list[str]:
    """The names of the option ``--periodic``, which are separated by commas."""
    return [name.strip() for name in names.split(",")] if names else []


def periodic_axes(grid: Grid, names: str | None) -> tuple[int, ...]:
    """The axes of the names, separated by commas, that go all the way round.

    Raises
    ------
    InputError
        The grid has no such axis, or one that is in degrees and covers no full turn.
    """
    wanted = periodic_names(names)
    for name in wanted:
        if name not in grid.axes:
            raise InputError(
                f"--periodic: there is no axis {name!r}; there are {', '.join(grid.axes)}"
            )
        axis = grid.axes.index(name)
        step = grid.spacing[axis] if grid.affine is None else spacing_of(grid.affine)[axis]
        try:
            check_turn(name, grid.shape[axis], step, grid.metadata.get(f"{name}:units", ""))
        except ValueError as error:
            raise InputError(f"--periodic: {error}") from error
    return tuple(grid.axes.index(name) for name in dict.fromkeys(wanted))


def fair(
    grid: Grid,
    method: str,
    settings: Settings,
    fill: bool = False,
    periodic: tuple[int, ...] = (),
) -> BezierField:
    """The fair field of the samples, in field coordinates, in the present `precision`.

    Cells with a missing corner have no values, unless `fill` is set.  Along `periodic` axes the
    field goes on to the first sample of the next turn.

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
    values, missing = grid.values, grid.missing
    for axis in periodic:
        values = with_turns(values, axis)
        missing = None if missing is None else with_turns(missing, axis)
    chosen = choose_method(grid, method, settings)
    try:
        field = fair_field(
            jnp.asarray(values, dtype=float),
            spacing=grid.spacing,
            origin=grid.origin,
            method=chosen,
        )
    except ValueError as error:
        raise InputError(str(error)) from error
    if missing is not None and not fill:
        field = replace(field, control_points=without_gaps(field.control_points, missing))
    if periodic:
        field = one_turn(field, [n if k in periodic else None for k, n in enumerate(grid.shape)])
    return jax.block_until_ready(field)
