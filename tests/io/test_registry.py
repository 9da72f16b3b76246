"""Every format: round trips, geometry, missing samples, and every bad file in one line."""

import io as streams
import json
import os
import pickle
import stat
import sys
import zipfile

import numpy as np
import pytest
import rasterio
from file_helpers import inside  # noqa: F401
from PIL import Image
from rasterio.transform import Affine

from contourfair_jax import export
from contourfair_jax.contours import ContourLine
from contourfair_jax.export import write_geojson, write_svg
from contourfair_jax.io import (
    FORMATS,
    Grid,
    InputError,
    MissingPackageError,
    check_writable,
    example,
    read,
    read_bands,
    write,
    write_bands,
)

pytestmark = pytest.mark.usefixtures("inside")

UTM = "EPSG:32633"
# North-up: y falls with the row.
NORTH_UP = np.array([[-30.0, 0.0, 5_000_000.0], [0.0, 20.0, 400_000.0], [0.0, 0.0, 1.0]])


def terrain(dtype="float32", shape=(7, 9)) -> np.ndarray:
    return np.arange(np.prod(shape)).reshape(shape).astype(dtype)


def with_gap(dtype="float32", **settings) -> Grid:
    values = terrain(dtype)
    values[2, 3:5] = np.nan
    return Grid(values, missing=np.isnan(values), **settings)


def same(left: Grid, right: Grid) -> None:
    """Everything that a file with geometry must keep."""
    np.testing.assert_array_equal(left.values, right.values)
    assert left.values.dtype == right.values.dtype
    np.testing.assert_allclose(left.spacing, right.spacing, rtol=1e-12)
    np.testing.assert_allclose(left.origin, right.origin, rtol=1e-12)
    assert (left.affine is None) == (right.affine is None)
    if left.affine is not None:
        np.testing.assert_allclose(left.affine, right.affine, rtol=1e-12)
    assert (left.missing is None) == (right.missing is None)
    if left.missing is not None:
        np.testing.assert_array_equal(left.missing, right.missing)
    assert left.axes == right.axes
    assert left.units == right.units


# ---- Grid ----------------------------------------------------------------------------------


def test_grid_defaults_follow_the_number_of_axes():
    assert Grid(terrain()).axes == ("y", "x")
    volume = Grid(terrain(shape=(3, 4, 5)))
    assert (volume.axes, volume.spacing, volume.origin) == (("z", "y", "x"), (1.0,) * 3, (0.0,) * 3)
    assert Grid(np.zeros((2,) * 4)).axes == ("axis0", "axis1", "axis2", "axis3")


def test_field_coordinates_are_world_coordinates_where_no_axis_descends():
    affine = np.array([[2.0, 0.0, 10.0], [0.0, 3.0, 20.0], [0.0, 0.0, 1.0]])
    grid = Grid(terrain(), affine=affine)
    assert grid.spacing == (2.0, 3.0)
    assert grid.origin == (10.0, 20.0)
    np.testing.assert_allclose(grid.world(np.array([14.0, 23.0])), [14.0, 23.0])
    assert grid.rows_ascend


def test_world_of_a_north_up_grid_descends():
    grid = Grid(terrain(), affine=NORTH_UP)
    assert grid.spacing == (30.0, 20.0)
    assert grid.origin == (0.0, 0.0)
    assert not grid.rows_ascend
    corner = (np.array(grid.shape) - 1) * grid.spacing
    np.testing.assert_allclose(grid.world(corner), [5_000_000.0 - 6 * 30, 400_000.0 + 8 * 20])


def test_world_uses_a_metric_spacing_and_the_files_coordinates():
    grid = Grid(terrain(), affine=NORTH_UP, spacing=(1.5, 2.5))
    np.testing.assert_allclose(grid.world(np.array([3.0, 5.0])), [4_999_940.0, 400_040.0])


def test_refined_keeps_every_sample_where_it_is():
    turned = np.array([[-30.0, 4.0, 5e6], [3.0, 20.0, 4e5], [0.0, 0.0, 1.0]])
    for affine in (None, NORTH_UP, turned):
        grid = Grid(terrain(), affine=affine, spacing=(30.0, 20.0))
        finer = grid.refined(np.zeros((25, 33)), 4)
        index = np.argwhere(np.ones(grid.shape))
        old = grid.world(index * np.asarray(grid.spacing) + grid.origin)
        new = finer.world(4 * index * np.asarray(finer.spacing) + finer.origin)
        np.testing.assert_allclose(new, old, rtol=1e-15)


def test_crop_keeps_every_sample_where_it_is():
    grid = with_gap(affine=NORTH_UP)
    part = grid.crop([(2, 6), (3, 9)])
    assert part.shape == (4, 6)
    np.testing.assert_array_equal(part.missing, grid.missing[2:6, 3:9])
    at = np.array([1.0, 2.0])
    old = grid.world((at + np.array([2, 3])) * grid.spacing)
    np.testing.assert_allclose(part.world(at * part.spacing + part.origin), old)
    assert grid.crop([(3, 7), (0, 9)]).missing is None
    with pytest.raises(InputError, match="4:9 is not within 0:7"):
        grid.crop([(4, 9), (0, 9)])


def test_missing_samples_are_counted_and_located():
    grid = with_gap()
    assert grid.missing_count == 2
    assert grid.missing_box() == ((2, 2), (3, 4))
    assert Grid(terrain()).missing_box() is None


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"spacing": (1.0,)}, "spacing has 1 entries, the grid has 2 axes"),
        ({"spacing": (1.0, 0.0)}, "spacing must be positive"),
        ({"spacing": (1.0, float("nan"))}, "spacing must be positive"),
        ({"axes": ("a", "b", "c")}, "axes has 3 entries"),
        ({"affine": np.eye(4)}, "affine must be 3 x 3"),
        ({"missing": np.zeros((2, 2), bool)}, "missing has shape"),
    ],
)
def test_grid_refuses_geometry_that_does_not_fit(settings, said):
    with pytest.raises(InputError, match=said):
        Grid(terrain(), **{"spacing": (1.0, 1.0), **settings})


