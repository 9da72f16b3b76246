"""How fair a field and its contours are: length, turning, bending, parts, crossings, overshoot."""

from collections.abc import Sequence

import numpy as np

from ._coarea import Coarea as Coarea
from ._coarea import SurfaceCoarea as SurfaceCoarea
from ._coarea import coarea as coarea
from ._coarea import surface_coarea as surface_coarea
from ._compare import Comparison as Comparison
from ._compare import bilinear_field as bilinear_field
from ._compare import compare as compare
from ._contour_line import ContourLine
from ._crossings import crossing_pairs
from ._extrema import extrema
from ._field import BezierField
from ._lengths import LevelMetrics as LevelMetrics
from ._lengths import level_metrics as level_metrics
from ._lengths import signed_area as signed_area
from ._surface_metrics import SurfaceMetrics as SurfaceMetrics
from ._surface_metrics import surface_metrics as surface_metrics


def crossings(lines: Sequence[ContourLine]) -> int:
    """How many pairs of segments of all lines meet, other than neighbours on a line.

    Lines of one level and of different levels, and lines with themselves; touching counts.
    """
    return len(crossing_pairs([line.points for line in lines]))


def overshoot(field: BezierField) -> float:
    """How far the field leaves the range of its samples, as a fraction of that range.

    Proved by Bernstein bounds to 1e-9 of the range; 0 for constant samples.  NaN cells are left
    out, 0 if all are.  Any dimension.
    """
    samples = np.asarray(field.samples)
    samples = samples[np.isfinite(samples)]
    if not samples.size or samples.min() == samples.max():
        return 0.0
    low, high = extrema(np.asarray(field.control_points))
    if np.isnan(low):  # no cell is left
        return 0.0
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
