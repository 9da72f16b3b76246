"""Length, turning and bending of contour lines, and segments that meet."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .._support.arrays import batches, ranges
from ..contours import ContourLine
from ..contours._line import signed_area


@dataclass(frozen=True)
class LevelMetrics:
    """Figures of the contour of one level.

    Parameters
    ----------
    level : float
    length : float
        In units of the coordinates.
    turning : float
        Total absolute turning in radians; `2 pi` for each convex loop.
    bending : float
        Squared curvature integrated along the contour, in units of 1 / length; `2 pi / r` for a
        circle.
    components : int
        Connected parts of the contour.
    holes : int
        Loops around smaller values: holes in the part of the plane above the level.
    """

    level: float
    length: float
    turning: float
    bending: float
    components: int
    holes: int


def level_metrics(
    lines: Sequence[ContourLine], step: float, levels: Sequence[float] | None = None
) -> list[LevelMetrics]:
    """Metrics of every level, sorted.

    Turning and bending are those of the lines with vertices every `step` of their length: of
    exterior angles, and of their squares over the length that they stand for.  Lines with kinks
    (bilinear ones) bend the more, the smaller the step.

    Parameters
    ----------
    lines : sequence of ContourLine
        Of `BezierField.contours`, with a tolerance well below `step`.
    step : float
        In units of the coordinates; a quarter of a cell suits.
    levels : sequence of float
        By default those of the lines; lines of other levels are left out.
    """
    if not 0 < step < np.inf:
        raise ValueError(f"step must be a length above zero, got {step!r}")
    known = np.unique([line.level for line in lines] if levels is None else levels).astype(float)
    lines = [line for line in lines if line.level in known]
    if not lines:
        return [LevelMetrics(level, 0.0, 0.0, 0.0, 0, 0) for level in known.tolist()]
    number = np.searchsorted(known, [line.level for line in lines])
    closed = np.array([line.closed for line in lines])
    length, turning, bending = _line_metrics([line.points for line in lines], closed, step)
    holes = np.array([line.closed and signed_area(line.points) < 0 for line in lines])
    sums = [
        np.bincount(number, weights, len(known)).tolist()
        for weights in (length, turning, bending, np.ones(len(lines)), holes)
    ]
    return [
        LevelMetrics(level, a, b, c, int(parts), int(gaps))
        for level, a, b, c, parts, gaps in zip(known.tolist(), *sums, strict=True)
    ]


def _line_metrics(
    lines: Sequence[np.ndarray], closed: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Length, turning and bending of each line; all lines are resampled in one go."""
    sizes = np.array([len(line) for line in lines])
    points = np.concatenate(lines)
    first, last = np.cumsum(sizes) - sizes, np.cumsum(sizes) - 1
    steps = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    steps[first] = 0
    at = np.cumsum(steps)
    length = at[last] - at[first]
    # Between lines the length jumps, so that no place belongs to two.
    at += np.repeat(np.arange(len(lines)) * step, sizes)
    pieces = np.maximum(np.ceil(length / step).astype(int), np.where(closed, 3, 1))
    number = np.repeat(np.arange(len(lines)), pieces + 1)
    rank = ranges(np.zeros(len(lines), int), pieces + 1)
    places = at[first][number] + rank * (length / pieces)[number]
    samples = np.stack([np.interp(places, at, points[:, k]) for k in (0, 1)], axis=1)
    begin = np.cumsum(pieces + 1) - pieces - 1
    chords = np.diff(samples, axis=0, append=samples[:1])
    heading = np.arctan2(chords[:, 1], chords[:, 0])
    # Of the last vertex of a line the next chord is the first one of a loop, and its own else.
    end = begin + pieces
    heading[end] = np.where(closed, heading[begin], heading[end - 1])
    angle = np.diff(heading, prepend=heading[:1])
    angle[begin] = 0
    angle = np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
    turning = np.bincount(number, angle)
    return length, turning, np.bincount(number, angle**2) / (length / pieces)


# Pairs compared in one go.
_BATCH = 1 << 20
# A cross product smaller than this times the sum of its terms' sizes counts as zero.
_ZERO = 8 * np.finfo(float).eps


