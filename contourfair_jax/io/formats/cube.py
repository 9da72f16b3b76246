"""Gaussian cube files, read only: orbitals and densities of molecules as text."""

import math
import os
from pathlib import Path

import numpy as np

from ..._grid.grid import Grid
from ..._support.errors import InputError
from ..._support.memory import check_memory
from .volumes import SPATIAL, select, volume_grid, zyx

_MOST_ATOMS = 10**6
_ORBITAL = "orbital"


def read(path: Path, key: str | None) -> Grid:
    """The values on the grid; of several orbitals the one that `key` numbers.

    Distances are in bohr, or in angstrom where the file counts its samples as negative.
    """
    with open(path, encoding="latin-1") as stream:
        title = " ".join(part for part in (_line(stream), _line(stream)) if part)
        atoms, *origin = _line(stream).split()
        several = int(origin.pop()) if len(origin) == 4 else 1
        steps = [_line(stream).split() for _ in range(3)]
        counts = [int(n) for n, *_ in steps]
        if abs(int(atoms)) > _MOST_ATOMS or min(map(abs, counts)) < 1 or several < 1:
            raise InputError(f"has a damaged header ({atoms} atoms, {counts} samples)")
        for _ in range(abs(int(atoms))):
            _line(stream)
        words = iter(())
        if int(atoms) < 0:  # the numbers of the orbitals
            words = iter(_line(stream).split())
            several = int(next(words))
            given = list(words)
            while len(given) < several:
                given += _line(stream).split()
        shape = [abs(n) for n in counts]
        total = several * math.prod(shape)
        # A number takes two characters at least.
        if total > (os.fstat(stream.fileno()).st_size + 1) // 2:
            raise InputError(f"is truncated: its header promises {total} numbers")
        check_memory(80 * total, f"{total} numbers as text")
        text = stream.read()
    numbers = text.split()
    if text[-1:].strip() and len({len(each.lstrip("-")) for each in numbers[-2:]}) > 1:
        numbers.pop()  # cut within its digits
    if len(numbers) < total:
        raise InputError(f"is truncated: {len(numbers)} of {total} numbers are there")
    values = np.array(numbers[:total], np.float64).reshape(*shape, several).T
    index = select(key, (_ORBITAL, *SPATIAL), values.shape)
    affine = np.eye(4)
    affine[:3, :3] = np.array([step[1:4] for step in steps], np.float64).T
    affine[:3, 3] = np.array(origin, np.float64)
    return volume_grid(
        values[index],
        values.shape[1:],
        index[1:],
        zyx(affine),
        metadata={
            "title": title,
            "space units": "angstrom" if min(counts) < 0 else "bohr",
        },
    )


def _line(stream) -> str:
    line = stream.readline(10_000)
    if not line:
        raise InputError("is truncated: it ends within its header")
    return line.strip()
