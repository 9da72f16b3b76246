"""What several commands do: read the input, fair it, check the names of files, choose levels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ._apart import check_apart
from ._axis_units import degrees_note
from ._console import Reporter
from ._describe import by, describe_missing, missing_note
from ._levels import choose_levels
from ._recipe import Recipe
from ._run import fair, precision, result_dtype
from .io import Grid, InputError, read, read_bands
from .io._atomic import check_parent, check_target
from .io._geometry import seam_note

if TYPE_CHECKING:
    from ._field import BezierField

# Samples of a volume from which on local fairing, with normals, takes minutes.
_SLOW = 300_000
# Where samples of a field lie between those of whole numbers.
_BETWEEN = 0.25


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
    """What is faster, where fairing takes minutes."""
    if recipe.method != "local" or recipe.settings.iterations == 0:
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
    with precision(recipe.single), say.working(f"fairing {size} samples"):
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
    if target.suffix.lower() not in known:
        raise InputError(f"{target}: the name must end in {', '.join(known)}")
    check_target(target)


@contextmanager
def as_input() -> Iterator[None]:
    """What the engine refuses is input that cannot be used, to be told in one line."""
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
