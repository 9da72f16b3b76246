"""Times of JAX functions: compilation apart, warmed up, blocked until ready, medians."""

import statistics
import time
from collections.abc import Callable
from typing import Any

import jax


def ready(function: Callable[[], Any]) -> float:
    """Seconds of one call until its arrays are ready."""
    start = time.perf_counter()
    jax.block_until_ready(function())
    return time.perf_counter() - start


def median(function: Callable[[], Any], repeats: int = 7, budget: float = 20.0) -> float:
    """Median seconds over ``repeats`` calls after one warm-up.

    A warm-up longer than the budget is the result itself: give such functions compiled.

    Parameters
    ----------
    function : callable
    repeats : int
        Calls at most.
    budget : float
        Seconds after which no further call starts.
    """
    first = ready(function)
    if first > budget:
        return first
    times = [ready(function)]
    while len(times) < repeats and sum(times) < budget:
        times.append(ready(function))
    return statistics.median(times)
