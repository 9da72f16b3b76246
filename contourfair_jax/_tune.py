"""Settings of global fairing chosen from the samples alone, by cross-validation."""

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from . import _check
from ._global import GlobalFairing


class Candidate(NamedTuple):
    """Settings that are tried."""

    thin_plate_weight: float
    sharpness: int
    tension: float
    smoothness: float
    norm: float
    border_degree: int = 0


# Thin plate (weight 1) is for terrain, its tension for noise; smoothness is for what is analytic;
# small weights are for ridges, with tension along them for jagged edges.  Power 1 of the energy is
# better than 2 on nearly all data.
CANDIDATES = (
    Candidate(1.0, 1, 0.0, 0.0, 1.0),
    Candidate(1.0, 1, 300.0, 0.0, 1.0),
    Candidate(0.3, 1, 20.0, 0.0, 1.0),
    Candidate(0.05, 1, 20.0, 0.0, 1.0),
    Candidate(0.05, 1, 0.0, 0.12, 1.0),
    Candidate(0.01, 2, 0.0, 0.0, 1.0),
    Candidate(0.003, 2, 0.0, 0.0, 1.0),
    Candidate(0.003, 2, 20.0, 0.0, 1.0),
    Candidate(0.001, 2, 1000.0, 0.0, 2.0),
)

# For what is really smooth, recognised by `PROBE`: over the wide gaps of cross-validation, and
# halfway between samples where it looks, more smoothness pays than between all samples, so that its
# error has to be this much smaller than others.
SMOOTH = Candidate(1.0, 1, 0.0, 0.02, 2.0, border_degree=4)
PROBE = SMOOTH._replace(smoothness=0.2, border_degree=0)
HANDICAP = 1.6
COHERENCE = 1.2

# Renewals of the normals while candidates are compared.
ITERATIONS = 2

# Fits that are only compared need not be exact, but their errors have to be below those that are
# compared: on smooth samples 1e-2 is not enough.
TOLERANCE = 1e-3
MAX_STEPS = 200

# Samples at the border, where dropped ones are not surrounded by others.
MARGIN = 3


def tune(
    values: ArrayLike,
    *,
    spacing: ArrayLike | Sequence[float] = 1.0,
    sigma: ArrayLike | None = None,
) -> GlobalFairing:
    """Choose the settings of `GlobalFairing` from the samples alone.

    Drops one colour of a checkerboard of the samples, fits the rest with every candidate setting
    and compares at the dropped samples.  Returns the setting with the smallest mean square error,
    with a small handicap for smoothness.  Deterministic; takes less than ten times as long
    as one fit.

    Parameters
    ----------
    values : array, shape (n_1, n_2) or (n_1, n_2, n_3)
        Samples; NaN is missing.
    spacing : float or sequence of ndim floats
    sigma : float or array, or None
        Noise of the samples, passed on to the method that is returned.

    Returns
    -------
    GlobalFairing

    Raises
    ------
    ValueError
        As `fair_field`; also inside `jax.jit`, and for fewer than 8 samples that are not missing.

    Notes
    -----
    The settings are leaves of the method: `cross_validation_error` is differentiable in them, and
    can be minimised further by gradient.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> x = jnp.linspace(-1.0, 1.0, 10)
    >>> ridge = jnp.exp(-((4.5 * (x[:, None] - 0.8 * x[None, :])) ** 2))
    >>> cf.tune(ridge).sharpness
    2
    """
    values = _check.check_samples(values)
    spacing = _check.check_per_axis(spacing, values.ndim, values.dtype, "spacing", positive=True)
    if isinstance(values, Tracer):
        raise ValueError("values must be known to choose settings; call tune outside jax.jit")
    known = ~jnp.isnan(values)
    if int(jnp.sum(known)) < 8:
        raise ValueError("values must hold at least 8 samples that are not NaN to be tuned on")
    # One colour ranks the settings as well as both do, for half the price.
    odd = int(jnp.sum(known & _colours(values.shape).astype(bool)))
    dropped = (int(4 * odd >= int(jnp.sum(known))),)
    everywhere, inside = np.empty((2, len(CANDIDATES)))
    for sharpness in sorted({each.sharpness for each in CANDIDATES}):
        rows = [k for k, each in enumerate(CANDIDATES) if each.sharpness == sharpness]
        group = [CANDIDATES[k] for k in rows]
        everywhere[rows], inside[rows] = _errors(values, spacing, group, dropped)
    # What is smooth over the wide gaps of cross-validation need not be over the gaps between
    # all samples: smoothness s has to lower the error by more than s of it.
    best = int(np.argmin(everywhere * [1 + each.smoothness for each in CANDIDATES]))
    _, (probe,) = _errors(values, spacing, [PROBE], dropped)
    chosen = SMOOTH if HANDICAP * probe < inside[best] else CANDIDATES[best]
    return GlobalFairing(**chosen._asdict(), coherence=COHERENCE, sigma=sigma)  # pyright: ignore


