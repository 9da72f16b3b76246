"""One planner of tile jobs: from Python and on the command line the same output, place and all."""

import numpy as np
import pytest
import tile_worker
import xarray as xr
import zarr

import contourfair_jax as cf
from contourfair_jax import tiles
from contourfair_jax.cli import main
from contourfair_jax.io import read
from contourfair_jax.tiles import _program

SHAPE = (13, 17)


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch):
    """Tiles of 8 x 8 cells."""
    for method, overlap in tile_worker.SMALL.items():
        monkeypatch.setitem(_program._OVERLAPS, method, overlap)


def labelled(dtype="float32") -> xr.DataArray:
    """Temperatures in a projection, rows from north to south, steps 30 and 20."""
    values = np.random.default_rng(5).normal(280.0, 5.0, SHAPE).astype(dtype)
    places = {
        "y": ("y", 5e6 - 30.0 * np.arange(SHAPE[0]), {"units": "m"}),
        "x": ("x", 4e5 + 20.0 * np.arange(SHAPE[1]), {"units": "m"}),
    }
    attributes = {"units": "K", "long_name": "temperature", "grid_mapping": "system"}
    return xr.DataArray(values, places, ("y", "x"), "warmth", attributes)


def with_coordinates(folder):
    system = xr.DataArray(0, attrs={"crs_wkt": "EPSG:32633", "spatial_ref": "EPSG:32633"})
    data = labelled().to_dataset().assign_coords(system=system)
    data.to_zarr(folder / "in.zarr", zarr_format=3, consolidated=False)
    return folder / "in.zarr"


def whole_numbers(folder):
    array = labelled().round().astype("int16")
    del array.attrs["grid_mapping"]
    array.to_dataset().to_zarr(folder / "in.zarr", zarr_format=3, consolidated=False)
    return folder / "in.zarr"


def array_alone(folder):
    zarr.create_array(str(folder / "in.zarr"), data=labelled().values, chunks=(5, 6))
    return folder / "in.zarr"


def array_with_names(folder):
    zarr.create_array(
        str(folder / "in.zarr"),
        data=labelled("float64").values,
        dimension_names=("lat", "lon"),
        attributes={"units": "m"},
    )
    return folder / "in.zarr"


def npy(folder):
    np.save(folder / "in.npy", labelled().values)
    return folder / "in.npy"


SOURCES = [with_coordinates, whole_numbers, array_alone, array_with_names, npy]


@pytest.mark.parametrize("suffix", [".zarr", ".npy"])
@pytest.mark.parametrize("made", SOURCES)
def test_python_and_the_command_line_write_the_same(tmp_path, capsys, made, suffix):
    source = made(tmp_path)
    ours, theirs = tmp_path / f"python{suffix}", tmp_path / f"command{suffix}"
    outcome = tiles.refine_to(source, ours, 2, method=tile_worker.METHOD)
    settings = tile_worker.METHOD
    assert isinstance(settings, cf.LocalFairing)
    options = ["--iterations", str(settings.iterations), "--workers", "1", "--memory", "20"]
    code = main(["upsample", str(source), "-o", str(theirs), "--factor", "2", *options])
    assert code == 0, capsys.readouterr().err
    left, right = read(ours), read(theirs)
    assert left.shape == outcome.shape
    assert left.values.dtype == right.values.dtype
    np.testing.assert_array_equal(left.values, right.values)
    for name in ("spacing", "origin", "axes", "units", "crs", "metadata", "notes"):
        assert getattr(left, name) == getattr(right, name), name
    np.testing.assert_array_equal(np.asarray(left.affine), np.asarray(right.affine))


def test_the_place_of_the_source_is_kept(tmp_path):
    tiles.refine_to(with_coordinates(tmp_path), tmp_path / "out.zarr", 2)
    fine = read(tmp_path / "out.zarr")
    assert fine.units == "K"
    assert fine.axes == ("y", "x")
    assert "32633" in str(fine.crs)
    assert fine.spacing == (15.0, 10.0)
    np.testing.assert_allclose(fine.affine, [[-15, 0, 5e6], [0, 10, 4e5], [0, 0, 1]])
    whole = cf.fair_field(labelled("float64").values, spacing=(30.0, 20.0)).refine(2)
    np.testing.assert_allclose(fine.values, whole, rtol=1e-6)


def test_labelled_arrays_keep_their_place(tmp_path):
    array = labelled()
    del array.attrs["grid_mapping"]
    tiles.refine_to(array, tmp_path / "out.zarr", (1, 4))
    with xr.open_zarr(tmp_path / "out.zarr", chunks=None) as data:
        fine = data["warmth"]
        np.testing.assert_allclose(fine.x, 4e5 + 5.0 * np.arange(4 * 16 + 1))
        np.testing.assert_array_equal(fine.y, array.y)
        assert fine.attrs["units"] == "K"
    whole = cf.fair_field(array.values.astype("float64"), spacing=(30.0, 20.0)).refine((1, 4))
    np.testing.assert_allclose(fine, whole, rtol=1e-6)


def test_spacing_that_is_given_wins(tmp_path):
    tiles.refine_to(with_coordinates(tmp_path), tmp_path / "out.npy", 2, spacing=1.0)
    whole = cf.fair_field(labelled("float64").values).refine(2)
    np.testing.assert_allclose(np.load(tmp_path / "out.npy"), whole, rtol=1e-6)


def test_another_place_is_not_resumed(tmp_path, monkeypatch):
    """The record of a run says where its output lies, so that no other is continued."""
    source, target = with_coordinates(tmp_path), tmp_path / "out.zarr"
    with monkeypatch.context() as patch:
        patch.setattr("contourfair_jax.tiles._job._run_rest", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            tiles.refine_to(source, target, 2)
    group = zarr.open_group(source)
    group["x"][:] += 1
    with pytest.raises(ValueError, match="cannot be resumed, for place of the output was"):
        tiles.refine_to(source, target, 2, resume=True)
