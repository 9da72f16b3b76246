"""A factor for each axis: fields, layers, files, tiles, labelled arrays and the command line."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from shape_checks import refused

import contourfair_jax as cf
import contourfair_jax.xarray
from contourfair_jax import cli, tiles
from contourfair_jax.cli._per_axis import Factor
from contourfair_jax.io import Grid, InputError, read, write

SHAPE = (9, 11)
AFFINE = np.array([[-30.0, 0.0, 5e6], [0.0, 20.0, 4e5], [0.0, 0.0, 1.0]])


def hill(shape=SHAPE) -> np.ndarray:
    axes = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return np.exp(-2 * sum(x**2 for x in axes)) + 0.1 * axes[0]


def test_a_field_is_refined_along_every_axis_by_its_own_factor():
    field = cf.fair_field(jnp.asarray(hill()))
    even = np.asarray(field.refine(6))
    for factors in ((6, 1), [2, 3], np.array([1, 6])):
        steps = tuple(slice(None, None, 6 // int(factor)) for factor in factors)
        np.testing.assert_allclose(field.refine(factors), even[steps], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(field.refine((1, 1)), field.samples)
    volume = cf.fair_field(jnp.asarray(hill((3, 4, 5))))
    fine = np.asarray(volume.refine((1, 1, 4)))
    assert fine.shape == (3, 4, 17)
    np.testing.assert_array_equal(fine[:, :, ::4], volume.samples)
    np.testing.assert_allclose(fine, volume.refine(4)[::4, ::4], rtol=0, atol=1e-14)


@pytest.mark.parametrize("factor", [(2,), (2, 2, 2), "22", (2, 0), (2, 1.5), 0, True, None])
def test_other_factors_are_refused(factor):
    field = cf.fair_field(jnp.asarray(hill()))
    with refused(ValueError, match=r"^factor must be"):
        field.refine(factor)
    with refused(ValueError, match=r"^factor must be"):
        list(tiles.refine_tiles(hill(), factor))


def test_a_layer_takes_one_for_each_axis():
    layer = cf.FairUpsample([1, 3], spacing=(3.0, 1.0))
    images = jnp.asarray(hill())[None, None]
    field = cf.fair_field(images[0, 0], spacing=(3.0, 1.0))
    np.testing.assert_allclose(layer(images)[0, 0], field.refine((1, 3)), rtol=0, atol=1e-14)
    assert hash(layer.factor) == hash((1, 3))


@pytest.mark.parametrize("suffix", [pytest.param(".npy", marks=pytest.mark.slow), ".zarr"])
def test_tiles_are_those_of_the_whole(tmp_path, suffix):
    values = hill((150, 140))
    whole = np.asarray(cf.fair_field(jnp.asarray(values)).refine((1, 3)))
    outcome = tiles.refine_to(values, tmp_path / f"fine{suffix}", (1, 3))
    assert outcome.tiles == 4
    fine = read(tmp_path / f"fine{suffix}").values
    np.testing.assert_allclose(fine, whole, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(fine[:, ::3], values)


def test_labelled_arrays_take_factors_by_dimension(monkeypatch):
    y, x = np.linspace(8.0, 0.0, SHAPE[0]), np.arange(float(SHAPE[1]))
    array = xr.DataArray(hill(), coords={"y": y, "x": x}, name="t")
    fine = array.fair.upsample({"x": 4})
    assert fine.sizes == {"y": 9, "x": 41}
    np.testing.assert_array_equal(fine.y, y)
    np.testing.assert_array_equal(fine.x, np.linspace(0, 10, 41))
    np.testing.assert_allclose(fine, array.fair.upsample(4)[::4], rtol=0, atol=1e-14)
    lazy = array.chunk({"y": 5}).fair.upsample({"x": 4})
    assert lazy.chunksizes == {"y": (5, 4), "x": (41,)}
    np.testing.assert_allclose(lazy.compute(), fine, rtol=0, atol=1e-14)
    with pytest.raises(ValueError, match=r"^factor must be along \['y', 'x'\], got \['z'\]"):
        array.fair.upsample({"z": 2})


@pytest.mark.parametrize("wanted", ["1,3", "x=3", "y=1, x=3"])
def test_the_command_line_keeps_places(tmp_path, wanted):
    write(tmp_path / "in.tif", Grid(hill(), affine=AFFINE, crs="EPSG:32633", axes=("y", "x")))
    target = tmp_path / "out.tif"
    assert cli.main(["upsample", str(tmp_path / "in.tif"), "-o", str(target), "-f", wanted]) == 0
    grid = read(target)
    field = cf.fair_field(hill(), spacing=(30.0, 20.0))
    np.testing.assert_allclose(grid.values, field.refine((1, 3)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(grid.affine, AFFINE / [[1, 3, 1], [1, 3, 1], [1, 1, 1]])


def test_the_command_line_in_tiles(tmp_path, capsys):
    np.save(tmp_path / "in.npy", hill())
    command = ["upsample", str(tmp_path / "in.npy"), "-o", str(tmp_path / "out.zarr"), "--json"]
    assert cli.main([*command, "-f", "2,1"]) == 0
    assert json.loads(capsys.readouterr().out)["shape"] == [17, 11]
    field = cf.fair_field(hill())
    np.testing.assert_allclose(
        read(tmp_path / "out.zarr").values, field.refine((2, 1)), rtol=0, atol=1e-13
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "--factor must be a whole number such as 4, one for each axis such as 1,1,4"),
        ("-2", "--factor must be a whole number"),
        ("2,", "--factor must be a whole number"),
        ("x=2,3", "--factor must be a whole number"),
        ("2,0", "--factor must be 1 or more, got 2,0"),
        ("2,3,4", "--factor must be one number or 2, for the axes y, x, got 2,3,4"),
        ("z=2", "--factor: there is no axis 'z'; there are y, x"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(text, message):
    with pytest.raises(InputError) as caught:
        Factor.parse(text).of(Grid(hill(), axes=("y", "x")))
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)
