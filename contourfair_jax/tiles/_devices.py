"""Tiles on several JAX devices: every device holds a part of the samples and a rim of the others'.

A device computes the tiles that begin in its part, one after the other, by the program that all
drivers use.  Parts are whole numbers of tiles, so grids are padded where they do not fill them.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._fair import settings_as_arrays
from .._fairing.default import chosen_method
from .._fairing.method import AbstractFairing
from .._support import checks
from .._support.arrays import is_traced
from ._program import refine_block, tile_method, tiling_of
from ._tiling import Tiling


def refine_sharded(
    values: ArrayLike,
    factor: checks.Factors,
    mesh: Mesh,
    *,
    method: AbstractFairing | None = None,
    spacing: ArrayLike | Sequence[float] = 1.0,
) -> Float[Array, "*fine"]:
    """Fair and refine samples that are spread over the devices of a mesh.

    Global fairing fills missing samples (NaN).  In gaps that reach beyond a tile it is not exact,
    as `contourfair_jax.tiles` tells; as values may be traced, these are not looked for.

    Differentiable in values, spacing and the real-valued settings of the method; may be called in
    `jax.jit`.

    Parameters
    ----------
    values : array, shape (n_1, ..., n_d)
        Samples, 2-D or 3-D.
    factor : int or sequence of ndim ints
        How many times finer, along each axis where they differ.
    mesh : jax.sharding.Mesh
        The first axis of the mesh divides the first axis of the grid, and so on; a mesh may have
        fewer axes than the grid.  Explicit axes, as of `jax.make_mesh`, are taken for automatic
        ones; inside `jax.jit` the values must not be divided along them.
    method : LocalFairing or GlobalFairing
        As for `contourfair_jax.tiles.refine_to`.
    spacing : float or sequence of ndim floats
        Distance of samples along each axis.

    Returns
    -------
    array, shape (factor * (n_1 - 1) + 1, ...)
        Spread over the devices.

    Raises
    ------
    ValueError
        For a mesh of more axes than the grid, or an argument that cannot be used.
    """
    values = checks.check_samples(values)
    steps = checks.check_per_axis(spacing, values.ndim, "spacing", positive=True)
    factors = checks.check_factors(factor, values.ndim)
    if len(mesh.axis_names) > values.ndim:
        raise ValueError(
            f"mesh must have at most {values.ndim} axes for these values, got {mesh.axis_names}"
        )
    mesh, values = _automatic(mesh, values)
    method = chosen_method(method)
    tiling = tiling_of(method, values.shape, factors)
    method = settings_as_arrays(tile_method(method.prepare(values)), values.dtype)
    return _refine(tiling, mesh, method, values, jnp.asarray(steps, values.dtype))


def _automatic(mesh: Mesh, values: Array) -> tuple[Mesh, Array]:
    """The mesh, and what is divided along its axes, with axes that JAX divides as it likes.

    Those of `jax.make_mesh` are explicit, and go into the types of arrays.
    """
    automatic = Mesh(mesh.devices, mesh.axis_names)
    if not is_traced(values) and values.sharding.device_set == set(mesh.devices.flat):
        spec = getattr(values.sharding, "spec", PartitionSpec())
        values = jax.device_put(values, NamedSharding(automatic, spec))
    return automatic, values


class _Part(NamedTuple):
    """The part of an axis that one device holds.

    Parameters
    ----------
    name
        Axis of the mesh, or None where the axis of the grid is not divided.
    devices
        Number of parts.
    tiles
        Tiles in each part.
    size
        Samples in each part.
    below, above
        Samples that are needed of the parts on both sides.
    """

    name: str | None
    devices: int
    tiles: int
    size: int
    below: int
    above: int


def _parts(tiling: Tiling, mesh: Mesh) -> list[_Part]:
    """The division of every axis; the last sample belongs to a tile too, if need be of its own."""
    names = [*mesh.axis_names, *[None] * len(tiling.shape)]
    parts = []
    for name, n in zip(names, tiling.shape, strict=False):
        devices = 1 if name is None else mesh.shape[name]
        tiles = -(-n // (tiling.cells * devices))
        rim = tiling.cells + 2 * tiling.halo
        parts.append(_Part(name, devices, tiles, tiles * tiling.cells, rim, 2 * tiling.halo + 1))
    return parts


@eqx.filter_jit
def _refine(
    tiling: Tiling, mesh: Mesh, method: AbstractFairing, values: Array, spacing: Array
) -> Array:
    parts = _parts(tiling, mesh)
    padding = [(0, p.devices * p.size - n) for p, n in zip(parts, tiling.shape, strict=True)]
    divided = PartitionSpec(*(part.name for part in parts))
    leaves, fixed = eqx.partition(method, eqx.is_array)

    def of_device(samples: Array, leaves: AbstractFairing, spacing: Array) -> Array:
        return _of_device(tiling, parts, eqx.combine(leaves, fixed), samples, spacing)

    spread = jax.shard_map(
        of_device,
        mesh=mesh,
        in_specs=(divided, PartitionSpec(), PartitionSpec()),
        out_specs=divided,
        check_vma=False,  # the scans inside start from constants
    )
    fine = spread(jnp.pad(values, padding, mode="edge"), leaves, spacing)
    return fine[tuple(slice(n) for n in tiling.fine_shape)]


def _of_device(
    tiling: Tiling, parts: list[_Part], method: AbstractFairing, samples: Array, spacing: Array
) -> Float[Array, "*fine_part"]:
    """The refined samples of a part: those of all its tiles."""
    firsts = [
        0 if part.name is None else jax.lax.axis_index(part.name) * part.size for part in parts
    ]
    for axis, part in enumerate(parts):
        samples = _with_rim(samples, axis, part)
    own = tiling.own

    def one(position: Array) -> Array:
        corners = [_corners(tiling, axis, firsts[axis], position[axis]) for axis in range(len(own))]
        starts, offsets, shifts = zip(*corners, strict=True)
        at = [s - f + part.below for s, f, part in zip(starts, firsts, parts, strict=True)]
        block = jax.lax.dynamic_slice(samples, at, tiling.block)
        fine, _ = refine_block(
            method, block, spacing, jnp.stack(offsets), tiling.window, tiling.factors
        )
        # The window of a last tile may end before the tile does.
        padded = jnp.pad(fine, [(0, size) for size in own])
        return jax.lax.dynamic_slice(padded, shifts, own)

    counts = [part.tiles for part in parts]
    positions = np.array(list(itertools.product(*map(range, counts))), np.int32)
    tiles = jax.lax.map(one, jnp.asarray(positions))
    ndim = len(own)
    tiles = tiles.reshape(*counts, *own)
    order = itertools.chain(*zip(range(ndim), range(ndim, 2 * ndim), strict=True))
    fine = tuple(count * size for count, size in zip(counts, own, strict=True))
    return tiles.transpose(*order).reshape(fine)


def _corners(tiling: Tiling, axis: int, first: Array | int, position: Array) -> tuple:
    """`Tiling._along` for a traced position: start of the block, offset and shift of the window."""
    n, block, window = tiling.shape[axis], tiling.block[axis], tiling.window[axis]
    cell = first + position * tiling.cells
    start = jnp.clip(cell - tiling.halo, 0, n - block)
    low = jnp.minimum(cell, n - 1 - window)
    return start, low - start, tiling.factors[axis] * (cell - low)


def _with_rim(samples: Array, axis: int, part: _Part) -> Array:
    """The samples of a part with those beside it, zeros beyond the ends of the grid."""
    return jnp.concatenate(
        [
            _beside(samples, axis, part, part.below, 1),
            samples,
            _beside(samples, axis, part, part.above, -1),
        ],
        axis=axis,
    )


def _beside(samples: Array, axis: int, part: _Part, count: int, step: int) -> Array:
    """The `count` samples before (`step` 1) or behind (-1) the part."""
    pieces = []
    for hop in range(1, math.ceil(count / part.size) + 1):
        taken = min(part.size, count - (hop - 1) * part.size)
        kept = slice(part.size - taken, None) if step > 0 else slice(taken)
        piece = samples[(slice(None),) * axis + (kept,)]
        pairs = [
            (device, device + step * hop)
            for device in range(part.devices)
            if 0 <= device + step * hop < part.devices
        ]
        if pairs:
            pieces.append(jax.lax.ppermute(piece, part.name, pairs))
        else:
            pieces.append(jnp.zeros_like(piece))
    return jnp.concatenate(pieces[::-1] if step > 0 else pieces, axis=axis)
