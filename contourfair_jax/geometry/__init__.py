"""Differentiable geometry of contours and isosurfaces: length, area, volume, bending.

Lines and meshes are found on the host, and which points there are cannot be differentiated.  Where
they lie can: a point x(t) of the level set f(x; t) = level obeys the implicit function theorem,

    dx = (d level - df(x)) g / |g|^2    along the gradient g,

with df(x) the change of the field at a place that is held.  `level_points` gives the points this
derivative, in forward and reverse mode and to any order, and the measures are sums over them.  They
compose with `fair_field`: to the samples, the spacing, the origin and the settings.

Derivatives of area and volume are those of the continuous measures to the accuracy of the
polygons, such as `d area / d level = - integral of ds / |g|`.  That needs polygons that resolve the
level set: on a surface with features of a voxel's size the derivative of the volume was a quarter
too small.  Mesh with a smaller `tolerance` there, and compare with a difference.

Where the gradient vanishes the level set has no derivative; zero is put there.  Bending has
Hessians in it, which jump between cells: it is continuous almost everywhere only, and its
derivative leaves the jumps out.
"""

from .._support.public import public as _public
from ._level_points import level_points as level_points
from ._measures import area as area
from ._measures import bending as bending
from ._measures import length as length
from ._measures import surface_area as surface_area
from ._measures import volume as volume

__all__ = [
    "area",
    "bending",
    "length",
    "level_points",
    "surface_area",
    "volume",
]

_public(
    __name__,
    "one of its functions, such as contourfair_jax.geometry.area(field, lines)",
    {
        "willmore": "contourfair_jax.geometry.bending",
    },
)
