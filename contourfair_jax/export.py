"""Contour lines, filled bands and isosurfaces as files, the former as pictures too.

Files hold world coordinates, x first: those of a `Grid` read with `contourfair_jax.io`, which may
carry a coordinate reference system, or those of the field itself (`grid_of`).
"""

from __future__ import annotations

import csv
import json
import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ._lengths import signed_area
from ._to_vtk import write_leaves as write_leaves
from ._to_vtk import write_mesh as write_mesh
from .contours import Band
from .io import ContourLine, Grid, InputError, MissingPackageError, replacing, write_geojson
from .io import write_svg as write_svg
from .io._geometry import diagonal_affine
from .io._lines import NO_CRS, feature_collection

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection, PathCollection

    from ._bezier import PlacedNet

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


def write_bands(path: str | os.PathLike[str], bands: Sequence[Band], grid: Grid) -> Notes:
    """Store bands as features in the format that the name ends in: .geojson, .json or .gpkg.

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


def draw_lines(
    lines: Sequence[ContourLine], ax: Axes, color: str | None = None, width: float = 0.8
) -> LineCollection:
    """Add lines to Matplotlib axes, axis 1 to the right; coloured by level unless told."""
    from matplotlib.collections import LineCollection

    drawn = LineCollection([line.points[:, ::-1] for line in lines], linewidths=width)
    if color is None:
        drawn.set_array(np.array([line.level for line in lines]))
    else:
        drawn.set_color(color)
    ax.add_collection(drawn)
    ax.autoscale_view()
    return drawn


def draw_bands(bands: Sequence[Band], ax: Axes) -> PathCollection:
    """Add bands to Matplotlib axes, axis 1 to the right, coloured from low to high."""
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Outline

    outlines = [
        Outline.make_compound_path(
            *(Outline(ring[:, ::-1], closed=True) for polygon in band.polygons for ring in polygon)
        )
        for band in bands
    ]
    drawn = PathCollection(outlines, linewidths=0)
    drawn.set_array(np.arange(len(bands), dtype=float))
    ax.add_collection(drawn)
    ax.autoscale_view()
    return drawn


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
    collection["features"] = [_feature(band, grid) for band in bands]
    with replacing(path) as partial:
        partial.write_text(json.dumps(collection) + "\n", encoding="utf-8")
    return notes


def _feature(band: Band, grid: Grid) -> dict[str, Any]:
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
