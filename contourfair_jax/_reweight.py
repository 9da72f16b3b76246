r"""Powers of the energy density, by weights of the cells that are renewed like the normals.

`sum_cells e^(p/2)` of the energies e of the cells is minimal where `sum_cells c e` is, with
`c = e^(p/2 - 1)` held fixed: iteratively reweighted least squares.  Below p = 2 a cell across which
the field really bends counts less, so that it does not make the field swing beside it.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._energy import FLAT
from ._form import CellForm, Dofs, Weights
from ._hermite import cells_to_rows, rows_to_cells
from ._method import is_traced

# Energies far below this part of the mean count as equally small.
FLOOR = 0.01


class Powers(NamedTuple):
    """What makes an iteration other than thin plate, which the first one is."""

    thin_plate_weight: Float[Array, "..."]
    norm: Float[Array, "..."]

    def unless(self, first: Bool[Array, "..."]) -> "Powers":
        """Those of thin plate where `first` is true."""
        return Powers(*(jnp.where(first, p, q) for p, q in zip((1, 2), self, strict=True)))


def weighs_cells(norm: float | Float[Array, ""] | None) -> bool:
    """Whether this power of the energy makes cells count differently; a traced one may."""
    return norm is not None and (is_traced(norm) or float(norm) != 2)


def power_weights(
    energy: CellForm, weights: Weights, dofs: Dofs, norm: float | Float[Array, ""]
) -> Float[Array, "1 vertices"]:
    """`e^(norm/2 - 1)` of every cell, scaled to a mean of 1; 1 everywhere where e is constant."""
    row = jnp.sum(weights * energy.densities(dofs), axis=0, keepdims=True)
    # Rounding can leave energies of flat cells below zero.
    energies = jnp.maximum(rows_to_cells(row, energy.shape), 0)
    relative = energies / (jnp.mean(energies) + FLAT**2) + FLOOR
    powers = relative ** (norm / 2 - 1)
    return cells_to_rows(powers / jnp.mean(powers))
