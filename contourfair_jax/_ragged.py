"""Many short ranges of numbers as one array."""

from collections.abc import Iterator

import numpy as np


def ranges(first: np.ndarray, count: np.ndarray) -> np.ndarray:
    """`first[k], first[k] + 1, ...`, `count[k]` numbers, for one k after the other."""
    ends = np.cumsum(count)
    return np.arange(ends[-1] if len(ends) else 0) + np.repeat(first - (ends - count), count)


def batches(count: np.ndarray, most: int) -> Iterator[np.ndarray]:
    """The indices of `count` in parts whose counts sum to about `most`."""
    done = np.cumsum(count)
    if not len(done) or not done[-1]:
        return
    bounds = np.searchsorted(done, np.arange(most, done[-1], most), side="right")
    for first, last in zip([0, *bounds], [*bounds, len(done)], strict=True):
        yield np.arange(first, last)
