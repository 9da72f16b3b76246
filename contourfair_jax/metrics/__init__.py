"""How fair a field and its contours are: length, turning, bending, parts, crossings, overshoot."""

from .._support.public import public as _public
from ..contours._line import signed_area as signed_area
from ._coarea import Coarea as Coarea
from ._coarea import SurfaceCoarea as SurfaceCoarea
from ._coarea import coarea as coarea
from ._compare import Comparison as Comparison
from ._compare import bilinear_field as bilinear_field
from ._compare import compare as compare
from ._fields import c1_jump as c1_jump
from ._fields import overshoot as overshoot
from ._lines import LevelMetrics as LevelMetrics
from ._lines import crossings as crossings
from ._lines import level_metrics as level_metrics
from ._surfaces import SurfaceMetrics as SurfaceMetrics
from ._surfaces import surface_metrics as surface_metrics

__all__ = [
    "Coarea",
    "Comparison",
    "LevelMetrics",
    "SurfaceCoarea",
    "SurfaceMetrics",
    "bilinear_field",
    "c1_jump",
    "coarea",
    "compare",
    "crossings",
    "level_metrics",
    "overshoot",
    "signed_area",
    "surface_metrics",
]

_public(
    __name__,
    "one of its functions, such as contourfair_jax.metrics.compare(field)",
    {
        "surface_coarea": "contourfair_jax.metrics.coarea",
    },
)
