"""Contour lines, filled bands, isosurfaces and leaves as files.

Files hold world coordinates, x first: those of a `Grid` read with `contourfair_jax.io`, which may
carry a coordinate reference system, or those of the field itself (`grid_of`).
"""

from .._support.public import public as _public
from ._meshes import write_leaves as write_leaves
from ._meshes import write_mesh as write_mesh
from ._vectors import grid_of as grid_of
from ._vectors import write_filled as write_filled
from ._vectors import write_geojson as write_geojson
from ._vectors import write_lines as write_lines
from ._vectors import write_svg as write_svg

__all__ = [
    "grid_of",
    "write_filled",
    "write_geojson",
    "write_leaves",
    "write_lines",
    "write_mesh",
    "write_svg",
]

_public(
    __name__,
    "one of its functions, such as contourfair_jax.export.write_lines(path, lines, grid)",
    {
        "draw_lines": "contourfair_jax.plot.draw_lines",
        "draw_bands": "contourfair_jax.plot.draw_filled",
        "write_bands": "contourfair_jax.export.write_filled",
    },
)
