"""The bands between the levels of a 2-D field."""

from dataclasses import dataclass

import numpy as np

from .._bezier.nets import PlacedNet, cells_with_values
from .._level_sets import (
    Levels,
    check_levels,
    check_tolerance,
    distinct,
    level_notes,
    unproved_note,
    values_of,
)
from .._support.checks import Scalar
from .._support.results import Members, Progress, untold
from ._arcs import Codes
from ._fill import Filler, Polygon
from ._line import signed_area
from ._trace import host_arrays, link, trace


@dataclass(frozen=True, eq=False)
class Band:
    """The places where a field is above one level and at most at the next.

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


@dataclass(frozen=True, eq=False)
class Bands(Members[Band]):
    """The bands between neighbouring levels, from low to high: a sequence of `Band`.

    Parameters
    ----------
    bands : tuple of Band
    levels : tuple of float
        Their ends, sorted, without those too close to another to be told apart.
    unproved : int
        As for `Contours`: pieces of cells where bands may lack details.  Otherwise 0.
    notes : tuple of str
        What is to be known about the levels.
    """

    bands: tuple[Band, ...]
    levels: tuple[float, ...]
    unproved: int
    notes: tuple[str, ...]

    @property
    def members(self) -> tuple[Band, ...]:
        """The bands."""
        return self.bands

    def __repr__(self) -> str:
        return f"Bands({len(self.bands)} bands, {self.unproved} pieces unproved)"


def filled(
    field: PlacedNet,
    levels: Levels,
    tolerance: Scalar = 0.01,
    *,
    progress: Progress = untold,
) -> Bands:
    """The bands between neighbouring levels of a 2-D field, as polygons.

    Parameters
    ----------
    field : BezierField
    levels : sequence of float
        At least two, in any order; `-inf` and `inf` are for all that is below or above.
    tolerance : float
        As for `contours`: bands are bounded by its lines, and by the border of the grid and of
        cells that hold NaN.
    progress : callable
        Called with the number of rows of cells that are traced and of all.

    Returns
    -------
    Bands
        A sequence of one `Band` for each pair of neighbouring levels.

    Raises
    ------
    ValueError
        As for `contours`, and for fewer than two levels that can be told apart.

    Notes
    -----
    A band is {lower < f <= upper}: a sample or plateau on a level belongs to the band below it.
    Levels are raised against rounding as for `contours`; those reported are those asked for.
    """
    asked = check_levels(levels, infinite=True)
    tolerance = check_tolerance(tolerance)
    net, spacing, origin = host_arrays(field)
    values = values_of(net)
    ends = distinct(asked, values.shift())
    if len(ends) < 2:
        raise ValueError(
            f"levels must be at least two to have a band between, got {len(ends)} more than "
            f"{values.shift():.1g} apart"
        )
    finite = ends[np.isfinite(ends)]
    codes = Codes(len(finite), max(net.shape) // 3)
    all_arcs, unproved = trace(net, values, finite, tolerance, codes, progress)
    parts = list(link(all_arcs, codes))
    samples = net[::3, ::3].astype(np.float64) - values.middle
    filler = Filler(samples, cells_with_values(net), parts, codes)
    limits = np.concatenate([ends[ends == -np.inf], values.placed(finite), ends[ends == np.inf]])
    number = np.searchsorted(finite, ends)
    number[ends == -np.inf] = -1
    bands = []
    for k in range(len(ends) - 1):
        pair = int(number[k]), int(number[k + 1])
        polygons = filler.band(*pair, (limits[k], limits[k + 1]))
        placed = [tuple(ring * spacing + origin for ring in polygon) for polygon in polygons]
        bands.append(Band(float(ends[k]), float(ends[k + 1]), tuple(placed)))
    notes = level_notes(asked, ends, values, net[::3, ::3]) + unproved_note(unproved, "bands")
    return Bands(tuple(bands), tuple(ends.tolist()), unproved, notes)
