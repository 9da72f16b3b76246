"""Area, bending, parts and topology of isosurfaces."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ._components import connect
from ._creases import crease_bending
from ._field import BezierField
from ._split import edges_of
from .isosurface import Isosurface, isosurface


@dataclass(frozen=True)
class SurfaceMetrics:
    """What an isosurface looks like.

    Parameters
    ----------
    level : float
    area : float
        In squared units of the coordinates.
    bending : float
        Squared mean curvature integrated over the surface, without unit; `4 pi` for a sphere.
        Of `surface_metrics`, without the kinks between cells that trilinear fields have.
    components : int
        Connected parts.
    euler_characteristic : int
        Vertices less edges plus triangles: 2 for each sphere, less 2 for each handle, less 1 for
        each further border.
    watertight : bool
        Whether every edge has two triangles.
    """

    level: float
    area: float
    bending: float
    components: int
    euler_characteristic: int
    watertight: bool


def surface_metrics(surface: Isosurface) -> SurfaceMetrics:
    """Metrics of one isosurface; those of one without triangles are 0."""
    corners = surface.vertices[surface.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1)
    squared = surface.mean_curvature[surface.triangles] ** 2
    edges = edges_of(surface.triangles)
    parts = np.unique(connect(len(surface.vertices), edges.ends.T))
    return SurfaceMetrics(
        surface.level,
        surface.area,
        float((area * squared.mean(1)).sum()),
        len(parts),
        surface.euler_characteristic,
        surface.watertight,
    )


def level_surfaces(
    field: BezierField,
    levels: Sequence[float] | np.ndarray,
    tolerance: float,
    step: Callable[[], None] = lambda: None,
) -> list[SurfaceMetrics]:
    """Metrics of the isosurfaces of levels; `step` is called after each.

    The bending is that of the cells and that of kinks between them, each rounded over a quarter of
    the smallest spacing.
    """
    width = 0.25 * float(np.min(np.asarray(field.spacing)))
    found = []
    for level in map(float, levels):
        each = surface_metrics(isosurface(field, level, tolerance))
        bending = each.bending + crease_bending(field, level, width)
        found.append(replace(each, bending=bending))
        step()
    return found
