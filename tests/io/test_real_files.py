"""Real files of every format come out right, are stored again, and are faired in place."""

import numpy as np
import pytest
from file_helpers import inside, read_inside, same_places  # noqa: F401

import contourfair_jax as cf
from contourfair_jax.io import InputError, read, write

pytestmark = pytest.mark.data

# file, key: shape, source type, smallest, largest, missing, nodata, spacing, formats to store in
REAL = {
    ("SainteHelens.dem", None): ((468, 327), "int16", 682, 2543, 4151, -32767, (30, 30), ".nc"),
    ("eraint_uvz.nc", "z,month=0,level=1"): (
        *((241, 480), "float64", 49169.8, 57693.2, 0, None, (0.75, 0.75)),
        ".nc .zarr",
    ),
    ("rotated_pole.nc", None): (
        *((22, 36), "float32", 98439, 102954, 0, None, (2.2, 2.2)),
        ".nc .zarr .vti",
    ),
    ("A1B_north_america.nc", "time=0"): (
        *((37, 49), "float32", 258.03, 302.27, 0, None, (1.25, 1.875)),
        ".nc",
    ),
    ("A1B_north_america.nc", "time=0:240"): (
        *((240, 37, 49), "float32", 257.32, 306.07, 0, None, (8640, 1.25, 1.875)),
        "",
    ),
    ("hybrid_height.nc", "model_level_number=3"): (
        *((100, 100), "float32", 287.6, 288.5, 0, None, (0.0009, 0.0009)),
        ".nc",
    ),
    ("oisst_reduced.nc", "sst"): (
        *((90, 180), "float32", -1.8, 32.97, 4448, None, (2, 2)),
        ".nc .zarr .tif .npz",
    ),
    ("orca2_votemper.nc", None): (
        *((148, 180), "float32", -2.06583, 29.8332, 10209, np.float32(9.96921e36), (1, 1)),
        ".nc",
    ),
    ("basin_mask.nc", "Z=0"): ((180, 360), "int8", 1, 56, 23344, -100, (1, 1), ".nc"),
    ("nouragues.nc", "t2m,time=3,expver=0"): (
        *((3, 3), "float64", 296.9, 297.1, 0, None, (0.1, 0.1005)),
        ".nc .zarr",
    ),
    ("headsq_quarter.nrrd", None): (
        *((93, 64, 64), "int16", 0, 3926, 0, None, (1.5, 3.2, 3.2)),
        ".nrrd .nii.gz .vti",
    ),
    ("BallBinary30x30x30_gz.nrrd", None): (
        *((30, 30, 30), "int16", 0, 257, 0, None, (1, 1, 1)),
        ".nrrd .mha .nii .vtk",
    ),
    ("MR_seg3d.nii.gz", None): (
        *((160, 232, 160), "float32", 0, 512, 0, None, (0.898437, 0.898437, 1)),
        "",
    ),
    ("image_10426.nii.gz", None): (
        *((46, 63, 53), "float32", -7.94144, 7.94135, 0, None, (3, 3, 3)),
        ".nii.gz .nrrd .mha .vti .nc",
    ),
    ("avg152T1_RL_nifti.nii.gz", None): (
        *((91, 109, 91), "uint8", 0, 255, 0, None, (2, 2, 2)),
        ".nii.gz",
    ),
    ("anatomical.nii", None): (
        *((25, 41, 33), ">i2", -610, 30393, 0, None, (2, 2, 2)),
        ".nii .nrrd .mha .vti .vtk .nc .zarr",
    ),
    ("functional.nii", "7"): (
        *((3, 21, 17), "float32", 763.07, 5525.02, 0, None, (8, 4, 4)),
        ".nii",
    ),
    ("resampled_anat_moved.nii", None): (
        *((3, 21, 17), ">f4", 409.3, 13361, 153, None, (8, 4, 4)),
        ".nii .nrrd .mha .vti .vtk .nc .zarr",
    ),
    ("HeadMRVolume.mhd", None): ((42, 62, 48), "uint8", 0, 255, 0, None, (4, 4, 4), ".mha"),
    ("CT_small.dcm", None): (
        *((128, 128), "int16", -896, 1167, 0, None, (0.661468, 0.661468)),
        ".nii .mha",
    ),
    ("hydrogen.vti", None): ((64, 64, 64), "float32", 0, 1, 0, None, (1, 1, 1), ".vti .vtk"),
    ("channels.vti", None): ((100, 250, 250), "int64", 0, 4, 0, None, (1, 1, 1), ""),
    ("benzene-homo.cube", None): (
        *((40, 55, 55), "float64", -0.21246, 0.212535, 0, None, (0.333333,) * 3),
        ".nrrd .npz",
    ),
    ("3pqr-mode0.ccp4", None): (
        *((59, 69, 100), "int8", -128, 127, 0, None, (0.91552, 0.95853, 0.95853)),
        ".nrrd .npz",
    ),
    ("annual_precip.npz", None): ((168, 360), "float32", 0, 20195, 0, None, (1, 1), ".npz .nc"),
    ("coins.png", None): ((303, 384), "uint8", 1, 252, 0, None, (1, 1), ".png .tif"),
    ("microaneurysms.png", None): ((102, 102), "uint8", 38, 129, 0, None, (1, 1), ".png .npy"),
    ("mri_s1045.npz", None): ((256, 256), "uint16", 0, 215, 0, None, (1, 1), ".npz .png .tif"),
    ("neghip.npz", None): ((66, 66, 66), "uint8", 0, 255, 0, None, (1, 1, 1), ".npz"),
    ("olinda.npz", None): ((111, 111), "float32", -1, 88, 0, None, (89.994, 89.994), ".tif .npz"),
    ("topobathy_mpl.npz", "topo"): ((91, 120), "float32", -1437, 2205, 0, None, (1, 1), ".npz"),
    ("volcano.npz", None): ((61, 87), "int16", 94, 195, 0, None, (10, 10), ".npz .tif .nc"),
    ("ironProt.vtk", None): ((68, 68, 68), "uint8", 0, 255, 0, None, (1, 1, 1), ".vtk"),
    ("carotid.vtk", None): ((45, 49, 76), "float32", 0, 580, 0, None, (1, 1, 1), ".vtk .vti"),
    ("carotid.vtk", "vectors,component=2"): (
        *((45, 49, 76), "float32", -17.4655, 9.75926, 0, None, (1, 1, 1)),
        "",
    ),
}


