"""Samples of the fair field on other grids."""

import json

import numpy as np
import pytest
from file_helpers import inside  # noqa: F401

import contourfair_jax as cf
from contourfair_jax.io import Grid, read, write

pytestmark = pytest.mark.usefixtures("inside")

SHAPE = (9, 11)
NORTH_UP = np.array([[-30.0, 0.0, 5e6], [0.0, 20.0, 4e5], [0.0, 0.0, 1.0]])
UTM = "EPSG:32633"


def hill(shape=SHAPE) -> np.ndarray:
    axes = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return np.exp(-2 * sum(x**2 for x in axes)) + 0.1 * axes[0]


@pytest.fixture
def dem(tmp_path):
    write(tmp_path / "dem.tif", Grid(hill(), affine=NORTH_UP, crs=UTM, units="m"))
    return tmp_path / "dem.tif"


def test_another_spacing_of_a_geotiff(run, dem, tmp_path):
    target = tmp_path / "out.tif"
    code, out, err = run("resample", dem, "--spacing", 12, "-o", target)
    assert (code, out) == (0, f"{target}: 21 x 17 float64\n")
    assert "note" not in err
    made = read(target)
    expected = NORTH_UP @ np.diag([12 / 30, 12 / 20, 1])
    np.testing.assert_allclose(made.affine, expected, rtol=1e-12)
    assert (made.crs, made.units) == (read(dem).crs, "m")
    points = np.stack(np.meshgrid(12.0 * np.arange(21), 12.0 * np.arange(17), indexing="ij"), -1)
    field = cf.fair_field(hill(), spacing=(30.0, 20.0))
    np.testing.assert_allclose(made.values, field(points), rtol=0, atol=1e-12)


