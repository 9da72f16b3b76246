"""Points that stay on a level set while the field, or the level, changes.

Beside cells without values contours end on a face that has values on one side.
"""

import functools
import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from .._bezier.curvature import full_hessian, mean_curvature
from .._bezier.evaluate import partials
from .._bezier.nets import cell_extreme, is_flat
from .._field import BezierField
from .._support import checks
from .._support.arrays import finest, from_origin, is_traced

# Roundings of the last coordinate within which a point is on a face.
_ROUNDINGS = 8


class SidedField(eqx.Module):
    """A field whose first sample lies at zero, evaluated on the sides of points that have values.

    Parameters
    ----------
    net : array, shape (3 (n_1 - 1) + 1, ...)
    spacing : array, shape (ndim,)
    cells : array of int, shape (..., ndim)
        Of points on faces that have no values on one side the cell on the other; -1 for all others,
        which are free to move to other cells.
    ends : bool array, shape (..., ndim)
        Along which axes a point is on such a face, or at the border of the grid.
    """

    net: Float[Array, "*net"]
    spacing: Float[Array, " ndim"]
    cells: Int[Array, "*batch ndim"]
    ends: Bool[Array, "*batch ndim"]

    @classmethod
    def of(cls, field: BezierField, points: Float[ArrayLike, "*batch ndim"]) -> "SidedField":
        """The field of a `BezierField` beside points, which are counted from the first sample."""
        net = field.control_points
        valid = ~jnp.isnan(cell_extreme(jax.lax.stop_gradient(net), jnp.maximum))
        cells, ends = _sides(valid, field.spacing, points)
        return cls(net, jnp.asarray(field.spacing, net.dtype), cells, ends)

    def __call__(self, points: Float[Array, "*batch ndim"]) -> Float[Array, "*batch"]:
        """Values; polynomials go on outside."""
        return self._partials(points, 0)[0][..., 0]

    def value_and_gradient(self, points: Float[Array, "*batch ndim"]) -> tuple[Array, Array]:
        """Values (...) and gradients (..., ndim)."""
        value, gradient = self._partials(points, 1)
        return value[..., 0], gradient

    def mean_curvature(self, points: Float[Array, "*batch ndim"]) -> Float[Array, "*batch"]:
        """Mean curvature of the level sets, as of `BezierField`."""
        value, gradient, second = self._partials(points, 2)
        hessian = full_hessian(second, self.net.ndim)
        return mean_curvature(value[..., 0], gradient, hessian, self.spacing)

    def _partials(self, points: Array, order: int) -> list[Array]:
        origin = jnp.zeros_like(self.spacing)
        return partials(self.net, self.spacing, origin, points, "extend", order, self.cells)


def _sides(
    valid: Bool[Array, "*cells"],
    spacing: Float[Array | np.ndarray, " ndim"],
    points: Float[ArrayLike, "*batch ndim"],
) -> tuple[Int[Array, "*batch ndim"], Bool[Array, "*batch ndim"]]:
    """The cells and ends of a `SidedField`.

    What is known is worked out by NumPy: XLA would fold it, slowly, while it compiles.
    """
    ndim, last = valid.ndim, np.array(valid.shape, np.int32)
    xp: Any = np
    if is_traced(points, spacing):
        xp, (spacing, points) = jnp, jax.lax.stop_gradient((spacing, points))
    kind = jnp.result_type(points)
    grid = xp.asarray(points) / xp.broadcast_to(xp.asarray(spacing, kind), np.shape(points))
    grid = xp.where(xp.isnan(grid), 0, grid)  # nowhere; the first cell will do
    near = xp.asarray(_ROUNDINGS * float(jnp.finfo(kind).eps) * last, kind)
    near = xp.broadcast_to(near, grid.shape)
    above = xp.floor(grid + near).astype(np.int32)
    below = xp.ceil(grid - near).astype(np.int32) - 1
    last = xp.broadcast_to(xp.asarray(last), above.shape)

    cells, holds = [], []
    for down in itertools.product((False, True), repeat=ndim):
        cell = xp.where(np.array(down), below, above)
        inside = xp.all((cell >= 0) & (cell < last), axis=-1)
        index = xp.moveaxis(xp.clip(cell, 0, last - 1), -1, 0)
        cells.append(cell)
        holds.append(valid[tuple(index)] & inside)
    chosen, found = jnp.asarray(above), jnp.zeros_like(holds[0])
    ends: list[Array] = [jnp.zeros_like(found)] * ndim
    for number, (cell, here) in enumerate(zip(cells, holds, strict=True)):
        first = here & ~found
        chosen = jnp.where(first[..., None], cell, chosen)
        for axis in range(ndim):
            # Away from faces both cells along an axis are one, and what one holds both do.
            across = holds[number ^ 2 ** (ndim - 1 - axis)]
            ends[axis] = jnp.where(first, ~across, ends[axis])  # pyright: ignore
        found = found | here
    whole = functools.reduce(jnp.logical_and, holds)
    fixed = (found & ~whole)[..., None]
    return jnp.where(fixed, chosen, -1), jnp.stack(ends, axis=-1)


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
    checks.check_count(steps, 0, "steps")
    relative = places_of(field, points)
    on_level = project(SidedField.of(field, relative), relative, level, steps)
    placed, origin = finest(on_level, field.origin)
    return placed + jnp.broadcast_to(origin, placed.shape)


def places_of(field: BezierField, points: ArrayLike) -> Float[Array | np.ndarray, "*batch ndim"]:
    """Points counted from the first sample, in the precision of the field."""
    return from_origin(checks.check_points(points, field.ndim), field.origin, field.dtype)


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
