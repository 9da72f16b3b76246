"""NetCDF and Zarr: choice of variables and parts, coordinates, packed values, codecs."""

import json
import os
import pickle

import numcodecs
import numpy as np
import pytest
import xarray as xr
import zarr
from file_helpers import inside, samples  # noqa: F401

from contourfair_jax.io import Grid, InputError, read, write
from contourfair_jax.io.formats.zarr import read_outline

pytestmark = pytest.mark.usefixtures("inside")

LAT = np.linspace(60.0, 15.0, 4, dtype="f4")
LON = np.linspace(-10.0, 40.0, 6, dtype="f4")
DEGREES = {"lat": {"units": "degrees_north"}, "lon": {"units": "degrees_east"}}


def field(dims=("lat", "lon"), shape=(4, 6), lat=LAT, lon=LON, **attributes) -> xr.DataArray:
    places = {
        axis: (axis, values, DEGREES[axis])
        for axis, values in (("lat", lat), ("lon", lon))
        if axis in dims
    }
    return xr.DataArray(samples(shape=shape), dims=dims, coords=places, attrs=attributes, name="t")


def stored(tmp_path, data, **settings):
    """The path of a NetCDF-4 file with `data`, a variable or a data set."""
    data = data.to_dataset() if isinstance(data, xr.DataArray) else data
    path = tmp_path / "data.nc"
    data.to_netcdf(path, engine="h5netcdf", **settings)
    return path


# ---- which variable, which part ----------------------------------------------------------------


def test_the_only_field_needs_no_key(tmp_path):
    data = field(units="K").to_dataset()
    data["height"] = ((), 2.0)
    data["lat_bounds"] = (("lat", "two"), np.array([["a", "b"]] * 4))
    grid = read(stored(tmp_path, data))
    assert grid.shape == (4, 6)
    assert grid.axes == ("lat", "lon")
    assert grid.units == "K"
    assert grid.metadata["name"] == "t"


def test_several_fields_need_a_key(tmp_path):
    path = stored(tmp_path, xr.Dataset({"a": field(), "b": field() + 1, "c": field()[0]}))
    with pytest.raises(InputError, match=r"holds 2 fields, .* key: a \(lat 4, lon 6\), b \(lat"):
        read(path)
    assert read(path, "b").values[0, 0] == 1
    with pytest.raises(InputError, match="holds no variable 'x'; it has a"):
        read(path, "x")
    with pytest.raises(InputError, match="'c' has 1 axis left; 2 or 3 are needed"):
        read(path, "c")


def series(tmp_path, shape=(5, 4, 6), dims=("time", "lat", "lon")):
    return stored(tmp_path, field(dims, shape))


def test_a_time_series_is_indexed_by_the_key(tmp_path):
    path = series(tmp_path)
    with pytest.raises(InputError, match=r"is a time series \(time 5, .* such as t,time=0, or"):
        read(path)
    for key, step in (("time=2", 2), ("t,time=2", 2), ("t,time=-1", 4)):
        grid = read(path, key)
        np.testing.assert_array_equal(grid.values, samples(shape=(5, 4, 6))[step])
        assert grid.axes == ("lat", "lon")
    assert read(path, "time=:").shape == (5, 4, 6)
    assert read(path, "time=1:4,lon=2:").shape == (3, 4, 4)
    assert read(path, "time=1,lon=2:").affine[1, 2] == LON[2]


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("time=5", r"time=5 is outside 0\.\.4"),
        ("time=-6", r"time=-6 is outside 0\.\.4"),
        ("time=4:2", r"time=4:2 holds nothing of 0\.\.4"),
        ("level=0", "has no axis 'level'; it has time 5, lat 4, lon 6"),
        ("time=noon", "key must look like name,axis=3 or name,axis=0:5, got 'time=noon'"),
        ("t,time", "key must look like"),
        ("time=0,lat=1,lon=2", "'t' has 0 axis left"),
    ],
)
def test_keys_that_fit_nothing(tmp_path, key, said):
    with pytest.raises(InputError, match=said):
        read(series(tmp_path), key)


