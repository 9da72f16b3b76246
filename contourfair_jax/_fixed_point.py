"""The limit of a contraction, differentiated by the implicit function theorem.

A fixed point z = S(z, t) moves with `dz = S_z dz + S_t dt`.  So its derivative solves a linear
system with I - S_z, in forward mode, or its transpose, in reverse mode.  The systems are solved by
BiCGStab: S contracts in the end, but S_z is not symmetric, and the terms of a Neumann series can
grow before they shrink.  Nothing of the iteration is kept.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

State = TypeVar("State")

# Steps of the linear solver at most, each of them two products.
MOST_STEPS = 200
# Relative residual above which there is no derivative to speak of: it becomes NaN.
WORST_RESIDUAL = 0.01


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
        Residual of the linear systems relative to their right-hand side.  Derivatives are NaN where
        it cannot be brought near that.
    """

    def residual(state: State) -> State:
        return jax.tree.map(jnp.subtract, state, step(state))

    def tangent_solve(matvec: Callable, rhs: State) -> State:
        flat, unravel = ravel_pytree(rhs)
        value = jax.lax.custom_linear_solve(
            lambda x: ravel_pytree(matvec(unravel(x)))[0],
            flat,
            partial(_solve, tolerance=tolerance),
            partial(_solve, tolerance=tolerance),
        )
        return unravel(value)

    return jax.lax.custom_root(residual, like, lambda *_: solve(), tangent_solve, has_aux=True)


def _solve(matvec: Callable, rhs: Float[Array, " n"], tolerance: float) -> Float[Array, " n"]:
    """Solve with an operator that is not symmetric, by BiCGStab; NaN if that fails."""
    # Written out: JAX cannot transpose the rule of its own `bicgstab` inside another linear solve,
    # and that of lineax takes negative steps for a breakdown in float32.
    size = _norm(rhs)
    first = rhs / jnp.where(size > 0, size, 1)

    def unfinished(carry: tuple) -> Array:
        _, residual, _, _, steps = carry
        return (_norm(residual) > tolerance) & (steps < MOST_STEPS)

    def advance(carry: tuple) -> tuple:
        value, residual, direction, along, steps = carry
        image = matvec(direction)
        length = along / jnp.vdot(first, image)
        half = residual - length * image
        turned = matvec(half)
        damping = jnp.vdot(turned, half) / jnp.vdot(turned, turned)
        value = value + length * direction + damping * half
        residual = half - damping * turned
        next_along = jnp.vdot(first, residual)
        direction = direction - damping * image
        direction = residual + (next_along / along) * (length / damping) * direction
        return value, residual, direction, next_along, steps + 1

    start = jnp.zeros_like(first), first, first, jnp.vdot(first, first), 0
    value = jax.lax.while_loop(unfinished, advance, start)[0]
    error = _norm(first - matvec(value))
    return jnp.where(error <= max(WORST_RESIDUAL, tolerance), value * size, jnp.nan)


def _norm(x: Float[Array, " n"]) -> Float[Array, ""]:
    return jnp.sqrt(jnp.vdot(x, x))
