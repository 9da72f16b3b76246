"""The command line, run in this process through `main`; a few runs in a process of their own."""

import json
import os
import re
import subprocess
import sys
import time
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import rasterio
from file_helpers import inside  # noqa: F401
from matplotlib.figure import Figure
from PIL import Image
from rasterio.transform import Affine

import contourfair_jax as cf
from contourfair_jax import cli, plot
from contourfair_jax._bezier.linear import BilinearField
from contourfair_jax.cli._compare import busiest_window
from contourfair_jax.cli._console import Reporter
from contourfair_jax.cli._levels import choose_levels, even_levels, interval_levels, listed_levels
from contourfair_jax.cli._recipe import METHODS
from contourfair_jax.io import FORMATS, Grid, InputError, read, read_bands, write, write_bands
from contourfair_jax.isosurface import Isosurface

pytestmark = pytest.mark.usefixtures("inside")

# One shape for most tests, so that the engine is compiled once.
SHAPE = (9, 11)
NORTH_UP = np.array([[-30.0, 0.0, 5e6], [0.0, 20.0, 4e5], [0.0, 0.0, 1.0]])


def hill(dtype="float64", shape=SHAPE) -> np.ndarray:
    rows, columns = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return np.round(200 * np.exp(-2 * (rows**2 + (columns - 0.2) ** 2))).astype(dtype)


@pytest.fixture
def dem(tmp_path):
    """A GeoTIFF without gaps."""
    path = tmp_path / "dem.tif"
    write(path, Grid(hill("int16"), affine=NORTH_UP, crs="EPSG:32633", units="m"))
    return path


# ---- upsample ------------------------------------------------------------------------------


def test_upsample_geotiff_keeps_samples_place_and_crs(run, dem, tmp_path):
    target = tmp_path / "fine.tif"
    code, out, err = run("upsample", dem, "-o", target, "--factor", 3)
    assert (code, out) == (0, f"{target}: 25 x 31 float32\n")
    assert "note" not in err
    fine = read(target)
    np.testing.assert_array_equal(fine.values[::3, ::3], hill("float32"))
    field = cf.fair_field(hill(), spacing=(30.0, 20.0))
    np.testing.assert_allclose(fine.values, field.refine(3), rtol=2e-7)
    with rasterio.open(dem) as old, rasterio.open(target) as new:
        assert new.crs == old.crs
        assert new.res == (old.res[0] / 3, old.res[1] / 3)
        for row, column in ((0, 0), (4, 7), (8, 10)):
            assert new.xy(3 * row, 3 * column) == pytest.approx(old.xy(row, column), abs=1e-9)


def test_upsample_every_band(run, tmp_path):
    """Each as if it were alone; the result opens as what it was."""
    rgb = np.stack([np.roll(hill("uint8"), k, 1) for k in range(3)])
    source, target = tmp_path / "rgb.tif", tmp_path / "fine.tif"
    write_bands(source, [Grid(band, affine=NORTH_UP, crs="EPSG:32633") for band in rgb])
    code, out, err = run("upsample", source, "-o", target, "--all-bands", "-f", 2)
    assert (code, out) == (0, f"{target}: 3 x 17 x 21 float32\n")
    assert "note" not in err
    for band, samples in zip(read_bands(target), rgb, strict=True):
        expected = cf.fair_field(samples.astype(float), spacing=(30.0, 20.0)).refine(2)
        np.testing.assert_allclose(band.values, expected, rtol=2e-7, atol=1e-5)
        assert band.crs == read(source).crs
    Image.fromarray(np.moveaxis(rgb, 0, -1)).save(tmp_path / "rgb.png")
    picture = tmp_path / "fine.png"
    assert run("upsample", tmp_path / "rgb.png", "-o", picture, "--all-bands", "-f", 2)[0] == 0
    with Image.open(picture) as image:
        assert (image.mode, image.size) == ("RGB", (21, 17))
        np.testing.assert_array_equal(np.moveaxis(np.asarray(image), -1, 0)[:, ::2, ::2], rgb)


def test_every_band_needs_a_file_that_has_several(run, tmp_path):
    np.save(tmp_path / "in.npy", hill())
    alone = tmp_path / "out.npy"  # a file without bands is one band
    assert run("upsample", tmp_path / "in.npy", "-o", alone, "--all-bands", "-f", 2)[0] == 0
    assert np.load(alone).shape == (17, 21)
    write_bands(tmp_path / "two.tif", [Grid(hill("uint8"))] * 2)
    faults = [
        (("-o", tmp_path / "out.zarr"), "not written with several bands"),
        (("-o", tmp_path / "out.tif", "-k", "2"), "--key 2 has nothing to choose"),
        (("-o", tmp_path / "out.tif", "--workers", 2), "are for outputs in .zarr and .npy"),
    ]
    for options, message in faults:
        code, out, err = run("upsample", tmp_path / "two.tif", "--all-bands", *options)
        assert (code, out) == (2, "")
        assert message in err


@pytest.fixture
def around(tmp_path):
    """Samples all around the globe, with a gap at the seam."""
    turn = np.arange(0.0, 360.0, 20.0)
    values = np.cos(np.radians(turn - 10)) * np.linspace(1, 2, 7)[:, None]
    values[0, -1] = np.nan
    affine = np.array([[-10.0, 0.0, 30.0], [0.0, 20.0, 0.0], [0.0, 0.0, 1.0]])
    told = {"name": "t", "x:units": "degrees_east"}
    path = tmp_path / "around.nc"
    write(path, Grid(values, affine=affine, missing=np.isnan(values), metadata=told))
    return path


@pytest.mark.parametrize("method", ["local", pytest.param("global", marks=pytest.mark.slow)])
def test_a_periodic_axis_has_no_seam(run, around, tmp_path, method):
    """Rolled samples give the rolled result; the last interval is that before the first sample."""
    grid = read(around)
    rolled = np.roll(grid.values, 5, axis=1)
    other = tmp_path / "rolled.nc"
    write(other, replace(grid, values=rolled, missing=np.isnan(rolled)))
    finer = []
    for source in (around, other):
        target = tmp_path / f"fine_{source.name}"
        options = ("-o", target, "-f", 3, "--periodic", "x", "--method", method)
        code, out, _ = run("upsample", source, *options)
        assert (code, out.split(": ")[1][:7]) == (0, "19 x 54")
        finer.append(read(target))
    atol = 0 if method == "local" else 1e-3  # of iterations that end early
    np.testing.assert_allclose(
        np.roll(finer[0].values, 15, 1), finer[1].values, rtol=1e-6, atol=atol
    )
    np.testing.assert_array_equal(finer[0].values[::3, ::3], grid.values)
    np.testing.assert_allclose(finer[0].affine[1], [0, 20 / 3, 0], rtol=1e-12)