def test_refined_refuses_the_wrong_shape():
    with pytest.raises(InputError, match=r"must be \(13, 17\)"):
        Grid(terrain()).refined(np.zeros((14, 18)), 2)


# ---- round trips ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "dtype", ["uint8", "int16", "uint16", "int32", "int64", "float32", "float64"]
)
@pytest.mark.parametrize("suffix", [".npy", ".npz", ".tif"])
def test_samples_come_back_exactly(tmp_path, suffix, dtype):
    path = tmp_path / f"grid{suffix}"
    write(path, Grid(terrain(dtype)))
    back = read(path)
    np.testing.assert_array_equal(back.values, terrain(dtype))
    if (suffix, dtype) != (".tif", "int64"):
        assert back.values.dtype == dtype
    assert back.missing is None


@pytest.mark.parametrize("suffix", [".npz", ".tif"])
@pytest.mark.parametrize("affine", [NORTH_UP, NORTH_UP * [[-1], [1], [1]]], ids=["north", "south"])
def test_geometry_units_and_crs_come_back(tmp_path, suffix, affine):
    path = tmp_path / f"grid{suffix}"
    grid = Grid(terrain(), affine=affine, crs=UTM, units="m", metadata={"title": "a hill"})
    assert write(path, grid) == ()
    back = read(path)
    same(back, grid)
    assert "32633" in back.crs
    assert back.metadata["title"] == "a hill"


@pytest.mark.parametrize("suffix", [".npz", ".tif"])
@pytest.mark.parametrize("nodata", [None, -9999.0, float("nan"), -3.4e38])
def test_missing_samples_come_back(tmp_path, suffix, nodata):
    path = tmp_path / f"grid{suffix}"
    grid = with_gap(affine=NORTH_UP, nodata=nodata)
    write(path, grid)
    back = read(path)
    same(back, grid)
    if nodata is not None:
        np.testing.assert_allclose(back.nodata, nodata)


def test_npy_keeps_missing_samples_as_nan(tmp_path):
    path = tmp_path / "grid.npy"
    assert write(path, with_gap(nodata=-9999.0)) == ()
    np.testing.assert_array_equal(np.isnan(np.load(path)), with_gap().missing)
    same(read(path), with_gap())


@pytest.mark.parametrize("suffix", [".npz", ".tif"])
def test_a_nodata_value_that_a_sample_has_is_not_used(tmp_path, suffix):
    path = tmp_path / f"grid{suffix}"
    notes = write(path, with_gap(nodata=0.0))  # sample (0, 0) is 0
    back = read(path)
    assert back.missing_count == 2
    assert back.values[0, 0] == 0
    assert bool(notes) == (suffix == ".tif")


def test_npz_keeps_volumes_origin_and_turned_axes(tmp_path):
    turned = np.eye(4)
    turned[:3, :3] = [[0.0, -2.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 3.0]]
    for settings in ({"affine": turned}, {"spacing": (1.0, 2.0, 3.0), "origin": (4.0, 5.0, 6.0)}):
        grid = Grid(terrain(shape=(3, 4, 5)), **settings)
        write(tmp_path / "grid.npz", grid)
        same(read(tmp_path / "grid.npz"), grid)


def test_a_stack_of_tiff_pages_is_a_volume(tmp_path):
    grid = Grid(terrain("uint16", (3, 4, 5)))
    write(tmp_path / "stack.tif", grid)
    back = read(tmp_path / "stack.tif")
    np.testing.assert_array_equal(back.values, grid.values)
    assert back.axes == ("z", "y", "x")
    assert back.notes == ("3 pages are read as a volume",)
    said = "a TIFF of several pages keeps no coordinates: they are left out (.nc and .npz keep "
    placed = Grid(grid.values, affine=np.eye(4))
    assert write(tmp_path / "stack.tif", placed) == (f"{said}them)",)


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_png_is_as_deep_as_its_source(tmp_path, dtype):
    values = terrain(dtype) * (1 if dtype == "uint8" else 500)
    Image.fromarray(values).save(tmp_path / "in.png")
    grid = read(tmp_path / "in.png")
    assert grid.values.max() == values.max()
    finer = Grid(values.astype(float) + 0.3, source_dtype=np.dtype(dtype))
    assert write(tmp_path / "out.png", finer) == (
        f"values are rounded to {8 * np.dtype(dtype).itemsize}-bit grey",
    )
    np.testing.assert_array_equal(read(tmp_path / "out.png").values, values)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_black_and_white_stay_that(tmp_path, suffix):
    mask = np.add.outer(np.arange(24), np.arange(30)) > 25
    Image.fromarray(mask).save(tmp_path / f"mask{suffix}")
    grid = read(tmp_path / f"mask{suffix}")
    np.testing.assert_array_equal(grid.values, 255 * mask)
    write(tmp_path / "again.png", grid)
    np.testing.assert_array_equal(Image.open(tmp_path / "again.png"), np.uint8(255) * mask)


def test_png_clips_overshoot_and_says_so(tmp_path):
    values = terrain().astype(float)
    values[0, 0], values[0, 1] = -3.0, 300.0
    notes = write(tmp_path / "out.png", Grid(values, source_dtype=np.dtype("uint8")))
    assert notes == ("2 values outside 0..255 are clipped",)
    assert read(tmp_path / "out.png").values[0, :2].tolist() == [0, 255]


def test_png_shows_missing_samples_as_transparent(tmp_path):
    values = with_gap().values
    write(
        tmp_path / "out.png", Grid(values, missing=np.isnan(values), source_dtype=np.dtype("uint8"))
    )
    back = read(tmp_path / "out.png")
    np.testing.assert_array_equal(back.missing, np.isnan(values))
    np.testing.assert_array_equal(back.values, values)


