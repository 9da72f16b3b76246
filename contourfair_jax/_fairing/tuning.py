"""Settings of global fairing chosen from the samples alone, by cross-validation."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from .._support import checks
from .._support.public import former_keyword
from .global_fairing.method import GlobalFairing


class Candidate(NamedTuple):
    """Settings that are tried.

    Where noise is tried, sigma 0 stands for none.
    """

    thin_plate_weight: float
    sharpness: int
    tension: float
    smoothness: float
    norm: float
    hessian_weight: float = 0.0
    border_degree: int = 0
    sigma: float | None = None


class Errors(NamedTuple):
    """Mean squares over all samples that are dropped, and over those away from the border.

    `typical` is the mean square of normally distributed errors that have the median of these: less
    where a few features have large errors, the same where noise has.
    """

    everywhere: float
    inside: float
    typical: float


COHERENCE = 1.2
# Renewals of the normals while candidates are compared.  With noise as many as by default, since
# every one makes the springs to the samples more nearly as stiff as they are in the end.
ITERATIONS, WITH_NOISE = 2, 3
# Fits that are only compared need not be exact, but their errors have to be below those that are
# compared: on smooth samples 1e-2 is not enough.
TOLERANCE = 1e-3
MAX_STEPS = 200
# The median of the square of a normally distributed number, as a part of its mean.
MEDIAN = 0.4549
# Samples at the border, where dropped ones are not surrounded by others.
MARGIN = 3


@former_keyword("colours", "colors")
def cross_validation_error(
    method: GlobalFairing,
    values: ArrayLike,
    spacing: ArrayLike | Sequence[float] = 1.0,
    colors: tuple[int, ...] = (0, 1),
) -> Float[Array, ""]:
    """Mean square error at the samples of either colour when the method is given the other.

    Parameters
    ----------
    method : GlobalFairing
        Differentiable in its real-valued settings.
    values : array, shape (n_1, ..., n_d)
        Samples; NaN is missing.
    spacing : float or sequence of ndim floats
    colors : tuple of int
        Colours that are dropped, one after the other.

    Raises
    ------
    ValueError
        As `fair_field`; also for a method that does not fill missing samples.
    """
    values, steps = checked(values, spacing)
    if not isinstance(method, GlobalFairing):
        raise ValueError(f"method must be GlobalFairing, which fills what is dropped, got {method}")
    method = method.prepare(values)
    colour = jnp.asarray(checkerboard(values.shape))
    squares, judged = jax.lax.map(
        lambda dropped: _held_back(method, values, steps, colour == dropped),
        jnp.asarray(colors),
    )
    return _mean(squares, judged)


def checked(values: ArrayLike, spacing: ArrayLike | Sequence[float]) -> tuple[Array, Array]:
    """Samples, and their distances in the same precision."""
    samples = checks.check_samples(values, depth=2)
    steps = checks.check_per_axis(spacing, samples.ndim, "spacing", positive=True)
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


def checkerboard(shape: tuple[int, ...]) -> Int[np.ndarray, "*shape"]:
    """The colours of a checkerboard, 0 and 1."""
    return np.indices(shape).sum(axis=0) % 2


def scattered(known: Bool[Array, "*shape"], many: int) -> list[Bool[Array, "*shape"]]:
    """One in five samples of a plane, seven of a volume, that have none of each other beside.

    As many such sets as have more than `many` samples together, the largest first.
    """
    count = 2 * known.ndim + 1
    colours = np.tensordot(np.arange(1, known.ndim + 1), np.indices(known.shape), 1) % count
    numbers = np.bincount(colours[np.asarray(known)], minlength=count)
    largest = np.argsort(-numbers, kind="stable")[: 1 + many // numbers.max()]
    return [jnp.asarray(colours == each) for each in largest]


def _inside(shape: tuple[int, ...]) -> Bool[Array, "*shape"]:
    """Samples away from the border."""
    inside = np.ones(shape, bool)
    for axis, count in enumerate(shape):
        margin = min(MARGIN, count // 8)
        place = np.arange(count).reshape([-1 if k == axis else 1 for k in range(len(shape))])
        inside &= (place >= margin) & (place < count - margin)
    return jnp.asarray(inside)


def errors_of(
    candidate: Candidate,
    values: Array,
    spacing: Array,
    dropped: Sequence[Bool[Array, "*shape"]],
) -> Errors:
    """At samples that are dropped, a set at a time, with nothing continued beyond the border."""
    each = [_errors_at(candidate, values, spacing, some) for some in dropped]
    return Errors(*(sum(errors) / len(each) for errors in zip(*each, strict=True)))


def _errors_at(
    candidate: Candidate, values: Array, spacing: Array, dropped: Bool[Array, "*shape"]
) -> Errors:
    """At one set of samples that are dropped."""
    exact = not candidate.sigma
    # Without normals and powers of the energy the first fit is the last, and can be more exact.
    plain = candidate.thin_plate_weight == 1 and candidate.norm == 2 and exact
    renewals = ITERATIONS if candidate.sigma is None else WITH_NOISE
    method = GlobalFairing(
        coherence=COHERENCE,
        sharpness=candidate.sharpness,
        iterations=0 if plain else renewals,
        tolerance=TOLERANCE / 10 if plain else TOLERANCE,
        max_steps=MAX_STEPS,
        sigma=None if exact else jnp.asarray(candidate.sigma, values.dtype),
    )
    # Arrays, so that candidates share programs.
    setting = jnp.asarray([candidate.thin_plate_weight, *candidate[2:6]], values.dtype)
    everywhere, inside, squares = _with_setting(method, values, spacing, setting, dropped)
    # Here, where the median takes a part of the time that sorting would in the program.
    typical = np.nanmedian(np.asarray(squares)) / MEDIAN
    return Errors(float(everywhere), float(inside), float(typical))


@jax.jit
def _with_setting(
    method: GlobalFairing,
    values: Array,
    spacing: Array,
    setting: Float[Array, "5"],
    dropped: Bool[Array, "*shape"],
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, "*shape"]]:
    """Mean squares with those real-valued settings, and all squares, NaN where none is judged."""
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
    inside = _mean(squares, judged & _inside(values.shape))
    return _mean(squares, judged), inside, jnp.where(judged, squares, jnp.nan)


Judge: TypeAlias = Callable[[Candidate], Errors]
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

# For rings, stripes and other waves along whose contours little happens.  The first is for volumes
# too, and takes over where half the samples hardly tell it from the best, at most by this factor,
# and few dropped ones say so.
STRIPES = (Candidate(0.01, 2, 0.0, 0.1, 1.0), Candidate(0.003, 2, 0.0, 0.3, 1.0))
TIE = 1.05
# For what is really smooth, recognised by `PROBE`: over the wide gaps of cross-validation, and
# halfway between samples where it looks, more smoothness pays than between all samples, so that its
# error has to be this much smaller than others; stripes are smooth there as well.
SMOOTH = Candidate(1.0, 1, 0.0, 0.015, 2.0, border_degree=4)
PROBE = SMOOTH._replace(smoothness=0.2, border_degree=0)
HANDICAP = 1.25
# What is smooth over the wide gaps of cross-validation need not be over the gaps between all
# samples: smoothness s has to lower the error by more than this times s of it.
SCEPTICISM = 0.6
# Waves that the samples just resolve look like noise on a checkerboard of them.  Where one of these
# candidates is this much better when only a few samples are dropped, at least so many, the
# checkerboard was too coarse.
WITNESSES = (WAVES, JAGGED)
FOOLED = 1.4
FEWEST = 8
# Noise that is tried, as a part of the error of an exact fit at the samples that are dropped (noise
# is everywhere, so that features with large errors do not count), and how many of these there are
# to be where there can be: the errors hardly differ.
NOISES = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95)
MANY = 2000
# The smallest noise counts that leaves no more than this part of what can be gained: beyond it the
# errors often hardly change, while features between the samples go.
FORGONE = 0.03


def tune(
    values: ArrayLike,
    *,
    spacing: ArrayLike | Sequence[float] = 1.0,
    sigma: ArrayLike | None = None,
    noisy: bool = False,
) -> GlobalFairing:
    """Choose the settings of `GlobalFairing` from the samples alone.

    Drops one colour of a checkerboard of the samples, fits the rest with every candidate setting
    and compares at the dropped samples.  Returns the setting with the smallest mean square error,
    with a small handicap for smoothness.  Where dropping only one in five samples (in 3-D seven)
    tells that half of them were too few, those decide.  Deterministic; takes some ten times as long
    as one fit, with `noisy` two to five times as long as without.

    Parameters
    ----------
    values : array, shape (n_1, n_2) or (n_1, n_2, n_3)
        Samples; NaN is missing.  Where any is, settings that fill wide holes badly are left out.
    spacing : float or sequence of ndim floats
    sigma : float or array, or None
        Noise of the samples, passed on to the method that is returned.
    noisy : bool
        Whether to choose `sigma` too, one for all samples: the smallest that fits nearly as well as
        the best where one in five samples (in 3-D seven) is dropped at a time.  It stays None, so
        that samples are met exactly, where nothing else is better.

    Returns
    -------
    GlobalFairing

    Raises
    ------
    ValueError
        As `fair_field`; also inside `jax.jit`, for fewer than 8 samples that are not missing, and
        for both `sigma` and `noisy`.

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
    values, steps = checked(values, spacing)
    checks.check_choice(noisy, (False, True), "noisy")
    if noisy and sigma is not None:
        raise ValueError("noisy chooses sigma, so sigma must be None beside it; leave one out")
    if isinstance(values, Tracer):
        raise ValueError("values must be known to choose settings; call tune outside jax.jit")
    values, scale = _scaled(values)
    known = ~jnp.isnan(values)
    if int(jnp.sum(known)) < FEWEST:
        raise ValueError(
            f"values must hold at least {FEWEST} samples that are not NaN to be tuned on"
        )
    # One colour ranks the settings as well as both do, for half the price.
    odd = jnp.asarray(checkerboard(values.shape) == 1)
    half = odd if 4 * int(jnp.sum(known & odd)) >= int(jnp.sum(known)) else ~odd
    several = scattered(known, MANY if noisy else 0)
    enough = int(jnp.sum(known & several[0])) >= FEWEST
    on_half = functools.cache(lambda candidate: errors_of(candidate, values, steps, [half]))
    on_few = functools.cache(lambda candidate: errors_of(candidate, values, steps, several[:1]))
    on_several = functools.cache(lambda candidate: errors_of(candidate, values, steps, several))
    # Cross-validation does not see wide holes.  Tension is flat over them, and polynomials that
    # continue the samples beyond the border are far off behind them.
    gapless = bool(known.all())
    tried = [each for each in (*CANDIDATES, *STRIPES) if gapless or each.tension == 0]
    chosen, deciding = _exact(tried, on_half, on_few if enough else None)
    if not gapless:
        chosen = chosen._replace(border_degree=0)
    if noisy:
        chosen = _with_noise(chosen, tried, deciding, on_several)
    settings = chosen._asdict() | {"sigma": scale * chosen.sigma if chosen.sigma else sigma}
    return dataclasses.replace(GlobalFairing(coherence=COHERENCE), **settings)


