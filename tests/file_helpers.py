"""Helpers of the tests of files: reading without a child process, and comparing places."""

import warnings
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pydicom
import pytest
from pydicom.data import get_testdata_file
from pydicom.uid import generate_uid

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


# Affine maps of volumes, and positions of slices, out of order.
STEPS = np.diag([2.0, 1.5, 0.5, 1.0]) + np.eye(4, k=3) * 40
UP = [(-10.0, -20.0, 5.0 + 2.5 * k) for k in (3, 0, 4, 1, 2)]


def oblique() -> np.ndarray:
    """Turned about two axes, with different steps, far from the origin."""
    a, b = 0.3, -0.2
    first = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    second = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
    affine = np.eye(4)
    affine[:3, :3] = first @ second @ np.diag([2.0, 1.5, 0.5])
    affine[:3, 3] = [-30.0, 12.5, 81.0]
    return affine


def cube(orbitals: int = 1, angstrom: bool = False) -> bytes:
    """Two atoms, a grid of 6 x 5 x 4 (x, y, z) with a turned axis, z fastest."""
    sign, atoms = -1 if angstrom else 1, -2 if orbitals > 1 else 2
    lines = ["water", "density", f"{atoms} 1.0 2.0 3.0", f"{6 * sign} 0.5 0.25 0.0"]
    lines += [f"{5 * sign} 0.0 1.5 0.0", f"{4 * sign} 0.0 0.0 2.0"]
    lines += ["8 8.0 0.0 0.0 0.0"] * 2
    if orbitals > 1:
        lines += [f"{orbitals} " + " ".join(str(k + 7) for k in range(orbitals))]
    values = np.stack([samples().T + 1000 * k for k in range(orbitals)], -1)
    lines += [" ".join(f"{value:.5E}" for value in row) for row in values.reshape(30, -1)]
    return "\n".join(lines).encode()


def ccp4(order: str = "<", turns: tuple[int, int, int] = (2, 1, 3), **words: float) -> bytes:
    """A map whose columns are along b and rows along a, of a cell with a right angle or not."""
    header = np.zeros(256, f"{order}i4")
    reals = header.view(f"{order}f4")
    sizes = {1: 6, 2: 5, 3: 4}
    header[:4] = [*(sizes[axis] for axis in turns), 1]
    header[4:7] = [{1: 10, 2: 20, 3: 30}[axis] for axis in turns]
    header[7:10] = [12, 10, 8]
    reals[10:16] = [6.0, 15.0, 16.0, 90.0, 90.0, words.get("gamma", 90.0)]
    header[16:19] = turns
    data = bytearray(header.tobytes())
    data[208:216] = b"MAP " + (b"\x44\x44\0\0" if order == "<" else b"\x11\x11\0\0")
    values = samples().T.transpose([axis - 1 for axis in turns])  # columns, rows, sections
    return bytes(data) + values.astype(f"{order}i2").tobytes(order="F")


def slices(folder, places, number=7, uid=None, **changes):
    """A series of CT slices; the stored value of all samples of slice k is k."""
    folder.mkdir(exist_ok=True)
    uid = uid or generate_uid()
    for k, place in enumerate(places):
        image = pydicom.dcmread(get_testdata_file("CT_small.dcm"))
        image.SeriesInstanceUID, image.SeriesNumber = uid, number
        image.SOPInstanceUID = image.file_meta.MediaStorageSOPInstanceUID = generate_uid()
        image.SeriesDescription = "head"
        image.ImagePositionPatient = list(place)
        image.PixelData = np.full((128, 128), k, "<i2").tobytes()
        for name, value in changes.items():
            setattr(image, name, value)
        image.save_as(folder / f"{hash((k, number)) % 997:03d}_{number}_{k}")
    return folder
