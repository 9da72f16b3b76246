"""What is to be known about the levels of contours, bands and isosurfaces."""

import numpy as np

from ._shift import Values

# Levels that are listed in words.
_LISTED = 5
# More samples than these on a level are worth a note.
_SHARE, _FEW = 0.01, 4
# So is rounding of more than this part of the range, and of more than that of usual samples.
_SMALL, _ROUNDINGS = 1e-9, 32


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
    if not values.shift() > max(_SMALL, _ROUNDINGS * values.precision) * values.spread > 0:
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
