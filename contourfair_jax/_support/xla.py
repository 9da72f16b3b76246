"""Hints for JAX beside the mathematics: where not to fuse, what to keep, how much at once."""

import os
from collections.abc import Callable
from functools import wraps
from typing import NamedTuple

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
    """Mark values that took long to compute."""
    return checkpoint_name(tree, "kept")


def matmul(left: Array, right: Array) -> Array:
    """Product of matrices in the precision of their type; GPUs round float32 by default."""
    return jnp.matmul(left, right, precision="highest")


class WorkingSet(NamedTuple):
    """Vertices of a window of local fairing, and bytes of what a step inside works on.

    `core_bytes` is what each of `cores` works on where every one has a batch of its own.
    """

    window_vertices: int
    batch_bytes: int
    cores: int
    core_bytes: int


def _processors() -> int:
    """Number of cores that the process may use, if known: XLA starts as many threads."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


CORES = min(_processors(), 16)
# Every step of a program is a vector operation that reads and writes its whole working set.
CACHED = WorkingSet(2048 * CORES, 12 * 2**20, CORES, 3 * 2**20)
# A step of a GPU takes some microseconds however small it is.
FILLING = WorkingSet(2**19, 512 * 2**20, 1, 512 * 2**20)


def working_set() -> WorkingSet:
    """The working set that suits the default device."""
    return CACHED if jax.default_backend() == "cpu" else FILLING
