"""Sizes checked against this machine's memory, alone because readers start with it only."""

import os

from .errors import InputError

_FALLBACK = 16 * 2**30


def physical_memory() -> int:
    """Bytes of main memory, or 16 GiB where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return _FALLBACK


def check_memory(nbytes: int, what: str) -> None:
    """Refuse arrays that cannot fit; `what` starts the message."""
    limit = physical_memory()
    if nbytes > limit:
        raise InputError(
            f"{what} needs {describe_bytes(nbytes)}, this machine has {describe_bytes(limit)}; "
            "use a smaller grid, or cut it into pieces"
        )


def describe_bytes(nbytes: int) -> str:
    """`nbytes` with a binary unit, such as ``1.5 GiB``."""
    size = float(nbytes)
    for unit in ("bytes", "KiB", "MiB", "GiB"):
        if size < 1024:
            return f"{size:.0f} {unit}" if unit == "bytes" else f"{size:.1f} {unit}"
        size /= 1024
    return f"{size:.1f} TiB"