def cross_validation_error(
    method: GlobalFairing,
    values: Float[Array, "*shape"],
    spacing: Float[Array, " ndim"],
    colours: tuple[int, ...] = (0, 1),
) -> Float[Array, ""]:
    """Mean square error at the samples of either colour when the method is given the other.

    Parameters
    ----------
    method : GlobalFairing
        Differentiable in its real-valued settings.
    values : array, shape (n_1, ..., n_d)
        Samples; NaN is missing.
    spacing : array, shape (ndim,)
    colours : tuple of int
        Colours that are dropped, one after the other.
    """
    return _mean(*_held_back(method, values, spacing, colours))


def _held_back(
    method: GlobalFairing, values: Array, spacing: Array, colours: tuple[int, ...]
) -> tuple[Float[Array, "colours *shape"], Bool[Array, "colours *shape"]]:
    """Squares of the errors at the samples of each colour, and where there are any."""
    colour = _colours(values.shape)
    known = ~jnp.isnan(values)

    def squares(dropped: Array) -> tuple[Array, Array]:
        judged = known & (colour == dropped)
        net, _ = method.fit(jnp.where(colour == dropped, jnp.nan, values), spacing)
        difference = net[(slice(None, None, 3),) * values.ndim] - jnp.where(known, values, 0)
        return jnp.where(judged, difference, 0) ** 2, judged

    return jax.lax.map(squares, jnp.asarray(colours))


def _mean(squares: Array, judged: Array) -> Float[Array, ""]:
    """Mean over what is judged."""
    count = jnp.maximum(jnp.sum(judged, dtype=squares.dtype), 1)
    return jnp.sum(jnp.where(judged, squares, 0)) / count


def _colours(shape: tuple[int, ...]) -> Int[Array, "*shape"]:
    """The checkerboard: 0 and 1."""
    return jnp.asarray(np.indices(shape).sum(axis=0) % 2)


def _inside(shape: tuple[int, ...]) -> Bool[Array, "*shape"]:
    """Samples away from the border."""
    inside = np.ones(shape, bool)
    for axis, count in enumerate(shape):
        margin = min(MARGIN, count // 8)
        place = np.arange(count).reshape([-1 if k == axis else 1 for k in range(len(shape))])
        inside &= (place >= margin) & (place < count - margin)
    return jnp.asarray(inside)


def _errors(
    values: Array, spacing: Array, candidates: Sequence[Candidate], colours: tuple[int, ...]
) -> tuple[Float[Array, " candidates"], Float[Array, " candidates"]]:
    """Errors of candidates of one sharpness, everywhere and inside."""
    settings = [(each.thin_plate_weight, *each[2:5]) for each in candidates]
    # Without normals and powers of the energy the first fit is the last, and can be more exact.
    plain = all(each.thin_plate_weight == 1 and each.norm == 2 for each in candidates)
    method = GlobalFairing(
        coherence=COHERENCE,
        sharpness=candidates[0].sharpness,
        iterations=0 if plain else ITERATIONS,
        tolerance=TOLERANCE / 10 if plain else TOLERANCE,
        max_steps=MAX_STEPS,
    )
    return _errors_of(method, values, spacing, jnp.asarray(settings, values.dtype), colours)


@partial(jax.jit, static_argnames="colours")
def _errors_of(
    method: GlobalFairing,
    values: Array,
    spacing: Array,
    settings: Float[Array, "candidates four"],
    colours: tuple[int, ...],
) -> tuple[Float[Array, " candidates"], Float[Array, " candidates"]]:
    """Errors of the method with other settings, one after the other in one program."""

    def error(setting: Array) -> tuple[Array, Array]:
        weight, tension, smoothness, norm = setting
        tried = dataclasses.replace(
            method, thin_plate_weight=weight, tension=tension, smoothness=smoothness, norm=norm
        )
        squares, judged = _held_back(tried, values, spacing, colours)
        return _mean(squares, judged), _mean(squares, judged & _inside(values.shape)[None])

    return jax.lax.map(error, settings)
