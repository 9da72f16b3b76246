"""The master table of test fields: a new case is one row.

``FIELDS[name].samples(shape, rng)`` gives float64 samples for any shape of 2 or 3 axes that the
field supports; ``GRIDS`` are the shapes and spacings they are put on, and
``grid_field_cases(2, 3)`` is every field on every grid.  ``ANALYTIC`` are the fields of known
truth: functions of coordinates on ``[-1, 1]^d``, with their own grid.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest


@dataclass(frozen=True)
class Field:
    """How to make samples; `rough` says that they do not resolve the feature they show."""

    build: Callable
    ndims: tuple = (2, 3)
    rough: bool = False

    def samples(self, shape, rng):
        """Float64 samples of this field on `shape`."""
        values = np.asarray(self.build(tuple(shape), rng), float)
        assert values.shape == tuple(shape)
        return values


@dataclass(frozen=True)
class Grid:
    """A number of samples and a distance between them per axis."""

    shape: tuple
    spacing: tuple

    @property
    def ndim(self):
        return len(self.shape)

    @property
    def name(self):
        return "x".join(map(str, self.shape)) + "@" + ",".join(f"{h:g}" for h in self.spacing)


@dataclass(frozen=True)
class Analytic:
    """A field known everywhere on ``[-1, 1]^d``, sampled with `size` points per axis."""

    truth: Callable
    ndim: int
    size: int

    def points(self, size=None):
        """Grid points, one array per axis, both ends included."""
        size = self.size if size is None else size
        return np.meshgrid(*[np.linspace(-1, 1, size)] * self.ndim, indexing="ij")

    def samples(self, size=None):
        """Samples of the truth with `size` points per axis."""
        return self.truth(*self.points(size))

    def refined(self, factor):
        """The truth on the grid `factor` times finer that contains the samples."""
        return self.samples((self.size - 1) * factor + 1)

    @property
    def spacing(self):
        """Distance between samples, per axis."""
        return (2 / (self.size - 1),) * self.ndim


# Fields of known truth -------------------------------------------------------------------


def ridge(x, y):
    return np.exp(-((4.5 * (x - 0.8 * y)) ** 2))


def step(x, y):
    return 1 / (1 + np.exp(15 * (x - 0.6 * y)))


def disk(x, y):
    return 1 / (1 + np.exp(12 * (np.hypot(x, y) - 0.6)))


def marschner_lobb(x, y, z=0.0):
    r = np.hypot(x, y)
    waves = 0.25 * (1 + np.cos(12 * np.pi * np.cos(np.pi * r / 2)))
    return (1 - np.sin(np.pi * z / 2) + waves) / 2.5


def franke(x, y):
    """Franke's function, its unit square mapped to ``[-1, 1]^2``."""
    u, v = 9 * (x + 1) / 2, 9 * (y + 1) / 2
    return (
        0.75 * np.exp(-((u - 2) ** 2 + (v - 2) ** 2) / 4)
        + 0.75 * np.exp(-((u + 1) ** 2) / 49 - (v + 1) / 10)
        + 0.5 * np.exp(-((u - 7) ** 2 + (v - 3) ** 2) / 4)
        - 0.2 * np.exp(-((u - 4) ** 2) - (v - 7) ** 2)
    )


ANALYTIC = {
    "ridge": Analytic(ridge, 2, 10),
    "step": Analytic(step, 2, 10),
    "disk": Analytic(disk, 2, 10),
    "cone": Analytic(np.hypot, 2, 10),
    "marschner_lobb_slice": Analytic(marschner_lobb, 2, 41),
    "marschner_lobb": Analytic(marschner_lobb, 3, 41),
    "franke": Analytic(franke, 2, 12),
}


def smooth_random_241():
    """The smooth random field on its fine grid; every 8th value per axis is a sample."""
    from scipy.ndimage import gaussian_filter

    fine = gaussian_filter(np.random.default_rng(0).standard_normal((241, 241)), 12, mode="wrap")
    return fine / fine.std()


# Fields on any shape ---------------------------------------------------------------------