def crossing_pairs(lines: Sequence[np.ndarray]) -> np.ndarray:
    """Segments that have a point in common, other than neighbours on a line.

    Parameters
    ----------
    lines : sequence of arrays, shape (n, 2)

    Returns
    -------
    array of int, shape (pairs, 2, 2)
        Line and segment of both.  Each pair once; one that touches counts, also within rounding.
    """
    lines = [np.asarray(line, dtype=np.float64) for line in lines]
    sizes = np.array([max(len(line) - 1, 0) for line in lines], dtype=int)
    if not sizes.sum():
        return np.empty((0, 2, 2), int)
    starts = np.concatenate([line[:-1] for line in lines])
    ends = np.concatenate([line[1:] for line in lines])
    number = np.repeat(np.arange(len(lines)), sizes)
    first = np.cumsum(sizes) - sizes
    loops = np.array([len(line) > 1 and bool((line[0] == line[-1]).all()) for line in lines])
    last_of_loop = np.where(loops, first + sizes - 1, -1)
    found = [np.empty((0, 2), int)]
    for one, other in _close_pairs(np.minimum(starts, ends), np.maximum(starts, ends)):
        same = number[one] == number[other]
        low, high = np.minimum(one, other), np.maximum(one, other)
        closing = (low == first[number[low]]) & (high == last_of_loop[number[low]])
        apart = ~(same & ((high - low == 1) | closing))
        low, high = low[apart], high[apart]
        meet = _meet(starts[low], ends[low], starts[high], ends[high])
        found.append(np.stack([low[meet], high[meet]], axis=1))
    pairs = np.concatenate(found)
    return np.stack([number[pairs], pairs - first[number[pairs]]], axis=-1)


def _close_pairs(lower: np.ndarray, upper: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Pairs of boxes that overlap, each once, batch by batch."""
    low, high = _bins(lower, upper)
    spans = high - low + 1
    box = np.repeat(np.arange(len(low)), spans.prod(1))
    place = ranges(np.zeros(len(low), int), spans.prod(1))
    bins = low[box] + np.stack([place // spans[box, 1], place % spans[box, 1]], axis=1)
    code = bins[:, 0] * (high[:, 1].max() + 1) + bins[:, 1]
    order = np.argsort(code, kind="stable")
    box, bins, code = box[order], bins[order], code[order]
    stop = np.searchsorted(code, code, side="right")
    later = stop - np.arange(len(code)) - 1
    for here in batches(later, _BATCH):
        at = np.repeat(here, later[here])
        partner = ranges(here + 1, later[here])
        one, other = box[at], box[partner]
        # The bin of the lowest corner of both boxes stands for the pair.
        kept = (bins[at] == np.maximum(low[one], low[other])).all(1)
        kept &= (lower[one] <= upper[other]).all(1) & (lower[other] <= upper[one]).all(1)
        yield one[kept], other[kept]


def _bins(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last bin of each box, in bins so large that few boxes are in many."""
    origin, whole = lower.min(0), np.ptp(np.concatenate([lower, upper]), axis=0).max()
    size = max(float((upper - lower).max(1).mean()), whole / (1 << 20)) or 1.0
    while True:
        low, high = (np.floor((x - origin) / size).astype(int) for x in (lower, upper))
        if (high - low + 1).prod(1).sum() <= 8 * len(lower) + 64:
            return low, high
        size *= 2


def _meet(a: np.ndarray, b: np.ndarray, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """True where the segments a b and p q, whose boxes overlap, have a point in common."""
    across = _side(a, b, p) * _side(a, b, q) <= 0
    return across & (_side(p, q, a) * _side(p, q, b) <= 0)


def _side(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
    """1 or -1 for points left and right of the line through a and b, 0 on it."""
    one = (b[:, 0] - a[:, 0]) * (p[:, 1] - a[:, 1])
    other = (b[:, 1] - a[:, 1]) * (p[:, 0] - a[:, 0])
    zero = np.abs(one - other) <= _ZERO * (np.abs(one) + np.abs(other))
    return np.where(zero, 0, np.sign(one - other))


def crossings(lines: Sequence[ContourLine]) -> int:
    """Number of pairs of segments of all lines that meet, other than neighbours on a line.

    Lines of one level and of different levels, and lines with themselves; touching counts.
    """
    return len(crossing_pairs([line.points for line in lines]))
