"""How much is worked on at once: what stays in a CPU's cache, or what fills a GPU.

Results do not depend on these numbers beyond rounding.  They are read when a program is traced.
"""

from typing import NamedTuple

import jax


class WorkingSet(NamedTuple):
    """Vertices of a window of local fairing, and bytes of what a step inside works on."""

    window_vertices: int
    batch_bytes: int


# Every step of a program is a vector operation that reads and writes its whole working set.
CACHED = WorkingSet(window_vertices=4096, batch_bytes=12 * 2**20)
# A step of a GPU takes some microseconds however small it is.
FILLING = WorkingSet(window_vertices=2**19, batch_bytes=512 * 2**20)


def working_set() -> WorkingSet:
    """What suits the default device."""
    return CACHED if jax.default_backend() == "cpu" else FILLING
