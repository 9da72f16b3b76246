"""Points that stay on a level set while the field, or the level, changes."""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from . import _check
from ._bezier import is_flat
from ._field import BezierField
from ._precision import finest, from_origin

# Longest step of a projection, in cells: points stay near where they were found.
LONGEST_STEP = 0.5
# Part of the squared gradient that has to lie along the border for points to slide along it.
LEAST_ALONG = 1e-4


def level_points(
    field: BezierField, points: ArrayLike, level: ArrayLike, steps: int = 2
) -> Float[Array, "*batch ndim"]:
    """Points of a level set as differentiable functions of the field and the level.

    Parameters
    ----------
    field : BezierField
        May be traced, as inside `jax.grad`.
    points : array, shape (..., ndim)
        Points on or near the level set: vertices of `field.contours(level)` or of an isosurface,
        of this field or of one that differs little.
    level : float or array that broadcasts to (...)
    steps : int
        Newton steps along the gradient from the points given to the level set; 0 takes them as
        they are.

    Returns
    -------
    array, shape (..., ndim)
        On the level set.  Changes of the field and the level move them along the gradient, points
        on the border of the grid along the border; changes of the points given move them along the
        level set.  A point that is NaN stays NaN.

    Raises
    ------
    ValueError
        For points whose last axis is not `ndim` long, or steps below 0.

    Examples
    --------
    >>> import jax, jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> from contourfair_jax.geometry import level_points
    >>> x = jnp.arange(5.0)
    >>> def place(slope):
    ...     field = cf.fair_field(slope * x[:, None] + 0 * x[None, :])
    ...     return level_points(field, jnp.array([1.0, 2.0]), 2.0)[0]
    >>> round(float(jax.grad(place)(2.0)), 4)  # the contour of 2 lies at x = 2 / slope
    -0.5
    """
    _check.check_count(steps, 0, "steps")
    relative = places_of(field, points)
    placed, origin = finest(project(centred(field), relative, level, steps), field.origin)
    return placed + jnp.broadcast_to(origin, placed.shape)


def centred(field: BezierField) -> BezierField:
    """The field with its first sample at zero, without its report: a pytree of numbers."""
    spacing = jnp.asarray(field.spacing, field.dtype)
    return BezierField(field.control_points, spacing, jnp.zeros_like(spacing))


def places_of(field: BezierField, points: ArrayLike) -> Float[Array, "*batch ndim"]:
    """Points counted from the first sample, in the precision of the field."""
    return from_origin(_check.check_points(points, field.ndim), field.origin, field.dtype)


def project(
    field: BezierField, points: Float[Array, "*batch ndim"], level: ArrayLike, steps: int = 2
) -> Float[Array, "*batch ndim"]:
    """`level_points` of a field that is `centred`."""
    level = jnp.broadcast_to(jnp.asarray(level, field.dtype), points.shape[:-1])
    start = points
    for _ in range(steps):
        value, step = field(points, "extend"), _across(field, points)
        step = (level - value)[..., None] * step
        cells = jnp.abs(step) / jnp.broadcast_to(field.spacing, step.shape)
        size = jnp.max(cells, axis=-1, keepdims=True)
        points = points + step * jnp.minimum(1, LONGEST_STEP / jnp.maximum(size, LONGEST_STEP))
    return _tied(field, start + jax.lax.stop_gradient(points - start), level)


@jax.custom_jvp
def _tied(field: BezierField, points: Array, level: Array) -> Array:
    """Points of the level set with the derivatives of the implicit function theorem."""
    return points


@_tied.defjvp
def _tied_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    field, points, level = primals
    field_dot, points_dot, level_dot = tangents
    # Tied again, so that derivatives of the derivative follow the level set as well.
    points = _tied(field, points, level)
    known = jnp.all(jnp.isfinite(points), axis=-1, keepdims=True)
    places = jnp.where(known, points, jnp.broadcast_to(field.origin, points.shape))
    _, value_dot = jax.jvp(lambda f, p: f(p, "extend"), (field, places), (field_dot, points_dot))
    across = jnp.where(known, _across(field, places), 0)
    return points, points_dot + (level_dot - value_dot)[..., None] * across


def _across(field: BezierField, points: Array) -> Array:
    """g / |g|^2, or zero where the gradient vanishes; on the border g is that along it."""
    value, gradient = field.value_and_gradient(points, "extend")
    flat = is_flat(value, gradient, jnp.asarray(field.spacing, value.dtype))[..., None]
    # Squares of a gradient that is far from 1 would leave the range of float32.
    size = jnp.where(flat, 1, jnp.max(jnp.abs(gradient), axis=-1, keepdims=True))
    unit = gradient / jax.lax.stop_gradient(size)
    along = jnp.where(_at_border(field, points), 0, unit)
    whole, kept = (jnp.sum(g * g, axis=-1, keepdims=True) for g in (unit, along))
    # A level set that runs along the border can only move off it.
    unit, squared = (
        jnp.where(kept > LEAST_ALONG * whole, *pair) for pair in ((along, unit), (kept, whole))
    )
    return jnp.where(flat, 0, unit / jnp.where(flat, 1, squared) / jax.lax.stop_gradient(size))


def _at_border(field: BezierField, points: Array) -> Array:
    """Along which axes a point lies at an end of the grid, up to rounding."""
    last = jnp.asarray(field.shape, field.dtype) - 1
    spacing, origin, last = (
        jnp.broadcast_to(x, points.shape) for x in (field.spacing, field.origin, last)
    )
    grid = jax.lax.stop_gradient((points - origin) / spacing)
    return jnp.minimum(jnp.abs(grid), jnp.abs(grid - last)) <= 8 * jnp.finfo(grid.dtype).eps * last
