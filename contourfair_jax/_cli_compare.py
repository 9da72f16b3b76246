"""The command ``compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ._console import Reporter
from ._levels import check_choice
from ._options import (
    Count,
    Crop,
    Fill,
    Input,
    Interval,
    Iterations,
    Json,
    Key,
    Levels,
    Method,
    Quiet,
    Sigma,
    Single,
    Weight,
    examples,
    output,
)
from ._recipe import Recipe, Settings
from ._run import check_fairable, fair, precision
from ._steps import check_suffix, levels_of, load
from ._window import choose_window


def compare(
    source: Input,
    target: Annotated[Path, output("Picture to write, a .png.")],
    levels: Levels = None,
    interval: Interval = None,
    count: Count = None,
    crop: Crop = None,
    method: Method = "local",
    iterations: Iterations = None,
    thin_plate_weight: Weight = None,
    sigma: Sigma = None,
    fill: Fill = False,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Show bilinear, thin plate and fair contours of the same samples side by side."""
    from .plot import BilinearField, compare_figure, save_figure

    say = Reporter(quiet, as_json)
    check_suffix(target, (".png",))
    recipe = Recipe.parse(method, iterations, thin_plate_weight, sigma, fill, single)
    check_choice(levels, interval, count)
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
    with precision(single), say.working("fairing the samples and drawing"):
        plain = fair(grid, Recipe("local", Settings(iterations=0)))
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