@pytest.mark.parametrize(("name", "key"), REAL)
def test_real_files_come_out_right_and_are_stored_again(
    shared_data, tmp_path, monkeypatch, name, key
):
    shape, dtype, smallest, largest, missing, nodata, spacing, suffixes = REAL[name, key]
    grid = read(shared_data / name, key)
    assert grid.shape == shape
    assert grid.source_dtype == np.dtype(dtype)
    assert np.nanmin(grid.values) == pytest.approx(smallest, rel=3e-3)
    assert np.nanmax(grid.values) == pytest.approx(largest, rel=3e-3)
    assert grid.missing_count == missing
    assert grid.nodata == nodata
    assert grid.spacing == pytest.approx(spacing, rel=1e-3)
    monkeypatch.setattr("contourfair_jax.io._table.read_isolated", read_inside)
    for suffix in suffixes.split():
        write(tmp_path / f"again{suffix}", grid)
        again = read(tmp_path / f"again{suffix}")
        same_places(again, grid)
        assert again.missing_count == missing


# The same data in the ready-made arrays beside them, which other programs wrote.
TWINS = {
    ("benzene-homo.cube", None): ("benzene_homo.npz", np.s_[:], 1e-8),
    ("3pqr-mode0.ccp4", None): ("ccp4_3pqr.npz", np.s_[:], 0),
    ("SainteHelens.dem", None): ("sainte_helens.npz", np.s_[:], 0),
    ("eraint_uvz.nc", "z,month=0,level=1"): ("eraint_z500_jan.npz", np.s_[:], 1),
    ("rotated_pole.nc", None): ("mslp_rotated_pole.npz", np.s_[:], 0),
    ("A1B_north_america.nc", "time=48"): ("a1b_temperature.npz", np.s_[2], 0),
    ("oisst_reduced.nc", "sst"): ("oisst_sst.npz", np.s_[:], 1e-5),
    ("orca2_votemper.nc", None): ("orca2_temp.npz", np.s_[:], 0),
    ("basin_mask.nc", "Z=0"): ("basin_mask.npz", np.s_[:], 0),
    ("nouragues.nc", "t2m,time=5,expver=0"): ("nouragues_3x3.npz", np.s_[5], 1e-4),
    ("CT_small.dcm", None): ("ct_small.npz", np.s_[:], 0),
    ("MR_seg3d.nii.gz", None): ("mr_seg3d.npz", np.s_[:], 1e-3),
    ("image_10426.nii.gz", None): ("motor_zmap.npz", np.s_[:], 0),
    ("hydrogen.vti", None): ("hydrogen_orbital.npz", np.s_[:], 0),
    ("carotid.vtk", None): ("carotid_speed.npz", np.s_[:], 0),
    ("channels.vti", None): ("channels_facies.npz", np.s_[:], 0),
}


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize(("name", "key"), TWINS)
def test_real_files_equal_their_twins(shared_data, name, key):
    twin, part, within = TWINS[name, key]
    values = read(shared_data / name, key).values
    with np.load(shared_data / twin) as archive:
        expected = archive["data"][part]
        if "valid" in archive:
            expected = np.where(archive["valid"], expected, np.nan)
    if values.ndim == 3:
        expected = expected.T  # the twins count x first
        values = values[::2, ::2, ::2] if name.startswith("MR_seg3d") else values
        values = values[tuple(slice(n) for n in expected.shape)]
    np.testing.assert_allclose(values, expected, rtol=0, atol=within)


