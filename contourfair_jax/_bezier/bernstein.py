"""Bernstein polynomials, their derivatives, quadrature, and Kronecker products."""

import itertools
from functools import cache

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


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


def kronecker(matrix: np.ndarray, ndim: int) -> np.ndarray:
    """The matrix that applies `matrix` along each of `ndim` axes, first axis slowest."""
    product = np.ones((1, 1))
    for _ in range(ndim):
        product = np.kron(product, matrix)
    return product


def cubic_bernstein(t: Float[Array, " *batch"], order: int) -> Float[Array, "*batch 4"]:
    """Derivative of the given order (0, 1, 2) of the four cubic Bernstein polynomials at `t`."""
    u = 1 - t
    if order == 0:
        terms = [u * u * u, 3 * t * u * u, 3 * t * t * u, t * t * t]
    elif order == 1:
        terms = [-3 * u * u, 3 * u * (u - 2 * t), 3 * t * (2 * u - t), 3 * t * t]
    else:
        terms = [6 * u, 6 * (t - 2 * u), 6 * (u - 2 * t), 6 * t]
    return jnp.stack(terms, axis=-1)


def derivatives(order: int, ndim: int) -> list[tuple[int, ...]]:
    """All partial derivatives of an order as sorted tuples of axes."""
    return list(itertools.combinations_with_replacement(range(ndim), order))
