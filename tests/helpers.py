"""What the tests of the engine share: nets as arrays, samples by name, products, a tolerance."""

import os
from pathlib import Path

import cases
import jax
import numpy as np

import contourfair_jax as cf

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("CONTOURFAIR_DATA", ROOT.parent / "shared" / "data"))
SEED = int(os.environ.get("CONTOURFAIR_TEST_SEED", "0"))


def net_of(values, spacing=1.0, **settings):
    """Control net of the engine as a NumPy array."""
    field = cf.fair_field(values, spacing=spacing, method=cf.LocalFairing(**settings))
    return np.asarray(field.control_points)


def samples_of(name, grid, seed=0):
    """Float64 samples of a field of the master table."""
    return cases.FIELDS[name].samples(grid.shape, np.random.default_rng(seed))


def matrix_products(function, *arguments):
    """The lines of the lowered program that multiply matrices."""
    program = jax.jit(function).lower(*arguments).as_text()
    return [line for line in program.splitlines() if "stablehlo.dot_general" in line]


def assert_close(ours, expected, relative):
    """Largest difference, relative to the spread of what is expected (its size if constant)."""
    ours, expected = np.asarray(ours, float), np.asarray(expected, float)
    spread, size = np.ptp(expected), np.abs(expected).max()
    scale = spread if spread > 1e-6 * size else size or 1.0
    np.testing.assert_allclose(ours / scale, expected / scale, rtol=0, atol=relative)
