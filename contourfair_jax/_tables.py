"""Constants of the local energy: product functions and products of two, at the quadrature points.

Made by a few large operations, each on its own: what XLA would fuse into every table that is cut
out of them, it would compile once for each.
"""

import itertools
from functools import partial

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._basis import block_of, index_set, quadrature
from ._xla import apart


def derivatives(order: int, ndim: int) -> list[tuple[int, ...]]:
    """The partial derivatives of an order, as sorted tuples of axes."""
    return list(itertools.combinations_with_replacement(range(ndim), order))


def block_pairs(ndim: int) -> list[list[tuple[int, int]]]:
    """The blocks (p, q), p <= q, of the fairing matrix: a list for each product of parities."""
    count = 2**ndim
    return [[(p, p ^ both) for p in range(count) if p <= p ^ both] for both in range(count)]


def block_sizes(kind: str, ndim: int) -> np.ndarray:
    """How many of the sample or fairing functions fall into each parity block."""
    return np.bincount(block_of(index_set(ndim, kind)), minlength=2**ndim)


def function_tables(
    axis: Float[Array, "3 2 5 q"],
    scale: Float[Array, " ndim"],
    indices: np.ndarray,
    partials: list[tuple[int, ...]],
) -> Float[Array, "partials points n"]:
    """Derivatives of product functions at the quadrature points, in physical units."""
    ndim = indices.shape[1]
    orders = np.array([[axes.count(k) for k in range(ndim)] for axes in partials])
    powers = jnp.stack([jnp.ones_like(scale), scale, scale * scale])
    rows = [
        axis[orders[:, k]][:, :, indices[:, k]] * powers[orders[:, k], k, None, None, None]
        for k in range(ndim)
    ]
    letters = [(chr(ord("a") + k), chr(ord("p") + k)) for k in range(ndim)]
    formula = ",".join(f"z{half}n{point}" for half, point in letters)
    formula += "->z" + "".join(half for half, _ in letters) + "".join(p for _, p in letters) + "n"
    tables = apart(partial(jnp.einsum, formula, precision="highest"))(*rows)
    return tables.reshape(len(partials), -1, len(indices))


def product_tables(
    hessians: Float[Array, "pairs half n"], ndim: int
) -> list[Float[Array, "entries pairs_half"]]:
    """sum_c f_ac f_bc of all pairs of functions at the points of the upper halves, for a <= b."""
    count, half, size = hessians.shape
    pairs = derivatives(2, ndim)

    def places(side: int, c: int) -> np.ndarray:
        """Of f_ac, or with side 1 of f_bc, for every pair (a, b)."""
        return np.array([pairs.index(tuple(sorted((axes[side], c)))) for axes in pairs])

    both = [(places(0, c), places(1, c)) for c in range(ndim)]
    # Entries off the diagonal of M count twice.
    twice = np.array([1.0 if a < b else 0.5 for a, b in pairs])

    @apart
    def products(upper: Float[Array, "n pairs half"]) -> Float[Array, "n n pairs half"]:
        terms = [upper[:, None, a] * upper[None, :, b] for a, b in both]
        terms += [upper[:, None, b] * upper[None, :, a] for a, b in both]
        return sum(terms[1:], start=terms[0]) * jnp.asarray(twice, upper.dtype)[None, None, :, None]

    every = products(jnp.moveaxis(hessians, 2, 0)).reshape(size, size, count * half)
    ends = np.concatenate([[0], np.cumsum(block_sizes("fairing", ndim))])

    def block(p: int, q: int) -> Float[Array, "entries pairs_half"]:
        part = every[ends[p] : ends[p + 1], ends[q] : ends[q + 1]]
        return part.reshape(-1, count * half)

    return [jnp.concatenate([block(p, q) for p, q in group]) for group in block_pairs(ndim)]


def point_weights(ndim: int, order: int) -> np.ndarray:
    """Weights of all quadrature points."""
    weights = np.ones(1)
    for _ in range(ndim):
        weights = np.multiply.outer(weights, quadrature(order)[1]).ravel()
    return np.tile(weights, 2**ndim)
