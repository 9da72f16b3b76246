"""Many small symmetric positive definite systems at once: inverses and solutions, batch last."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._support.xla import matmul


def invert(square: Float[Array, "w w batch"]) -> Float[Array, "w w batch"]:
    """Gauss-Jordan elimination in place; no pivots need to be sought."""

    def step(k: Array | int, work: Float[Array, "w w batch"]) -> Float[Array, "w w batch"]:
        row = jax.lax.dynamic_index_in_dim(work, k, axis=0, keepdims=False)
        column = jax.lax.dynamic_index_in_dim(work, k, axis=1, keepdims=False)
        pivot = jax.lax.dynamic_index_in_dim(row, k, axis=0, keepdims=False)
        row = _replace(k, row, jnp.ones_like(row), axis=0) * (1 / pivot)[None]
        rest = _replace(k, work, jnp.zeros_like(work), axis=1) - column[:, None] * row[None]
        return _replace(k, rest, row[None], axis=0)

    # A real loop: written out, it takes as long and compiles more slowly.  Two steps at a time, or
    # XLA would copy the matrices after every step.
    return jax.lax.fori_loop(0, len(square), step, square, unroll=2)


def _replace(k: Array | int, old: Array, new: Array, axis: int) -> Array:
    """`old` with entry k along an axis taken from `new`.

    As a choice, which XLA fuses with what comes before and after; `jax.numpy.where` would be a
    function of its own, and in a unit set `apart` it would be called for every step.
    """
    here = jax.lax.broadcast_in_dim(jnp.arange(old.shape[axis]) == k, old.shape, (axis,))
    return jax.lax.select(here, jnp.broadcast_to(new, old.shape), old)


def batched(function: Callable) -> Callable:
    """A function of one vertex for many, the batch last."""
    return jax.vmap(function, in_axes=-1, out_axes=-1)


def solve_small(
    matrix: Float[Array, "fairing fairing"], rhs: Float[Array, "fairing columns"]
) -> Float[Array, "fairing columns"]:
    """Solve one system for many right-hand sides."""

    def solve(_, columns: Array) -> Array:
        return matmul(invert(matrix[:, :, None])[:, :, 0], columns)

    return jax.lax.custom_linear_solve(partial(matmul, matrix), rhs, solve, symmetric=True)
