"""Renewing the normals of global fairing: some number of times, or until the field stands still."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._fixed_point import fixed_point
from ._form import Dofs
from ._noise import Springs
from ._reweight import Powers


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