def coordinates(shape):
    """Coordinates in ``[-1, 1]`` along every axis, as full arrays."""
    return np.meshgrid(*[np.linspace(-1, 1, n) for n in shape], indexing="ij")


def oblique(shape):
    """A coordinate along a direction that is no axis and no diagonal."""
    direction = np.array([1.0, -0.6, 0.4])[: len(shape)]
    return sum(a * x for a, x in zip(direction, coordinates(shape), strict=True))


def radius(shape):
    """Distance from a point near the middle that is no sample."""
    centre = np.array([0.07, -0.11, 0.05])[: len(shape)]
    squares = ((x - c) ** 2 for x, c in zip(coordinates(shape), centre, strict=True))
    return np.sqrt(sum(squares))


def of_coordinates(function):
    """A case from a function of two or three coordinates."""
    return lambda shape, rng: function(*coordinates(shape))


def quadratic(shape, rng):
    """A quadratic form with mixed terms, a gradient and a constant."""
    x = np.stack(coordinates(shape))
    matrix, slope = rng.normal(size=(len(shape),) * 2), rng.normal(size=len(shape))
    return 1 + np.tensordot(slope, x, 1) + np.einsum("ij,i...,j...", matrix, x, x)


def saddle(shape, rng):
    x = coordinates(shape)
    return x[0] * x[1] if len(shape) == 2 else x[0] * x[1] + x[2] ** 2


def spike(shape, rng):
    values = np.zeros(shape)
    values[tuple(n // 2 for n in shape)] = 1
    return values


def smooth_random(shape, rng):
    """Six plane waves of random phase, at most 1.1 radians per sample along each axis."""
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"))
    total = np.zeros(shape)
    for _ in range(6):
        wave, phase = rng.uniform(-1.1, 1.1, len(shape)), rng.uniform(0, 2 * np.pi)
        total += rng.normal() * np.sin(np.tensordot(wave, index, 1) + phase)
    return total


FIELDS = {
    "constant": Field(lambda shape, rng: np.full(shape, 3.7)),
    "plane": Field(lambda shape, rng: 2.5 + 3 * oblique(shape)),
    "quadratic": Field(quadratic),
    "ridge": Field(lambda shape, rng: np.exp(-((3 * oblique(shape)) ** 2))),
    "step": Field(lambda shape, rng: 1 / (1 + np.exp(10 * oblique(shape)))),
    "sharp_step": Field(lambda shape, rng: (oblique(shape) > 0.1).astype(float), rough=True),
    "disk": Field(lambda shape, rng: 1 / (1 + np.exp(8 * (radius(shape) - 0.6)))),
    "cone": Field(lambda shape, rng: radius(shape)),
    "saddle": Field(saddle),
    "spike": Field(spike, rough=True),
    "checkerboard": Field(lambda shape, rng: np.indices(shape).sum(0) % 2, rough=True),
    "noise": Field(lambda shape, rng: rng.normal(size=shape), rough=True),
    "smooth_random": Field(smooth_random),
    "integers": Field(lambda shape, rng: rng.integers(0, 4, shape), rough=True),
    "marschner_lobb": Field(of_coordinates(marschner_lobb), rough=True),
    "franke": Field(of_coordinates(franke), ndims=(2,)),
}

# Few shapes, several spacings: every shape is another program to compile.
GRIDS = {
    2: (Grid((6, 5), (1.0, 1.0)), Grid((6, 5), (0.5, 1.25))),
    3: (Grid((4, 3, 5), (1.0, 1.0, 1.0)), Grid((4, 3, 5), (0.7, 1.0, 2.5))),
}


def field_cases(ndim):
    """Names of the fields of `ndim` dimensions, for ``pytest.mark.parametrize``."""
    return [name for name, field in FIELDS.items() if ndim in field.ndims]


def grid_field_cases(*ndims):
    """Every field on every grid, as ``pytest.param(grid, name)``; cubes, the simplest, are slow."""
    return [
        pytest.param(
            grid,
            name,
            id=f"{name}-{grid.name}",
            marks=[pytest.mark.slow] if grid is GRIDS[3][0] else [],
        )
        for ndim in ndims
        for grid in GRIDS[ndim]
        for name in field_cases(ndim)
    ]