def test_contours_go_on_through_the_seam(run, around, tmp_path):
    """Lines of the globe end where the next turn begins, at the height where they begin."""
    ends = []
    for name in ("lines.geojson", "lines.svg"):
        target = tmp_path / name
        assert run("contours", around, "-o", target, "--levels", "1.6", "--periodic", "x")[0] == 0
    for each in json.loads((tmp_path / "lines.geojson").read_text())["features"]:
        x, y = np.array(each["geometry"]["coordinates"]).T
        assert x.max() <= 360
        ends += [(x[k] % 360, y[k]) for k in (0, -1) if x[k] in (0, 360)]
    assert len(ends) == 2
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    svg = (tmp_path / "lines.svg").read_text()
    width = float(re.search(r'viewBox="0 0 (\S+)', svg)[1])
    drawn = [float(x) for x in re.findall(r"[ML]([\d.]+),", svg)]
    assert 0.99 * width < max(drawn) <= width


@pytest.mark.parametrize("target", ["lines.csv", "fine.nc"])
def test_of_a_seam_only_what_is_open_is_told(run, around, tmp_path, target):
    """With the option that joins it; where it is joined, nothing."""
    command = "contours" if target == "lines.csv" else "upsample"
    call = (command, around, "-o", tmp_path / target)
    assert "are left out (--periodic x joins them)" in run(*call)[2]
    assert "goes all around" not in run(*call, "--periodic", "x")[2]


def test_commands_that_cannot_join_a_seam_name_no_option(run, around, tmp_path):
    err = run("compare", around, "-o", tmp_path / "figure.png", "--crop", "all")[2]
    assert "first sample are left out\n" in err


def test_what_is_not_periodic_is_refused(run, around, tmp_path):
    np.save(tmp_path / "in.npy", hill())
    faults = [
        (around, "out.nc", "lon", "there is no axis 'lon'; there are y, x"),
        (around, "out.nc", "y,q", "there is no axis 'q'"),
        (tmp_path / "in.npy", "out.zarr", "x", "written as a whole"),
    ]
    for source, target, names, message in faults:
        code, out, err = run("upsample", source, "-o", tmp_path / target, "--periodic", names)
        assert (code, out) == (2, "")
        assert message in err
    options = ("-o", tmp_path / "out.nc", "--periodic", "x", "--key", "x=0:9")
    assert "covers 180 degrees, not 360" in run("upsample", around, *options)[2]


def test_upsample_takes_the_methods_settings(run, tmp_path):
    np.save(tmp_path / "in.npy", hill())
    options = ("--iterations", 0, "--thin-plate-weight", 0.5, "--method", "local")
    assert run("upsample", tmp_path / "in.npy", "-o", tmp_path / "out.npy", *options)[0] == 0
    method = cf.LocalFairing(thin_plate_weight=0.5, iterations=0)
    expected = cf.fair_field(hill(), method=method).refine(4)
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), expected)


def test_noisy_samples_are_passed_within_their_noise(run, tmp_path):
    noisy = hill() + 0.02 * np.random.default_rng(0).normal(size=hill().shape)
    np.save(tmp_path / "in.npy", noisy)
    options = ("--method", "global", "--sigma", 0.02)
    assert run("upsample", tmp_path / "in.npy", "-o", tmp_path / "out.npy", *options)[0] == 0
    expected = cf.fair_field(noisy, method=cf.GlobalFairing(sigma=0.02)).refine(4)
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), expected)


@pytest.mark.slow
def test_the_noise_of_samples_is_found(run, tmp_path):
    noisy = hill() + 0.02 * np.random.default_rng(0).normal(size=hill().shape)
    np.save(tmp_path / "in.npy", noisy)
    options = ("-f", 1, "--method", "tune", "--sigma", "auto")
    assert run("upsample", tmp_path / "in.npy", "-o", tmp_path / "out.npy", *options)[0] == 0
    expected = cf.fair_field(noisy, method=cf.tune(noisy, noisy=True)).samples
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), expected)
    code, _, err = run(
        "upsample", tmp_path / "in.npy", "-o", tmp_path / "o.npy", *options[2:4], "--resume"
    )
    assert (code, "need the whole grid" in err) == (2, True)
    assert not (tmp_path / "o.npy").exists()


@pytest.mark.both_precisions
def test_float64_whatever_the_process_does_and_float32_on_request(run, tmp_path):
    values = hill() + 1e-12
    np.save(tmp_path / "in.npy", values)
    run("upsample", tmp_path / "in.npy", "-o", tmp_path / "out.npy")
    wide = np.load(tmp_path / "out.npy")
    assert wide.dtype == np.float64
    np.testing.assert_array_equal(wide[::4, ::4], values)
    _, _, err = run("upsample", tmp_path / "in.npy", "-o", tmp_path / "out.npy", "--float32")
    narrow = np.load(tmp_path / "out.npy")
    assert narrow.dtype == np.float32
    np.testing.assert_allclose(narrow, wide, atol=2e-3)
    assert "float64 samples are rounded to 7 digits" in err


@pytest.mark.slow
def test_upsample_a_volume(run, tmp_path):
    values = hill(shape=(3, 4))[..., None] + np.arange(5.0)
    np.savez(tmp_path / "in.npz", data=values, spacing=[1.0, 2.0, 3.0])
    code, out, _ = run("upsample", tmp_path / "in.npz", "-o", tmp_path / "out.npz", "-f", 2)
    assert (code, out.split(": ")[1]) == (0, "5 x 7 x 9 float64\n")
    fine = read(tmp_path / "out.npz")
    np.testing.assert_array_equal(fine.values[::2, ::2, ::2], values)
    assert fine.spacing == (0.5, 1.0, 1.5)