def test_png_refuses_what_it_would_lose(tmp_path):
    with pytest.raises(InputError, match="a PNG holds whole grey values"):
        write(tmp_path / "out.png", Grid(terrain() + 0.5))
    with pytest.raises(InputError, match="a PNG holds 2-D data"):
        write(tmp_path / "out.png", Grid(terrain("uint8", (3, 3, 3))))
    gap = with_gap()
    wide = Grid(gap.values, missing=gap.missing, source_dtype=np.dtype("uint16"))
    with pytest.raises(InputError, match="16-bit PNG cannot mark missing"):
        write(tmp_path / "out.png", wide)
    assert os.listdir(tmp_path) == []


def test_colour_becomes_luminance_and_grey_colour_stays_exact(tmp_path):
    rgb = np.zeros((4, 5, 3), np.uint8)
    rgb[..., 0] = 200
    Image.fromarray(rgb).save(tmp_path / "red.png")
    red = read(tmp_path / "red.png")
    assert red.values.tolist() == [[60] * 5] * 4
    assert red.notes == ("a colour image: its luminance is used (ITU-R 601)",)
    Image.fromarray(np.repeat(terrain("uint8")[..., None], 3, -1)).save(tmp_path / "grey.png")
    grey = read(tmp_path / "grey.png")
    np.testing.assert_array_equal(grey.values, terrain("uint8"))
    assert grey.notes == ()


def coloured(channels: int = 3) -> np.ndarray:
    """A picture whose channels differ."""
    return np.stack([np.roll(terrain("uint8"), k, k % 2) for k in range(channels)], axis=-1)


def test_channels_of_a_colour_image(tmp_path):
    rgba = coloured(4)
    rgba[..., 3] = np.maximum(rgba[..., 3], 1)
    Image.fromarray(rgba[..., :3]).save(tmp_path / "rgb.png")
    Image.fromarray(rgba).save(tmp_path / "rgba.png")
    for name in ("rgb", "rgba"):
        bands = read_bands(tmp_path / f"{name}.png")
        assert bands[0].bands == ("red", "green", "blue", "alpha")[: len(name)]
        assert not any(band.notes for band in bands)
        for k, (band, key) in enumerate(zip(bands, bands[0].bands, strict=True)):
            np.testing.assert_array_equal(band.values, rgba[..., k])
            np.testing.assert_array_equal(read(tmp_path / f"{name}.png", key).values, rgba[..., k])
        assert write_bands(tmp_path / "out.png", bands) == ()
        with Image.open(tmp_path / "out.png") as image:
            np.testing.assert_array_equal(np.asarray(image), rgba[..., : len(name)])
    with pytest.raises(InputError, match="no 'alpha' to choose: it has the channels red, green, b"):
        read(tmp_path / "rgb.png", "alpha")
    assert len(read_bands(tmp_path / "rgb.png")) == 3


def test_missing_pixels_of_a_colour_image_are_transparent(tmp_path):
    rgba = np.dstack([coloured(), np.full((7, 9), 255, np.uint8)])
    rgba[1, 2, 3] = 0
    Image.fromarray(rgba).save(tmp_path / "in.png")
    bands = read_bands(tmp_path / "in.png")
    assert [band.missing_count for band in bands] == [1, 1, 1]
    write_bands(tmp_path / "out.png", bands)
    with Image.open(tmp_path / "out.png") as image:
        out = np.asarray(image)
    np.testing.assert_array_equal(out[..., 3], rgba[..., 3])
    np.testing.assert_array_equal(out[rgba[..., 3] > 0], rgba[rgba[..., 3] > 0])


def test_what_cannot_be_bands_of_one_file_is_refused(tmp_path):
    small, large = Grid(terrain("uint8")), Grid(terrain("uint8", (6, 7)))
    faults = [
        ("a.tif", (small, large), "bands must have one shape"),
        ("a.npy", (small, small), r"not written with several bands; known suffixes: \.png, \.tif"),
        ("a.png", (small, small), "a PNG holds 3 or 4 channels of 8 bits, the source has 2"),
        ("a.png", (Grid(terrain()),) * 3, "float32, float32, float32"),
        ("a.tif", (), "there are no bands to write"),
    ]
    for name, grids, message in faults:
        with pytest.raises(InputError, match=message):
            write_bands(tmp_path / name, grids)
    assert os.listdir(tmp_path) == []


def test_image_modes(tmp_path):
    bits = np.eye(6, dtype=bool)
    Image.fromarray(bits).save(tmp_path / "bits.png")
    np.testing.assert_array_equal(read(tmp_path / "bits.png").values != 0, bits)
    Image.fromarray(terrain("float32")).save(tmp_path / "float.tif")
    np.testing.assert_array_equal(read(tmp_path / "float.tif").values, terrain())
    palette = Image.fromarray(terrain("uint8")).convert("P")
    palette.save(tmp_path / "palette.png")
    np.testing.assert_array_equal(read(tmp_path / "palette.png").values, terrain("uint8"))


@pytest.mark.parametrize(
    "array",
    [
        terrain(">i2"),
        np.asfortranarray(terrain(">f8")),
        terrain("float16"),
        terrain()[:, ::2],
        terrain().astype(bool),
        terrain("longdouble"),
    ],
    ids=["big-endian", "fortran", "half", "strided", "bool", "longdouble"],
)
def test_any_layout_becomes_native_and_contiguous(tmp_path, array):
    np.save(tmp_path / "in.npy", array)
    grid = read(tmp_path / "in.npy")
    np.testing.assert_array_equal(grid.values, array.astype(grid.values.dtype))
    assert grid.values.dtype.isnative
    assert grid.values.dtype.name in ("uint8", "int16", "float32", "float64")
    assert grid.values.flags.c_contiguous


def test_infinite_samples_are_missing(tmp_path):
    values = terrain()
    values[1, 1], values[2, 2] = np.inf, -np.inf
    np.save(tmp_path / "in.npy", values)
    grid = read(tmp_path / "in.npy")
    assert grid.missing_count == 2
    assert np.isnan(grid.values[1, 1])
    assert grid.notes == ("2 infinite samples are taken as missing",)


