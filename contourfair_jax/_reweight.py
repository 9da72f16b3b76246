r"""Powers of the energy density, by weights of the cells that are renewed like the normals.

`sum_cells e^(p/2)` of the energies e of the cells is minimal where `sum_cells c e` is, with
`c = e^(p/2 - 1)` held fixed: iteratively reweighted least squares.  Below p = 2 a cell across which
the field really bends counts less, so that it does not make the field swing beside it.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ._energy import FLAT

# Energies far below this part of the mean count as equally small.
FLOOR = 0.01


def cell_powers(
    energies: Float[Array, "*cells"], norm: float | Float[Array, ""]
) -> Float[Array, "*cells"]:
    """`e^(norm/2 - 1)` of every cell, scaled to a mean of 1; 1 everywhere where e is constant."""
    # Rounding can leave energies of flat cells below zero.
    energies = jnp.maximum(energies, 0)
    relative = energies / (jnp.mean(energies) + FLAT**2) + FLOOR
    powers = relative ** (norm / 2 - 1)
    return powers / jnp.mean(powers)
