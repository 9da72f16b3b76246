"""The front door: check the arguments, choose the control net, return the field."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array

from . import _check
from ._field import BezierField
from ._local import LocalFairing
from ._method import AbstractFairing, FitReport, is_traced


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
    values = _check.check_samples(values)
    spacing = _check.check_per_axis(spacing, values.ndim, "spacing", positive=True)
    origin = _check.check_per_axis(origin, values.ndim, "origin")
    if method is None:
        method = LocalFairing()
    if not isinstance(method, AbstractFairing):
        raise ValueError(f"method must be an object such as LocalFairing(), got {method!r}")
    method = method.prepare(values)
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