def test_upsample_an_image(run, tmp_path):
    Image.fromarray(hill("uint8")).save(tmp_path / "in.png")
    code, _, err = run("upsample", tmp_path / "in.png", "-o", tmp_path / "out.png")
    assert code == 0
    assert "note: values are rounded to 8-bit grey" in err
    np.testing.assert_array_equal(read(tmp_path / "out.png").values[::4, ::4], hill("uint8"))


def test_missing_samples_are_told_and_stay_missing(run, tmp_path):
    values = hill("int16")
    values[3:5, 6] = -99
    profile = {"dtype": "int16", "nodata": -99, "transform": Affine(20, 0, 4e5, 0, -30, 5e6)}
    with rasterio.open(tmp_path / "in.tif", "w", "GTiff", 11, 9, 1, "EPSG:32633", **profile) as dst:
        dst.write(values, 1)
    code, out, err = run("upsample", tmp_path / "in.tif", "-o", tmp_path / "out.tif")
    assert code == 0
    assert "missing samples: 2 of 99 (2.0%), within y 3..4, x 6..6" in err
    assert "missing" in out
    fine = read(tmp_path / "out.tif")
    assert fine.nodata == -99
    field = cf.fair_field(read(tmp_path / "in.tif").values.astype(float), spacing=(30.0, 20.0))
    np.testing.assert_array_equal(fine.missing, np.isnan(np.asarray(field.refine(4))))
    # Far from the gap nothing changes, and every real sample is still there.
    clean = np.asarray(cf.fair_field(hill(), spacing=(30.0, 20.0)).refine(4))
    np.testing.assert_allclose(fine.values[:, :12], clean[:, :12], rtol=2e-7)
    kept = values != -99
    np.testing.assert_array_equal(fine.values[::4, ::4][kept], values[kept])


@pytest.mark.slow
def test_global_fairing_fills_gaps_only_where_it_is_asked(run, tmp_path):
    values = hill()
    values[3:5, 6] = np.nan
    np.save(tmp_path / "in.npy", values)
    call = ("upsample", tmp_path / "in.npy", "-f", 2, "-m", "global", "--iterations", 0, "-o")
    code, _, err = run(*call, tmp_path / "gaps.npz")
    assert code == 0
    assert "the cells beside them stay missing" in err
    gaps = read(tmp_path / "gaps.npz").values
    expected = np.full(gaps.shape, False)
    expected[5:10, 11:14] = True
    np.testing.assert_array_equal(np.isnan(gaps), expected)
    assert run(*call, tmp_path / "in_tiles.zarr")[0] == 0
    in_tiles = read(tmp_path / "in_tiles.zarr").values
    np.testing.assert_array_equal(np.isnan(in_tiles), expected)
    np.testing.assert_allclose(in_tiles, gaps, atol=1e-2)
    code, _, err = run(*call, tmp_path / "filled.npz", "--fill")
    assert code == 0
    assert "they are filled" in err
    filled = read(tmp_path / "filled.npz").values
    assert np.isfinite(filled).all()
    np.testing.assert_array_equal(filled[~expected], gaps[~expected])


# ---- contours ------------------------------------------------------------------------------


def test_contours_as_geojson_lie_on_the_level_in_world_coordinates(run, dem, tmp_path):
    target = tmp_path / "lines.geojson"
    code, out, err = run("contours", dem, "-o", target, "--levels", "50,100")
    assert code == 0
    stored = json.loads(target.read_text())
    assert {feature["properties"]["level"] for feature in stored["features"]} == {50.0, 100.0}
    assert out == f"{target}: {len(stored['features'])} contours at 2 levels\n"
    assert stored["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::32633"
    assert "crs member" in err
    field = cf.fair_field(hill(), spacing=(30.0, 20.0))
    for feature in stored["features"]:
        x, y = np.array(feature["geometry"]["coordinates"]).T
        points = np.stack([5e6 - y, x - 4e5], axis=-1)
        np.testing.assert_allclose(
            field(points, "clamp"), feature["properties"]["level"], atol=1e-5
        )


def test_contours_as_svg(run, dem, tmp_path):
    code, _, _ = run("contours", dem, "-o", tmp_path / "lines.svg", "--interval", 40)
    text = (tmp_path / "lines.svg").read_text()
    assert code == 0
    assert re.findall(r'data-level="(\d+)"', text) == ["40", "80", "120", "160"]


def test_contours_as_a_picture(run, dem, tmp_path):
    code, _, _ = run("contours", dem, "-o", tmp_path / "lines.png", "--count", 3)
    assert code == 0
    with Image.open(tmp_path / "lines.png") as image:
        assert min(image.size) > 400
        assert len(np.unique(np.asarray(image.convert("L")))) > 50


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--levels", "500,600"), "note: no level lies within the samples, which are"),
        (("--levels", "100,600"), "note: 1 of 2 levels are outside the samples"),
    ],
)
def test_levels_outside_the_range_are_told(run, dem, tmp_path, options, said):
    code, _, err = run("contours", dem, "-o", tmp_path / "lines.svg", *options)
    assert code == 0
    assert said in err


def test_a_constant_field_has_no_contours(run, tmp_path):
    np.save(tmp_path / "in.npy", np.full(SHAPE, 7.0))
    for suffix in ("svg", "geojson", "png"):
        target = tmp_path / f"lines.{suffix}"
        code, out, err = run("contours", tmp_path / "in.npy", "-o", target)
        assert (code, out) == (0, f"{target}: 0 contours at 0 levels\n")
        assert "no level lies within the samples, which are 7 to 7" in err


@pytest.mark.parametrize(
    ("top", "crs", "said"),
    [
        (50.0, "EPSG:4326", "one of longitude is 0.64 of one of latitude at 50 degrees"),
        (-50.0, "EPSG:4326", "one of longitude is 0.62 of one of latitude at 51.6 degrees"),
        (5.0, "EPSG:4326", ""),
        (50.0, "EPSG:32633", ""),
        (50.0, None, ""),
    ],
)
def test_distances_in_degrees_are_told(run, tmp_path, top, crs, said):
    affine = np.array([[-0.2, 0.0, top], [0.0, 0.2, 4.0], [0.0, 0.0, 1.0]])
    write(tmp_path / "in.tif", Grid(hill(), affine=affine, crs=crs))
    code, _, err = run("contours", tmp_path / "in.tif", "-o", tmp_path / "o.csv", "--count", 1)
    assert code == 0
    assert said in err
    assert ("degrees" in err) == bool(said)


