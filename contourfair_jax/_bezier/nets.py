"""Cubic Bezier nets: where they lie, their shape, refinement and bounds, missing samples."""

import functools
from collections.abc import Callable
from typing import Protocol, TypeVar, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .bernstein import bernstein

Net = TypeVar("Net", Array, np.ndarray)


@runtime_checkable
class PlacedNet(Protocol):
    """A Bezier net and where it lies: all that finding lines, meshes and trees asks of a field.

    Parameters
    ----------
    control_points : array, shape (3 (n_1 - 1) + 1, ..., 3 (n_d - 1) + 1)
    spacing, origin : array, shape (ndim,)
        Distance of samples along each axis, and position of the first one.
    """

    @property
    def control_points(self) -> Float[Array, "*net"]: ...

    @property
    def spacing(self) -> Float[Array | np.ndarray, " ndim"]: ...

    @property
    def origin(self) -> Float[Array | np.ndarray, " ndim"]: ...

    @property
    def ndim(self) -> int:
        """Spatial dimensions, 2 or 3."""
        ...

    @property
    def shape(self) -> tuple[int, ...]:
        """Samples along each axis."""
        ...

    @property
    def samples(self) -> Float[Array, "*shape"]:
        """Every third point of the net along all axes."""
        ...


def gather_cells(
    net: Float[Array, "*net"], cells: Int[Array, "*batch ndim"]
) -> Float[Array, "..."]:
    """The 4^d net points of the given cells."""

    def one(cell: Int[Array, " ndim"]) -> Float[Array, "*fours"]:
        return jax.lax.dynamic_slice(net, list(3 * cell), (4,) * net.ndim)

    for _ in range(cells.ndim - 1):
        one = jax.vmap(one)
    return one(cells)


def is_flat(
    value: Float[Array, "*batch"],
    gradient: Float[Array, "*batch ndim"],
    spacing: Float[Array, " ndim"],
) -> Bool[Array, "*batch"]:
    """True where a gradient is no larger than the rounding of the values that it comes from."""
    largest = jnp.max(jnp.abs(gradient) * jnp.broadcast_to(spacing, gradient.shape), axis=-1)
    return largest <= 8 * jnp.finfo(value.dtype).eps * jnp.abs(value)


def refine_axis(net: Float[Array, "..."], axis: int, factor: int) -> Float[Array, "..."]:
    """Values on the `factor` times finer grid along one axis; samples are copied, not computed."""
    net = jnp.moveaxis(net, axis, 0)
    samples, first, second = net[::3], net[1::3], net[2::3]
    weights = bernstein(3, np.arange(1, factor) / factor)
    rows = [samples[:-1]]
    for w in weights:
        w = [float(x) for x in w]
        rows.append(w[0] * samples[:-1] + w[1] * first + w[2] * second + w[3] * samples[1:])
    inner = jnp.stack(rows, axis=1).reshape(-1, *net.shape[1:])
    return jnp.moveaxis(jnp.concatenate([inner, samples[-1:]]), 0, axis)


def cell_extreme(net: Net, reduce: Callable[[Net, Net], Net]) -> Net:
    """The 4^d net points of every cell reduced to one, by the minimum or maximum of JAX or NumPy.

    NaN spreads.
    """
    for axis in range(net.ndim):
        before = (slice(None),) * axis
        parts = (net[*before, k : k - 3 or None : 3] for k in range(4))
        net = functools.reduce(reduce, parts)
    return net


def without_gaps(
    net: Float[Array, "*net"], missing: Bool[Array, "*n"] | np.ndarray
) -> Float[Array, "*net"]:
    """A control net with NaN in the cells that a missing sample is a corner of, nowhere else.

    Bezier points nearest to a missing sample are NaN: all such cells hold one, and their faces
    between samples that are there keep their values.
    """
    for axis, points in enumerate(net.shape):
        missing = jnp.take(jnp.asarray(missing), (np.arange(points) + 1) // 3, axis=axis)
    return jnp.where(missing, jnp.nan, net)


def net_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Points per axis of the control net of a grid of `shape` samples."""
    return tuple(3 * (n - 1) + 1 for n in shape)


def set_samples(net: Float[Array, "*net"], values: Float[Array, "*shape"]) -> Float[Array, "*net"]:
    """Put the samples, bit for bit, where the net points are samples."""
    return net.at[(slice(None, None, 3),) * net.ndim].set(values)


def cells_with_values(net: np.ndarray) -> np.ndarray:
    """True for the cells of a control net that have finite points only."""
    return np.isfinite(cell_extreme(net, np.minimum)) & np.isfinite(cell_extreme(net, np.maximum))
