"""How much is worked on at once: what stays in a CPU's cache, or what fills a GPU.

Results do not depend on these numbers beyond rounding.  They are read when a program is traced.
"""

import os
from typing import NamedTuple

import jax


class WorkingSet(NamedTuple):
    """Vertices of a window of local fairing, and bytes of what a step inside works on.

    `core_bytes` is what each of `cores` works on where every one has a batch of its own.
    """

    window_vertices: int
    batch_bytes: int
    cores: int
    core_bytes: int


def _processors() -> int:
    """Those that the process may use, where the system can say: XLA starts as many threads."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


CORES = min(_processors(), 16)

# Every step of a program is a vector operation that reads and writes its whole working set.
CACHED = WorkingSet(2048 * CORES, 12 * 2**20, CORES, 3 * 2**20)
# A step of a GPU takes some microseconds however small it is.
FILLING = WorkingSet(2**19, 512 * 2**20, 1, 512 * 2**20)


def working_set() -> WorkingSet:
    """What suits the default device."""
    return CACHED if jax.default_backend() == "cpu" else FILLING