def test_levels():
    values = np.array([[0.0, 10.0], [np.nan, 5.0]])
    assert even_levels(values, 4) == [2.0, 4.0, 6.0, 8.0]
    assert interval_levels(values, 2.5) == [2.5, 5.0, 7.5]
    assert interval_levels(values - 5, 5.0) == [0.0]
    assert listed_levels("3, 1,2,1") == [1.0, 2.0, 3.0]
    assert even_levels(np.ones((2, 2)), 4) == []
    assert len(choose_levels(values, None, None, None)[0]) == 10


def test_contours_in_other_formats_are_the_exact_ones(run, dem, tmp_path):
    field = cf.fair_field(hill(), spacing=(30.0, 20.0))
    lines = field.contours([50.0, 100.0])
    target, picture = tmp_path / "lines.csv", tmp_path / "lines.png"
    options = ("--levels", "50,100", "--plot", picture)
    assert run("contours", dem, "-o", target, *options)[0] == 0
    assert len(target.read_text().splitlines()) == 1 + sum(len(line.points) for line in lines)
    with Image.open(picture) as image:
        assert min(image.size) > 400
    rows = np.genfromtxt(target, delimiter=",", skip_header=1)
    np.testing.assert_allclose(rows[: len(lines[0].points), 3] - 4e5, lines[0].points[:, 1])
    coarse = tmp_path / "coarse.csv"
    assert run("contours", dem, "-o", coarse, "--levels", "50,100", "-t", "0.3", "-q")[0] == 0
    assert len(coarse.read_text()) < 0.7 * len(target.read_text())


@pytest.mark.parametrize("suffix", ["geojson", "gpkg"])
def test_filled_contours(run, dem, tmp_path, suffix):
    geopandas = pytest.importorskip("geopandas")
    target = tmp_path / f"bands.{suffix}"
    code, out, _ = run("contours", dem, "-o", target, "--levels", "50,100", "--filled")
    assert (code, out) == (0, f"{target}: 3 bands\n")
    bands = geopandas.read_file(target)
    assert bands.crs.to_epsg() == 32633
    assert bands.area.sum() == pytest.approx(8 * 30 * 10 * 20)


def test_filled_contours_as_a_picture(run, dem, tmp_path):
    """Three colours are most of what is not white; without --filled, values are shaded."""
    share = {}
    for options in ((), ("--filled",)):
        target = tmp_path / "picture.png"
        assert run("contours", dem, "-o", target, "--levels", "50,100", *options)[0] == 0
        with Image.open(target) as image:
            shown = np.asarray(image.convert("RGB")).reshape(-1, 3)
        counts = np.unique(shown[(shown < 255).any(1)], axis=0, return_counts=True)[1]
        share[options] = np.sort(counts)[-3:].sum() / counts.sum()
    assert share[()] < 0.3 < 0.8 < share[("--filled",)]
    beside = ("-o", tmp_path / "bands.json", "--plot", tmp_path / "bands.png")
    assert run("contours", dem, "--levels", "50,100", "--filled", *beside)[0] == 0
    with Image.open(beside[-1]) as image, Image.open(target) as other:
        np.testing.assert_array_equal(np.asarray(image), np.asarray(other))


def test_filled_contours_tell_what_there_is_to_know(run, dem, tmp_path):
    options = ("-o", tmp_path / "bands.json", "--levels", "50,50.000000001", "--filled")
    code, out, err = run("contours", dem, *options)
    assert (code, out) == (0, f"{options[1]}: 2 bands\n")
    assert "too close to tell apart" in err
    found = json.loads(run("contours", dem, *options, "--json")[1])
    assert (found["levels"], found["bands"], found["unproved"]) == ([50.0], 2, 0)
    assert "too close to tell apart" in found["notes"][0]


# ---- compare and pictures ------------------------------------------------------------------


def test_compare_draws_three_panels(run, dem, tmp_path):
    code, out, _ = run("compare", dem, "-o", tmp_path / "figure.png")
    assert (code, out) == (0, f"{tmp_path / 'figure.png'}: rows 0:9, columns 0:11, 10 levels\n")
    with Image.open(tmp_path / "figure.png") as image:
        assert image.width > 2 * image.height


def test_compare_shows_a_part(run, tmp_path):
    values = np.zeros((60, 70))
    values[20:29, 30:41] = hill()
    np.save(tmp_path / "in.npy", values)
    target = tmp_path / "figure.png"
    options = ("--crop", "20:29,30:41", "--levels", "50")
    code, out, _ = run("compare", tmp_path / "in.npy", "-o", target, *options)
    assert (code, out) == (0, f"{target}: rows 20:29, columns 30:41, 1 levels\n")
    assert busiest_window(values, 16)[0][0] in range(8, 28)
    assert busiest_window(values, 100) == [(0, 60), (0, 70)]
    values[:, 35] = np.nan
    (_, _), (left, right) = busiest_window(values, 16)
    assert right - left == 16


def test_bilinear_is_aligned_on_the_samples_and_linear_between():
    samples = np.array([[0.0, 2.0, np.nan], [4.0, 10.0, 1.0]])
    fine = BilinearField(samples).refine(2)
    assert fine.shape == (3, 5)
    np.testing.assert_array_equal(fine[::2, ::2], samples)
    assert fine[1, 1] == 4.0
    assert np.isnan(fine[0, 3])
    assert fine[2, 3] == 5.5
    with pytest.raises(ValueError, match="samples must be 2-D, got 3-D"):
        BilinearField(np.zeros((2, 2, 2)))


def test_plot_contours_draws_what_it_is_given():
    field = BilinearField(hill(), spacing=(30.0, 20.0), origin=(100.0, 50.0))
    ax = plot.plot_contours(field, [50.0, 100.0, 999.0], refine=4, title="hill")
    assert ax.get_xlim() == (50.0, 250.0)
    assert ax.get_ylim() == (340.0, 100.0)
    (lines,) = ax.collections
    assert list(lines.levels) == [50.0, 100.0]
    upward = plot.plot_contours(field, [], upward=True, shade=False, refine=4)
    assert upward.get_ylim() == (100.0, 340.0)
    assert not upward.images
    assert not upward.collections


