"""Averages of a field over boxes, as pixels of a sensor: observations for `fit_samples`."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from . import _check
from ._basis import bernstein, quadrature
from ._extent import check_finite, check_sigma
from ._method import is_traced
from ._misfit import Averages
from ._observe import AbstractObservation


class BoxAverages(AbstractObservation):
    """Averages of the field over a regular grid of boxes, as pixels or voxels of a sensor.

    Box (i, j) reaches from `corner + (i, j) * size` to `corner + (i + 1, j + 1) * size`.  The
    field is integrated exactly.

    Parameters
    ----------
    values : array, shape (m_1, ..., m_d)
        The averages.
    size : float or sequence of ndim floats
        Edges of a box in physical units, of any length.
    corner : float or sequence of ndim floats, or None
        The corner of the first box; where the grid begins by default.
    sigma : float or array, shape (m_1, ..., m_d)
        Standard deviation of the noise.

    Raises
    ------
    ValueError
        For NaN, or a sigma that is not above zero.
    """

    values: ArrayLike
    size: ArrayLike | Sequence[float]
    corner: ArrayLike | Sequence[float] | None = None
    sigma: ArrayLike = 1.0

    def __check_init__(self):
        shape = np.shape(self.values)
        if len(shape) not in _check.DIMENSIONS or 0 in shape:
            raise ValueError(
                f"values of BoxAverages must be 2-D or 3-D averages, got shape {shape}"
            )
        check_finite(self.values, "values of BoxAverages")
        check_sigma(self.sigma, shape, "BoxAverages")

    def prepare(self, extent):
        shape, ndim = np.shape(self.values), extent.ndim
        if len(shape) != ndim:
            raise ValueError(f"values of BoxAverages must have {ndim} axes, got shape {shape}")
        corner = extent.origin if self.corner is None else self.corner
        size = _check.check_per_axis(self.size, ndim, "size", positive=True)
        corner = _check.check_per_axis(corner, ndim, "corner")
        if is_traced(size, corner, extent.spacing, extent.origin):
            raise ValueError(
                "BoxAverages must know where its boxes lie, got a traced size, corner, spacing or "
                "origin; give them as numbers"
            )
        unit, origin = np.asarray(extent.spacing, float), np.asarray(extent.origin, float)
        first = (np.asarray(corner, float) - origin) / unit
        widths = np.asarray(size, float) / unit
        ends = np.asarray(corner, float) + np.asarray(size, float) * np.array([[0] * ndim, shape])
        extent.check_inside(ends, "BoxAverages")
        matrices = []
        for axis, (boxes, samples) in enumerate(zip(shape, extent.shape, strict=True)):
            edges = first[axis] + widths[axis] * np.arange(boxes + 1)
            matrices.append(jnp.asarray(interval_averages(edges, samples), extent.dtype))
        values = jnp.asarray(self.values, extent.dtype)
        sigma = jnp.broadcast_to(jnp.asarray(self.sigma, extent.dtype), shape)
        return Averages(values=values, weights=tuple(matrices), sigma=sigma), shape[0]


def interval_averages(edges: Float[np.ndarray, " m+1"], count: int) -> np.ndarray:
    """Weights of the 3 (count - 1) + 1 Bezier points in the averages over m intervals.

    `edges` are in units of the spacing.  Two Gauss points integrate a cubic exactly.
    """
    cells = np.arange(count - 1)
    low = np.clip(edges[:-1, None] - cells, 0, 1)
    high = np.clip(edges[1:, None] - cells, 0, 1)
    nodes, halves = quadrature(2)
    at = low[..., None] + (high - low)[..., None] * nodes
    share = (high - low) / np.diff(edges)[:, None]
    parts = share[..., None] * np.einsum("mcqk,q->mck", bernstein(3, at), halves)
    weights = np.zeros((len(edges) - 1, 3 * count - 2))
    for k in range(4):
        weights[:, k + 3 * cells] += parts[..., k]
    return weights
