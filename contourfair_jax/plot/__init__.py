"""Pictures of fields and their contours.

Matplotlib is imported when a picture is drawn, and drawn on plain `Figure` objects: no display is
needed, and nothing of `pyplot`'s state is touched.
"""

from .._support.public import public as _public
from ._figures import compare_figure as compare_figure
from ._figures import contour_figure as contour_figure
from ._figures import plot_contours as plot_contours
from ._figures import save_figure as save_figure
from ._levels import draw_filled as draw_filled
from ._levels import draw_lines as draw_lines
from ._levels import level_colors as level_colors
from ._surfaces import draw_surface as draw_surface
from ._surfaces import surface_figure as surface_figure
from ._values import Refinable as Refinable

__all__ = [
    "Refinable",
    "compare_figure",
    "contour_figure",
    "draw_filled",
    "draw_lines",
    "draw_surface",
    "level_colors",
    "plot_contours",
    "save_figure",
    "surface_figure",
]

_public(
    __name__,
    "one of its functions, such as contourfair_jax.plot.contour_figure(field, levels)",
    {
        "BilinearField": (
            "contourfair_jax._bezier.linear.BilinearField",
            "contourfair_jax.metrics.bilinear_field",
        ),
        "draw_bands": "contourfair_jax.plot.draw_filled",
    },
)
