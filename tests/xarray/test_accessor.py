"""The accessor of xarray's arrays: same numbers as the engine, and all labels kept."""

import doctest
import subprocess
import sys

import dask.array
import numpy as np
import pytest
import xarray as xr

import contourfair_jax as cf
import contourfair_jax.xarray
from contourfair_jax.io import read, write
from contourfair_jax.tiles import _program

UP, DOWN = np.linspace(40.0, 60.0, 6), np.linspace(60.0, 40.0, 6)
LON = np.linspace(-3.0, 5.0, 9)


def field(lat=DOWN, lon=LON, dtype=float) -> xr.DataArray:
    rng = np.random.default_rng(3)
    return xr.DataArray(
        rng.normal(size=(len(lat), len(lon))).astype(dtype),
        coords={
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", lon, {"units": "degrees_east"}),
            "height": ((), 2.0, {"units": "m"}),
        },
        dims=("lat", "lon"),
        name="t",
        attrs={"units": "K"},
    )


def engine(array: xr.DataArray) -> cf.BezierField:
    """The field of an array whose coordinates ascend."""
    spacing = [float(array[dim][1] - array[dim][0]) for dim in array.dims]
    return cf.fair_field(array.values, spacing=spacing)


def test_upsample_gives_the_samples_of_the_field_with_all_labels():
    array = field(lat=UP)
    fine = array.fair.upsample(4)
    np.testing.assert_array_equal(fine.values, engine(array).refine(4))
    assert fine.dims == array.dims
    assert fine.name == "t"
    assert fine.attrs == array.attrs
    assert fine.lat.attrs == array.lat.attrs
    assert fine.height.item() == 2.0
    np.testing.assert_array_equal(fine.lat[::4], array.lat)
    np.testing.assert_array_equal(fine.lon[::4], array.lon)
    assert np.ptp(np.diff(fine.lat)) < 1e-12


def test_coordinates_that_descend_only_turn_the_result():
    array = field(lat=UP)
    for turned in (np.s_[::-1, :], np.s_[:, ::-1], np.s_[::-1, ::-1]):
        fine = array[turned].fair.upsample(3)
        xr.testing.assert_allclose(fine[turned], array.fair.upsample(3), rtol=1e-12)
        np.testing.assert_allclose(fine[::3, ::3], array[turned], rtol=1e-13)


@pytest.mark.slow
def test_the_type_of_the_samples_is_kept():
    assert field(dtype="f4").fair.upsample(2).dtype == np.float32
    assert field(dtype="f8").fair.upsample(2).dtype == np.float64
    assert (10 * field()).astype("i2").fair.upsample(2).dtype == np.float32
    assert field().astype("f4").assign_coords(lat=DOWN.astype("f4")).fair.upsample(2).lat.dtype == (
        np.float32
    )


def test_time_is_a_batch_and_dims_come_back_in_their_order():
    array = field().expand_dims(time=[0, 6, 12], axis=1) * xr.DataArray([1.0, 2, 3], dims="time")
    fine = array.fair.upsample(2)
    assert fine.dims == ("lat", "time", "lon")
    for k in range(3):
        xr.testing.assert_allclose(fine.isel(time=k), array.isel(time=k).fair.upsample(2))
    other = array.rename(time="member")
    xr.testing.assert_allclose(
        other.fair.upsample(2, dims=["lat", "lon"]), fine.rename(time="member")
    )


@pytest.mark.slow
def test_volumes():
    array = xr.DataArray(np.random.default_rng(0).normal(size=(3, 4, 3)), dims=("z", "y", "x"))
    fine = array.fair.upsample(2, method=cf.LocalFairing(iterations=0))
    assert fine.shape == (5, 7, 5)
    np.testing.assert_allclose(fine[::2, ::2, ::2], array)
    assert not fine.coords