def test_draw_surface_shades_by_the_angle_to_the_light():
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0], [3.0, 0.0, 0.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    upwards = np.tile([1.0, 0.0, 0.0], (4, 1))  # axis 0 is up
    flat = np.zeros(4)
    mesh = Isosurface(0.5, corners, triangles, upwards, flat, flat, 0, 0, ())
    colors = {}
    for elevation in (0.0, 89.0):
        ax = Figure().add_subplot(projection="3d")
        plot.draw_surface(mesh, ax, elevation, color=(1.0, 0.5, 0.25))
        (drawn,) = ax.collections
        colors[elevation] = drawn.get_facecolor()
        assert ax.get_xlim() == (0, 2)
        assert ax.get_ylim() == (0, 1)
        assert ax.get_zlim() == (0, 3)
    assert np.allclose(colors[89.0][:, 1:3] / colors[89.0][:, :1], [0.5, 0.25])
    assert (colors[89.0][:, 0] > 1.5 * colors[0.0][:, 0]).all()


def test_surfaces_are_drawn_as_they_lie_in_the_world():
    """A corner of larger z is above where the file's z ascends, and below where it descends."""
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 1.0]])
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    mesh = Isosurface(0.5, corners, np.array([[0, 1, 2]]), normals, *np.zeros((2, 3)), 0, 0, ())
    for steps, limits in (((1, 1, 1), (0, 2)), ((-3, 1, 1), (-2, 0))):
        grid = Grid(np.zeros((3, 3, 3)), affine=np.diag([*steps, 1.0]), spacing=(1.0, 1.0, 1.0))
        (ax,) = plot.surface_figure(mesh, grid=grid).axes
        assert ax.get_zlim() == limits
    turned = Grid(np.zeros((3, 3, 3)), affine=np.eye(4)[[1, 0, 2, 3]])
    assert plot.surface_figure(mesh, grid=turned).axes[0].get_zlim() == (0, 1)


def test_plots_refuse_what_cannot_be_drawn(tmp_path):
    volume = cf.BezierField(jnp.zeros((7, 7, 7)), jnp.ones(3), jnp.zeros(3))
    with pytest.raises(ValueError, match="field must be 2-D to be drawn, got 3-D"):
        plot.plot_contours(volume, [0.0])
    with pytest.raises(ValueError, match="fields must hold at least one"):
        plot.compare_figure({}, [0.0])
    figure = plot.compare_figure({"a": BilinearField(hill())}, [50.0])
    with pytest.raises(InputError, match=r"pictures are written as \.png"):
        plot.save_figure(figure, tmp_path / "a.pdf")


def test_nothing_of_pyplot_is_touched(run, dem, tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)
    run("compare", dem, "-o", tmp_path / "figure.png")
    assert "matplotlib.pyplot" not in sys.modules


# ---- metrics -------------------------------------------------------------------------------


def test_metrics_tell_what_is_missing_and_what_the_integrals_are(run, dem, tmp_path):
    values = hill()
    values[0, 0] = np.nan
    np.save(tmp_path / "in.npy", values)
    code, out, err = run("metrics", tmp_path / "in.npy", "--levels", "100")
    assert (code, "missing samples: 1 of 99" in err) == (0, True)
    (line,) = (line for line in out.splitlines() if "integrated over all levels" in line)
    assert re.search(r"length [\d.e+]+ value × length, turning/2pi [\d.e+]+ value, bending", line)
    found = json.loads(run("metrics", dem, "--levels", "100", "--json")[1])
    integrals = found["integrals"]
    assert integrals["units"] == {"length": "m × m", "turning/2pi": "m", "bending": "m / m"}
    field = cf.fair_field(hill(), spacing=(30.0, 20.0))
    assert integrals["length"] == pytest.approx(cf.metrics.coarea(field).length)


def test_places_where_parts_merge_are_in_coordinates_of_the_file(run, tmp_path):
    x = np.linspace(-1, 1, 10)
    ridge = np.exp(-((4.5 * (x[:, None] - 0.8 * x)) ** 2))
    grid = Grid(ridge, affine=NORTH_UP, crs="EPSG:32633")
    write(tmp_path / "ridge.tif", grid)
    found = json.loads(run("metrics", tmp_path / "ridge.tif", "--levels", "0.8", "--json")[1])
    corners = grid.world(np.array([[0, 0], [9 * grid.spacing[0], 9 * grid.spacing[1]]]))
    places = np.array([change["position"] for change in found["changes"]])
    assert len(places)
    assert (places >= corners.min(0)).all()
    assert (places <= corners.max(0)).all()


# ---- info ----------------------------------------------------------------------------------


def test_info(run, dem):
    code, out, err = run("info", dem)
    assert (code, err) == (0, "")
    shown = {line[:12].strip(): line[13:] for line in out.splitlines()}
    assert shown["shape"] == "9 x 11 (y, x)"
    assert shown["type"] == "int16"
    assert shown["range"].endswith(" m")
    assert shown["spacing"] == "30 x 20"
    assert shown["y"] == "5000000 to 4999760 (first to last sample)"
    assert shown["crs"] == "WGS 84 / UTM zone 33N"
    assert shown["missing"] == "none"


def test_info_on_a_turned_grid_tells_its_steps(tmp_path, run):
    affine = np.array([[-8.0, 6.0, 100.0], [6.0, 8.0, 20.0], [0.0, 0.0, 1.0]])
    write(tmp_path / "turned.npz", Grid(np.zeros((4, 5)), affine=affine))
    printed = run("info", tmp_path / "turned.npz")[1]
    assert re.search(r"^first +y 100, x 20$", printed, re.M)
    assert re.search(r"^step y +y -8, x 6 \(turned\)$", printed, re.M)
    assert re.search(r"^step x +y 6, x 8 \(turned\)$", printed, re.M)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("elev_luxembourg.tif", "3942 of 8550 (46.1%), within y 0..89, x 0..94"),
        ("all-nodata.tif", "175725 of 175725 (100.0%), within y 0..2474, x 0..70"),
        ("jacksboro_bigendian_fortran.npy", "int16, byte-swapped"),
        ("olinda_dem_utm25s.tif", "UTM Zone 25, Southern Hemisphere"),
        ("camera.png", "512 x 512 (y, x)"),
        ("cell.png", "0 to 255"),
    ],
)
def test_info_on_real_files(run, shared_data, name, said):
    code, out, _ = run("info", shared_data / name)
    assert code == 0
    assert said in out


