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
"""

import itertools
from functools import cache

import numpy as np

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


def bernstein(degree: int, t: np.ndarray) -> np.ndarray:
    """Bernstein polynomials at `t`, shape (*t.shape, degree + 1), by their recursion."""
    t = np.asarray(t, dtype=float)
    basis = np.ones((*t.shape, 1))
    for _ in range(degree):
        rise = np.concatenate([np.zeros_like(basis[..., :1]), basis * t[..., None]], axis=-1)
        fall = np.concatenate([basis * (1 - t[..., None]), np.zeros_like(basis[..., :1])], axis=-1)
        basis = rise + fall
    return basis


def bernstein_derivative(order: int, t: np.ndarray) -> np.ndarray:
    """Derivatives of the four cubic Bernstein polynomials at `t`, shape (*t.shape, 4)."""
    differences = np.eye(4)
    for step in range(order):
        differences = (3 - step) * np.diff(differences, axis=0)
    return bernstein(3 - order, t) @ differences


@cache
def quadrature(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre points and weights on [0, 1]."""
    points, weights = np.polynomial.legendre.leggauss(order)
    return (points + 1) / 2, weights / 2


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


def kronecker(matrix: np.ndarray, ndim: int) -> np.ndarray:
    """The matrix that applies `matrix` along each of `ndim` axes, first axis slowest."""
    product = np.ones((1, 1))
    for _ in range(ndim):
        product = np.kron(product, matrix)
    return product


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
