"""Coarse grids for wide holes: a multilevel preconditioner for values that no sample pins.

The C1 spaces on grids of spacing 1, 2, 4, ... are nested, and refining from one to the next is
exact in Hermite form.  A basis function of a coarse grid helps where its whole support is missing;
each of these contributes the residual over its own thin plate energy, summed over all grids
(Bramble, Pasciak and Xu, "Parallel multilevel preconditioners", 1990).
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._support.xla import materialise, matmul
from ..small_systems import invert
from .cell_form import CellForm

# A grid as (2, ..., 2, n_1, ..., n_d): the layout of `_hermite` with the axes apart.
Grid = Float[Array, "*twos_shape"]


def coarse_correction(
    form: CellForm, missing: Bool[Array, "*shape"], residual: Float[Array, "twos vertices"]
) -> Float[Array, "twos vertices"]:
    """Sum over all coarser grids of what their functions within the holes contribute."""
    ndim = len(form.shape)
    inverse = _interior_inverse(form)
    shapes = [form.shape]
    while max(shapes[-1]) >= 5:
        shapes.append(tuple(n // 2 + 1 for n in shapes[-1]))

    def below(level: int, missing: Array, residual: Grid) -> Grid:
        """The correction of all grids coarser than `level`, on that grid."""
        if level + 1 == len(shapes):
            return jnp.zeros_like(residual)
        fine, coarse = shapes[level], shapes[level + 1]
        template = jax.ShapeDtypeStruct((2,) * ndim + coarse, residual.dtype)
        (restricted,) = jax.linear_transpose(lambda x: _prolong(x, fine), template)(residual)
        active = _supports(missing, coarse)
        restricted = materialise(restricted)
        # The energy of a function scales with the spacing to the power ndim - 4.
        scale = 2.0 ** ((4 - ndim) * (level + 1))
        own = matmul(inverse, restricted.reshape(2**ndim, -1)).reshape(restricted.shape) * scale
        own = jnp.where(jnp.expand_dims(active, tuple(range(ndim))), own, 0)
        return _prolong(own + below(level + 1, active, restricted), fine)  # pyright: ignore

    grid = residual.reshape((2,) * ndim + form.shape)
    return below(0, missing, grid).reshape(residual.shape)


def has_wide_holes(missing: np.ndarray) -> bool:
    """Whether any function of a coarse grid lies within what is missing."""
    for axis in range(missing.ndim):
        ends = [(1, 1) if k == axis else (0, 0) for k in range(missing.ndim)]
        padded = np.moveaxis(np.pad(missing, ends, constant_values=True), axis, 0)
        missing = np.moveaxis(padded[:-2] & padded[1:-1] & padded[2:], 0, axis)
    return bool(missing.any())


def _interior_inverse(form: CellForm) -> Float[Array, "twos twos"]:
    """Inverse of the thin plate block of a vertex with cells all around."""
    ndim = len(form.shape)
    twos = 2**ndim
    diagonal = [g for g, (a, b) in enumerate(_pairs(ndim)) if a == b]
    plate = sum(form.matrices[g] for g in diagonal).reshape(twos, twos, twos, twos)  # pyright: ignore
    corner = np.arange(twos)
    block = jnp.sum(plate[corner, :, corner, :], axis=0)
    return invert(block[:, :, None])[:, :, 0]


def _pairs(ndim: int) -> list[tuple[int, int]]:
    return list(itertools.combinations_with_replacement(range(ndim), 2))


def _prolong(grid: Grid, shape: tuple[int, ...]) -> Float[Array, "*twos_fine"]:
    """The same field on the grid of half the spacing, slopes per cell of either grid."""
    ndim = len(shape)
    for axis, size in enumerate(shape):
        place = ndim + axis
        value, slope = jnp.split(grid, 2, axis=axis)
        low, high = (
            [jax.lax.slice_in_dim(x, k, x.shape[place] - 1 + k, axis=place) for x in (value, slope)]
            for k in (0, 1)
        )
        middle = (low[0] + high[0]) / 2 + (low[1] - high[1]) / 8
        steepness = 0.75 * (high[0] - low[0]) - (low[1] + high[1]) / 8
        grid = jnp.concatenate(
            [_weave(value, middle, place, size), _weave(slope / 2, steepness, place, size)],
            axis=axis,
        )
        grid = materialise(grid)
    return grid


def _weave(even: Array, odd: Array, axis: int, size: int) -> Array:
    """Alternate the entries of two arrays along an axis and keep the first `size`."""
    odd = jnp.pad(odd, [(0, 1) if k == axis else (0, 0) for k in range(odd.ndim)])
    both = jnp.stack([even, odd], axis=axis + 1)
    both = both.reshape(*even.shape[:axis], -1, *even.shape[axis + 1 :])
    return jax.lax.slice_in_dim(both, 0, size, axis=axis)


def _supports(missing: Bool[Array, "*fine"], shape: tuple[int, ...]) -> Bool[Array, "*coarse"]:
    """Which coarse functions lie within what is missing: all fine vertices of their support."""
    for axis, size in enumerate(shape):
        padding = [(1, 1) if k == axis else (0, 0) for k in range(missing.ndim)]
        padded = jnp.pad(missing, padding, constant_values=True)
        last = padded.shape[axis] - 1
        parts = [
            jnp.take(padded, np.minimum(2 * np.arange(size) + k, last), axis=axis) for k in range(3)
        ]
        missing = parts[0] & parts[1] & parts[2]
    return missing
