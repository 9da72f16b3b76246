"""Length, area, volume and bending of level sets as functions of the field."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._field import BezierField
from ..contours import ContourLine
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


def bending(
    field: BezierField, lines: Sequence[ContourLine], level: ArrayLike | None = None
) -> Float[Array, ""]:
    """Squared curvature integrated along contour lines, in 1 / length; 2 pi / r for a circle.

    With the curvature of the field's level set at the points.  Parameters and Raises as for
    `length`.
    """
    points, follows, sided = _tied_lines(field, lines, level)
    squared = sided.mean_curvature(points) ** 2
    return jnp.sum((squared[:-1] + squared[follows]) / 2 * _norm(points[follows] - points[:-1]))


def _tied_lines(
    field: BezierField, lines: Sequence[ContourLine], level: ArrayLike | None
) -> tuple[Float[Array, "points 2"], np.ndarray, SidedField]:
    """All points of all lines, of every one but the last which follows (itself at ends), the field.

    Points are counted from the origin of the field, here and below.
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


def surface_area(
    field: BezierField, vertices: ArrayLike, triangles: ArrayLike, level: ArrayLike
) -> Float[Array, ""]:
    """Area of an isosurface.

    Parameters
    ----------
    field : BezierField
        3-D; may be traced.
    vertices : array, shape (n, 3)
        Of the isosurface of this level, in physical coordinates.
    triangles : array of int, shape (m, 3)
        Numbers of vertices, found outside `jax.jit`.
    level : float

    Raises
    ------
    ValueError
        For a field that is not 3-D, or triangles that are not (m, 3) or name other vertices.
    """
    _, _, normals, _ = _tied_mesh(field, vertices, triangles, level)
    return jnp.sum(_norm(normals)) / 2


def volume(
    field: BezierField, vertices: ArrayLike, triangles: ArrayLike, level: ArrayLike
) -> Float[Array, ""]:
    """Volume within a closed isosurface: of the places above the level, cavities taken off.

    By the divergence theorem.  Parameters as for `surface_area`; triangles may face either way, but
    all the same.

    Raises
    ------
    ValueError
        As for `surface_area`, and for a surface that is not closed.

    Examples
    --------
    The derivative of the volume of an isosurface with respect to every sample, with `vertices` and
    `triangles` of any marching cubes:

    >>> import contourfair_jax as cf
    >>> from contourfair_jax import geometry
    >>> def loss(samples, vertices, triangles):
    ...     return geometry.volume(cf.fair_field(samples), vertices, triangles, 0.5)
    """
    points, triangles, normals, _ = _tied_mesh(field, vertices, triangles, level)
    _check_closed(triangles)
    points = points - jax.lax.stop_gradient(jnp.mean(points, axis=0, keepdims=True))
    centres = jnp.mean(points[triangles], axis=1)
    return jnp.sum(centres * normals) / 6


def willmore(
    field: BezierField, vertices: ArrayLike, triangles: ArrayLike, level: ArrayLike
) -> Float[Array, ""]:
    """Squared mean curvature integrated over an isosurface; 4 pi for every sphere.

    With the curvature of the field's level set at the vertices.  Parameters and Raises as for
    `surface_area`.
    """
    points, triangles, normals, sided = _tied_mesh(field, vertices, triangles, level)
    squared = sided.mean_curvature(points) ** 2
    return jnp.sum(jnp.mean(squared[triangles], axis=1) * _norm(normals)) / 2


def _tied_mesh(
    field: BezierField, vertices: ArrayLike, triangles: ArrayLike, level: ArrayLike
) -> tuple[Float[Array, "n 3"], np.ndarray, Float[Array, "m 3"], SidedField]:
    """Vertices, triangles, normals of twice their area away from what is above the level; field."""
    if field.ndim != 3:
        raise ValueError(f"field must be 3-D to have isosurfaces, got {field.ndim}-D")
    corners, places = np.asarray(triangles), places_of(field, vertices)
    count = len(places)
    if corners.ndim != 2 or corners.shape[1] != 3 or not len(corners):
        raise ValueError(f"triangles must have shape (m, 3) with m > 0, got {corners.shape}")
    if corners.dtype.kind not in "iu":
        raise ValueError(f"triangles must be whole numbers of vertices, got {corners.dtype}")
    if corners.min() < 0 or corners.max() >= count:
        raise ValueError(f"triangles must be numbers of the {count} vertices, got others")
    sided = SidedField.of(field, places)
    points = project(sided, places, level)
    first, second, third = (points[corners[:, k]] for k in range(3))
    normals = jnp.cross(second - first, third - first)
    _, uphill = jax.lax.stop_gradient(sided.value_and_gradient(points))
    side = -jnp.sign(jax.lax.stop_gradient(jnp.sum(normals * jnp.mean(uphill[corners], axis=1))))
    return points, corners, side * normals, sided


def _check_closed(triangles: np.ndarray) -> None:
    """Every edge must be that of two triangles."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    open_edges = int((np.unique(edges, axis=0, return_counts=True)[1] % 2).sum())
    if open_edges:
        raise ValueError(
            f"triangles must form a closed surface to enclose a volume, got {open_edges} open "
            "edges; the surface ends at the border or at missing samples: pad the samples"
        )


def _norm(vectors: Array) -> Array:
    """Lengths along the last axis; their derivative at zero is zero."""
    squared = jnp.sum(vectors * vectors, axis=-1)
    zero = squared == 0
    return jnp.where(zero, 0, jnp.sqrt(jnp.where(zero, 1, squared)))
