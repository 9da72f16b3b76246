"""A line on the terminal that tells how far a compiled search has come."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

import jax
from rich.console import Console
from rich.status import Status

# Called with how much is done, and how much there is to do.
Progress: TypeAlias = Callable[[int, int], None]

# The displays in use, innermost last: compiled programs call `tell`, and know of no display.
_ACTIVE: list[Status] = []


def tell(step: object, loss: object, gradient: object) -> None:
    """Show how far the search is; called by the compiled program."""
    if _ACTIVE:
        text = f"step {int(step)}: loss {float(loss):.4g}, gradient {float(gradient):.1e}"  # pyright: ignore
        _ACTIVE[-1].update(text)


@contextmanager
def shown(progress: bool) -> Iterator[None]:
    """Show a line on stderr while the block runs, if `progress`."""
    if not progress:
        yield
        return
    with Status("compiling", console=Console(stderr=True)) as status:
        _ACTIVE.append(status)
        try:
            yield
            jax.effects_barrier()
        finally:
            _ACTIVE.remove(status)


def untold(done: int, total: int) -> None:
    """Show nothing of what is done."""