# ---- GeoTIFF -------------------------------------------------------------------------------


def raster(path, values, **profile):
    count, (height, width) = (
        (1, values.shape) if values.ndim == 2 else (len(values), values.shape[1:])
    )
    settings = {"crs": UTM, "transform": Affine(20.0, 0.0, 4e5, 0.0, -30.0, 5e6), **profile}
    bands = values.reshape(count, height, width)
    with rasterio.open(
        path, "w", "GTiff", width, height, count, dtype=values.dtype, **settings
    ) as target:
        target.write(bands)


def test_refined_geotiff_overlays_the_original_at_pixel_centres(tmp_path):
    raster(tmp_path / "in.tif", terrain())
    grid = read(tmp_path / "in.tif")
    write(tmp_path / "out.tif", grid.refined(np.zeros((25, 33), np.float32), 4))
    with rasterio.open(tmp_path / "in.tif") as old, rasterio.open(tmp_path / "out.tif") as new:
        assert new.shape == (25, 33)
        assert new.transform.a == old.transform.a / 4
        assert new.transform.e == old.transform.e / 4
        for row, column in np.ndindex(old.shape):
            # rasterio's xy() gives the centre of a pixel
            assert new.xy(4 * row, 4 * column) == pytest.approx(old.xy(row, column), abs=1e-9)
        assert new.bounds.left == pytest.approx(old.bounds.left + 20 / 2 - 20 / 8)
        assert new.crs == old.crs


def test_bands_of_a_geotiff(tmp_path):
    """Values, names, units, colours and gaps of every band; place and texts once."""
    ground = terrain("int16")
    gaps = with_gap(nodata=-1.0)
    placed = {"affine": NORTH_UP, "crs": UTM}
    told = {"description": "ground", "source": "a plane"}
    bands = [
        Grid(ground, **placed, nodata=-9999, metadata=told),
        Grid(gaps.values, **placed, nodata=-1.0, missing=gaps.missing, units="K"),
        Grid(ground[::-1] - 9999, **placed, metadata={"colour": "red"}),
    ]
    notes = write_bands(tmp_path / "bands.tif", bands)
    assert "the nodata value is now nan" in notes[0]  # -9999 is a sample of the third band
    found = read_bands(tmp_path / "bands.tif")
    assert [each.bands for each in found] == [("1", "2", "3")] * 3
    for each, band in zip(found, bands, strict=True):
        np.testing.assert_array_equal(each.values, band.values)
        np.testing.assert_allclose(each.affine, NORTH_UP)
        assert (each.units, each.missing_count) == (band.units, band.missing_count)
        assert each.metadata["source"] == "a plane"
    assert found[0].metadata["description"] == "ground"
    assert found[2].metadata["colour"] == "red"
    assert read(tmp_path / "bands.tif", "ground").values.tolist() == ground.tolist()
    assert read(tmp_path / "bands.tif", "red").values.tolist() == bands[2].values.tolist()
    whole = [Grid(ground, nodata=-9999), Grid(ground + 1, nodata=-9999)]
    assert write_bands(tmp_path / "whole.tif", whole) == ()
    assert [each.nodata for each in read_bands(tmp_path / "whole.tif")] == [-9999, -9999]
    single = read_bands(tmp_path / "whole.tif")[:1]
    write_bands(tmp_path / "single.tif", single)
    assert len(read_bands(tmp_path / "single.tif")) == 1


def test_a_geotiff_read_and_written_is_placed_the_same(tmp_path):
    transform = Affine(20.0, 5.0, 4e5, 2.0, -30.0, 5e6)
    raster(tmp_path / "in.tif", terrain(), transform=transform)
    grid = read(tmp_path / "in.tif")
    assert grid.notes == ("the axes are not perpendicular; fairing treats them as if they were",)
    write(tmp_path / "out.tif", grid)
    with rasterio.open(tmp_path / "out.tif") as new:
        np.testing.assert_allclose(new.transform, transform, rtol=1e-14)


def test_area_or_point_keeps_positions(tmp_path):
    raster(tmp_path / "in.tif", terrain())
    with rasterio.open(tmp_path / "in.tif", "r+") as target:
        target.update_tags(AREA_OR_POINT="Point")
    grid = read(tmp_path / "in.tif")
    write(tmp_path / "out.tif", grid)
    back = read(tmp_path / "out.tif")
    np.testing.assert_allclose(back.affine, grid.affine)
    assert back.metadata["AREA_OR_POINT"] == "Point"


def test_bands_are_chosen_by_number_or_name(tmp_path):
    bands = np.stack([terrain(), terrain() + 100])
    raster(tmp_path / "in.tif", bands)
    with rasterio.open(tmp_path / "in.tif", "r+") as target:
        target.set_band_description(2, "height")
    first = read(tmp_path / "in.tif")
    said = "band 1 of 2 is read, the others are left out; choose with a key of 1, 2 height"
    assert first.notes == (said,)
    assert read(tmp_path / "in.tif", key=2).values[0, 0] == 100
    assert read(tmp_path / "in.tif", key="height").values[0, 0] == 100
    for key in (0, 3, "depth", "-1"):
        with pytest.raises(InputError, match=f"has no band '{key}'; it has 1, 2 height"):
            read(tmp_path / "in.tif", key=key)


def test_of_many_bands_the_first_are_named(tmp_path):
    raster(tmp_path / "in.tif", np.zeros((20, 3, 4), "uint8"))
    named = "1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, ... 20"
    assert read(tmp_path / "in.tif").notes[0].endswith(f"choose with a key of {named}")


