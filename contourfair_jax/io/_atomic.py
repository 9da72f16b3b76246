"""Outputs appear whole or not at all: written beside the target, then renamed over it."""

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from ._errors import InputError, one_line


def check_target(path: str | os.PathLike[str]) -> Path:
    """The file that `path` names, links followed; refuses what cannot become a file."""
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise InputError(f"{path}: is a folder; name a file in it")
    if target.exists() and not target.is_file():
        raise InputError(f"{path}: is not a regular file, so it cannot be replaced")
    if not target.parent.is_dir():
        raise InputError(f"{path}: there is no folder {target.parent}; make it first")
    return target


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a new file beside `path`; on success it replaces `path`, on failure it is removed.

    A file that was there before is untouched until the rename and keeps its permissions.
    """
    target = check_target(path)
    partial = target.with_name(f".{target.name}.{secrets.token_hex(4)}.partial")
    try:
        os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error
    try:
        yield partial
        if target.exists():
            shutil.copymode(target, partial)
        _flush(partial)
        os.replace(partial, target)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or one_line(error)})") from (
            error
        )
    finally:
        partial.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    """Push the file's bytes to the disk, so that a rename never names an empty file."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
