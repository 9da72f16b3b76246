"""Length, turning and bending of contour lines, level by level."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ._contour_line import ContourLine
from ._ragged import ranges


@dataclass(frozen=True)
class LevelMetrics:
    """What the contour of one level looks like.

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


def signed_area(ring: np.ndarray) -> float:
    """Area within a closed line; negative where it runs clockwise in the plane (0, 1)."""
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1]))


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
