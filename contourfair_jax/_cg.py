"""Preconditioned conjugate gradients."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


class Solution(NamedTuple):
    """What `conjugate_gradients` returns: `residual` is relative to `size`."""

    value: Float[Array, "..."]
    steps: Int[Array, ""]
    residual: Float[Array, ""]
    size: Float[Array, ""]


def conjugate_gradients(
    apply: Callable[[Array], Array],
    rhs: Float[Array, "..."],
    guess: Float[Array, "..."],
    precondition: Callable[[Array], Array],
    tolerance: float,
    max_steps: int,
    least_size: float | Float[Array, ""] = 0.0,
) -> Solution:
    """Solve a symmetric positive definite system.

    Stops when the residual, in the norm of the preconditioner, is `tolerance` times the right-hand
    side, or `least_size` if that is larger, or after `max_steps`.  A guess that is worse than zero
    is not used.
    """

    def norm(x: Array) -> Array:
        return jnp.sum(x * precondition(x))

    def unfinished(state: tuple) -> Array:
        *_, squared, step = state
        return (squared > target) & (step < max_steps)

    def advance(state: tuple) -> tuple:
        x, residual, direction, squared, step = state
        image = apply(direction)
        length = squared / jnp.sum(direction * image)
        x = x + length * direction
        residual = residual - length * image
        scaled = precondition(residual)
        renewed = jnp.sum(residual * scaled)
        return x, residual, scaled + (renewed / squared) * direction, renewed, step + 1

    size = norm(rhs)
    largest = jnp.maximum(size, least_size**2)
    target = tolerance**2 * largest
    residual = rhs - apply(guess)
    useful = norm(residual) < size
    guess, residual = jnp.where(useful, guess, 0), jnp.where(useful, residual, rhs)
    direction = precondition(residual)
    state = (guess, residual, direction, jnp.sum(residual * direction), jnp.zeros((), jnp.int32))
    x, _, _, squared, steps = jax.lax.while_loop(unfinished, advance, state)
    relative = jnp.sqrt(squared / jnp.where(largest == 0, 1, largest))
    return Solution(x, steps, relative, jnp.sqrt(largest))
