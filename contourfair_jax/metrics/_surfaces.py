"""Area, bending, parts and topology of isosurfaces, with the creases of trilinear fields."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from .._bezier.host import HostField, known
from .._field import BezierField
from .._support.checks import Scalar
from ..isosurface import Isosurface, isosurface
from ..isosurface._mesh import connect, edges_of, triangle_normals

# Slopes on both sides of a face that differ by no more, relatively, are the same.
_SMOOTH = 1e-6


def crease_bending(field: BezierField, level: float, step: float) -> float:
    """Squared mean curvature along kinks at faces between cells, each rounded over a width `step`.

    A surface that turns by an angle a along a crease of length L, rounded over the width s, has the
    mean curvature a / (2 s) on an area of s L: it bends by a^2 L / (4 s).  0 for a C1 field, up to
    rounding; faces beside cells without values are left out.

    Parameters
    ----------
    field : BezierField
        3-D.
    level : float
    step : float
        In units of the coordinates.
    """
    net = np.asarray(known(field).control_points).astype(np.float64)
    spacing = np.asarray(field.spacing, dtype=np.float64)
    total = 0.0
    for axis in range(3):
        layers = np.moveaxis(net, axis, 0)
        others = [k for k in range(3) if k != axis]
        for k in range(3, len(layers) - 1, 3):
            below, face, above = layers[k - 1 : k + 2]
            known_face = face[np.isfinite(face)]
            low, high = known_face.min(initial=np.inf), known_face.max(initial=-np.inf)
            sides = [3 / spacing[axis] * side for side in (face - below, above - face)]
            if low <= level <= high and not np.allclose(
                sides[0], sides[1], _SMOOTH, 0, equal_nan=True
            ):
                total += _along_face(face, sides, spacing[others], level)
    return total / (4 * step)


def _along_face(
    face: np.ndarray, sides: list[np.ndarray], spacing: np.ndarray, level: float
) -> float:
    """Squared angle integrated along the line of a level in a face of cells.

    `sides` are the nets of the derivative across the face, below it and above.
    """
    points, ends = [], []
    plane = BezierField(jnp.asarray(face), jnp.asarray(spacing), jnp.zeros(2))
    for line in plane.contours(level):
        points.append((line.points[1:] + line.points[:-1]) / 2)
        ends.append(np.linalg.norm(np.diff(line.points, axis=0), axis=1))
    if not points:
        return 0.0
    at, length = np.concatenate(points) / spacing, np.concatenate(ends)
    hosts = [HostField(np.ascontiguousarray(net)) for net in (face, *sides)]
    within = np.linalg.norm(hosts[0].jet(at, 1)[1] / spacing[:, None], axis=0)
    below, above = (np.arctan2(side.jet(at, 0)[0][0], within) for side in hosts[1:])
    return float(np.nansum((above - below) ** 2 * length))


@dataclass(frozen=True)
class SurfaceMetrics:
    """Figures of an isosurface.

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
        Whether the surface is closed, as of `Isosurface`.
    """

    level: float
    area: float
    bending: float
    components: int
    euler_characteristic: int
    watertight: bool


def surface_metrics(surface: Isosurface) -> SurfaceMetrics:
    """Metrics of one isosurface; those of one without triangles are 0."""
    area = 0.5 * np.linalg.norm(triangle_normals(surface.vertices, surface.triangles), axis=1)
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
    tolerance: Scalar,
    step: Callable[[], None] = lambda: None,
) -> list[SurfaceMetrics]:
    """Metrics of the isosurfaces of levels; `step` is called after each.

    The bending is that of the cells and that of kinks between them, each rounded over a quarter of
    the smallest spacing.
    """
    width = 0.25 * float(np.min(np.asarray(field.spacing)))
    by_level = []
    for level in map(float, levels):
        metrics = surface_metrics(isosurface(field, level, tolerance))
        bending = metrics.bending + crease_bending(field, level, width)
        by_level.append(replace(metrics, bending=bending))
        step()
    return by_level
