"""Values and derivatives of a net at physical coordinates, in batches that stay in the cache."""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Real

from .._support.arrays import finest, rounding
from .._support.xla import materialise, working_set
from .bernstein import cubic_bernstein, derivatives
from .nets import gather_cells


@eqx.filter_custom_jvp
def jets(
    net: Float[Array, "*net"],
    cells: Int[Array, "n ndim"],
    t: Float[Array, "n ndim"],
    order: int,
) -> list[Float[Array, "n derivatives"]]:
    """Partial derivatives of orders 0 to `order` at coordinates `t` in cells, per unit of `t`."""
    count = len(cells)
    most = max(1, working_set().batch_bytes // (4**net.ndim * net.dtype.itemsize))
    if count <= most:
        return _jets_at_once(net, cells, t, order, _written_out)
    batches = -(-count // most)
    size = -(-count // batches)
    places = tuple(
        jnp.pad(x, ((0, batches * size - count), (0, 0)), mode="edge").reshape(
            batches, size, net.ndim
        )
        for x in (cells, t)
    )

    def evaluate(place: tuple[Array, ...]) -> list[Array]:
        cells, t = place
        return _jets_at_once(net, cells, t, order, _written_out)

    parts = jax.lax.map(evaluate, places)
    return [part.reshape(batches * size, -1)[:count] for part in parts]


@jets.def_jvp
def _jets_jvp(primals: tuple, tangents: tuple) -> tuple:
    net, cells, t, order = primals
    net_dot, _, t_dot, _ = tangents

    # All at once: the derivative of a batch in the net would be a whole net.
    def evaluate(net: Array, t: Array) -> list[Array]:
        return _jets_at_once(net, cells, t, order, _summed)

    return eqx.filter_jvp(evaluate, (net, t), (net_dot, t_dot))


def _jets_at_once(
    net: Float[Array, "*net"],
    cells: Int[Array, "n ndim"],
    t: Float[Array, "n ndim"],
    order: int,
    contract: Callable[[Array, Array], Array],
) -> list[Float[Array, "n derivatives"]]:
    """All are contractions of the same net points, last axis first."""
    ndim = net.ndim
    parts: dict[tuple[int, ...], Array] = {(): gather_cells(net, cells)}
    for axis in reversed(range(ndim)):
        weights = [cubic_bernstein(t[:, axis], k) for k in range(order + 1)]
        parts = {
            (k, *counts): contract(part, weights[k])
            for counts, part in parts.items()
            for k in range(order + 1 - sum(counts))
        }
        parts = materialise(parts)
    return [
        jnp.concatenate(
            [parts[tuple(axes.count(k) for k in range(ndim))] for axes in derivatives(n, ndim)],
            axis=1,
        )
        for n in range(order + 1)
    ]


def _written_out(
    points: Float[Array, "n ..."], weights: Float[Array, "n 4"]
) -> Float[Array, "n m"]:
    """Sums over the last axis, of length 4; XLA does short sums of its own on one core only."""
    points = _fours(points)
    first, *rest = (weights[:, i, None] * points[:, :, i] for i in range(4))
    return sum(rest, start=first)


def _summed(points: Float[Array, "n ..."], weights: Float[Array, "n 4"]) -> Float[Array, "n m"]:
    """The same; its derivative does not put parts of arrays together again."""
    return jnp.sum(_fours(points) * weights[:, None], axis=-1)


def _fours(points: Float[Array, "n ..."]) -> Float[Array, "n m 4"]:
    count, *sizes = points.shape
    return points.reshape(count, math.prod(sizes) // 4, 4)  # of no points too


OUTSIDE = ("nan", "clamp", "extend")


def partials(
    net: Float[Array, "*net"],
    spacing: Float[Array | np.ndarray, " ndim"],
    origin: Float[Array | np.ndarray, " ndim"],
    points: Real[Array | np.ndarray, "*batch ndim"],
    outside: str,
    order: int,
    cells: Int[Array, "*batch ndim"] | None = None,
) -> list[Float[Array, "*batch derivatives"]]:
    """Partial derivatives of orders 0 to `order`.

    In the cells that are given, where they are not negative: on faces they could be others.
    """
    grid, counts, slack = _grid_coordinates(net, spacing, origin, points)
    inside = jnp.all((grid >= -slack) & (grid <= counts + slack), axis=-1, keepdims=True)
    # A NaN within would spoil derivatives of results that do not depend on it.
    nowhere = jnp.any(jnp.isnan(grid), axis=-1, keepdims=True)
    grid = jnp.where(nowhere, 0, grid)
    if outside == "clamp":
        # Not `clip`, which passes on half of a derivative at the limits.
        grid = jnp.where(grid < 0, 0, jnp.where(grid > counts, counts, grid))
    cell = jnp.clip(jnp.floor(jax.lax.stop_gradient(grid)), 0, counts - 1)
    if cells is not None:
        cell = jnp.where(cells < 0, cell, cells.astype(cell.dtype))
    local = cell.astype(jnp.int32), (grid - cell).astype(net.dtype)
    results = jets(net, *(x.reshape(-1, net.ndim) for x in local), order)
    lengths = jnp.asarray(spacing, net.dtype)
    scaled = []
    for n, values in enumerate(results):
        values = values.reshape(*grid.shape[:-1], values.shape[-1])
        values = values * _inverse_lengths(lengths, n, values.shape)
        hidden = ~inside if outside == "nan" else nowhere
        scaled.append(jnp.where(hidden, jnp.nan, values))
    return scaled


def _grid_coordinates(
    net: Array, spacing: Array | np.ndarray, origin: Array | np.ndarray, points: Array | np.ndarray
) -> tuple[Array, Array, Array]:
    """Points in units of the spacing from the first sample, cells, and what rounding may move.

    In float64 on the host where all of it is known there.
    """
    numbers: list[Any] = [points, spacing, origin]
    if any(isinstance(number, jax.Array) for number in numbers):
        numbers = [jnp.broadcast_to(array, points.shape) for array in finest(*numbers)]
    else:
        numbers = [np.asarray(number, np.float64) for number in numbers]
    at, step, first = numbers
    grid, away = jnp.asarray((at - first) / step), jnp.asarray(abs(first / step))
    count = jnp.array([(n - 1) // 3 for n in net.shape], grid.dtype)
    cells = jnp.broadcast_to(count, grid.shape)
    return grid, cells, rounding(points) * (jnp.broadcast_to(away, grid.shape) + cells)


def _inverse_lengths(spacing: Float[Array, " ndim"], order: int, shape: tuple) -> Array:
    """Factors from derivatives per cell to derivatives per length, one for each derivative."""
    inverse = 1 / spacing
    if order == 0:
        factors = jnp.ones((1,), spacing.dtype)
    elif order == 1:
        factors = inverse
    else:
        rows, columns = jnp.triu_indices(len(spacing))
        factors = inverse[rows] * inverse[columns]
    return jnp.broadcast_to(factors, shape)
