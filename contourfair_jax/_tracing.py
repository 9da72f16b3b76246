"""From a field and levels to arcs: checks, arrays on the host, and what level is traced."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from ._arcs import Arcs, arcs, concatenate
from ._cells import grid_cells
from ._codes import Codes
from ._field import BezierField
from ._subdivide import leaves

Levels: TypeAlias = float | Sequence[float] | np.ndarray

MOST_LEVELS = 10_000
LEAST_TOLERANCE = 1e-8


def trace(net: np.ndarray, levels: np.ndarray, tolerance: float, codes: Codes) -> tuple[Arcs, int]:
    """The arcs of sorted levels in a control net, and how many pieces were not proved."""
    found: list[Arcs] = []
    unproved = 0
    rounding = 4 * rounding_of(net)
    for cells in grid_cells(net, levels):
        for group in leaves(cells, levels, tolerance, rounding):
            unproved += int(np.count_nonzero(~group.proved))
            found += arcs(group, levels, codes)
    return concatenate(found), unproved


def raised(net: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """The levels that are traced, above plateaus at the levels that were asked for."""
    samples = net[(slice(None, None, 3),) * net.ndim]
    samples = samples[np.isfinite(samples)]
    spread = float(np.ptp(samples)) if samples.size else 0.0
    return levels + (5e-10 * spread + 16 * rounding_of(net))


def rounding_of(net: np.ndarray) -> float:
    """Rounding of the largest sample in the precision that the net was computed in."""
    samples = np.abs(net[(slice(None, None, 3),) * net.ndim])
    largest = samples.max(initial=0.0, where=np.isfinite(samples))
    return float(np.finfo(net.dtype).eps) * float(largest)


def host_arrays(field: BezierField) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Net, spacing and origin of a 2-D field on the host.

    Raises
    ------
    ValueError
        For a field that is not 2-D.
    """
    if field.ndim != 2:
        raise ValueError(
            f"field must be 2-D to have contour lines, got {field.ndim}-D; "
            "take a slice of the samples, or the isosurface"
        )
    spacing, origin = (np.asarray(x, dtype=np.float64) for x in (field.spacing, field.origin))
    return np.asarray(field.control_points), spacing, origin


def check_levels(levels: Levels) -> np.ndarray:
    """Sorted finite levels, each once.

    Raises
    ------
    ValueError
        For levels that are not real and finite, or too many.
    """
    array = np.asarray(levels)
    if array.ndim > 1 or (array.size and array.dtype.kind not in "fiu"):
        raise ValueError(
            f"levels must be real numbers in one sequence, got shape {array.shape} and dtype "
            f"{array.dtype}"
        )
    array = np.atleast_1d(array).astype(np.float64)
    wrong = np.count_nonzero(~np.isfinite(array))
    if wrong:
        raise ValueError(f"levels must be finite, got {wrong} that are not; leave them out")
    array = np.unique(array)
    if len(array) > MOST_LEVELS:
        raise ValueError(
            f"levels must be at most {MOST_LEVELS}, got {len(array)}; call once for each part"
        )
    return array


def check_tolerance(tolerance: float) -> None:
    """Raise ValueError unless the tolerance is a usable number of cells."""
    known = isinstance(tolerance, int | float | np.number) and not isinstance(tolerance, bool)
    if not known or not LEAST_TOLERANCE <= tolerance < np.inf:
        raise ValueError(
            f"tolerance must be a distance in cells of at least {LEAST_TOLERANCE:g}, "
            f"got {tolerance!r}; 0.01 is fine enough for pictures and maps"
        )
