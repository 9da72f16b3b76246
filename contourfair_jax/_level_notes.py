"""What is to be known about the levels of contours and bands."""

import numpy as np

from ._shift import Values

# Levels that are listed in words.
_LISTED = 5


def level_notes(asked: np.ndarray, kept: np.ndarray, values: Values) -> tuple[str, ...]:
    """Notes on levels that count as one."""
    notes = []
    if len(kept) < len(asked):
        left_out = np.setdiff1d(asked, kept)
        notes.append(
            f"{len(left_out)} of {len(asked)} levels are left out, less than {values.shift():.1g} "
            f"above another, which is too close to tell apart: {listed(left_out, '')}"
        )
    return tuple(notes)


def unproved_note(unproved: int, what: str) -> tuple[str, ...]:
    """A note on pieces where the bounds could not prove that `what` is complete."""
    if not unproved:
        return ()
    return (f"{unproved} pieces of cells may hold details that the {what} do not show",)


def listed(levels: np.ndarray, digits: str = "g") -> str:
    """The first few levels in words; all their digits where `digits` is empty."""
    shown = ", ".join(f"{level:{digits}}" for level in levels[:_LISTED].tolist())
    return shown + (", ..." if len(levels) > _LISTED else "")
