"""Settings of global fairing chosen from the samples alone, by cross-validation."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
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
    hessian_weight: float = 0.0
    border_degree: int = 0


class Errors(NamedTuple):
    """Mean squares over all samples that are dropped, and over those away from the border."""

    everywhere: float
    inside: float


# Thin plate (weight 1) is for quantised samples, its tension for noise; smoothness is for what is
# analytic; small weights are for ridges, with normals from second derivatives for terrain, with
# tension along the contours for jagged edges.  Power 1 of the energy is better than 2 on nearly all
# data.
WAVES = Candidate(0.05, 1, 0.0, 0.12, 1.0)
JAGGED = Candidate(0.003, 2, 20.0, 0.0, 1.0)
CANDIDATES = (
    Candidate(1.0, 1, 0.0, 0.0, 1.0),
    Candidate(1.0, 1, 300.0, 0.0, 1.0),
    Candidate(0.3, 1, 20.0, 0.0, 1.0),
    Candidate(0.05, 1, 20.0, 0.0, 1.0),
    WAVES,
    Candidate(0.01, 2, 0.0, 0.0, 1.0, hessian_weight=8.0),
    Candidate(0.003, 2, 0.0, 0.0, 1.0),
    JAGGED,
    Candidate(0.001, 2, 1000.0, 0.0, 2.0),
)

# For what is really smooth, recognised by `PROBE`: over the wide gaps of cross-validation, and
# halfway between samples where it looks, more smoothness pays than between all samples, so that its
# error has to be this much smaller than others.
SMOOTH = Candidate(1.0, 1, 0.0, 0.015, 2.0, border_degree=4)
PROBE = SMOOTH._replace(smoothness=0.2, border_degree=0)
HANDICAP = 1.25
COHERENCE = 1.2

# Waves that the samples just resolve look like noise on a checkerboard of them.  Where one of these
# candidates is this much better when only a few samples are dropped, at least so many, the
# checkerboard was too coarse.
WITNESSES = (WAVES, JAGGED)
FOOLED = 1.4
FEWEST = 8

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
    with a small handicap for smoothness.  Where dropping only one in five samples (in 3-D seven)
    tells that half of them were too few, those decide.  Deterministic; takes less than ten times
    as long as one fit.

    Parameters
    ----------
    values : array, shape (n_1, n_2) or (n_1, n_2, n_3)
        Samples; NaN is missing.  Where any is, settings that fill wide holes badly are left out.
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
    values, steps = _checked(values, spacing)
    if isinstance(values, Tracer):
        raise ValueError("values must be known to choose settings; call tune outside jax.jit")
    known = ~jnp.isnan(values)
    if int(jnp.sum(known)) < FEWEST:
        raise ValueError(
            f"values must hold at least {FEWEST} samples that are not NaN to be tuned on"
        )
    # One colour ranks the settings as well as both do, for half the price.
    odd = jnp.asarray(_colours(values.shape) == 1)
    half = odd if 4 * int(jnp.sum(known & odd)) >= int(jnp.sum(known)) else ~odd
    few = _scattered(known)
    on_half = functools.cache(lambda candidate: _errors(values, steps, candidate, half))
    on_few = functools.cache(lambda candidate: _errors(values, steps, candidate, few))
    # Cross-validation does not see wide holes.  Tension is flat over them, and polynomials that
    # continue the samples beyond the border are far off behind them.
    gapless = bool(known.all())
    tried = [each for each in CANDIDATES if gapless or each.tension == 0]
    chosen = _least(tried, on_half)
    if int(jnp.sum(known & few)) >= FEWEST and _contradicted(chosen, on_few):
        chosen = _least(tried, on_few)
    elif HANDICAP * on_half(PROBE).inside < on_half(chosen).inside:
        chosen = SMOOTH if gapless else SMOOTH._replace(border_degree=0)
    return GlobalFairing(**chosen._asdict(), coherence=COHERENCE, sigma=sigma)  # pyright: ignore


def cross_validation_error(
    method: GlobalFairing,
    values: ArrayLike,
    spacing: ArrayLike | Sequence[float] = 1.0,
    colours: tuple[int, ...] = (0, 1),
) -> Float[Array, ""]:
    """Mean square error at the samples of either colour when the method is given the other.

    Parameters
    ----------
    method : GlobalFairing
        Differentiable in its real-valued settings.
    values : array, shape (n_1, ..., n_d)
        Samples; NaN is missing.
    spacing : float or sequence of ndim floats
    colours : tuple of int
        Colours that are dropped, one after the other.

    Raises
    ------
    ValueError
        As `fair_field`; also for a method that does not fill missing samples.
    """
    values, steps = _checked(values, spacing)
    if not isinstance(method, GlobalFairing):
        raise ValueError(f"method must be GlobalFairing, which fills what is dropped, got {method}")
    method = method.prepare(values)
    colour = jnp.asarray(_colours(values.shape))
    squares, judged = jax.lax.map(
        lambda dropped: _held_back(method, values, steps, colour == dropped),
        jnp.asarray(colours),
    )
    return _mean(squares, judged)


def _checked(values: ArrayLike, spacing: ArrayLike | Sequence[float]) -> tuple[Array, Array]:
    """Samples, and their distances in the same precision."""
    samples = _check.check_samples(values)
    steps = _check.check_per_axis(spacing, samples.ndim, "spacing", positive=True)
    return samples, jnp.asarray(steps, samples.dtype)


def _held_back(
    method: GlobalFairing, values: Array, spacing: Array, dropped: Bool[Array, "*shape"]
) -> tuple[Float[Array, "*shape"], Bool[Array, "*shape"]]:
    """Squares of the errors at the samples that are dropped, and where there are any."""
    known = ~jnp.isnan(values)
    net, _ = method.fit(jnp.where(dropped, jnp.nan, values), spacing)
    difference = net[(slice(None, None, 3),) * values.ndim] - jnp.where(known, values, 0)
    return jnp.where(known & dropped, difference, 0) ** 2, known & dropped


def _mean(squares: Array, judged: Array) -> Float[Array, ""]:
    """Mean over what is judged."""
    count = jnp.maximum(jnp.sum(judged, dtype=squares.dtype), 1)
    return jnp.sum(jnp.where(judged, squares, 0)) / count


def _colours(shape: tuple[int, ...]) -> Int[np.ndarray, "*shape"]:
    """The checkerboard: 0 and 1."""
    return np.indices(shape).sum(axis=0) % 2


def _scattered(known: Bool[Array, "*shape"]) -> Bool[Array, "*shape"]:
    """One in five samples of a plane, seven of a volume, that have none of each other beside."""
    count = 2 * known.ndim + 1
    colours = np.tensordot(np.arange(1, known.ndim + 1), np.indices(known.shape), 1) % count
    numbers = np.bincount(colours[np.asarray(known)], minlength=count)
    return jnp.asarray(colours == numbers.argmax())


def _inside(shape: tuple[int, ...]) -> Bool[Array, "*shape"]:
    """Samples away from the border."""
    inside = np.ones(shape, bool)
    for axis, count in enumerate(shape):
        margin = min(MARGIN, count // 8)
        place = np.arange(count).reshape([-1 if k == axis else 1 for k in range(len(shape))])
        inside &= (place >= margin) & (place < count - margin)
    return jnp.asarray(inside)


def _least(tried: Sequence[Candidate], errors: Callable[[Candidate], Errors]) -> Candidate:
    """The best candidate.

    What is smooth over the wide gaps of cross-validation need not be over the gaps between all
    samples: smoothness s has to lower the error by more than s of it.
    """
    return min(tried, key=lambda each: errors(each).everywhere * (1 + each.smoothness))


def _contradicted(chosen: Candidate, errors: Callable[[Candidate], Errors]) -> bool:
    """Whether a witness has far smaller errors."""
    least = min(errors(each).everywhere for each in WITNESSES)
    return errors(chosen).everywhere > FOOLED * least


def _errors(values: Array, spacing: Array, candidate: Candidate, dropped: Array) -> Errors:
    """Of a candidate at the samples that are dropped."""
    # Without normals and powers of the energy the first fit is the last, and can be more exact.
    plain = candidate.thin_plate_weight == 1 and candidate.norm == 2
    method = GlobalFairing(
        coherence=COHERENCE,
        sharpness=candidate.sharpness,
        iterations=0 if plain else ITERATIONS,
        tolerance=TOLERANCE / 10 if plain else TOLERANCE,
        max_steps=MAX_STEPS,
    )
    # Arrays, so that candidates share programs.
    setting = jnp.asarray([candidate.thin_plate_weight, *candidate[2:6]], values.dtype)
    everywhere, inside = _errors_of(method, values, spacing, setting, dropped)
    return Errors(float(everywhere), float(inside))


@jax.jit
def _errors_of(
    method: GlobalFairing,
    values: Array,
    spacing: Array,
    setting: Float[Array, "5"],
    dropped: Bool[Array, "*shape"],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """As `_errors`, of the method with those real-valued settings."""
    weight, tension, smoothness, norm, hessian_weight = setting
    tried = dataclasses.replace(
        method,
        thin_plate_weight=weight,
        tension=tension,
        smoothness=smoothness,
        norm=norm,
        hessian_weight=hessian_weight,
    )
    squares, judged = _held_back(tried, values, spacing, dropped)
    return _mean(squares, judged), _mean(squares, judged & _inside(values.shape))
