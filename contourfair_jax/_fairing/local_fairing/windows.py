"""Samples cut into windows and neighbourhoods; local patches merged into one net (section 4.2).

Along an axis, net point k belongs to the inner vertex nearest to it, v(k) = clip(round(k/3), 1,
n - 2), and is its local Bezier point k - 3 (v - 1), 0 to 6.  In d dimensions ownership is the
product over the axes.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._bezier.nets import net_shape


def window_shape(shape: tuple[int, ...], most: int) -> tuple[int, ...]:
    """Vertices per axis of the windows for a grid of `shape` samples, `most` in all.

    Windows are what the engine streams: everything it holds beside the samples and the control net
    is a multiple of one of them.  They are as equal to a cube as the grid allows and divide every
    axis into nearly equal parts, so that little is computed twice.
    """
    inner = [n - 2 for n in shape]
    sides = list(inner)
    for rank, axis in enumerate(np.argsort(inner)):
        others = math.prod(sides[k] for k in np.argsort(inner)[:rank])
        side = int((most / others) ** (1 / (len(shape) - rank)) + 1e-9)
        parts = -(-inner[axis] // max(1, side))
        sides[axis] = -(-inner[axis] // parts)
    return tuple(sides)


def window_starts(shape: tuple[int, ...], window: tuple[int, ...]) -> np.ndarray:
    """First sample of every window, shape (windows, ndim); the last ones end with the grid."""
    per_axis = [
        np.minimum(np.arange(-(-(n - 2) // w)) * w, n - 2 - w)
        for n, w in zip(shape, window, strict=True)
    ]
    return np.stack(np.meshgrid(*per_axis, indexing="ij"), axis=-1).reshape(-1, len(shape))


def cut_windows(
    values: Float[Array, "*shape"], window: tuple[int, ...]
) -> Float[Array, "windows *window_2"]:
    """Windows of samples with a halo of one vertex on every side."""
    shape, ndim = values.shape, values.ndim
    for axis, w in enumerate(window):
        starts = np.unique(window_starts(shape, window)[:, axis])
        rows = starts[:, None] + np.arange(w + 2)
        values = jnp.take(values, rows, axis=2 * axis)
    order = (*range(0, 2 * ndim, 2), *range(1, 2 * ndim, 2))
    return values.transpose(order).reshape(-1, *(w + 2 for w in window))


def neighbourhoods(window: Float[Array, "*window_2"]) -> Float[Array, "samples vertices"]:
    """The 3^d samples around every inner vertex, first axis slowest, vertices last."""
    # One axis after the other: 3^d shifts at once would be as many copies, each to be compiled.
    near = window[None]
    for axis, n in enumerate(window.shape, start=1):
        shifts = [jax.lax.slice_in_dim(near, k, k + n - 2, axis=axis) for k in range(3)]
        near = jnp.stack(shifts, axis=1).reshape(-1, *shifts[0].shape[1:])
    return near.reshape(len(near), -1)


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
