"""Quadtrees and octrees that follow a field as closely as asked, and no finer than needed.

Each leaf interpolates the values at its corners (bi- or trilinearly).  The interpolant is a cubic
too, whose Bezier points lie on it at thirds of the leaf; the field stays as near to it as its
Bezier points do, which proves the error.  Where leaves of two sizes meet, the vertices in the
middle of the larger one's edges and faces take its values, so that the whole is continuous; the
proof is for the values that result.
"""

from .._support.public import public as _public
from ._adaptive import AdaptiveField as AdaptiveField
from ._adaptive import adaptive as adaptive
from ._adaptive import check_error as check_error
from ._adaptive import uniform_error as uniform_error

__all__ = [
    "AdaptiveField",
    "adaptive",
    "check_error",
    "uniform_error",
]

_public(
    __name__,
    "field.adaptive(error) or contourfair_jax.adaptive.adaptive(field, error)",
)
