"""Removing overshoot: slopes scaled until every cell stays within its own samples."""

import itertools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def limit_slopes(
    dofs: Float[Array, "twos vertices"], shape: tuple[int, ...]
) -> Float[Array, "twos vertices"]:
    """Scale the slopes of every vertex, all by one factor in [0, 1], so that nothing overshoots.

    A cell lies within its Bezier points, and each of these is the value of the nearest vertex plus
    thirds of its slopes.  The factor of a vertex is the largest that keeps all its points between
    the smallest and the largest sample of every cell they belong to.  Values and C1 are kept.
    """
    ndim = len(shape)
    grid = dofs.reshape(2**ndim, *shape)
    value = grid[0]
    lower, upper = _cell_ranges(value, jnp.minimum), _cell_ranges(value, jnp.maximum)
    factor = jnp.ones_like(value)
    for offset in itertools.product((-1, 0, 1), repeat=ndim):
        if not any(offset):
            continue
        rise = sum(
            float(np.prod([offset[k] / 3 for k in range(ndim) if part[k]])) * grid[number]
            for number, part in enumerate(itertools.product((0, 1), repeat=ndim))
            if any(part)
        )
        low = _over_cells(lower, offset, jnp.maximum, -jnp.inf)
        high = _over_cells(upper, offset, jnp.minimum, jnp.inf)
        room = jnp.where(rise > 0, high - value, value - low)
        size = jnp.abs(rise)
        fits = size <= room
        factor = jnp.minimum(factor, jnp.where(fits, 1, room / jnp.where(fits, 1, size)))
    return jnp.concatenate([dofs[:1], dofs[1:] * factor.reshape(1, -1)])


def _cell_ranges(values: Float[Array, "*shape"], reduce) -> Float[Array, "*cells"]:
    """Smallest or largest sample of every cell."""
    for axis in range(values.ndim):
        size = values.shape[axis]
        values = reduce(
            jnp.take(values, np.arange(size - 1), axis=axis),
            jnp.take(values, np.arange(1, size), axis=axis),
        )
    return values


def _over_cells(
    cells: Float[Array, "*cells"], offset: tuple[int, ...], reduce, neutral: float
) -> Float[Array, "*shape"]:
    """Reduce over the cells that a Bezier point at `offset` from its vertex belongs to."""
    padded = jnp.pad(cells, 1, constant_values=neutral)
    for axis, side in enumerate(offset):
        size = padded.shape[axis]
        below, above = np.arange(size - 1), np.arange(1, size)
        if side:
            padded = jnp.take(padded, below if side < 0 else above, axis=axis)
        else:
            padded = reduce(jnp.take(padded, below, axis=axis), jnp.take(padded, above, axis=axis))
    return padded
