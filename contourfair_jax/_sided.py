"""Fields beside cells without values: contours end there, on a face that has values on one side."""

import functools
import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ._bezier import cell_extreme
from ._field import BezierField
from ._method import is_traced
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
    def of(cls, field: BezierField, points: Float[ArrayLike, "*batch ndim"]) -> "SidedField":
        """Of points counted from the first sample."""
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
        """As that of `BezierField`."""
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
            across = holds[number ^ 2 ** (ndim - 1 - axis)]
            on_face = (above != below)[..., axis]
            ends[axis] = jnp.where(first, ~across & on_face, ends[axis])  # pyright: ignore
        found = found | here
    whole = functools.reduce(jnp.logical_and, holds)
    fixed = (found & ~whole)[..., None]
    return jnp.where(fixed, chosen, -1), jnp.stack(ends, axis=-1)
