"""Missing samples kept missing, whatever a method puts in their place."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


def without_gaps(
    net: Float[Array, "*net"], missing: Bool[Array, "*n"] | np.ndarray
) -> Float[Array, "*net"]:
    """A control net with NaN in the cells that a missing sample is a corner of, nowhere else.

    Bezier points nearest to a missing sample are NaN: all such cells hold one, and their faces
    between samples that are there keep their values.
    """
    for axis, points in enumerate(net.shape):
        missing = jnp.take(jnp.asarray(missing), (np.arange(points) + 1) // 3, axis=axis)
    return jnp.where(missing, jnp.nan, net)
