"""Where parts above and below levels merge and split between two fields of the same samples."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ._cells import cells_with_values
from ._components import components
from ._field import BezierField

# How much finer the grids are on which fair fields are followed, in 2-D and in 3-D.
_FACTORS = {2: 4, 3: 2}


@dataclass(frozen=True)
class Change:
    """Parts above (or below) a level that the fair field joins or separates.

    Parameters
    ----------
    level : float
    kind : str
        "merged" or "split", going from bilinear (trilinear) to fair.
    side : str
        "above" or "below": summits and ridges, or basins and valleys; in volumes alike.
    parts : int
        How many parts became one, or one became.
    position : tuple of float
        Where the extreme sample of the smallest of these parts lies.
    """

    level: float
    kind: str
    side: str
    parts: int
    position: tuple[float, ...]

    def __str__(self) -> str:
        where = ", ".join(f"{x:.10g}" for x in self.position)
        return f"level {self.level:g}, {self.side}: {self.parts} parts {self.kind} at ({where})"


def changes(
    plain: BezierField,
    field: BezierField,
    levels: Sequence[float],
    step: Callable[[], None] = lambda: None,
) -> list[Change]:
    """Parts of the multilinear field that the fair one merges and splits, where both have values.

    Both are followed on a refined grid.  The multilinear one is the same on any; halved cells have
    points within, which say that a cell has no values where all of its samples do.  Of a faired
    volume, what is smaller than half a cell can be missed.

    `step` is called after each level.
    """
    samples = np.asarray(field.samples, dtype=np.float64)
    valid = np.logical_and(
        *(cells_with_values(np.asarray(each.control_points)) for each in (plain, field))
    )
    factor = _FACTORS[field.ndim]
    coarse, finer = _refined(plain, 2, valid), _refined(field, factor, valid)
    in_coarse, in_finer = ((slice(None, None, n),) * field.ndim for n in (2, factor))
    found = []
    for level in levels:
        for side, sign in (("above", 1.0), ("below", -1.0)):
            before = components(sign * coarse, sign * level)[in_coarse]
            after = components(sign * finer, sign * level)[in_finer]
            for kind, one, other in (("merged", before, after), ("split", after, before)):
                for parts, at in _joined(one, other, sign * samples):
                    place = np.asarray(field.origin) + np.asarray(field.spacing) * at
                    found.append(Change(level, kind, side, parts, tuple(place.tolist())))
        step()
    return found


def _refined(field: BezierField, factor: int, valid: np.ndarray) -> np.ndarray:
    """The field on a finer grid, NaN away from the valid cells."""
    values = np.asarray(field.refine(factor), dtype=np.float64)
    near = valid
    for axis in range(values.ndim):
        inside = np.moveaxis(near.repeat(factor, axis), axis, 0)
        end = np.zeros_like(inside[:1])
        near = np.concatenate([end, inside]) | np.concatenate([inside, end])
        near = np.moveaxis(near, 0, axis)
    return np.where(near, values, np.nan)


def _joined(parts: np.ndarray, whole: np.ndarray, samples: np.ndarray) -> list[tuple]:
    """Members of `whole` with several `parts`: how many, and the highest sample of the smallest."""
    inside = (parts >= 0) & (whole >= 0)
    if not inside.any():
        return []
    pairs, sizes = np.unique(np.stack([whole[inside], parts[inside]]), axis=1, return_counts=True)
    joined = []
    number, count = np.unique(pairs[0], return_counts=True)
    for k in number[count > 1].tolist():
        members = np.flatnonzero(pairs[0] == k)
        smallest = pairs[1, members[np.argmin(sizes[members])]]
        where = np.where((parts == smallest) & (whole == k), samples, -np.inf)
        joined.append((len(members), np.array(np.unravel_index(where.argmax(), where.shape))))
    return joined