def test_packed_values_are_decoded(tmp_path):
    values = terrain("int16")
    values[1, 1] = -1
    raster(tmp_path / "in.tif", values, nodata=-1)
    with rasterio.open(tmp_path / "in.tif", "r+") as target:
        target.scales, target.offsets = (0.5,), (10.0,)
    grid = read(tmp_path / "in.tif")
    assert grid.values[0, 3] == 11.5
    assert grid.missing_box() == ((1, 1), (1, 1))
    assert grid.notes == ("packed values are decoded: 0.5 * stored + 10",)
    write(tmp_path / "out.tif", grid)
    np.testing.assert_array_equal(read(tmp_path / "out.tif").values, grid.values)


def test_tiff_without_georeference_has_none_afterwards(tmp_path):
    Image.fromarray(terrain()).save(tmp_path / "in.tif")
    grid = read(tmp_path / "in.tif")
    assert grid.affine is None
    assert grid.crs is None
    for dtype in ("float32", "float64"):  # Pillow reads the first, rasterio the second
        write(tmp_path / "out.tif", Grid(grid.values.astype(dtype)))
        back = read(tmp_path / "out.tif")
        assert back.affine is None
        assert back.values.dtype == dtype


def test_a_file_named_tif_is_never_opened_as_another_format(tmp_path):
    raster(tmp_path / "in.tif", terrain())
    (tmp_path / "vrt.tif").write_text(
        '<VRTDataset rasterXSize="9" rasterYSize="7"><VRTRasterBand dataType="Float32" band="1">'
        "<SimpleSource><SourceFilename>in.tif</SourceFilename></SimpleSource></VRTRasterBand>"
        "</VRTDataset>"
    )
    with pytest.raises(InputError, match="cannot be read as TIFF or GeoTIFF"):
        read(tmp_path / "vrt.tif")


def test_without_rasterio_plain_images_work_and_geotiff_names_the_extra(tmp_path, monkeypatch):
    raster(tmp_path / "in.tif", terrain())
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(MissingPackageError, match=r"pip install 'contourfair-jax\[geotiff\]'"):
        read(tmp_path / "in.tif")
    with pytest.raises(MissingPackageError, match="writing GeoTIFF needs rasterio"):
        write(tmp_path / "out.tif", Grid(terrain(), affine=NORTH_UP))
    write(tmp_path / "plain.tif", Grid(terrain()))
    np.testing.assert_array_equal(read(tmp_path / "plain.tif").values, terrain())


# ---- .npz keys -----------------------------------------------------------------------------


def test_npz_chooses_data_then_the_only_grid(tmp_path):
    np.savez(tmp_path / "a.npz", data=terrain(), other=terrain() + 1)
    assert read(tmp_path / "a.npz").values[0, 0] == 0
    assert read(tmp_path / "a.npz", key="other").values[0, 0] == 1
    np.savez(tmp_path / "b.npz", elevation=terrain(), dx=2.0, lon=np.arange(9))
    assert read(tmp_path / "b.npz").values[0, 0] == 0
    np.savez(tmp_path / "c.npz", p=terrain(), q=terrain())
    with pytest.raises(InputError, match=r"choose one with a key: p \(7, 9\), q \(7, 9\)"):
        read(tmp_path / "c.npz")
    with pytest.raises(InputError, match="holds no array 'r'"):
        read(tmp_path / "c.npz", key="r")


def test_npz_with_pickled_objects_beside_the_samples_is_read_without_them(tmp_path):
    np.savez(tmp_path / "a.npz", data=terrain(), extra=np.array([{}], dtype=object))
    assert read(tmp_path / "a.npz").shape == (7, 9)
    with pytest.raises(InputError, match="pickled Python objects, which are never loaded"):
        read(tmp_path / "a.npz", key="extra")


@pytest.mark.parametrize(
    ("beside", "said"),
    [
        ({"y": np.arange(7) ** 2, "x": np.arange(9)}, "coordinate 'y' is not evenly spaced"),
        ({"y": np.zeros(7), "x": np.arange(9)}, "coordinate 'y' must be finite and change"),
        ({"spacing": [1.0, -1.0]}, "spacing must be positive"),
        ({"spacing": [1.0]}, "spacing has 1 entries"),
        ({"valid": np.ones((2, 2), bool)}, "has a 'valid' of bool"),
        ({"affine": np.eye(2)}, "affine must be 3 x 3"),
        ({"metadata": "not json"}, "cannot be read as NumPy archive"),
    ],
)
def test_npz_with_geometry_that_does_not_fit(tmp_path, beside, said):
    np.savez(tmp_path / "in.npz", data=terrain(), dims=["y", "x"], **beside)
    with pytest.raises(InputError, match=said):
        read(tmp_path / "in.npz")


def test_npz_coordinates_in_float32_are_even_enough(tmp_path):
    x = np.linspace(313.02, 390.02, 9, dtype=np.float32)
    np.savez(tmp_path / "in.npz", data=terrain(), dims=["time", "x"], x=x)
    grid = read(tmp_path / "in.npz")
    assert grid.spacing == pytest.approx((1.0, 77 / 8))


# ---- bad files -----------------------------------------------------------------------------


def npy_bytes(array) -> bytes:
    stream = streams.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def huge_header() -> bytes:
    stream = streams.BytesIO()
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + bytes(64)


