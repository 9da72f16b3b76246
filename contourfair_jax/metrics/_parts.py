"""Connected parts of the samples above a level; where parts of two fields merge and split."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from skimage.measure import label

from .._bezier.nets import cells_with_values
from .._field import BezierField
from ..isosurface._mesh import connect


def components(samples: np.ndarray, level: float) -> np.ndarray:
    """Number the connected parts of `{f > level}` at the samples; -1 at those not above.

    Of images and of volumes.  Neighbours along an axis that are both above are connected; those
    across a cell where the bilinear (trilinear) interpolant is above the level all the way between
    them.  NaN is not above.
    """
    above = samples > level
    # Each part of the interpolant within a cell holds a corner, as it grows along axes up to one.
    part = np.asarray(label(above, connectivity=1)) - 1
    pairs = []
    for axes in itertools.combinations(range(samples.ndim), 2):
        f, higher, number = (np.moveaxis(each, axes, (0, 1)) for each in (samples, above, part))
        pairs.append(_across_faces(f, higher, number, level))
    if samples.ndim == 3:
        pairs += _through_cells(samples, above, part, level)
    root = connect(int(part.max(initial=-1)) + 1, np.concatenate(pairs, axis=1))
    number = np.unique(root, return_inverse=True)[1]
    part[above] = number[part[above]]
    return part


def _across_faces(
    samples: np.ndarray, above: np.ndarray, part: np.ndarray, level: float
) -> np.ndarray:
    """Pairs of parts that meet in faces of the first two axes: above at two opposite corners."""
    views = slice(-1), slice(1, None)
    a00, a01, a10, a11 = (above[i, j] for i in views for j in views)
    pairs = [np.zeros((2, 0), part.dtype)]
    for mixed, one, other in (
        (a00 & a11 & ~a01 & ~a10, (0, 0), (1, 1)),
        (a01 & a10 & ~a00 & ~a11, (0, 1), (1, 0)),
    ):
        at = np.nonzero(mixed)
        f00, f01, f10, f11 = (
            samples[(at[0] + i, at[1] + j, *at[2:])] for i in (0, 1) for j in (0, 1)
        )
        with np.errstate(invalid="ignore"):
            saddle = (f00 * f11 - f01 * f10) / (f00 + f11 - f01 - f10) > level
        ends = [part[(at[0] + i, at[1] + j, *at[2:])][saddle] for i, j in (one, other)]
        pairs.append(np.stack(ends))
    return np.concatenate(pairs, axis=1)


def _through_cells(
    samples: np.ndarray, above: np.ndarray, part: np.ndarray, level: float
) -> Iterator[np.ndarray]:
    """Pairs of parts that meet within cells.

    They meet at a saddle of the cell, and so in the section across the last axis through it, where
    they are above at two opposite of the corners A, B, C, D, which run along edges of the cell.
    The section is bilinear: A and C meet in it where `A C > B D`, less the level, and A, C > 0.
    """
    ring = [(0, 0), (0, 1), (1, 1), (1, 0)]
    corner = [
        [tuple(slice(bit, bit - 1 or None) for bit in (*at, k)) for k in (0, 1)] for at in ring
    ]
    higher = [above[low] | above[high] for low, high in corner]
    parts = [np.where(above[low], part[low], part[high]) for low, high in corner]
    for a, b, c, d in ((0, 1, 2, 3), (1, 2, 3, 0)):
        at = np.nonzero(higher[a] & higher[c] & (parts[a] != parts[c]))
        ends = [[samples[view][at] - level for view in corner[k]] for k in (a, b, c, d)]
        met = _meet(*(np.stack(each) for each in ends))
        yield np.stack([parts[a][at][met], parts[c][at][met]])


def _meet(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """True for `A C > B D` at any t in [0, 1] with A, C > 0; each from its values at 0 and 1."""
    start, stop = np.zeros(a.shape[1]), np.ones(a.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        for first, last in (a, c):
            zero = first / (first - last)
            start = np.where(first > 0, start, np.maximum(start, zero))
            stop = np.where(last > 0, stop, np.minimum(stop, zero))
        da, db, dc, dd = (last - first for first, last in (a, b, c, d))
        bend = da * dc - db * dd
        top = -(a[0] * dc + c[0] * da - b[0] * dd - d[0] * db) / (2 * bend)
        met = np.zeros(len(start), bool)
        for t in (start, stop, np.clip(top, start, stop)):
            met |= (a[0] + t * da) * (c[0] + t * dc) > (b[0] + t * db) * (d[0] + t * dd)
        return met & (start < stop)


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
