r"""Quadratic forms of a field that are sums over cells, given a few weights per cell.

    E(u) = 1/2 sum_v sum_g w_g(v) u(v)^T K_g u(v)

with the 4^d degrees of freedom u(v) of cell v and constant matrices K_g.  For the energy the groups
g are the entries a <= b of the tensor M and, last, tension; for structure tensors the entries of J.
Cells are worked on in chunks that stay in the cache, each with one product of matrices.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._energy import derivatives
from ._hermite import corner_shifts, gather_corners, gram, scatter_corners

# Memory for the products of all matrices with the cells that are worked on together.
CHUNK_BYTES = 4 * 2**20

Dofs = Float[Array, "twos vertices"]
Weights = Float[Array, "groups vertices"]


class CellForm(eqx.Module):
    """Constant matrices K_g of a cell, for one shape of grid."""

    matrices: Float[Array, "groups fours fours"]
    shape: tuple[int, ...] = eqx.field(static=True)

    def apply(self, weights: Weights, dofs: Dofs) -> Dofs:
        """The gradient of E: the symmetric matrix of the form times `dofs`."""

        def chunk(item: tuple[Array, Array]) -> Array:
            weights, cells = item
            products = self._products(cells)
            terms = [products[g] * weights[g][None] for g in range(len(weights))]
            return sum(terms[1:], start=terms[0])

        cells = gather_corners(dofs, self.shape)
        return scatter_corners(self._chunked(chunk, weights, cells), self.shape)

    def densities(self, dofs: Dofs) -> Weights:
        """u(v)^T K_g u(v) for every cell and group."""

        def chunk(item: tuple[Array]) -> Array:
            (cells,) = item
            return jnp.sum(self._products(cells) * cells[None], axis=1)

        return self._chunked(chunk, gather_corners(dofs, self.shape))

    def vertex_blocks(self, weights: Weights) -> Float[Array, "twos twos vertices"]:
        """The diagonal block of every vertex, of the matrix of E."""
        twos = 2 ** len(self.shape)
        corner = np.arange(twos)
        blocks = self.matrices.reshape(-1, twos, twos, twos, twos)[:, corner, :, corner, :]
        table = blocks.reshape(-1, twos * twos)  # corner and group down, block entries across
        shifts, columns = corner_shifts(self.shape), weights.shape[1]
        padded = jnp.pad(weights, ((0, 0), (shifts[-1], 0)))
        shifted = jnp.concatenate(
            [
                jax.lax.slice_in_dim(padded, shifts[-1] - s, shifts[-1] - s + columns, axis=1)
                for s in shifts
            ]
        )
        return jnp.matmul(table.T, shifted, precision="highest").reshape(twos, twos, columns)

    def _products(self, cells: Float[Array, "fours chunk"]) -> Float[Array, "groups fours chunk"]:
        groups, fours, _ = self.matrices.shape
        flat = jnp.matmul(self.matrices.reshape(-1, fours), cells, precision="highest")
        return flat.reshape(groups, fours, -1)

    def _chunked(self, function, *arrays: Array) -> Array:
        """Map a function over chunks of columns of the arrays."""
        columns = arrays[0].shape[1]
        per_column = self.matrices.shape[0] * self.matrices.shape[1] * self.matrices.dtype.itemsize
        parts = -(-columns // max(1, CHUNK_BYTES // per_column))
        size = -(-columns // parts)

        def split(array: Array) -> Array:
            padded = jnp.pad(array, ((0, 0), (0, parts * size - columns)))
            return jnp.moveaxis(padded.reshape(len(array), parts, size), 1, 0)

        results = jax.lax.map(jax.checkpoint(function), tuple(split(array) for array in arrays))
        return jnp.moveaxis(results, 0, 1).reshape(results.shape[1], -1)[:, :columns]


def energy_form(spacing: Float[Array, " ndim"], shape: tuple[int, ...]) -> CellForm:
    """`sum_c <f_ac, f_bc>` for a <= b and `sum_a <f_a, f_a>` (tension), physical derivatives."""
    ndim = len(shape)
    matrices = []
    for a, b in derivatives(2, ndim):
        matrix = sum(
            _scaled(gram(_orders((a, c), ndim), _orders((b, c), ndim)), spacing, (a, b, c, c))
            for c in range(ndim)
        )
        matrices.append(matrix if a == b else matrix + matrix.T)
    slopes = [gram(_orders((a,), ndim), _orders((a,), ndim)) for a in range(ndim)]
    matrices.append(sum(_scaled(slope, spacing, (a, a)) for a, slope in enumerate(slopes)))
    return CellForm(jnp.stack(matrices), shape)


def structure_form(spacing: Float[Array, " ndim"], shape: tuple[int, ...]) -> CellForm:
    """`<f_a, f_b>` for a <= b: the structure tensor of every cell."""
    ndim = len(shape)
    matrices = []
    for a, b in derivatives(2, ndim):
        matrix = gram(_orders((a,), ndim), _orders((b,), ndim))
        matrices.append(_scaled((matrix + matrix.T) / 2, spacing, (a, b)))
    return CellForm(jnp.stack(matrices), shape)


def _scaled(matrix: np.ndarray, spacing: Array, axes: tuple[int, ...]) -> Array:
    """A constant matrix in physical units: over the spacing along `axes`."""
    scale = jnp.prod(spacing[jnp.array(axes)])
    return jnp.asarray(matrix, spacing.dtype) / scale


def _orders(axes: tuple[int, ...], ndim: int) -> tuple[int, ...]:
    """The orders along each axis of the partial derivative along `axes`."""
    return tuple(axes.count(axis) for axis in range(ndim))