BAD = {
    "empty.npy": (b"", "is not a .npy array"),
    "text.npy": (b"1 2 3\n4 5 6\n", "is not a .npy array"),
    "pickle.npy": (pickle.dumps([1, 2]), "is not a .npy array"),
    "object.npy": (npy_bytes(np.array([[1, None]])), "pickled Python objects, which are never"),
    "truncated.npy": (npy_bytes(terrain())[:-9], "is truncated: its header promises 252 bytes"),
    "header.npy": (npy_bytes(terrain())[:40], "has a damaged header"),
    "huge.npy": (huge_header(), "its header promises 7.3 TiB of samples, 64 bytes are there"),
    "version.npy": (b"\x93NUMPY\x09\x00" + bytes(80), "is a .npy file of version"),
    "complex.npy": (npy_bytes(terrain("complex64")), "complex numbers; save the magnitude"),
    "string.npy": (npy_bytes(np.array([["a", "b"]])), "real numbers are needed"),
    "void.npy": (npy_bytes(np.zeros((2, 2), "i4,i4")), "real numbers are needed"),
    "zero.npy": (npy_bytes(np.zeros((0, 4))), r"an empty array, shape \(0, 4\)"),
    "scalar.npy": (npy_bytes(np.float64(3)), "holds a single number, not a grid"),
    "text.npz": (b"not a zip", "cannot be read as NumPy archive"),
    "npy.npz": (npy_bytes(terrain()), "cannot be read as NumPy archive"),
    "text.png": (b"not an image", "is not a PNG or TIFF image"),
    "text.tif": (b"not an image", "cannot be read as TIFF or GeoTIFF"),
    "empty.tif": (b"", "cannot be read as TIFF or GeoTIFF"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_end_in_one_line(tmp_path, name):
    content, said = BAD[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=said) as caught:
        read(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / name))


@pytest.mark.parametrize("name", ["geo.tif", "plain.tif", "plain.png"])
def test_pictures_that_are_cut_short_are_said_to_be(tmp_path, rng, name):
    path = tmp_path / name
    values = rng.integers(0, 255, (60, 70), np.uint8)
    if name == "geo.tif":  # as other programs write it: what it holds first, then the samples
        size = {"height": 60, "width": 70, "count": 1, "dtype": "uint8"}
        place = Affine(20.0, 0.0, 4e5, 0.0, -30.0, 5e6)
        with rasterio.open(path, "w", "GTiff", **size, crs=UTM, transform=place) as target:
            target.write(values, 1)
    else:
        Image.fromarray(values).save(path)
    assert read(path).shape == (60, 70)
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(InputError, match=r"is damaged or cut short \(\S.*\)$") as caught:
        read(path)
    assert "previous" not in str(caught.value)


def read_or_message(path) -> Grid | str:
    try:
        return read(path)
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".png", ".tif"])
def test_files_cut_anywhere_end_in_one_line(tmp_path, suffix):
    path = tmp_path / f"whole{suffix}"
    settings = {"affine": NORTH_UP, "crs": UTM} if suffix != ".png" else {}
    write(path, Grid(terrain("uint8", (20, 30)), **settings))
    whole = path.read_bytes()
    cut = tmp_path / f"cut{suffix}"
    refused = 0
    for length in range(0, len(whole), max(1, len(whole) // 40)):
        cut.write_bytes(whole[:length])
        back = read_or_message(cut)
        if isinstance(back, str):
            assert "\n" not in back
            refused += 1
        else:
            # Only padding was cut: nothing of the samples may have changed.
            np.testing.assert_array_equal(back.values, terrain("uint8", (20, 30)))
    assert refused >= 30


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".png", ".tif"])
def test_files_with_flipped_bytes_never_raise_anything_else(tmp_path, suffix, rng):
    path = tmp_path / f"whole{suffix}"
    write(path, Grid(terrain("uint8", (20, 30))))
    whole = np.frombuffer(path.read_bytes(), np.uint8)
    for _ in range(60):
        damaged = whole.copy()
        where = rng.integers(0, len(whole), 4)
        damaged[where] = rng.integers(0, 256, 4)
        path.write_bytes(damaged.tobytes())
        back = read_or_message(path)
        if isinstance(back, str):
            assert "\n" not in back
        else:
            assert back.values.dtype.kind in "iuf"


def test_a_zip_that_unpacks_to_more_than_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("contourfair_jax._support.memory.physical_memory", lambda: 1000)
    np.savez_compressed(tmp_path / "bomb.npz", data=np.zeros((100, 100)))
    with pytest.raises(InputError, match=r"needs 78\.1 KiB, this machine has 1000 bytes"):
        read(tmp_path / "bomb.npz")
    write(tmp_path / "image.png", Grid(np.zeros((100, 100), np.uint8)))
    with pytest.raises(InputError, match=r"needs 78\.1 KiB"):
        read(tmp_path / "image.png")


def test_a_zip_member_that_lies_about_its_size_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "lie.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data.npy", huge_header())
    with pytest.raises(InputError, match=r"is truncated: its header promises 7\.3 TiB"):
        read(tmp_path / "lie.npz")


def test_names_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        read(tmp_path / "nothing.npy")
    (tmp_path / "folder.npy").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        read(tmp_path / "folder.npy")
    for name in ("grid.xyz", "grid", ".npy"):
        with pytest.raises(InputError, match=r"known suffixes: \.npy, \.npz"):
            read(tmp_path / name)
    np.save(tmp_path / "grid.npy", terrain())
    with pytest.raises(InputError, match="no 'data' to choose"):
        read(tmp_path / "grid.npy", key="data")
    os.mkfifo(tmp_path / "pipe.npy")
    with pytest.raises(InputError, match="is not a regular file"):
        read(tmp_path / "pipe.npy")


def test_suffixes_are_unique_and_case_does_not_matter(tmp_path):
    suffixes = [suffix for each in FORMATS for suffix in each.suffixes]
    assert len(suffixes) == len(set(suffixes))
    np.save(tmp_path / "grid.npy", terrain())
    os.rename(tmp_path / "grid.npy", tmp_path / "GRID.NPY")
    assert read(tmp_path / "GRID.NPY").shape == (7, 9)


