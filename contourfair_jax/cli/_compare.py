"""The command ``compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np

from .._grid.grid import Grid
from .._support.errors import InputError
from ._console import Reporter
from ._levels import check_level_options
from ._options import (
    Count,
    Crop,
    Input,
    Interval,
    Json,
    Key,
    Levels,
    Quiet,
    Single,
    examples,
    output,
    with_options,
)
from ._recipe import Fairing, Recipe
from ._steps import check_fairable, check_suffix, fair, float_width, levels_of, load

SIZE = 32


def choose_window(grid: Grid, crop: str | None) -> tuple[list[tuple[int, int]], str]:
    """Row and column ranges for the option ``--crop``, and a note or ``""``.

    ``r0:r1,c0:c1`` are sample numbers, the second of a pair not included; ``all`` is the whole
    grid; None is the busiest window of a grid that is larger than one.
    """
    whole = [(0, n) for n in grid.shape]
    if crop is None:
        ranges = busiest_window(grid.values, SIZE)
        note = f"the busiest {SIZE} x {SIZE} samples are shown; --crop takes others, or all"
        return ranges, "" if ranges == whole else note
    if crop == "all":
        return whole, ""
    try:
        (top, bottom), (left, right) = (map(int, part.split(":")) for part in crop.split(","))
    except ValueError as error:
        raise InputError(f"crop must look like 10:60,20:70 or be 'all', got {crop!r}") from error
    return [(top, bottom), (left, right)], ""


def busiest_window(values: np.ndarray, size: int) -> list[tuple[int, int]]:
    """Ranges of the window, `size` samples wide at most, whose values change most.

    Windows with missing samples are taken only where there is no other.
    """
    ranges = [(0, n) for n in values.shape]
    if max(values.shape) <= size:
        return ranges
    steps = np.sum(np.abs(np.gradient(values.astype(np.float64))), axis=0)
    best, busiest = -1.0, ranges
    stride = max(1, size // 4)
    starts = [
        sorted({*range(0, max(n - size, 0) + 1, stride), max(n - size, 0)}) for n in values.shape
    ]
    for row in starts[0]:
        for column in starts[1]:
            part = steps[row : row + size, column : column + size]
            gaps = np.isnan(part)
            score = float(part[~gaps].mean()) * (~gaps).mean() ** 4 if not gaps.all() else 0.0
            if score > best:
                best = score
                busiest = [
                    (row, min(row + size, values.shape[0])),
                    (column, min(column + size, values.shape[1])),
                ]
    return busiest


@with_options
def compare(
    source: Input,
    target: Annotated[Path, output("Picture to write, a .png.")],
    levels: Levels = None,
    interval: Interval = None,
    count: Count = None,
    crop: Crop = None,
    *,
    fairing: Fairing,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Show bilinear, thin plate and fair contours of the same samples side by side."""
    from .._bezier.linear import BilinearField
    from ..plot import compare_figure, save_figure

    say = Reporter(quiet, as_json)
    check_suffix(target, (".png",))
    recipe = Recipe.parse(fairing, single)
    check_level_options(levels, interval, count)
    whole = load(source, key, target, recipe, say)
    check_fairable(whole, ndim=(2,))
    ranges, note = choose_window(whole, crop)
    if note:
        say.note(note)
    grid = whole.crop(ranges)
    (top, bottom), (left, right) = ranges
    shown = f"rows {top}:{bottom}, columns {left}:{right}"
    check_fairable(grid, ndim=(2,))
    chosen = levels_of(grid, levels, interval, count, say)
    with float_width(single), say.working("fairing the samples and drawing"):
        plain = fair(grid, Recipe("local", {"iterations": 0}))
        faired = fair(grid, recipe)
        panels = {
            "bilinear": BilinearField(grid.values, grid.spacing, grid.origin),
            "thin plate": plain,
            "faired": faired,
        }
        figure = compare_figure(panels, chosen, grid=grid, title=f"{source.name}: {shown}")
        save_figure(figure, target)
    say.done(target, f"{shown}, {len(chosen)} levels", window=ranges, levels=chosen)


COMMANDS = {
    compare: examples(
        "contourfair compare dem.tif -o figure.png",
        "contourfair compare dem.tif -o figure.png --crop 120:180,200:260 --interval 20",
    ),
}
