"""Inputs are never written to."""

import os
from pathlib import Path

from .io import InputError


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
