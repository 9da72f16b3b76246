"""The contour-fairness energy around a vertex as a quadratic form, given the normals.

Fairness is the variation of the gradient along the level set, blended with a little thin plate
(equations 12 and 13 of the paper, in any dimension)::

    E(f) = integral tr(H M H),   M = I - (1 - w) N,   N = n n^T,   n = g / |g|,

with the gradient g and the Hessian H of f.  N comes from the previous iterate, so E is quadratic in
the coefficients and every integral is a sum over Gauss points q of M_ab(q) times constants::

    E = sum_q sum_ab M_ab(q) sum_c f_ac(q) f_bc(q).

Tables of those constants depend on the spacing only.  The largest, of products of two functions,
is kept for half of every axis: the functions are even or odd about the vertex (`_basis`), so a sum
over all points is a sum over the half with M folded into its even and odd parts (`_fold`).

Functions of one vertex take and return vectors, and are written with slices, sums and products with
constant matrices only: under `jax.vmap` over a trailing axis they stay products of matrices.
`LocalEnergy.matrix`, which also puts vectors together, takes many vertices as they are, the batch
last: `jax.vmap` would move the batch first for that, and back.
"""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._bezier.bernstein import derivatives
from ..._support.xla import materialise, matmul
from ..method import FLAT
from .splines import (
    block_entries,
    full_axis,
    function_tables,
    index_set,
    point_weights,
    product_tables,
)

# A symmetric tensor at the quadrature points, entries a <= b.  Points are ordered by the half of
# every axis (upper halves first), then by the point within it.
Tensor = dict[tuple[int, int], Float[Array, " points"]]
# The same for many vertices.
Tensors = dict[tuple[int, int], Float[Array, "points batch"]]


class LocalEnergy(eqx.Module):
    """Tables of the energy over a vertex neighbourhood [0, 2]^d, for one spacing.

    `spacing` is relative: only its ratios change the minimum.  `places` says where the entries of
    a matrix stand among those that the tables give; it belongs to the tables so that energies of
    several batches can be stacked, which keeps the batch the first axis of what is gathered.
    """

    gradient_tables: list[Float[Array, "points coefficients"]]
    sample_hessians: dict[tuple[int, int], Float[Array, "points samples"]]
    fairing_hessians: dict[tuple[int, int], Float[Array, "points fairing"]]
    matrix_tables: list[Float[Array, "*groups entries pairs_half"]]
    weights: Float[Array, " points"]
    places: Int[Array, "fairing fairing"]

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
        self.places = jnp.asarray(_places(ndim))

    @property
    def ndim(self) -> int:
        """Spatial dimensions."""
        return len(self.gradient_tables)

    def gradients(
        self, coefficients: Float[Array, " coefficients"]
    ) -> list[Float[Array, " points"]]:
        """Gradient at every quadrature point, one vector for each axis."""
        return [matmul(table, coefficients) for table in self.gradient_tables]

    def matrix(self, tensors: Tensors) -> Float[Array, "fairing fairing batch"]:
        """The matrices of the normal equations of a batch of vertices."""
        folded = materialise(_fold(tensors, self.ndim))
        equal, others = self.matrix_tables
        rest = matmul(others, folded[1:])
        entries = jnp.concatenate([matmul(equal, folded[0]), rest.reshape(-1, rest.shape[-1])])
        return materialise(jnp.take(materialise(entries), self.places, axis=0, mode="clip"))

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
    thin_plate_weight: float | Float[Array | np.ndarray, ""],
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


@cache
def _places(ndim: int) -> np.ndarray:
    """Where every entry of a matrix stands in the order of `block_entries`."""
    rows, columns = np.concatenate([e.reshape(2, -1) for e in block_entries(ndim)], axis=1)
    places = np.empty((rows.max() + 1,) * 2, np.int32)
    places[rows, columns] = places[columns, rows] = np.arange(len(rows))
    return places


def _entry(tensor: dict, a: int, b: int) -> Array:
    """Entry of a symmetric tensor that is stored for a <= b."""
    return tensor[min(a, b), max(a, b)]


def _fold(tensors: Tensors, ndim: int) -> Float[Array, "blocks pairs_half batch"]:
    """Sums or differences over the halves of every axis, one row for each product of parities.

    A product of two functions is even along an axis, and a sum is what counts, if their parities
    agree there; one derivative along the axis turns that round.
    """
    values = jnp.stack(list(tensors.values()))
    values = values.reshape(len(tensors), *(2,) * ndim, -1, values.shape[-1])
    for axis in range(ndim):
        upper, lower = (jax.lax.index_in_dim(values, half, axis + 1, False) for half in (0, 1))
        turned = np.array([axes.count(axis) % 2 for axes in tensors])
        odd = np.arange(2)[:, None] ^ turned
        sign = jnp.asarray(1 - 2 * odd, values.dtype)
        sign = jnp.expand_dims(sign, (*range(axis), *range(axis + 2, upper.ndim + 1)))
        values = jnp.expand_dims(upper, axis) + sign * jnp.expand_dims(lower, axis)
    return values.reshape(2**ndim, -1, values.shape[-1])
