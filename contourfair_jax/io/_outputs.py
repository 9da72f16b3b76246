"""Outputs appear whole or not at all: written beside the target, then renamed over it."""

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from .._support.errors import InputError, one_line

# What a folder that may be replaced holds: the metadata of a Zarr array or group.
_ZARR = ("zarr.json", ".zgroup", ".zarray")


def known_suffix(path: str | os.PathLike[str], known: Iterable[str]) -> str:
    """The ending of the name, in lower case, with the dot.

    Raises
    ------
    InputError
        It is none of the `known` ones.
    """
    suffix, suffixes = Path(path).suffix.lower(), tuple(known)
    if suffix not in suffixes:
        raise InputError(f"{path}: the name must end in {', '.join(suffixes)}")
    return suffix


def check_target(path: str | os.PathLike[str]) -> Path:
    """The file that `path` names, links followed; refuses what cannot become a file."""
    target = _target(path)
    if target.is_dir():
        raise InputError(f"{path}: is a folder; name a file in it")
    if target.exists() and not target.is_file():
        raise InputError(f"{path}: is not a regular file, so it cannot be replaced")
    check_parent(path)
    return target


def check_folder(path: str | os.PathLike[str]) -> Path:
    """The folder that `path` names, links followed; one that is there must be a Zarr folder."""
    target = _target(path)
    if target.exists() and not target.is_dir():
        raise InputError(f"{path}: is a file, so there can be no folder of this name")
    if target.exists() and not any((target / name).is_file() for name in _ZARR):
        raise InputError(f"{path}: is a folder of something else, so it is not replaced")
    check_parent(path)
    return target


def check_pair(path: str | os.PathLike[str], suffix: str) -> Path:
    """As `check_target`, of a header with a file of samples beside it, whose name has `suffix`.

    A file of that name which is there without a header is somebody's data.
    """
    target = check_target(path)
    beside = target.with_suffix(suffix)
    if beside.exists() and not target.exists():
        raise InputError(f"{path}: {beside.name} is there without it, so it is not replaced")
    check_target(beside)
    return target


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a new file beside `path`; on success it replaces `path`, on failure it is removed.

    A file that was there before is untouched until the rename and keeps its permissions.
    """
    target = check_target(path)
    partial = _beside(target)
    with in_one_line(path):
        os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        with in_one_line(path):
            yield partial
            if target.exists():
                shutil.copymode(target, partial)
            flush(partial)
            os.replace(partial, target)
    finally:
        partial.unlink(missing_ok=True)


@contextlib.contextmanager
def replacing_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """The same for a folder; one that was there before is moved aside, and removed at the end."""
    target = check_folder(path)
    partial, old = _beside(target), _beside(target)
    with in_one_line(path):
        partial.mkdir()
    try:
        with in_one_line(path):
            yield partial
            for file in partial.rglob("*"):
                if file.is_file():
                    flush(file)
            if target.exists():
                os.rename(target, old)
            os.rename(partial, target)
    finally:
        if old.exists() and not target.exists():
            os.rename(old, target)
        for folder in (partial, old):
            shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def replacing_pair(path: str | os.PathLike[str], suffix: str) -> Iterator[Path]:
    """The same for a header with a file of samples beside it, whose name has `suffix`.

    Both are written under their own names, in a folder.  The old header goes first and the new one
    comes last, so that no header is ever seen beside the samples of another.
    """
    target = check_pair(path, suffix)
    partial = _beside(target)
    with in_one_line(path):
        partial.mkdir()
    try:
        with in_one_line(path):
            header = partial / target.name
            yield header
            pair = (header.with_suffix(suffix), header)
            for file in pair:
                if (target.parent / file.name).exists():
                    shutil.copymode(target.parent / file.name, file)
                flush(file)
            target.unlink(missing_ok=True)
            for file in pair:
                os.replace(file, target.parent / file.name)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def check_parent(path: str | os.PathLike[str]) -> None:
    """Refuse a file whose folder is not there, or may not be written to."""
    parent = Path(os.path.realpath(path)).parent
    shown = parent if os.path.islink(path) else Path(path).parent
    if not parent.is_dir():
        raise InputError(f"{path}: there is no folder {shown}; make it first")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(f"{path}: the folder {shown} may not be written to; choose another")


def _target(path: str | os.PathLike[str]) -> Path:
    """The real path; refuses names that the system refuses, such as too long ones."""
    target = Path(os.path.realpath(path))
    with in_one_line(path), contextlib.suppress(FileNotFoundError, NotADirectoryError):
        os.stat(target)
    return target


def _beside(target: Path) -> Path:
    """A new name in the same folder, with the same suffixes."""
    return target.with_name(f".{secrets.token_hex(4)}.partial.{target.name}")


@contextlib.contextmanager
def in_one_line(path: str | os.PathLike[str]) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or one_line(error)
        raise InputError(f"{path}: cannot be written ({reason})") from error


def flush(path: Path) -> None:
    """Push the file's bytes to the disk, so that a rename never names an empty file."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def check_apart(source: Path, target: Path) -> None:
    """Refuse a target that is the input or lies in its folder, links followed.

    Raises
    ------
    InputError
        It is, or does.
    """
    # Of names that are too long `Path.exists` raises.
    if not os.path.exists(source):
        return
    read, written = source.resolve(), target.resolve()
    if read == written or (os.path.exists(target) and source.samefile(target)):
        raise InputError(f"{target}: is the input; write to another file")
    if read in written.parents:
        raise InputError(f"{target}: lies in the input {source}; write to another folder")
