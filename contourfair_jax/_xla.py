"""What JAX is told beside the mathematics: where not to fuse, what to keep, and precision."""

from collections.abc import Callable
from functools import wraps

import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name
from jax.experimental.xla_metadata import set_xla_metadata
from jaxtyping import Array

# The policy for `jax.checkpoint` that keeps what is `kept`, and computes the rest again.
save_kept = jax.checkpoint_policies.save_only_these_names("kept")


def materialise(tree):
    """A barrier to what XLA simplifies: nothing is folded or moved across it.

    On the CPU it is gone before XLA decides what to fuse; `apart` keeps it from that.
    """
    return jax.lax.optimization_barrier(tree)


def apart(function: Callable) -> Callable:
    """`function` as a unit of its own, into and out of which XLA on the CPU fuses nothing.

    Otherwise XLA fuses cheap operations into all their consumers and computes them again there,
    which over a batch of vertices multiplies work and compile time many times over.
    """

    @jax.jit
    @wraps(function)
    def unit(*arguments):
        with set_xla_metadata(inlineable=None):  # the functions that this one calls
            return function(*arguments)

    @wraps(function)
    def call(*arguments):
        if jax.default_backend() != "cpu":
            return unit(*arguments)
        with set_xla_metadata(inlineable="false"):
            return unit(*arguments)

    return call


def kept(tree):
    """Marks what took long to compute."""
    return checkpoint_name(tree, "kept")


def matmul(left: Array, right: Array) -> Array:
    """Product of matrices in the precision of their type; GPUs round float32 by default."""
    return jnp.matmul(left, right, precision="highest")
