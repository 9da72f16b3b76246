"""``contourfair upsample``, of samples and results that fit in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ._console import Reporter
from ._describe import Output, by
from ._factors import Factor
from ._recipe import Recipe
from ._run import check_fairable, fair, precision, result_dtype
from ._steps import as_between, load, load_bands, warn_narrowing
from .io import Grid, check_writable, write_bands


def upsample_whole(
    source: Path,
    target: Path,
    key: str | None,
    factor: Factor,
    recipe: Recipe,
    say: Reporter,
    bands: bool = False,
) -> Output:
    """Read, refine and write; with `bands`, all of the file, each by itself.

    Raises
    ------
    InputError
        The file cannot be read, faired or written.
    """
    if bands:
        grids = load_bands(source, target, recipe, say)
    else:
        grids = (load(source, key, target, recipe, say),)
    factors = factor.of(grids[0])
    for grid in grids:
        check_fairable(grid, factors)
    dtype = np.result_type(*(result_dtype(grid, recipe.single) for grid in grids))
    check_writable(target, *(as_between(each, dtype, max(factors) > 1) for each in grids))
    warn_narrowing(grids[0], recipe.single, say)
    around = recipe.axes(grids[0])
    shape, count = grids[0].shape, len(grids)
    several: tuple[int, ...] = (count,) if count > 1 else ()
    size = by(several + shape)
    results: list[Grid] = []
    with precision(recipe.single), say.working(f"fairing {size} samples") as move:
        for grid in grids:
            if several:
                move(len(results), len(grids))
            finer = np.asarray(fair(grid, recipe).refine(factors))
            for axis in around:  # the first sample of the next turn
                finer = np.delete(finer, -1, axis)
            results.append(grid.refined(finer.astype(dtype, copy=False), factors, around))
    with say.working(f"writing {target}"):
        notes = write_bands(target, results)
    for note in notes:
        say.note(note)
    return Output(several + results[0].shape, dtype, sum(each.missing_count for each in results))
