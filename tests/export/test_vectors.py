"""Lines and bands in files, read back, and in pictures."""

import csv
import json
import sys

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import contourfair_jax as cf
from contourfair_jax import export, metrics, plot
from contourfair_jax._bezier.linear import BilinearField
from contourfair_jax.contours import Band, contours
from contourfair_jax.io import Grid, InputError, MissingPackageError
from contourfair_jax.plot._frame import frame_of

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
    lines = field.contours(LEVELS)
    export.write_lines(tmp_path / "lines.svg", [*lines, lines[0]], export.grid_of(field))
    text = (tmp_path / "lines.svg").read_text()
    assert text.count("<g ") == 2
    assert text.count("Z") == 3


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
        export.write_filled(tmp_path / "bands.gpkg", bands, grid)
    frame = geopandas.read_file(tmp_path / "bands.gpkg")
    assert frame.geometry.is_valid.all()
    np.testing.assert_allclose(frame.area, [band.area for band in bands], rtol=1e-6)
    np.testing.assert_array_equal(frame["lower"], [np.nan, *LEVELS])


@pytest.mark.parametrize("crs", [None, UTM, "EPSG:4326"])
def test_geojson_of_bands(terrain, crs, tmp_path):
    grid, field = terrain
    grid = Grid(grid.values, affine=NORTH_UP, crs=crs)
    bands = field.filled([-np.inf, *LEVELS])
    notes = export.write_filled(tmp_path / "bands.json", bands, grid)
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
    export.write_filled(tmp_path / "bands.geojson", [band], Grid(np.ones((3, 3)), crs="EPSG:4326"))
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
        export.write_filled(tmp_path / "a.csv", [], grid)


def test_pictures(field):
    figure = Figure()
    ax = figure.add_subplot()
    lines = contours(field, LEVELS)
    drawn = plot.draw_lines(lines, ax)
    assert len(drawn.get_segments()) == len(lines)
    assert plot.draw_lines(lines, ax, color="k").get_color()[0][0] == 0
    bands = plot.draw_filled(field.filled([-np.inf, *LEVELS, np.inf]), ax)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())
    assert len(bands.get_paths()) == 3
    assert len(np.unique(image.reshape(-1, 4), axis=0)) > 5
    np.testing.assert_allclose(ax.get_xlim(), (-1, 1), atol=0.2)


