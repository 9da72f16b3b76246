"""Contour lines of a 2-D field: on the field, complete, and never crossing.

Lines are found in the Bezier form of the field, in float64 on the host.  Cells whose Bezier points
are all on one side of a level cannot hold it and are skipped.  The others are halved until their
Bezier points prove that a level is one or two simple arcs in them, and that chords keep to the
tolerance.  Every vertex is a root of the field along a straight line.  Within a convex piece chords
keep the order of the arcs that they stand for, so lines cannot cross.

The line of a level v is the border of {f > v}, with v raised by a little more than rounding
(`_shift`): a plateau counts as below its own level.
"""

from .._level_sets import Levels as Levels
from .._support.public import public as _public
from ._bands import Band as Band
from ._bands import Bands as Bands
from ._bands import filled as filled
from ._line import ContourLine as ContourLine
from ._lines import Contours as Contours
from ._lines import contours as contours

__all__ = [
    "Band",
    "Bands",
    "ContourLine",
    "Contours",
    "Levels",
    "contours",
    "filled",
]

_public(
    __name__,
    "field.contours(levels) or contourfair_jax.contours.contours(field, levels)",
)
