"""Multilinear interpolation, aligned on the samples: what pictures compare with."""

from collections.abc import Sequence

import numpy as np


class BilinearField:
    """The bilinear interpolant of 2-D samples: what contours look like without fairing.

    Parameters
    ----------
    samples
        2-D array.
    spacing
        Distance between samples per axis.
    origin
        Coordinates of sample (0, 0).
    """

    def __init__(
        self,
        samples: np.ndarray,
        spacing: Sequence[float] = (1.0, 1.0),
        origin: Sequence[float] = (0.0, 0.0),
    ) -> None:
        self.samples = np.asarray(samples, dtype=np.float64)
        if self.samples.ndim != 2:
            raise ValueError(f"samples must be 2-D, got {self.samples.ndim}-D")
        self.spacing = tuple(spacing)
        self.origin = tuple(origin)

    @property
    def shape(self) -> tuple[int, ...]:
        """Samples per axis."""
        return self.samples.shape

    def refine(self, factor: int) -> np.ndarray:
        """Values on the grid that is `factor` times finer, ``factor * (n - 1) + 1`` per axis.

        NaN stays within the cells that touch it.
        """
        return refine_linearly(self.samples, factor)


def refine_linearly(values: np.ndarray, factor: int) -> np.ndarray:
    """The multilinear interpolant on the finer grid, any dimension; NaN as in `BilinearField`."""
    for axis in range(values.ndim):
        values = refine_axis_linearly(values, axis, factor)
    return values


def refine_axis_linearly(values: np.ndarray, axis: int, factor: int) -> np.ndarray:
    """The same along one axis, in the precision of the values; these are kept exactly."""
    n = values.shape[axis]
    at = np.arange(factor * (n - 1) + 1) / factor
    cell = np.minimum(at.astype(int), max(n - 2, 0))
    weight = np.expand_dims(at - cell, [k for k in range(values.ndim) if k != axis])
    weight = weight.astype(values.dtype)
    low, high = values.take(cell, axis), values.take(np.minimum(cell + 1, n - 1), axis)
    # In this form a plateau stays one, to the last bit.
    mixed = low + weight * (high - low)
    return np.where(weight == 0, low, np.where(weight == 1, high, mixed))
