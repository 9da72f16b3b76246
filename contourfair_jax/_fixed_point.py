"""The limit of a contraction, differentiated by the implicit function theorem.

A fixed point z = S(z, t) moves with `dz = S_z dz + S_t dt`.  So its derivative solves a linear
system with I - S_z, in forward mode, or its transpose, in reverse mode; as S contracts, the Neumann
series `v <- v + (b - (v - S_z v))` converges like the iteration.  Nothing of that is kept.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

State = TypeVar("State")

# Terms of the series at most.
MOST_TERMS = 100


def fixed_point(
    step: Callable[[State], State],
    solve: Callable[[], tuple[State, Any]],
    like: State,
    tolerance: float,
) -> tuple[State, Any]:
    """The result of `solve` with the derivatives of the fixed point of `step`.

    Parameters
    ----------
    step
        Contracts; differentiated with respect to all it closes over.
    solve
        Finds the fixed point; returns it and anything else, which is not differentiated.
    like
        A state, for its shape.
    tolerance
        Residual of the linear systems relative to their right-hand side.
    """

    def residual(state: State) -> State:
        return jax.tree.map(jnp.subtract, state, step(state))

    def tangent_solve(matvec: Callable, rhs: State) -> State:
        flat, unravel = ravel_pytree(rhs)
        value = jax.lax.custom_linear_solve(
            lambda x: ravel_pytree(matvec(unravel(x)))[0],
            flat,
            partial(_neumann, tolerance=tolerance),
            partial(_neumann, tolerance=tolerance),
        )
        return unravel(value)

    return jax.lax.custom_root(residual, like, lambda *_: solve(), tangent_solve, has_aux=True)


def _neumann(matvec: Callable, rhs: Float[Array, " n"], tolerance: float) -> Float[Array, " n"]:
    """Solve with an operator that is near the identity.

    Stops at the tolerance, or where the residual has stopped to shrink.
    """
    target = tolerance * jnp.linalg.norm(rhs)

    def unfinished(carry: tuple) -> Array:
        _, _, size, last, terms = carry
        return (size > target) & (size < 0.9 * last) & (terms < MOST_TERMS)

    def advance(carry: tuple) -> tuple:
        value, residual, size, _, terms = carry
        value = value + residual
        residual = rhs - matvec(value)
        return value, residual, jnp.linalg.norm(residual), size, terms + 1

    start = jnp.zeros_like(rhs), rhs, jnp.linalg.norm(rhs), jnp.full_like(target, jnp.inf), 0
    return jax.lax.while_loop(unfinished, advance, start)[0]
