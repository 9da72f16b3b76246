"""Levels: checked, placed a little above plateaus, and what is to be known about them.

Places that are flat but for rounding would make specks at the level of the plateau.  So a level is
raised by `5e-10` of the range of the samples, or by two roundings of the largest sample where these
are more.  Levels that differ by less cannot be told apart.

What is traced is the field less the middle of the range, at levels less the same number.  Of
samples that lie far from zero this difference is exact, and subdivision rounds to digits of the
range, not of the samples.  Subtraction keeps the order of floats, so that bounds stay bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import jax
import numpy as np
from jaxtyping import Array, Real

from ._support.checks import Scalar

# In the range of the samples, and in roundings of the largest.
_PART, _ROUNDINGS = 5e-10, 2


@dataclass(frozen=True)
class Values:
    """Range and precision of the finite samples of a net; all zero where there is none.

    Parameters
    ----------
    low, high : float
    eps : float
        Rounding of numbers near 1, in the precision that the net was computed in.
    """

    low: float
    high: float
    eps: float

    @property
    def rounding(self) -> float:
        """Rounding of the largest sample."""
        return self.eps * max(-self.low, self.high)

    @property
    def middle(self) -> float:
        """The value that is taken off before tracing."""
        return 0.5 * self.low + 0.5 * self.high

    @property
    def spread(self) -> float:
        """Range of the samples."""
        return self.high - self.low

    def shift(self) -> float:
        """The value that levels are raised by."""
        return max(_PART * self.spread, _ROUNDINGS * self.rounding)

    def placed(self, levels: np.ndarray) -> np.ndarray:
        """The levels that are traced in the field less its middle."""
        return levels - self.middle + self.shift()


def values_of(net: np.ndarray) -> Values:
    """Range and rounding of the samples of a control net."""
    samples = net[(slice(None, None, 3),) * net.ndim]
    samples = samples[np.isfinite(samples)]
    eps = float(np.finfo(net.dtype).eps)
    if not samples.size:
        return Values(0.0, 0.0, eps)
    return Values(float(samples.min()), float(samples.max()), eps)


def distinct(levels: np.ndarray, least: float) -> np.ndarray:
    """Sorted levels without those that are at most `least` above the one kept before."""
    if not (np.diff(levels) <= least).any():
        return levels
    kept = [levels[0]]
    for level in levels[1:]:
        if level - kept[-1] > least:
            kept.append(level)
    return np.array(kept)


# Levels that are listed in words.
_LISTED = 5
# More samples than these on a level are worth a note.
_SHARE, _FEW = 0.01, 4
# So is rounding of more than this part of the range, and of more than that of usual samples.
_NOTED_SHIFT, _NOTED_ROUNDINGS = 1e-9, 32


def level_notes(
    asked: np.ndarray, kept: np.ndarray, values: Values, samples: np.ndarray
) -> tuple[str, ...]:
    """Notes on levels that count as one, that samples have, and that rounding moves."""
    notes = []
    if len(kept) < len(asked):
        left_out = np.setdiff1d(asked, kept)
        notes.append(
            f"{len(left_out)} of {len(asked)} levels are left out, less than {values.shift():.1g} "
            f"above another, which is too close to tell apart: {listed(left_out, '')}"
        )
    notes += _on_samples(kept, samples[np.isfinite(samples)], values.shift())
    return (*notes, *rounding_note(values, "lines"))


def rounding_note(values: Values, what: str) -> tuple[str, ...]:
    """A note on rounding that moves lines or surfaces."""
    if not values.shift() > max(_NOTED_SHIFT, _NOTED_ROUNDINGS * values.eps) * values.spread > 0:
        return ()
    return (
        f"{what} are up to {values.shift():.1g} above their levels, because the samples are "
        "rounded to so few digits of their range; take a constant off them, or use float64",
    )


def _on_samples(levels: np.ndarray, samples: np.ndarray, near: float) -> list[str]:
    """A note on levels with many samples on them, as of plateaus of whole numbers."""
    place = np.searchsorted(levels, samples - near)
    on = np.append(levels, np.inf)[place] <= samples + near
    count = np.bincount(place[on], minlength=len(levels))
    many = np.flatnonzero(count > max(_SHARE * len(samples), _FEW))
    if not len(many):
        return []
    level = levels[many[0]]
    above, below = samples[samples > level + near], samples[samples < level - near]
    if not len(above) and not len(below):
        return []
    between = 0.5 * (level + float(above.min() if len(above) else below.max()))
    return [
        f"{len(many)} of {len(levels)} levels are on many samples, which count as below: "
        f"{listed(levels[many])}; levels between samples, such as {between:.10g}, avoid flat places"
    ]


def unproved_note(unproved: int, what: str) -> tuple[str, ...]:
    """A note on pieces where the bounds could not prove that `what` is complete."""
    if not unproved:
        return ()
    return (f"{unproved} pieces of cells may hold details that the {what} do not show",)


def listed(levels: np.ndarray, digits: str = ".10g") -> str:
    """The first few levels in words; all their digits where `digits` is empty."""
    shown = ", ".join(f"{level:{digits}}" for level in levels[:_LISTED].tolist())
    return shown + (", ..." if len(levels) > _LISTED else "")


Levels: TypeAlias = Scalar | Sequence[Scalar] | Real[Array | np.ndarray, " levels"]
MOST_LEVELS = 10_000
LEAST_TOLERANCE = 1e-8
# Levels where nothing says how many.
USUAL_COUNT = 10


def even_levels(samples: np.ndarray, count: int = USUAL_COUNT) -> np.ndarray:
    """`count` levels that divide the range of the finite samples into equal parts.

    None where the samples have no range.
    """
    finite = samples[np.isfinite(samples)]
    if not finite.size or finite.min() == finite.max():
        return np.zeros(0)
    return np.linspace(float(finite.min()), float(finite.max()), count + 2)[1:-1]


def check_levels(levels: Levels, infinite: bool = False) -> np.ndarray:
    """Sorted finite levels, each once; with `-inf` and `inf` where `infinite` allows them.

    Raises
    ------
    ValueError
        For levels that are masked or not real and finite, or too many.
    """
    try:
        array = levels if isinstance(levels, np.ma.MaskedArray) else np.asarray(levels)
    except ValueError as error:
        raise ValueError(f"levels must be real numbers in one sequence, got {levels!r}") from error
    if array.ndim > 1 or (array.size and array.dtype.kind not in "fiu"):
        raise ValueError(
            f"levels must be real numbers in one sequence, got shape {array.shape} and dtype "
            f"{array.dtype}"
        )
    array = np.atleast_1d(np.ma.filled(array.astype(np.float64), np.nan))
    wrong = np.count_nonzero(np.isnan(array) if infinite else ~np.isfinite(array))
    if wrong:
        raise ValueError(
            f"levels must be finite and not masked, got {wrong} that are not; leave them out"
        )
    array = np.unique(array)
    if len(array) > MOST_LEVELS:
        raise ValueError(
            f"levels must be at most {MOST_LEVELS}, got {len(array)}; call once for each part"
        )
    return array


def check_tolerance(tolerance: Scalar) -> float:
    """The tolerance as a float.

    Raises
    ------
    ValueError
        Unless it is one real number, array or not, that is a usable number of cells.
    """
    known = isinstance(tolerance, int | float | np.number | np.ndarray | jax.Array)
    array = np.asarray(tolerance if known else "")
    known = array.ndim == 0 and array.dtype.kind in "fiu"
    if not known or not LEAST_TOLERANCE <= array < np.inf:
        raise ValueError(
            f"tolerance must be a distance in cells of at least {LEAST_TOLERANCE:g}, "
            f"got {tolerance!r}; 0.01 is fine enough for pictures and maps"
        )
    return float(array)