def test_four_axes_need_a_key(tmp_path):
    path = series(tmp_path, (2, 3, 4, 6), ("time", "level", "lat", "lon"))
    with pytest.raises(InputError, match="choose with a key such as t,time=0,level=0"):
        read(path)
    np.testing.assert_array_equal(
        read(path, "time=1,level=2").values, samples(shape=(2, 3, 4, 6))[1, 2]
    )


def test_thin_axes_are_dropped(tmp_path):
    assert read(series(tmp_path, (1, 1, 4, 6), ("time", "z", "lat", "lon"))).shape == (4, 6)
    assert read(stored(tmp_path, field(shape=(1, 6), lat=LAT[:1]))).shape == (1, 6)


# ---- coordinates -------------------------------------------------------------------------------


def test_coordinates_become_places_and_come_back_refined(tmp_path):
    grid = read(stored(tmp_path, field(units="K", long_name="warmth")))
    np.testing.assert_allclose(grid.affine, [[-15, 0, 60], [0, 10, -10], [0, 0, 1]])
    write(tmp_path / "fine.nc", grid.refined(np.ones((13, 21), np.float32), 4))
    with xr.open_dataset(tmp_path / "fine.nc", engine="h5netcdf") as fine:
        np.testing.assert_allclose(fine.lat[::4], LAT)
        np.testing.assert_allclose(fine.lon[::4], LON)
        assert fine.lat.attrs["units"] == "degrees_north"
        assert fine.t.attrs["units"] == "K"
        assert fine.t.attrs["long_name"] == "warmth"


def test_x_before_y_is_turned(tmp_path):
    grid = read(stored(tmp_path, field().transpose("lon", "lat")))
    assert grid.axes == ("lat", "lon")
    np.testing.assert_array_equal(grid.values, samples(shape=(4, 6)))


def test_uneven_coordinates_are_refused_by_name(tmp_path):
    path = stored(tmp_path, field(lat=np.array([1.0, 2.0, 4.0, 8.0])))
    with pytest.raises(InputError, match="coordinate 'lat' is not evenly spaced"):
        read(path)


def test_single_precision_coordinates_count_as_even(tmp_path):
    lon = (359.58 + 0.0009 * np.arange(6)).astype("f4")
    assert np.ptp(np.diff(lon)) > 0.03 * 0.0009
    assert read(stored(tmp_path, field(lon=lon))).spacing[1] == pytest.approx(0.0009, rel=0.02)


def test_longitudes_go_on_over_the_turn(tmp_path):
    lon = np.array([350.0, 355.0, 0.0, 5.0, 10.0, 15.0])
    grid = read(stored(tmp_path, field(lon=lon)))
    np.testing.assert_allclose(grid.affine[1], [0, 5, 350])
    assert "lon jumps by a turn in the file; here it goes on to 375" in grid.notes


def test_a_full_circle_is_said(tmp_path):
    grid = read(stored(tmp_path, field(lon=np.arange(6) * 60.0)))
    assert any("lon goes all around" in note for note in grid.notes)
    assert read(stored(tmp_path, field(lon=np.arange(6) * 72.0))).notes == ()


def test_curvilinear_coordinates_are_said_not_to_be_used(tmp_path):
    data = xr.DataArray(samples(shape=(4, 6)), dims=("j", "i"), name="t").to_dataset()
    places = samples(shape=(4, 6))
    data = data.assign_coords(
        nav_lat=(("j", "i"), places, DEGREES["lat"]), nav_lon=(("j", "i"), places, DEGREES["lon"])
    )
    grid = read(stored(tmp_path, data))
    assert grid.affine is None
    assert grid.notes == (
        "nav_lat, nav_lon are curvilinear: sample numbers are used instead",
        "variables that are left out: nav_lat, nav_lon",
    )


def test_uneven_levels_behind_their_numbers_are_said(tmp_path):
    data = field(("level", "lat", "lon"), (3, 4, 6)).assign_coords(
        level=("level", [0, 1, 2]),
        height=("level", [5.0, 20.0, 80.0], {"units": "m", "positive": "up"}),
    )
    grid = read(stored(tmp_path, data))
    assert "height is not evenly spaced: level counts as the distance" in grid.notes


def test_coordinates_that_are_no_numbers(tmp_path):
    path = stored(tmp_path, field().assign_coords(lat=["a", "b", "c", "d"]))
    with pytest.raises(InputError, match=r"coordinate 'lat' holds .*, not numbers"):
        read(path)


