"""Arrays of several precisions together."""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array


def finest(*arrays: ArrayLike) -> list[Array]:
    """The arrays in the precision of the finest of them, as far as JAX has it."""
    kinds = [jax.dtypes.canonicalize_dtype(jnp.result_type(array)) for array in arrays]
    real = [kind for kind in kinds if jnp.issubdtype(kind, jnp.floating)]
    kind = max(real, key=lambda kind: kind.itemsize, default=float)
    return [jnp.asarray(array, kind) for array in arrays]
