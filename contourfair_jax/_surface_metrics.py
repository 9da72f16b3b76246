"""Area, bending, parts and topology of isosurfaces."""

from dataclasses import dataclass

import numpy as np

from ._components import connect
from ._split import edges_of
from .isosurface import Isosurface


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
