"""Quadratic forms of a field that are sums over cells, given a few weights per cell.

    E(u) = 1/2 sum_v sum_g w_g(v) u(v)^T K_g u(v)

with the 4^d degrees of freedom u(v) of cell v and constant matrices K_g.  For the energy the groups
g are the entries a <= b of the tensor M, for structure tensors those of J.
Cells are worked on in chunks that stay in the cache, each with one product of matrices.
"""

import itertools
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._bezier.bernstein import derivatives
from ..._support.xla import apart, materialise, matmul, working_set
from ..small_systems import invert
from .hermite import corner_shifts, gather_corners, gram, scatter_corners

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
            return self._weighted(weights, cells)

        cells = gather_corners(dofs, self.shape)
        return scatter_corners(self._chunked(chunk, weights, cells), self.shape)

    def apply_in_place(self, weights: Weights, dofs: Dofs) -> Dofs:
        """`apply` with less memory and time, for use where it is not differentiated.

        Goes through the row chunk by chunk.  What a chunk adds to vertices behind it is handed on
        to the next: additions into the whole result would copy it every time.
        """
        shifts, columns, size = corner_shifts(self.shape), dofs.shape[1], self._chunk_size()
        last, padding = shifts[-1], -columns % size
        weights = jnp.pad(weights, ((0, 0), (0, padding)))
        dofs = jnp.pad(dofs, ((0, 0), (0, padding + last)))
        weights, dofs = materialise((weights, dofs))

        def add(over: Array, start: Array) -> tuple[Array, Array]:
            cells = jnp.concatenate([_columns(dofs, start + s, size) for s in shifts])
            forces = self._weighted(_columns(weights, start, size), materialise(cells))
            total = jnp.pad(over, ((0, 0), (0, size)))
            for s, force in zip(shifts, jnp.split(materialise(forces), len(shifts)), strict=True):
                total = total + jnp.pad(force, ((0, 0), (s, last - s)))
            total = materialise(total)
            return total[:, size:], total[:, :size]

        starts = jnp.arange(0, columns, size)
        _, parts = jax.lax.scan(add, jnp.zeros_like(dofs[:, :last]), starts)
        return jnp.moveaxis(parts, 0, 1).reshape(len(dofs), -1)[:, :columns]

    def forces(self, weights: Weights, dofs: Dofs) -> Dofs:
        """`apply`, computed in place; its derivatives are those of `apply`."""
        return _forces(self, weights, dofs)

    def densities(self, dofs: Dofs) -> Weights:
        """u(v)^T K_g u(v) for every cell and group, of a form in which constants do not count."""
        twos = len(dofs)

        def chunk(item: tuple[Array]) -> Array:
            (cells,) = item
            # Without the common value, whose rounding errors outweigh the slopes in flat places.
            cells = cells.at[::twos].add(-cells[:1])
            return jnp.sum(self._products(cells) * cells[None], axis=1)

        return self._chunked(chunk, gather_corners(dofs, self.shape))

    def inverse_blocks(
        self,
        weights: Weights,
        pins: Float[Array, " vertices"],
        free: Bool[Array, "twos vertices"],
    ) -> Float[Array, "twos twos vertices"]:
        """Inverse of every vertex's diagonal block of the matrix, zero where not `free`.

        `pins` is added to the diagonal for the values.
        """
        twos = 2 ** len(self.shape)
        shifts, columns = corner_shifts(self.shape), weights.shape[1]
        corner = np.arange(twos)
        blocks = self.matrices.reshape(-1, twos, twos, twos, twos)[:, corner, :, corner, :]
        table = blocks.reshape(-1, twos * twos).T  # block entries down, corner and group across
        last, size = shifts[-1], self._chunk_size()
        weights = jnp.pad(weights, ((0, 0), (last, -columns % size)))
        free = jnp.pad(free, ((0, 0), (0, -columns % size)))
        pins = jnp.pad(pins, (0, -columns % size))[None]

        def chunk(start: Array) -> Array:
            cells = jnp.concatenate([_columns(weights, start + last - s, size) for s in shifts])
            block = matmul(table, cells).reshape(twos, twos, size)
            block = block.at[0, 0].add(_columns(pins, start, size)[0])
            return _invert_free(block, _columns(free, start, size))

        inverses = jax.lax.map(chunk, jnp.arange(0, columns, size))
        return jnp.moveaxis(inverses, 0, 2).reshape(twos, twos, -1)[:, :, :columns]

    def _weighted(
        self, weights: Float[Array, "groups chunk"], cells: Float[Array, "fours chunk"]
    ) -> Float[Array, "fours chunk"]:
        """sum_g w_g K_g u of every cell."""
        products = self._products(cells)
        terms = [products[g] * weights[g][None] for g in range(len(weights))]
        return sum(terms[1:], start=terms[0])

    def _products(self, cells: Float[Array, "fours chunk"]) -> Float[Array, "groups fours chunk"]:
        groups, fours, _ = self.matrices.shape
        flat = matmul(self.matrices.reshape(-1, fours), cells)
        return flat.reshape(groups, fours, -1)

    def _chunk_size(self) -> int:
        """Cells in a chunk: as many as have products with all matrices that fit the working set."""
        groups, fours, _ = self.matrices.shape
        columns = int(np.prod(self.shape))
        size = columns * groups * fours * self.matrices.dtype.itemsize
        parts = -(-size // working_set().batch_bytes)
        return -(-columns // parts)

    def _chunked(self, function, *arrays: Array) -> Array:
        """Map a function over chunks of columns of the arrays."""
        columns, size = arrays[0].shape[1], self._chunk_size()
        padding = -columns % size

        def split(array: Array) -> Array:
            padded = jnp.pad(array, ((0, 0), (0, padding)))
            return jnp.moveaxis(padded.reshape(len(array), -1, size), 1, 0)

        results = jax.lax.map(jax.checkpoint(function), tuple(split(array) for array in arrays))
        return jnp.moveaxis(results, 0, 1).reshape(results.shape[1], -1)[:, :columns]


@jax.custom_jvp
def _forces(form: CellForm, weights: Weights, dofs: Dofs) -> Dofs:
    return form.apply_in_place(weights, dofs)


@_forces.defjvp
def _(primals: tuple, tangents: tuple) -> tuple[Dofs, Dofs]:
    _, tangent = jax.jvp(CellForm.apply, primals, tangents)
    return _forces(*primals), tangent


def _columns(array: Array, start: Array, size: int) -> Array:
    return jax.lax.dynamic_slice_in_dim(array, start, size, axis=1)


@apart
def _invert_free(
    blocks: Float[Array, "n n chunk"], free: Bool[Array, "n chunk"]
) -> Float[Array, "n n chunk"]:
    """Inverses of symmetric positive definite blocks, restricted to what is free."""
    both = free[:, None] & free[None]
    unit = jnp.eye(len(blocks), dtype=blocks.dtype)[:, :, None]
    # Columns that pad the last chunk have blocks of zeros; they count as not free.
    unit = jnp.broadcast_to(unit, blocks.shape)
    blocks = jax.lax.select(both & (blocks[0, 0] > 0)[None, None], blocks, unit)
    return jax.lax.select(both, invert(blocks), jnp.zeros_like(blocks))


def energy_form(
    spacing: Float[Array, " ndim"],
    shape: tuple[int, ...],
    tension: Float[Array | np.ndarray, ""] | float = 0.0,
    smoothness: Float[Array | np.ndarray, ""] | float = 0.0,
) -> CellForm:
    """Products of derivatives along a <= b, in physical units.

    `sum_c <f_ac, f_bc> + tension <f_a, f_b> + smoothness sum_ce <f_ace, f_bce>`.
    """
    symmetric = _derivative_products((tension, 1.0, smoothness), spacing)
    twice = jnp.asarray([1 + (a < b) for a, b in derivatives(2, len(shape))], spacing.dtype)
    return CellForm(twice[:, None, None] * symmetric, shape)


def structure_form(
    spacing: Float[Array, " ndim"],
    shape: tuple[int, ...],
    hessian_weight: Float[Array | np.ndarray, ""] | float = 0.0,
) -> CellForm:
    """`<f_a, f_b> + hessian_weight sum_c <f_ac, f_bc>` for a <= b: what directs the normals."""
    return CellForm(_derivative_products((1.0, hessian_weight), spacing), shape)


def _derivative_products(
    weights: tuple[Float[Array | np.ndarray, ""] | float, ...], spacing: Float[Array, " ndim"]
) -> Float[Array, "pairs fours fours"]:
    """Symmetric parts of the products of derivatives along a <= b and along further axes.

    `weights[k]` is that of all terms with k further axes.
    """
    matrices, exponents, orders = _unit_products(len(weights), len(spacing))
    matrices, exponents = (jnp.asarray(x, spacing.dtype) for x in (matrices, exponents))
    by_order = jnp.stack([jnp.asarray(weight, spacing.dtype) for weight in weights])
    scales = by_order[orders][None] / jnp.prod(spacing[None, None] ** exponents, axis=-1)
    return jnp.einsum("gt,gtij->gij", scales, matrices, precision="highest")


@cache
def _unit_products(count: int, ndim: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Terms of `_derivative_products` with fewer than `count` further axes, for a spacing of 1.

    Returns
    -------
    matrices : array, shape (pairs, terms, 4^d, 4^d)
    exponents : array of int, shape (pairs, terms, ndim)
        The powers of the spacing of every axis that they are divided by.
    orders : array of int, shape (terms,)
        How many further axes there are.
    """
    further = [axes for order in range(count) for axes in derivatives(order, ndim)]

    def orders(axes: tuple[int, ...]) -> tuple[int, ...]:
        """How often a partial derivative is taken along each axis."""
        return tuple(axes.count(axis) for axis in range(ndim))

    def product(a: int, b: int, c: tuple[int, ...]) -> np.ndarray:
        matrix = gram(orders((a, *c)), orders((b, *c)))
        arrangements = len(set(itertools.permutations(c)))
        return arrangements * (matrix + matrix.T) / 2

    pairs = derivatives(2, ndim)
    matrices = np.array([[product(a, b, c) for c in further] for a, b in pairs])
    exponents = np.array([[orders((a, b, *c, *c)) for c in further] for a, b in pairs])
    # Not int64: JAX keeps how it converted an index, also when `jax_enable_x64` changes.
    return matrices, exponents, np.array([len(c) for c in further], np.int32)
