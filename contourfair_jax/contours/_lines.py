"""Contour lines of a 2-D field."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._bezier.nets import PlacedNet
from .._level_sets import (
    Levels,
    check_levels,
    check_tolerance,
    distinct,
    level_notes,
    listed,
    unproved_note,
    values_of,
)
from .._support.checks import Scalar
from .._support.results import Members, Progress, untold
from ._arcs import Codes
from ._line import ContourLine
from ._trace import host_arrays, link, trace


@dataclass(frozen=True, eq=False)
class Contours(Members[ContourLine]):
    """The lines of all levels, sorted by level: a sequence of `ContourLine`.

    Parameters
    ----------
    lines : tuple of ContourLine
        Each with its `.level`, `.points` of shape (n, 2) in physical coordinates, and `.closed`; a
        closed line repeats its first point.  The field is larger on the left of the direction of a
        line in the plane of the coordinates (0, 1): a loop around a summit has positive area.
    levels : tuple of float
        Sorted, each once, without those too close to another to be told apart.
    unproved : int
        Pieces of cells, at most `2**-12` cells wide, where the bounds could not prove that lines
        are complete: places where the gradient vanishes on the level, as at the border of a plateau
        at the level.  Otherwise 0.
    notes : tuple of str
        What is to be known about the levels: which have no line, are too close to another, or
        are those of many samples; and how far rounding moves lines, where that is much.
    """

    lines: tuple[ContourLine, ...]
    levels: tuple[float, ...]
    unproved: int
    notes: tuple[str, ...]

    @property
    def members(self) -> tuple[ContourLine, ...]:
        """The lines."""
        return self.lines

    def __repr__(self) -> str:
        return (
            f"Contours({len(self.lines)} lines at {len(self.levels)} levels, "
            f"{self.unproved} pieces unproved)"
        )


def contours(
    field: PlacedNet,
    levels: Levels,
    tolerance: Scalar = 0.01,
    *,
    progress: Progress = untold,
) -> Contours:
    """The contour lines of a 2-D field.

    Parameters
    ----------
    field : BezierField
    levels : float or sequence of float
        In any order; each counts once.
    tolerance : float
        Chords stay within this distance of the true contour, in cells.
    progress : callable
        Called with the number of rows of cells that are traced and of all.

    Returns
    -------
    Contours
        A sequence of lines.  Lines end at the border of the grid and at cells that hold NaN.

    Raises
    ------
    ValueError
        For a field that is not 2-D, levels that are not finite or more than 10 000, or a tolerance
        below 1e-8.

    Notes
    -----
    A line of level v is the border of {f > v}: samples on a level count as below it, and a plateau
    at the level is surrounded, not crossed.  Against rounding the lines are those of a level higher
    by 5e-10 of the range of the samples, or by two roundings of the largest sample (2.2e-16 of it
    in float64, 1.2e-7 in float32) where these are more; levels closer than that count once.  The
    levels reported are those asked for.  For samples that are whole numbers, levels halfway between
    have no plateaus.

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
    tolerance = check_tolerance(tolerance)
    net, spacing, origin = host_arrays(field)
    values = values_of(net)
    kept = distinct(chosen, values.shift())
    codes = Codes(len(kept), max(net.shape) // 3)
    all_arcs, unproved = trace(net, values, kept, tolerance, codes, progress)
    lines = []
    for part in link(all_arcs, codes):
        part.points[:] = part.points * spacing + origin
        at, loops = kept[part.level].tolist(), part.closed.tolist()
        lines += [
            ContourLine(level, piece, loop)
            for level, piece, loop in zip(at, part.pieces(), loops, strict=True)
            if len(piece) > 1 + 2 * loop
        ]
    notes = level_notes(chosen, kept, values, net[::3, ::3]) + _without_lines(kept, lines)
    notes += unproved_note(unproved, "lines")
    return Contours(tuple(lines), tuple(kept.tolist()), unproved, notes)


def _without_lines(levels: np.ndarray, lines: Sequence[ContourLine]) -> tuple[str, ...]:
    empty = np.setdiff1d(levels, [line.level for line in lines])
    if not len(empty):
        return ()
    return (f"{len(empty)} of {len(levels)} levels have no line: {listed(empty)}",)
