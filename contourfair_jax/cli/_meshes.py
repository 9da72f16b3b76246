"""The commands ``isosurface`` and ``adaptive``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ._console import Reporter
from ._options import (
    Input,
    Json,
    Key,
    Quiet,
    Single,
    examples,
    output,
    with_options,
)
from ._recipe import JoinedFairing, Recipe
from ._steps import as_input, check_fairable, check_suffix, faired, float_width, load

Tolerance = Annotated[
    float, typer.Option("--tolerance", "-t", help="How far from the true surface, in cells.")
]


@with_options
def isosurface(
    source: Input,
    target: Annotated[Path, output("File for the mesh: .vtp, .ply, .stl or .obj.")],
    level: Annotated[float, typer.Option("--level", "-l", help="Value of the surface.")],
    tolerance: Tolerance = 0.05,
    plot: Annotated[Path | None, typer.Option(help="Picture of the surface, a .png.")] = None,
    *,
    fairing: JoinedFairing,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Store the isosurface of a volume as a mesh, in the coordinates of the file.

    Vertices lie on the fair field; the mesh is closed but at the border and at missing samples.
    Normals point towards larger values; seen from there, triangles run counter-clockwise.
    """
    from .._level_sets import check_tolerance
    from ..export import write_mesh
    from ..export._meshes import MESH_SUFFIXES
    from ..isosurface import isosurface as trace
    from ..plot import save_figure

    say = Reporter(quiet, as_json)
    check_suffix(target, MESH_SUFFIXES)
    if plot is not None:
        check_suffix(plot, (".png",))
    recipe = Recipe.parse(fairing, single)
    with as_input():
        check_tolerance(tolerance)
    grid = load(source, key, target, recipe, say)
    check_fairable(grid, ndim=(3,))
    field = faired(grid, recipe, say)
    with float_width(single), say.working("tracing the surface") as move, as_input():
        mesh = trace(field, level, tolerance, progress=move)
    for note in mesh.notes:
        say.note(note)
    with say.working(f"writing {target}"):
        for note in write_mesh(target, mesh, grid):
            say.note(note)
    if plot is not None:
        from ..plot import surface_figure

        with say.working(f"drawing {plot}"):
            save_figure(surface_figure(mesh, f"{source.name}: {level:g}", grid), plot)
    whole = "watertight" if mesh.watertight else "with a border"
    if not len(mesh.triangles):
        whole = "empty"
    say.done(
        target,
        f"{len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles, {whole}",
        level=level,
        vertices=len(mesh.vertices),
        triangles=len(mesh.triangles),
        watertight=mesh.watertight,
        unmet=mesh.unmet,
        unproved=mesh.unproved,
        area=mesh.area,
        volume=mesh.volume,
    )


@with_options
def adaptive(
    source: Input,
    target: Annotated[Path, output("File for the leaves, a .vtu.")],
    tolerance: Annotated[
        float, typer.Option("--tolerance", "-t", help="Largest error, in units of the samples.")
    ],
    plot: Annotated[
        Path | None, typer.Option(help="Picture of the leaves, a .png; of a volume, its middle.")
    ] = None,
    *,
    fairing: JoinedFairing,
    key: Key = None,
    single: Single = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Refine where the fair field needs it: a quadtree, or an octree, with a proved error.

    The values at the corners, interpolated linearly along the axes, stay within the tolerance.
    """
    from ..adaptive import adaptive as refine
    from ..adaptive import check_error
    from ..export import write_leaves
    from ..plot import save_figure
    from ..plot._surfaces import leaf_figure

    say = Reporter(quiet, as_json)
    check_suffix(target, (".vtu",))
    if plot is not None:
        check_suffix(plot, (".png",))
    recipe = Recipe.parse(fairing, single)
    with as_input():
        check_error(tolerance, "tolerance")
    grid = load(source, key, target, recipe, say)
    check_fairable(grid)
    field = faired(grid, recipe, say)
    with float_width(single), say.working("refining") as move, as_input():
        leaves = refine(field, tolerance, progress=move)
    with say.working(f"writing {target}"):
        write_leaves(target, leaves, grid)
    if plot is not None:
        with say.working(f"drawing {plot}"):
            save_figure(leaf_figure(leaves, grid, source.name), plot)
    text = f"{len(leaves)} leaves, error at most {leaves.error:.4g}"
    say.done(target, text, leaves=len(leaves), vertices=len(leaves.vertices), error=leaves.error)


COMMANDS = {
    isosurface: examples(
        "contourfair isosurface scan.nii.gz --level 300 -o skin.vtp",
        "contourfair isosurface scan.npz --level 80 -o mesh.ply --plot mesh.png",
    ),
    adaptive: examples(
        "contourfair adaptive dem.tif --tolerance 0.5 -o leaves.vtu --plot leaves.png"
    ),
}
