"""Minimising half the sum of squares of residuals: one interface for several optimisers.

jaxopt is imported when it is used: its import warns that it is no longer maintained.
"""

import abc
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from .._support import checks

Residuals = Callable[[Array], Any]
Report = Callable[[Any, Any, Any], None]
# Halvings of a Gauss-Newton step that does not lower the loss.
HALVINGS = 10


def loss_of(residuals: Residuals) -> Callable[[Array], Float[Array, ""]]:
    """Half the sum of squares of all arrays that `residuals` returns."""

    def loss(z: Array) -> Array:
        return sum(jnp.sum(part * part) for part in jax.tree.leaves(residuals(z))) / 2  # type: ignore[return-value]

    return loss


class AbstractOptimiser(eqx.Module):
    """A way for `fit_samples` to search; the search ends where the gradient of the loss is small.

    Parameters
    ----------
    tolerance : float
        Norm of the gradient, in the coordinates of the fit, over the norm of the residuals of the
        constant field at the mean of the data.
    max_steps : int
    """

    tolerance: eqx.AbstractVar[float]
    max_steps: eqx.AbstractVar[int]

    def __check_init__(self):
        checks.check_real(self.tolerance, "tolerance", open_below=True)
        checks.check_count(self.max_steps, 1, "max_steps")

    @abc.abstractmethod
    def init(self, residuals: Residuals, z: Array) -> Any:
        """State before the first step."""

    @abc.abstractmethod
    def step(self, residuals: Residuals, z: Array, state: Any) -> tuple[Array, Any]:
        """Better unknowns, and the state after."""


class GaussNewton(AbstractOptimiser):
    """Gauss-Newton: each step solves the linearised problem by conjugate gradients.

    The Jacobian is never formed.  For linear fairing (`LocalFairing(iterations=0)`, or
    `GlobalFairing(iterations=0)`) and all observations but `Masks` the first step is the answer.

    Parameters
    ----------
    tolerance, max_steps
        As for every optimiser.
    inner_steps : int
        Limit on the steps of conjugate gradients in each step.
    """

    tolerance: float = eqx.field(static=True, default=1e-5)
    max_steps: int = eqx.field(static=True, default=20)
    inner_steps: int = eqx.field(static=True, default=500)

    def __check_init__(self):
        checks.check_count(self.inner_steps, 1, "inner_steps")

    def init(self, residuals, z):
        return None

    def step(self, residuals, z, state):
        values, push = jax.linearize(residuals, z)
        jacobian = lx.FunctionLinearOperator(push, jax.eval_shape(lambda: z))
        solver = _least_squares(self.tolerance, self.inner_steps)
        right = jax.tree.map(jnp.negative, values)
        change = lx.linear_solve(jacobian, right, solver, throw=False).value
        loss = loss_of(residuals)
        before = loss(z)

        def worse(trial: tuple[Array, Array]) -> Array:
            length, halvings = trial
            return (halvings < HALVINGS) & ~(loss(z + length * change) <= before)

        def halve(trial: tuple[Array, Array]) -> tuple[Array, Array]:
            return trial[0] / 2, trial[1] + 1

        start = jnp.ones((), z.dtype), jnp.zeros((), jnp.int32)
        length, halvings = jax.lax.while_loop(worse, halve, start)
        useful: Array = jnp.where(halvings < HALVINGS, length * change, jnp.zeros_like(z))  # pyright: ignore
        return z + useful, None


def _least_squares(tolerance: float, max_steps: int) -> lx.AbstractLinearSolver:
    """Conjugate gradients on the normal equations, to a gradient below the search's tolerance."""
    return lx.Normal(lx.CG(0.0, tolerance / 4, norm=optx.two_norm, max_steps=max_steps))


class _Optimistix(AbstractOptimiser):
    """A solver of optimistix, stepped from outside so that all optimisers end alike."""

    @abc.abstractmethod
    def solver(self) -> optx.AbstractIterativeSolver:
        """The solver; its own tolerances are not used."""

    def _call(self, residuals: Residuals) -> Callable:
        return lambda z, _: (residuals(z), None)

    def init(self, residuals, z):
        call = self._call(residuals)
        out = jax.eval_shape(lambda: call(z, None)[0])
        return self.solver().init(call, z, None, {}, out, None, frozenset())

    def step(self, residuals, z, state):
        z, state, _ = self.solver().step(self._call(residuals), z, None, {}, state, frozenset())
        return z, state


