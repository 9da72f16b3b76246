"""Figures of whole fields: what leaves the range of the samples, and jumps of slopes."""

import numpy as np

from .._bezier.subdivision import extrema
from .._field import BezierField


def overshoot(field: BezierField) -> float:
    """Distance of the field from the range of its samples, as a fraction of that range.

    Parameters
    ----------
    field : BezierField
        Of any dimension.  Cells that hold NaN are left out.

    Returns
    -------
    float
        Proved by Bernstein bounds to 1e-9 of the range; 0 for constant samples, and where no cell
        is left.
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

    Parameters
    ----------
    field : BezierField
        Of any dimension.  Jumps and derivatives that are NaN are left out.

    Returns
    -------
    float
        Rounding only where the field is C1.
    """
    net = np.asarray(field.control_points, dtype=np.float64)
    jump = slope = 0.0
    for axis, spacing in enumerate(np.asarray(field.spacing, dtype=np.float64)):
        steps = np.diff(np.moveaxis(net, axis, 0), axis=0)
        jumps = np.abs(steps[3::3] - steps[2:-1:3])
        jump = max(jump, float(np.nanmax(jumps, initial=0.0)) / spacing)
        slope = max(slope, float(np.nanmax(np.abs(steps), initial=0.0)) / spacing)
    return jump / slope if slope else 0.0
