"""Levels from the options ``--levels``, ``--interval`` and ``--count``."""

import math

import numpy as np

from .._support.errors import InputError

# As in `_level_sets`, which imports JAX.
MOST_LEVELS, _USUAL_COUNT = 10_000, 10


def check_level_options(
    levels: str | None = None, interval: float | None = None, count: int | None = None
) -> None:
    """Refuse options of these names that are wrong whatever the samples are."""
    if sum(option is not None for option in (levels, interval, count)) > 1:
        raise InputError("give only one of --levels, --interval and --count")
    if levels is not None:
        listed_levels(levels)
    if interval is not None and not (math.isfinite(interval) and interval > 0):
        raise InputError(f"interval must be positive, got {interval:g}")
    if count is not None and not 1 <= count <= MOST_LEVELS:
        raise InputError(f"count must be 1 to {MOST_LEVELS}, got {count}")


def even_levels(values: np.ndarray, count: int) -> list[float]:
    """`count` levels that divide the range of `values` into equal parts; none if it is flat."""
    from .. import _level_sets

    check_level_options(count=count)
    return _level_sets.even_levels(values, count).tolist()


def interval_levels(values: np.ndarray, interval: float) -> list[float]:
    """The multiples of `interval` strictly inside the range of `values`."""
    check_level_options(interval=interval)
    lowest, highest = value_range(values)
    if (highest - lowest) / interval > MOST_LEVELS:
        raise InputError(
            f"interval {interval:g} makes more than {MOST_LEVELS} levels "
            f"between {lowest:g} and {highest:g}; use a larger one"
        )
    first, last = math.floor(lowest / interval) + 1, math.ceil(highest / interval) - 1
    return [float(k * interval) for k in range(first, last + 1)]


def choose_levels(
    values: np.ndarray, levels: str | None, interval: float | None, count: int | None
) -> tuple[list[float], str]:
    """The levels that the options of the same names ask for (10 by default), and a note."""
    check_level_options(levels, interval, count)
    if levels is not None:
        chosen = listed_levels(levels)
    elif interval is not None:
        chosen = interval_levels(values, interval)
    else:
        chosen = even_levels(values, _USUAL_COUNT if count is None else count)
    lowest, highest = value_range(values)
    outside = [level for level in chosen if not lowest <= level <= highest]
    if len(outside) == len(chosen):
        return chosen, f"no level lies within the samples, which are {lowest:g} to {highest:g}"
    if outside:
        some = f"{len(outside)} of {len(chosen)} levels"
        return chosen, f"{some} are outside the samples, which are {lowest:g} to {highest:g}"
    return chosen, ""


def listed_levels(text: str) -> list[float]:
    """Numbers separated by commas, sorted, each once."""
    try:
        chosen = sorted({float(part) for part in text.split(",")})
    except ValueError as error:
        raise InputError(f"levels must be numbers with commas, got {text!r}") from error
    if not np.isfinite(chosen).all() or len(chosen) > MOST_LEVELS:
        raise InputError(f"levels must be at most {MOST_LEVELS} finite numbers, got {text[:40]!r}")
    return chosen


def value_range(values: np.ndarray) -> tuple[float, float]:
    """Smallest and largest sample that is not NaN."""
    present = values[~np.isnan(values)]
    if not present.size:
        raise InputError("every sample is missing")
    return float(present.min()), float(present.max())
