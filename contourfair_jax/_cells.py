"""Bezier cells as NumPy arrays with the batch last: which hold a level, and their subdivision.

Everything that traces contours works on the host in float64: how many cells, points and lines there
are depends on the data.  With the batch last, each of the 16 points of all cells is one contiguous
vector, and one line of code treats all cells.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ._bezier import cell_extreme

# Cells of the grid looked at in one go, and those with a level subdivided in one go: what is worked
# on stays in the caches of the processor.
_SCANNED = 1 << 17
BATCH = 1 << 15


@dataclass(frozen=True)
class Cells:
    """Square pieces of the field, all of the same size.

    Parameters
    ----------
    points : array, shape (4, 4, n)
        Bezier points, float64.
    corner : array of int, shape (2, n)
        Lower corners, in units of the side `2**-depth` of the pieces.
    depth : int
        How often the cells of the grid were halved.
    first, last : array of int, shape (n,)
        The sorted levels `first <= k < last` lie within the bounds of the piece.
    """

    points: np.ndarray
    corner: np.ndarray
    depth: int
    first: np.ndarray
    last: np.ndarray

    def __len__(self) -> int:
        return self.points.shape[-1]

    def take(self, chosen: np.ndarray) -> "Cells":
        """Those with the given indices, or where a mask is true."""
        if chosen.dtype == bool:
            chosen = np.flatnonzero(chosen)
        points, corner = self.points.take(chosen, -1), self.corner.take(chosen, -1)
        return Cells(points, corner, self.depth, self.first[chosen], self.last[chosen])


def level_ranges(
    lower: np.ndarray, upper: np.ndarray, levels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """First and one past the last of the sorted levels with `lower <= level < upper`.

    A level that is not between the Bezier points of a piece has no line in it.  Where the bounds
    are NaN or infinite there is none.
    """
    first = np.searchsorted(levels, lower, side="left")
    last = np.searchsorted(levels, upper, side="left")
    last = np.where(np.isfinite(lower) & np.isfinite(upper), last, first)
    return first, last


def grid_cells(net: np.ndarray, levels: np.ndarray, middle: float) -> Iterator[Cells]:
    """The cells that may hold one of the sorted levels, batch by batch: of a net less `middle`."""
    rows, columns = ((points - 1) // 3 for points in net.shape)
    step = max(1, _SCANNED // columns)
    for start in range(0, rows, step):
        part = net[3 * start : 3 * min(start + step, rows) + 1]
        lower, upper = (
            cell_extreme(part, reduce).astype(np.float64) - middle
            for reduce in (np.minimum, np.maximum)
        )
        first, last = level_ranges(lower, upper, levels)
        i, j = np.nonzero(last > first)
        corners = np.stack([i + start, j])
        for begin in range(0, len(i), BATCH):
            corner = corners[:, begin : begin + BATCH]
            at = corner[0] - start, corner[1]
            yield Cells(_gather(part, *at) - middle, corner, 0, first[at], last[at])


def _gather(net: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """The 4 x 4 points of cells (i, j), float64, the cells last."""
    points = np.empty((4, 4, len(i)))
    lowest = 3 * i * net.shape[1] + 3 * j
    flat = net.reshape(-1)
    for a in range(4):
        for b in range(4):
            points[a, b] = flat[lowest + (a * net.shape[1] + b)]
    return points


def cells_with_values(net: np.ndarray) -> np.ndarray:
    """Which cells of a control net have finite points only."""
    return np.isfinite(cell_extreme(net, np.minimum)) & np.isfinite(cell_extreme(net, np.maximum))


def halves(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both halves of cubics along the first axis, by de Casteljau.

    The last point of the lower half is the first of the upper, bit for bit, and the end points are
    copied: pieces that share an edge agree on it exactly.
    """
    p0, p1, p2, p3 = points
    p01, p12, p23 = (p0 + p1) * 0.5, (p1 + p2) * 0.5, (p2 + p3) * 0.5
    p012, p123 = (p01 + p12) * 0.5, (p12 + p23) * 0.5
    middle = (p012 + p123) * 0.5
    return np.stack([p0, p01, p012, middle]), np.stack([middle, p123, p23, p3])


def quarters(cells: Cells, levels: np.ndarray) -> Cells:
    """The four quarters of every cell, those that may hold a level."""
    parts = []
    for a, half in enumerate(halves(cells.points)):
        for b, quarter in enumerate(halves(half.swapaxes(0, 1))):
            flat = quarter.reshape(16, -1)
            first, last = level_ranges(flat.min(0), flat.max(0), levels)
            kept = np.flatnonzero(last > first)
            corner = 2 * cells.corner[:, kept] + np.array([[a], [b]])
            points = quarter.swapaxes(0, 1).take(kept, -1)
            parts.append((points, corner, first[kept], last[kept]))
    points, corner, first, last = (
        np.concatenate(arrays, -1) for arrays in zip(*parts, strict=True)
    )
    return Cells(points, corner, cells.depth + 1, first, last)
