"""Pairs of segments of polylines that meet, found in a grid of bins."""

from collections.abc import Iterator, Sequence

import numpy as np

from ._ragged import batches, ranges

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
    """Whether the segments a b and p q, whose boxes overlap, have a point in common."""
    across = _side(a, b, p) * _side(a, b, q) <= 0
    return across & (_side(p, q, a) * _side(p, q, b) <= 0)


def _side(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
    """1 or -1 for points left and right of the line through a and b, 0 on it."""
    one = (b[:, 0] - a[:, 0]) * (p[:, 1] - a[:, 1])
    other = (b[:, 1] - a[:, 1]) * (p[:, 0] - a[:, 0])
    zero = np.abs(one - other) <= _ZERO * (np.abs(one) + np.abs(other))
    return np.where(zero, 0, np.sign(one - other))
