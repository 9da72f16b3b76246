"""One table of formats; `read` and `write` choose by the suffix of the file's name."""

import os
import tempfile
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from ._atomic import check_target, replacing
from ._errors import InputError, one_line
from ._grid import Grid


class _Reader(Protocol):
    def __call__(self, path: Path, key: str | None) -> Grid: ...


class _Writer(Protocol):
    def __call__(self, path: Path, grid: Grid) -> tuple[str, ...]: ...


@dataclass(frozen=True)
class Format:
    """A file format; its module is imported when a file of it is met.

    Parameters
    ----------
    name
        For messages.
    suffixes
        Lower case, with the dot; the longest that fits a file's name decides.
    module
        Module of this package with the reader and the writer.
    reader, writer
        Names of the functions there; ``""`` where the format is only written or only read.
    """

    name: str
    suffixes: tuple[str, ...]
    module: str
    reader: str = "read"
    writer: str = "write"

    def load(self, function: str):
        """The reader or the writer."""
        return getattr(import_module(f"{__package__}.{self.module}"), function)


FORMATS = (
    Format("NumPy array", (".npy",), "_npy"),
    Format("NumPy archive", (".npz",), "_npz"),
    Format("PNG image", (".png",), "_image", writer="write_png"),
    Format("TIFF or GeoTIFF", (".tif", ".tiff"), "_tiff"),
)


def read(path: str | os.PathLike[str], key: str | int | None = None) -> Grid:
    """The samples in a file, with their geometry.

    Parameters
    ----------
    path
        The file; its suffix says the format.
    key
        Which array, where a file holds several: a name in a ``.npz``, a band of a GeoTIFF.

    Raises
    ------
    InputError
        The file is missing, unknown, damaged or holds no real numbers: one line that says so.
    """
    chosen = _format(path, "reader")
    source = Path(path)
    if source.is_dir():
        raise InputError(f"{path}: is a folder, not a file")
    if not source.exists():
        raise InputError(f"{path}: there is no such file")
    if not source.is_file():
        raise InputError(f"{path}: is not a regular file")
    reader = cast(_Reader, chosen.load(chosen.reader))
    try:
        return reader(source.absolute(), None if key is None else str(key))
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    # A damaged file makes the libraries below raise almost anything.
    except Exception as error:
        raise InputError(f"{path}: cannot be read as {chosen.name}: {one_line(error)}") from error


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
    chosen = _format(path, "writer")
    writer = cast(_Writer, chosen.load(chosen.writer))
    with replacing(path) as partial:
        try:
            return writer(partial, grid)
        except InputError as error:
            raise type(error)(f"{path}: {error}") from error


def check_writable(path: str | os.PathLike[str], like: Grid | None = None) -> None:
    """Raise now what `write` would raise about the file's name and folder.

    With `like`, also what it would raise about a grid of that kind: its corner is written to a
    temporary folder, so that a long computation does not end in a format that cannot hold it.
    """
    chosen = _format(path, "writer")
    check_target(path)
    if like is None:
        return
    corner = like.crop([(0, min(2, n)) for n in like.shape])
    writer = cast(_Writer, chosen.load(chosen.writer))
    with tempfile.TemporaryDirectory() as folder:
        try:
            writer(Path(folder) / f"probe{chosen.suffixes[0]}", corner)
        except InputError as error:
            raise type(error)(f"{path}: {error}") from error


def _format(path: str | os.PathLike[str], wanted: str) -> Format:
    name = os.path.basename(os.fspath(path)).lower()
    usable = [each for each in FORMATS if getattr(each, wanted)]
    fitting = [
        (len(suffix), each)
        for each in usable
        for suffix in each.suffixes
        if name.endswith(suffix) and name != suffix
    ]
    if not fitting:
        known = ", ".join(suffix for each in usable for suffix in each.suffixes)
        verb = "read" if wanted == "reader" else "written"
        raise InputError(f"{path}: files of this name are not {verb}; known suffixes: {known}")
    return max(fitting, key=lambda pair: pair[0])[1]
