"""Analytic fields whose truth between the samples is known.

Every case lives on ``[-1, 1]^d`` with ``size`` samples per axis, ends included, and ``x`` along
axis 0.  ``Case.truth`` is the same field on the grid refined ``factor`` times, so a
reconstruction is compared with it sample by sample, aligned.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """One analytic field and how finely it is sampled.

    Parameters
    ----------
    name : str
        What tables call it.
    size : int
        Samples per axis.
    function : callable
        Takes ``ndim`` coordinate arrays, returns the values.
    ndim : int
        Dimensions.
    factor : int
        Refinement at which truth and reconstruction are compared.
    margin : int
        Cells left out at every border.
    """

    name: str
    size: int
    function: Callable[..., Array]
    ndim: int = 2
    factor: int = 8
    margin: int = 0

    def _evaluate(self, count: int) -> Array:
        axis = np.linspace(-1.0, 1.0, count)
        return self.function(*np.meshgrid(*[axis] * self.ndim, indexing="ij"))

    @property
    def spacing(self) -> float:
        """Distance between samples."""
        return 2.0 / (self.size - 1)

    def samples(self) -> Array:
        """Values at the samples, shape ``(size,) * ndim``."""
        return self._evaluate(self.size)

    def truth(self) -> Array:
        """Values on the refined grid."""
        return self._evaluate((self.size - 1) * self.factor + 1)

    def interior(self, refined: Array) -> Array:
        """Cut ``margin`` cells off a refined grid."""
        cut = self.margin * self.factor
        return refined[(slice(cut, refined.shape[0] - cut),) * self.ndim]


def ridge(x: Array, y: Array) -> Array:
    """Thin oblique ridge, about two samples wide at 10 x 10."""
    return np.exp(-((4.5 * (x - 0.8 * y)) ** 2))


def step(x: Array, y: Array) -> Array:
    """Oblique edge, a logistic step."""
    return 1.0 / (1.0 + np.exp(15.0 * (x - 0.6 * y)))


def disk(x: Array, y: Array) -> Array:
    """Disk of radius 0.6 with a blurred rim."""
    return 1.0 / (1.0 + np.exp(12.0 * (np.hypot(x, y) - 0.6)))


def marschner_lobb(x: Array, y: Array, z: Array) -> Array:
    """Test signal of Marschner and Lobb (1994), ``f_M = 6``, ``alpha = 0.25``."""
    ripple = np.cos(12.0 * np.pi * np.cos(np.pi * np.hypot(x, y) / 2.0))
    return (1.0 - np.sin(np.pi * z / 2.0) + 0.25 * (1.0 + ripple)) / 2.5


def marschner_lobb_gradient(x: Array, y: Array, z: Array) -> Array:
    """Gradient of `marschner_lobb`, shape ``(..., 3)``."""
    radius = np.hypot(x, y)
    phase = 12.0 * np.pi * np.cos(np.pi * radius / 2.0)
    # d ripple / d r = sin(phase) * 6 pi^2 sin(pi r / 2); divided by r for the chain rule.
    slope = np.sin(phase) * 6.0 * np.pi**2 * (np.pi / 2.0) * np.sinc(radius / 2.0)
    return np.stack(
        [0.1 * slope * x, 0.1 * slope * y, -np.pi / 5.0 * np.cos(np.pi * z / 2.0)], axis=-1
    )


def marschner_lobb_slice(x: Array, y: Array) -> Array:
    """Plane ``z = 0`` of `marschner_lobb`."""
    return marschner_lobb(x, y, np.zeros_like(x))


def franke(x: Array, y: Array) -> Array:
    """Franke's function, its unit square mapped to ``[-1, 1]^2``."""
    u, v = 4.5 * (x + 1.0), 4.5 * (y + 1.0)
    return (
        0.75 * np.exp(-((u - 2.0) ** 2 + (v - 2.0) ** 2) / 4.0)
        + 0.75 * np.exp(-((u + 1.0) ** 2) / 49.0 - (v + 1.0) / 10.0)
        + 0.5 * np.exp(-((u - 7.0) ** 2 + (v - 3.0) ** 2) / 4.0)
        - 0.2 * np.exp(-((u - 4.0) ** 2) - (v - 7.0) ** 2)
    )


@lru_cache(maxsize=1)
def _random_grid() -> Array:
    noise = np.random.default_rng(0).standard_normal((241, 241))
    smooth = ndimage.gaussian_filter(noise, 12.0, mode="wrap")
    return smooth / smooth.std()


def smooth_random(x: Array, y: Array) -> Array:
    """Filtered white noise, defined on the 241 x 241 grid only."""
    rows, columns = (np.rint((c + 1.0) * 120.0).astype(int) for c in (x, y))
    return _random_grid()[rows, columns]


PLANE = (
    Case("thin diagonal ridge 10x10", 10, ridge),
    Case("oblique step 10x10", 10, step),
    Case("blurred disk 10x10", 10, disk),
    Case("Marschner-Lobb slice 41x41", 41, marschner_lobb_slice),
    Case("Franke 12x12", 12, franke),
    Case("cone 10x10", 10, np.hypot),
    Case("smooth random 31x31", 31, smooth_random),
)
VOLUME = Case("Marschner-Lobb 41^3, interior", 41, marschner_lobb, ndim=3, factor=4, margin=4)
