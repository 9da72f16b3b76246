"""Multilinear interpolation beside the fair field, level by level."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ParamSpec

import jax.numpy as jnp
import numpy as np

from .._bezier.linear import refine_linearly
from .._fair import fair_field
from .._field import BezierField
from .._level_sets import Levels, check_levels
from .._support.checks import Scalar
from .._support.public import warn_former
from ._lines import LevelMetrics, level_metrics
from ._parts import Change, changes
from ._surfaces import SurfaceMetrics, level_surfaces

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

# In cells: of contours, and of isosurfaces.
TOLERANCES = {2: 1e-3, 3: 0.05}


def measured(
    field: BezierField,
    levels: Sequence[float] | np.ndarray,
    tolerance: Scalar | None = None,
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


# Changes that are printed.
_LISTED = 10
# What `compare` took of `fair_field`.
_SETTINGS = ("spacing", "origin", "method")
Params = ParamSpec("Params")


@dataclass(frozen=True)
class Comparison:
    """Metrics of every level of the bilinear (trilinear) and the fair field, lowest first.

    `print` shows sums over the levels in a table.

    Parameters
    ----------
    bilinear, fair : tuple of LevelMetrics, or of SurfaceMetrics for volumes
    changes : tuple of Change
        Where parts merge and split.
    """

    bilinear: tuple[LevelMetrics, ...] | tuple[SurfaceMetrics, ...]
    fair: tuple[LevelMetrics, ...] | tuple[SurfaceMetrics, ...]
    changes: tuple[Change, ...]

    def __str__(self) -> str:
        volume = any(isinstance(each, SurfaceMetrics) for each in self.fair)
        ndim, plain = (3, "trilinear") if volume else (2, "bilinear")
        rows = [f"{'':>12}" + "".join(f" {column:>12}" for column in COLUMNS[ndim])]
        for name, metrics in ((plain, self.bilinear), ("fair", self.fair)):
            table = np.array([figures(each, ndim) for each in metrics])
            totals = table.reshape(-1, len(COLUMNS[ndim])).sum(axis=0)
            rows.append(f"{name:>12}" + "".join(f" {total:12.5g}" for total in totals))
        counts = {
            kind: sum(change.kind == kind for change in self.changes)
            for kind in ("merged", "split")
        }
        rows.append(f"places merged: {counts['merged']}, split: {counts['split']}")
        rows += [f"  {change}" for change in self.changes[:_LISTED]]
        if len(self.changes) > _LISTED:
            rows.append(f"  and {len(self.changes) - _LISTED} more, in .changes")
        return "\n".join(rows)


def _formerly_of_values(compare: Callable[Params, Comparison]) -> Callable[Params, Comparison]:
    """A decorator: samples are faired, as before, with the settings of `fair_field`."""

    @functools.wraps(compare)
    def call(*args: Any, **kwargs: Any) -> Comparison:
        if (args and isinstance(args[0], BezierField)) or "field" in kwargs:
            return compare(*args, **kwargs)
        warn_former("compare(values, ...)", "compare(fair_field(values, ...), ...)")
        if not args:
            args = (kwargs.pop("values"),)
        settings = {name: kwargs.pop(name) for name in _SETTINGS if name in kwargs}
        return compare(fair_field(args[0], **settings), *args[1:], **kwargs)  # pyright: ignore

    return call


@_formerly_of_values
def compare(
    field: BezierField, levels: Levels | None = None, *, tolerance: Scalar | None = None
) -> Comparison:
    """Contours, or isosurfaces, of the multilinear interpolant beside those of a field.

    Parameters
    ----------
    field : BezierField
    levels : float or sequence of float
        By default the 10 inner ones of 12 equally spaced over the range of the samples.
    tolerance : float
        Of the contours or isosurfaces, in cells; by default 1e-3 of contours, 0.05 of isosurfaces.

    Returns
    -------
    Comparison
        Turning and bending are those of lines with vertices a quarter of the smaller spacing apart;
        the bending of a trilinear isosurface has that of its kinks in it, each rounded over a
        quarter of the smallest spacing.  Parts of volumes are followed from sample to sample
        on grids of half the spacing: what the fair field has between these is not in `changes`.
        Both fields are measured in the cells where the given one has values.

    Raises
    ------
    ValueError
        For levels that are not finite, and for a field that is traced.
    """
    samples = np.asarray(field.samples, dtype=np.float64)
    plain = bilinear_field(field)
    if levels is None:
        finite = samples[np.isfinite(samples)]
        levels = np.linspace(finite.min(), finite.max(), 12)[1:-1] if finite.size else finite
    chosen = check_levels(levels)
    before, after = (measured(one, chosen, tolerance) for one in (plain, field))
    parts = changes(plain, field, [metrics.level for metrics in after])
    return Comparison(before, after, tuple(parts))


def bilinear_field(field: BezierField) -> BezierField:
    """The bilinear (trilinear) interpolant of a field's samples, in Bezier form; not C1.

    NaN in the cells where the field is NaN, so that both can be measured side by side.
    """
    net = refine_linearly(np.asarray(field.samples, dtype=np.float64), 3)
    net = np.where(np.isnan(np.asarray(field.control_points)), np.nan, net)
    return BezierField(jnp.asarray(net, dtype=field.dtype), field.spacing, field.origin)