def test_coordinates_beside_are_refined_linearly_or_left_out():
    array = field().assign_coords(
        level=("lat", np.array([0.0, 1, 4, 9, 16, 25])),
        place=(("lat", "lon"), np.add.outer(np.arange(6.0), np.arange(9.0))),
        name=("lon", list("abcdefghi")),
        around=("lon", np.linspace(300.0, 700.0, 9) % 360, {"units": "degrees_east"}),
    )
    fine = array.fair.upsample(4)
    np.testing.assert_array_equal(fine.level[::4], array.level)
    np.testing.assert_allclose(fine.level[4:8], [1.0, 1.75, 2.5, 3.25])
    np.testing.assert_allclose(fine.place, np.add.outer(np.arange(21) / 4, np.arange(33) / 4))
    assert set(fine.coords) == {"lat", "lon", "height", "level", "place"}


# ---- all the way round ---------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("descending", [False, True])
def test_a_periodic_axis_has_no_seam(descending):
    lon = np.arange(0.0, 360.0, 30.0)
    array = field(lon=lon[::-1] if descending else lon)
    fine = array.fair.upsample(4, periodic="lon")
    assert fine.shape == (21, 48)
    np.testing.assert_allclose(fine[::4, ::4], array, rtol=1e-12)
    rolled = array.roll(lon=5, roll_coords=False).fair.upsample(4, periodic="lon")
    np.testing.assert_allclose(rolled, fine.roll(lon=20, roll_coords=False), rtol=1e-10)
    steps = np.diff(fine.lon)
    np.testing.assert_allclose(steps, (-7.5 if descending else 7.5) * np.ones(47))
    again = array.fair.interp(lat=fine.lat, lon=fine.lon, periodic="lon")
    np.testing.assert_allclose(again, fine, rtol=1e-9, atol=1e-12)
    beyond = array.fair.interp(lat=50.0, lon=[365.0, -355.0, 5.0], periodic="lon")
    np.testing.assert_allclose(beyond, beyond[2], rtol=1e-9)


def test_an_axis_that_is_not_all_around_is_refused():
    with pytest.raises(ValueError, match="covers 9 degrees, not 360; it is not periodic"):
        field().fair.upsample(2, periodic="lon")
    with pytest.raises(ValueError, match=r"periodic must name some of \['lat', 'lon'\]"):
        field().fair.upsample(2, periodic=["time"])


# ---- interp --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_interp_on_a_grid_equals_upsample():
    array = field()
    fine = array.fair.upsample(4)
    xr.testing.assert_allclose(array.fair.interp(lat=fine.lat, lon=fine.lon), fine, rtol=1e-9)
    xr.testing.assert_allclose(
        array.fair.interp({"lat": fine.lat.values}), fine.isel(lon=slice(None, None, 4))
    )


@pytest.mark.slow
def test_interp_takes_what_xarray_takes():
    array = field()
    along = {
        "lat": xr.DataArray([41.0, 50.0, 59.0], dims="point"),
        "lon": xr.DataArray([0.5, 1.0, 4.5], dims="point"),
    }
    requests = (along, {"lat": 50.0}, {"lat": 50.0, "lon": 1.0}, {"lon": [0.5, 1.0], "lat": [41.0]})
    for request in requests:
        ours, theirs = array.fair.interp(request), array.interp(request)
        assert ours.dims == theirs.dims
        assert ours.shape == theirs.shape
        assert set(ours.coords) == set(theirs.coords)
        assert ours.attrs == theirs.attrs
        for name in ours.coords:
            xr.testing.assert_identical(ours[name].variable, theirs[name].variable)
    with_time = array.expand_dims(time=[1, 2])
    assert with_time.fair.interp(along).dims == ("time", "point")


def test_interp_leaves_what_it_was_given():
    wanted = xr.DataArray([41.0, 50.0], dims="point", attrs={"source": "mine"})
    ours, theirs = field().fair.interp(lat=wanted), field().interp(lat=wanted)
    assert ours.lat.attrs == theirs.lat.attrs == {"source": "mine"}
    assert wanted.attrs == {"source": "mine"}


def test_interp_on_long_axes_keeps_the_digits_of_its_points():
    count = 40_000
    waves = xr.DataArray(
        np.sin(np.arange(count) / 2, dtype=np.float32) * np.ones((3, 1), np.float32),
        {"y": np.arange(3.0), "x": np.arange(float(count))},
    )
    late, early = (waves.isel(x=slice(first, first + 40)) for first in (count - 40, 0))
    at = count - 20 + 0.3
    ours = waves.fair.interp(y=1.0, x=at).item()
    assert ours == pytest.approx(late.fair.interp(y=1.0, x=at).item(), abs=1e-5)
    assert early.fair.interp(y=1.0, x=at).isnull()


