"""Reference systems and units of axes, as far as a file says them."""

import re
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from .affine import spacing_of
from .grid import Grid

_X_NAMES = frozenset(("x", "lon", "longitude", "easting"))
_Y_NAMES = frozenset(("y", "lat", "latitude", "northing"))
# The outermost system of coordinates, of WKT 1 or 2, without that of heights or of a target.
_SYSTEM = re.compile(r"(PROJCS|PROJCRS|PROJECTEDCRS|GEOGCS|GEOGCRS|GEODCRS|GEODETICCRS)[\[(]")
_NEXT = re.compile(r",\s*(?:VERT_CS|VERTCRS|VERTICALCRS|TARGETCRS)[\[(]")
# Longitudes and latitudes with a pole of their own have other names, which a grid does not know.
_DERIVED = re.compile(r"DERIVINGCONVERSION|ob_tran|rotated_?pole|Rotated_?latitude", re.IGNORECASE)
_LENGTH = re.compile(r'\b(?:LENGTHUNIT|UNIT)[\[(]"([^"]*)",\s*([0-9.eE+-]+)')
_METRES = {"m": 1.0, "km": 1e3, "foot": 0.3048, "US_survey_foot": 1200 / 3937}


def axis_attributes(crs: str | None, axes: Sequence[str]) -> dict[str, dict[str, str]]:
    """Standard name and units of the axes that lie along x and y of a coordinate reference system.

    None for other axes, and none at all for a system that is neither projected nor geographic or
    is not known here.
    """
    places = {
        axis: "x" if axis.lower() in _X_NAMES else "y"
        for axis in axes
        if axis.lower() in _X_NAMES | _Y_NAMES
    }
    if crs is None or not places:
        return {}
    text = _wkt(crs)
    system = _SYSTEM.search(text)
    if system is None or _DERIVED.search(text):
        return {}
    if not system[1].startswith("PROJ"):
        degrees = {"x": ("longitude", "degrees_east"), "y": ("latitude", "degrees_north")}
        return {axis: _attributes(*degrees[place]) for axis, place in places.items()}
    unit = _unit(_NEXT.split(text[system.start() :])[0])
    return {
        axis: _attributes(f"projection_{place}_coordinate", unit) for axis, place in places.items()
    }


def _attributes(name: str, units: str) -> dict[str, str]:
    return {"standard_name": name, "units": units}


def _unit(projected: str) -> str:
    """CF name of the unit of length that comes last, which is that of the axes."""
    units = _LENGTH.findall(projected)
    name, size = units[-1] if units else ("m", "1")
    with suppress(ValueError):
        for known, metres in _METRES.items():
            if abs(float(size) / metres - 1) < 1e-9:
                return known
    return name.replace(" ", "_")


def same_system(one: str, other: str) -> bool:
    """Whether two texts name one coordinate reference system, as far as can be told here."""
    if _wkt(one) == _wkt(other):
        return True
    with suppress(Exception):
        from rasterio.crs import CRS

        return CRS.from_user_input(one) == CRS.from_user_input(other)
    with suppress(Exception):
        from pyproj import CRS

        return CRS.from_user_input(one).equals(CRS.from_user_input(other))
    return False


def _wkt(crs: str) -> str:
    """The system as WKT; a code as it is where no library is there to look it up."""
    if "[" in crs or "(" in crs:
        return crs
    with suppress(Exception):  # the libraries raise errors of their own on what they do not know
        from rasterio.crs import CRS

        return CRS.from_user_input(crs).to_wkt()
    with suppress(Exception):
        from pyproj import CRS

        return CRS.from_user_input(crs).to_wkt()
    return crs


# The code of a system: at the end of its WKT, or alone, as a URN or as an address.
_EPSG = re.compile(
    r'(?:AUTHORITY\s*\[\s*"EPSG"\s*,\s*"(\d+)"|ID\s*\[\s*"EPSG"\s*,\s*(\d+))\s*\]\s*\]$'
    r"|^(?:urn:ogc:def:crs:|https?://www\.opengis\.net/def/crs/)?EPSG[:/](?:[\d.]*[:/])?(\d+)$",
    re.IGNORECASE,
)
_CRS84 = re.compile(r'(?:^|[:/"])CRS84"?\s*[\]\s]*$', re.IGNORECASE)
_TITLE = re.compile(r'\s*\w+\s*\[\s*"([^"]*)"')


def epsg_code(crs: str) -> str | None:
    """The number of a system in the EPSG registry, as far as its text says it."""
    match = _EPSG.search(crs)
    return next(filter(None, match.groups()), None) if match else None


def is_crs84(crs: str) -> bool:
    """Whether a text names WGS 84 with the longitude first, which has no EPSG code."""
    return _CRS84.search(crs) is not None


def crs_title(crs: str) -> str:
    """The name inside a WKT text, or the text itself where it is a code."""
    match = _TITLE.match(crs)
    return match[1] if match else crs


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
        units = _UNIT.findall(crs)
        return units[-1] if units else "degree"
    units = _UNIT.findall(re.split("VERT_?C", crs)[0])
    return units[-1] if units else ""
