r"""The contour-fairness energy around a vertex as a quadratic form, given the normals.

Fairness is the variation of the gradient along the level set, blended with a little thin plate
(equations 12 and 13 of the paper, in any dimension)::

    E(f) = integral tr(H M H),   M = I - (1 - w) N,   N = n n^T,   n = g / |g|,

with the gradient g and the Hessian H of f.  N comes from the previous iterate, so E is quadratic in
the coefficients and every integral is a sum over Gauss points q of M_ab(q) times constants::

    E = sum_q sum_ab M_ab(q) sum_c f_ac(q) f_bc(q).

Tables of those constants depend on the spacing only.  The largest, of products of two functions,
is kept for half of every axis: the functions are even or odd about the vertex (`_basis`), so a sum
over all points is a sum over the half with M folded into its even and odd parts (`_fold`), one
table for each parity block.

Functions of one vertex take and return vectors, and are written with slices, sums and products with
constant matrices only: under `jax.vmap` over a trailing axis they stay products of matrices.
`LocalEnergy.matrix`, which also puts vectors together, takes many vertices as they are, the batch
last: `jax.vmap` would move the batch first for that, and back.
"""

import itertools
from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._basis import full_axis, index_set
from ._tables import (
    block_pairs,
    block_sizes,
    derivatives,
    function_tables,
    point_weights,
    product_tables,
)
from ._xla import materialise, matmul

# Gradients below this fraction of the neighbourhood's spread count as flat: N fades to zero.
FLAT = 1e-6

# A symmetric tensor at the quadrature points, entries a <= b.  Points are ordered by the half of
# every axis (upper halves first), then by the point within it.
Tensor = dict[tuple[int, int], Float[Array, " points"]]


class LocalEnergy(eqx.Module):
    """Tables of the energy over a vertex neighbourhood [0, 2]^d, for one spacing.

    `spacing` is relative: only its ratios change the minimum.
    """

    gradient_tables: list[Float[Array, "points coefficients"]]
    sample_hessians: dict[tuple[int, int], Float[Array, "points samples"]]
    fairing_hessians: dict[tuple[int, int], Float[Array, "points fairing"]]
    matrix_tables: list[Float[Array, "entries pairs_half"]]
    weights: Float[Array, " points"]

    def __init__(self, spacing: Float[Array, " ndim"], order: int):
        ndim, dtype = spacing.shape[0], spacing.dtype
        # The barrier keeps XLA from folding the products of constants below at compile time.
        axis, scale = materialise((jnp.asarray(full_axis(order), dtype), 1 / spacing))
        samples, fairing = index_set(ndim, "samples"), index_set(ndim, "fairing")
        first, second = derivatives(1, ndim), derivatives(2, ndim)
        tables = function_tables(axis, scale, np.concatenate([samples, fairing]), first + second)
        self.gradient_tables = list(tables[:ndim])
        hessians = dict(zip(second, tables[ndim:], strict=True))
        given = len(samples)
        self.sample_hessians = {axes: table[:, :given] for axes, table in hessians.items()}  # pyright: ignore
        self.fairing_hessians = {axes: table[:, given:] for axes, table in hessians.items()}  # pyright: ignore
        self.matrix_tables = product_tables(tables[ndim:, : order**ndim, given:], ndim)
        self.weights = jnp.asarray(point_weights(ndim, order), dtype)

    @property
    def ndim(self) -> int:
        """Spatial dimensions."""
        return len(self.gradient_tables)

    def gradients(
        self, coefficients: Float[Array, " coefficients"]
    ) -> list[Float[Array, " points"]]:
        """Gradient at every quadrature point, one vector for each axis."""
        return [matmul(table, coefficients) for table in self.gradient_tables]

    def normal_equations(
        self, tensor: Tensor, samples: Float[Array, " samples"]
    ) -> tuple[Float[Array, " entries"], Float[Array, " fairing"]]:
        """Matrix and right-hand side of the minimum over the fairing coefficients.

        Parameters
        ----------
        tensor
            M_ab at the quadrature points, times their weights.
        samples
            Coefficients of the sample functions.
        """
        return self.matrix(tensor), self.right_side(tensor, samples)

    def matrix(self, tensor: Tensor) -> Float[Array, " entries"]:
        """Blocks of the matrix of the normal equations, in the order of `block_pairs`.

        Of one vertex, or of a batch along a last axis.
        """
        folded = {axes: _fold(values, self.ndim) for axes, values in tensor.items()}
        entries = []
        for block, table in enumerate(self.matrix_tables):
            own = [parts[block ^ _flips(axes, self.ndim)] for axes, parts in folded.items()]
            entries.append(matmul(table, materialise(jnp.concatenate(own))))
        return jnp.concatenate(entries)

    def right_side(
        self, tensor: Tensor, samples: Float[Array, " samples"]
    ) -> Float[Array, " fairing"]:
        """Right-hand side of the normal equations."""
        return -self._forces(tensor, self.sample_hessians, samples)

    def apply(self, tensor: Tensor, fairing: Float[Array, " fairing"]) -> Float[Array, " fairing"]:
        """The matrix of the normal equations times a vector, without the matrix.

        For one vector that is less work than the matrix, and so are its derivatives.
        """
        return self._forces(tensor, self.fairing_hessians, fairing)

    def residuals(
        self, factor: Tensor, samples: Float[Array, " samples"], fairing: Float[Array, " fairing"]
    ) -> Float[Array, " residuals"]:
        """L^T H at every quadrature point, for M = L L^T: their sum of squares is the energy."""
        hessian = {
            axes: matmul(self.sample_hessians[axes], samples)
            + matmul(self.fairing_hessians[axes], fairing)
            for axes in factor
        }
        rows = [
            sum(factor[k, a] * _entry(hessian, a, c) for a in range(k, self.ndim))
            for k in range(self.ndim)
            for c in range(self.ndim)
        ]
        return jnp.concatenate(rows)

    def _forces(
        self, tensor: Tensor, tables: dict[tuple[int, int], Array], coefficients: Array
    ) -> Float[Array, " fairing"]:
        """What the part of the field with the given Hessians exerts on the fairing functions.

        The products of their Hessians with (M H + H M) / 2, off-diagonal entries counted twice.
        """
        hessian = {axes: matmul(table, coefficients) for axes, table in tables.items()}
        hessian = materialise(hessian)

        def product(a: int, c: int) -> Float[Array, " points"]:
            terms = [_entry(tensor, a, b) * _entry(hessian, b, c) for b in range(self.ndim)]
            return sum(terms[1:], start=terms[0])

        stress = {
            (a, c): product(a, a) if a == c else product(a, c) + product(c, a) for a, c in tensor
        }
        stress = materialise(stress)
        forces = [matmul(table.T, stress[axes]) for axes, table in self.fairing_hessians.items()]
        return sum(forces[1:], start=forces[0])


