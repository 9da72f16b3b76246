"""A field as NumPy arrays in float64: cells that may hold a level, values and derivatives.

Grid coordinates throughout: sample (i, j, k) lies at (i, j, k).  Any dimension; the batch is last
in arrays of Bezier points, so that each point of all cells is one contiguous vector.
"""

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import jax
import numpy as np

from .._support.arrays import is_traced
from .bernstein import bernstein, bernstein_derivative, derivatives
from .nets import PlacedNet, cell_extreme

Placed = TypeVar("Placed", bound=PlacedNet)
# Points evaluated in one go.
_BATCH = 1 << 14


@dataclass(frozen=True)
class HostField:
    """The control net of a field on the host.

    Parameters
    ----------
    net : array, shape (3 (n_1 - 1) + 1, ...)
        Float64.
    """

    net: np.ndarray

    @classmethod
    def of(cls, field: PlacedNet) -> "HostField":
        """The net of a field, widened; ValueError for one that is not known."""
        return cls(np.asarray(known(field).control_points).astype(np.float64))

    @property
    def ndim(self) -> int:
        """Spatial dimensions."""
        return self.net.ndim

    @property
    def cells(self) -> tuple[int, ...]:
        """Cells along each axis."""
        return tuple((points - 1) // 3 for points in self.net.shape)

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest Bezier point of every cell; NaN where one is NaN."""
        low, high = (cell_extreme(self.net, reduce) for reduce in (np.minimum, np.maximum))
        return low, high

    @cached_property
    def valid(self) -> np.ndarray:
        """Cells whose Bezier points are finite."""
        return np.isfinite(self.bounds[0]) & np.isfinite(self.bounds[1])

    def gather(self, cells: np.ndarray) -> np.ndarray:
        """Bezier points of cells (n, ndim): shape (4, ..., 4, n)."""
        steps = np.array(self.net.strides) // self.net.itemsize
        places = np.indices((4,) * self.ndim).reshape(self.ndim, -1)
        offsets = (steps @ places).reshape((4,) * self.ndim)
        return self.net.reshape(-1)[offsets[..., None] + 3 * (cells @ steps)]

    def locate(self, points: np.ndarray) -> np.ndarray:
        """A cell with values that holds each point (n, ndim), the one above where there are two."""
        highest = np.array(self.cells) - 1
        cell = np.clip(np.floor(points), 0, highest).astype(int)
        wrong = np.flatnonzero(~self.valid[tuple(cell.T)])
        if len(wrong):
            on_face = points[wrong] == cell[wrong]
            for down in itertools.product((0, 1), repeat=self.ndim):
                lower = np.maximum(cell[wrong] - np.array(down) * on_face, 0)
                better = self.valid[tuple(lower.T)] & ~self.valid[tuple(cell[wrong].T)]
                cell[wrong[better]] = lower[better]
        return cell

    def jet(self, points: np.ndarray, order: int) -> list[np.ndarray]:
        """Partial derivatives of orders 0 to `order`, each of shape (derivatives, n).

        NaN outside the grid and in cells without values.
        """
        parts = [
            self._jet(points[start : start + _BATCH], order)
            for start in range(0, max(len(points), 1), _BATCH)
        ]
        return [np.concatenate(same, axis=1) for same in zip(*parts, strict=True)]

    def _jet(self, points: np.ndarray, order: int) -> list[np.ndarray]:
        inside = np.all((points >= 0) & (points <= np.array(self.cells)), axis=1)
        points = np.where(inside[:, None], points, 0.0)
        cell = self.locate(points)
        local = (points - cell).T
        partials: dict[tuple[int, ...], np.ndarray] = {(): self.gather(cell)}
        for t in local:
            rows = [bernstein_derivative(k, t).T for k in range(order + 1)]
            partials = {
                (*counts, k): np.einsum("kn,k...n->...n", rows[k], part)
                for counts, part in partials.items()
                for k in range(order + 1 - sum(counts))
            }
        return [
            np.stack(
                [
                    np.where(
                        inside, partials[tuple(axes.count(k) for k in range(self.ndim))], np.nan
                    )
                    for axes in derivatives(n, self.ndim)
                ]
            )
            for n in range(order + 1)
        ]


def known(field: Placed) -> Placed:
    """The field with known arrays, also of one that is being differentiated.

    Raises
    ------
    ValueError
        Inside `jax.jit` and `jax.vmap`.
    """
    leaves, kind = jax.tree.flatten(field)
    # What NumPy holds, in float64, would become arrays of JAX, which may be narrower.
    arrays = [x if isinstance(x, np.ndarray) else jax.lax.stop_gradient(x) for x in leaves]
    field = jax.tree.unflatten(kind, arrays)
    if is_traced(*jax.tree.leaves(field)):
        raise ValueError(
            "field must be known where contours, surfaces or grids are found in it, got one traced "
            "by jax.jit or jax.vmap; find them outside, and follow them inside with "
            "contourfair_jax.geometry"
        )
    return field


def lattice_values(fours: np.ndarray, factor: int) -> np.ndarray:
    """Values of cells on their lattice of `factor` steps, shape (factor + 1, ..., n).

    Sums of products in one fixed order: cells agree on the faces that they share, bit for bit.
    """
    weights = bernstein(3, np.arange(factor + 1) / factor)
    values = fours
    for axis in range(fours.ndim - 1):
        p = np.moveaxis(values, axis, 0)
        rows = [((w[0] * p[0] + w[1] * p[1]) + w[2] * p[2]) + w[3] * p[3] for w in weights]
        values = np.moveaxis(np.stack(rows), 0, axis)
    return values
