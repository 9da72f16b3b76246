"""Fair upsampling as a layer of a network."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from . import _check
from ._fair import fair_field
from ._local import LocalFairing
from ._method import AbstractFairing


def _hashable(each: Any) -> Any:
    """One for all axes as it is, or one for each as a tuple."""
    return tuple(np.asarray(each).tolist()) if np.ndim(each) else each


class FairUpsample(eqx.Module):
    """Upsample images or volumes by fairing: a layer, differentiable in its input.

    In the place of bilinear upsampling.  The last `ndim` axes are space, all axes before them
    (batch, channels) are upsampled on their own.  It has no parameters, unless real-valued settings
    of the method are given as arrays, which are then learned like any other.

    Parameters
    ----------
    factor : int or tuple of `ndim` ints
        From n to `factor (n - 1) + 1` samples per axis: samples stay, others come between them.
    ndim : int
        Spatial axes, 2 or 3, the last of the input.
    method : AbstractFairing
        `LocalFairing()` by default.
    spacing : float or sequence of `ndim` floats
        Distance between samples along each axis of space: it is part of the energy, so that voxels
        longer than wide are faired as what they are.  Not learned.

    Raises
    ------
    ValueError
        For a factor below 1, another ndim, a spacing that is not above zero, or (when called) fewer
        than 3 samples per axis.

    Notes
    -----
    A module of Equinox: it takes its place in `eqx.nn.Sequential`.  In Flax, whose arrays have
    channels last, call it between `jnp.moveaxis(x, -1, 1)` and its inverse.  Each shape of input is
    compiled once.  Input of less than 32 bits is computed and returned in float32.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> layer = cf.FairUpsample(4)
    >>> layer(jnp.zeros((8, 3, 16, 12))).shape
    (8, 3, 61, 45)
    """

    factor: int | tuple[int, ...] = eqx.field(static=True, converter=_hashable)
    ndim: int = eqx.field(static=True, default=2)
    method: AbstractFairing = eqx.field(default_factory=LocalFairing)
    spacing: float | tuple[float, ...] = eqx.field(static=True, default=1.0, converter=_hashable)

    def __check_init__(self):
        _check.check_choice(self.ndim, _check.DIMENSIONS, "ndim")
        _check.check_factors(self.factor, self.ndim)
        _check.check_per_axis(self.spacing, self.ndim, "spacing", positive=True)
        if not isinstance(self.method, AbstractFairing):
            raise ValueError(
                f"method must be an object such as LocalFairing(), got {self.method!r}"
            )

    def __call__(
        self, x: Float[ArrayLike, "..."], *, key: Array | None = None
    ) -> Float[Array, "..."]:
        """Upsample the last axes of `x`; `key` is not used, `eqx.nn.Sequential` passes one."""
        shape = jnp.shape(x)
        if len(shape) < self.ndim:
            raise ValueError(f"x must have at least {self.ndim} axes, got shape {shape}")
        return _upsampled(self, jnp.asarray(x))


@eqx.filter_jit
def _upsampled(layer: FairUpsample, x: Array) -> Array:
    batch, shape = x.shape[: -layer.ndim], x.shape[-layer.ndim :]

    def refine(values: Array) -> Array:
        return fair_field(values, spacing=layer.spacing, method=layer.method).refine(layer.factor)

    fine = jax.vmap(refine)(x.reshape(-1, *shape))
    return fine.reshape(*batch, *fine.shape[1:])
