r"""The contour-fairness energy around a vertex as a quadratic form, given the normals.

Fairness is the variation of the gradient along the level set, blended with a little thin plate
(equations 12 and 13 of the paper, in any dimension)::

    E(f) = integral tr(H M H),   M = I - (1 - w) N,   N = n n^T,   n = g / |g|,

with the gradient g and the Hessian H of f.  N comes from the previous iterate, so E is quadratic in
the coefficients and every integral is a sum over Gauss points q of M_ab(q) times constants::

    E = sum_q sum_ab M_ab(q) sum_c f_ac(q) f_bc(q).

Tables of those constants depend on the spacing only.  They are kept for half of every axis: the
functions are even or odd about the vertex (`_basis`), so a sum over all points is a sum over the
half with M folded into its even and odd parts (`_mirror`), one table for each parity block.

Functions of one vertex take and return vectors, and are written with slices, sums and products with
constant matrices only: under `jax.vmap` over a trailing axis they stay products of matrices.
"""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Real

from ._basis import block_of, half_axis, index_set, quadrature

# Gradients below this fraction of the neighbourhood's spread count as flat: N fades to zero.
FLAT = 1e-6

# A vector at every quadrature point of half the axes, for each sign (or parity) of the axes.
Halves = list[Float[Array, " points"]]


