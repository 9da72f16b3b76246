"""Contour lines of a 2-D field: on the field, complete, and never crossing.

Lines are found in the Bezier form of the field, in float64 on the host.  Cells whose Bezier points
are all on one side of a level cannot hold it and are skipped.  The others are halved until their
Bezier points prove that a level is one or two simple arcs in them, and that chords keep to the
tolerance.  Every vertex is a root of the field along a straight line.  Chords stay within convex
pieces that they share with no other arc in wrong order, so lines cannot cross.

The line of a level v is the border of {f > v}.  Places that are flat but for rounding would make
specks at the level of the plateau, so v is raised by `5e-10` of the range of the samples and 16
roundings of the largest sample: a plateau counts as below its own level.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias, overload

import numpy as np

from ._arcs import Arcs, arcs, concatenate
from ._cells import cells_with_values, grid_cells
from ._codes import Codes
from ._field import BezierField
from ._fill import Filler, Polygon
from ._lengths import signed_area
from ._link import link
from ._subdivide import leaves
from .io import ContourLine as ContourLine

Levels: TypeAlias = float | Sequence[float] | np.ndarray

MOST_LEVELS = 10_000
LEAST_TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class Contours(Sequence[ContourLine]):
    """The lines of all levels, sorted by level: a sequence of `ContourLine`.

    Parameters
    ----------
    lines : tuple of ContourLine
        Each with its `.level`, `.points` of shape (n, 2) in physical coordinates, and `.closed`; a
        closed line repeats its first point.  The field is larger on the left of the direction of a
        line in the plane of the coordinates (0, 1): a loop around a summit has positive area.
    levels : tuple of float
        Sorted, each once.
    unproved : int
        Pieces of cells, at most `2**-12` cells wide, where the bounds could not prove that lines
        are complete: places where the gradient vanishes on the level, as at the border of a plateau
        at the level.  Otherwise 0.
    notes : tuple of str
        What is to be known about levels without lines.
    """

    lines: tuple[ContourLine, ...]
    levels: tuple[float, ...]
    unproved: int
    notes: tuple[str, ...]

    @overload
    def __getitem__(self, index: int) -> ContourLine: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[ContourLine, ...]: ...

    def __getitem__(self, index: int | slice) -> ContourLine | tuple[ContourLine, ...]:
        return self.lines[index]

    def __len__(self) -> int:
        return len(self.lines)

    def __iter__(self) -> Iterator[ContourLine]:
        return iter(self.lines)

    def __repr__(self) -> str:
        return (
            f"Contours({len(self.lines)} lines at {len(self.levels)} levels, "
            f"{self.unproved} pieces unproved)"
        )


def contours(field: BezierField, levels: Levels, tolerance: float = 0.01) -> Contours:
    """The contour lines of a 2-D field.

    Parameters
    ----------
    field : BezierField
    levels : float or sequence of float
        In any order; each counts once.
    tolerance : float
        Chords stay within this distance of the true contour, in cells.

    Returns
    -------
    Contours
        A sequence of lines.  Lines end at the border of the grid and at cells that hold NaN.

    Raises
    ------
    ValueError
        For a field that is not 2-D, levels that are not finite or more than 10 000, or a tolerance
        below 1e-8.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> x = jnp.linspace(-1.0, 1.0, 10)
    >>> field = cf.fair_field(jnp.hypot(x[:, None], x[None, :]), spacing=2 / 9, origin=-1.0)
    >>> (circle,) = field.contours(0.5)
    >>> circle.closed
    True
    """
    chosen = check_levels(levels)
    check_tolerance(tolerance)
    net, spacing, origin = host_arrays(field)
    codes = Codes(len(chosen), max(net.shape) // 3)
    found, unproved = trace(net, raised(net, chosen), tolerance, codes)
    lines = []
    for part in link(found, codes):
        part.points[:] = part.points * spacing + origin
        values, loops = chosen[part.level].tolist(), part.closed.tolist()
        lines += [
            ContourLine(value, piece, loop)
            for value, piece, loop in zip(values, part.pieces(), loops, strict=True)
            if len(piece) > 1 + 2 * loop
        ]
    notes = _notes(chosen, lines, unproved)
    return Contours(tuple(lines), tuple(chosen.tolist()), unproved, notes)


@dataclass(frozen=True, eq=False)
class Band:
    """Where a field is above one level and at most at the next.

    Parameters
    ----------
    lower, upper : float
    polygons : tuple of tuples of arrays, each of shape (n, 2)
        For each part its outer ring, of positive area in the plane of the coordinates (0, 1), then
        its holes, of negative area.  Rings repeat their first point.
    """

    lower: float
    upper: float
    polygons: tuple[Polygon, ...]

    @property
    def area(self) -> float:
        """Area of the band, holes taken off."""
        return sum(signed_area(ring) for polygon in self.polygons for ring in polygon)

    def __repr__(self) -> str:
        return f"Band({self.lower:g} to {self.upper:g}, {len(self.polygons)} polygons)"


def filled(field: BezierField, levels: Levels, tolerance: float = 0.01) -> list[Band]:
    """The bands between neighbouring levels of a 2-D field, as polygons.

    Parameters
    ----------
    field : BezierField
    levels : sequence of float
        At least two, in any order; `-inf` and `inf` are for all that is below or above.
    tolerance : float
        As for `contours`: bands are bounded by its lines, and by the border of the grid and of
        cells that hold NaN.

    Returns
    -------
    list of Band
        One for each pair of neighbouring levels.

    Raises
    ------
    ValueError
        As for `contours`, and for fewer than two levels.
    """
    ends = np.unique(np.asarray(levels, dtype=np.float64))
    finite = check_levels(ends[~np.isinf(ends)])
    if len(ends) < 2:
        raise ValueError(f"levels must be at least two to have a band between, got {len(ends)}")
    check_tolerance(tolerance)
    net, spacing, origin = host_arrays(field)
    traced = raised(net, finite)
    codes = Codes(len(finite), max(net.shape) // 3)
    found, _ = trace(net, traced, tolerance, codes)
    parts = list(link(found, codes))
    filler = Filler(net[::3, ::3], cells_with_values(net), parts, codes)
    limits = np.concatenate([ends[ends == -np.inf], traced, ends[ends == np.inf]])
    number = np.searchsorted(finite, ends)
    number[ends == -np.inf] = -1
    bands = []
    for k in range(len(ends) - 1):
        pair = int(number[k]), int(number[k + 1])
        polygons = filler.band(*pair, (limits[k], limits[k + 1]))
        moved = [tuple(ring * spacing + origin for ring in polygon) for polygon in polygons]
        bands.append(Band(float(ends[k]), float(ends[k + 1]), tuple(moved)))
    return bands


def trace(net: np.ndarray, levels: np.ndarray, tolerance: float, codes: Codes) -> tuple[Arcs, int]:
    """The arcs of sorted levels in a control net, and how many pieces were not proved."""
    found: list[Arcs] = []
    unproved = 0
    rounding = 4 * _rounding(net)
    for cells in grid_cells(net, levels):
        for group in leaves(cells, levels, tolerance, rounding):
            unproved += int(np.count_nonzero(~group.proved))
            found += arcs(group, levels, codes)
    return concatenate(found), unproved


def raised(net: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """The levels that are traced, above plateaus at the levels that were asked for."""
    samples = net[::3, ::3]
    samples = samples[np.isfinite(samples)]
    spread = float(np.ptp(samples)) if samples.size else 0.0
    return levels + (5e-10 * spread + 16 * _rounding(net))


def _rounding(net: np.ndarray) -> float:
    """Rounding of the largest sample in the precision that the net was computed in."""
    samples = np.abs(net[::3, ::3])
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


def _notes(levels: np.ndarray, lines: Sequence[ContourLine], unproved: int) -> tuple[str, ...]:
    notes = []
    empty = sorted(set(levels.tolist()) - {line.level for line in lines})
    if empty:
        listed = ", ".join(f"{level:g}" for level in empty[:5]) + (", ..." if empty[5:] else "")
        notes.append(f"{len(empty)} of {len(levels)} levels have no line: {listed}")
    if unproved:
        notes.append(f"{unproved} pieces of cells may hold details that the lines do not show")
    return tuple(notes)
