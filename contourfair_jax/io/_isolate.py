"""Reading in a process of its own: what a damaged file does to a library stays there.

The libraries below some formats can crash, hang or ask for any amount of memory on files that
were damaged, or made to do so.  The child has a limit on memory and a limit on time; it sends one
line of JSON and the samples through a pipe, never a pickle.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from .._grid.grid import Grid
from .._support.errors import InputError, MissingPackageError
from .._support.memory import check_memory

# Seconds that any file may take, and bytes per second beyond them.
_PATIENCE = 60.0
_PACE = 4e6
_LONGEST_HEADER = 2**24

_CODE = """
import json, sys
sys.path[:] = json.loads(sys.argv[1])
from contourfair_jax.io._worker import main
main(*json.loads(sys.argv[2]))
"""


def read_isolated(module: str, reader: str, path: Path, key: str | None) -> Grid:
    """Result of ``reader(path, key)`` of a module of this package, read by a child process.

    Raises
    ------
    InputError
        What the reader raised; or the child crashed, took too long or needed too much memory.
    """
    limit = _PATIENCE + _bytes_below(path) / _PACE
    late = threading.Event()
    with _child([module, reader, str(path), key]) as (process, stream, log):

        def stop() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(limit, stop)
        timer.start()
        try:
            return _receive(stream)
        except EOFError:
            raise InputError(_why(process.wait(), late.is_set(), limit, log)) from None
        finally:
            timer.cancel()


@contextmanager
def _child(request: list[Any]) -> Iterator[tuple[subprocess.Popen[bytes], IO[bytes], IO[bytes]]]:
    search = json.dumps([*map(str, sys.path)])
    command = [sys.executable, "-P", "-c", _CODE, search, json.dumps(request)]
    # Threads of libraries would only reserve memory; locks would fail on read-only file systems.
    settings = {
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "HDF5_USE_FILE_LOCKING": "FALSE",
    }
    with tempfile.TemporaryFile() as log:
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                env={**os.environ, **settings},
            )
        except OSError as error:
            raise InputError(f"the process that reads it cannot start ({error})") from error
        assert process.stdout is not None
        try:
            yield process, process.stdout, log
        finally:
            process.kill()
            process.stdout.close()
            process.wait()


def _receive(stream: IO[bytes]) -> Grid:
    """The grid that `_worker.send_grid` wrote; EOFError where the child broke off."""
    line = stream.readline(_LONGEST_HEADER)
    if not line.endswith(b"\n"):
        raise EOFError
    header = json.loads(line)
    if "error" in header:
        raise _ERRORS[header["kind"]](header["error"])
    shape, dtype = tuple(header["shape"]), np.dtype(header["dtype"])
    check_memory(math.prod(shape) * dtype.itemsize, f"an array of shape {shape}")
    values = _array(stream, shape, dtype)
    return Grid(
        values,
        missing=_array(stream, shape, np.dtype(bool)) if header["gaps"] else None,
        spacing=tuple(header["spacing"]),
        origin=tuple(header["origin"]),
        axes=tuple(header["axes"]),
        units=header["units"],
        crs=header["crs"],
        affine=None if header["affine"] is None else np.array(header["affine"]),
        nodata=header["nodata"],
        metadata=header["metadata"],
        notes=tuple(header["notes"]),
        bands=tuple(header["bands"]),
        source_dtype=np.dtype(header["source_dtype"]),
    )


class _ReaderFault(Exception):
    """A fault of the reader that is no `InputError`; `read` turns it into one."""


_ERRORS: Mapping[str, type[Exception]] = {
    "input": InputError,
    "package": MissingPackageError,
    "fault": _ReaderFault,
}


def _array(stream: IO[bytes], shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    array = np.empty(shape, dtype)
    rest = array.reshape(-1).view(np.uint8).data
    while len(rest):
        count = stream.readinto(rest)  # pyright: ignore[reportAttributeAccessIssue]
        if not count:
            raise EOFError
        rest = rest[count:]
    return array


def _why(status: int, late: bool, limit: float, log: IO[bytes]) -> str:
    if late:
        return f"reading it was given up after {limit:.0f} s; the file is damaged or its disk slow"
    if status < 0:
        return f"it crashes the library that reads it (signal {-status}), so it is damaged"
    log.seek(max(log.seek(0, os.SEEK_END) - 2000, 0))
    lines = log.read().decode(errors="replace").split("\n")
    said = next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")
    return f"the process that reads it ended early, status {status} ({said})"


def _bytes_below(path: Path) -> int:
    if not path.is_dir():
        return path.stat().st_size
    sizes = (os.path.join(folder, name) for folder, _, names in os.walk(path) for name in names)
    return sum(os.lstat(each).st_size for each in sizes)
