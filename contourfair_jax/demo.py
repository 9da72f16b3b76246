"""``python -m contourfair_jax.demo``: what fairing does to real terrain.

Writes finer samples, contours and a picture, and prints what was measured.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from . import metrics
from ._fair import fair_field
from ._fairing.global_fairing.method import GlobalFairing
from ._fairing.local_fairing.method import LocalFairing
from ._fairing.method import AbstractFairing
from ._fairing.tuning import tune
from ._field import BezierField
from ._grid.grid import Grid
from ._support.errors import InputError
from .cli._console import Reporter
from .cli._steps import float_width
from .contours import Contours
from .export import write_geojson
from .io import example, write
from .metrics import bilinear_field
from .plot import compare_figure, save_figure

FACTOR = 4
# Of the contours, in cells: 2 m.
TOLERANCE = 0.03
# The samples are whole metres: half a metre up, no contour runs along a plateau.
INTERVAL, OFFSET = 50.0, 0.5
# A narrow ridge that crosses the grid obliquely, and closer levels to show it.
ROWS, COLUMNS, CLOSE = (44, 62), (350, 370), 20.0
Method = Callable[[Grid], BezierField]
app = typer.Typer(add_completion=False)


def bilinear(grid: Grid) -> BezierField:
    """The bilinear interpolant as a Bezier field."""
    values = jnp.asarray(grid.values, dtype=float)
    # Only the samples of this field are used; its net need not be fair.
    net = jnp.zeros([3 * (n - 1) + 1 for n in grid.shape]).at[::3, ::3].set(values)
    return bilinear_field(BezierField(net, jnp.asarray(grid.spacing), jnp.asarray(grid.origin)))


def fairing(method: AbstractFairing) -> Method:
    """Fairing with the settings given."""

    def fair(grid: Grid) -> BezierField:
        values = jnp.asarray(grid.values, dtype=float)
        return fair_field(values, spacing=grid.spacing, origin=grid.origin, method=method)

    return fair


def tuned(grid: Grid) -> BezierField:
    """Global fairing with settings chosen by cross-validation on the samples."""
    return fairing(tune(jnp.asarray(grid.values, dtype=float), spacing=grid.spacing))(grid)


METHODS: Mapping[str, Method] = {
    "bilinear": bilinear,
    "thin plate": fairing(LocalFairing(iterations=0)),
    "local": fairing(LocalFairing()),
    "global": fairing(GlobalFairing()),
}

# The method whose samples and contours are written.
STORED = "global"


@dataclass(frozen=True)
class Measures:
    """What the table shows of one method.

    Parameters
    ----------
    sample_error
        Largest difference between the field and a sample.
    slope_jump
        Largest jump of the slope between cells, over the largest slope.
    contours
        Number of contour components over all levels.
    turns
        How far all contours turn in total, either way, in full turns.
    bending
        Squared curvature integrated along all contours, per length.
    seconds
        Time to build the field, compilation included.
    """

    sample_error: float
    slope_jump: float
    contours: int
    turns: float
    bending: float
    seconds: float


def measure(field: BezierField, grid: Grid, lines: Contours, seconds: float) -> Measures:
    """The figures of one method."""
    index = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), axis=-1)
    points = np.asarray(grid.origin) + np.asarray(grid.spacing) * index
    at_samples = np.asarray(field(points, outside="extend"))  # pyright: ignore
    levels = metrics.level_metrics(lines, step=0.25 * min(grid.spacing))
    return Measures(
        sample_error=float(np.max(np.abs(at_samples - grid.values))),
        slope_jump=metrics.c1_jump(field),
        contours=len(lines),
        turns=sum(level.turning for level in levels) / (2 * np.pi),
        bending=sum(level.bending for level in levels),
        seconds=seconds,
    )


def levels_between(values: np.ndarray, interval: float) -> list[float]:
    """Levels `interval` apart, half a metre above its multiples."""
    first = np.ceil((values.min() - OFFSET) / interval)
    return np.arange(first * interval + OFFSET, values.max(), interval).tolist()


def cut(field: BezierField, rows: tuple[int, int], columns: tuple[int, int]) -> BezierField:
    """The part of a 2-D field between samples, the second of each pair left out."""
    (top, bottom), (left, right) = rows, columns
    net = field.control_points[3 * top : 3 * bottom - 2, 3 * left : 3 * right - 2]
    origin = field.origin + field.spacing * jnp.array([top, left], field.dtype)
    return BezierField(net, field.spacing, origin)


def render(rows: Mapping[str, Measures]) -> Table:
    """The table of methods."""
    table = Table(title=f"contours every {INTERVAL:g} m")
    table.add_column("method")
    headings = ("error at\nsamples, m", "slope jump,\nrelative", "contours", "turns")
    for heading in (*headings, "bending,\n1/m", "build, s"):
        table.add_column(heading, justify="right")
    for name, row in rows.items():
        table.add_row(
            name,
            f"{row.sample_error:.0e}",
            f"{row.slope_jump:.0e}",
            f"{row.contours}",
            f"{row.turns:.0f}",
            f"{row.bending:.0f}",
            f"{row.seconds:.1f}",
        )
    return table


def picture(fields: Mapping[str, BezierField], grid: Grid, path: Path) -> None:
    """Draw a small part of every field, with its contours, side by side."""
    part = grid.values[slice(*ROWS), slice(*COLUMNS)]
    panels = {name: cut(field, ROWS, COLUMNS) for name, field in fields.items()}
    title = f"contours every {CLOSE:g} m; dots are the samples"
    figure = compare_figure(panels, levels_between(part, CLOSE), refine=20, title=title)
    save_figure(figure, path, dpi=80)


def store(field: BezierField, lines: Contours, grid: Grid, folder: Path) -> list[Path]:
    """Write the finer samples, as GeoTIFF where rasterio is installed, and the contours."""
    suffix = ".tif" if find_spec("rasterio") else ".npz"
    samples, contours = folder / f"terrain_{FACTOR}x{suffix}", folder / "contours.geojson"
    finer = np.asarray(field.refine(FACTOR), dtype=np.float32)
    write(samples, grid.refined(finer, FACTOR))
    write_geojson(contours, lines, grid)
    return [samples, contours]


def run(
    grid: Grid, folder: Path, methods: Mapping[str, Method], say: Reporter
) -> tuple[dict[str, Measures], list[Path]]:
    """Build the fields, write the files; returns what was measured and the names of the files."""
    levels = levels_between(grid.values, INTERVAL)
    fields, rows, written = {}, {}, []
    for name, method in methods.items():
        with say.working(f"{name}: building the field, measuring its contours"):
            start = time.perf_counter()
            fields[name] = field = jax.block_until_ready(method(grid))
            seconds = time.perf_counter() - start
            lines = field.contours(levels, TOLERANCE)
            rows[name] = measure(field, grid, lines, seconds)
        if name == STORED:
            with say.working(f"writing to {folder}"):
                written += store(field, lines, grid, folder)
    with say.working("drawing"):
        written.append(folder / "comparison.png")
        picture(fields, grid, written[-1])
    return rows, written


@app.command()
def main(
    folder: Annotated[Path, typer.Option(help="Where to write.")] = Path("demo"),
    tune: Annotated[
        bool, typer.Option("--tune", help="Also with settings chosen by cross-validation.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
) -> None:
    """Fair the bundled terrain; write finer samples, contours and a picture; print a table."""
    say, console = Reporter(quiet), Console(highlight=False)
    grid = example("jacksboro")
    methods = {**METHODS, "tuned": tuned} if tune else METHODS
    console.print("Terrain around Jacksboro, Tennessee (NASA SRTM, public domain)")
    console.print(f"{grid.shape[0]} x {grid.shape[1]} samples, whole metres, every sample kept\n")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with float_width(single=False):
            rows, written = run(grid, folder, methods, say)
    except (InputError, OSError) as error:
        say.error(str(error))
        raise typer.Exit(2) from error
    console.print(render(rows))
    for path in written:
        console.print(f"wrote {path}")


if __name__ == "__main__":
    app()
