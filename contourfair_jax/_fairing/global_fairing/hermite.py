"""The C1 space in Hermite form, vertices in one row.

A field of the space is given by its value and mixed first derivatives at every vertex: 2^d numbers,
stored as an array of shape (2^d, vertices) with the vertices of the grid in one row, last axis
fastest.  The binary digits of the first index say along which axes the value is differentiated, in
units of value per cell.

Cells are numbered by their lowest vertex, so corner `s` of cell v is vertex v + shift(s), the same
shift everywhere; vertices on an upper border number cells that do not exist.
"""

import itertools
import math
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._bezier.bernstein import bernstein_derivative, quadrature

# Bezier points of a cell from (value, slope) at its lower and upper vertex.
HERMITE_TO_BEZIER = np.array([[1, 0, 0, 0], [1, 1 / 3, 0, 0], [0, 0, 1, -1 / 3], [0, 0, 1, 0]])


def corner_shifts(shape: tuple[int, ...]) -> list[int]:
    """How far the 2^d corners of a cell lie behind its number."""
    strides = [math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
    corners = itertools.product((0, 1), repeat=len(shape))
    return [
        sum(s * stride for s, stride in zip(corner, strides, strict=True)) for corner in corners
    ]


def cells_to_rows(cells: Float[Array, "entries *cells"]) -> Float[Array, "entries vertices"]:
    """Numbers of cells in rows of vertices; zero where there is no cell."""
    return jnp.pad(cells, [(0, 0), *[(0, 1)] * (cells.ndim - 1)]).reshape(len(cells), -1)


def rows_to_cells(
    rows: Float[Array, "entries vertices"], shape: tuple[int, ...]
) -> Float[Array, "entries *cells"]:
    """The opposite of `cells_to_rows`."""
    return rows.reshape(-1, *shape)[(slice(None), *(slice(-1),) * len(shape))]


def gather_corners(
    dofs: Float[Array, "twos vertices"], shape: tuple[int, ...]
) -> Float[Array, "fours vertices"]:
    """Degrees of freedom of every cell: those of its corners, one after the other."""
    shifts = corner_shifts(shape)
    padded = jnp.pad(dofs, ((0, 0), (0, shifts[-1])))
    vertices = dofs.shape[1]
    return jnp.concatenate([jax.lax.slice_in_dim(padded, s, s + vertices, axis=1) for s in shifts])


def scatter_corners(
    cells: Float[Array, "fours vertices"], shape: tuple[int, ...]
) -> Float[Array, "twos vertices"]:
    """Add up at every vertex what its cells hold for it; the transpose of `gather_corners`."""
    shifts = corner_shifts(shape)
    vertices, last = cells.shape[1], shifts[-1]
    padded = jnp.pad(cells, ((0, 0), (last, 0)))
    parts = [
        jax.lax.slice_in_dim(part, last - s, last - s + vertices, axis=1)
        for s, part in zip(shifts, jnp.split(padded, len(shifts)), strict=True)
    ]
    return sum(parts[1:], start=parts[0])


@cache
def gram(left: tuple[int, ...], right: tuple[int, ...]) -> np.ndarray:
    """Integrals over a unit cell of products of partial derivatives of the basis.

    Parameters
    ----------
    left, right
        Order of the derivative along each axis, such as (2, 0) or (1, 1).

    Returns
    -------
    array, shape (4^d, 4^d)
        In the order of `gather_corners`: exact, a Kronecker product of one-dimensional integrals.
    """
    ndim = len(left)
    product = np.ones((1, 1))
    for k, m in zip(left, right, strict=True):
        product = np.kron(product, _gram_axis(k, m))
    # Kronecker order is (end, slope) of each axis; bring all ends before all slopes.
    axes = [2 * k for k in range(ndim)] + [2 * k + 1 for k in range(ndim)]
    split = product.reshape((2,) * (4 * ndim))
    return split.transpose(axes + [2 * ndim + k for k in axes]).reshape(product.shape)


@cache
def _gram_axis(left: int, right: int) -> np.ndarray:
    points, weights = quadrature(4)
    first, second = (
        bernstein_derivative(order, points) @ HERMITE_TO_BEZIER for order in (left, right)
    )
    return (first.T * weights) @ second


def to_net(dofs: Float[Array, "twos vertices"], shape: tuple[int, ...]) -> Float[Array, "*net"]:
    """Bezier net of a field: along each axis the points v - slope / 3, v, v + slope / 3."""
    ndim = len(shape)
    net = dofs.reshape((2,) * ndim + shape)
    for axis in reversed(range(ndim)):
        # Of the leading axes 0 .. axis are left, so this axis of the grid stands at 2 axis + 1.
        value, slope = (jax.lax.index_in_dim(net, k, axis, keepdims=False) for k in (0, 1))
        place = 2 * axis
        triple = jnp.stack([value - slope / 3, value, value + slope / 3], axis=place + 1)
        merged = triple.reshape(*value.shape[:place], -1, *value.shape[place + 1 :])
        net = jax.lax.slice_in_dim(merged, 1, 3 * shape[axis] - 1, axis=place)
    return net