class Dogleg(_Optimistix):
    """Dogleg (optimistix): Gauss-Newton within a trust region, for residuals far from linear.

    Parameters
    ----------
    tolerance, max_steps
        As for every optimiser.
    inner_steps : int
        Limit on the steps of conjugate gradients in each step.
    """

    tolerance: float = eqx.field(static=True, default=1e-5)
    max_steps: int = eqx.field(static=True, default=50)
    inner_steps: int = eqx.field(static=True, default=500)

    def __check_init__(self):
        checks.check_count(self.inner_steps, 1, "inner_steps")

    def solver(self):
        inner = _least_squares(self.tolerance, self.inner_steps)
        return optx.Dogleg(0.0, 0.0, linear_solver=inner)


class BFGS(_Optimistix):
    """BFGS (optimistix): only gradients; keeps a dense matrix, so for some thousand samples.

    Parameters
    ----------
    tolerance, max_steps
        As for every optimiser.
    """

    tolerance: float = eqx.field(static=True, default=1e-5)
    max_steps: int = eqx.field(static=True, default=1000)

    def solver(self):
        return optx.BFGS(0.0, 0.0)

    def _call(self, residuals):
        loss = loss_of(residuals)
        return lambda z, _: (loss(z), None)


class LBFGS(AbstractOptimiser):
    """Limited-memory BFGS (jaxopt): only gradients, little memory; for any number of samples.

    Parameters
    ----------
    tolerance, max_steps
        As for every optimiser.
    history : int
        Steps that are remembered.
    """

    tolerance: float = eqx.field(static=True, default=1e-5)
    max_steps: int = eqx.field(static=True, default=2000)
    history: int = eqx.field(static=True, default=10)

    def __check_init__(self):
        checks.check_count(self.history, 1, "history")

    def _solver(self, residuals: Residuals) -> Any:

        return lbfgs(loss_of(residuals), self.history)

    def init(self, residuals, z):
        return self._solver(residuals).init_state(z)

    def step(self, residuals, z, state):
        return tuple(self._solver(residuals).update(z, state))


class Search(NamedTuple):
    """Result of `search`."""

    unknowns: Float[Array, "*shape"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    losses: Float[Array, " visited"]
    gradients: Float[Array, " visited"]


def search(
    optimiser: AbstractOptimiser,
    residuals: Residuals,
    z: Float[Array, "*shape"],
    size: Float[Array, ""],
    report: Report | None,
) -> Search:
    """Step until the gradient is below `tolerance * size`, or `max_steps` are done.

    `report` is called with the step, the loss and the gradient, by the compiled program.
    Entries of the histories after the last step are NaN.
    """
    # Optimisers see residuals and unknowns in units of `size`, so that tolerances are absolute.
    size = jnp.where(size == 0, 1, size)

    def scaled(z: Array) -> Any:
        return jax.tree.map(lambda part: part / size, residuals(size * z))

    measure = jax.value_and_grad(loss_of(scaled))
    arrays, static = eqx.partition(optimiser.init(scaled, z / size), eqx.is_array)

    def record(z: Array, step: Array, histories: tuple[Array, Array]) -> tuple[Array, Array]:
        loss, gradient = measure(z)
        loss, norm = loss * size**2, jnp.sqrt(jnp.sum(gradient * gradient))
        if report is not None:
            jax.debug.callback(report, step, loss, norm)
        return histories[0].at[step].set(loss), histories[1].at[step].set(norm)

    def unfinished(carry: tuple) -> Array:
        _, _, step, (losses, norms) = carry
        short = (norms[step] > optimiser.tolerance) & jnp.isfinite(losses[step])
        return short & (step < optimiser.max_steps)

    def advance(carry: tuple) -> tuple:
        z, arrays, step, histories = carry
        # Libraries leave the precision of products to the default, which is low on GPUs.
        with jax.default_matmul_precision("highest"):
            z, state = optimiser.step(scaled, z, eqx.combine(arrays, static))
        return z, eqx.filter(state, eqx.is_array), step + 1, record(z, step + 1, histories)

    empty = jnp.full((optimiser.max_steps + 1,), jnp.nan, z.dtype)
    first = jnp.zeros((), jnp.int32)
    carry = z / size, arrays, first, record(z / size, first, (empty, empty))
    z, _, steps, (losses, norms) = jax.lax.while_loop(unfinished, advance, carry)
    return Search(size * z, norms[steps] <= optimiser.tolerance, steps, losses, norms)


with warnings.catch_warnings():
    warnings.filterwarnings("ignore", category=DeprecationWarning)
    import jaxopt


def lbfgs(loss: Callable, history: int) -> "jaxopt.LBFGS":
    """Limited-memory BFGS that is stepped from outside."""
    return jaxopt.LBFGS(loss, history_size=history, tol=0.0, implicit_diff=False)
