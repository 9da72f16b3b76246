"""The child process of `_isolate`: one file in, one grid out on standard output."""

import json
import os
from importlib import import_module
from pathlib import Path
from typing import IO

import numpy as np

from .._grid.grid import Grid
from .._support.errors import InputError, MissingPackageError, one_line
from .._support.memory import physical_memory

# Room beyond the memory of the machine for what libraries reserve and never touch.
_MARGIN = 4 * 2**30


def main(module: str, reader: str, path: str, key: str | None) -> None:
    """Read `path`; what libraries print goes to standard error."""
    with os.fdopen(os.dup(1), "wb") as stream:
        os.dup2(2, 1)
        _limit_memory()
        try:
            grid = getattr(import_module(f"{__package__}.formats.{module}"), reader)(
                Path(path), key
            )
        except Exception as error:
            stream.write(json.dumps(_fault(error)).encode() + b"\n")
        else:
            send_grid(stream, grid)
    os._exit(0)  # no tidying up by libraries that may be in any state


def send_grid(stream: IO[bytes], grid: Grid) -> None:
    """One line of JSON, the samples, and where there are gaps the mask."""
    nodata = grid.nodata.item() if isinstance(grid.nodata, np.generic) else grid.nodata
    header = {
        "shape": grid.shape,
        "dtype": grid.values.dtype.str,
        "gaps": grid.missing is not None,
        "spacing": grid.spacing,
        "origin": grid.origin,
        "axes": grid.axes,
        "units": grid.units,
        "crs": grid.crs,
        "affine": None if grid.affine is None else grid.affine.tolist(),
        "nodata": nodata,
        "metadata": dict(grid.metadata),
        "notes": grid.notes,
        "bands": grid.bands,
        "source_dtype": grid.source_dtype.str,
    }
    stream.write(json.dumps(header).encode() + b"\n")
    for array in (grid.values, grid.missing):
        if array is not None:
            stream.write(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)


def _fault(error: Exception) -> dict[str, str]:
    if isinstance(error, MissingPackageError):
        return {"kind": "package", "error": str(error)}
    if isinstance(error, InputError):
        return {"kind": "input", "error": str(error)}
    if isinstance(error, MemoryError):
        return {"kind": "input", "error": "asks for more memory than this machine has"}
    return {"kind": "fault", "error": one_line(error)}


def _limit_memory() -> None:
    """Make asking for more than the machine has an error, where the system can."""
    try:
        import resource
    except ImportError:  # not a POSIX system
        return
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    wanted = physical_memory() + _MARGIN
    if most == resource.RLIM_INFINITY or wanted < most:
        resource.setrlimit(resource.RLIMIT_AS, (wanted, most))