def plain_tensor(energy: LocalEnergy) -> Tensor:
    """M = I of the thin plate, times the quadrature weights."""
    zero = jnp.zeros_like(energy.weights)
    return {(a, b): energy.weights if a == b else zero for a, b in energy.sample_hessians}


def contour_tensor(
    weights: Float[Array, " points"],
    gradients: list[Float[Array, " points"]],
    thin_plate_weight: float | Float[Array, ""],
) -> Tensor:
    """M = I - (1 - w) N with N = g g^T / (|g|^2 + flat^2), times the quadrature weights.

    Where the gradient vanishes, N does too and the energy falls back to thin plate; value and
    derivatives are finite there.
    """
    squares = [g * g for g in gradients]
    squared = sum(squares[1:], start=squares[0])
    share = weights * (1 - thin_plate_weight) / (squared + FLAT**2)
    return {
        (a, b): (weights if a == b else 0) - share * gradients[a] * gradients[b]
        for a, b in derivatives(2, len(gradients))
    }


def cholesky_factor(tensor: Tensor) -> Tensor:
    """L of M = L L^T at every quadrature point; entry (k, a), k <= a, is L_ak."""
    factor: Tensor = {}
    for k, a in sorted(tensor):
        rest = tensor[k, a] - sum(factor[m, k] * factor[m, a] for m in range(k))
        factor[k, a] = jnp.sqrt(rest) if k == a else rest / factor[k, k]
    return factor


def full_matrix(
    entries: Float[Array, "entries batch"], ndim: int
) -> Float[Array, "fairing fairing batch"]:
    """Put the blocks of symmetric matrices together."""
    return jnp.take(entries, _places(ndim), axis=0, mode="clip")


@cache
def _places(ndim: int) -> np.ndarray:
    """Where the entries of the whole matrix stand among those of its blocks."""
    sizes = block_sizes("fairing", ndim)
    starts = np.cumsum(sizes) - sizes
    places = np.empty((sizes.sum(),) * 2, np.int32)
    first = 0
    for p, q in itertools.chain(*block_pairs(ndim)):
        block = first + np.arange(sizes[p] * sizes[q]).reshape(sizes[p], sizes[q])
        rows, columns = starts[p] + np.arange(sizes[p]), starts[q] + np.arange(sizes[q])
        places[np.ix_(rows, columns)] = block
        places[np.ix_(columns, rows)] = block.T
        first += block.size
    return places


def _flips(axes: tuple[int, ...], ndim: int) -> int:
    """The parities that derivatives along `axes` change, as a block number."""
    flips = 0
    for axis in axes:
        flips ^= 1 << (ndim - 1 - axis)
    return flips


def _entry(tensor: dict, a: int, b: int) -> Array:
    """Entry of a symmetric tensor that is stored for a <= b."""
    return tensor[min(a, b), max(a, b)]


def _fold(values: Float[Array, " points"], ndim: int) -> list[Float[Array, " half"]]:
    """Sums and differences over the halves of every axis: what meets even and odd functions."""
    parts = jnp.split(values, 2**ndim)
    for axis in range(ndim):
        step = 1 << (ndim - 1 - axis)
        parts = [
            parts[k ^ step] - parts[k] if k & step else parts[k] + parts[k ^ step]
            for k in range(2**ndim)
        ]
    return parts
