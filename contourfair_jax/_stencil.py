"""Cutting a grid of samples into overlapping windows, and a window into vertex neighbourhoods."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


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
