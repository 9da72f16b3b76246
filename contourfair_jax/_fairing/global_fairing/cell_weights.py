"""Weights of cells: tensors of their normals, and powers of their energies.

The structure tensor of a cell is `J = integral of g g^T`, with part of `h^2 H H^T` if wanted (the
boundary tensor of Koethe 2003).  Smoothed over cells with a Gaussian, its power
`N = J^p / tr(J^p)` is n n^T where neighbouring level sets agree on their normal n, and I / d at
corners, blobs and flat places.  No eigenvectors, so it has derivatives everywhere.

`sum_cells e^(p/2)` of the energies e of the cells is minimal where `sum_cells c e` is, with
`c = e^(p/2 - 1)` held fixed: iteratively reweighted least squares.  Below p = 2 a cell across which
the field really bends counts less, so that it does not make the field swing beside it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._support.arrays import is_traced
from ..._support.xla import apart, materialise
from ..method import FLAT
from .cell_form import CellForm, Dofs, Weights
from .hermite import cells_to_rows, rows_to_cells

# Cells that the Gaussian reaches to each side, and the largest width it is cut off well for.
REACH = 6
LARGEST_COHERENCE = 2.5
# A symmetric tensor in every cell, entries a <= b.
CellTensor = dict[tuple[int, int], Float[Array, "*cells"]]


def normal_weights(
    structure: CellForm,
    dofs: Dofs,
    thin_plate_weight: float | Float[Array | np.ndarray, ""],
    coherence: float | Float[Array | np.ndarray, ""],
    sharpness: int,
) -> Weights:
    """`M_ab = delta_ab - (1 - w) N_ab` for a <= b of every cell."""
    shape = structure.shape
    axes = [(a, b) for a in range(len(shape)) for b in range(a, len(shape))]
    smoothed = smooth(rows_to_cells(structure.densities(dofs), shape), coherence)
    normals = _powers(dict(zip(axes, materialise(smoothed), strict=True)), sharpness)
    tensor = [float(a == b) - (1 - thin_plate_weight) * normals[a, b] for a, b in axes]
    return cells_to_rows(jnp.stack(tensor))


def _powers(smoothed: CellTensor, sharpness: int) -> CellTensor:
    """N of every cell from the averaged structure tensors of a field with spread about 1."""
    ndim = max(smoothed)[0] + 1
    trace = sum(smoothed[axis, axis] for axis in range(ndim)) + FLAT**2
    direction = materialise({axes: entry / trace for axes, entry in smoothed.items()})
    power = direction
    for _ in range(sharpness - 1):
        power = materialise(_multiply(power, direction, ndim))
    total = sum(power[axis, axis] for axis in range(ndim)) + FLAT**2 / trace
    return {axes: entry / total for axes, entry in power.items()}


@apart
def smooth(
    values: Float[Array, "entries *cells"], width: float | Float[Array | np.ndarray, ""]
) -> Float[Array, "entries *cells"]:
    """Gaussian average over cells with standard deviation `width`, mirrored at the border."""
    width = jnp.maximum(jnp.asarray(width, values.dtype), 0.05)
    offsets = jnp.arange(-REACH, REACH + 1, dtype=values.dtype)
    weights = jnp.exp(-0.5 * (offsets / width) ** 2)
    weights = weights / jnp.sum(weights)
    for axis in range(1, values.ndim):
        size = values.shape[axis]
        padding = [(REACH, REACH) if k == axis else (0, 0) for k in range(values.ndim)]
        padded = materialise(jnp.pad(values, padding, mode="symmetric"))
        parts = [
            weights[k] * jax.lax.slice_in_dim(padded, k, k + size, axis=axis)
            for k in range(2 * REACH + 1)
        ]
        values = sum(parts[1:], start=parts[0])
    return values


def _multiply(left: CellTensor, right: CellTensor, ndim: int) -> CellTensor:
    """Product of two symmetric tensors that commute."""
    return {  # pyright: ignore
        (a, b): sum(left[min(a, k), max(a, k)] * right[min(k, b), max(k, b)] for k in range(ndim))
        for a, b in left
    }


# Energies far below this part of the mean count as equally small.
FLOOR = 0.01


class Powers(NamedTuple):
    """What makes an iteration other than thin plate, which the first one is."""

    thin_plate_weight: Float[Array, "..."]
    norm: Float[Array, "..."]

    def unless(self, first: Bool[Array, "..."]) -> "Powers":
        """Those of thin plate where `first` is true."""
        return Powers(*(jnp.where(first, p, q) for p, q in zip((1, 2), self, strict=True)))


def weighs_cells(norm: float | Float[Array | np.ndarray, ""] | None) -> bool:
    """Whether this power of the energy makes cells count differently; a traced one may."""
    return norm is not None and (is_traced(norm) or float(norm) != 2)


def power_weights(
    energy: CellForm, weights: Weights, dofs: Dofs, norm: float | Float[Array | np.ndarray, ""]
) -> Float[Array, "1 vertices"]:
    """`e^(norm/2 - 1)` of every cell, scaled to a mean of 1; 1 everywhere where e is constant."""
    row = jnp.sum(weights * energy.densities(dofs), axis=0, keepdims=True)
    # Rounding can leave energies of flat cells below zero.
    energies = jnp.maximum(rows_to_cells(row, energy.shape), 0)
    relative = energies / (jnp.mean(energies) + FLAT**2) + FLOOR
    powers = relative ** (norm / 2 - 1)
    return cells_to_rows(powers / jnp.mean(powers))
