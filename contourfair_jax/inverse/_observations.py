"""Observations of a field, each kind of data with its noise; combined by `fit_samples`."""

import abc
from collections.abc import Iterator, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._bezier.bernstein import bernstein, quadrature
from .._support import checks
from .._support.arrays import is_traced
from ..contours import ContourLine
from ._extent import Extent, check_finite, check_sigma, padded
from ._misfits import AbstractMisfit, Averages, Margins, PointSlopes, PointValues


class AbstractObservation(eqx.Module):
    """Data about a field."""

    @abc.abstractmethod
    def prepare(self, extent: Extent) -> tuple[AbstractMisfit, int]:
        """The data as arrays in the dtype of the fit, and how many there are.

        More data of no weight follow, so that not every number of data compiles anew.

        Raises ValueError for data that do not fit the grid.
        """


class Values(AbstractObservation):
    """Values of the field at scattered points.

    Parameters
    ----------
    points : array, shape (n, ndim)
        Physical coordinates, within the grid.
    values : array, shape (n,)
    sigma : float or array, shape (n,)
        Standard deviation of the noise, in units of the values.

    Raises
    ------
    ValueError
        For shapes that do not fit each other, NaN, or a sigma that is not above zero.
    """

    points: ArrayLike
    values: ArrayLike
    sigma: ArrayLike = 1.0

    def __check_init__(self):
        shape = _check_points(self.points, "Values")[:1]
        _check_shape(self.values, shape, "values of Values")
        check_finite(self.values, "values of Values")
        check_sigma(self.sigma, shape, "Values")

    def prepare(self, extent):
        return _point_values(self.points, self.values, self.sigma, extent, "Values")


class Slopes(AbstractObservation):
    """Gradients of the field at scattered points.

    Parameters
    ----------
    points : array, shape (n, ndim)
        Physical coordinates, within the grid.
    gradients : array, shape (n, ndim)
        In units of value per length.
    sigma : float or array, shape (n,)
        Standard deviation of the noise of each component, in units of the gradients.

    Raises
    ------
    ValueError
        As for `Values`.
    """

    points: ArrayLike
    gradients: ArrayLike
    sigma: ArrayLike = 1.0

    def __check_init__(self):
        shape = _check_points(self.points, "Slopes")
        _check_shape(self.gradients, shape, "gradients of Slopes")
        check_finite(self.gradients, "gradients of Slopes")
        check_sigma(self.sigma, shape[:1], "Slopes")

    def prepare(self, extent):
        points, sigma, count = _sites(self.points, self.sigma, extent, "Slopes")
        return PointSlopes(points, padded(self.gradients, extent.dtype), sigma), count


class ContourLines(AbstractObservation):
    """Digitised contour lines: along each the field has the value of its level.

    Parameters
    ----------
    lines : sequence of ContourLine, or of pairs (level, points of shape (n, ndim))
        Polylines in physical coordinates, such as `field.contours` returns.
    sigma : float
        Standard deviation of the field along a line, for each length of one sample distance.
    step : float or None
        Distance along a line at which it is compared; half the smallest spacing by default.  It
        hardly changes the result: the weight of a point is that of the length it stands for.

    Raises
    ------
    ValueError
        For no lines, NaN, or a sigma or a step that is not above zero.
    """

    lines: tuple[tuple[float, np.ndarray], ...]
    sigma: float = 1.0
    step: float | None = None

    def __init__(
        self,
        lines: Sequence[ContourLine] | Sequence[tuple[float, ArrayLike]],
        sigma: float = 1.0,
        step: float | None = None,
    ):
        self.lines = tuple(_as_pairs(lines))
        self.sigma, self.step = sigma, step
        if not self.lines:
            raise ValueError("lines of ContourLines must hold at least one line, got none")
        for level, points in self.lines:
            _check_points(points, "ContourLines")
            check_finite(level, "levels of ContourLines")
        check_sigma(sigma, (), "ContourLines")
        if step is not None:
            checks.check_real(step, "step of ContourLines", open_below=True)

    def prepare(self, extent):
        if is_traced(extent.spacing):
            raise ValueError(
                "spacing must be known for ContourLines, which are cut into pieces of about its "
                "length, got a traced array; give it as numbers"
            )
        smallest = float(np.min(np.asarray(extent.spacing)))
        step = smallest / 2 if self.step is None else self.step
        pieces = [along(points, step) for _, points in self.lines]
        counts = [len(points) for points, _ in pieces]
        levels = np.repeat([level for level, _ in self.lines], counts)
        lengths = np.repeat([length for _, length in pieces], counts)
        sigma = self.sigma * np.sqrt(smallest / lengths)
        points = np.concatenate([points for points, _ in pieces])
        return _point_values(points, levels, sigma, extent, "ContourLines")