def test_the_grid_of_another_file(run, dem, tmp_path):
    """Turned and partly outside; what lies outside is missing."""
    affine = np.array([[25.0, 5.0, 4999900.0], [-4.0, 21.0, 400050.0], [0.0, 0.0, 1.0]])
    other, target = Grid(np.zeros((8, 6)), affine=affine, crs=UTM), tmp_path / "out.npz"
    write(tmp_path / "other.tif", other)
    code, out, err = run("resample", dem, "--like", tmp_path / "other.tif", "-o", target)
    assert code == 0
    world = np.stack(np.indices((8, 6)), -1) @ affine[:2, :2].T + affine[:2, 2]
    points = (world - NORTH_UP[:2, 2]) / np.array([-30.0, 20.0]) * np.array([30.0, 20.0])
    expected = np.asarray(cf.fair_field(hill(), spacing=(30.0, 20.0))(points))
    assert 5 < np.isnan(expected).sum() < 40
    made = read(target)
    np.testing.assert_allclose(made.values, expected, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(made.affine, affine)
    assert f"outside the file, and so missing: {np.isnan(expected).sum()} of 48" in err
    assert f"{np.isnan(expected).mean():.1%} missing" in out


def test_the_same_grid_gives_the_samples_also_between_gaps(run, tmp_path):
    values = hill()
    values[2, 3] = values[4, 4] = values[4, 6] = np.nan
    source, target = tmp_path / "in.npz", tmp_path / "out.npz"
    write(source, Grid(values, missing=np.isnan(values)))
    assert run("resample", source, "--like", source, "-o", target)[0] == 0
    np.testing.assert_array_equal(read(target).values, values)


def test_on_the_faces_beside_gaps_there_are_values(run, tmp_path):
    """As `upsample` has them, by factors of two."""
    values = hill()
    values[2, 3] = np.nan
    source, fine, target = (tmp_path / f"{name}.npz" for name in ("in", "fine", "out"))
    write(source, Grid(values, missing=np.isnan(values)))
    assert run("upsample", source, "-o", fine, "-f", 2, "-m", "global")[0] == 0
    assert run("resample", source, "-o", target, "--spacing", 0.5, "-m", "global")[0] == 0
    expected = read(fine).values
    assert 1 < np.isnan(expected).sum() < 20
    np.testing.assert_allclose(read(target).values, expected, rtol=0, atol=1e-10)


def test_volumes_become_isotropic(run, tmp_path):
    values = hill((5, 7, 8))
    source, target = tmp_path / "in.npz", tmp_path / "out.npz"
    write(source, Grid(values, spacing=(3.0, 1.0, 1.0), axes=("z", "y", "x")))
    code, out, _err = run("resample", source, "-o", target, "--spacing", "z=1", "--json")
    assert (code, json.loads(out)["shape"]) == (0, [13, 7, 8])
    field = cf.fair_field(values, spacing=(3.0, 1.0, 1.0))
    np.testing.assert_allclose(read(target).values, field.refine((3, 1, 1)), rtol=0, atol=1e-12)
    assert read(target).spacing == (1.0, 1.0, 1.0)


def test_large_volumes_are_told_what_is_faster(monkeypatch, run, tmp_path):
    monkeypatch.setattr("contourfair_jax.cli._steps._SLOW", 200)
    source, target = tmp_path / "in.npz", tmp_path / "out.npz"
    write(source, Grid(hill((5, 7, 8)), spacing=(3.0, 1.0, 1.0), axes=("z", "y", "x")))
    call = ("resample", source, "-o", target, "--spacing", "z=1")
    assert "takes minutes, --method global a tenth of that" in run(*call)[2]
    assert "note" not in run(*call, "--iterations", 0)[2]


def test_periodic_axes_go_on(run, tmp_path):
    """The other grid has longitudes from -180, that of the samples from 0."""
    lat, lon = np.linspace(-60, 60, 9), np.arange(0, 360, 30.0)
    values = np.cos(np.radians(lat))[:, None] * np.cos(np.radians(lon) - 1)
    affine = np.array([[15.0, 0, -60], [0, 30.0, 0], [0, 0, 1]])
    axes = {"axes": ("lat", "lon"), "metadata": {"lon:units": "degrees_east"}}
    write(tmp_path / "in.npz", Grid(values, affine=affine, **axes))
    shifted = affine - np.array([[0, 0, 0], [0, 15.0, 180], [0, 0, 0]])
    write(tmp_path / "like.npz", Grid(np.zeros((9, 24)), affine=shifted, **axes))
    call = ("resample", tmp_path / "in.npz", "--like", tmp_path / "like.npz", "--periodic", "lon")
    assert run(*call, "-o", tmp_path / "out.npz")[0] == 0
    call = ("upsample", tmp_path / "in.npz", "--factor", "1,2", "--periodic", "lon")
    assert run(*call, "-o", tmp_path / "fine.npz")[0] == 0
    turned = np.roll(read(tmp_path / "fine.npz").values, 12, 1)
    np.testing.assert_allclose(read(tmp_path / "out.npz").values, turned, rtol=0, atol=1e-12)


def test_coarser_grids_are_told_of(run, dem, tmp_path):
    code, out, err = run("resample", dem, "-o", tmp_path / "out.tif", "--spacing", "60,40")
    assert (code, "5 x 6" in out) == (0, True)
    assert "coarser: it has values of the field at its samples, not means" in err
    np.testing.assert_array_equal(read(tmp_path / "out.tif").values, hill()[::2, ::2])


def test_what_float32_computes_is_as_near_as_it_can_be(run, dem, tmp_path):
    target = tmp_path / "out.tif"
    assert run("resample", dem, "-o", target, "--spacing", 12, "--float32", "-q")[0] == 0
    points = np.stack(np.meshgrid(12.0 * np.arange(21), 12.0 * np.arange(17), indexing="ij"), -1)
    expected = cf.fair_field(hill(), spacing=(30.0, 20.0))(points)
    assert read(target).values.dtype == np.float32
    np.testing.assert_allclose(read(target).values, expected, rtol=0, atol=3e-6)


def other_grids(tmp_path):
    volume = Grid(hill((3, 4, 5)), affine=np.eye(4))
    elsewhere = NORTH_UP + np.array([[0, 0, 1e5], [0, 0, 0], [0, 0, 0]])
    grids = {
        "volume.npz": volume,
        "degrees.tif": Grid(hill(), affine=NORTH_UP, crs="EPSG:4326"),
        "elsewhere.tif": Grid(hill(), affine=elsewhere, crs=UTM),
        "nowhere.npz": Grid(hill()),
        "turned.npz": Grid(hill(), affine=NORTH_UP, axes=("x", "y")),
    }
    for name, grid in grids.items():
        write(tmp_path / name, grid)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "give either --like or --spacing"),
        (("--like", "elsewhere.tif", "--spacing", "3"), "give either --like or --spacing"),
        (("--spacing", "0"), "--spacing must be above zero, got 0"),
        (("--spacing", "fine"), "--spacing must be a number such as 10"),
        (("--spacing", "1,2,3"), "--spacing must be one number or 2, for the axes y, x"),
        (("--spacing", "q=1"), "--spacing: there is no axis 'q'; there are y, x"),
        (("--spacing", "x=201"), "--spacing 201 is longer than all of axis 'x', 200 in the"),
        (("--spacing", "1e-5"), "this machine has"),
        (("--like", "volume.npz"), "--like is 3-D, the samples are 2-D"),
        (("--like", "degrees.tif"), "--like has another coordinate reference system"),
        (("--like", "elsewhere.tif"), "no sample of the new grid lies within those of the file"),
        (("--like", "nowhere.npz"), "it is not known where those of --like lie"),
        (("--like", "turned.npz"), "--like has the axes x, y, the samples y, x"),
        (("--like", "none.tif"), "none.tif"),
    ],
)
def test_what_cannot_be_is_refused(run, dem, tmp_path, options, said):
    other_grids(tmp_path)
    given = [tmp_path / each if "." in each and "=" not in each else each for each in options]
    code, out, err = run("resample", dem, "-o", tmp_path / "out.tif", "-q", *given)
    assert (code, out) == (2, "")
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "out.tif").exists()