@pytest.mark.data
def test_upsample_a_real_raster_with_nodata(run, shared_data, tmp_path):
    source = shared_data / "float_raster_with_nodata.tif"
    code, _, err = run("upsample", source, "-o", tmp_path / "out.tif", "--factor", 2)
    assert code == 0
    assert "missing samples: 58 of 156 (37.2%), within y 1..11, x 4..12" in err
    old, new = read(source), read(tmp_path / "out.tif")
    assert new.nodata == old.nodata
    np.testing.assert_array_equal(new.values[::2, ::2], old.values)
    assert np.nanmin(new.values) > -0.2  # nothing of -3.4e38 leaked into the samples
    assert np.nanmax(new.values) < 0.5


# ---- errors --------------------------------------------------------------------------------


def one_line(err: str) -> str:
    lines = err.strip().splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("contourfair: ")
    return lines[0]


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (hill()[0], r"the samples are 1-D (11); 2-D or 3-D data is needed"),
        (np.zeros((3, 3, 3, 3)), r"the samples are 4-D (3 x 3 x 3 x 3)"),
        (hill()[:1], "axis 'y' has 1 sample (1 x 11 in all); fairing needs at least 3"),
        (hill()[:, :2], "axis 'x' has 2 samples (9 x 2 in all)"),
        (np.full(SHAPE, np.nan), "every sample is missing, so there is nothing to fair"),
        (hill("complex128"), "in.npy: holds complex numbers"),
        (np.zeros((0, 4)), "in.npy: holds an empty array"),
    ],
)
def test_samples_that_cannot_be_faired(run, tmp_path, array, said):
    np.save(tmp_path / "in.npy", array)
    code, out, err = run("upsample", tmp_path / "in.npy", "-o", tmp_path / "out.npy", "-q")
    assert (code, out) == (2, "")
    assert said in one_line(err)
    assert not (tmp_path / "out.npy").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("upsample", "in.npy"), "Missing option '--output' / '-o'"),
        (("upsample", "none.npy", "-o", "out.npy"), "none.npy: there is no such file"),
        (("upsample", "in.npy", "-o", "in.npy"), "in.npy: is the input; write to another file"),
        (("upsample", "in.npy", "-o", "folder.npy"), "folder.npy: is a folder"),
        (("upsample", "in.npy", "-o", "no/out.npy"), "there is no folder no"),
        (("upsample", "in.npy", "-o", "out.xyz"), "files of this name are not written"),
        (("upsample", "in.npy", "-o", "out.png"), "a PNG holds whole grey values"),
        (("upsample", "in.npy", "-o", "out.npy", "-f", "0"), "--factor must be 1 or more, got 0"),
        (("upsample", "in.npy", "-o", "out.npy", "-f", "two"), "--factor must be a whole number"),
        (("upsample", "in.npy", "-o", "out.npy", "-f", "9999999"), "this machine has"),
        (("upsample", "in.npy", "-o", "out.npy", "-m", "best"), "method must be one of local"),
        (("upsample", "in.npy", "-o", "out.npy", "--iterations", "-1"), "iterations must be"),
        (("upsample", "in.npy", "-o", "out.npy", "--thin-plate-weight", "2"), "thin_plate_weight"),
        (("upsample", "in.npy", "-o", "out.npy", "--sigma", "1"), "--sigma needs --method global"),
        (("upsample", "in.npy", "-o", "o.npy", "-m", "global", "--sigma", "x"), "--sigma must be"),
        (("upsample", "in.npy", "-o", "o.npy", "-m", "global", "--sigma", "0"), "sigma must hold"),
        (
            ("upsample", "in.npy", "-o", "out.npy", "-m", "global", "--sigma", "auto"),
            "--sigma auto needs --method tune",
        ),
        (
            ("upsample", "in.npy", "-o", "o.zarr", "-m", "global", "--sigma", "1", "--resume"),
            "sigma looks at the whole grid",
        ),
        (("upsample", "in.npy", "-o", "out.npy", "-k", "z"), "there is no 'z' to choose"),
        (("upsample", "in.npy", "-o", "out.npy", "--fill"), "--fill needs --method global"),
        (("upsample", "in.npy", "-o", "out.zarr", "--fill"), "--fill needs --method global"),
        (("contours", "in.npy", "-o", "out.csv", "--filled"), "must end in .geojson, .json, .gpkg"),
        (("contours", "in.npy", "-o", "o.svg", "-t", "0"), "tolerance must be a distance"),
        (("contours", "in.npy", "-o", "o.svg", "--plot", "o.pdf"), "o.pdf: the name must end in"),
        (("contours", "in.npy", "-o", "o.svg", "--plot", "no/o.png"), "there is no folder no"),
        (("contours", "in.npy", "-o", "out.dxf"), "the name must end in .geojson"),
        (("contours", "in.npy", "-o", "o.svg", "--levels", "1,x"), "levels must be numbers"),
        (("contours", "in.npy", "-o", "o.svg", "--levels", "nan"), "finite numbers"),
        (("contours", "in.npy", "-o", "o.svg", "--count", "0"), "count must be 1 to"),
        (("contours", "in.npy", "-o", "o.svg", "--interval", "0"), "interval must be positive"),
        (("contours", "in.npy", "-o", "o.svg", "--interval", "1e-9"), "makes more than 10000"),
        (
            ("contours", "in.npy", "-o", "o.svg", "--count", "3", "--interval", "2"),
            "give only one of --levels, --interval and --count",
        ),
        (("contours", "none.npy", "-o", "o.svg", "-t", "0"), "tolerance must be a distance"),
        (("contours", "none.npy", "-o", "o.svg", "--levels", "1,x"), "levels must be numbers"),
        (("contours", "none.npy", "-o", "o.svg", "-m", "best"), "method must be one of"),
        (("compare", "none.npy", "-o", "o.png", "--count", "0"), "count must be 1 to"),
        (("metrics", "none.npy", "--interval", "-1"), "interval must be positive"),
        (("metrics", "none.npy", "--fill"), "--fill needs --method global"),
        (("adaptive", "none.npy", "-o", "o.vtu", "-t", "0"), "tolerance must be above zero"),
        (("isosurface", "none.npy", "-o", "o.vtp", "-l", "1", "-t", "0"), "must be a distance"),
        (("upsample", "none.npy", "-o", "out.npy", "--iterations", "-1"), "iterations must be"),
        (("contours", "volume.npy", "-o", "o.svg"), "the samples are 3-D (3 x 3 x 3); 2-D data"),
        (("compare", "in.npy", "-o", "figure.pdf"), "the name must end in .png"),
        (("compare", "in.npy", "-o", "f.png", "--crop", "1:5"), "crop must look like"),
        (("compare", "in.npy", "-o", "f.png", "--crop", "1:50,1:9"), "1:50 is not within 0:9"),
        (("compare", "in.npy", "-o", "f.png", "--crop", "1:3,1:9"), "axis 'y' has 2 samples"),
        (("info", "text.npy"), "text.npy: is not a .npy array"),
        (("nonsense",), "No such command 'nonsense'"),
        (("info", "in.npy", "--nonsense"), "No such option: --nonsense"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_bad_calls_end_in_one_line_and_code_2(run, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    np.save("in.npy", hill() + 0.25)
    np.save("volume.npy", np.zeros((3, 3, 3)))
    (tmp_path / "text.npy").write_text("hello")
    (tmp_path / "folder.npy").mkdir()
    before = sorted(os.listdir())
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert said in one_line(err)
    assert sorted(os.listdir()) == before


@pytest.mark.parametrize(
    ("dtype", "gap", "said"),
    [
        ("int16", False, "a PNG holds whole grey values 0..65535, the source held int16"),
        ("int16", True, "a PNG holds whole grey values"),
        ("uint16", True, "a 16-bit PNG cannot mark missing samples"),
    ],
)
def test_what_a_format_cannot_hold_is_said_before_any_fairing(
    run, tmp_path, monkeypatch, dtype, gap, said
):
    monkeypatch.setattr("contourfair_jax.cli._upsample.fair", None)
    values, missing = hill(dtype) + np.dtype(dtype).type(1), np.zeros(SHAPE, bool)
    missing[:3, :3] = gap
    given = {"missing": missing, "nodata": 0} if gap else {}
    write(tmp_path / "in.tif", Grid(np.where(missing, 0, values).astype(dtype), **given))
    code, _, err = run("upsample", tmp_path / "in.tif", "-o", tmp_path / "out.png", "-q")
    assert (code, said in one_line(err)) == (2, True)


def test_samples_below_zero_are_said_before_any_fairing(run, tmp_path, monkeypatch):
    monkeypatch.setattr("contourfair_jax.cli._upsample.fair", None)
    np.save(tmp_path / "in.npy", hill() - 50)
    call = ("upsample", tmp_path / "in.npy", "-o", tmp_path / "out.png", "-f", 1, "-q")
    code, _, err = run(*call)
    assert (code, "a PNG holds whole grey values" in one_line(err)) == (2, True)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("all-nodata.tif", "every sample is missing, so there is nothing to fair"),
        ("jacksboro_1x403.npy", "axis 'y' has 1 sample (1 x 403 in all)"),
        ("jacksboro_344x1.npy", "axis 'x' has 1 sample (344 x 1 in all)"),
        ("topobathy.npz", "coordinate 'y' is not evenly spaced"),
    ],
)
def test_real_files_that_cannot_be_faired(run, shared_data, tmp_path, name, said):
    code, _, err = run("upsample", shared_data / name, "-o", tmp_path / "out.npz", "-q")
    assert code == 2
    assert said in one_line(err)


