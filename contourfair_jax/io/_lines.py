"""Contour lines as GeoJSON (world coordinates) and SVG."""

import json
import os
import re
from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np

from .._contour_line import ContourLine
from ._atomic import replacing
from ._errors import InputError
from ._grid import Grid

_SVG_SIZE = 1000.0
# The code of a system: at the end of its WKT, or alone, as a URN or as an address.
_EPSG = re.compile(
    r'(?:AUTHORITY\s*\[\s*"EPSG"\s*,\s*"(\d+)"|ID\s*\[\s*"EPSG"\s*,\s*(\d+))\s*\]\s*\]$'
    r"|^(?:urn:ogc:def:crs:|https?://www\.opengis\.net/def/crs/)?EPSG[:/](?:[\d.]*[:/])?(\d+)$",
    re.IGNORECASE,
)
_CRS84 = re.compile(r'(?:^|[:/"])CRS84"?\s*[\]\s]*$', re.IGNORECASE)
NO_CRS = "the source names no coordinate reference system; the file has none either"


def write_geojson(
    path: str | os.PathLike[str], lines: Sequence[ContourLine], grid: Grid
) -> tuple[str, ...]:
    """Store one LineString feature per line, with its ``level``, in world coordinates."""
    collection, notes = feature_collection(grid)
    with replacing(path) as partial, open(partial, "w", encoding="utf-8") as stream:
        head = json.dumps(collection)[:-1]
        stream.write(f'{head}, "features": [')
        for number, line in enumerate(lines):
            stream.write(",\n" if number else "\n")
            json.dump(_feature(line, grid), stream)
        stream.write("\n]}\n")
    return notes


def write_svg(
    path: str | os.PathLike[str],
    lines: Sequence[ContourLine],
    grid: Grid,
    colors: Sequence[str],
) -> tuple[str, ...]:
    """Store a group for each level, stroked with the colours in turn, from the lowest level on.

    North or row 0 is at the top.
    """
    height, width = (h * (n - 1) for h, n in zip(grid.spacing, grid.shape, strict=True))
    scale = _SVG_SIZE / max(height, width)
    body = []
    by_level = attrgetter("level")
    groups = [(level, list(same)) for level, same in groupby(sorted(lines, key=by_level), by_level)]
    if len(colors) < len(groups):
        raise InputError(f"{len(groups)} levels need as many colours, got {len(colors)}")
    for (level, pieces), color in zip(groups, colors, strict=False):
        paths = "".join(_svg_path(line, grid, height, scale) for line in pieces)
        body.append(f'<g data-level="{level:.12g}" stroke="{color}">{paths}</g>\n')
    size = f"0 0 {width * scale:.2f} {height * scale:.2f}"
    with replacing(path) as partial:
        partial.write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{size}" '
            'fill="none" stroke-width="1" stroke-linejoin="round">\n' + "".join(body) + "</svg>\n",
            encoding="utf-8",
        )
    return ()


def feature_collection(grid: Grid) -> tuple[dict[str, Any], tuple[str, ...]]:
    """A GeoJSON collection in the world of a grid, without features yet, and notes.

    A ``crs`` member names the reference system unless it is WGS 84, which GeoJSON implies.  It is
    what GDAL and QGIS read; strict readers of RFC 7946 expect WGS 84 only, so a note tells.
    """
    collection: dict[str, Any] = {"type": "FeatureCollection"}
    crs = (grid.crs or "").strip()
    if not crs:
        return collection, (NO_CRS,)
    code = _epsg(crs)
    if code == "4326" or (code is None and _CRS84.search(crs)):
        return collection, ()
    name = f"urn:ogc:def:crs:EPSG::{code}" if code else crs
    collection["crs"] = {"type": "name", "properties": {"name": name}}
    return collection, ("GeoJSON coordinates are in the source's system, named in its crs member",)


def _epsg(crs: str) -> str | None:
    found = _EPSG.search(crs)
    return next(filter(None, found.groups()), None) if found else None


def _feature(line: ContourLine, grid: Grid) -> dict[str, object]:
    xy = grid.world(line.points)[:, ::-1]
    return {
        "type": "Feature",
        "properties": {"level": float(f"{line.level:.12g}"), "closed": line.closed},
        "geometry": {
            "type": "LineString",
            "coordinates": xy.tolist(),
        },
    }


def _svg_path(line: ContourLine, grid: Grid, height: float, scale: float) -> str:
    y, x = (line.points - np.asarray(grid.origin)).T
    if grid.rows_ascend:
        y = height - y
    points = np.stack([x, y], axis=1) * scale
    if line.closed:
        points = points[:-1]
    steps = "L".join(f"{px:.2f},{py:.2f}" for px, py in points.tolist())
    return f'<path d="M{steps}{"Z" if line.closed else ""}"/>'
