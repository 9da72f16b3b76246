"""The local spline space around a vertex: one axis as exact constants, products for the rest.

Five cubic splines `phi_0 .. phi_4` on the knots {0,0,0,0,1,2,2,2,2} span one axis of a vertex
neighbourhood mapped to [0, 2] (section 4.1 and table 1 of the paper).  `phi_0, phi_2, phi_4` are 1
at s = 0, 1, 2 in turn and carry the samples; `phi_1, phi_3` vanish there and are free for fairing.

The energy is assembled in combinations of `phi` that are even or odd about the vertex, s = 1:

    index      0     1             2         3                      4
    function   1     (s - 1)^2     s - 1     phi_1 + phi_3          phi_3 - phi_1
    parity     even  even          odd       even                   odd
    set        samples             samples   fairing                fairing

The first three span the quadratics through the three samples, so that smooth data needs little of
the fairing functions: in float32 nothing cancels, even where spacings differ a lot.  A product of
two functions with different parity integrates to zero against an even weight, so in d dimensions
every table of products falls into 2^d independent blocks.

The constants of the energy are made by a few large operations, each on its own: what XLA would
fuse into every table that is cut out of them, it would compile once for each.
"""

import itertools
from functools import cache, partial

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._bezier.bernstein import bernstein_derivative, derivatives, kronecker, quadrature
from ..._support.xla import apart

# Bezier points b_0 .. b_6 of the two cubic segments from the coefficients c_0 .. c_4 (equation 19).
TO_BEZIER = np.array(
    [
        [1, 0, 0, 0, 0],
        [0, 1, 0, 0, 0],
        [0, 0.25, 1, -0.25, 0],
        [0, 0, 1, 0, 0],
        [0, -0.25, 1, 0.25, 0],
        [0, 0, 0, 1, 0],
        [0, 0, 0, 0, 1],
    ]
)

# Coefficients of phi_0 .. phi_4 from those of the even and odd functions above.
FROM_PARITY = np.array(
    [
        [1, 1, -1, 0, 0],
        [1, 1 / 3, -2 / 3, 1, -1],
        [1, 0, 0, 0, 0],
        [1, 1 / 3, 2 / 3, 1, 1],
        [1, 1, 1, 0, 0],
    ]
)

ODD = np.array([0, 0, 1, 0, 1])
N_SAMPLES = 3
# Coefficients of the quadratic through the three samples of an axis.
SAMPLES_TO_PARITY = np.array([[0, 1, 0], [0.5, -1, 0.5], [-0.5, 0, 0.5]])


@cache
def full_axis(order: int) -> np.ndarray:
    """Even and odd functions and their derivatives at the quadrature points of both halves.

    Returns
    -------
    array, shape (3, 2, 5, order)
        Derivative, half ([1, 2] first), function, point.  The points of [0, 1] are mirrored from
        [1, 2]: there the function of parity p has the value times (-1)^(p + derivative).
    """
    points, _ = quadrature(order)
    segment = (TO_BEZIER @ FROM_PARITY)[3:]
    upper = np.stack([(bernstein_derivative(k, points) @ segment).T for k in range(3)])
    sign = np.where((ODD + np.arange(3)[:, None]) % 2, -1.0, 1.0)
    return np.stack([upper, upper * sign[:, :, None]], axis=1)


@cache
def index_set(ndim: int, kind: str) -> np.ndarray:
    """Multi-indices of the sample or the fairing functions, sorted by parity block.

    Parameters
    ----------
    ndim : int
    kind : {"samples", "fairing"}

    Returns
    -------
    array of int, shape (n, ndim)
        n is 3^d for the samples, 5^d - 3^d for the fairing functions.
    """
    indices = np.array(list(itertools.product(range(5), repeat=ndim)))
    carries_sample = (indices < N_SAMPLES).all(axis=1)
    chosen = indices[carries_sample if kind == "samples" else ~carries_sample]
    return chosen[np.argsort(block_of(chosen), kind="stable")]


def block_of(indices: np.ndarray) -> np.ndarray:
    """Number of the parity block of multi-indices, the axes' parities read as binary digits."""
    ndim = indices.shape[-1]
    return ODD[indices] @ (1 << np.arange(ndim)[::-1])


@cache
def samples_to_parity(ndim: int) -> np.ndarray:
    """Matrix from 3^d samples (first axis slowest) to coefficients of `index_set("samples")`."""
    rows = index_set(ndim, "samples") @ (3 ** np.arange(ndim)[::-1])
    return kronecker(SAMPLES_TO_PARITY, ndim)[rows]


@cache
def parity_to_bezier(ndim: int) -> np.ndarray:
    """Matrix from coefficients (samples, then fairing) to the 7^d Bezier points of the patches."""
    full = kronecker(TO_BEZIER @ FROM_PARITY, ndim)
    order = np.concatenate([index_set(ndim, "samples"), index_set(ndim, "fairing")])
    return full[:, order @ (5 ** np.arange(ndim)[::-1])]


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
