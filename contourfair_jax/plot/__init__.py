"""Pictures of fields and their contours.

Matplotlib is imported when a picture is drawn, and drawn on plain `Figure` objects: no display is
needed, and nothing of `pyplot`'s state is touched.
"""

from .._bezier.linear import BilinearField as BilinearField
from ._figures import compare_figure as compare_figure
from ._figures import contour_figure as contour_figure
from ._figures import plot_contours as plot_contours
from ._figures import save_figure as save_figure
from ._levels import draw_bands as draw_bands
from ._levels import draw_lines as draw_lines
from ._levels import level_colors as level_colors
from ._surfaces import draw_surface as draw_surface
from ._surfaces import surface_figure as surface_figure
from ._values import Refinable as Refinable

__all__ = [
    "BilinearField",
    "Refinable",
    "compare_figure",
    "contour_figure",
    "draw_bands",
    "draw_lines",
    "draw_surface",
    "level_colors",
    "plot_contours",
    "save_figure",
    "surface_figure",
]
