"""The part of a large grid that a picture shows."""

import numpy as np

from .io import Grid, InputError

SIZE = 32


def choose_window(grid: Grid, crop: str | None) -> tuple[list[tuple[int, int]], str]:
    """Row and column ranges for the option ``--crop``, and a note or ``""``.

    ``r0:r1,c0:c1`` are sample numbers, the second of a pair not included; ``all`` is the whole
    grid; None is the busiest window of a grid that is larger than one.
    """
    whole = [(0, n) for n in grid.shape]
    if crop is None:
        ranges = busiest_window(grid.values, SIZE)
        note = f"the busiest {SIZE} x {SIZE} samples are shown; --crop takes others, or all"
        return ranges, "" if ranges == whole else note
    if crop == "all":
        return whole, ""
    try:
        (top, bottom), (left, right) = (map(int, part.split(":")) for part in crop.split(","))
    except ValueError as error:
        raise InputError(f"crop must look like 10:60,20:70 or be 'all', got {crop!r}") from error
    return [(top, bottom), (left, right)], ""


def busiest_window(values: np.ndarray, size: int) -> list[tuple[int, int]]:
    """Ranges of the window, `size` samples wide at most, whose values change most.

    Windows with missing samples are taken only where there is no other.
    """
    ranges = [(0, n) for n in values.shape]
    if max(values.shape) <= size:
        return ranges
    steps = np.sum(np.abs(np.gradient(values.astype(np.float64))), axis=0)
    best, found = -1.0, ranges
    stride = max(1, size // 4)
    starts = [
        sorted({*range(0, max(n - size, 0) + 1, stride), max(n - size, 0)}) for n in values.shape
    ]
    for row in starts[0]:
        for column in starts[1]:
            part = steps[row : row + size, column : column + size]
            gaps = np.isnan(part)
            score = float(part[~gaps].mean()) * (~gaps).mean() ** 4 if not gaps.all() else 0.0
            if score > best:
                best = score
                found = [
                    (row, min(row + size, values.shape[0])),
                    (column, min(column + size, values.shape[1])),
                ]
    return found
