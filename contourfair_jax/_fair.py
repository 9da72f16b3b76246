"""`fair_field`, which chooses the control net and returns the field, and the same as a layer."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ._fairing.default import chosen_method
from ._fairing.method import AbstractFairing, FitReport
from ._field import BezierField
from ._support import checks
from ._support.arrays import is_traced


def fair_field(
    values: ArrayLike,
    *,
    spacing: ArrayLike | Sequence[float] = 1.0,
    origin: ArrayLike | Sequence[float] = 0.0,
    method: AbstractFairing | None = None,
) -> BezierField:
    """Turn samples on a regular grid into a C1 field with fair contours.

    Minimises the variation of the gradient along all level sets at once, over splines that pass
    through every sample::

        integral tr(H M H),   M = I - (1 - w) n n^T,

    with the Hessian H, the unit normals n of the level sets, and a little thin plate energy w.

    Parameters
    ----------
    values : array, shape (n_1, n_2) or (n_1, n_2, n_3)
        Samples, at least 3 per axis.  float32 and float64 are kept, integers become the default
        float.  `jax.vmap` gives batches.
    spacing : float or sequence of ndim floats
        Distance of samples along each axis; it changes the result where axes differ.
    origin : float or sequence of ndim floats
        Physical position of the first sample.
    method : LocalFairing or GlobalFairing
        How to fair; `LocalFairing()`, the paper's method, by default.

    Returns
    -------
    BezierField
        Differentiable in values, spacing and the real-valued settings of the method.

    Raises
    ------
    ValueError
        For a wrong rank, short axis or dtype, or a spacing that is not above zero.

    Notes
    -----
    Samples that are NaN, infinite or masked are missing: local fairing leaves NaN in the cells
    whose samples one step around include one, at most four per axis for each, and nowhere else;
    global fairing fills them.

    Values are never looked at inside `jax.jit`.  Outside, a method may refuse samples it has no
    answer for and warns where it did not converge.

    References
    ----------
    M. Bertram, "Fairing Scalar Fields by Variational Modeling of Contours".

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> x = jnp.linspace(-1.0, 1.0, 10)
    >>> field = cf.fair_field(jnp.hypot(x[:, None], x[None, :]), spacing=2 / 9, origin=-1.0)
    >>> field.refine(4).shape
    (37, 37)
    """
    values = checks.check_samples(values)
    spacing = checks.check_per_axis(spacing, values.ndim, "spacing", positive=True)
    origin = checks.check_per_axis(origin, values.ndim, "origin")
    method = chosen_method(method).prepare(values)
    settings, steps = settings_as_arrays(method, values.dtype), jnp.asarray(spacing, values.dtype)
    net, report = _fit(settings, values, steps)
    known = jax.lax.stop_gradient(report)
    if not is_traced(*jax.tree.leaves(known)):
        method.warn(known)
    return BezierField(net, spacing, origin, report)


def settings_as_arrays(method: AbstractFairing, dtype: jnp.dtype) -> AbstractFairing:
    """Real-valued settings in the dtype of the samples: traced, so other values do not retrace."""

    def convert(leaf: object) -> object:
        number = isinstance(leaf, int | float) or eqx.is_array_like(leaf)
        return jnp.asarray(leaf, dtype) if number else leaf

    return jax.tree.map(convert, method)


@eqx.filter_jit
def _fit(method: AbstractFairing, values: Array, spacing: Array) -> tuple[Array, FitReport | None]:
    """One compiled program for each method, shape and dtype."""
    return method.fit(values, spacing)


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
    method: AbstractFairing = eqx.field(default=None, converter=chosen_method)
    spacing: float | tuple[float, ...] = eqx.field(static=True, default=1.0, converter=_hashable)

    def __check_init__(self):
        checks.check_choice(self.ndim, checks.DIMENSIONS, "ndim")
        checks.check_factors(self.factor, self.ndim)
        checks.check_per_axis(self.spacing, self.ndim, "spacing", positive=True)

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