def test_interp_keeps_the_order_of_the_dimensions():
    array = field().expand_dims(time=3).transpose("lon", "time", "lat")
    points = {dim: xr.DataArray(array[dim].values[:2], dims="point") for dim in ("lat", "lon")}
    for request in ({"lat": [41.0, 50.0], "lon": [0.5, 1.0]}, {"lon": 0.5}, points):
        assert array.fair.interp(request).dims == array.interp(request).dims


@pytest.mark.parametrize("chunks", [None, {}])
def test_no_members_of_a_batch_have_a_shape(chunks):
    array = field().expand_dims(time=np.arange(0))
    array = array if chunks is None else array.chunk(chunks)
    assert array.fair.upsample(2).sizes == {"time": 0, "lat": 11, "lon": 17}
    if chunks is None:
        assert array.fair.interp(lat=[50.0]).sizes == {"time": 0, "lat": 1, "lon": 9}


def test_interp_outside_follows_the_rule():
    array = field()
    assert np.isnan(array.fair.interp(lat=70.0, lon=0.0))
    border = array.sel(lat=60.0, lon=0.0)
    assert array.fair.interp(lat=70.0, lon=0.0, outside="clamp").item() == pytest.approx(
        border.item()
    )


@pytest.mark.slow
def test_positions_far_from_zero_keep_their_digits_in_single_precision():
    y, x = 5_000_000.0 + 0.5 * np.arange(6), 400_000.0 + 0.5 * np.arange(9)
    plane = np.arange(54, dtype="f4").reshape(6, 9)
    array = xr.DataArray(plane, coords={"y": y, "x": x}, dims=("y", "x"))
    found = array.fair.interp(y=y[4] + 0.125, x=x[:-1] + 0.0625)
    np.testing.assert_allclose(found, 36 + 2.25 + 0.125 + np.arange(8), rtol=1e-6)


# ---- contours ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("lat", [UP, DOWN], ids=["up", "down"])
def test_contours_are_in_the_coordinates_of_the_array(lat):
    array = (field(lat=lat) * 0 + (field(lat=lat).lat - 50) ** 2 / 25) + (field().lon - 1) ** 2
    lines = array.fair.contours([1.0, 2.5])
    assert lines.levels == (1.0, 2.5)
    for line in lines:
        y, x = line.points.T
        at = {"lat": xr.DataArray(y, dims="point"), "lon": xr.DataArray(x, dims="point")}
        np.testing.assert_allclose(array.fair.interp(at), line.level, rtol=1e-8)
        assert line.closed
        inside = 0.5 * np.sum(y[:-1] * x[1:] - y[1:] * x[:-1])
        assert inside < 0  # larger values on the left: outside of the loop
    with pytest.raises(ValueError, match=r"has the dimensions \('time', 'lat', 'lon'\)"):
        array.expand_dims("time").fair.contours(1.0)


def test_contours_of_a_periodic_axis_reach_around():
    lon = np.arange(0.0, 360.0, 30.0)
    array = field(lon=lon) * 0 + field(lon=lon).lat
    (line,) = array.fair.contours(51.0, periodic="lon")
    assert sorted(line.points[[0, -1], 1].tolist()) == [0.0, 360.0]


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "settings", "said"),
    [
        (lambda a: a, {"factor": 0}, "factor must be an integer that is at least 1, got 0"),
        (lambda a: a.assign_coords(lat=UP**2), {}, "coordinate 'lat' is not evenly spaced"),
        (lambda a: a.assign_coords(lat=list("abcdef")), {}, "which has no length"),
        (lambda a: a, {"dims": ["lat", "x"]}, r"dims must name 2 or 3 .* got \['lat', 'x'\]"),
        (lambda a: a, {"dims": ["lat", "lat"]}, "dims must name 2 or 3"),
        (lambda a: a.isel(lat=0), {}, r"got \['lon'\]"),
        (lambda a: a.astype(complex), {}, "holds complex128; real numbers are needed"),
        (lambda a: a.isel(lat=slice(2)), {}, "values"),
    ],
)
def test_what_cannot_be_faired_is_said(change, settings, said):
    with pytest.raises(ValueError, match=said):
        change(field()).fair.upsample(**{"factor": 2, **settings})


