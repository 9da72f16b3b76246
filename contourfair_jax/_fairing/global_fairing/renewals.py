"""Renewing the normals of global fairing: some number of times, or until the field stands still.

A fixed point z = S(z, t) moves with `dz = S_z dz + S_t dt`.  So its derivative solves a linear
system with I - S_z, in forward mode, or its transpose, in reverse mode.  The systems are solved by
BiCGStab: S contracts in the end, but S_z is not symmetric, and the terms of a Neumann series can
grow before they shrink.  Nothing of the iteration is kept.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from .cell_form import Dofs
from .cell_weights import Powers
from .noise import Springs

Carried = TypeVar("Carried")
# Steps of the linear solver at most, each of them two products.
MOST_STEPS = 200
# Relative residual above which there is no derivative to speak of: it becomes NaN.
WORST_RESIDUAL = 0.01


def fixed_point(
    step: Callable[[Carried], Carried],
    solve: Callable[[], tuple[Carried, Any]],
    like: Carried,
    tolerance: float,
) -> tuple[Carried, Any]:
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

    def residual(state: Carried) -> Carried:
        return jax.tree.map(jnp.subtract, state, step(state))

    def tangent_solve(matvec: Callable, rhs: Carried) -> Carried:
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


class State(NamedTuple):
    """What goes from one iteration to the next."""

    dofs: Dofs
    springs: Springs | None  # to noisy samples
    size: Float[Array, ""]  # of the right-hand side, which residuals are relative to

    @property
    def fixed(self) -> tuple[Dofs, Array | None]:
        """What stands still in the end."""
        return self.dofs, self.springs and self.springs.stiffness


class Info(NamedTuple):
    """What an iteration, or each of many, says of itself."""

    update: Float[Array, "..."]
    steps: Int[Array, "..."]
    residual: Float[Array, "..."]


Renewal: TypeAlias = Callable[[State, Powers], tuple[State, Info]]


def renew(renewal: Renewal, start: State, powers: Powers, iterations: int) -> tuple[Dofs, Info]:
    """Thin plate first, then the iterations."""
    first = jnp.arange(iterations + 1) == 0
    state, info = jax.lax.scan(renewal, start, powers.unless(first))
    return state.dofs, info


def converge(
    renewal: Renewal,
    start: State,
    powers: Powers,
    iterations: int,
    change: float,
    tolerance: float,
) -> tuple[Dofs, Info]:
    """Renew until the field changes by less than `change`, at most so many times.

    The limit is differentiated by the implicit function theorem, to the tolerance.  Iterations that
    were not needed say 0 of themselves.
    """
    most = iterations + 1

    def step(state: tuple[Dofs, Array | None]) -> tuple[Dofs, Array | None]:
        dofs, stiffness = state
        springs = start.springs and start.springs._replace(stiffness=stiffness)
        after, _ = renewal(State(dofs, springs, jnp.zeros_like(start.size)), powers)
        return after.fixed

    def solve() -> tuple[tuple[Dofs, Array | None], Info]:
        begin, frozen = jax.lax.stop_gradient((start, powers))

        def unfinished(carry: tuple[State, Info, Array]) -> Array:
            _, infos, k = carry
            return (k < most) & ((k < 2) | (infos.update[k - 1] > change))

        def advance(carry: tuple[State, Info, Array]) -> tuple[State, Info, Array]:
            state, infos, k = carry
            state, info = renewal(state, frozen.unless(k == 0))
            return state, jax.tree.map(lambda all, one: all.at[k].set(one), infos, info), k + 1

        _, like = jax.eval_shape(renewal, begin, frozen)
        infos = jax.tree.map(lambda one: jnp.zeros((most,), one.dtype), like)
        state, infos, _ = jax.lax.while_loop(unfinished, advance, (begin, infos, jnp.asarray(0)))
        # What is not differentiated has to be real all the same.
        infos = jax.tree.map(lambda info: info.astype(state.dofs.dtype), infos)
        return state.fixed, infos

    (dofs, _), infos = fixed_point(step, solve, start.fixed, tolerance)
    infos = jax.lax.stop_gradient(infos)
    return dofs, infos._replace(steps=infos.steps.astype(jnp.int32))
