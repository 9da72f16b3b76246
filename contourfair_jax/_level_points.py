"""Points that stay on a level set while the field, or the level, changes."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from . import _check
from ._bezier import is_flat
from ._field import BezierField
from ._precision import finest, from_origin
from ._sided import SidedField

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
        on the border of the grid, or of cells without values, along that; changes of the points
        given move them along the level set.  A point that is NaN stays NaN.

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
    found = project(SidedField.of(field, relative), relative, level, steps)
    placed, origin = finest(found, field.origin)
    return placed + jnp.broadcast_to(origin, placed.shape)


def places_of(field: BezierField, points: ArrayLike) -> Float[Array | np.ndarray, "*batch ndim"]:
    """Points counted from the first sample, in the precision of the field."""
    return from_origin(_check.check_points(points, field.ndim), field.origin, field.dtype)


def project(
    field: SidedField, places: Float[ArrayLike, "*batch ndim"], level: ArrayLike, steps: int = 2
) -> Float[Array, "*batch ndim"]:
    """`level_points` of points counted from the first sample."""
    points = jnp.asarray(places)
    level = jnp.broadcast_to(jnp.asarray(level, points.dtype), points.shape[:-1])
    start = points
    for _ in range(steps):
        value, step = _value_and_across(field, points)
        step = (level - value)[..., None] * step
        cells = jnp.abs(step) / jnp.broadcast_to(field.spacing, step.shape)
        size = jnp.max(cells, axis=-1, keepdims=True)
        points = points + step * jnp.minimum(1, LONGEST_STEP / jnp.maximum(size, LONGEST_STEP))
    return _tied(field, start + jax.lax.stop_gradient(points - start), level)


@jax.custom_jvp
def _tied(field: SidedField, points: Array, level: Array) -> Array:
    """Points of the level set with the derivatives of the implicit function theorem."""
    return points


@_tied.defjvp
def _tied_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    field, points, level = primals
    field_dot, points_dot, level_dot = tangents
    # Tied again, so that derivatives of the derivative follow the level set as well.
    points = _tied(field, points, level)
    known = jnp.all(jnp.isfinite(points), axis=-1, keepdims=True)
    places = jnp.where(known, points, 0)
    _, value_dot = jax.jvp(lambda f, p: f(p), (field, places), (field_dot, points_dot))
    across = jnp.where(known, _value_and_across(field, places)[1], 0)
    return points, points_dot + (level_dot - value_dot)[..., None] * across


def _value_and_across(field: SidedField, points: Array) -> tuple[Array, Array]:
    """Values, and g / |g|^2, or zero where the gradient vanishes; at ends g is that along them."""
    value, gradient = field.value_and_gradient(points)
    flat = is_flat(value, gradient, field.spacing)[..., None]
    # Squares of a gradient that is far from 1 would leave the range of float32.
    size = jnp.where(flat, 1, jnp.max(jnp.abs(gradient), axis=-1, keepdims=True))
    unit = gradient / jax.lax.stop_gradient(size)
    along = jnp.where(field.ends, 0, unit)
    whole, kept = (jnp.sum(g * g, axis=-1, keepdims=True) for g in (unit, along))
    # A level set that runs along an end can only move off it.
    unit, squared = (
        jnp.where(kept > LEAST_ALONG * whole, *pair) for pair in ((along, unit), (kept, whole))
    )
    across = unit / jnp.where(flat, 1, squared) / jax.lax.stop_gradient(size)
    return value, jnp.where(flat, 0, across)
