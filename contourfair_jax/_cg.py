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
    guess: Float[Array, "..."] | None,
    precondition: Callable[[Array], Array],
    tolerance: float,
    max_steps: int,
    least_size: float | Float[Array, ""] = 0.0,
) -> Solution:
    """Solve a symmetric positive definite system.

    Stops when the residual, in the norm of the preconditioner, is `tolerance` times the right-hand
    side, or `least_size` if that is larger, or after `max_steps`.  With a guess the first step goes
    along it as far as is best, so that none is worse than zero, and does not count.
    """

    def nonzero(number: Array) -> Array:
        return jnp.where(number == 0, jnp.ones_like(number), number)

    def unfinished(state: tuple) -> Array:
        *_, squared, step = state
        return (step < 0) | (squared > target) & (step < max_steps)

    def advance(state: tuple) -> tuple:
        x, residual, direction, squared, step = state
        image = apply(direction)
        length = squared / nonzero(jnp.sum(direction * image))
        x = x + length * direction
        residual = residual - length * image
        scaled = precondition(residual)
        renewed = jnp.sum(residual * scaled)
        kept = jnp.where(step < 0, 0, renewed / nonzero(squared))
        return x, residual, scaled + kept * direction, renewed, step + 1

    scaled = precondition(rhs)
    size = jnp.sum(rhs * scaled)
    largest = jnp.maximum(size, least_size**2)
    target = tolerance**2 * largest
    direction, squared, step = (
        (scaled, size, 0) if guess is None else (guess, jnp.sum(guess * rhs), -1)
    )
    state = (jnp.zeros_like(rhs), rhs, direction, squared, jnp.full((), step, jnp.int32))
    x, _, _, squared, steps = jax.lax.while_loop(unfinished, advance, state)
    relative = jnp.sqrt(squared / nonzero(largest))
    return Solution(x, steps, relative, jnp.sqrt(largest))
