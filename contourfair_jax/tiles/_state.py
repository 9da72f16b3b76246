"""An unfinished run beside its target: what it is of, which tiles are done, how it ends.

The folder ``TARGET.partial`` holds the output so far, ``settings.json``, ``missing``, the number of
missing samples of each tile of the output, and ``done``, one byte for each tile, set when the tile
has been written.  The target itself is untouched until the end, when
the output is renamed over it.
"""

import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from .._support.errors import InputError
from ..io._outputs import check_folder, check_target, flush, in_one_line

OPEN, DONE, UNCONVERGED = 0, 1, 2
_STATE, _COUNT = np.dtype(np.uint8), np.dtype("<i8")
_NOTE = "unfinished: continue with resume, or delete this folder"


class Unfinished:
    """The folder of a run that is not finished.

    Parameters
    ----------
    target
        The path that the output will have.
    """

    def __init__(self, target: str | os.PathLike[str]) -> None:
        self.target = Path(os.path.realpath(target))
        self.folder = self.target.with_name(self.target.name + ".partial")
        self.data = self.folder / f"data{self.target.suffix.lower()}"
        self._old = self.folder / f"old{self.target.suffix.lower()}"
        self._settings = self.folder / "settings.json"
        self._done, self._missing = self.folder / "done", self.folder / "missing"

    def check_target(self) -> None:
        """Refuse a target that cannot become what its name says."""
        (check_folder if self.target.suffix.lower() == ".zarr" else check_target)(self.target)

    @property
    def started(self) -> bool:
        """Whether an earlier run got as far as writing tiles."""
        return self._settings.exists()

    @contextmanager
    def held(self) -> Iterator[None]:
        """Make the folder, and keep other processes from it for as long as this one lives."""
        with in_one_line(self.target):
            self.folder.mkdir(exist_ok=True)
            stream = open(self.folder / "lock", "w")  # noqa: SIM115
        with stream:
            _lock(stream, self.target)
            try:
                yield
            finally:
                if not self.started:
                    shutil.rmtree(self.folder, ignore_errors=True)

    def compare(self, settings: Mapping[str, Any]) -> None:
        """Refuse to go on with other settings or another input, naming the first difference."""
        try:
            stored = json.loads(self._settings.read_text())
        except (OSError, ValueError) as error:
            raise InputError(
                f"{self._settings}: cannot be read; delete {self.folder} to start afresh"
            ) from error
        for name, value in json.loads(json.dumps(settings)).items():
            if stored.get(name) != value:
                raise InputError(
                    f"{self.target}: cannot be resumed, for {name} was "
                    f"{_short(stored.get(name))} and is {_short(value)}; repeat the run as it "
                    f"was, or delete {self.folder}"
                )

    def begin(self, settings: Mapping[str, Any], tiles: int) -> None:
        """Record what the run is of; call it when the empty output is there."""
        for path, kind in ((self._done, _STATE), (self._missing, _COUNT)):
            path.write_bytes(bytes(kind.itemsize * tiles))
            flush(path)
        new = self._settings.with_suffix(".new")
        new.write_text(json.dumps({"note": _NOTE, **settings}, indent=1))
        flush(new)
        os.replace(new, self._settings)
        if os.name == "posix":  # elsewhere folders cannot be flushed
            flush(self.folder)

    def clear(self) -> None:
        """Remove what a run left that was stopped before it began."""
        for each in (self.data, self._old):
            if each.is_dir():
                shutil.rmtree(each)
            else:
                each.unlink(missing_ok=True)

    def states(self, tiles: int) -> np.ndarray:
        """The state of every tile.

        Raises
        ------
        InputError
            The record is not one of so many tiles.
        """
        return self._read(self._done, _STATE, tiles, UNCONVERGED)

    def missing(self, tiles: int) -> int:
        """Number of missing samples of the output, in the tiles that are done."""
        return int(self._read(self._missing, _COUNT, tiles, np.iinfo(_COUNT).max).sum())

    def _read(self, path: Path, kind: np.dtype, tiles: int, most: int) -> np.ndarray:
        data = path.read_bytes() if path.exists() else b""
        whole = len(data) == kind.itemsize * tiles
        if not whole or (np.frombuffer(data, kind) > most).any():
            raise InputError(
                f"{path}: is damaged, so it is not known which tiles are done; delete "
                f"{self.folder} to start afresh"
            )
        return np.frombuffer(data, kind)

    @contextmanager
    def marking(self) -> Iterator[Callable[[int, int, int], None]]:
        """A function ``mark(number, state, missing)``."""
        with (
            open(self._done, "r+b", buffering=0) as states,
            open(self._missing, "r+b", buffering=0) as counts,
        ):

            def mark(number: int, state: int, missing: int) -> None:
                counts.seek(number * _COUNT.itemsize)
                counts.write(np.array(missing, _COUNT).tobytes())
                states.seek(number)
                states.write(bytes([state]))

            yield mark

    def finish(self) -> None:
        """Rename the output over the target; may be repeated after having been interrupted."""
        if self.data.exists():
            files = self.data.rglob("*") if self.data.is_dir() else [self.data]
            for each in files:
                if each.is_file():
                    flush(each)
            if self.data.is_dir() and self.target.exists():
                if self._old.exists():
                    shutil.rmtree(self._old)
                os.rename(self.target, self._old)
            elif self.target.exists():
                shutil.copymode(self.target, self.data)
            os.replace(self.data, self.target)
        self._settings.unlink()
        shutil.rmtree(self.folder)


def _lock(stream: Any, target: Path) -> None:
    with suppress(ImportError):  # no such locks on Windows
        import fcntl

        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(f"{target}: another process is writing it; wait for it") from error


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
