"""Curvature of level sets from the gradient and second derivatives, with JAX and on the host.

With the gradient g and the Hessian H of a field in d dimensions, and `n = g / |g|`, the mean of the
principal curvatures of its level sets is `(tr H - n H n) / ((d - 1) |g|)`; positive where a level
set bends away from the gradient.  Second derivatives come along axes a <= b, as in `derivatives`.
"""

from collections.abc import Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .bernstein import derivatives
from .nets import is_flat

Second = TypeVar("Second", Array, np.ndarray)


def full_hessian(second: Second, ndim: int) -> Second:
    """The symmetric matrix (..., ndim, ndim) of the second derivatives (..., derivatives)."""
    rows, columns = np.triu_indices(ndim)
    place = np.zeros((ndim, ndim), dtype=int)
    place[rows, columns] = place[columns, rows] = np.arange(len(rows))
    return second[..., place]


def mean_curvature(
    value: Float[Array, "*batch"],
    gradient: Float[Array, "*batch ndim"],
    hessian: Float[Array, "*batch ndim ndim"],
    spacing: Float[Array, " ndim"],
) -> Float[Array, "*batch"]:
    """Mean curvature of the level sets, with JAX; 0 where the gradient is rounding."""
    flat = is_flat(value, gradient, spacing)
    # It does not depend on the scale of the values, but squares would leave their range.
    size = jax.lax.stop_gradient(jnp.where(flat, 1, jnp.max(jnp.abs(gradient), axis=-1)))
    unit, hessian = gradient / size[..., None], hessian / size[..., None, None]
    squared = jnp.where(flat, 1, jnp.sum(unit * unit, axis=-1))
    along = jnp.einsum("...a,...ab,...b->...", unit, hessian, unit, precision="highest")
    trace = jnp.trace(hessian, axis1=-2, axis2=-1)
    curvature = (trace - along / squared) / (jnp.sqrt(squared) * (len(spacing) - 1))
    return jnp.where(flat, 0, curvature)


def host_mean_curvature(
    gradient: Sequence[np.ndarray] | np.ndarray, second: Sequence[np.ndarray] | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`|g|` and the mean curvature on the host; the latter is 0 where the gradient vanishes.

    Parameters
    ----------
    gradient : sequence of ndim arrays
        Of any one shape: of points, or of grids of them.
    second : sequence of arrays
        Of the same shape, one for each pair of axes a <= b.
    """
    ndim = len(gradient)
    second_along = dict(zip(derivatives(2, ndim), second, strict=True))
    squared = sum(g * g for g in gradient)
    trace = sum(second_along[k, k] for k in range(ndim))
    along = sum(
        (1 if a == b else 2) * value * gradient[a] * gradient[b]
        for (a, b), value in second_along.items()
    )
    size = np.sqrt(squared)
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = np.where(squared > 0, (trace - along / squared) / ((ndim - 1) * size), 0)
    return size, curvature


def host_gaussian_curvature(
    gradient: Float[np.ndarray, "n 3"], hessian: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, " n"]:
    """Product of the principal curvatures in 3-D, on the host; 0 where the gradient vanishes.

    With the adjugate adj H it is `g (adj H) g / |g|^4`.
    """
    size = np.linalg.norm(gradient, axis=1)
    # Rows of the adjugate of a symmetric matrix are cross products of its rows.
    adjugate = np.cross(np.roll(hessian, -1, 1), np.roll(hessian, -2, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = gradient / size[:, None]
        curvature = np.einsum("na,nab,nb->n", normal, adjugate, normal) / size**2
    return np.where(size == 0, 0, curvature)