def _scaled(values: Array) -> tuple[Array, float]:
    """The samples over a power of two near their range, whose squares stay in that of floats."""
    known = np.asarray(values, dtype=np.float64)
    known = known[~np.isnan(known)]
    exponent = int(np.frexp(np.ptp(known) if known.size else 1.0)[1])
    return jnp.ldexp(values, -exponent), 2.0**exponent


def _exact(
    tried: Sequence[Candidate], on_half: Judge, on_few: Judge | None
) -> tuple[Candidate, Judge]:
    """The best setting that meets all samples, and the errors that decided."""
    chosen = _least([each for each in tried if each not in STRIPES], on_half)
    if on_few is not None and _contradicted(chosen, on_few):
        return _least(tried, on_few), on_few
    if HANDICAP * on_half(PROBE).inside < on_half(chosen).inside:
        return SMOOTH, on_half
    chosen, stripes = _least(tried, on_half), STRIPES[0]
    tied = on_half(stripes).everywhere < TIE * on_half(chosen).everywhere
    if on_few is not None and tied:
        chosen = _least([chosen, stripes], on_few)
    return chosen, on_half


def _least(tried: Sequence[Candidate], errors: Judge) -> Candidate:
    """The best candidate, with the handicap for smoothness."""
    return min(tried, key=lambda each: errors(each).everywhere * (1 + SCEPTICISM * each.smoothness))