class LocalEnergy(eqx.Module):
    """Tables of the energy over a vertex neighbourhood [0, 2]^d, for one spacing.

    `spacing` is relative: only its ratios change the minimum.
    """

    gradient_tables: list[Float[Array, "d_points coefficients"]]
    sample_hessians: list[Float[Array, "pairs_points samples"]]
    fairing_hessians: list[Float[Array, "fairing pairs_points"]]
    matrix_tables: list[Float[Array, "entries pairs_points"]]
    weights: Float[Array, " points"]

    def __init__(self, spacing: Float[Array, " ndim"], order: int):
        ndim, dtype = spacing.shape[0], spacing.dtype
        # The barrier keeps XLA from folding the products of constants below at compile time.
        half, scale = jax.lax.optimization_barrier(
            (jnp.asarray(half_axis(order), dtype), 1 / spacing)
        )
        samples, fairing = index_set(ndim, "samples"), index_set(ndim, "fairing")
        everything = [_functions(half, scale, kind, _axes(ndim, 1)) for kind in (samples, fairing)]
        hessians = [_functions(half, scale, kind, _axes(ndim, 2)) for kind in (samples, fairing)]
        blocks = range(2**ndim)
        rows = [[np.flatnonzero(block_of(s) == b) for b in blocks] for s in (samples, fairing)]
        self.gradient_tables = [
            jnp.concatenate([_stack(everything[k], rows[k][b]) for k in (0, 1)], axis=1)
            for b in blocks
        ]
        self.sample_hessians = [_stack(hessians[0], rows[0][b]) for b in blocks]
        self.fairing_hessians = [_stack(hessians[1], rows[1][b]).T for b in blocks]
        self.matrix_tables = [_products(hessians[1], *pairs) for pairs in pair_blocks(ndim)]
        self.weights = jnp.asarray(_product_weights(ndim, order), dtype)

    @property
    def ndim(self) -> int:
        return len(self.matrix_tables).bit_length() - 1

    def gradients(
        self, samples: Float[Array, " samples"], fairing: Float[Array, " fairing"]
    ) -> list[Halves]:
        """Gradient at every quadrature point: one `Halves` for each axis."""
        parts = [[None] * len(self.gradient_tables) for _ in range(self.ndim)]
        coefficients = _split_blocks(samples, fairing, self.ndim)
        for block, (table, pair) in enumerate(
            zip(self.gradient_tables, coefficients, strict=True)
        ):
            values = jnp.split(table @ jnp.concatenate(pair), self.ndim)
            for axes, value in zip(_axes(self.ndim, 1), values, strict=True):
                parts[axes[0]][block ^ _flips(axes, self.ndim)] = value
        return [_mirror(part) for part in parts]

    def normal_equations(
        self, tensor: dict[tuple[int, int], Halves], samples: Float[Array, " samples"]
    ) -> tuple[Float[Array, " entries"], Float[Array, " fairing"]]:
        """Matrix and right-hand side of the minimum over the fairing coefficients.

        Parameters
        ----------
        tensor
            M_ab at the quadrature points, times their weights, for a <= b.
        samples
            Coefficients of the sample functions.

        Returns
        -------
        matrix
            The entries i <= j, in the order of `pair_blocks`.
        rhs
        """
        ndim = self.ndim
        folded = {axes: _mirror(values) for axes, values in tensor.items()}
        entries = [
            table @ jnp.concatenate([folded[axes][b ^ _flips(axes, ndim)] for axes in folded])
            for b, table in enumerate(self.matrix_tables)
        ]
        stress = {axes: _mirror(v) for axes, v in self._stress(tensor, samples).items()}
        forces = [
            table @ jnp.concatenate([stress[axes][b ^ _flips(axes, ndim)] for axes in stress])
            for b, table in enumerate(self.fairing_hessians)
        ]
        return jnp.concatenate(entries), -jnp.concatenate(forces)

    def hessians(self, samples: Float[Array, " samples"]) -> dict[tuple[int, int], Halves]:
        """Hessian of the interpolating part at every quadrature point, for a <= b."""
        ndim = self.ndim
        parts = {axes: [None] * 2**ndim for axes in _axes(ndim, 2)}
        for block, (table, (part, _)) in enumerate(
            zip(self.sample_hessians, _split_blocks(samples, None, ndim), strict=True)
        ):
            for axes, value in zip(parts, jnp.split(table @ part, len(parts)), strict=True):
                parts[axes][block ^ _flips(axes, ndim)] = value
        return {axes: _mirror(part) for axes, part in parts.items()}

    def _stress(
        self, tensor: dict[tuple[int, int], Halves], samples: Float[Array, " samples"]
    ) -> dict[tuple[int, int], Halves]:
        """(M H + H M) / 2 of the interpolating part, off-diagonal entries counted twice."""
        hessian = self.hessians(samples)

        def product(a: int, c: int) -> Halves:
            terms = [
                [m * h for m, h in zip(_entry(tensor, a, b), _entry(hessian, b, c), strict=True)]
                for b in range(self.ndim)
            ]
            return [sum(halves[1:], start=halves[0]) for halves in zip(*terms, strict=True)]

        return {
            (a, c): product(a, a)
            if a == c
            else [x + y for x, y in zip(product(a, c), product(c, a), strict=True)]
            for a, c in tensor
        }


def plain_tensor(energy: LocalEnergy) -> dict[tuple[int, int], Halves]:
    """M = I of the thin plate, times the quadrature weights."""
    zero = jnp.zeros_like(energy.weights)
    return {
        (a, b): [energy.weights if a == b else zero] * 2**energy.ndim
        for a, b in _axes(energy.ndim, 2)
    }


def contour_tensor(
    energy: LocalEnergy, gradients: list[Halves], thin_plate_weight: Real[Array, ""]
) -> dict[tuple[int, int], Halves]:
    """M = I - (1 - w) N with N = g g^T / (|g|^2 + flat^2), times the quadrature weights.

    Where the gradient vanishes, N does too and the energy falls back to thin plate; value and
    derivatives are finite there.
    """
    points = list(zip(*gradients, strict=True))
    shares = [
        energy.weights * (1 - thin_plate_weight) / (sum(g * g for g in point) + FLAT**2)
        for point in points
    ]

    def entry(a: int, b: int) -> Halves:
        products = [share * point[a] * point[b] for share, point in zip(shares, points, strict=True)]
        return [energy.weights - p if a == b else -p for p in products]

    return {(a, b): entry(a, b) for a, b in _axes(energy.ndim, 2)}