def test_names_that_are_too_long_or_no_characters(run, dem, tmp_path):
    for command in ("upsample", "contours"):
        code, _, err = run(command, dem, "-o", tmp_path / f"{300 * 'a'}.npy", "-q")
        assert code == 2
        assert "name too long" in err or "the name must end in" in err
    code, _, err = run("info", tmp_path / f"{300 * 'a'}.npy")
    assert (code, "there is no such file" in err) == (2, True)
    target = tmp_path / os.fsdecode(b"\xff.npy")
    code, out, _ = run("upsample", dem, "-o", target)
    assert code == 0
    assert "\\udcff.npy: 33 x 41" in out
    assert target.exists()


@pytest.mark.parametrize("command", ["upsample", "contours"])
def test_a_folder_that_is_read_only_is_said_before_any_work(
    run, dem, tmp_path, monkeypatch, command
):
    monkeypatch.setattr("contourfair_jax.io._registry._format", None)  # nothing is read
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    target = tmp_path / ("o.npy" if command == "upsample" else "o.svg")
    code, _, err = run(command, dem, "-o", target, "-q")
    assert code == 2
    assert "may not be written to; choose another" in one_line(err)


def test_faults_of_the_program_are_code_1_and_leave_nothing(run, dem, tmp_path, monkeypatch):
    def broken(*_):
        raise TypeError("first line\nsecond line")

    monkeypatch.setattr("contourfair_jax.cli._upsample.fair", broken)
    code, out, err = run("upsample", dem, "-o", tmp_path / "out.tif", "-q")
    assert (code, out) == (1, "")
    assert "internal error, TypeError: first line (set" in one_line(err)
    assert os.listdir(tmp_path) == ["dem.tif"]
    monkeypatch.setenv("CONTOURFAIR_TRACEBACK", "1")
    assert "Traceback" in run("upsample", dem, "-o", tmp_path / "out.tif", "-q")[2]


