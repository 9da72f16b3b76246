"""Metrics of the level sets of a field, level by level, and the columns of their table."""

from collections.abc import Callable, Sequence

import numpy as np

from ._field import BezierField
from ._lengths import LevelMetrics, level_metrics
from ._surface_metrics import SurfaceMetrics, level_surfaces

# By dimension: the columns, each a figure of the metrics and what it is divided by.
COLUMNS = {
    2: {
        "length": ("length", 1),
        "turning/2pi": ("turning", 2 * np.pi),
        "bending": ("bending", 1),
        "parts": ("components", 1),
        "holes": ("holes", 1),
    },
    3: {
        "area": ("area", 1),
        "bending/4pi": ("bending", 4 * np.pi),
        "parts": ("components", 1),
        "Euler": ("euler_characteristic", 1),
    },
}
# Of contours and of isosurfaces, in cells.
TOLERANCES = {2: 1e-3, 3: 0.05}


def measured(
    field: BezierField,
    levels: Sequence[float] | np.ndarray,
    tolerance: float | None = None,
    moved: Callable[[], None] = lambda: None,
) -> tuple[LevelMetrics, ...] | tuple[SurfaceMetrics, ...]:
    """Metrics of sorted levels, without those too close to the one below; `moved` for each."""
    tolerance = TOLERANCES[field.ndim] if tolerance is None else tolerance
    if field.ndim == 3:
        return tuple(level_surfaces(field, levels, tolerance, moved))
    lines = field.contours(levels, tolerance)
    step = 0.25 * float(np.min(np.asarray(field.spacing)))
    found = tuple(level_metrics(lines, step, lines.levels))
    for _ in levels:
        moved()
    return found


def figures(metrics: LevelMetrics | SurfaceMetrics, ndim: int) -> list[float]:
    """A row of the table."""
    found = [(getattr(metrics, name), unit) for name, unit in COLUMNS[ndim].values()]
    return [value if unit == 1 else value / unit for value, unit in found]  # counts stay whole
