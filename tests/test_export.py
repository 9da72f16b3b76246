"""Lines and bands in files, read back, and in pictures."""

import csv
import json
import sys

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import contourfair_jax as cf
from contourfair_jax import export, metrics
from contourfair_jax.contours import Band, contours
from contourfair_jax.io import Grid, InputError, MissingPackageError

UTM = "EPSG:32633"
NORTH_UP = np.array([[-30.0, 0.0, 5_000_000.0], [0.0, 20.0, 400_000.0], [0.0, 0.0, 1.0]])
LEVELS = [0.3, 0.6]


@pytest.fixture(scope="module")
def field():
    x = np.linspace(-1, 1, 10)
    return cf.fair_field(np.hypot(x[:, None] - 0.05, x), spacing=2 / 9, origin=-1.0)


@pytest.fixture(scope="module")
def terrain(field):
    """A grid in metres whose field coordinates are 30 and 20 m per cell, and its field."""
    grid = Grid(np.asarray(field.samples), affine=NORTH_UP, crs=UTM)
    return grid, cf.fair_field(grid.values, spacing=grid.spacing, origin=grid.origin)


def expected(lines, grid):
    return [grid.world(line.points)[:, ::-1] for line in lines]


def test_geojson_of_lines(terrain, tmp_path):
    grid, field = terrain
    lines = field.contours(LEVELS)
    (note,) = export.write_lines(tmp_path / "lines.geojson", lines, grid)
    assert "crs member" in note
    features = json.loads((tmp_path / "lines.geojson").read_text())["features"]
    assert [feature["properties"]["level"] for feature in features] == [v.level for v in lines]
    for feature, points in zip(features, expected(lines, grid), strict=True):
        np.testing.assert_array_equal(feature["geometry"]["coordinates"], points)


def test_csv_has_a_row_for_each_vertex(field, tmp_path):
    lines, grid = field.contours(LEVELS), export.grid_of(field)
    assert export.write_lines(tmp_path / "lines.csv", lines, grid) == ()
    with open(tmp_path / "lines.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == sum(len(line.points) for line in lines)
    points = np.array([[float(row["x"]), float(row["y"])] for row in rows])
    np.testing.assert_allclose(points, np.concatenate(expected(lines, grid)), atol=1e-11)
    assert {float(row["level"]) for row in rows} == set(LEVELS)


def test_svg_has_a_group_for_each_level(field, tmp_path):
    export.write_lines(tmp_path / "lines.svg", field.contours(LEVELS), export.grid_of(field))
    text = (tmp_path / "lines.svg").read_text()
    assert text.count("<g ") == 2
    assert text.count("Z") == 2


def test_geopackage_of_lines_keeps_the_reference_system(terrain, tmp_path):
    geopandas = pytest.importorskip("geopandas")
    pytest.importorskip("pyogrio")
    grid, field = terrain
    lines = field.contours(LEVELS)
    assert export.write_lines(tmp_path / "lines.gpkg", lines, grid) == ()
    frame = geopandas.read_file(tmp_path / "lines.gpkg", layer="contours")
    assert frame.crs.to_epsg() == 32633
    assert frame["level"].tolist() == [line.level for line in lines]
    for shape, points in zip(frame.geometry, expected(lines, grid), strict=True):
        np.testing.assert_array_equal(np.asarray(shape.coords), points)
    assert [each.name for each in tmp_path.iterdir()] == ["lines.gpkg"]


def test_geopackage_replaces_and_holds_valid_bands(terrain, tmp_path):
    geopandas = pytest.importorskip("geopandas")
    pytest.importorskip("pyogrio")
    grid, field = terrain
    bands = field.filled([-np.inf, *LEVELS, np.inf])
    for _ in range(2):
        export.write_bands(tmp_path / "bands.gpkg", bands, grid)
    frame = geopandas.read_file(tmp_path / "bands.gpkg")
    assert frame.geometry.is_valid.all()
    np.testing.assert_allclose(frame.area, [band.area for band in bands], rtol=1e-6)
    np.testing.assert_array_equal(frame["lower"], [np.nan, *LEVELS])


@pytest.mark.parametrize("crs", [None, UTM, "EPSG:4326"])
def test_geojson_of_bands(terrain, crs, tmp_path):
    grid, field = terrain
    grid = Grid(grid.values, affine=NORTH_UP, crs=crs)
    bands = field.filled([-np.inf, *LEVELS])
    notes = export.write_bands(tmp_path / "bands.json", bands, grid)
    assert len(notes) == (crs != "EPSG:4326")
    stored = json.loads((tmp_path / "bands.json").read_text())
    assert ("crs" in stored) == (crs == UTM)
    assert [each["properties"]["lower"] for each in stored["features"]] == [None, 0.3]
    for feature, band in zip(stored["features"], bands, strict=True):
        areas = [
            [metrics.signed_area(np.array(ring)) for ring in polygon]
            for polygon in feature["geometry"]["coordinates"]
        ]
        assert all(rings[0] > 0 and all(hole < 0 for hole in rings[1:]) for rings in areas)
        assert sum(map(sum, areas)) == pytest.approx(band.area, rel=1e-6)


def test_slivers_of_bands_are_not_folded(tmp_path):
    shapely = pytest.importorskip("shapely")
    ring = np.array(
        [
            *([49.70472857, 6.4546875], [49.704166666748, 6.454166666666667]),
            *([49.70416666666666, 6.454166666595988], [49.70416666666666, 6.46]),
            [49.70472857, 6.4546875],
        ]
    )
    band = Band(0.0, 1.0, ((ring[::-1],),))
    export.write_bands(tmp_path / "bands.geojson", [band], Grid(np.ones((3, 3)), crs="EPSG:4326"))
    (feature,) = json.loads((tmp_path / "bands.geojson").read_text())["features"]
    assert shapely.geometry.shape(feature["geometry"]).is_valid


def test_without_reference_system_a_geopackage_tells(field, tmp_path):
    pytest.importorskip("pyogrio")
    notes = export.write_lines(tmp_path / "a.gpkg", field.contours(0.3), export.grid_of(field))
    assert "no coordinate reference system" in notes[0]


def test_missing_package_names_the_extra(field, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    with pytest.raises(MissingPackageError, match=r"contourfair-jax\[geopackage\]"):
        export.write_lines(tmp_path / "a.gpkg", field.contours(0.3), export.grid_of(field))


def test_unknown_endings_are_refused(field, tmp_path):
    grid = export.grid_of(field)
    with pytest.raises(InputError, match=r"must end in .geojson, .json, .gpkg, .csv, .svg"):
        export.write_lines(tmp_path / "a.dxf", [], grid)
    with pytest.raises(InputError, match=r"must end in .geojson, .json, .gpkg"):
        export.write_bands(tmp_path / "a.csv", [], grid)


def test_pictures(field):
    figure = Figure()
    ax = figure.add_subplot()
    lines = contours(field, LEVELS)
    drawn = export.draw_lines(lines, ax)
    assert len(drawn.get_segments()) == len(lines)
    assert export.draw_lines(lines, ax, color="k").get_color()[0][0] == 0
    bands = export.draw_bands(field.filled([-np.inf, *LEVELS, np.inf]), ax)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())
    assert len(bands.get_paths()) == 3
    assert len(np.unique(image.reshape(-1, 4), axis=0)) > 5
    np.testing.assert_allclose(ax.get_xlim(), (-1, 1), atol=0.2)
