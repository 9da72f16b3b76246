"""Contour lines and bands as files of vectors."""

from __future__ import annotations

import csv
import json
import os
import re
import warnings
from collections.abc import Callable, Sequence
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._grid.affine import diagonal_affine
from .._grid.grid import Grid
from .._support.errors import InputError, MissingPackageError
from ..contours import Band, ContourLine
from ..contours._line import signed_area
from ..io import replacing

if TYPE_CHECKING:
    from .._bezier.nets import PlacedNet


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
            json.dump(_line_feature(line, grid), stream)
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
    match = _EPSG.search(crs)
    return next(filter(None, match.groups()), None) if match else None


def _line_feature(line: ContourLine, grid: Grid) -> dict[str, object]:
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


Notes = tuple[str, ...]


def grid_of(field: PlacedNet, crs: str | None = None) -> Grid:
    """The grid of a field in its own coordinates, axis 0 upwards, for files and pictures.

    Parameters
    ----------
    field : BezierField
    crs : str
        Coordinate reference system, as WKT or a code such as ``EPSG:4326``.
    """
    spacing, origin = (np.asarray(x, dtype=np.float64) for x in (field.spacing, field.origin))
    affine = diagonal_affine(spacing.tolist(), origin.tolist())
    return Grid(np.asarray(field.samples), affine=affine, crs=crs)


def write_lines(path: str | os.PathLike[str], lines: Sequence[ContourLine], grid: Grid) -> Notes:
    """Store lines in the format that the name ends in: .geojson, .json, .gpkg, .csv or .svg.

    GeoPackage needs the extra ``geopackage``.  CSV has one row for each vertex.

    Returns
    -------
    tuple of str
        What is to be known about the file.

    Raises
    ------
    InputError
        For another ending or a file that cannot be written.
    """
    return _writer(path, _LINES)(path, lines, grid)


def write_filled(path: str | os.PathLike[str], bands: Sequence[Band], grid: Grid) -> Notes:
    """Store the bands of `filled` in the format of the name: .geojson, .json or .gpkg.

    Features are multipolygons with the properties `lower` and `upper`; those of bands that reach to
    infinity are null.

    Returns
    -------
    tuple of str
        What is to be known about the file.

    Raises
    ------
    InputError
        For another ending or a file that cannot be written.
    """
    return _writer(path, _BANDS)(path, bands, grid)


def _writer(path: str | os.PathLike[str], known: dict[str, Callable[..., Notes]]) -> Callable:
    suffix = Path(path).suffix.lower()
    if suffix not in known:
        raise InputError(f"{path}: the name must end in {', '.join(known)}")
    return known[suffix]


def _write_csv(path: str | os.PathLike[str], lines: Sequence[ContourLine], grid: Grid) -> Notes:
    with replacing(path) as partial, open(partial, "w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["line", "level", "closed", "x", "y"])
        for number, line in enumerate(lines):
            level, closed = f"{line.level:.12g}", int(line.closed)
            for y, x in grid.world(line.points).tolist():
                rows.writerow([number, level, closed, f"{x:.12g}", f"{y:.12g}"])
    return ()


def _write_svg(path: str | os.PathLike[str], lines: Sequence[ContourLine], grid: Grid) -> Notes:
    count = len({line.level for line in lines})
    return write_svg(path, lines, grid, ["#1a1a1a"] * count)


def _write_band_geojson(path: str | os.PathLike[str], bands: Sequence[Band], grid: Grid) -> Notes:
    collection, notes = feature_collection(grid)
    collection["features"] = [_band_feature(band, grid) for band in bands]
    with replacing(path) as partial:
        partial.write_text(json.dumps(collection) + "\n", encoding="utf-8")
    return notes


def _band_feature(band: Band, grid: Grid) -> dict[str, Any]:
    # All digits: rounding folds slivers, so that rings cross themselves.
    coordinates = [[ring.tolist() for ring in rings] for rings in _world_polygons(band, grid)]
    return {
        "type": "Feature",
        "properties": _limits(band),
        "geometry": {"type": "MultiPolygon", "coordinates": coordinates},
    }


def _write_line_package(
    path: str | os.PathLike[str], lines: Sequence[ContourLine], grid: Grid
) -> Notes:
    shapely = _geopackage_module("shapely")
    shapes = [shapely.LineString(grid.world(line.points)[:, ::-1]) for line in lines]
    columns = {"level": [line.level for line in lines], "closed": [line.closed for line in lines]}
    return _write_package(path, "contours", shapes, columns, grid)


def _write_band_package(path: str | os.PathLike[str], bands: Sequence[Band], grid: Grid) -> Notes:
    shapely = _geopackage_module("shapely")
    shapes = [
        shapely.MultiPolygon([(rings[0], rings[1:]) for rings in _world_polygons(band, grid)])
        for band in bands
    ]
    limits = [_limits(band) for band in bands]
    columns = {name: [limit[name] for limit in limits] for name in ("lower", "upper")}
    return _write_package(path, "bands", shapes, columns, grid)


def _write_package(
    path: str | os.PathLike[str], layer: str, shapes: list, columns: dict[str, list], grid: Grid
) -> Notes:
    frame = _geopackage_module("geopandas").GeoDataFrame(columns, geometry=shapes, crs=grid.crs)
    with replacing(path) as partial, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "'crs' was not provided")  # A note tells.
        partial.unlink()  # GDAL makes the database itself.
        frame.to_file(partial, layer=layer, driver="GPKG", engine="pyogrio")
    return () if grid.crs else (NO_CRS,)


def _geopackage_module(name: str) -> Any:
    import importlib

    try:
        importlib.import_module("pyogrio")
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingPackageError(
            f"GeoPackage needs {error.name}: pip install 'contourfair-jax[geopackage]'"
        ) from error


def _limits(band: Band) -> dict[str, float | None]:
    ends = {"lower": band.lower, "upper": band.upper}
    return {name: end if np.isfinite(end) else None for name, end in ends.items()}


def _world_polygons(band: Band, grid: Grid) -> list[list[np.ndarray]]:
    """Rings in world coordinates, x first, outer ones counter-clockwise and holes clockwise."""
    polygons = []
    for polygon in band.polygons:
        rings = [grid.world(ring)[:, ::-1] for ring in polygon]
        reverse = signed_area(rings[0]) < 0
        polygons.append([ring[::-1] if reverse else ring for ring in rings])
    return polygons


_LINES = {
    ".geojson": write_geojson,
    ".json": write_geojson,
    ".gpkg": _write_line_package,
    ".csv": _write_csv,
    ".svg": _write_svg,
}

_BANDS = {
    ".geojson": _write_band_geojson,
    ".json": _write_band_geojson,
    ".gpkg": _write_band_package,
}
