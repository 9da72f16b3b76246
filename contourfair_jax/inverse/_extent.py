"""The grid of a fit; checks of data about it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._support.arrays import finest, from_origin, is_traced, rounding

# How far outside the grid a point may lie, in units of the spacing, beside its rounding.
SLACK = 1e-5


class Extent(eqx.Module):
    """The grid that is fitted: its shape, its geometry as exact as it was given, and its dtype."""

    shape: tuple[int, ...] = eqx.field(static=True)
    spacing: Float[Array | np.ndarray, " ndim"]
    origin: Float[Array | np.ndarray, " ndim"]
    dtype: np.dtype = eqx.field(static=True)

    @property
    def ndim(self) -> int:
        """Spatial dimensions."""
        return len(self.shape)

    @property
    def steps(self) -> Float[Array, " ndim"]:
        """The spacing in the dtype of the fit."""
        return jnp.asarray(self.spacing, self.dtype)

    def check_inside(self, points: ArrayLike, kind: str) -> Array | np.ndarray:
        """Points counted from the origin, in the dtype of the fit.

        Of known ones the origin is taken off in float64.

        Raises
        ------
        ValueError
            For another number of coordinates, or points outside the grid (where they are known):
            how many, and where the grid lies.
        """
        shape = np.shape(points)
        if shape[-1] != self.ndim:
            raise ValueError(
                f"points of {kind} must have {self.ndim} coordinates for a grid of shape "
                f"{self.shape}, got shape {shape}"
            )
        if not is_traced(points, self.spacing, self.origin):
            low, step = np.asarray(self.origin, dtype=float), np.asarray(self.spacing, dtype=float)
            known, size = np.asarray(points, dtype=float) - low, step * (np.array(self.shape) - 1)
            slack = SLACK * step + rounding(points) * (abs(low) + size)
            outside = ((known < -slack) | (known > size + slack)).any(axis=-1)
            if outside.any():
                raise ValueError(
                    f"{outside.sum()} of {outside.size} points of {kind} lie outside the grid, "
                    f"which goes from {tuple(low.tolist())} to {tuple((low + size).tolist())}; "
                    "leave them out, or fit a larger grid"
                )
        return from_origin(points, self.origin, self.dtype)

    def absolute(self, points: Float[Array, "n ndim"]) -> Float[Array | np.ndarray, "n ndim"]:
        """Points as they were before `check_inside`; of NumPy, in float64, where they are known."""
        if is_traced(points, self.origin):
            points, origin = finest(points, self.origin)
            return points + origin[None]
        return np.asarray(points, float) + np.asarray(self.origin, float)


def check_finite(array: ArrayLike, name: str) -> None:
    """Raise ValueError for what are no real numbers, and for known ones that are not finite."""
    check_real_kind(array, name)
    if is_traced(array):
        return
    bad = ~np.isfinite(np.asarray(array, dtype=float))
    if bad.any():
        raise ValueError(
            f"{name} must be finite, got {bad.sum()} of {bad.size} that are not; "
            "leave out what was not observed"
        )


def check_real_kind(array: ArrayLike, name: str) -> None:
    """Raise ValueError for what are no real numbers."""
    dtype = array.dtype if isinstance(array, jax.Array) else np.asarray(array).dtype
    if not (jnp.issubdtype(dtype, np.floating) or dtype.kind in "iub"):
        raise ValueError(f"{name} must be real numbers, got {dtype}")


def check_sigma(sigma: ArrayLike, shape: tuple[int, ...], kind: str) -> None:
    """Raise ValueError unless `sigma` is above zero, one number or one for each of the data."""
    if np.shape(sigma) not in ((), shape):
        wanted = "one number" if shape == () else f"one number or of shape {shape}"
        raise ValueError(f"sigma of {kind} must be {wanted}, got shape {np.shape(sigma)}")
    check_real_kind(sigma, f"sigma of {kind}")
    if is_traced(sigma):
        return
    bad = ~(np.asarray(sigma, dtype=float) > 0)
    if bad.any():
        raise ValueError(
            f"sigma of {kind} must be above zero, got {np.asarray(sigma)[bad].flat[0]}; "
            "it is the standard deviation of the noise"
        )
    if np.isinf(np.asarray(sigma, dtype=float)).all():
        raise ValueError(
            f"sigma of {kind} must be finite for some of the data, got only infinity; leave it out"
        )


def padded(array: ArrayLike, dtype: jnp.dtype, fill: float | None = None) -> Array:
    """More rows up to `padded_count`: copies of the last one, or `fill`."""
    values = jnp.asarray(array, dtype)
    rows = padded_count(values.shape[0]) - values.shape[0]
    widths = ((0, rows),) + ((0, 0),) * (values.ndim - 1)
    if fill is None:
        return jnp.pad(values, widths, mode="edge")
    return jnp.pad(values, widths, constant_values=fill)


def padded_count(count: int) -> int:
    """`count` rounded up to a multiple of an eighth of the power of two at or below it, or of 8."""
    unit = max(8, 2 ** (count.bit_length() - 4))
    return -(-count // unit) * unit
