"""Arrays of several precisions, coordinates with more digits than float32, ranges of numbers."""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Float


def is_traced(*arrays: object) -> bool:
    """Whether any of the arrays is abstract, as inside `jax.jit` or `jax.vmap`."""
    return any(isinstance(array, Tracer) for array in arrays)


# Coordinates of the border may be rounded so many times, and still be inside.
_ROUNDINGS = 4


def rounding(points: ArrayLike) -> float:
    """Bound on the rounding of coordinates, relative to their size."""
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


def ranges(first: np.ndarray, count: np.ndarray) -> np.ndarray:
    """`first[k], first[k] + 1, ...`, `count[k]` numbers, for one k after the other."""
    ends = np.cumsum(count)
    return np.arange(ends[-1] if len(ends) else 0) + np.repeat(first - (ends - count), count)


def batches(count: np.ndarray, most: int) -> Iterator[np.ndarray]:
    """The indices of `count` in parts whose counts sum to about `most`."""
    done = np.cumsum(count)
    if not len(done) or not done[-1]:
        return
    bounds = np.searchsorted(done, np.arange(most, done[-1], most), side="right")
    for first, last in zip([0, *bounds], [*bounds, len(done)], strict=True):
        yield np.arange(first, last)