# ---- values and texts --------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy", "netcdf4"])
def test_packed_integers_are_decoded(tmp_path, engine):
    data = field().where(field() != 3).to_dataset()
    packing = {"dtype": "int16", "scale_factor": 0.5, "add_offset": 10.0, "_FillValue": -999}
    settings = {"format": "NETCDF3_64BIT_DATA"} if engine == "netcdf4" else {}
    data.to_netcdf(tmp_path / "data.nc", engine=engine, encoding={"t": packing}, **settings)
    grid = read(tmp_path / "data.nc")
    np.testing.assert_array_equal(grid.values, data.t)
    assert grid.missing_count == 1
    assert grid.nodata is None
    assert grid.source_dtype.kind == "f"


def test_a_fill_value_is_kept_and_written_again(tmp_path):
    data = field().where(field() != 3).to_dataset()
    grid = read(stored(tmp_path, data, encoding={"t": {"_FillValue": np.float32(-9e9)}}))
    assert grid.nodata == np.float32(-9e9)
    for suffix in (".nc", ".zarr"):
        write(tmp_path / f"again{suffix}", grid)
        again = read(tmp_path / f"again{suffix}")
        assert again.nodata == grid.nodata
        np.testing.assert_array_equal(again.values, grid.values)
        assert again.metadata == grid.metadata


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_a_projection_is_kept_as_wkt_or_in_its_own_terms(tmp_path, suffix):
    pole = {"grid_mapping_name": "rotated_latitude_longitude", "grid_north_pole_latitude": 37.5}
    data = field(grid_mapping="pole").to_dataset().assign(pole=((), 0, pole))
    grid = read(stored(tmp_path, data))
    assert grid.crs is None
    write(tmp_path / f"again{suffix}", grid)
    again = read(tmp_path / f"again{suffix}")
    assert json.loads(again.metadata["grid_mapping"]) == pole
    write(tmp_path / f"wkt{suffix}", Grid(samples(shape=(4, 6)), crs="EPSG:4326"))
    assert read(tmp_path / f"wkt{suffix}").crs == "EPSG:4326"


UTM = (
    'PROJCS["UTM",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
    'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["central_meridian",15],PARAMETER["scale_factor",0.9996],'
    'PARAMETER["false_easting",500000],UNIT["metre",1]]'
)
DEGREE = 'GEOGCRS["WGS 84",DATUM["W",ELLIPSOID["W",6378137,298.3,LENGTHUNIT["metre",1]]]]'
# A system, and the standard name and the units of x, or None.
ALONG_X = {
    "metres": (UTM, "projection_x_coordinate", "m"),
    "feet": (UTM.replace('"metre",1', '"foot",0.3048'), "projection_x_coordinate", "foot"),
    "survey": (UTM.replace('"metre",1', '"f",0.304800609601219'), None, "US_survey_foot"),
    "links": (UTM.replace('"metre",1', '"Clarke link",0.201166'), None, "Clarke_link"),
    "heights": (f'COMPD_CS["both",{UTM},VERT_CS["h",UNIT["foot",0.3048]]]', None, "m"),
    "degrees": (DEGREE, "longitude", "degrees_east"),
    "pole": (DEGREE[:-1] + ',DERIVINGCONVERSION["pole"]]', None, None),
    "unknown": ("somewhere", None, None),
}


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
@pytest.mark.parametrize("case", ALONG_X)
def test_coordinates_say_what_their_reference_system_makes_of_them(tmp_path, suffix, case):
    crs, name, units = ALONG_X[case]
    affine = np.array([[-30.0, 0.0, 60.0], [0.0, 20.0, 4.0], [0.0, 0.0, 1.0]])
    grid = Grid(samples(shape=(4, 6)), affine=affine, crs=crs, metadata={"name": "t"})
    write(tmp_path / f"a{suffix}", grid)
    engine = "h5netcdf" if suffix == ".nc" else "zarr"
    with xr.open_dataset(tmp_path / f"a{suffix}", engine=engine) as data:
        assert data.x.attrs.get("units") == units
        if name:
            assert data.x.attrs["standard_name"] == name
            assert data.y.attrs["standard_name"] in (name.replace("x", "y", 1), "latitude")
        if suffix == ".nc":
            assert "_FillValue" not in data.x.encoding
    again = read(tmp_path / f"a{suffix}")
    assert again.metadata == grid.metadata
    assert again.crs == crs