REFUSED = {
    ("basin_mask.nc", None): "coordinate 'Z' is not evenly spaced",
    ("A1B_north_america.nc", None): "is a time series",
    ("eraint_uvz.nc", None): "holds 3 fields, choose one with a key",
    ("eraint_uvz.nc", "z"): "choose with a key such as z,month=0,level=0",
    ("nouragues.nc", "t2m"): "choose with a key such as t2m,time=0,expver=0",
    ("nouragues.nc", "t2m,expver=0,time=:"): "coordinate 'time' is not evenly spaced",
    ("functional.nii", None): "choose with a key such as t=0",
    ("carotid.vtk", "vectors"): "choose with a key such as component=0",
    ("volcano.json", None): "files of this name are not read; known suffixes",
    ("annual-precip.json", None): "files of this name are not read; known suffixes",
    ("nucleon_41x41x41_uint8.raw", None): "files of this name are not read; known suffixes",
    ("s1045.ima.gz", None): "is compressed as a whole; unpack it and read what is in it",
    ("neghip.slc", None): "files of this name are not read; known suffixes",
}


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize(("name", "key"), REFUSED)
def test_what_is_not_supported_is_said(shared_data, name, key):
    with pytest.raises(InputError, match=REFUSED[name, key]) as caught:
        read(shared_data / name, key)
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("inside")
def test_notes_about_what_is_not_seen_in_the_samples(shared_data):
    notes = {
        ("orca2_votemper.nc", None): "nav_lat, nav_lon are curvilinear",
        ("hybrid_height.nc", None): "level_height is not evenly spaced",
        ("oisst_reduced.nc", "sst"): "lon goes all around",
        ("channels.vti", None): "at the centres of the cells",
        ("MR_seg3d.nii.gz", None): "packed values are decoded: 2.00784 * stored",
    }
    for (name, key), said in notes.items():
        assert any(said in note for note in read(shared_data / name, key).notes)


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize(
    ("name", "key", "suffix"),
    [
        ("rotated_pole.nc", None, ".nc"),
        ("oisst_reduced.nc", "sst", ".zarr"),
        ("CT_small.dcm", None, ".mha"),
        ("resampled_anat_moved.nii", None, ".nii.gz"),
        ("float_raster_with_nodata.tif", None, ".tif"),
        ("headsq_quarter.nrrd", "z=40", ".nrrd"),
    ],
)
def test_faired_files_overlay_the_originals(shared_data, tmp_path, name, key, suffix):
    grid = read(shared_data / name, key)
    field = cf.fair_field(grid.values.astype(float), spacing=grid.spacing, origin=grid.origin)
    write(tmp_path / f"fine{suffix}", grid.refined(np.asarray(field.refine(4)), 4))
    fine = read(tmp_path / f"fine{suffix}")
    every = tuple(slice(None, None, 4) for _ in grid.shape)
    np.testing.assert_allclose(fine.values[every], grid.values, rtol=1e-6)
    index = np.argwhere(np.ones(grid.shape, bool))
    old = grid.world(index * np.asarray(grid.spacing) + grid.origin)
    new = fine.world(4 * index * np.asarray(fine.spacing) + fine.origin)
    np.testing.assert_allclose(new, old, atol=1e-5 * min(grid.spacing))
