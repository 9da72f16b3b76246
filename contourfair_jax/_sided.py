"""Fields beside cells without values: contours end there, on a face that has values on one side."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._bezier import cell_extreme
from ._field import BezierField
from ._queries import full_hessian, mean_curvature, partials

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
    def of(cls, field: BezierField, points: Float[Array, "*batch ndim"]) -> "SidedField":
        """Of points counted from the first sample."""
        net, spacing = field.control_points, jnp.asarray(field.spacing, field.dtype)
        return cls(net, spacing, *_sides(jax.lax.stop_gradient((net, spacing, points))))

    def value_and_gradient(self, points: Float[Array, "*batch ndim"]) -> tuple[Array, Array]:
        """Values (...) and gradients (..., ndim); polynomials go on outside."""
        value, gradient = self._partials(points, 1)
        return value[..., 0], gradient

    def mean_curvature(self, points: Float[Array, "*batch ndim"]) -> Float[Array, "*batch"]:
        """As that of `BezierField`."""
        value, gradient, second = self._partials(points, 2)
        hessian = full_hessian(second, self.net.ndim)
        return mean_curvature(value[..., 0], gradient, hessian, self.spacing)

    def _partials(self, points: Array, order: int) -> list[Array]:
        origin = jnp.zeros_like(self.spacing)
        return partials(self.net, self.spacing, origin, points, "extend", order, self.cells)


def _sides(places: tuple[Array, Array, Array]) -> tuple[Int[Array, "..."], Bool[Array, "..."]]:
    """The cells and ends of a `SidedField`."""
    net, spacing, points = places
    valid = ~jnp.isnan(cell_extreme(net, jnp.maximum))
    grid = points / jnp.broadcast_to(spacing, points.shape)
    last = jnp.broadcast_to(jnp.array(valid.shape, jnp.int32), points.shape)
    near = _ROUNDINGS * float(jnp.finfo(grid.dtype).eps) * last.astype(grid.dtype)
    # NaN is nowhere; the first cell will do.
    grid = jnp.where(jnp.isnan(grid), 0, grid)
    above = jnp.floor(grid + near).astype(jnp.int32)
    below = jnp.ceil(grid - near).astype(jnp.int32) - 1

    def holds(cell: Array) -> Array:
        inside = jnp.all((cell >= 0) & (cell < last), axis=-1)
        index = jnp.clip(cell, 0, last - 1)
        return inside & valid[tuple(jnp.moveaxis(index, -1, 0))]

    chosen, found, whole = above, holds(above), holds(above)
    for down in list(itertools.product((False, True), repeat=net.ndim))[1:]:
        cell = jnp.where(jnp.array(down), below, above)
        better = holds(cell)
        whole = whole & better
        chosen = jnp.where((better & ~found)[..., None], cell, chosen)
        found = found | better
    other = above + below - chosen
    ends = []
    for axis in range(net.ndim):
        across = chosen.at[..., axis].set(other[..., axis])
        ends.append((above != below)[..., axis] & ~holds(across))
    fixed = (found & ~whole)[..., None]
    return jnp.where(fixed, chosen, -1), jnp.stack(ends, axis=-1)
