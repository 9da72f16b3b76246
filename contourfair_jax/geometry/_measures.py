"""Length, area, volume and bending of level sets as functions of the field."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._field import BezierField
from .._support.public import former_keyword
from ..contours import ContourLine
from ..isosurface._mesh import TriangleMesh, open_edges, triangle_normals
from ._former import formerly_of_arrays
from ._level_points import SidedField, places_of, project


def length(
    field: BezierField, lines: Sequence[ContourLine], level: ArrayLike | None = None
) -> Float[Array, ""]:
    """Length of contour lines, in units of the coordinates.

    Parameters
    ----------
    field : BezierField
        May be traced.
    lines : sequence of ContourLine
        `field.contours(levels)`, found outside `jax.jit`; lines of other levels add up.
    level : float or None
        Takes the place of the levels of the lines, to differentiate with respect to it.

    Raises
    ------
    ValueError
        For a field that is not 2-D, or no lines.

    Examples
    --------
    >>> import jax, jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> from contourfair_jax import geometry
    >>> x = jnp.linspace(-1.0, 1.0, 9)
    >>> hill = jnp.exp(-(x[:, None] ** 2) - x[None, :] ** 2)
    >>> fair = lambda samples: cf.fair_field(samples, spacing=0.25, origin=-1.0)
    >>> lines = fair(hill).contours(0.6)
    >>> jax.grad(lambda samples: geometry.length(fair(samples), lines))(hill).shape
    (9, 9)
    """
    points, follows, _ = _tied_lines(field, lines, level)
    return jnp.sum(_norm(points[follows] - points[:-1]))


def area(
    field: BezierField, lines: Sequence[ContourLine], level: ArrayLike | None = None
) -> Float[Array, ""]:
    """Area within closed contour lines: of the places above the level, holes taken off.

    Lines around basins count as negative.  Parameters as for `length`.

    Raises
    ------
    ValueError
        As for `length`, and for lines that are not closed.
    """
    if not all(line.closed for line in lines):
        count = sum(not line.closed for line in lines)
        raise ValueError(
            f"lines must be closed to enclose an area, got {count} that end at the border or at "
            "missing samples; leave them out, or pad the samples so that they close"
        )
    points, follows, _ = _tied_lines(field, lines, level)
    # About the middle of the points: rounding does not grow with the distance to the origin.
    points = points - jax.lax.stop_gradient(jnp.mean(points, axis=0, keepdims=True))
    after = points[follows]
    return jnp.sum(points[:-1, 0] * after[:, 1] - points[:-1, 1] * after[:, 0]) / 2


@former_keyword("lines", "level_set")
@formerly_of_arrays
def bending(
    field: BezierField,
    level_set: Sequence[ContourLine] | TriangleMesh,
    level: ArrayLike | None = None,
) -> Float[Array, ""]:
    """Squared curvature integrated along contour lines, or squared mean curvature over a surface.

    With the curvature of the field's level set at the points.  Lines have it in 1 / length,
    2 pi / r for a circle; surfaces without unit, 4 pi for every sphere.

    Parameters
    ----------
    field : BezierField
        May be traced.
    level_set : sequence of ContourLine, or Isosurface
        As for `length`, or for `surface_area`.
    level : float or None
        Takes the place of the levels of the lines or the surface.

    Raises
    ------
    ValueError
        As for `length`, or for `surface_area`.
    """
    if hasattr(level_set, "triangles"):
        points, triangles, normals, sided = _tied_mesh(field, level_set, level)  # pyright: ignore
        squared = sided.mean_curvature(points) ** 2
        return jnp.sum(jnp.mean(squared[triangles], axis=1) * _norm(normals)) / 2
    points, follows, sided = _tied_lines(field, level_set, level)  # pyright: ignore
    squared = sided.mean_curvature(points) ** 2
    return jnp.sum((squared[:-1] + squared[follows]) / 2 * _norm(points[follows] - points[:-1]))


def _tied_lines(
    field: BezierField, lines: Sequence[ContourLine], level: ArrayLike | None
) -> tuple[Float[Array, "points 2"], np.ndarray, SidedField]:
    """The points of all lines, the number of the point that follows each but the last, the field.

    The last point of a line is followed by itself.  Points are counted from the origin of the
    field, here and below.
    """
    if field.ndim != 2:
        raise ValueError(f"field must be 2-D to have contour lines, got {field.ndim}-D")
    if not len(lines):
        raise ValueError("lines must hold at least one line, got none; choose another level")
    sizes = np.array([len(line.points) for line in lines])
    levels = np.repeat([line.level for line in lines], sizes) if level is None else level
    follows = np.arange(1, sizes.sum() + 1)
    follows[np.cumsum(sizes) - 1] -= 1
    places = places_of(field, np.concatenate([line.points for line in lines]))
    sided = SidedField.of(field, places)
    return project(sided, places, levels), follows[:-1], sided


@formerly_of_arrays
def surface_area(
    field: BezierField, surface: TriangleMesh, level: ArrayLike | None = None
) -> Float[Array, ""]:
    """Area of an isosurface, in squared units of the coordinates.

    Parameters
    ----------
    field : BezierField
        3-D; may be traced.
    surface : Isosurface
        `field.isosurface(level)`, found outside `jax.jit`; or any object with the `level`, the
        `vertices` in physical coordinates, shape (n, 3), and the `triangles` of a mesh.
    level : float or None
        Takes the place of the level of the surface, to differentiate with respect to it.

    Raises
    ------
    ValueError
        For a field that is not 3-D, a surface that is no mesh or has no triangles, or triangles
        that are not (m, 3) or name vertices that there are not.
    """
    _, _, normals, _ = _tied_mesh(field, surface, level)
    return jnp.sum(_norm(normals)) / 2


@formerly_of_arrays
def volume(
    field: BezierField, surface: TriangleMesh, level: ArrayLike | None = None
) -> Float[Array, ""]:
    """Volume within a closed isosurface, with the sign of `Isosurface.volume`.

    By the divergence theorem: that of the places below the level, cavities taken off, and negative
    around larger values.  Triangles turn left around the gradient, as those of an `Isosurface` do;
    of those that turn right the sign is the opposite.  Parameters as for `surface_area`.

    Raises
    ------
    ValueError
        As for `surface_area`, and for a surface that is not closed.

    Examples
    --------
    The derivative of the volume of a ball of larger values with respect to every sample:

    >>> import jax, jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> from contourfair_jax import geometry
    >>> x = jnp.linspace(-1.0, 1.0, 7)
    >>> ball = jnp.exp(-(x[:, None, None] ** 2) - x[:, None] ** 2 - x**2)
    >>> fair = lambda samples: cf.fair_field(samples, method=cf.LocalFairing(iterations=0))
    >>> surface = fair(ball).isosurface(0.6)
    >>> jax.grad(lambda samples: -geometry.volume(fair(samples), surface))(ball).shape
    (7, 7, 7)
    """
    points, triangles, normals, _ = _tied_mesh(field, surface, level)
    if count := open_edges(triangles):
        raise ValueError(
            f"surface must be closed to enclose a volume, got {count} open edges; it ends at the "
            "border or at missing samples, where samples can be padded, or its triangles face "
            "different ways"
        )
    points = points - jax.lax.stop_gradient(jnp.mean(points, axis=0, keepdims=True))
    centres = jnp.mean(points[triangles], axis=1)
    return jnp.sum(centres * normals) / 6


def _tied_mesh(
    field: BezierField, surface: TriangleMesh, level: ArrayLike | None
) -> tuple[Float[Array, "n 3"], np.ndarray, Float[Array, "m 3"], SidedField]:
    """Vertices, triangles, their normals of twice their area, and the field."""
    if field.ndim != 3:
        raise ValueError(f"field must be 3-D to have isosurfaces, got {field.ndim}-D")
    if not hasattr(surface, "triangles"):
        raise ValueError(
            f"surface must be an Isosurface, got {type(surface).__name__}; find one with "
            "field.isosurface(level)"
        )
    triangles, places = np.asarray(surface.triangles), places_of(field, surface.vertices)
    count = len(places)
    if triangles.ndim != 2 or triangles.shape[1] != 3 or not len(triangles):
        raise ValueError(f"triangles must have shape (m, 3) with m > 0, got {triangles.shape}")
    if triangles.dtype.kind not in "iu":
        raise ValueError(f"triangles must be whole numbers of vertices, got {triangles.dtype}")
    if triangles.min() < 0 or triangles.max() >= count:
        raise ValueError(f"triangles must be numbers of the {count} vertices, got others")
    sided = SidedField.of(field, places)
    points = project(sided, places, surface.level if level is None else level)
    return points, triangles, triangle_normals(points, triangles), sided


def _norm(vectors: Array) -> Array:
    """Lengths along the last axis; their derivative at zero is zero."""
    squared = jnp.sum(vectors * vectors, axis=-1)
    zero = squared == 0
    return jnp.where(zero, 0, jnp.sqrt(jnp.where(zero, 1, squared)))