def test_interp_names_what_it_does_not_know():
    with pytest.raises(
        ValueError, match=r"coords must be along \['lat', 'lon'\], got \['height'\]"
    ):
        field().fair.interp(height=1.0)
    with pytest.raises(ValueError, match="must be a number, 1-D or a DataArray, got 2-D"):
        field().fair.interp(lat=np.ones((2, 2)))


@pytest.mark.slow
def test_dask_chunks_are_kept_and_change_nothing(monkeypatch):
    overlap = _program.Overlap(1, {2: 8, 3: 4})
    monkeypatch.setitem(_program._OVERLAPS, cf.LocalFairing, overlap)
    method = cf.LocalFairing(iterations=0)
    lon = np.arange(24) * 15.0
    array = field(lat=np.linspace(60.0, 40.0, 21), lon=lon)
    array = xr.concat([array, -array], "time").transpose("lat", "time", "lon")
    for periodic in ((), "lon"):
        whole = array.fair.upsample(2, method=method, periodic=periodic)
        found = []
        for lat, last in ((21, 24), (5, 7)):
            chunked = array.chunk(lat=lat, lon=last, time=1)
            fine = chunked.fair.upsample(2, method=method, periodic=periodic)
            assert isinstance(fine.data, dask.array.Array)
            chunks = dict(fine.chunksizes)
            assert chunks["time"] == (1, 1)
            assert chunks["lat"] == ((41,) if lat == 21 else (10, 10, 10, 10, 1))
            assert chunks["lon"][0] == min(2 * last, fine.sizes["lon"])
            computed = fine.compute(scheduler="synchronous")
            xr.testing.assert_allclose(computed, whole, rtol=1e-10, atol=1e-12)
            np.testing.assert_array_equal(computed[::2, :, ::2], array)
            found.append(computed)
        xr.testing.assert_identical(*found)


@pytest.mark.slow
def test_members_of_a_batch_are_computed_side_by_side():
    """More members than threads, which change places as often as they can."""
    array = field(lat=np.linspace(60.0, 40.0, 6), lon=np.arange(7.0))
    batch = xr.concat([k * array for k in range(1, 41)], "member").chunk(member=1)
    often, method = sys.getswitchinterval(), cf.LocalFairing(iterations=0)
    sys.setswitchinterval(1e-6)
    try:
        fine = batch.fair.upsample(2, dims=("lat", "lon"), method=method)
        fine = fine.compute(scheduler="threads", num_workers=8)
    finally:
        sys.setswitchinterval(often)
    np.testing.assert_array_equal(fine[:, ::2, ::2], batch)


def test_dask_chunks_are_refused_where_points_are_wanted():
    pytest.importorskip("dask")
    with pytest.raises(ValueError, match=r"in dask chunks; call \.compute\(\) on it first"):
        field().chunk(lat=2).fair.interp(lat=50.0)


def test_without_xarray_the_extra_is_named():
    code = "import sys; sys.modules['xarray'] = None; import contourfair_jax.xarray"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "pip install 'contourfair-jax[xarray]'" in done.stderr


def test_the_example_in_the_docstring():
    assert doctest.testmod(contourfair_jax.xarray).failed == 0


@pytest.mark.data
def test_a_real_field_all_around(shared_data, tmp_path):
    with xr.open_dataset(shared_data / "oisst_reduced.nc", engine="scipy") as data:
        sea = data.sst.isel(time=0, zlev=0).load()
    fine = sea.fair.upsample(4, periodic="lon")
    assert fine.shape == (357, 720)
    np.testing.assert_allclose(fine[::4, ::4], sea, rtol=1e-5)
    assert fine.attrs == sea.attrs
    write(tmp_path / "sea.nc", read(shared_data / "oisst_reduced.nc", "sst"))
    assert np.isfinite(fine[:, -1]).sum() > 100
