"""The prior for samples that no data determine, and coordinates that even it out."""

import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._support import checks


class ThinPlate(eqx.Module):
    """Thin plate energy of the samples, with a little tension where wanted.

    With differences `D_a` of the samples along axis a, over the spacing in units of the smallest
    one, and the (geometric) mean sigma of the data::

        weight / sigma^2 * ( sum_ab |D_a D_b v|^2 + tension sum_a |D_a v|^2 ) / 2

    So `weight` is the square of (noise of the data) / (second differences to be expected between
    samples): smaller follows the data, larger smooths.  It does not change with units.

    Parameters
    ----------
    weight : float
        Above zero.
    tension : float
        Against overshoot between dense and sparse data, at least zero; GMT's `surface` with tension
        does the same.

    Raises
    ------
    ValueError
        For a setting outside its limits.
    """

    weight: float | Float[Array | np.ndarray, ""] = 1e-3
    tension: float | Float[Array | np.ndarray, ""] = 0.0

    def __check_init__(self):
        checks.check_real(self.weight, "weight", open_below=True)
        checks.check_real(self.tension, "tension")

    def residuals(
        self, samples: Float[Array, "*shape"], spacing: Float[Array, " ndim"]
    ) -> list[Float[Array, "..."]]:
        """Terms whose squares are summed, without the factor of the weight."""
        steps = spacing / jnp.min(spacing)
        slopes = [jnp.diff(samples, axis=k) / steps[k] for k in range(samples.ndim)]
        parts = [jnp.diff(slope, axis=k) / steps[k] for k, slope in enumerate(slopes)]
        for a, b in itertools.combinations(range(samples.ndim), 2):
            parts.append(np.sqrt(2).item() * jnp.diff(slopes[a], axis=b) / steps[b])
        tension = jnp.asarray(self.tension)
        # Its derivative at zero, which is infinite, is zero here.
        root = jnp.where(tension > 0, jnp.sqrt(jnp.where(tension > 0, tension, 1)), 0)
        return parts + [root.astype(samples.dtype) * slope for slope in slopes]

    def spectrum(self, shape: tuple[int, ...], spacing: Float[Array, " ndim"]) -> Array:
        """Energy of each cosine of `cosines`, all axes; exact but at the border of the grid."""
        total = jnp.zeros(shape, spacing.dtype)
        for axis, ratio in enumerate(spacing / jnp.min(spacing)):
            angles = jnp.arange(shape[axis], dtype=spacing.dtype) * (np.pi / shape[axis])
            along = [-1 if k == axis else 1 for k in range(len(shape))]
            total = total + ((2 - 2 * jnp.cos(angles)) / ratio**2).reshape(along)
        return total * total + jnp.asarray(self.tension, spacing.dtype) * total


class Coordinates(eqx.Module):
    """Unknowns in which data and prior together weigh about alike in all directions.

    Samples are cosines, `v = sum_k scales_k z_k cos_k`.  Evenly spread data of total
    weight W on N samples have the energy `(W / N + weight * spectrum) / 2` in each, whose inverse
    root is the scale.  The condition of the problem then depends on how unevenly the data are
    spread, and not on the size of the grid.
    """

    scales: Float[Array, "*shape"]
    matrices: tuple[Float[Array, "_n _n"], ...]

    def samples(self, z: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Samples at the unknowns."""
        values = self.scales * z
        for matrix in self.matrices:
            values = jnp.tensordot(values, matrix, axes=((0,), (1,)), precision="highest")
        return values

    def unknowns(self, samples: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Unknowns of given samples."""
        values = samples
        for matrix in self.matrices:
            values = jnp.tensordot(values, matrix, axes=((0,), (0,)), precision="highest")
        return values / self.scales


def cosines(count: int) -> np.ndarray:
    """Orthonormal cosines (DCT-II) as columns."""
    rows, columns = np.arange(count) + 0.5, np.arange(count)
    matrix = np.cos(np.pi / count * np.outer(rows, columns)) * np.sqrt(2 / count)
    matrix[:, 0] /= np.sqrt(2)
    return matrix