def test_an_interrupt_is_code_130(run, dem, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("contourfair_jax.cli._upsample.fair", interrupted)
    assert run("upsample", dem, "-o", tmp_path / "out.tif")[0] == 130
    assert os.listdir(tmp_path) == ["dem.tif"]


# ---- manners -------------------------------------------------------------------------------


def test_quiet_says_nothing(run, tmp_path):
    values = hill()
    values[4, 4] = np.nan
    np.save(tmp_path / "in.npy", values)
    assert run("upsample", tmp_path / "in.npy", "-o", tmp_path / "out.npy", "-q") == (0, "", "")


def test_results_as_json(run, dem, tmp_path):
    code, out, err = run("upsample", dem, "-o", tmp_path / "out.npy", "--json")
    assert code == 0
    found = json.loads(out)
    assert (found["shape"], found["type"], found["missing"]) == ([33, 41], "float32", 0)
    assert "spacing and coordinates are left out" in found["notes"][0]
    assert "note" not in err
    found = json.loads(run("contours", dem, "-o", tmp_path / "o.csv", "--count", 2, "--json")[1])
    assert (len(found["levels"]), found["lines"], found["unproved"]) == (2, 2, 0)
    found = json.loads(run("info", dem, "--json")[1])
    assert found["range"] == [hill().min(), hill().max()]
    np.testing.assert_array_equal(found["affine"], NORTH_UP)
    found = json.loads(run("compare", dem, "-o", tmp_path / "o.png", "--json", "-q")[1])
    assert found["window"] == [[0, 9], [0, 11]]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("info", "none.npy"), 2, "none.npy: there is no such file"),
        (("info", "in.npy", "--nonsense"), 2, "No such option: --nonsense"),
        (("info", "in.npy"), 1, "internal error, TypeError: a fault"),
        (("info", "in.npy"), 130, "interrupted"),
    ],
)
def test_failures_as_json(run, tmp_path, monkeypatch, arguments, code, said):
    def fault(*_):
        raise {1: TypeError, 130: KeyboardInterrupt}[code]("a fault")

    monkeypatch.chdir(tmp_path)
    np.save("in.npy", hill())
    if code != 2:
        monkeypatch.setattr("contourfair_jax.cli._info.read", fault)
    found, out, err = run(*arguments, "--json")
    assert found == code
    assert json.loads(out)["error"].startswith(said)
    assert f"contourfair: {json.loads(out)['error']}" == one_line(err)


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("contourfair co", ["contours", "compare"]),
        ("contourfair upsample --method ", ["local", "global", "tune"]),
    ],
)
def test_the_shell_completes_names(words, found):
    asked = {"_CONTOURFAIR_COMPLETE": "complete_bash", "COMP_WORDS": words}
    environment = {**os.environ, **asked, "COMP_CWORD": str(words.count(" "))}
    command = [sys.executable, "-c", "import sys; from contourfair_jax import cli; cli.main()"]
    call = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert call.stdout.split() == found


def test_help_names_all_endings_that_can_be_written(run):
    out = "".join(run("upsample", "--help")[1].split())
    for suffix in (suffix for each in FORMATS if each.writer for suffix in each.suffixes):
        assert f"{suffix}," in out or f"{suffix}." in out


def test_help_names_all_endings_that_are_read(run):
    out = re.sub(r"[\s│]", "", run("--help")[1])
    for suffix in (suffix for each in FORMATS for suffix in each.suffixes):
        assert re.search(re.escape(suffix) + r"[,;(]", out), suffix


def test_help_of_the_key_names_its_grammar(run):
    out = re.sub(r"[\s│]", "", run("info", "--help")[1])
    for each in ("NAME,time=3,level=0:5", "t=0", "component=2", "GeoTIFFband", "DICOMseries"):
        assert each in out


def test_help_and_version(run):
    code, out, _ = run("--version")
    assert (code, out) == (0, f"contourfair {cf.__version__}\n")
    for command in ("upsample", "contours", "compare", "info"):
        code, out, _ = run(command, "--help")
        assert code == 0
        assert f"contourfair {command}" in out.split("Examples")[1]


def test_without_arguments_the_help_is_shown(run):
    code, out, err = run()
    assert (code, err) == (2, "")
    assert "Usage: contourfair" in out


def test_every_method_of_the_table_is_in_the_help(run):
    out = run("upsample", "--help")[1]
    for name in METHODS:
        assert name in out


def test_long_work_is_announced_and_short_work_is_not(capsys, monkeypatch):
    monkeypatch.setattr("contourfair_jax.cli._console._PATIENCE", 0.05)
    with Reporter().working("long work"):
        time.sleep(0.3)
    assert capsys.readouterr().err == "long work ...\n"
    monkeypatch.setattr("contourfair_jax.cli._console._PATIENCE", 60.0)
    with Reporter().working("short work"):
        pass
    assert capsys.readouterr() == ("", "")


def test_a_terminal_gets_a_bar_that_goes_away(capsys, monkeypatch):
    monkeypatch.setattr("contourfair_jax.cli._console._PATIENCE", 0.05)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with Reporter().working("long work") as move:
        move(1, 4)
        time.sleep(0.5)
    shown = capsys.readouterr().err
    assert "long work" in shown
    assert "\x1b[" in shown
    assert re.search(r"0:00:0\d", shown)


HELP_WITHOUT_ENGINE = """
import sys, types
package = types.ModuleType("contourfair_jax")  # its __init__ would import the engine
package.__path__ = [sys.argv[1]]
sys.modules["contourfair_jax"] = package
from contourfair_jax.cli import main
assert main(["upsample", "--help"]) == 0
loaded = {"jax", "equinox", "matplotlib", "rasterio", "PIL"} & set(sys.modules)
sys.exit(f"loaded {loaded}" if loaded else 0)
"""


def test_help_loads_no_heavy_package():
    folder = os.path.dirname(os.path.dirname(cli.__file__))
    done = subprocess.run(
        [sys.executable, "-c", HELP_WITHOUT_ENGINE, folder], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_an_interrupt_while_modules_are_imported_is_code_130(tmp_path):
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt")
    path = os.pathsep.join([str(tmp_path), *sys.path])
    command = [sys.executable, "-m", "contourfair_jax", "info", "in.npy", "--json"]
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (130, "contourfair: interrupted\n")
    assert json.loads(done.stdout) == {"error": "interrupted"}


def test_as_a_module_in_its_own_process():
    command = [sys.executable, "-m", "contourfair_jax", "info", "nothing.npy"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "contourfair: nothing.npy: there is no such file\n"