# ---- writing -------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".png", ".tif"])
def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"grid{suffix}"
    path.write_bytes(b"earlier")

    def no_space(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(InputError, match=r"cannot be written \(No space left on device\)"):
        write(path, Grid(terrain("uint8")))
    assert path.read_bytes() == b"earlier"
    assert os.listdir(tmp_path) == [path.name]


def test_an_unknown_fault_while_writing_leaves_nothing_half_written(tmp_path, monkeypatch):
    def broken(stream, *_, **__):
        stream.write(b"half")
        raise RuntimeError("broken")

    monkeypatch.setattr(np.lib.format, "write_array", broken)
    with pytest.raises(RuntimeError, match="broken"):
        write(tmp_path / "grid.npy", Grid(terrain()))
    assert os.listdir(tmp_path) == []


def test_names_that_cannot_be_written(tmp_path):
    grid = Grid(terrain())
    (tmp_path / "folder.npy").mkdir()
    (tmp_path / "file").write_text("")
    faults = {
        "folder.npy": "is a folder; name a file in it",
        "missing/grid.npy": "there is no folder",
        "file/grid.npy": "there is no folder",
        "grid.docx": "files of this name are not written",
    }
    for name, said in faults.items():
        with pytest.raises(InputError, match=said):
            write(tmp_path / name, grid)
        with pytest.raises(InputError, match=said):
            check_writable(tmp_path / name)
    os.mkfifo(tmp_path / "pipe.npy")
    with pytest.raises(InputError, match="is not a regular file"):
        write(tmp_path / "pipe.npy", grid)


def test_a_format_that_cannot_hold_the_grid_is_refused_beforehand(tmp_path):
    check_writable(tmp_path / "a.png", Grid(terrain("uint8")))
    with pytest.raises(InputError, match=r"a\.png: a PNG holds whole grey values"):
        check_writable(tmp_path / "a.png", Grid(terrain() + 0.5))
    with pytest.raises(InputError, match="a PNG holds 2-D data"):
        check_writable(tmp_path / "a.png", Grid(terrain("uint8", (3, 3, 3))))
    assert os.listdir(tmp_path) == []


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs a folder nobody may write to")
def test_an_unwritable_folder():
    for use in (check_writable, lambda path: write(path, Grid(terrain()))):
        with pytest.raises(InputError, match="/proc/self may not be written to; choose another"):
            use("/proc/self/grid.npy")


def test_a_replaced_file_keeps_its_permissions_and_links(tmp_path):
    target, link = tmp_path / "grid.npy", tmp_path / "link.npy"
    target.write_bytes(b"earlier")
    target.chmod(0o640)
    link.symlink_to(target)
    write(link, Grid(terrain()))
    assert link.is_symlink()
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    np.testing.assert_array_equal(np.load(target), terrain())


def test_missing_integers_need_a_nodata_value(tmp_path):
    missing = np.zeros((7, 9), bool)
    missing[0, 0] = True
    with pytest.raises(InputError, match="need a nodata value"):
        write(tmp_path / "grid.npz", Grid(terrain("int16"), missing=missing))
    write(tmp_path / "grid.npz", Grid(terrain("int16"), missing=missing, nodata=-1))
    assert np.load(tmp_path / "grid.npz")["data"][0, 0] == -1


def test_what_a_format_cannot_keep_is_said(tmp_path):
    grid = Grid(terrain("uint8"), affine=NORTH_UP)
    assert "spacing and coordinates are left out" in write(tmp_path / "a.npy", grid)[0]
    assert "keeps no coordinates" in write(tmp_path / "a.png", grid)[0]
    assert write(tmp_path / "a.tif", grid) == ()
    metric = Grid(terrain("uint8"), affine=NORTH_UP, spacing=(1.0, 2.0))
    assert "not the metric spacing" in write(tmp_path / "a.tif", metric)[0]
    with pytest.raises(InputError, match="a GeoTIFF holds 2-D data"):
        write(tmp_path / "a.tif", Grid(np.zeros((2, 2, 2, 2))))
    with pytest.raises(InputError, match="reference system not understood"):
        write(tmp_path / "a.tif", Grid(terrain(), affine=NORTH_UP, crs="EPSG:nonsense"))


# ---- lines ---------------------------------------------------------------------------------

LOOP = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 0.0]])


