"""Values and derivatives of a Bezier net at many points, in batches that stay in the cache."""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._bezier import cubic_bernstein, derivatives, gather_cells
from ._working_set import working_set
from ._xla import materialise


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
