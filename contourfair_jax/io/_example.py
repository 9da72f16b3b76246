"""Data sets that come with the package."""

from importlib.resources import as_file, files

from ._errors import InputError
from ._grid import Grid
from ._registry import read

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
