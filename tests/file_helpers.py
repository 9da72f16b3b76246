"""Helpers of the tests of files: reading without a child process, and comparing places."""

import warnings
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from contourfair_jax.io import Grid

WRITTEN_3D = (
    *(".nc", ".zarr", ".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".vti", ".vtk"),
)


def read_inside(module: str, reader: str, path: Path, key: str | None) -> Grid:
    """What `read_isolated` does, in this process; warnings of libraries stay unseen, as there."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return getattr(import_module(f"contourfair_jax.io.formats.{module}"), reader)(path, key)


@pytest.fixture
def inside(monkeypatch):
    """Read all formats in this process: the same code, without half a second for every file."""
    monkeypatch.setattr("contourfair_jax.io._table.read_isolated", read_inside)


def samples(dtype="float32", shape=(4, 5, 6)) -> np.ndarray:
    """Different values that every type holds."""
    return np.arange(np.prod(shape)).reshape(shape).astype(dtype)


def placed(grid: Grid) -> np.ndarray:
    """One row per sample, world position then value, sorted: the same for any order of axes."""
    index = np.argwhere(np.ones(grid.shape, bool))
    at = grid.world(index * np.asarray(grid.spacing) + grid.origin)
    rows = np.column_stack([at, grid.values.ravel()])
    rounded = np.round(rows[:, :-1] / 1e-6)
    return rows[np.lexsort(rounded.T[::-1])]


def same_places(left: Grid, right: Grid, rtol: float = 1e-6) -> None:
    """Every sample of one grid is in the other, at the same place of the world.

    Worlds whose x and y have opposite signs, as the formats of medicine say they have, are the
    same.
    """
    spaces = {grid.metadata.get("space", "") for grid in (left, right)}
    if len(spaces) == 2 and "" not in spaces:
        flip = np.diag([*(1.0 if axis == "z" else -1.0 for axis in right.axes), 1.0])
        right = replace(right, affine=flip @ right.affine, origin=())
    np.testing.assert_allclose(placed(left), placed(right), rtol=rtol, atol=1e-9)
