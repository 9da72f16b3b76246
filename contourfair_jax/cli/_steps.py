"""Steps that several commands share: read the input, fair it, check names of files, choose levels.

The engine, and with it JAX, is imported when something is computed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._grid.affine import describe_factors, refined_shape, seam_note
from .._grid.grid import Grid, exact_float
from .._grid.periodic import with_turns
from .._grid.reference import degrees_note
from .._resample import one_turn
from .._support.errors import InputError
from .._support.memory import check_memory
from ..io import read, read_bands
from ..io._outputs import check_apart, check_parent, check_target, known_suffix
from ._console import Reporter
from ._levels import choose_levels
from ._recipe import Recipe
from ._words import by, describe_missing, missing_note

if TYPE_CHECKING:
    from .._field import BezierField


# Samples of a volume from which on local fairing, with normals, takes minutes.
_SLOW = 300_000
# Where samples of a field lie between those of whole numbers.
_BETWEEN = 0.25


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
def float_width(single: bool) -> Iterator[None]:
    """Work in float64 here, or in float32 where `single` asks for it, whatever the process does."""
    import jax

    with jax.enable_x64(not single):
        yield


def fair(grid: Grid, recipe: Recipe) -> BezierField:
    """The fair field of the samples, in field coordinates, in the present `float_width`.

    Along periodic axes the field goes on to the first sample of the next turn.

    Raises
    ------
    InputError
        The samples cannot be faired so.
    """
    import jax
    import jax.numpy as jnp

    from .._bezier.nets import without_gaps
    from .._fair import fair_field

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


def load(
    source: Path,
    key: str | None,
    target: Path | None,
    recipe: Recipe,
    say: Reporter,
) -> Grid:
    """Read the samples and tell what is to be known about them where they are faired so."""
    return _load(lambda: (read(source, key),), source, target, recipe, say)[0]


def load_bands(source: Path, target: Path, recipe: Recipe, say: Reporter) -> tuple[Grid, ...]:
    """As `load`, for all bands of a file; what holds for several of them is told once."""
    return _load(lambda: read_bands(source), source, target, recipe, say)


def _load(
    reading: Callable[[], tuple[Grid, ...]],
    source: Path,
    target: Path | None,
    recipe: Recipe,
    say: Reporter,
) -> tuple[Grid, ...]:
    if target is not None:
        check_parent(target)
        check_apart(source, target)
    with say.working(f"reading {source}"):
        grids = reading()
    notes = [
        note for grid in grids for note in _of_grid(grid, recipe.periodic) + degrees_note(grid)
    ]
    notes += [
        missing_note(describe_missing(grid), recipe.fill)
        for grid in grids
        if grid.missing is not None
    ]
    notes += [note for grid in grids for note in _of_speed(grid, recipe)]
    for note in dict.fromkeys(notes):
        say.note(note)
    return grids


def _of_speed(grid: Grid, recipe: Recipe) -> tuple[str, ...]:
    """A note on the faster method, where fairing takes minutes."""
    if recipe.method != "local" or recipe.settings.get("iterations") == 0:
        return ()
    if grid.ndim < 3 or grid.values.size < _SLOW:
        return ()
    return ("local fairing of a volume this large takes minutes, --method global a tenth of that",)


def _of_grid(grid: Grid, joined: Sequence[str] | None) -> tuple[str, ...]:
    """The notes of a grid, as they are where seams can be joined."""
    if joined is None:
        return grid.notes
    seams = {seam_note(name): name for name in grid.axes}
    return tuple(
        f"{note} (--periodic {seams[note]} joins them)" if note in seams else note
        for note in grid.notes
        if seams.get(note) not in joined
    )


def faired(grid: Grid, recipe: Recipe, say: Reporter) -> BezierField:
    """The fair field of the samples, in the precision that is asked for."""
    size = by(grid.shape)
    with float_width(recipe.single), say.working(f"fairing {size} samples"):
        return fair(grid, recipe)


def as_between(grid: Grid, dtype: np.dtype, between: bool = True) -> Grid:
    """The samples as those of a fair field are: of its type, and between whole numbers."""
    values = grid.values.astype(dtype)
    return replace(grid, values=values + dtype.type(_BETWEEN) if between else values)


def warn_narrowing(grid: Grid, single: bool, say: Reporter) -> None:
    """Tell where float32 loses digits of the samples."""
    if single and result_dtype(grid, False) != np.float32:
        say.note(f"--float32: {grid.source_dtype} samples are rounded to 7 digits")


def check_suffix(target: Path, known: tuple[str, ...]) -> None:
    """Refuse an output whose ending says no known kind of file, or that cannot become a file."""
    known_suffix(target, known)
    check_target(target)


@contextmanager
def as_input() -> Iterator[None]:
    """Turn ValueErrors of the engine into InputErrors, which are told in one line."""
    try:
        yield
    except InputError:
        raise
    except ValueError as error:
        raise InputError(str(error)) from error


def levels_of(
    grid: Grid, levels: str | None, interval: float | None, count: int | None, say: Reporter
) -> list[float]:
    """The levels that the options ask for."""
    chosen, note = choose_levels(grid.values, levels, interval, count)
    if note:
        say.note(note)
    return chosen
