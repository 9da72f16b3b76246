"""What XLA is told beside the mathematics: where not to fuse, and precision."""

import jax
import jax.numpy as jnp
from jaxtyping import Array


def materialise(tree):
    """Keep XLA from computing `tree` again inside every use of it.

    XLA on the CPU fuses cheap operations into all their consumers.  Over a batch of vertices that
    multiplies work and compile time many times over.
    """
    return jax.lax.optimization_barrier(tree)


def matmul(left: Array, right: Array) -> Array:
    """Product of matrices in the precision of their type; GPUs round float32 by default."""
    return jnp.matmul(left, right, precision="highest")
