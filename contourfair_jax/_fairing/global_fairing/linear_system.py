"""The field of least energy, M given: conjugate gradients, differentiated as one linear solve."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .cell_form import CellForm, Dofs, Weights
from .coarse_grids import coarse_correction


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


class LinearSystem(NamedTuple):
    """Least energy over what is `free`, the rest as in `start`.

    `pins` are springs that hold the values to those of `start`.
    """

    form: CellForm
    weights: Weights
    start: Dofs
    free: Bool[Array, "twos vertices"]
    pins: Float[Array, " vertices"]

    def apply(self, x: Dofs) -> Dofs:
        """The matrix times `x`, which is zero where nothing is free."""
        return self._pinned(self.form.apply(self.weights, x), x)

    def apply_in_place(self, x: Dofs) -> Dofs:
        """`apply` where it is not differentiated."""
        return self._pinned(self.form.apply_in_place(self.weights, x), x)

    def right_side(self) -> Dofs:
        """What the start exerts on what is free."""
        return -jnp.where(self.free, self.form.forces(self.weights, self.start), 0)

    def _pinned(self, image: Dofs, x: Dofs) -> Dofs:
        return jnp.where(self.free, image.at[0].add(self.pins * x[0]), 0)


class Precision(NamedTuple):
    """How exactly to solve, and whether coarse grids help."""

    tolerance: float
    max_steps: int
    coarse_grids: bool


def solve(
    system: LinearSystem, guess: Dofs, size: Float[Array, ""], precision: Precision
) -> Solution:
    """The field of least energy, by conjugate gradients from `guess`.

    Differentiated as a linear solve: its derivatives are solves with the same matrix, whatever the
    number of steps.  In reverse mode the solves of earlier iterations have ever smaller right-hand
    sides, and need not be more exact than the last one, which comes first.  So `size`, a number
    beside the unknowns, zero but in the transposed solves, hands down the size of that one.
    """
    frozen = jax.lax.stop_gradient(system)
    near = jax.lax.stop_gradient(jnp.where(system.free, guess - system.start, 0))

    def apply(pair: tuple[Array, Array]) -> tuple[Array, Array]:
        x, size = pair
        return system.apply(x), size

    def solve_near(_, pair: tuple[Array, Array]) -> tuple[tuple, tuple]:
        right, size = pair
        solution = _iterate(frozen, right, near, jnp.zeros_like(size), precision)
        return (solution.value, size), (solution.steps, solution.residual)

    def solve_transposed(_, pair: tuple[Array, Array]) -> tuple[tuple, tuple]:
        right, size = pair
        solution = _iterate(frozen, right, None, size, precision)
        return (solution.value, solution.size), (solution.steps, solution.residual)

    right = system.right_side()
    # To be transposed, the size has to be a linear function of all that the system is one of.
    nothing = 0 * (right[0, 0] + system.weights[0, 0] + system.pins[0])
    (value, size), info = jax.lax.custom_linear_solve(
        apply,
        (right, size + nothing),
        solve_near,
        solve_transposed,
        symmetric=True,
        has_aux=True,
    )
    steps, residual = info
    return Solution(system.start + value, steps, residual, size)


def save_solutions(primitive, *_, **__) -> bool:
    """In reverse mode keep the solutions of the linear systems and compute the rest again."""
    return primitive is jax.lax.linear_solve_p


def _iterate(
    system: LinearSystem,
    right: Dofs,
    guess: Dofs | None,
    least_size: Float[Array, ""],
    precision: Precision,
) -> Solution:
    """Conjugate gradients with the inverse blocks of the vertices, and of coarse grids."""
    form, free, pins = system.form, system.free, system.pins
    inverse = form.inverse_blocks(system.weights, pins, free)

    def precondition(x: Dofs) -> Dofs:
        own = jnp.sum(inverse * x[None], axis=1)
        if not precision.coarse_grids:
            return own
        holes = (free[0] & (pins == 0)).reshape(form.shape)
        return jnp.where(free, own + coarse_correction(form, holes, x), 0)

    tolerance, max_steps, _ = precision
    return conjugate_gradients(
        system.apply_in_place, right, guess, precondition, tolerance, max_steps, least_size
    )
