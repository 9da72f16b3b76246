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
from jaxtyping import Array, Float

from ..._support.xla import apart, kept
from ..small_systems import batched, invert
from .energy import LocalEnergy, Tensor, cholesky_factor

# The elimination takes several rows at a time: traffic of memory against compile time.
MOST_PANELS = 7
LEAST_ROWS = 4
# The inverse of the square on the diagonal of a few rows, and it times what is right of the square.
# Each panel has rows of its own, so their number is not one for a whole list.
Panel = tuple[Float[Array, "_w _w batch"], Float[Array, "_w _r batch"]]
_invert = apart(invert)


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
        solve = self.factorise(energy.matrix(jax.lax.stop_gradient(tensor)))
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
        return partial(substitute, kept(eliminate(matrix)))


class LeastSquares(AbstractSolver):
    """The cross-check: the same minimum posed as residuals and solved by optimistix.

    The residuals are `L^T H` with `M = L L^T` at the quadrature points, and their sum of squares is
    the energy; a Gauss-Newton step with QR finds their minimum without forming the normal
    equations.  Hundreds of times slower than `Cholesky`, and like `LU` it calls LAPACK.
    """

    def __call__(self, energy, tensor, samples):
        # Half a second of imports, which nothing else of fairing needs.
        import lineax
        import optimistix

        def fit(tensor: Tensor, given: Array) -> Array:
            factor = cholesky_factor(tensor)

            def residuals(fairing: Array, _: None) -> Array:
                return energy.residuals(factor, given, fairing)

            start = jnp.zeros(energy.fairing_hessians[0, 0].shape[1], given.dtype)
            solver = optimistix.GaussNewton(rtol=1e-12, atol=1e-12, linear_solver=lineax.QR())
            return optimistix.least_squares(residuals, solver, start, throw=False).value

        return jax.vmap(fit, in_axes=-1, out_axes=-1)(tensor, samples)


def eliminate(matrix: Float[Array, "n n batch"]) -> list[Panel]:
    """Reduce symmetric positive definite matrices to block triangles, batch last.

    Several rows at a time: their square on the diagonal is inverted, what lies below takes all of
    them in one pass over memory.  As in a Cholesky decomposition no pivots need to be sought.
    """
    rows = max(LEAST_ROWS, -(-len(matrix) // MOST_PANELS))
    panels = []
    while len(matrix) > rows:
        inverse = _invert(matrix[:rows, :rows])
        scaled = _scale(inverse, matrix)
        panels.append((inverse, scaled))
        matrix = _subtract(matrix, scaled)
    return [*panels, (_invert(matrix), matrix[:, len(matrix) :])]


def substitute(panels: list[Panel], rhs: Float[Array, "n batch"]) -> Float[Array, "n batch"]:
    """Solve with the matrices that `eliminate` has reduced."""
    own = []
    for _, scaled in panels:
        own.append(rhs[: len(scaled)])
        rhs = _forward(scaled, rhs)
    solution = rhs  # nothing is left of it
    for (inverse, scaled), part in zip(reversed(panels), reversed(own), strict=True):
        first = _backward(inverse, scaled, part, solution)
        solution = jnp.concatenate([first, solution])
    return solution


@apart
def _scale(
    inverse: Float[Array, "w w batch"], matrix: Float[Array, "m m batch"]
) -> Float[Array, "w r batch"]:
    """The first rows of the matrix, right of their square, times the inverse of that."""
    w = len(inverse)
    return _product(inverse, matrix[:w, w:])


@apart
def _subtract(
    matrix: Float[Array, "m m batch"], scaled: Float[Array, "w r batch"]
) -> Float[Array, "r r batch"]:
    """What the first rows leave of the others."""
    w = len(scaled)
    return matrix[w:, w:] - _product(matrix[w:, :w], scaled)


def _product(
    left: Float[Array, "a w batch"], right: Float[Array, "w b batch"]
) -> Float[Array, "a b batch"]:
    """Products of matrices, written out as sums of every column times every row."""

    def term(k: int) -> Float[Array, "a b batch"]:
        column = jax.lax.slice_in_dim(left, k, k + 1, axis=1)
        return column * jax.lax.slice_in_dim(right, k, k + 1, axis=0)

    return sum((term(k) for k in range(1, len(right))), start=term(0))


@apart
def _forward(
    scaled: Float[Array, "w r batch"], rhs: Float[Array, "m batch"]
) -> Float[Array, "r batch"]:
    """What the first rows leave of the right-hand side of the others."""
    w = len(scaled)
    return rhs[w:] - jnp.sum(scaled * rhs[:w, None], axis=0)


@apart
def _backward(
    inverse: Float[Array, "w w batch"],
    scaled: Float[Array, "w r batch"],
    own: Float[Array, "w batch"],
    later: Float[Array, "r batch"],
) -> Float[Array, "w batch"]:
    """The first unknowns, given the later ones."""
    return jnp.sum(inverse * own[None], axis=1) - jnp.sum(scaled * later[None], axis=1)
