"""Samples continued beyond the border of the grid by polynomials.

The energy is free at a border, which leaves the field straight across it: its error there is of
second order in the spacing, while it is of fourth order inside.  Samples continued by polynomials
of higher degree make up for that; on noise they swing.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

# Samples on either side.  What the free border leaves falls by a factor of about 4 with each.
LAYERS = 2
# Polynomials of higher degree swing too much.
LARGEST_DEGREE = 5
# Continued samples that noise moves by more than this part of their range tell nothing.
LOUDEST = 0.1


class Continued(NamedTuple):
    """Samples with `LAYERS` more at either end of every axis."""

    values: Float[Array, "*wide"]
    sigma: Float[Array, "*wide"]


def continue_samples(
    values: Float[Array, "*shape"], sigma: Float[Array, "*shape"], degree: int
) -> Continued:
    """Samples on a wider grid, axis by axis from the nearest `degree + 1` samples of each line.

    Lines with fewer samples near the border are not continued: NaN.  Sigma is the standard
    deviation of the polynomials, for independent noise; where it is large, NaN too.
    """
    known = jax.lax.stop_gradient(values)
    spread = jnp.nanmax(known) - jnp.nanmin(known)
    unit = jnp.where(spread > 0, spread, 1)
    variances = (sigma / unit) ** 2
    for axis in range(values.ndim):
        values, variances = (jnp.moveaxis(array, axis, 0) for array in (values, variances))
        low, high = (_beyond(values[::step], variances[::step], degree) for step in (1, -1))
        values, variances = (
            jnp.moveaxis(jnp.concatenate([before[::-1], array, after]), 0, axis)
            for before, array, after in zip(low, (values, variances), high, strict=True)
        )
    inside = jnp.zeros(values.shape, bool).at[(slice(LAYERS, -LAYERS),) * values.ndim].set(True)
    quiet = variances <= jnp.where(spread > 0, LOUDEST**2, 0)
    return Continued(jnp.where(inside | quiet, values, jnp.nan), jnp.sqrt(variances) * unit)


def _beyond(
    values: Float[Array, "n *others"], variances: Float[Array, "n *others"], degree: int
) -> tuple[Float[Array, "layers *others"], Float[Array, "layers *others"]]:
    """The samples beyond the first one, the nearest first."""
    degree = min(degree, len(values) - 1)
    # Every other sample may be missing, as in cross-validation.
    reach = min(2 * (degree + 1), len(values))
    values, variances = values[:reach], variances[:reach]
    known = ~jnp.isnan(values)
    used = known & (jnp.cumsum(known, axis=0) <= degree + 1)
    enough = jnp.sum(used, axis=0) > degree
    values, variances = (jnp.where(used, array, 0) for array in (values, variances))
    beyond, uncertain = [], []
    for place in range(-1, -LAYERS - 1, -1):
        weights = _lagrange(used, place, values.dtype)
        beyond.append(jnp.where(enough, jnp.sum(weights * values, axis=0), jnp.nan))
        uncertain.append(jnp.sum(weights**2 * variances, axis=0))
    return jnp.stack(beyond), jnp.stack(uncertain)


def _lagrange(
    used: Bool[Array, "reach *others"], place: int, dtype: np.dtype
) -> Float[Array, "reach *others"]:
    """Weights of the samples 0, 1, ... in the polynomial through those that are used."""
    at = np.arange(len(used), dtype=float)
    with np.errstate(divide="ignore"):
        ratios = (place - at) / (at[:, None] - at)
    np.fill_diagonal(ratios, 1)
    ratios = jnp.asarray(ratios, dtype).reshape(*ratios.shape, *[1] * (used.ndim - 1))
    return jnp.where(used, jnp.prod(jnp.where(used[None], ratios, 1), axis=1), 0)
