"""How fair a field and its contours are: length, turning, bending, parts, crossings, overshoot."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ._basis import bernstein_derivative, quadrature
from ._compare import Comparison as Comparison
from ._compare import bilinear_field as bilinear_field
from ._compare import compare as compare
from ._crossings import crossing_pairs
from ._extrema import extrema
from ._field import BezierField
from ._lengths import LevelMetrics as LevelMetrics
from ._lengths import level_metrics as level_metrics
from ._lengths import signed_area as signed_area
from ._surface_metrics import SurfaceMetrics as SurfaceMetrics
from ._surface_metrics import surface_metrics as surface_metrics
from ._tracing import host_arrays
from .io import ContourLine


def crossings(lines: Sequence[ContourLine]) -> int:
    """How many pairs of segments of all lines meet, other than neighbours on a line.

    Lines of one level and of different levels, and lines with themselves; touching counts.
    """
    return len(crossing_pairs([line.points for line in lines]))


def overshoot(field: BezierField) -> float:
    """How far the field leaves the range of its samples, as a fraction of that range.

    Proved by Bernstein bounds to 1e-9 of the range; 0 for constant samples.  NaN cells are left
    out.  Any dimension.
    """
    samples = np.asarray(field.samples)
    samples = samples[np.isfinite(samples)]
    if not samples.size or samples.min() == samples.max():
        return 0.0
    low, high = extrema(np.asarray(field.control_points))
    excess = max(float(samples.min()) - low, high - float(samples.max()), 0.0)
    return excess / (float(samples.max()) - float(samples.min()))


def c1_jump(field: BezierField) -> float:
    """Largest jump of a first derivative between cells, over the largest first derivative.

    Rounding only where the field is C1.  Any dimension; NaN is left out.
    """
    net = np.asarray(field.control_points, dtype=np.float64)
    jump = slope = 0.0
    for axis, spacing in enumerate(np.asarray(field.spacing, dtype=np.float64)):
        steps = np.diff(np.moveaxis(net, axis, 0), axis=0)
        jumps = np.abs(steps[3::3] - steps[2:-1:3])
        jump = max(jump, float(np.nanmax(jumps, initial=0.0)) / spacing)
        slope = max(slope, float(np.nanmax(np.abs(steps), initial=0.0)) / spacing)
    return jump / slope if slope else 0.0


@dataclass(frozen=True)
class Coarea:
    """Integrals over all levels of what `LevelMetrics` has for one.

    Parameters
    ----------
    length, turning, bending : float
        Integrals over the levels of length, of absolute turning (radians), and of squared curvature
        integrated along the contours.
    """

    length: float
    turning: float
    bending: float


def coarea(field: BezierField, order: int = 4) -> Coarea:
    """Length, turning and bending of the contours of all levels at once.

    By the coarea formula, with the curvature k of the contour through each point::

        sum over levels of (integral of q along contours) = integral of q |grad f| over the grid

    for q = 1, |k| and k^2, with `order` Gauss points per axis and cell.  NaN cells are left out,
    and so are kinks between cells, which a C1 field does not have.

    Raises
    ------
    ValueError
        For a field that is not 2-D.
    """
    net, spacing, _ = host_arrays(field)
    at, weights = quadrature(order)
    rows = [bernstein_derivative(k, at) for k in range(3)]

    def partial(first: int, second: int) -> np.ndarray:
        values = _sections(_sections(net, rows[first]).T, rows[second]).T
        return values / (spacing[0] ** first * spacing[1] ** second)

    fx, fy = partial(1, 0), partial(0, 1)
    squared = fx * fx + fy * fy
    with np.errstate(divide="ignore", invalid="ignore"):
        bend = partial(2, 0) * fy * fy - 2 * partial(1, 1) * fx * fy + partial(0, 2) * fx * fx
        curvature = np.where(squared > 0, bend / squared**1.5, 0)
    area = np.outer(np.tile(weights, len(fx) // order), np.tile(weights, fx.shape[1] // order))
    area = area * spacing.prod() * np.sqrt(squared)
    length, turning, bending = (
        float(np.nansum(q * area)) for q in (1.0, np.abs(curvature), curvature**2)
    )
    return Coarea(length, turning, bending)


def _sections(net: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Combine the four points of every cell along the first axis with each row of `weights`."""
    fours = np.stack([net[:-1:3], net[1::3], net[2::3], net[3::3]])
    return np.einsum("qa,aij->iqj", weights, fours).reshape(-1, net.shape[1])