def _with_noise(
    chosen: Candidate,
    tried: Sequence[Candidate],
    errors: Judge,
    on_several: Judge,
) -> Candidate:
    """Noise for what was chosen, the best candidate with it, and noise for that."""
    noisy = _noisy(chosen, on_several)
    if not noisy.sigma:
        return chosen
    again = _least([noisy, *(each._replace(sigma=noisy.sigma) for each in tried)], errors)
    return noisy if again == noisy else _noisy(again, on_several)


def _noisy(candidate: Candidate, errors: Judge) -> Candidate:
    """The candidate with the noise that leaves small errors, 0 for an exact fit."""
    exact = candidate._replace(sigma=0.0)
    found = errors(exact)
    error = min(found.everywhere, found.typical) ** 0.5
    tried = [exact, *(exact._replace(sigma=part * error) for part in NOISES)]
    squares = [errors(each).everywhere for each in tried]
    enough = squares[0] - (1 - FORGONE) * (squares[0] - min(squares))
    return next(each for each, square in zip(tried, squares, strict=True) if square <= enough)


def _contradicted(chosen: Candidate, errors: Judge) -> bool:
    """Whether a witness has far smaller errors."""
    least = min(errors(each).everywhere for each in WITNESSES)
    return errors(chosen).everywhere > FOOLED * least
