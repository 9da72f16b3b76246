"""Constants of the local energy: product functions and products of two, at the quadrature points.

Made by a few large operations, each on its own: what XLA would fuse into every table that is cut
out of them, it would compile once for each.
"""

from functools import partial

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._basis import block_of, index_set, quadrature
from ._bezier import derivatives
from ._xla import apart


def block_entries(ndim: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the entries of the fairing matrix, by the parities that meet.

    The matrix is symmetric: every pair of functions is there once.

    Returns
    -------
    equal : array of int, shape (2, n)
        Pairs of functions that are even or odd in the same axes.
    others : array of int, shape (2, 2^ndim - 1, m)
        Pairs that differ in the axes where 1, 2, ... has a binary digit 1; the shorter lists repeat
        their last pair.
    """
    block = block_of(index_set(ndim, "fairing"))
    rows, columns = np.triu_indices(len(block))
    differ = block[rows] ^ block[columns]
    equal, *others = (np.stack([rows, columns])[:, differ == b] for b in range(2**ndim))
    most = max(pairs.shape[1] for pairs in others)
    padded = [np.pad(pairs, ((0, 0), (0, most - pairs.shape[1])), "edge") for pairs in others]
    return equal, np.stack(padded, axis=1)


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
) -> list[Float[Array, "*groups entries pairs_half"]]:
    """sum_c f_ac f_bc of pairs of functions at the points of the upper halves, for a <= b.

    The pairs are those of `block_entries`.
    """
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

    every = products(jnp.moveaxis(hessians, 2, 0)).reshape(size * size, count * half)
    return [
        jnp.take(every, rows * size + columns, axis=0, mode="clip")
        for rows, columns in block_entries(ndim)
    ]


def point_weights(ndim: int, order: int) -> np.ndarray:
    """Weights of all quadrature points."""
    weights = np.ones(1)
    for _ in range(ndim):
        weights = np.multiply.outer(weights, quadrature(order)[1]).ravel()
    return np.tile(weights, 2**ndim)
