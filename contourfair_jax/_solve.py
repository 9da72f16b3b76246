"""Solvers of the local systems: the only place where small linear algebra is called.

A solver is an object that finds, for a batch of vertices, the fairing coefficients that minimise
the local energy.  Arrays have the batch last.
"""

import abc
from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax
import optimistix
from jaxtyping import Array, Float

from ._energy import LocalEnergy, Tensor, cholesky_factor, full_matrix
from ._xla import materialise, matmul

# Panels of rows that the elimination works in: traffic of memory against compile time.
PANELS = 4


class AbstractSolver(eqx.Module):
    """What `LocalFairing(solver=...)` takes: finds the minimum of many local energies."""

    @abc.abstractmethod
    def __call__(
        self,
        energy: LocalEnergy,
        tensor: Tensor,
        samples: Float[Array, "samples batch"],
    ) -> Float[Array, "fairing batch"]:
        """Fairing coefficients that minimise the energy with the tensor M given."""


class AbstractDirectSolver(AbstractSolver):
    """Assembles the normal equations and solves them as dense symmetric systems.

    Differentiated as the solution of linear systems, with the factors of the matrix at hand and
    without going through its assembly.
    """

    def __call__(self, energy, tensor, samples):
        entries = batched(energy.matrix)(jax.lax.stop_gradient(tensor))
        matrix = materialise(full_matrix(materialise(entries), energy.ndim))
        solve = self.factorise(matrix)
        return jax.lax.custom_linear_solve(
            lambda fairing: batched(energy.apply)(tensor, fairing),
            batched(energy.right_side)(tensor, samples),
            lambda _, rhs: solve(rhs),
            symmetric=True,
        )

    @abc.abstractmethod
    def factorise(
        self, matrix: Float[Array, "n n batch"]
    ) -> Callable[[Float[Array, "n batch"]], Float[Array, "n batch"]]:
        """A function that solves symmetric positive definite systems with these matrices."""


class LU(AbstractDirectSolver):
    """The reference: batched `jax.numpy.linalg.solve`.

    It calls LAPACK on the CPU, which JAX 0.10 can deadlock in; see the README.
    """

    def factorise(self, matrix):
        first = jnp.moveaxis(matrix, -1, 0)
        return lambda rhs: jnp.linalg.solve(first, rhs.T[..., None])[..., 0].T


class Cholesky(AbstractDirectSolver):
    """The default: symmetric elimination without pivots, in plain array operations.

    With the batch last every step is a long vector operation.  No LAPACK, so nothing can hang.
    """

    def factorise(self, matrix):
        return partial(substitute, eliminate(matrix))


class LeastSquares(AbstractSolver):
    """The cross-check: the same minimum posed as residuals and solved by optimistix.

    The residuals are `L^T H` with `M = L L^T` at the quadrature points, and their sum of squares is
    the energy; a Gauss-Newton step with QR finds their minimum without forming the normal
    equations.  About 20 times slower than `Cholesky`, and like `LU` it calls LAPACK.
    """

    def __call__(self, energy, tensor, samples):
        def fit(tensor: Tensor, given: Array) -> Array:
            factor = cholesky_factor(tensor)

            def residuals(fairing: Array, _: None) -> Array:
                return energy.residuals(factor, given, fairing)

            start = jnp.zeros(energy.fairing_hessians[0, 0].shape[1], given.dtype)
            solver = optimistix.GaussNewton(rtol=1e-12, atol=1e-12, linear_solver=lineax.QR())
            return optimistix.least_squares(residuals, solver, start, throw=False).value

        return jax.vmap(fit, in_axes=-1, out_axes=-1)(tensor, samples)


