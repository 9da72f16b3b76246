"""Contour lines, filled bands and isosurfaces as files, the former as pictures too.

Files hold world coordinates, x first: those of a `Grid` read with `contourfair_jax.io`, which may
carry a coordinate reference system, or those of the field itself (`grid_of`).
"""

from ._meshes import write_leaves as write_leaves
from ._meshes import write_mesh as write_mesh
from ._vectors import grid_of as grid_of
from ._vectors import write_bands as write_bands
from ._vectors import write_geojson as write_geojson
from ._vectors import write_lines as write_lines
from ._vectors import write_svg as write_svg

__all__ = [
    "grid_of",
    "write_bands",
    "write_geojson",
    "write_leaves",
    "write_lines",
    "write_mesh",
    "write_svg",
]
