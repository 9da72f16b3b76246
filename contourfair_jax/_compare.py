"""Bilinear interpolation beside the fair field: contours, parts that merge and split."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._bilinear import refine_linearly
from ._changes import Change, changes
from ._fair import fair_field
from ._field import BezierField
from ._lengths import LevelMetrics, level_metrics
from ._method import AbstractFairing
from ._tracing import Levels, check_levels

# Changes that are printed.
_LISTED = 10


@dataclass(frozen=True)
class Comparison:
    """Metrics of every level of the bilinear and the fair field; `print` shows a table."""

    bilinear: tuple[LevelMetrics, ...]
    fair: tuple[LevelMetrics, ...]
    changes: tuple[Change, ...]

    def __str__(self) -> str:
        head = (
            f"{'':>12} {'length':>12} {'turning/2pi':>12} {'bending':>12} {'parts':>7} {'holes':>7}"
        )
        rows = [head]
        for name, metrics in (("bilinear", self.bilinear), ("fair", self.fair)):
            total = [sum(values) for values in zip(*map(_figures, metrics), strict=True)] or [0] * 5
            rows.append(
                f"{name:>12} {total[0]:12.5g} {total[1] / (2 * np.pi):12.5g} {total[2]:12.5g} "
                f"{total[3]:7d} {total[4]:7d}"
            )
        counts = {
            kind: sum(change.kind == kind for change in self.changes)
            for kind in ("merged", "split")
        }
        rows.append(f"places merged: {counts['merged']}, split: {counts['split']}")
        rows += [f"  {change}" for change in self.changes[:_LISTED]]
        if len(self.changes) > _LISTED:
            rows.append(f"  and {len(self.changes) - _LISTED} more, in .changes")
        return "\n".join(rows)


def compare(
    values: Float[Array, "ny nx"],
    levels: Levels | None = None,
    *,
    spacing: float | Sequence[float] | Array = 1.0,
    origin: float | Sequence[float] | Array = 0.0,
    method: AbstractFairing | None = None,
    tolerance: float = 1e-3,
) -> Comparison:
    """Contours of the bilinear interpolant beside those of the fair field.

    Parameters
    ----------
    values : array, shape (n_1, n_2)
    levels : float or sequence of float
        By default the 10 inner ones of 12 equally spaced over the range of the samples.
    spacing, origin, method
        As for `fair_field`.
    tolerance : float
        Of the contours, in cells.

    Returns
    -------
    Comparison
        Turning and bending are those of lines with vertices a quarter of the smaller spacing apart.
        Both fields are measured in the cells where the fair one has values.
    """
    if np.ndim(values) != 2:
        raise ValueError(f"values must be 2-D to compare contours, got {np.ndim(values)}-D")
    field = fair_field(values, spacing=spacing, origin=origin, method=method)
    samples = np.asarray(field.samples, dtype=np.float64)
    plain = bilinear_field(field)
    if levels is None:
        finite = samples[np.isfinite(samples)]
        levels = np.linspace(finite.min(), finite.max(), 12)[1:-1] if finite.size else finite
    chosen = check_levels(levels)
    step = 0.25 * float(np.min(np.asarray(field.spacing)))
    lines = [each.contours(chosen, tolerance) for each in (plain, field)]
    metrics = [tuple(level_metrics(each, step, each.levels)) for each in lines]
    return Comparison(metrics[0], metrics[1], tuple(changes(plain, field, lines[1].levels)))


def bilinear_field(field: BezierField) -> BezierField:
    """The bilinear (trilinear) interpolant of a field's samples, in Bezier form; not C1.

    NaN in the cells where the field is NaN, so that both can be measured side by side.
    """
    net = refine_linearly(np.asarray(field.samples, dtype=np.float64), 3)
    net = np.where(np.isnan(np.asarray(field.control_points)), np.nan, net)
    return BezierField(jnp.asarray(net, dtype=field.dtype), field.spacing, field.origin)


def _figures(metrics: LevelMetrics) -> tuple:
    return metrics.length, metrics.turning, metrics.bending, metrics.components, metrics.holes
