"""Contours and isosurfaces of all levels at once, by the coarea formula."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .._bezier.bernstein import bernstein_derivative, derivatives, quadrature
from .._bezier.curvature import host_mean_curvature
from .._bezier.host import known
from .._field import BezierField

# Gauss points worked on in one go, at least one slab of cells.
_POINTS = 1 << 20


@dataclass(frozen=True)
class Coarea:
    """Integrals over all levels of what `LevelMetrics` has for one; of a 2-D field.

    Parameters
    ----------
    length, turning, bending : float
        Integrals over the level of length, of absolute turning (radians), and of squared curvature
        integrated along the contours.  Their units are those of the values times those of length,
        radians, and one over length.
    """

    length: float
    turning: float
    bending: float


@dataclass(frozen=True)
class SurfaceCoarea:
    """Integrals over all levels of what `SurfaceMetrics` has for one; of a 3-D field.

    Parameters
    ----------
    area, bending : float
        Integrals over the level of area, and of squared mean curvature integrated over the
        isosurfaces.  Their units are those of the values times those of area, and those of the
        values.
    """

    area: float
    bending: float


def coarea(field: BezierField, order: int = 4) -> Coarea | SurfaceCoarea:
    """Integrals over all levels of what their contours, or isosurfaces, have.

    By the coarea formula, with the (mean) curvature k of the level set through each point::

        integral over the level of (integral of q along level sets) = integral of q |grad f|

    over the grid, for q = 1, |k| and k^2 (no |k| in 3-D), with `order` Gauss points per axis and
    cell.  NaN cells are left out, and so are kinks between cells, which a C1 field does not have.

    Returns
    -------
    Coarea or SurfaceCoarea
        Length, turning and bending of a 2-D field; area and bending of a 3-D one.

    Raises
    ------
    ValueError
        For a field that is traced.

    Examples
    --------
    Spheres of radius r have an area of 4 pi r^2 and a bending of 4 pi, whatever the level is:

    >>> import numpy as np
    >>> import contourfair_jax as cf
    >>> from contourfair_jax import metrics
    >>> x = np.linspace(1.0, 2.0, 5)
    >>> radius = np.sqrt(x[:, None, None] ** 2 + x[:, None] ** 2 + x**2)
    >>> round(metrics.coarea(cf.fair_field(radius, spacing=0.25, origin=1.0)).area, 3)
    1.0
    """
    size, turning, bending = _sums(field, order)
    if field.ndim == 3:
        return SurfaceCoarea(size, bending)
    return Coarea(size, turning, bending)


def _sums(field: BezierField, order: int) -> list[float]:
    """Integrals of 1, |H| and H^2 times |grad f|, with H the mean of the principal curvatures."""
    parts = [
        [np.nansum(measure), np.nansum(np.abs(bend) * measure), np.nansum(bend**2 * measure)]
        for measure, bend in _slabs(field, order)
    ]
    return np.sum(parts, axis=0).tolist()


def _slabs(field: BezierField, order: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """`|grad f|` times the weight, and mean curvature, at the Gauss points of slabs of cells."""
    field, ndim = known(field), field.ndim
    net, spacing = np.asarray(field.control_points), np.asarray(field.spacing, dtype=np.float64)
    cells = [n - 1 for n in field.shape]
    at, weights = quadrature(order)
    rows = [bernstein_derivative(k, at) for k in range(3)]
    step = max(1, _POINTS // (order**ndim * math.prod(cells[1:])))
    for start in range(0, cells[0], step):
        part = net[3 * start : 3 * min(start + step, cells[0]) + 1].astype(np.float64)
        partials: dict[tuple[int, ...], np.ndarray] = {(): part}
        for axis, length in enumerate(spacing):
            partials = {
                (*counts, k): _sections(values, axis, rows[k] / length**k)
                for counts, values in partials.items()
                for k in range(3 - sum(counts))
            }
        gradient, second = (
            [partials[tuple(axes.count(k) for k in range(ndim))] for axes in derivatives(n, ndim)]
            for n in (1, 2)
        )
        measure, bend = host_mean_curvature(gradient, second)
        for axis, length in enumerate(spacing):
            along = np.repeat(weights * length, measure.shape[axis] // order)
            measure = measure * np.expand_dims(along, [k for k in range(ndim) if k != axis])
        yield measure, bend


def _sections(net: np.ndarray, axis: int, weights: np.ndarray) -> np.ndarray:
    """Combine the four points of every cell along an axis with each row of `weights`.

    First all cells with the first row, then all with the next.
    """
    p = np.moveaxis(net, axis, 0)
    fours = np.stack([p[:-1:3], p[1::3], p[2::3], p[3::3]])
    mixed = np.tensordot(weights, fours, 1)
    return np.moveaxis(mixed.reshape(-1, *p.shape[1:]), 0, axis)
