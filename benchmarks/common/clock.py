"""Times of JAX functions and their ratios: compiled before, blocked until ready, medians."""

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


def ratio(
    first: Callable[[], Any], second: Callable[[], Any], repeats: int = 3, budget: float = 8.0
) -> float:
    """Median of the seconds of one function over those of another, run in turn.

    The speed of a machine drifts, but hardly within one round.  The warm-up is the first round and
    counts only where it takes longer than the budget: give functions compiled.

    Parameters
    ----------
    first, second : callable
    repeats : int
        Rounds at most.
    budget : float
        Seconds after which no further round starts.
    """

    def once() -> tuple[float, float]:
        return ready(first), ready(second)

    warm = once()
    rounds = [warm] if sum(warm) > budget else [once()]
    while len(rounds) < repeats and sum(map(sum, rounds)) < budget:
        rounds.append(once())
    return statistics.median(one / other for one, other in rounds)
