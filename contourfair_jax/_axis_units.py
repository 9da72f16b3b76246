"""What the coordinates of a grid are measured in, as far as the file says."""

import re

import numpy as np

from .io import Grid
from .io._geometry import spacing_of

_SHORT = {"metre": "m", "meter": "m", "metres": "m", "meters": "m", "kilometre": "km"}
_GEOGRAPHIC = re.compile(r"\s*(GEOGCS|GEOGCRS|GEODCRS|GEODETICCRS|EPSG:4326$|OGC:CRS84$)")
# Degrees whose lengths on the ground have this proportion, or more, need no note.
_ALIKE = 0.95
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


def length_unit(grid: Grid) -> str:
    """The unit of distances in the grid, ``""`` where it is unknown or differs between axes."""
    units = set(axis_units(grid))
    return units.pop() if len(units) == 1 and not has_own_spacing(grid) else ""


def degrees_note(grid: Grid) -> tuple[str, ...]:
    """A note where degrees along the last axis are clearly shorter than those along the one before.

    Not where the grid has a spacing of its own, such as metres.
    """
    if not in_degrees(grid) or has_own_spacing(grid):
        return ()
    assert grid.affine is not None
    ends = np.array([np.zeros(grid.ndim), np.array(grid.shape) - 1.0])
    latitudes = (ends @ grid.affine[:-1, :-1].T + grid.affine[:-1, -1])[:, grid.ndim - 2]
    farthest = float(np.abs(latitudes).max())
    narrowing = float(np.cos(np.radians(farthest)))
    if narrowing > _ALIKE:
        return ()
    return (
        f"distances are taken in degrees, of which one of longitude is {narrowing:.2f} of one of "
        f"latitude at {farthest:.4g} degrees: reproject the file, or give spacing in Python, to "
        "have distances on the ground",
    )


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