def test_attributes_of_coordinates_are_kept_beside_a_reference_system(tmp_path):
    data = field().rename(lat="y", lon="x").to_dataset()
    data["crs"] = ((), 0, {"crs_wkt": UTM})
    data["t"].attrs["grid_mapping"] = "crs"
    data["x"].attrs = {"units": "km", "long_name": "to the east"}
    data["y"].attrs = {"units": "m", "long_name": "to the north"}
    write(tmp_path / "again.nc", read(stored(tmp_path, data)))
    with xr.open_dataset(tmp_path / "again.nc", engine="h5netcdf") as again:
        assert again.x.attrs == {"units": "km", "long_name": "to the east"}
        name = {"standard_name": "projection_y_coordinate"}
        assert again.y.attrs == {"units": "m", "long_name": "to the north"} | name


@pytest.mark.parametrize("crs", [UTM, "EPSG:4326"])
def test_gdal_places_what_is_written(tmp_path, crs):
    rasterio = pytest.importorskip("rasterio")
    with rasterio.Env() as env:
        if "netCDF" not in env.drivers():
            pytest.skip("this GDAL does not read NetCDF")
    affine = np.array([[-0.3, 0.0, 60.0], [0.0, 0.2, 4.0], [0.0, 0.0, 1.0]])
    write(tmp_path / "a.nc", Grid(samples(shape=(4, 6)), affine=affine, crs=crs))
    with rasterio.open(f"netcdf:{tmp_path}/a.nc:data") as source:
        placed = tuple(source.transform)[:6]
    np.testing.assert_allclose(placed, (0.2, 0.0, 3.9, 0.0, -0.3, 60.15), atol=1e-9)


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_attributes_of_the_whole_data_set_are_kept(tmp_path, suffix):
    data = field().to_dataset()
    data.attrs = {"title": "a map", "institution": "the sea", "Conventions": "CF-1.4", "levels": 3}
    grid = read(stored(tmp_path, data))
    assert grid.metadata["title"] == "a map"
    assert grid.metadata["global:levels"] == "3"
    write(tmp_path / f"again{suffix}", grid)
    opened = (
        xr.open_dataset(tmp_path / "again.nc", engine="h5netcdf")
        if suffix == ".nc"
        else xr.open_zarr(tmp_path / "again.zarr", chunks=None)
    )
    with opened as again:
        kept = {"title": "a map", "institution": "the sea", "levels": "3"}
        assert again.attrs == {**kept, "Conventions": "CF-1.8"}
    assert read(tmp_path / f"again{suffix}").metadata == grid.metadata


def test_what_is_left_out_of_a_data_set_is_named(tmp_path):
    data = xr.Dataset({"t": field(("time", "lat", "lon"), (2, 4, 6)), "u": field()})
    data = data.assign_coords(
        time=[3.0, 9.0],
        area=(("lat", "lon"), samples(shape=(4, 6))),
        lat_bnds=(("lat", "two"), np.zeros((4, 2))),
    )
    data["crs"] = ((), 0, {"crs_wkt": "EPSG:4326"})
    data["t"].attrs["grid_mapping"] = "crs"
    path = stored(tmp_path, data)
    grid = read(path, "t,time=1")
    assert grid.metadata["at_time"] == "9"
    said = ("variables that are left out:", "u", "area", "lat_bnds")
    assert sorted(grid.notes[0].replace(",", "").split(" ")) == sorted(" ".join(said).split(" "))
    write(tmp_path / "again.nc", grid)
    assert read(tmp_path / "again.nc").notes == ()
    many = xr.Dataset({f"v{k:02d}": field() for k in range(20)})
    assert read(stored(tmp_path, many), "v00").notes[0].endswith("v11, v12 and 7 more")


