"""What the coordinates of a grid are measured in, as far as the file says."""

import re

import numpy as np

from .io import Grid
from .io._geometry import spacing_of

_SHORT = {"metre": "m", "meter": "m", "metres": "m", "meters": "m", "kilometre": "km"}
_GEOGRAPHIC = re.compile(r"\s*(GEOGCS|GEOGCRS|GEODCRS|GEODETICCRS|EPSG:4326$|OGC:CRS84$)")
_UNIT = re.compile(r'UNIT\["([^"]+)"')


def axis_units(grid: Grid) -> tuple[str, ...]:
    """The unit of the coordinates of each axis: ``degree``, ``m`` or another, ``""`` if unknown."""
    horizontal = _crs_unit(grid.crs) if grid.crs else ""
    space = grid.metadata.get("space units", "")
    units = []
    for axis, name in enumerate(grid.axes):
        unit = grid.metadata.get(f"{name}:units", "")
        unit = unit or (horizontal if axis >= grid.ndim - 2 else "") or space
        units.append("degree" if unit.startswith("degree") else _SHORT.get(unit, unit))
    return tuple(units)


def in_degrees(grid: Grid) -> bool:
    """Whether the last two axes are latitude and longitude, or angles on another sphere."""
    return grid.affine is not None and axis_units(grid)[-2:] == ("degree", "degree")


def middle_latitude(grid: Grid) -> float:
    """The latitude halfway between the first and the last row of a grid `in_degrees`."""
    assert grid.affine is not None
    middle = np.append((np.array(grid.shape) - 1) / 2, 1.0)
    return float((grid.affine @ middle)[grid.ndim - 2])


def has_own_spacing(grid: Grid) -> bool:
    """Whether the spacing is not that of the coordinates, such as metres beside degrees."""
    return grid.affine is not None and not np.allclose(
        spacing_of(grid.affine), grid.spacing, rtol=1e-6
    )


def _crs_unit(crs: str) -> str:
    """The unit of the horizontal axes: the last that is named, but for those of heights."""
    if _GEOGRAPHIC.match(crs):
        found = _UNIT.findall(crs)
        return found[-1] if found else "degree"
    found = _UNIT.findall(re.split("VERT_?C", crs)[0])
    return found[-1] if found else ""