class Masks(AbstractObservation):
    """Points inside, where the field is above a level, and points outside.

    A point counts by how far the field is short of `level + sigma` inside, or above
    `level - sigma` outside; beyond that it does not count (a squared hinge).

    Parameters
    ----------
    points : array, shape (n, ndim)
        Physical coordinates, within the grid: for a mask of pixels, their centres.
    inside : bool array, shape (n,)
    level : float
    sigma : float or array, shape (n,)
        The margin, in units of the values, and the unit of what falls short of it.

    Raises
    ------
    ValueError
        As for `Values`; also for an `inside` that is not boolean.
    """

    points: ArrayLike
    inside: ArrayLike
    level: ArrayLike = 0.5
    sigma: ArrayLike = 0.1

    def __check_init__(self):
        shape = _check_points(self.points, "Masks")[:1]
        _check_shape(self.inside, shape, "inside of Masks")
        kind = jnp.result_type(self.inside)
        if kind != np.bool_:
            raise ValueError(
                f"inside of Masks must be boolean, got {kind}; compare, as in mask > 0"
            )
        if jnp.shape(self.level) != ():
            raise ValueError(
                f"level of Masks must be one number, got shape {jnp.shape(self.level)}"
            )
        check_finite(self.level, "level of Masks")
        check_sigma(self.sigma, shape, "Masks")

    def prepare(self, extent):
        points, sigma, count = _sites(self.points, self.sigma, extent, "Masks")
        signs = padded(jnp.where(jnp.asarray(self.inside), 1, -1), extent.dtype)
        margin = jnp.where(jnp.isinf(sigma), 0, sigma)
        return Margins(points, signs, jnp.asarray(self.level, extent.dtype), margin, sigma), count


