"""Bilinear interpolation beside the fair field: contours, parts that merge and split."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._bilinear import refine_linearly
from ._cells import cells_with_values
from ._components import components
from ._fair import fair_field
from ._field import BezierField
from ._lengths import LevelMetrics, level_metrics
from ._method import AbstractFairing
from ._tracing import Levels, check_levels

_FACTOR = 4
# Changes that are printed.
_LISTED = 10


@dataclass(frozen=True)
class Change:
    """Parts above (or below) a level that the fair field joins or separates.

    Parameters
    ----------
    level : float
    kind : str
        "merged" or "split", going from bilinear to fair.
    side : str
        "above" or "below": summits and ridges, or basins and valleys.
    parts : int
        How many parts became one, or one became.
    position : tuple of float
        The extreme sample of the smallest of these parts.
    """

    level: float
    kind: str
    side: str
    parts: int
    position: tuple[float, float]

    def __str__(self) -> str:
        where = ", ".join(f"{x:g}" for x in self.position)
        return f"level {self.level:g}, {self.side}: {self.parts} parts {self.kind} at ({where})"


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


def changes(
    plain: BezierField,
    field: BezierField,
    levels: Sequence[float],
    step: Callable[[], None] = lambda: None,
) -> list[Change]:
    """Parts of the bilinear field that the fair one merges and splits, where both have values.

    Both are followed on a refined grid.  The bilinear one is the same on any; halved cells have
    points within, which say that a cell has no values where all of its samples do.

    `step` is called after each level.
    """
    samples = np.asarray(field.samples, dtype=np.float64)
    valid = np.logical_and(
        *(cells_with_values(np.asarray(each.control_points)) for each in (plain, field))
    )
    coarse, finer = _refined(plain, 2, valid), _refined(field, _FACTOR, valid)
    found = []
    for level in levels:
        for side, sign in (("above", 1.0), ("below", -1.0)):
            before = components(sign * coarse, sign * level)[::2, ::2]
            after = components(sign * finer, sign * level)[::_FACTOR, ::_FACTOR]
            for kind, one, other in (("merged", before, after), ("split", after, before)):
                for parts, at in _joined(one, other, sign * samples):
                    place = np.asarray(field.origin) + np.asarray(field.spacing) * at
                    found.append(Change(level, kind, side, parts, tuple(place.tolist())))
        step()
    return found


def _refined(field: BezierField, factor: int, valid: np.ndarray) -> np.ndarray:
    """The field on a finer grid, NaN away from the valid cells."""
    values = np.asarray(field.refine(factor), dtype=np.float64)
    inside = valid.repeat(factor, 0).repeat(factor, 1)
    near = np.full(values.shape, False)
    for rows in (slice(1, None), slice(-1)):
        for columns in (slice(1, None), slice(-1)):
            near[rows, columns] |= inside
    return np.where(near, values, np.nan)


def _joined(parts: np.ndarray, whole: np.ndarray, samples: np.ndarray) -> list[tuple]:
    """Members of `whole` with several `parts`: how many, and the highest sample of the smallest."""
    inside = (parts >= 0) & (whole >= 0)
    if not inside.any():
        return []
    pairs, sizes = np.unique(np.stack([whole[inside], parts[inside]]), axis=1, return_counts=True)
    joined = []
    number, count = np.unique(pairs[0], return_counts=True)
    for k in number[count > 1].tolist():
        members = np.flatnonzero(pairs[0] == k)
        smallest = pairs[1, members[np.argmin(sizes[members])]]
        where = np.where((parts == smallest) & (whole == k), samples, -np.inf)
        joined.append((len(members), np.array(np.unravel_index(where.argmax(), where.shape))))
    return joined
