"""From a field and levels to arcs: checks, and arrays on the host."""

from collections.abc import Sequence
from typing import TypeAlias

import jax
import numpy as np

from ._arcs import Arcs, arcs, concatenate
from ._bezier import PlacedNet
from ._cells import grid_cells
from ._codes import Codes
from ._display import Progress, untold
from ._host import known
from ._shift import Values
from ._subdivide import leaves

Levels: TypeAlias = float | Sequence[float] | np.ndarray

MOST_LEVELS = 10_000
LEAST_TOLERANCE = 1e-8


def trace(
    net: np.ndarray,
    values: Values,
    levels: np.ndarray,
    tolerance: float,
    codes: Codes,
    progress: Progress = untold,
) -> tuple[Arcs, int]:
    """The arcs of sorted levels in a control net, and how many pieces were not proved.

    `progress` is called with the number of rows of cells that are done and of all.
    """
    rows = (len(net) - 1) // 3
    placed = values.placed(levels)
    found: list[Arcs] = []
    unproved = 0
    for cells in grid_cells(net, placed, values.middle):
        for group in leaves(cells, placed, tolerance, 4 * values.rounding):
            unproved += int(np.count_nonzero(~group.proved))
            found += arcs(group, placed, codes)
        progress(int(cells.corner[0, -1]) + 1, rows)
    return concatenate(found), unproved


def host_arrays(field: PlacedNet) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Net, spacing and origin of a 2-D field on the host.

    Raises
    ------
    ValueError
        For a field that is not 2-D, or traced.
    """
    field = known(field)
    if field.ndim != 2:
        raise ValueError(
            f"field must be 2-D to have contour lines, got {field.ndim}-D; "
            "take a slice of the samples, or the isosurface"
        )
    spacing, origin = (np.asarray(x, dtype=np.float64) for x in (field.spacing, field.origin))
    return np.asarray(field.control_points), spacing, origin


def check_levels(levels: Levels, infinite: bool = False) -> np.ndarray:
    """Sorted finite levels, each once; with `-inf` and `inf` where `infinite` allows them.

    Raises
    ------
    ValueError
        For levels that are masked or not real and finite, or too many.
    """
    try:
        array = levels if isinstance(levels, np.ma.MaskedArray) else np.asarray(levels)
    except ValueError as error:
        raise ValueError(f"levels must be real numbers in one sequence, got {levels!r}") from error
    if array.ndim > 1 or (array.size and array.dtype.kind not in "fiu"):
        raise ValueError(
            f"levels must be real numbers in one sequence, got shape {array.shape} and dtype "
            f"{array.dtype}"
        )
    array = np.atleast_1d(np.ma.filled(array.astype(np.float64), np.nan))
    wrong = np.count_nonzero(np.isnan(array) if infinite else ~np.isfinite(array))
    if wrong:
        raise ValueError(
            f"levels must be finite and not masked, got {wrong} that are not; leave them out"
        )
    array = np.unique(array)
    if len(array) > MOST_LEVELS:
        raise ValueError(
            f"levels must be at most {MOST_LEVELS}, got {len(array)}; call once for each part"
        )
    return array


def check_tolerance(tolerance: float | np.ndarray | jax.Array) -> float:
    """The tolerance as a float.

    Raises
    ------
    ValueError
        Unless it is one real number, array or not, that is a usable number of cells.
    """
    known = isinstance(tolerance, int | float | np.number | np.ndarray | jax.Array)
    array = np.asarray(tolerance if known else "")
    known = array.ndim == 0 and array.dtype.kind in "fiu"
    if not known or not LEAST_TOLERANCE <= array < np.inf:
        raise ValueError(
            f"tolerance must be a distance in cells of at least {LEAST_TOLERANCE:g}, "
            f"got {tolerance!r}; 0.01 is fine enough for pictures and maps"
        )
    return float(array)