def eliminate(matrix: Float[Array, "n n batch"]) -> list[Float[Array, "w m batch"]]:
    """Reduce symmetric positive definite matrices to upper triangles, batch last.

    A panel of rows is reduced by itself; what lies below takes all its rows in one pass over
    memory.  Returns the panels, each from its first pivot on.
    """
    n = len(matrix)
    panels = []
    while len(matrix) > 0:
        steps = min(-(-n // PANELS), len(matrix))
        # A real loop: unrolled, XLA would fuse the steps and compute every one again for each use.
        panel = jax.lax.fori_loop(0, steps, _eliminate_row, matrix[:steps])
        panels.append(materialise(panel))
        matrix = _subtract_panel(panels[-1], matrix[steps:, steps:])
    return panels


def substitute(
    panels: list[Float[Array, "w m batch"]], rhs: Float[Array, "n batch"]
) -> Float[Array, "n batch"]:
    """Solve with the matrices that `eliminate` has reduced."""
    reduced = []
    for panel in panels:
        steps = len(panel)
        own, scaled = _forward_substitute(panel, rhs[:steps])
        reduced.append(own)
        rhs = materialise(rhs[steps:] - jnp.sum(panel[:, steps:] * scaled[:, None], axis=0))
    solution = rhs  # nothing is left of it
    for panel, own in zip(reversed(panels), reversed(reduced), strict=True):
        known = jnp.sum(panel[:, len(panel) :] * solution[None], axis=1)
        solution = jnp.concatenate([_back_substitute(panel, own - known), solution])
    return solution


def _eliminate_row(k: Array, work: Float[Array, "w m batch"]) -> Float[Array, "w m batch"]:
    """Subtract multiples of row k from the rows below."""
    # Taking the factors from column k and not, by symmetry, from row k lets XLA work in place.
    row = jax.lax.dynamic_index_in_dim(work, k, axis=0, keepdims=False)
    column = jax.lax.dynamic_index_in_dim(work, k, axis=1, keepdims=False)
    pivot = jax.lax.dynamic_index_in_dim(row, k, axis=0, keepdims=False)
    below = jnp.arange(work.shape[0])[:, None] > k
    factors = jnp.where(below, column * (1 / pivot)[None], 0)
    return work - factors[:, None] * row[None]


def _subtract_panel(
    panel: Float[Array, "w m batch"], rest: Float[Array, "r r batch"]
) -> Float[Array, "r r batch"]:
    """Subtract multiples of the reduced rows of `panel` from the rows below it."""
    if len(rest) == 0:
        return rest
    w = len(panel)
    pivots = jnp.stack([panel[k, k] for k in range(w)])
    factors = materialise(panel[:, w:] / pivots[:, None])  # columns below, by symmetry
    terms = [factors[k][:, None] * panel[k, w:][None] for k in range(w)]
    return materialise(rest - sum(terms[1:], start=terms[0]))


def _forward_substitute(
    panel: Float[Array, "w m batch"], rhs: Float[Array, "w batch"]
) -> tuple[Float[Array, "w batch"], Float[Array, "w batch"]]:
    """Do to `rhs` what `_eliminate_row` did to the panel; the result, and it over the pivots."""
    w = panel.shape[0]

    def step(k: Array, pair: tuple[Array, Array]) -> tuple[Array, Array]:
        x, scaled = pair
        row = jax.lax.dynamic_index_in_dim(panel, k, keepdims=False)[:w]
        pivot = jax.lax.dynamic_index_in_dim(row, k, keepdims=False)
        value = jax.lax.dynamic_index_in_dim(x, k, keepdims=False) / pivot
        x = x - jnp.where(jnp.arange(w)[:, None] > k, row * value[None], 0)
        return x, jax.lax.dynamic_update_index_in_dim(scaled, value, k, 0)

    return jax.lax.fori_loop(0, w, step, (rhs, jnp.zeros_like(rhs)))


def _back_substitute(
    panel: Float[Array, "w m batch"], rhs: Float[Array, "w batch"]
) -> Float[Array, "w batch"]:
    """Solve with the upper triangle of the first columns of `panel`."""
    w = panel.shape[0]

    def step(i: Array, x: Float[Array, "w batch"]) -> Float[Array, "w batch"]:
        k = w - 1 - i
        row = jax.lax.dynamic_index_in_dim(panel, k, keepdims=False)[:w]
        later = jnp.where(jnp.arange(w)[:, None] > k, row * x, 0)
        value = jax.lax.dynamic_index_in_dim(x, k, keepdims=False) - jnp.sum(later, axis=0)
        pivot = jax.lax.dynamic_index_in_dim(row, k, keepdims=False)
        return jax.lax.dynamic_update_index_in_dim(x, value / pivot, k, 0)

    return jax.lax.fori_loop(0, w, step, rhs)


def batched(function: Callable) -> Callable:
    """A function of one vertex for many, the batch last."""
    return jax.vmap(function, in_axes=-1, out_axes=-1)


def solve_small(
    ndim: int, entries: Float[Array, " entries"], rhs: Float[Array, "fairing columns"]
) -> Float[Array, "fairing columns"]:
    """Solve one system for many right-hand sides."""
    matrix = full_matrix(entries[:, None], ndim)[:, :, 0]

    def solve(_, columns: Array) -> Array:
        work = jnp.concatenate([matrix, columns], axis=1)
        return jax.lax.fori_loop(0, matrix.shape[0], _pivot, work)[:, matrix.shape[0] :]

    return jax.lax.custom_linear_solve(partial(matmul, matrix), rhs, solve, symmetric=True)


def _pivot(k: Array, work: Float[Array, "n m"]) -> Float[Array, "n m"]:
    """One step of Gauss-Jordan elimination."""
    row = jax.lax.dynamic_index_in_dim(work, k, axis=0, keepdims=False)
    column = jax.lax.dynamic_index_in_dim(work, k, axis=1, keepdims=False)
    row = row / jax.lax.dynamic_index_in_dim(row, k, axis=0, keepdims=False)
    return jax.lax.dynamic_update_index_in_dim(work - jnp.outer(column, row), row, k, axis=0)
