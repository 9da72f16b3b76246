"""``python -m contourfair_jax.demo``: what fairing does to real terrain.

Writes the finer samples, the contours and a picture, and prints what was measured.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import typer
from jaxtyping import Array, Float
from rich.console import Console
from rich.table import Table

from . import BezierField, LocalFairing, fair_field
from ._bilinear import BilinearField
from ._console import Reporter
from ._run import precision
from ._trace import trace
from .io import ContourLine, Grid, InputError, example, write, write_geojson
from .plot import compare_figure, save_figure

FACTOR = 4
# The samples are whole metres: half a metre up, no contour runs along a plateau.
INTERVAL, OFFSET = 50.0, 0.5
# A narrow ridge that crosses the grid obliquely, and closer levels to show it.
ROWS, COLUMNS, CLOSE = (44, 62), (350, 370), 20.0

Method = Callable[[Grid], BezierField]


@dataclass(frozen=True)
class Measures:
    """What the table shows of one method.

    Parameters
    ----------
    sample_error
        Largest difference between the field and a sample.
    slope_jump
        Largest jump of the slope across a cell face; zero for a C1 field, up to rounding.
    components
        Number of contours over all levels.
    turning
        How far all contours turn in total, either way, in full turns.
    seconds
        Time to build the field, compilation included.
    """

    sample_error: float
    slope_jump: float
    components: int
    turning: float
    seconds: float


def bilinear(grid: Grid) -> BezierField:
    """The bilinear interpolant as a Bezier field: its net is the interpolant at thirds."""
    net = BilinearField(grid.values).refine(3)
    return BezierField(jnp.asarray(net), jnp.asarray(grid.spacing), jnp.asarray(grid.origin))


def thin_plate(grid: Grid) -> BezierField:
    """Local fairing without iterations."""
    return _fair(grid, LocalFairing(iterations=0))


def faired(grid: Grid) -> BezierField:
    """Local fairing with its default settings."""
    return _fair(grid, LocalFairing())


METHODS: Mapping[str, Method] = {
    "bilinear": bilinear,
    "thin plate": thin_plate,
    "faired": faired,
}
# The method whose samples and contours are written.
SHOWN = "faired"


def _fair(grid: Grid, method: LocalFairing) -> BezierField:
    values = jnp.asarray(grid.values, dtype=float)
    return fair_field(values, spacing=grid.spacing, origin=grid.origin, method=method)


def slope_jump(field: BezierField) -> Float[Array, ""]:
    """Largest jump of the first derivative across the inner cell faces.

    On a face the jump is a polynomial whose Bezier points are `3 / h` times second differences of
    the net, so their largest size bounds it.
    """
    jumps = [jnp.zeros((), field.dtype)]
    for axis in range(field.ndim):
        net = jnp.moveaxis(field.control_points, axis, 0)
        jump = net[4::3] - 2 * net[3:-1:3] + net[2:-2:3]
        jumps.append(jnp.max(jnp.abs(jump)) * 3 / field.spacing[axis])
    return jnp.max(jnp.stack(jumps))


def turning(line: ContourLine) -> float:
    """Total absolute change of heading along a contour, in full turns."""
    edges = np.diff(line.points, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    # Where a line all but touches a grid vertex, tiny edges have no meaningful heading.
    edges = edges[lengths > 1e-6 * lengths.max()]
    headings = np.arctan2(edges[:, 0], edges[:, 1])
    if line.closed:
        headings = np.append(headings, headings[0])
    turns = (np.diff(headings) / (2 * np.pi) + 0.5) % 1 - 0.5
    return float(np.abs(turns).sum())


def measure(
    field: BezierField, grid: Grid, lines: Sequence[ContourLine], seconds: float
) -> Measures:
    """The figures of one method."""
    points = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), axis=-1)
    at_samples = field(field.origin + field.spacing * points, outside="extend")
    return Measures(
        sample_error=float(np.max(np.abs(np.asarray(at_samples) - grid.values))),
        slope_jump=float(slope_jump(field)),
        components=len(lines),
        turning=sum(turning(line) for line in lines),
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


def render(measures: Mapping[str, Measures], levels: Sequence[float], units: str) -> Table:
    """The table of methods."""
    table = Table(title=f"{len(levels)} levels, {INTERVAL:g} {units} apart")
    table.add_column("method")
    for heading in ("error at\nsamples", "largest jump\nof slope", "contours", "turns", "seconds"):
        table.add_column(heading, justify="right")
    for name, row in measures.items():
        table.add_row(
            name,
            f"{row.sample_error:.1e} {units}",
            f"{row.slope_jump:.1e}",
            f"{row.components}",
            f"{row.turning:.0f}",
            f"{row.seconds:.1f}",
        )
    return table


def picture(fields: Mapping[str, BezierField], grid: Grid, path: Path, dpi: float = 110) -> None:
    """Draw a small part of every field, with the contours, side by side."""
    part = grid.values[slice(*ROWS), slice(*COLUMNS)]
    panels = {name: cut(field, ROWS, COLUMNS) for name, field in fields.items()}
    title = f"contours every {CLOSE:g} {grid.units or 'm'}; dots are the samples"
    figure = compare_figure(panels, levels_between(part, CLOSE), title=title)
    save_figure(figure, path, dpi=dpi)


def write_results(grid: Grid, lines: Sequence[ContourLine], folder: Path) -> list[Path]:
    """Store the finer samples, as GeoTIFF where rasterio is installed, and the contours."""
    suffix = ".tif" if find_spec("rasterio") else ".npz"
    samples, contours = folder / f"terrain_4x{suffix}", folder / "contours.geojson"
    write(samples, grid)
    write_geojson(contours, lines, grid)
    return [samples, contours]


def run(grid: Grid, folder: Path, say: Reporter, console: Console) -> None:
    """Build the fields, write the files, print the table."""
    levels = levels_between(grid.values, INTERVAL)
    fields: dict[str, BezierField] = {}
    measures: dict[str, Measures] = {}
    written: list[Path] = []
    for name, method in METHODS.items():
        with say.working(f"{name}: building the field, tracing {len(levels)} levels"):
            start = time.perf_counter()
            field = fields[name] = jax.block_until_ready(method(grid))
            seconds = time.perf_counter() - start
            finer = grid.refined(np.asarray(field.refine(FACTOR)), FACTOR)
            lines = trace(finer, levels)
            measures[name] = measure(field, grid, lines, seconds)
        if name == SHOWN:
            with say.working(f"writing to {folder}"):
                stored = replace(finer, values=finer.values.astype(np.float32))
                written = write_results(stored, lines, folder)
    with say.working("drawing"):
        path = folder / "comparison.png"
        picture(fields, grid, path)
    console.print(render(measures, levels, grid.units or "m"))
    for file in [*written, path]:
        console.print(f"wrote {file}", highlight=False)


def main(
    folder: Annotated[Path, typer.Option(help="Where to write.")] = Path("demo"),
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
) -> None:
    """Fair the bundled terrain; write finer samples, contours and a picture; print a table."""
    say, console = Reporter(quiet), Console()
    grid = example("jacksboro")
    console.print("Terrain around Jacksboro, Tennessee (NASA SRTM, public domain):")
    console.print(f"{grid.shape[0]} x {grid.shape[1]} samples, {FACTOR} times refined", end="\n\n")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with precision(single=False):
            run(grid, folder, say, console)
    except (InputError, OSError) as error:
        say.error(str(error))
        sys.exit(2)


if __name__ == "__main__":
    typer.run(main)
