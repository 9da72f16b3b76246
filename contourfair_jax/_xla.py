"""What XLA is told beside the mathematics: where not to fuse, and precision."""

from collections.abc import Callable
from functools import wraps

import jax
import jax.numpy as jnp
from jax.experimental.xla_metadata import set_xla_metadata
from jaxtyping import Array


def materialise(tree):
    """Keep XLA from computing `tree` again inside every use of it.

    XLA on the CPU fuses cheap operations into all their consumers.  Over a batch of vertices that
    multiplies work and compile time many times over.
    """
    return jax.lax.optimization_barrier(tree)


def apart(function: Callable) -> Callable:
    """`function` as a unit of its own, into and out of which XLA on the CPU fuses nothing.

    A barrier does not do that: it is gone before XLA decides what to fuse.
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


def matmul(left: Array, right: Array) -> Array:
    """Product of matrices in the precision of their type; GPUs round float32 by default."""
    return jnp.matmul(left, right, precision="highest")