def test_geojson_is_in_world_coordinates_x_first(tmp_path):
    grid = Grid(terrain(), affine=NORTH_UP, crs=UTM)
    lines = [ContourLine(5.0, LOOP, True), ContourLine(7.5, LOOP[:3], False)]
    notes = write_geojson(tmp_path / "lines.geojson", lines, grid)
    stored = json.loads((tmp_path / "lines.geojson").read_text())
    first, second = stored["features"]
    assert first["geometry"]["coordinates"][1] == [400_000.0, 4_999_970.0]
    assert first["geometry"]["coordinates"][0] == first["geometry"]["coordinates"][-1]
    assert second["properties"] == {"level": 7.5, "closed": False}
    assert stored["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::32633"
    assert "crs member" in notes[0]


@pytest.mark.parametrize(
    ("crs", "member", "told"),
    [
        (None, None, True),
        ("EPSG:4326", None, False),
        (rasterio.crs.CRS.from_epsg(4326).to_wkt(), None, False),
        (rasterio.crs.CRS.from_epsg(4326).to_wkt(version="WKT2_2019"), None, False),
        (rasterio.crs.CRS.from_epsg(32725).to_wkt(), "urn:ogc:def:crs:EPSG::32725", True),
        (
            rasterio.crs.CRS.from_epsg(32725).to_wkt(version="WKT2_2019"),
            "urn:ogc:def:crs:EPSG::32725",
            True,
        ),
        ('LOCAL_CS["site"]', 'LOCAL_CS["site"]', True),
        (" epsg:4326\n", None, False),
        ("urn:ogc:def:crs:EPSG::4326", None, False),
        ("urn:ogc:def:crs:EPSG:9.8:4326", None, False),
        ("http://www.opengis.net/def/crs/EPSG/0/4326", None, False),
        ("OGC:CRS84", None, False),
        ("urn:ogc:def:crs:OGC:1.3:CRS84", None, False),
        (rasterio.crs.CRS.from_user_input("OGC:CRS84").to_wkt(version="WKT2_2019"), None, False),
        ("urn:ogc:def:crs:EPSG::32725", "urn:ogc:def:crs:EPSG::32725", True),
        ("epsg:14326", "urn:ogc:def:crs:EPSG::14326", True),
        ("ESRI:4326", "ESRI:4326", True),
    ],
)
@pytest.mark.parametrize("store", [write_geojson, export.write_filled], ids=["lines", "bands"])
def test_geojson_names_the_crs(tmp_path, crs, member, told, store):
    grid = Grid(terrain(), affine=NORTH_UP, crs=crs)
    notes = store(tmp_path / "lines.geojson", [], grid)
    stored = json.loads((tmp_path / "lines.geojson").read_text())
    assert stored["features"] == []
    assert stored.get("crs", {}).get("properties", {}).get("name") == member
    assert bool(notes) == told


def test_svg_has_one_group_per_level_and_north_up(tmp_path):
    grid = Grid(terrain(), affine=NORTH_UP * [[-1], [1], [1]])  # row 0 is south
    lines = [
        ContourLine(1.0, LOOP + grid.origin, True),
        ContourLine(1.0, LOOP[:2] + grid.origin, False),
        ContourLine(2.0, LOOP[:2] + grid.origin, False),
    ]
    write_svg(tmp_path / "lines.svg", lines, grid, ["#111111", "#222222"])
    text = (tmp_path / "lines.svg").read_text()
    assert text.count("<g ") == 2
    assert text.count("<path") == 3
    assert 'd="M0.00,1000.00L0.00,833.33L111.11,833.33Z"' in text
    with pytest.raises(InputError, match="2 levels need as many colours"):
        write_svg(tmp_path / "lines.svg", lines, grid, ["#111111"])


# ---- bundled and real data -----------------------------------------------------------------


def test_the_bundled_terrain():
    grid = example("jacksboro")
    assert grid.shape == (344, 403)
    assert grid.values.dtype == np.int16
    assert (grid.values.min(), grid.values.max()) == (236, 1076)
    assert grid.spacing == pytest.approx((92.48, 74.56))
    assert grid.world(np.zeros(2)) == pytest.approx([36.7325, -84.41333333])
    assert not grid.rows_ascend
    assert grid.units == "m"
    with pytest.raises(InputError, match="example must be one of jacksboro"):
        example("everest")


REAL = {
    # file: shape, source dtype, smallest, largest, missing, nodata
    "jacksboro_fault_dem.npz": ((344, 403), "int16", 236, 1076, 0, None),
    "jacksboro_fault_dem_mpl.npz": ((344, 403), "int16", 236, 1076, 0, None),
    "jacksboro_bigendian_fortran.npy": ((344, 403), ">i2", 236, 1076, 0, None),
    "jacksboro_1x403.npy": ((1, 403), "int16", 305, 910, 0, None),
    "elev_luxembourg.tif": ((90, 95), "int16", 141, 547, 3942, -32768),
    "elev_luxembourg.npz": ((90, 95), "int16", 141, 547, 3942, -32768),
    "olinda_dem_utm25s.tif": ((111, 111), "float32", -1, 88, 0, None),
    "float_raster_with_nodata.tif": ((12, 13), "float32", 0, 0.25, 58, np.float32(-3.4e38)),
    "all-nodata.tif": ((2475, 71), "uint16", np.nan, np.nan, 175725, 0),
    "camera.png": ((512, 512), "uint8", 0, 255, 0, None),
    "cell.png": ((660, 550), "uint8", 0, 255, 0, None),
    "sainte_helens.npz": ((468, 327), "int16", 682, 2543, 4151, -32767),
    "oisst_sst.npz": ((90, 180), "float32", -1.8, 32.97, 4448, None),
    "motorcycle_disp_skimage.npz": ((500, 741), "float32", 7.19136, 59.909, 27226, None),
    "nucleon.npz": ((41, 41, 41), "uint8", 0, 249, 0, None),
    "motor_zmap.npz": ((53, 63, 46), "float32", -7.94144, 7.94135, 0, None),
}


@pytest.mark.data
@pytest.mark.filterwarnings("ignore:All-NaN slice:RuntimeWarning")
@pytest.mark.parametrize("name", REAL)
def test_real_files(shared_data, tmp_path, name):
    shape, dtype, smallest, largest, missing, nodata = REAL[name]
    grid = read(shared_data / name)
    assert grid.shape == shape
    assert grid.source_dtype == np.dtype(dtype)
    assert np.nanmin(grid.values) == pytest.approx(smallest, rel=1e-5, nan_ok=True)
    assert np.nanmax(grid.values) == pytest.approx(largest, rel=1e-5, nan_ok=True)
    assert grid.missing_count == missing
    assert grid.nodata == nodata
    for suffix in (".npz", ".tif") if grid.ndim == 2 else (".npz",):
        write(tmp_path / f"copy{suffix}", grid)
        back = read(tmp_path / f"copy{suffix}")
        np.testing.assert_array_equal(back.values, grid.values)
        assert back.missing_count == missing
        assert back.nodata == nodata or missing == 0 or nodata is None
        if grid.affine is not None:
            np.testing.assert_allclose(back.affine, grid.affine, rtol=1e-12, atol=1e-12)


@pytest.mark.data
def test_the_same_terrain_from_every_layout(shared_data):
    expected = example("jacksboro").values
    for name in ("jacksboro_fault_dem.npz", "jacksboro_bigendian_fortran.npy"):
        np.testing.assert_array_equal(read(shared_data / name).values, expected)


@pytest.mark.data
def test_crs_of_real_rasters(shared_data):
    assert "WGS 84" in read(shared_data / "elev_luxembourg.tif").crs
    olinda = read(shared_data / "olinda_dem_utm25s.tif")
    assert "UTM Zone 25" in olinda.crs
    assert olinda.spacing == pytest.approx((89.99406735, 89.99406735))


@pytest.mark.data
def test_uneven_coordinates_are_refused_by_name(shared_data):
    for name, axis in (("topobathy.npz", "y"), ("hybrid_height_theta.npz", "z")):
        with pytest.raises(InputError, match=f"coordinate '{axis}' is not evenly spaced"):
            read(shared_data / name)
