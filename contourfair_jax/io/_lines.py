"""Contour lines as GeoJSON (world coordinates) and SVG."""

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from ._atomic import replacing
from ._errors import InputError
from ._grid import Grid

_SVG_SIZE = 1000.0
_WGS84 = re.compile(r'^(EPSG:4326|OGC:CRS84)$|AUTHORITY\["EPSG","4326"\]\]$|ID\["EPSG",4326\]\]$')
_CODE = re.compile(r'(?:AUTHORITY\["EPSG","(\d+)"\]|ID\["EPSG",(\d+)\])\]$')


@dataclass(frozen=True, eq=False)
class ContourLine:
    """One piece of a level set.

    Parameters
    ----------
    level
        The value along the line.
    points
        Field coordinates in array order (``y, x``), shape ``(n, 2)``.
    closed
        Whether the line is a loop; its last point then equals its first.
    """

    level: float
    points: np.ndarray
    closed: bool


def write_geojson(
    path: str | os.PathLike[str], lines: Sequence[ContourLine], grid: Grid
) -> tuple[str, ...]:
    """Store one LineString feature per line, with its ``level``, in world coordinates.

    A ``crs`` member names the reference system unless it is WGS 84, which GeoJSON implies.  It is
    what GDAL and QGIS read; strict readers of RFC 7946 expect WGS 84 only, so a note tells.
    """
    collection: dict[str, object] = {"type": "FeatureCollection"}
    notes: tuple[str, ...] = ()
    if grid.crs is None:
        notes = ("the source names no coordinate reference system; the GeoJSON has none either",)
    elif not _WGS84.search(grid.crs.strip()):
        collection["crs"] = {"type": "name", "properties": {"name": crs_name(grid.crs)}}
        notes = ("GeoJSON coordinates are in the source's system, named in its crs member",)
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
    """Store one group per level, stroked with one of `colors` each, north or row 0 at the top."""
    height, width = (h * (n - 1) for h, n in zip(grid.spacing, grid.shape, strict=True))
    scale = _SVG_SIZE / max(height, width)
    body = []
    groups = [(level, list(pieces)) for level, pieces in groupby(lines, lambda line: line.level)]
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


def crs_name(crs: str) -> str:
    """``urn:ogc:def:crs:EPSG::n`` where the code is known, else `crs` itself."""
    found = _CODE.search(crs.strip()) or re.fullmatch(r"EPSG:(\d+)", crs.strip())
    code = next((group for group in found.groups() if group), None) if found else None
    return f"urn:ogc:def:crs:EPSG::{code}" if code else crs


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
