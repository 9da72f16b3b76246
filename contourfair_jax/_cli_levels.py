"""The commands ``isosurface``, ``adaptive`` and ``metrics``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ._console import Reporter
from ._options import (
    Count,
    Fill,
    Input,
    Interval,
    Iterations,
    Key,
    Levels,
    Method,
    Quiet,
    Single,
    Weight,
    examples,
    output,
)
from ._run import Settings, check_fairable, fair, precision
from ._steps import check_suffix, levels_of, load
from .io import InputError, read

if TYPE_CHECKING:
    from ._field import BezierField

Tolerance = Annotated[
    float, typer.Option("--tolerance", "-t", help="How far from the true surface, in cells.")
]


def isosurface(
    source: Input,
    target: Annotated[Path, output("File for the mesh: .vtp, .ply, .stl or .obj.")],
    level: Annotated[float, typer.Option("--level", "-l", help="Value of the surface.")],
    tolerance: Tolerance = 0.05,
    plot: Annotated[Path | None, typer.Option(help="Picture of the surface, a .png.")] = None,
    method: Method = "local",
    iterations: Iterations = None,
    thin_plate_weight: Weight = None,
    fill: Fill = False,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
) -> None:
    """Store the isosurface of a volume as a mesh, in the coordinates of the file.

    Vertices lie on the fair field; the mesh is closed but at the border and at missing samples.
    """
    from ._to_vtk import MESH_SUFFIXES, write_mesh
    from .plot import save_figure

    say = Reporter(quiet)
    check_suffix(target, MESH_SUFFIXES)
    if plot is not None:
        check_suffix(plot, (".png",))
    grid = load(source, key, target, say, fill)
    check_fairable(grid, ndim=(3,))
    size = " x ".join(str(n) for n in grid.shape)
    with precision(single), say.working(f"fairing {size} samples"):
        field = fair(grid, method, Settings(iterations, thin_plate_weight), fill)
    try:
        with precision(single), say.working("tracing the surface"):
            mesh = field.isosurface(level, tolerance)
    except ValueError as error:
        raise InputError(str(error)) from error
    for note in mesh.notes:
        say.note(note)
    with say.working(f"writing {target}"):
        for note in write_mesh(target, mesh, grid):
            say.note(note)
    if plot is not None:
        from ._plot_surface import surface_figure

        with say.working(f"drawing {plot}"):
            save_figure(surface_figure(mesh, f"{source.name}: {level:g}"), plot)
    if not quiet:
        whole = "watertight" if mesh.watertight else "with a border"
        typer.echo(
            f"{target}: {len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles, {whole}"
        )


def adaptive(
    source: Input,
    target: Annotated[Path, output("File for the leaves, a .vtu.")],
    tolerance: Annotated[
        float, typer.Option("--tolerance", "-t", help="Largest error, in units of the samples.")
    ],
    method: Method = "local",
    iterations: Iterations = None,
    thin_plate_weight: Weight = None,
    fill: Fill = False,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
) -> None:
    """Refine where the fair field needs it: a quadtree, or an octree, with a proved error.

    The values at the corners, interpolated linearly along the axes, stay within the tolerance.
    """
    from ._to_vtk import write_leaves

    say = Reporter(quiet)
    check_suffix(target, (".vtu",))
    grid = load(source, key, target, say, fill)
    check_fairable(grid)
    size = " x ".join(str(n) for n in grid.shape)
    with precision(single), say.working(f"fairing {size} samples"):
        field = fair(grid, method, Settings(iterations, thin_plate_weight), fill)
    try:
        with precision(single), say.working("refining"):
            found = field.adaptive(tolerance)
    except ValueError as error:
        raise InputError(str(error)) from error
    with say.working(f"writing {target}"):
        write_leaves(target, found, grid)
    if not quiet:
        typer.echo(f"{target}: {len(found)} leaves, error at most {found.error:.4g}")


def metrics(
    source: Input,
    levels: Levels = None,
    interval: Interval = None,
    count: Count = None,
    method: Method = "local",
    iterations: Iterations = None,
    thin_plate_weight: Weight = None,
    fill: Fill = False,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
) -> None:
    """Measure contours, or isosurfaces, level by level: bilinear (trilinear) beside fair."""
    from ._compare import bilinear_field

    say = Reporter(quiet)
    with say.working(f"reading {source}"):
        grid = read(source, key)
    check_fairable(grid)
    chosen = levels_of(grid, levels, interval, count, say)
    with precision(single), say.working("fairing and measuring"):
        field = fair(grid, method, Settings(iterations, thin_plate_weight), fill)
        measure, header = (_lines, _LINES) if grid.ndim == 2 else (_surfaces, _SURFACES)
        plain = "bilinear" if grid.ndim == 2 else "trilinear"
        tables = {plain: measure(bilinear_field(field), chosen), "fair": measure(field, chosen)}
    typer.echo(f"{'level':>12} {'field':<10}" + "".join(f"{name:>13}" for name in header))
    for k, level in enumerate(chosen):
        for name, rows in tables.items():
            figures = "".join(f"{x:13.5g}" for x in rows[k])
            typer.echo(f"{level:12.6g} {name:<10}{figures}")


_LINES = ("length", "turning/2pi", "bending", "parts", "holes")
_SURFACES = ("area", "bending/4pi", "parts", "Euler")


def _lines(field: BezierField, levels: Sequence[float]) -> list[tuple]:
    import numpy as np

    from .metrics import level_metrics

    step = 0.25 * float(np.min(np.asarray(field.spacing)))
    found = level_metrics(field.contours(levels, 1e-3), step, levels)
    return [(m.length, m.turning / (2 * np.pi), m.bending, m.components, m.holes) for m in found]


def _surfaces(field: BezierField, levels: Sequence[float]) -> list[tuple]:
    import numpy as np

    from .metrics import surface_metrics

    found = [surface_metrics(field.isosurface(level, 0.05)) for level in levels]
    return [(m.area, m.bending / (4 * np.pi), m.components, m.euler_characteristic) for m in found]


COMMANDS = {
    isosurface: examples(
        "contourfair isosurface scan.nii.gz --level 300 -o skin.vtp",
        "contourfair isosurface scan.npz --level 80 -o mesh.ply --plot mesh.png",
    ),
    adaptive: examples("contourfair adaptive dem.tif --tolerance 0.5 -o leaves.vtu"),
    metrics: examples(
        "contourfair metrics dem.tif --interval 20",
        "contourfair metrics scan.nrrd",
    ),
}
