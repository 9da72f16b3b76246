"""The command ``contourfair``.

Options and messages live here; what is computed, traced, drawn and stored is in the modules that
the commands call.  JAX and Matplotlib are imported by the commands that need them, so that
``contourfair --help`` answers at once.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from ._cli_contours import COMMANDS as CONTOURS
from ._cli_meshes import COMMANDS as MESHES
from ._cli_metrics import COMMANDS as METRICS
from ._cli_resample import COMMANDS as RESAMPLING
from ._console import Reporter
from ._describe import facts, information
from ._factors import Factor
from ._levels import check_choice
from ._options import (
    SUMMARY,
    WRITABLE,
    Bands,
    Count,
    Crop,
    Fill,
    Input,
    Interval,
    Iterations,
    Json,
    Key,
    Levels,
    Memory,
    Method,
    Periodic,
    Quiet,
    Resume,
    Sigma,
    Single,
    Weight,
    Workers,
    examples,
    output,
)
from ._recipe import Recipe, Settings
from ._run import check_fairable, fair, precision
from ._steps import check_suffix, levels_of, load
from ._upsample import upsample_whole
from ._upsample_tiles import Division, is_tiled, upsample_in_tiles
from ._window import choose_window
from .io import InputError, read

app = typer.Typer(
    name="contourfair",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from . import __version__

        typer.echo(f"contourfair {__version__}")
        raise typer.Exit


@app.callback(
    help=SUMMARY,
    epilog=examples(
        "contourfair upsample dem.tif -o dem_4x.tif --factor 4",
        "contourfair contours dem.tif -o lines.geojson --interval 20",
        "contourfair compare photo.png -o figure.png",
    ),
)
def _options_of_all(
    show_version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True),
    ] = False,
) -> None:
    """Options of the program itself; `SUMMARY` is its help."""


@app.command(
    epilog=examples(
        "contourfair upsample dem.tif -o dem_4x.tif",
        "contourfair upsample image.tif -o image_2x.tif --all-bands --factor 2",
        "contourfair upsample scan.npz --key data -o scan_2x.npz --factor 2",
        "contourfair upsample head.nii.gz -o head_even.nii.gz --factor z=4",
        "contourfair upsample big.zarr -o big_4x.zarr --workers 2 --resume",
    )
)
def upsample(
    source: Input,
    target: Annotated[Path, output(f"File for the finer samples: {WRITABLE}.")],
    factor: Annotated[
        str,
        typer.Option(
            "--factor",
            "-f",
            help="How many times finer; 1,1,4 for every axis in order, z=4 for one by its name.",
        ),
    ] = "4",
    method: Method = "local",
    iterations: Iterations = None,
    thin_plate_weight: Weight = None,
    sigma: Sigma = None,
    fill: Fill = False,
    periodic: Periodic = "",
    key: Key = None,
    bands: Bands = False,
    single: Single = False,
    workers: Workers = 1,
    resume: Resume = False,
    memory: Memory = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Refine samples on the fair field: every sample is kept, and positions stay right.

    The result has [bold]factor * (n - 1) + 1[/] samples per axis, [bold]factor * n[/] where it is
    periodic.  Missing samples stay missing.

    Zarr folders, and large .npy files, are written part by part: they need not fit in memory.
    """
    say = Reporter(quiet, as_json)
    finer = Factor.parse(factor)
    recipe = Recipe.parse(method, iterations, thin_plate_weight, sigma, fill, single, periodic)
    tiling = Division(workers, resume, memory)
    if bands and key is not None:
        raise InputError(f"--all-bands takes every band, so --key {key} has nothing to choose")
    if is_tiled(source, target, recipe, tiling) and not bands:
        made = upsample_in_tiles(source, target, key, finer, recipe, tiling, say)
    else:
        made = upsample_whole(source, target, key, finer, recipe, say, bands)
    say.done(target, str(made), shape=made.shape, type=made.dtype.name, missing=made.missing)


for _command, _examples in {**RESAMPLING, **CONTOURS}.items():
    app.command(epilog=_examples)(_command)


@app.command(
    epilog=examples(
        "contourfair compare dem.tif -o figure.png",
        "contourfair compare dem.tif -o figure.png --crop 120:180,200:260 --interval 20",
    )
)
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


for _command, _examples in {**MESHES, **METRICS}.items():
    app.command(epilog=_examples)(_command)


@app.command(epilog=examples("contourfair info dem.tif"))
def info(source: Input, key: Key = None, quiet: Quiet = False, as_json: Json = False) -> None:
    """Show what a file holds: size, type, range, spacing, place, missing samples."""
    grid = read(source, key)
    say = Reporter(quiet, as_json)
    for note in grid.notes:
        say.note(note)
    if as_json:
        say.result(facts(grid))
        return
    for name, text in information(grid):
        typer.echo(f"{name:<12} {text}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; errors are one line on stderr, with ``--json`` also one on stdout.

    Returns
    -------
    int
        0, or 2 for input that cannot be used, 1 for a fault of the program, 130 if interrupted.
    """
    command = typer.main.get_command(app)
    words = sys.argv[1:] if arguments is None else [*arguments]
    report = Reporter(as_json="--json" in words)
    try:
        result = command.main(
            args=words,
            prog_name="contourfair",
            standalone_mode=False,
        )
    except InputError as error:
        report.error(str(error))
        return 2
    except _USAGE as error:
        message = error.format_message()
        if message:  # empty where the help was shown for want of arguments
            report.error(f"{message} (contourfair --help shows how it is used)")
        return 2
    except (KeyboardInterrupt, typer.Abort):
        result = _INTERRUPTED
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            report.error(f"{os.fsdecode(error.filename)}: {error.strerror}")
            return 2
        if os.environ.get("CONTOURFAIR_TRACEBACK"):
            traceback.print_exc()
        first = (str(error).splitlines() or [""])[0]
        report.error(
            f"internal error, {type(error).__name__}: {first} "
            "(set CONTOURFAIR_TRACEBACK=1 for details)"
        )
        return 1
    if result == _INTERRUPTED:  # from Typer too, which says nothing
        report.error("interrupted")
    return result if isinstance(result, int) else 0


_INTERRUPTED = 130
# The base of all errors about how a command is called; Typer exports its subclass only.
_USAGE: Any = typer.BadParameter.__mro__[2]


if __name__ == "__main__":
    sys.exit(main())