def test_xarray_reads_what_is_written(tmp_path):
    grid = read(stored(tmp_path, field(units="K")))
    write(tmp_path / "a.nc", grid)
    write(tmp_path / "a.zarr", grid)
    for data in (
        xr.open_dataset(tmp_path / "a.nc", engine="h5netcdf"),
        xr.open_zarr(tmp_path / "a.zarr", chunks=None),
    ):
        with data:
            np.testing.assert_array_equal(data.t, field())
            np.testing.assert_allclose(data.lat, LAT)
    assert zarr.open_group(tmp_path / "a.zarr", mode="r").metadata.zarr_format == 3


def test_what_is_no_netcdf(tmp_path):
    (tmp_path / "a.nc").write_bytes(b"not a data set")
    with pytest.raises(InputError, match="is not a NetCDF file"):
        read(tmp_path / "a.nc")
    xr.Dataset({"t": (("y", "x"), np.full((3, 3), "a"))}).to_netcdf(
        tmp_path / "b.nc", engine="h5netcdf"
    )
    with pytest.raises(InputError, match="holds 0 fields"):
        read(tmp_path / "b.nc")
    with pytest.raises(InputError, match=r"real numbers are needed|pickled Python objects"):
        read(tmp_path / "b.nc", "t")


# ---- Zarr --------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [2, 3])
def test_a_plain_array(tmp_path, version):
    names = {} if version == 2 else {"dimension_names": ("time", "lat", None)}
    array = zarr.create_array(
        tmp_path / "a.zarr",
        shape=(4, 5, 6),
        chunks=(2, 2, 3),
        dtype=">i2",
        zarr_format=version,
        attributes={"units": "m"},
        **names,
    )
    array[:] = samples("i2")
    grid = read(tmp_path / "a.zarr")
    np.testing.assert_array_equal(grid.values, samples("i2"))
    assert grid.axes == (("z", "y", "x") if version == 2 else ("time", "lat", "axis2"))
    assert grid.units == "m"
    axis = grid.axes[0]
    np.testing.assert_array_equal(read(tmp_path / "a.zarr", f"{axis}=2").values, samples("i2")[2])
    with pytest.raises(InputError, match="no 'data' to choose"):
        read(tmp_path / "a.zarr", "data")


def test_an_array_of_four_axes_without_names_has_the_spatial_ones_last(tmp_path):
    array = zarr.create_array(tmp_path / "a.zarr", shape=(2, 4, 5, 6), dtype="f4")
    array[:] = samples(shape=(2, 4, 5, 6))
    grid = read(tmp_path / "a.zarr", "axis0=1")
    assert grid.axes == ("z", "y", "x")
    np.testing.assert_array_equal(grid.values, array[1])
    assert read_outline(tmp_path / "a.zarr", None)[0].axes == ("axis0", "z", "y", "x")


@pytest.mark.parametrize("version", [2, 3])
def test_arrays_of_groups_whose_axes_have_no_names(tmp_path, version):
    path = tmp_path / "a.zarr"
    group = zarr.open_group(path, mode="w", zarr_format=version)
    group.create_array("dem", data=samples(shape=(4, 5)))
    np.testing.assert_array_equal(read(path).values, samples(shape=(4, 5)))
    group.create_group("0").create_array("scan", data=samples(shape=(3, 4, 5)))
    with pytest.raises(InputError, match=r"holds 2 fields, choose one with a key: .*0/scan"):
        read(path)
    with pytest.raises(InputError, match=r"holds no array 'a'; it has .*0/scan"):
        read(path, "a")
    np.testing.assert_array_equal(read(path, "dem").values, samples(shape=(4, 5)))
    np.testing.assert_array_equal(read(path, "0/scan").values, samples(shape=(3, 4, 5)))
    np.testing.assert_array_equal(read(path, "0/scan,z=1").values, samples(shape=(3, 4, 5))[1])
    outline, array = read_outline(path, "0/scan")
    assert outline.axes == ("z", "y", "x")
    np.testing.assert_array_equal(array[1:2], samples(shape=(3, 4, 5))[1:2])


def test_groups_in_groups_keep_their_coordinates(tmp_path):
    path, data = tmp_path / "a.zarr", field(units="K")
    (data + 1).to_dataset(name="t").to_zarr(path, consolidated=False)
    data.to_dataset(name="t").to_zarr(path, group="coarse/2", consolidated=False)
    grid = read(path, "coarse/2/t")
    np.testing.assert_array_equal(grid.values, data)
    np.testing.assert_array_equal(grid.affine, read(path).affine)
    np.testing.assert_array_equal(read(path, "coarse/2/t,lat=1:4").values, data[1:4])
    assert not np.array_equal(read(path).values, data)


