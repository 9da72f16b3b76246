"""Attributes by which the conventions for climate and forecast data (CF) say what axes are."""

import re
from collections.abc import Sequence
from contextlib import suppress

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
    """What the conventions call the unit of length that comes last, which is that of the axes."""
    found = _LENGTH.findall(projected)
    name, size = found[-1] if found else ("m", "1")
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