def pair_blocks(ndim: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows i and columns j <= i of the fairing matrix, grouped by the parity block of i and j."""
    block = block_of(index_set(ndim, "fairing"))
    i, j = np.tril_indices(len(block))
    together = block[i] ^ block[j]
    return [(i[together == b], j[together == b]) for b in range(2**ndim)]


def _axes(ndim: int, order: int) -> list[tuple[int, ...]]:
    """The derivatives of an order, as sorted tuples of axes."""
    return list(itertools.combinations_with_replacement(range(ndim), order))


def _flips(axes: tuple[int, ...], ndim: int) -> int:
    """The parities that a derivative along `axes` changes, as a block number."""
    flips = 0
    for axis in axes:
        flips ^= 1 << (ndim - 1 - axis)
    return flips


def _functions(
    half: Float[Array, "3 5 q"],
    scale: Float[Array, " ndim"],
    indices: np.ndarray,
    derivatives: list[tuple[int, ...]],
) -> dict[tuple[int, ...], Float[Array, "n points"]]:
    """Derivatives of product functions at the points of half the axes, in physical units."""
    tables = {}
    for axes in derivatives:
        table = jnp.ones((len(indices), 1), half.dtype)
        for axis in range(indices.shape[1]):
            row = half[axes.count(axis)][indices[:, axis]] * scale[axis] ** axes.count(axis)
            table = (table[:, :, None] * row[:, None, :]).reshape(len(indices), -1)
        tables[axes] = table
    return tables


def _stack(tables: dict, rows: np.ndarray) -> Float[Array, "tables_points n"]:
    """The chosen functions of several tables, points of all tables down, functions across."""
    return jnp.concatenate([table[rows] for table in tables.values()], axis=1).T


def _products(hessians: dict, i: np.ndarray, j: np.ndarray) -> Float[Array, "entries pairs_points"]:
    """sum_c f_ac f_bc of function pairs (i, j), both orders of a and b, for a <= b."""

    def product(a: int, b: int) -> Array:
        terms = [
            _entry(hessians, a, c)[i] * _entry(hessians, b, c)[j]
            for c in range(max(hessians)[0] + 1)
        ]
        return sum(terms[1:], start=terms[0])

    return jnp.concatenate(
        [product(a, b) if a == b else product(a, b) + product(b, a) for a, b in hessians], axis=1
    )


def _entry(tensor: dict, a: int, b: int):
    """Entry of a symmetric tensor that is stored for a <= b."""
    return tensor[min(a, b), max(a, b)]


def _split_blocks(samples: Array, fairing: Array | None, ndim: int) -> list[tuple]:
    """Cut coefficient vectors into their parity blocks."""

    def cut(vector: Array | None, kind: str) -> list:
        if vector is None:
            return [None] * 2**ndim
        sizes = np.bincount(block_of(index_set(ndim, kind)), minlength=2**ndim)
        return jnp.split(vector, np.cumsum(sizes)[:-1])

    return list(zip(cut(samples, "samples"), cut(fairing, "fairing"), strict=True))


def _mirror(halves: list) -> Halves:
    """Sums and differences over the two halves of every axis.

    Takes even and odd parts to the values at both halves, and values times weights to the even and
    odd parts that meet even and odd functions.
    """
    if len(halves) == 1:
        return halves
    middle = len(halves) // 2
    plus, minus = _mirror(halves[:middle]), _mirror(halves[middle:])
    return [p + m for p, m in zip(plus, minus, strict=True)] + [
        p - m for p, m in zip(plus, minus, strict=True)
    ]


def _product_weights(ndim: int, order: int) -> np.ndarray:
    """Quadrature weights of the points of half the axes."""
    weights = np.ones(1)
    for _ in range(ndim):
        weights = np.multiply.outer(weights, quadrature(order)[1]).ravel()
    return weights