@pytest.mark.parametrize("consolidated", [True, False])
def test_a_group_of_version_2(tmp_path, consolidated):
    data = field(units="K")
    data.to_dataset().to_zarr(tmp_path / "a.zarr", zarr_format=2, consolidated=consolidated)
    grid = read(tmp_path / "a.zarr")
    np.testing.assert_array_equal(grid.values, data)
    assert grid.axes == ("lat", "lon")
    assert grid.units == "K"
    outline, array = read_outline(tmp_path / "a.zarr", None)
    assert outline.shape == (4, 6)
    np.testing.assert_array_equal(array[1:3, 2:4], data[1:3, 2:4])


class Trap:
    """Makes a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


PICKLE = {"id": "pickle", "protocol": 5}
PICKLED = {
    "filter": ([PICKLE], None),
    "second filter": ([{"id": "shuffle", "elementsize": 8}, PICKLE], None),
    "compressor": (None, PICKLE),
}


@pytest.mark.parametrize("in_group", [False, True])
@pytest.mark.parametrize("place", PICKLED)
def test_a_pickle_is_never_loaded(tmp_path, place, in_group):
    folder = tmp_path / "a.zarr" / ("t" if in_group else "")
    folder.mkdir(parents=True)
    if in_group:
        (tmp_path / "a.zarr" / ".zgroup").write_text('{"zarr_format": 2}')
        (folder / ".zattrs").write_text('{"_ARRAY_DIMENSIONS": ["y", "x"]}')
    header = {
        "zarr_format": 2,
        "shape": [3, 3],
        "chunks": [3, 3],
        "dtype": "<f8",
        "fill_value": 0.0,
        "order": "C",
        "filters": PICKLED[place][0],
        "compressor": PICKLED[place][1],
    }
    (folder / ".zarray").write_text(json.dumps(header))
    (folder / "0.0").write_bytes(pickle.dumps(Trap(tmp_path / "sprung")))
    with pytest.raises(InputError, match=r"a\.zarr: "):
        read(tmp_path / "a.zarr")
    assert not (tmp_path / "sprung").exists()


def test_a_group_without_numbers(tmp_path):
    zarr.create_group(tmp_path / "a.zarr")
    with pytest.raises(InputError, match="holds 0 fields"):
        read(tmp_path / "a.zarr")
    (tmp_path / "b.zarr").mkdir()
    with pytest.raises(InputError, match="cannot be read as Zarr"):
        read(tmp_path / "b.zarr")


def test_complex_numbers_and_unknown_codecs(tmp_path):
    zarr.save_array(tmp_path / "a.zarr", np.ones((3, 3)) + 1j)
    with pytest.raises(InputError, match="holds complex numbers"):
        read(tmp_path / "a.zarr")
    zarr.create_array(tmp_path / "b.zarr", shape=(3, 3), dtype="f4")
    header = json.loads((tmp_path / "b.zarr" / "zarr.json").read_text())
    header["codecs"].append({"name": "numcodecs.unheard_of"})
    (tmp_path / "b.zarr" / "zarr.json").write_text(json.dumps(header))
    with pytest.raises(InputError, match="unheard_of"):
        read(tmp_path / "b.zarr")


def test_codecs_that_the_library_has_must_be_known_here_too(tmp_path):
    settings = {"shape": (3, 3), "dtype": "f4", "zarr_format": 2}
    array = zarr.create_array(tmp_path / "a.zarr", compressors=numcodecs.Zlib(), **settings)
    array[:] = 1
    assert read(tmp_path / "a.zarr").values.sum() == 9
    header = json.loads((tmp_path / "a.zarr" / ".zarray").read_text())
    header["compressor"] = {"id": "base64"}
    (tmp_path / "a.zarr" / ".zarray").write_text(json.dumps(header))
    with pytest.raises(InputError, match="uses the codec 'base64', which is not trusted"):
        read(tmp_path / "a.zarr")
