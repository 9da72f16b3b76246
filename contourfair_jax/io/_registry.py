"""`read` and `write` choose a format by the suffix of the file's name."""

import contextlib
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from .._grid.grid import Grid
from .._support.errors import InputError, one_line
from ._outputs import (
    check_folder,
    check_pair,
    check_target,
    replacing,
    replacing_folder,
    replacing_pair,
)
from ._table import FORMATS, NAMELESS_FOLDER, Format

# Endings of compressed files and archives.
_PACKED = (".gz", ".bz2", ".xz", ".zst", ".zip", ".tar", ".tgz")

# What messages call the functions of a format.
_VERBS = {
    "reader": "read",
    "writer": "written",
    "bands_writer": "written with several bands",
}


def read(path: str | os.PathLike[str], key: str | int | None = None) -> Grid:
    """The samples in a file, with their geometry.

    Parameters
    ----------
    path
        The file; its suffix says the format.
    key
        Which array, and which part of it: ``name``, ``name,time=3,level=0:5`` with numbers of
        samples, ``t=0`` alone, the number or the name of a band, the number of a DICOM series.

    Raises
    ------
    InputError
        The file is missing, unknown, damaged or holds no real numbers: one line that says so.
    """
    chosen = _format(path, "reader")
    source = Path(path)
    if not os.path.exists(source):  # false for names that the system refuses, too
        raise InputError(f"{path}: there is no such file")
    if source.is_dir() != chosen.folder:
        actual, wanted = ("file", "folder") if chosen.folder else ("folder", "file")
        raise InputError(f"{path}: is a {actual}, not a {wanted}")
    if not (chosen.folder or source.is_file()):
        raise InputError(f"{path}: is not a regular file")
    try:
        return chosen.read(source.absolute(), None if key is None else str(key))
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    # A damaged file makes the libraries below raise almost anything.
    except Exception as error:
        raise InputError(f"{path}: cannot be read as {chosen.name}: {one_line(error)}") from error


def read_bands(path: str | os.PathLike[str]) -> tuple[Grid, ...]:
    """All bands of a GeoTIFF, or channels of a colour image, one grid each.

    Of a file without bands, the one grid that `read` gives.

    Raises
    ------
    InputError
        As `read`.
    """
    first = read(path)
    return tuple(read(path, key) for key in first.bands) or (first,)


def write(path: str | os.PathLike[str], grid: Grid) -> tuple[str, ...]:
    """Store a grid; `path` is replaced when all is written, or left as it was.

    Missing samples get the grid's nodata value (NaN where there is none).

    Returns
    -------
    tuple of str
        What the format could not keep, one line each.

    Raises
    ------
    InputError
        The format cannot hold the grid, or the file cannot be written.
    """
    return write_bands(path, (grid,))


def write_bands(path: str | os.PathLike[str], grids: Sequence[Grid]) -> tuple[str, ...]:
    """As `write`, for grids of one place and shape that become bands or channels of one file.

    Their type and nodata value become one.  Coordinates and texts are those of the first; names,
    units and colours are kept for each band.
    """
    if not grids:
        raise InputError(f"{path}: there are no bands to write")
    chosen, store = _writer(path, grids)
    with _replacing(chosen, path) as partial:
        try:
            return store(partial)
        except InputError as error:
            raise type(error)(f"{path}: {error}") from error


def check_writable(path: str | os.PathLike[str], *like: Grid) -> None:
    """Raise now what `write` would raise about the file's name, folder and permissions.

    With `like`, also what it would raise about grids of that kind: small parts of them are written
    to a temporary folder, so that a long computation does not end in a format that cannot hold it.
    """
    corners = [_part(grid) for grid in like]
    chosen, store = _writer(path, corners)
    if chosen.beside:
        check_pair(path, chosen.beside)
    else:
        (check_folder if chosen.folder else check_target)(path)
    if not corners:
        return
    with tempfile.TemporaryDirectory() as folder:
        try:
            store(Path(folder) / f"probe{chosen.suffixes[0]}")
        except InputError as error:
            raise type(error)(f"{path}: {error}") from error


def _part(grid: Grid) -> Grid:
    """Two samples along each axis: the smallest, the largest, and a missing one where any is."""
    corner = grid.crop([(0, min(2, n)) for n in grid.shape])
    missing = np.zeros(grid.shape, bool) if grid.missing is None else grid.missing
    present = grid.values[~missing]
    if not present.size:
        return corner
    values, mask = [present.min(), present.max()], [False, False]
    if missing.any():
        values.insert(1, grid.values.flat[np.argmax(missing)])
        mask.insert(1, True)
    return replace(
        corner,
        values=np.resize(np.array(values, grid.values.dtype), corner.shape),
        missing=np.resize(mask, corner.shape) if any(mask) else None,
    )


def _writer(
    path: str | os.PathLike[str], grids: Sequence[Grid]
) -> tuple[Format, Callable[[Path], tuple[str, ...]]]:
    """The format that the name asks for, and what stores the grids in it."""
    if len(grids) <= 1:
        chosen = _format(path, "writer")
        return chosen, lambda where: chosen.write(where, grids[0])
    if len({grid.shape for grid in grids}) > 1:
        shapes = ", ".join(str(grid.shape) for grid in grids)
        raise InputError(f"{path}: bands must have one shape, got {shapes}")
    chosen = _format(path, "bands_writer")
    return chosen, lambda where: chosen.write_bands(where, grids)


def _replacing(
    chosen: Format, path: str | os.PathLike[str]
) -> contextlib.AbstractContextManager[Path]:
    if chosen.beside:
        return replacing_pair(path, chosen.beside)
    return (replacing_folder if chosen.folder else replacing)(path)


def _format(path: str | os.PathLike[str], wanted: str) -> Format:
    name = os.path.basename(os.path.normpath(path)).lower()
    usable = [row for row in FORMATS if getattr(row, wanted)]
    fitting = [
        (len(suffix), row)
        for row in usable
        for suffix in row.suffixes
        if name.endswith(suffix) and name != suffix
    ]
    if not fitting and wanted == "reader" and os.path.isdir(path):
        return NAMELESS_FOLDER
    if not fitting and wanted == "reader" and name.endswith(_PACKED):
        raise InputError(f"{path}: is compressed as a whole; unpack it and read what is in it")
    if not fitting:
        known = ", ".join(suffix for row in usable for suffix in row.suffixes)
        verb = _VERBS[wanted]
        raise InputError(f"{path}: files of this name are not {verb}; known suffixes: {known}")
    return max(fitting, key=lambda pair: pair[0])[1]


_EXAMPLES = ("jacksboro",)


def example(name: str = "jacksboro") -> Grid:
    """A bundled data set.

    ``jacksboro``: elevations in metres around Jacksboro, Tennessee, 344 x 403 samples of int16,
    3 arc-seconds apart (NASA SRTM, public domain).  Row 0 is north.

    Examples
    --------
    >>> from contourfair_jax.io import example
    >>> example("jacksboro").shape
    (344, 403)
    """
    if name not in _EXAMPLES:
        raise InputError(f"example must be one of {', '.join(_EXAMPLES)}, got {name!r}")
    with as_file(files("contourfair_jax") / "data" / f"{name}.npz") as path:
        return read(path)