def along(points: np.ndarray, step: float) -> tuple[np.ndarray, float]:
    """Points at equal distances, about `step`, along a polyline; that distance."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    total = float(lengths.sum())
    if total == 0:
        return points[:1], step
    count = max(1, round(total / step))
    at = (np.arange(count) + 0.5) * (total / count)
    known = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.stack([np.interp(at, known, column) for column in points.T], -1), total / count


def _point_values(
    points: ArrayLike, values: ArrayLike, sigma: ArrayLike, extent: Extent, kind: str
) -> tuple[PointValues, int]:
    sites, deviations, count = _sites(points, sigma, extent, kind)
    return PointValues(sites, padded(values, extent.dtype), deviations), count


def _sites(
    points: ArrayLike, sigma: ArrayLike, extent: Extent, kind: str
) -> tuple[Array, Array, int]:
    """Points and their sigma, padded by points of infinite sigma; how many there were."""
    inside = extent.check_inside(points, kind)
    count = inside.shape[0]
    deviations = jnp.broadcast_to(jnp.asarray(sigma, extent.dtype), (count,))
    return padded(inside, extent.dtype), padded(deviations, extent.dtype, jnp.inf), count


def _as_pairs(lines: Sequence) -> Iterator[tuple[float, np.ndarray]]:
    for line in lines:
        try:
            level, points = (line.level, line.points) if isinstance(line, ContourLine) else line
            pair = float(level), np.asarray(points, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(
                "lines of ContourLines must be pairs (level, points) of numbers, or ContourLine, "
                f"got {checks.describe(line)}"
            ) from None
        yield pair


def _check_points(points: ArrayLike, kind: str) -> tuple[int, ...]:
    shape = np.shape(points)
    if len(shape) != 2 or shape[1] not in checks.DIMENSIONS:
        raise ValueError(
            f"points of {kind} must have shape (n, ndim) with 2 or 3 coordinates, got {shape}; "
            "stack the coordinates along the last axis"
        )
    if shape[0] == 0:
        raise ValueError(f"points of {kind} must hold at least one, got none; leave it out instead")
    check_finite(points, f"points of {kind}")
    return shape


def _check_shape(array: ArrayLike, shape: tuple[int, ...], name: str) -> None:
    if np.shape(array) != shape:
        raise ValueError(
            f"{name} must have shape {shape}, as the points say, got {np.shape(array)}"
        )


class BoxAverages(AbstractObservation):
    """Averages of the field over a regular grid of boxes, as pixels or voxels of a sensor.

    Box (i, j) reaches from `corner + (i, j) * size` to `corner + (i + 1, j + 1) * size`.  The
    field is integrated exactly.

    Parameters
    ----------
    values : array, shape (m_1, ..., m_d)
        The averages.
    size : float or sequence of ndim floats
        Edges of a box in physical units, of any length.
    corner : float or sequence of ndim floats, or None
        The corner of the first box; where the grid begins by default.
    sigma : float or array, shape (m_1, ..., m_d)
        Standard deviation of the noise.

    Raises
    ------
    ValueError
        For NaN, or a sigma that is not above zero.
    """

    values: ArrayLike
    size: ArrayLike | Sequence[float]
    corner: ArrayLike | Sequence[float] | None = None
    sigma: ArrayLike = 1.0

    def __check_init__(self):
        shape = np.shape(self.values)
        if len(shape) not in checks.DIMENSIONS or 0 in shape:
            raise ValueError(
                f"values of BoxAverages must be 2-D or 3-D averages, got shape {shape}"
            )
        check_finite(self.values, "values of BoxAverages")
        check_sigma(self.sigma, shape, "BoxAverages")

    def prepare(self, extent):
        shape, ndim = np.shape(self.values), extent.ndim
        if len(shape) != ndim:
            raise ValueError(f"values of BoxAverages must have {ndim} axes, got shape {shape}")
        corner = extent.origin if self.corner is None else self.corner
        size = checks.check_per_axis(self.size, ndim, "size", positive=True)
        corner = checks.check_per_axis(corner, ndim, "corner")
        if is_traced(size, corner, extent.spacing, extent.origin):
            raise ValueError(
                "BoxAverages must know where its boxes lie, got a traced size, corner, spacing or "
                "origin; give them as numbers"
            )
        unit, origin = np.asarray(extent.spacing, float), np.asarray(extent.origin, float)
        first = (np.asarray(corner, float) - origin) / unit
        widths = np.asarray(size, float) / unit
        ends = np.asarray(corner, float) + np.asarray(size, float) * np.array([[0] * ndim, shape])
        extent.check_inside(ends, "BoxAverages")
        matrices = []
        for axis, (boxes, samples) in enumerate(zip(shape, extent.shape, strict=True)):
            edges = first[axis] + widths[axis] * np.arange(boxes + 1)
            matrices.append(jnp.asarray(interval_averages(edges, samples), extent.dtype))
        values = jnp.asarray(self.values, extent.dtype)
        sigma = jnp.broadcast_to(jnp.asarray(self.sigma, extent.dtype), shape)
        return Averages(values=values, weights=tuple(matrices), sigma=sigma), shape[0]


def interval_averages(edges: Float[np.ndarray, " edges"], count: int) -> np.ndarray:
    """Weights of the 3 (count - 1) + 1 Bezier points in the averages over m intervals.

    `edges` are in units of the spacing.  Two Gauss points integrate a cubic exactly.
    """
    cells = np.arange(count - 1)
    low = np.clip(edges[:-1, None] - cells, 0, 1)
    high = np.clip(edges[1:, None] - cells, 0, 1)
    nodes, halves = quadrature(2)
    at = low[..., None] + (high - low)[..., None] * nodes
    share = (high - low) / np.diff(edges)[:, None]
    parts = share[..., None] * np.einsum("mcqk,q->mck", bernstein(3, at), halves)
    weights = np.zeros((len(edges) - 1, 3 * count - 2))
    for k in range(4):
        weights[:, k + 3 * cells] += parts[..., k]
    return weights
