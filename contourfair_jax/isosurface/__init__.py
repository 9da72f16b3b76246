"""Isosurfaces of a 3-D field: on the field, watertight, within a tolerance.

Cells whose Bezier points are all on one side of the level cannot hold it and are skipped.  The
others are sampled at twice the resolution and triangulated by scikit-image's marching cubes; parts
that pass between these samples are looked for with bounds on pieces of the cells.  Vertices move to
the roots of the field on their edges, and triangles are halved where their edges leave the surface
by more than the tolerance.  All work is in float64 on the host.

As for contours, a plateau counts as below its own level: this is raised by `5e-10` of the range of
the samples, or by two roundings of the largest sample where these are more.
"""

from .._support.public import public as _public
from ._isosurface import Isosurface as Isosurface
from ._isosurface import isosurface as isosurface

__all__ = [
    "Isosurface",
    "isosurface",
]

_public(
    __name__,
    "field.isosurface(level) or contourfair_jax.isosurface.isosurface(field, level)",
)
