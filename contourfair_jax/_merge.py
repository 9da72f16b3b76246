"""Blending the overlapping local patches into one Bezier control net (section 4.2 of the paper).

Along an axis, net point k belongs to the inner vertex nearest to it, v(k) = clip(round(k/3), 1,
n - 2), and is its local Bezier point k - 3 (v - 1), 0 to 6.  In d dimensions ownership is the
product over the axes.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def net_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Points per axis of the control net of a grid of `shape` samples."""
    return tuple(3 * (n - 1) + 1 for n in shape)


def scatter_patches(
    points: Float[Array, "points vertices"], shape: tuple[int, ...]
) -> Float[Array, "*net"]:
    """Write the Bezier points of all inner vertices of a grid to its control net.

    Parameters
    ----------
    points : array, shape (7^d, vertices)
        Bezier points of the 2^d patches around every inner vertex.
    shape
        Samples per axis of the grid.
    """
    row, column, target = _owned(shape)
    size = np.prod(net_shape(shape))
    net = jnp.zeros(size, points.dtype)
    net = net.at[target].set(points[row, column], unique_indices=True)
    return net.reshape(net_shape(shape))


def place_window(
    net: Float[Array, "*net"],
    window: Float[Array, "*window_net"],
    start: jax.Array,
    shape: tuple[int, ...],
) -> Float[Array, "*net"]:
    """Write the net of one window into the net of the whole grid.

    A window knows its own points between the two samples of its halo; of the rest only those on the
    border of the grid.

    Parameters
    ----------
    start : array of int, shape (ndim,)
        First sample of the window.
    shape
        Samples per axis of the whole grid.
    """
    owned = jnp.ones((1,) * window.ndim, dtype=bool)
    for axis, (points, n) in enumerate(zip(window.shape, shape, strict=True)):
        index = jnp.expand_dims(jnp.arange(points), [k for k in range(window.ndim) if k != axis])
        first = jnp.where(start[axis] == 0, 0, 2)
        last = jnp.where(3 * start[axis] + points == 3 * (n - 1) + 1, points, points - 2)
        owned = owned & (index >= first) & (index < last)
    corner = [3 * start[axis] for axis in range(len(shape))]
    current = jax.lax.dynamic_slice(net, corner, window.shape)
    return jax.lax.dynamic_update_slice(net, jnp.where(owned, window, current), corner)


def _owned(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Local point, vertex and net index (all flat) of every point of the control net."""
    local, vertex = [], []
    for n in shape:
        k = np.arange(3 * (n - 1) + 1)
        v = np.clip((k + 1) // 3, 1, n - 2)
        local.append(k - 3 * (v - 1))
        vertex.append(v - 1)
    row = np.ravel_multi_index(np.meshgrid(*local, indexing="ij"), (7,) * len(shape))
    inner = tuple(n - 2 for n in shape)
    column = np.ravel_multi_index(np.meshgrid(*vertex, indexing="ij"), inner)
    return row.ravel(), column.ravel(), np.arange(row.size)


def set_samples(net: Float[Array, "*net"], values: Float[Array, "*shape"]) -> Float[Array, "*net"]:
    """Put the samples, bit for bit, where the net points are samples."""
    return net.at[(slice(None, None, 3),) * net.ndim].set(values)
