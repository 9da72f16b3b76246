"""CCP4 and MRC maps, read only: densities in a crystal's cell, whose axes may be skewed."""

import math
import os
from pathlib import Path

import numpy as np

from ..._grid.grid import Grid
from ..._support.errors import InputError
from ..._support.memory import check_memory, describe_bytes
from .volumes import SPATIAL, select, volume_grid, zyx

_HEADER = 1024
_MODES = {0: "i1", 1: "i2", 2: "f4", 6: "u2", 12: "f2"}


def read(path: Path, key: str | None) -> Grid:
    """The whole map, with the axes of the cell in the order z, y, x whatever the file's order."""
    with open(path, "rb") as stream:
        header = stream.read(_HEADER)
        if len(header) < _HEADER or header[208:212] != b"MAP ":
            raise InputError("is not a CCP4 or MRC map (it does not begin like one)")
        order = ">" if header[212] == 0x11 else "<"
        whole = np.frombuffer(header, f"{order}i4").astype(int)
        sizes, mode = whole[:3].tolist(), int(whole[3])
        if mode not in _MODES or min(sizes) < 1 or sorted(whole[16:19].tolist()) != [1, 2, 3]:
            raise InputError(f"has a damaged header, or complex values (mode {mode}, {sizes})")
        dtype = np.dtype(order + _MODES[mode])
        promised = math.prod(sizes) * dtype.itemsize
        start = _HEADER + max(int(whole[23]), 0)
        present = os.fstat(stream.fileno()).st_size - start
        if promised > present:
            raise InputError(
                f"is truncated: its header promises {describe_bytes(promised)} of samples, "
                f"{describe_bytes(max(present, 0))} are there"
            )
        check_memory(promised, f"a map of {sizes} samples")
        stream.seek(start)
        values = np.frombuffer(stream.read(promised), dtype).reshape(sizes[::-1])
    # Word 17 says which axis of the cell the columns are along, and so on.
    columns_first = np.argsort(whole[16:19])
    values = np.transpose(values.T, columns_first).T
    index = select(key, SPATIAL, values.shape)
    return volume_grid(
        values[index],
        values.shape,
        index,
        zyx(_affine(header, order, whole[4:7][columns_first])),
        metadata={"space units": "angstrom"},
        source_dtype=dtype,
    )


def _affine(header: bytes, order: str, first: np.ndarray) -> np.ndarray:
    """Index to position, x first: the cell's edge a is along x, its edge b in the plane x, y."""
    intervals = np.frombuffer(header, f"{order}i4", 3, 28).astype(float)
    cell = np.frombuffer(header, f"{order}f4", 6, 40).astype(float)
    shift = np.frombuffer(header, f"{order}f4", 3, 196).astype(float)
    if not (np.isfinite(cell).all() and (intervals > 0).all() and (cell[:3] > 0).all()):
        raise InputError(f"has a damaged header (cell {cell.tolist()})")
    alpha, beta, gamma = np.round(np.cos(np.radians(cell[3:])), 15)  # right angles give zero
    sine = np.sin(np.radians(cell[5]))
    third = (alpha - beta * gamma) / sine
    upright = math.sqrt(max(1 - beta**2 - third**2, 0))
    edges = np.array([[1, gamma, beta], [0, sine, third], [0, 0, upright]]) * cell[:3]
    affine = np.eye(4)
    affine[:3, :3] = edges / intervals
    # Maps of crystals count from `first`; those of microscopes give a position instead.
    affine[:3, 3] = affine[:3, :3] @ first if first.any() else shift
    return affine