WGS84 = 'GEOGCS["WGS 84",DATUM["WGS_1984"],UNIT["degree",0.0174532925199433]]'
HEIGHTS = 'COMPD_CS["a",PROJCS["b",GEOGCS["c",UNIT["degree",0.017]],UNIT["metre",1]],VERT_CS["d",'
DEGREES = {"y:units": "degrees_north", "x:units": "degrees_east"}
TURNED = np.array([[0.0, 3.0, 10.0], [-2.0, 0.0, 20.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("given", "labels", "upward", "aspect"),
    [
        ({}, ("y", "x"), False, 1),
        ({"affine": NORTH_UP}, ("y", "x"), True, 1),
        ({"affine": NORTH_UP, "crs": f'{HEIGHTS}UNIT["foot",0.3]]]'}, ("y (m)", "x (m)"), True, 1),
        ({"affine": np.diag([-2, 3, 1]) + np.eye(3, k=2) * 61, "crs": WGS84},
         ("latitude (°)", "longitude (°)"), True, 2),
        ({"affine": np.diag([2, 3, 1]) + np.eye(3, k=2) * 59, "metadata": DEGREES},
         ("latitude (°)", "longitude (°)"), True, 2),
        ({"affine": np.diag([2.0, 3, 1]), "spacing": (220, 300), "metadata": DEGREES},
         ("latitude (°)", "longitude (°)"), True, 1.1),
        ({"affine": np.diag([2.0, 3, 1]), "axes": ("depth", "x"),
          "metadata": {"depth:units": "m", "x:units": "degrees_east"}},
         ("depth (m)", "x (°)"), True, None),
        ({"affine": np.diag([2.0, 3, 1]),
          "metadata": {"space": "left-posterior-superior", "space units": "mm"}},
         ("y (mm)", "x (mm)"), False, 1),
        ({"affine": TURNED}, ("distance along y", "distance along x"), False, 1),
    ],
)  # fmt: skip
def test_pictures_show_the_coordinates_of_the_file(given, labels, upward, aspect):
    """Of 2 x 2 samples, of which sample (1, 1) is shown where the file says that it lies."""
    grid = Grid(np.zeros((2, 2)), **given)
    frame = frame_of(grid)
    assert (frame.labels, frame.upward) == (labels, upward)
    assert frame.aspect == (None if aspect is None else pytest.approx(aspect))
    last = np.array(grid.origin) + grid.spacing
    shown = last if "affine" in given and given["affine"] is TURNED else grid.world(last)
    np.testing.assert_allclose(frame.place(last), shown)


def test_a_map_has_north_at_the_top_and_lines_on_their_values(terrain):
    grid, field = terrain
    figure = plot.contour_figure(field, LEVELS, grid=grid)
    ax = figure.axes[0]
    np.testing.assert_allclose(ax.get_xlim(), (400_000, 400_180))
    np.testing.assert_allclose(ax.get_ylim(), (4_999_730, 5_000_000))
    left, right, first, last = ax.images[0].get_extent()
    assert (left < right, first > last) == (True, True)  # row 0 is the northernmost
    (drawn,) = ax.collections
    for level, path in zip(LEVELS, drawn.get_paths(), strict=True):
        points = (path.vertices[:, ::-1] - NORTH_UP[:2, 2]) * [-1, 1]
        np.testing.assert_allclose(field(points, "clamp"), level, atol=2e-3)


def test_leaves_lie_where_the_file_says(terrain):
    from contourfair_jax.plot._surfaces import leaf_figure

    grid, field = terrain
    ax = leaf_figure(field.adaptive(0.1), grid).axes[0]
    np.testing.assert_allclose(ax.get_ylim(), (4_999_730, 5_000_000))
    np.testing.assert_allclose(ax.get_xlim(), (400_000, 400_180))


@pytest.mark.parametrize("refine", [1, 4])
def test_pictures_show_nothing_outside_the_cells_that_have_values(field, refine):
    """A sample by itself, and sides between missing cells, are neither dots nor hairs."""
    values = np.full((5, 9), np.nan)
    values[1:3, 1:3] = [[1, 2], [3, 4]]  # one cell
    values[2, 5] = values[4, 5] = values[4, 6] = 5
    net = jnp.asarray(np.repeat(np.repeat(values, 3, 0), 3, 1)[1:-1, 1:-1])
    known = cf.BezierField(net, jnp.ones(2), jnp.zeros(2))
    for each in (known, BilinearField(values)):
        shown = plot.plot_contours(each, [], refine=refine).images[0].get_array()
        cell = slice(refine, 2 * refine + 1)
        expected = np.ones(shown.shape, bool)
        expected[cell, cell] = False
        np.testing.assert_array_equal(np.ma.getmaskarray(shown), expected)


def test_bands_are_drawn_as_areas_of_one_colour_each(field):
    ends = [-np.inf, *LEVELS, np.inf]
    figure = plot.contour_figure(field, LEVELS, bands=field.filled(ends), units="m")
    ax, bar = figure.axes
    assert not ax.images
    areas = ax.collections[0]
    assert len(areas.get_paths()) == 3
    assert len(np.unique(areas.to_rgba(areas.get_array()), axis=0)) == 3
    ticks = bar.get_yticks()
    np.testing.assert_allclose(ticks[1:-1], LEVELS)
    samples = np.asarray(field.samples)
    np.testing.assert_allclose(ticks[[0, -1]], [samples.min(), samples.max()], atol=0.1)
    assert bar.get_ylabel() == "m"


def test_long_lines_are_labelled_with_their_levels(field):
    ax = plot.contour_figure(field, LEVELS).axes[0]
    assert {text.get_text() for text in ax.texts} == {"0.3", "0.6"}
    assert not plot.plot_contours(field, LEVELS).texts


def test_pictures_of_no_cell_and_no_band_are_empty():
    values = np.full((5, 5), np.nan)
    values[2, 2] = 1.0
    net = jnp.asarray(np.repeat(np.repeat(values, 3, 0), 3, 1)[1:-1, 1:-1])
    field = cf.BezierField(net, jnp.ones(2), jnp.zeros(2))
    bands = field.filled([-np.inf, 0.5, np.inf])
    assert all(band.area == 0 for band in bands)
    for figure in (
        plot.contour_figure(field, [0.5]),
        plot.contour_figure(field, [0.5], bands=bands),
    ):
        figure.draw_without_rendering()
        drawn = [path for each in figure.axes[0].collections for path in each.get_paths()]
        assert not sum(len(path.vertices) for path in drawn)
