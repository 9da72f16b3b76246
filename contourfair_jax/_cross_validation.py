"""How well settings of global fairing meet samples that are held back."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from . import _check
from ._global import GlobalFairing


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
    values, steps = checked(values, spacing)
    if not isinstance(method, GlobalFairing):
        raise ValueError(f"method must be GlobalFairing, which fills what is dropped, got {method}")
    method = method.prepare(values)
    colour = jnp.asarray(checkerboard(values.shape))
    squares, judged = jax.lax.map(
        lambda dropped: _held_back(method, values, steps, colour == dropped),
        jnp.asarray(colours),
    )
    return _mean(squares, judged)


def checked(values: ArrayLike, spacing: ArrayLike | Sequence[float]) -> tuple[Array, Array]:
    """Samples, and their distances in the same precision."""
    samples = _check.check_samples(values, depth=2)
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
