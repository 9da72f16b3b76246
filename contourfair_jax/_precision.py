"""Arrays of several precisions together, and coordinates that have more digits than float32."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ._method import is_traced

# Coordinates of the border may be rounded so many times, and still be inside.
_ROUNDINGS = 4


def rounding(points: ArrayLike) -> float:
    """What rounding may have changed coordinates by, relative to their size."""
    kind = jnp.result_type(points)
    return _ROUNDINGS * float(jnp.finfo(kind if jnp.issubdtype(kind, jnp.floating) else float).eps)


def finest(*arrays: ArrayLike) -> list[Array]:
    """The arrays in the precision of the finest of them, as far as JAX has it."""
    kinds = [jax.dtypes.canonicalize_dtype(jnp.result_type(array)) for array in arrays]
    real = [kind for kind in kinds if jnp.issubdtype(kind, jnp.floating)]
    kind = max(real, key=lambda kind: kind.itemsize, default=float)
    return [jnp.asarray(array, kind) for array in arrays]


def from_origin(
    points: ArrayLike, origin: Float[ArrayLike, " ndim"], dtype: jnp.dtype
) -> Float[Array | np.ndarray, "*batch ndim"]:
    """Points counted from the origin: where both are known of NumPy, and taken off in float64."""
    if is_traced(points, origin):
        at, first = finest(points, origin)
        return (at - jnp.broadcast_to(first, at.shape)).astype(dtype)
    return (np.asarray(points, np.float64) - np.asarray(origin, np.float64)).astype(dtype)
