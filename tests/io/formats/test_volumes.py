"""NIfTI, NRRD, MetaImage, DICOM and VTK: places against the libraries themselves, parts, series."""

import bz2
import gzip
import importlib.util
import math
import os
import tracemalloc

import nibabel
import nrrd
import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
from file_helpers import STEPS, UP, ccp4, cube, inside, oblique, same_places, samples, slices  # noqa: F401
from pydicom.data import get_testdata_file
from pydicom.uid import generate_uid
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOLegacy import vtkDataSetReader
from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLImageDataWriter

from contourfair_jax.io import Grid, InputError, read, write

pytestmark = pytest.mark.usefixtures("inside")

RAS, LPS = "right-anterior-superior", "left-posterior-superior"


def turned(space: str) -> Grid:
    return Grid(samples(), affine=oblique(), metadata={"space": space})


# ---- the place of a sample, as other programs see it ---------------------------------------------

AT = (3, 2, 1)  # sample z, y, x


def of_nibabel(path):
    return nibabel.load(path).affine[:3] @ [*AT[::-1], 1]


def of_itk(path):
    image = sitk.ReadImage(os.fspath(path))
    assert image.GetPixel(*AT[::-1]) == samples()[AT]
    return image.TransformIndexToPhysicalPoint(AT[::-1])


def of_nrrd(path):
    values, header = nrrd.read(os.fspath(path))
    assert values[AT[::-1]] == samples()[AT]
    return np.array(AT[::-1]) @ header["space directions"] + header["space origin"]


def of_vti(path):
    reader = vtkXMLImageDataReader()
    reader.SetFileName(os.fspath(path))
    reader.Update()
    image = reader.GetOutput()
    at = image.ComputePointId(AT[::-1])
    assert image.GetPointData().GetScalars().GetTuple1(at) == samples()[AT]
    return image.GetPoint(at)


@pytest.mark.parametrize(
    ("suffix", "place", "world"),
    [
        (".nii", of_nibabel, RAS),
        (".nii", of_itk, LPS),
        (".nii.gz", of_nibabel, RAS),
        (".mha", of_itk, LPS),
        (".nrrd", of_nrrd, None),
        (".nrrd", of_itk, LPS),
        (".vti", of_vti, None),
    ],
)
@pytest.mark.parametrize("space", [RAS, LPS])
def test_other_programs_see_samples_at_the_same_place(tmp_path, suffix, place, world, space):
    grid = turned(space)
    write(tmp_path / f"grid{suffix}", grid)
    expected = grid.world(np.array(AT) * grid.spacing)[::-1]
    if world is not None and world != space:
        expected = expected * [-1, -1, 1]
    np.testing.assert_allclose(place(tmp_path / f"grid{suffix}"), expected, rtol=1e-6)


def test_a_chain_of_formats_moves_nothing(tmp_path):
    grid = turned(RAS)
    for suffix in (".nii", ".nrrd", ".mha", ".vti", ".nii.gz"):
        write(tmp_path / f"grid{suffix}", grid)
        grid = read(tmp_path / f"grid{suffix}")
        if suffix in (".nii", ".nii.gz"):
            assert grid.metadata["space"] == RAS
            same_places(grid, turned(RAS), rtol=1e-5)
    assert read(tmp_path / "grid.mha").metadata["space"] == LPS


# ---- parts -------------------------------------------------------------------------------------


def film(path, dtype=np.int16):
    """Three volumes in time, (x, y, z, t)."""
    values = samples(dtype, (3, 4, 5, 6)).T
    image = nibabel.Nifti1Image(values, np.diag([0.5, 1.5, 2.0, 1.0]))
    image.header.set_xyzt_units("mm", "sec")
    nibabel.save(image, path)
    return path


def test_one_volume_of_a_time_series(tmp_path):
    path = film(tmp_path / "film.nii")
    with pytest.raises(InputError, match=r"axes t 3, z 4, y 5, x 6: .* such as t=0"):
        read(path)
    for key in ("2", "t=2", "-1"):
        np.testing.assert_array_equal(
            read(path, key).values, samples("i2", (3, 4, 5, 6))[2], strict=True
        )
    with pytest.raises(InputError, match=r"t=3 is outside 0\.\.2"):
        read(path, "3")
    with pytest.raises(InputError, match="has no 'heart' to choose"):
        read(path, "heart")


def test_planes_and_boxes_of_a_volume_stay_where_they_are(tmp_path):
    path = film(tmp_path / "film.nii")
    whole = read(path, "0")
    box = read(path, "t=0,z=1:3,x=2:")
    np.testing.assert_array_equal(box.values, whole.values[1:3, :, 2:])
    np.testing.assert_allclose(box.world(np.array(box.origin)), [2.0, 0.0, 1.0])
    plane = read(path, "t=0,y=3")
    assert plane.axes == ("z", "x")
    assert plane.spacing == (2.0, 0.5)
    np.testing.assert_array_equal(plane.values, whole.values[:, 3])
    write(tmp_path / "plane.nii", plane)
    assert nibabel.load(tmp_path / "plane.nii").shape == (6, 1, 4)
    with pytest.raises(InputError, match="leaves 1 axis; 2 or 3 are needed"):
        read(path, "t=0,y=3,z=1")


def test_a_plane_of_an_oblique_volume_is_measured_within(tmp_path):
    write(tmp_path / "grid.nii", turned(RAS))
    plane = read(tmp_path / "grid.nii", "z=2")
    assert plane.spacing == pytest.approx((1.5, 0.5), rel=1e-6)
    assert "the plane is oblique: its coordinates are distances within it" in plane.notes


@pytest.mark.parametrize("affine", [STEPS, oblique()], ids=["straight", "oblique"])
@pytest.mark.parametrize("gone", ["z", "y", "x"])
@pytest.mark.parametrize("suffix", [".nii", ".nrrd", ".mha", ".vti", ".vtk", ".nc", ".npz"])
def test_a_plane_of_a_volume_keeps_its_place(tmp_path, suffix, gone, affine):
    write(tmp_path / "grid.nii", Grid(samples(), affine=affine, metadata={"space": RAS}))
    plane = read(tmp_path / "grid.nii", f"{gone}=2").crop([(1, 3), (0, 3)])
    fine = plane.refined(np.kron(plane.values, np.ones((2, 2)))[:-1, :-1], 2)
    notes = write(tmp_path / f"fine{suffix}", fine)
    again = read(tmp_path / f"fine{suffix}")
    if suffix == ".vtk" and affine is not STEPS:
        assert "the place of the slice is left out" in notes[0]
        return
    write(tmp_path / "volume.nii", again)
    first = dict(zip(plane.axes, (1, 0), strict=True)) | {gone: 2}
    expected = nibabel.load(tmp_path / "grid.nii").affine @ [*(first[k] for k in "xyz"), 1]
    found = nibabel.load(tmp_path / "volume.nii")
    np.testing.assert_allclose(found.affine[:3, 3], expected[:3], rtol=1e-5)
    steps = nibabel.load(tmp_path / "grid.nii").header.get_zooms()
    halves = [step / (1 if axis == gone else 2) for axis, step in zip("xyz", steps, strict=True)]
    np.testing.assert_allclose(found.header.get_zooms(), halves, rtol=1e-5)


# ---- NIfTI -------------------------------------------------------------------------------------


def test_scaled_values_are_decoded(tmp_path):
    image = nibabel.Nifti1Image(samples("i2").T, np.eye(4))
    image.header.set_slope_inter(0.25, -7.0)
    image.to_filename(tmp_path / "scaled.nii")
    raw = bytearray((tmp_path / "scaled.nii").read_bytes())
    raw[112:120] = np.array([0.25, -7.0], "<f4").tobytes()  # scl_slope, scl_inter
    (tmp_path / "scaled.nii").write_bytes(raw)
    grid = read(tmp_path / "scaled.nii")
    assert grid.values.dtype == np.float32
    assert grid.notes == ("packed values are decoded: 0.25 * stored + -7",)
    assert np.ptp(grid.values) == 0.25 * np.ptp(np.frombuffer(raw[352:], "<i2").astype(float))


@pytest.mark.parametrize(("sform", "qform"), [(4, 0), (0, 1), (3, 3), (2, 1)])
def test_what_the_header_of_a_nifti_says_is_kept(tmp_path, sform, qform):
    image = nibabel.Nifti1Image(samples("f4").T, None)
    affine = np.diag([0.5, 1.5, 2.0, 1.0])
    image.set_sform(affine, sform)
    image.set_qform(affine, qform)
    image.header.set_intent("t test", (12,), name="task")
    image.header["cal_max"] = 99.5
    nibabel.save(image, tmp_path / "a.nii")
    grid = read(tmp_path / "a.nii")
    assert grid.notes == ()
    write(tmp_path / "a.nrrd", grid)
    assert write(tmp_path / "b.nii", read(tmp_path / "a.nrrd")) == ()
    header = nibabel.load(tmp_path / "b.nii").header
    assert (header["sform_code"], header["qform_code"]) == (sform, qform)
    assert header.get_intent() == ("t test", (12.0,), "task")
    assert (header["cal_min"], header["cal_max"]) == (0, 99.5)


def test_what_is_not_kept_of_a_nifti_is_said(tmp_path):
    image = nibabel.Nifti1Image(samples("f4").T, None)
    image.set_sform(np.diag([0.5, 1.5, 2.0, 1.0]), 4)
    image.set_qform(np.diag([0.5, 1.5, 2.5, 1.0]), 1)
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", b"a note"))
    nibabel.save(image, tmp_path / "a.nii")
    grid = read(tmp_path / "a.nii")
    assert grid.notes == (
        "the qform is left out: the sform is another map",
        "extensions of the header are left out: 1",
    )
    write(tmp_path / "b.nii", grid)
    header = nibabel.load(tmp_path / "b.nii").header
    assert (header["sform_code"], header["qform_code"]) == (4, 0)
    odd = {"sform_code": "x", "cal_max": "high", "intent_code": "1e99"}
    write(tmp_path / "c.nii", Grid(samples(), metadata=odd))
    header = nibabel.load(tmp_path / "c.nii").header
    assert (header["sform_code"], header["cal_max"], header["intent_code"]) == (2, 0, 0)


def test_a_nifti_without_place_has_only_steps(tmp_path):
    image = nibabel.Nifti1Image(samples("i2").T, None)
    image.header.set_zooms((0.5, 1.5, 2.0))
    nibabel.save(image, tmp_path / "grid.nii")
    grid = read(tmp_path / "grid.nii")
    assert grid.spacing == (2.0, 1.5, 0.5)
    assert "space" not in grid.metadata


def test_colour_and_complex_volumes_are_refused(tmp_path):
    rgb = np.zeros((3, 4, 5), [("R", "u1"), ("G", "u1"), ("B", "u1")])
    nibabel.save(nibabel.Nifti1Image(rgb, np.eye(4)), tmp_path / "rgb.nii")
    with pytest.raises(InputError, match="real numbers are needed"):
        read(tmp_path / "rgb.nii")
    nibabel.save(nibabel.Nifti1Image(samples() + 1j, np.eye(4)), tmp_path / "c.nii")
    with pytest.raises(InputError, match="holds complex numbers"):
        read(tmp_path / "c.nii")


def test_single_precision_positions_are_said_to_move_samples(tmp_path):
    far = np.diag([1.0, 1.0, 1.0, 1.0])
    far[0, 3] = 123_456_789.0
    assert "moves samples" in write(tmp_path / "far.nii", Grid(samples(), affine=far))[0]
    assert write(tmp_path / "near.nii", Grid(samples(), affine=STEPS)) == ()


# ---- NRRD --------------------------------------------------------------------------------------


def test_a_detached_header_reads_the_file_beside_it(tmp_path):
    header = {"spacings": [0.5, 1.5, 2.0], "encoding": "raw", "sample units": "HU"}
    nrrd.write(str(tmp_path / "grid.nhdr"), samples("i2").T, header)
    grid = read(tmp_path / "grid.nhdr")
    np.testing.assert_array_equal(grid.values, samples("i2"))
    assert grid.spacing == (2.0, 1.5, 0.5)
    assert grid.units == "HU"
    (tmp_path / "grid.raw").unlink()
    with pytest.raises(InputError, match=r"names the data file 'grid\.raw', which is not there"):
        read(tmp_path / "grid.nhdr")
    os.mkfifo(tmp_path / "grid.raw")
    with pytest.raises(InputError, match="which is not there"):
        read(tmp_path / "grid.nhdr")


def test_an_axis_of_vectors_is_chosen_from(tmp_path):
    header = {
        "kinds": ["vector", "domain", "domain", "domain"],
        "space": LPS,
        "space directions": [[np.nan] * 3, [0.5, 0, 0], [0, 1.5, 0], [0, 0, 2]],
        "space origin": [1.0, 2.0, 3.0],
        "labels": ["velocity", "", "", ""],
    }
    nrrd.write(str(tmp_path / "grid.nrrd"), samples("f4", (4, 5, 6, 3)).T, header)
    with pytest.raises(InputError, match="choose with a key such as velocity=0"):
        read(tmp_path / "grid.nrrd")
    grid = read(tmp_path / "grid.nrrd", "velocity=2")
    np.testing.assert_array_equal(grid.values, samples("f4", (4, 5, 6, 3))[..., 2])
    np.testing.assert_allclose(grid.affine[:3], [[2, 0, 0, 3], [0, 1.5, 0, 2], [0, 0, 0.5, 1]])


def nrrd_file(sizes, encoding, **fields):
    header = {"type": "short", "dimension": 3, "sizes": sizes, "endian": "big", **fields}
    lines = [f"{name.replace('_', ' ')}: {value}" for name, value in header.items()]
    return "\n".join(["NRRD0004", *lines, f"encoding: {encoding}", "", ""]).encode()


@pytest.mark.parametrize(("encoding", "pack"), [("gzip", gzip.compress), ("bz2", bz2.compress)])
def test_compressed_samples_within_and_beside_the_header(tmp_path, encoding, pack):
    data = pack(b"skipped" + samples(">i2").tobytes())
    head = nrrd_file("6 5 4", encoding, byte_skip=7)
    (tmp_path / "a.nrrd").write_bytes(head + data)
    np.testing.assert_array_equal(read(tmp_path / "a.nrrd").values, samples("i2"))
    (tmp_path / "data").write_bytes(b"a line\n" + data)
    head = nrrd_file("6 5 4", encoding, byteskip=7, line_skip=1, data_file="data")
    (tmp_path / "a.nhdr").write_bytes(head)
    np.testing.assert_array_equal(read(tmp_path / "a.nhdr").values, samples("i2"))


def test_no_more_is_inflated_than_the_header_promises(tmp_path):
    bomb = gzip.compress(bytes(2**28), 1)
    (tmp_path / "a.nrrd").write_bytes(nrrd_file("4 4 4", "gzip") + bomb)
    tracemalloc.start()
    with pytest.raises(InputError, match="promises 128 bytes of samples, but holds more"):
        read(tmp_path / "a.nrrd")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2**24
    (tmp_path / "a.nrrd").write_bytes(nrrd_file("4 4 4", "gzip") + gzip.compress(bytes(7)))
    with pytest.raises(InputError, match="but holds only 7 bytes"):
        read(tmp_path / "a.nrrd")
    (tmp_path / "a.nrrd").write_bytes(nrrd_file("4 4 4", "gzip", byte_skip=-1) + bomb)
    with pytest.raises(InputError, match="skips 0 lines and -1 bytes of compressed"):
        read(tmp_path / "a.nrrd")


# ---- MetaImage ---------------------------------------------------------------------------------


def test_a_header_with_its_data_beside_it(tmp_path):
    image = sitk.GetImageFromArray(samples("i2"))
    image.SetSpacing((0.5, 1.5, 2.0))
    sitk.WriteImage(image, str(tmp_path / "grid.mhd"))
    grid = read(tmp_path / "grid.mhd")
    np.testing.assert_array_equal(grid.values, samples("i2"))
    assert grid.spacing == (2.0, 1.5, 0.5)
    (tmp_path / "grid.raw").unlink()
    os.mkfifo(tmp_path / "grid.raw")
    with pytest.raises(InputError, match=r"names the data file 'grid\.raw', which is not there"):
        read(tmp_path / "grid.mhd")


def test_components_and_times_of_a_metaimage(tmp_path):
    image = sitk.GetImageFromArray(samples("f4", (4, 5, 6, 3)), isVector=True)
    sitk.WriteImage(image, str(tmp_path / "vector.mha"))
    with pytest.raises(InputError, match="choose with a key such as component=0"):
        read(tmp_path / "vector.mha")
    np.testing.assert_array_equal(
        read(tmp_path / "vector.mha", "1").values, samples("f4", (4, 5, 6, 3))[..., 1]
    )
    film = sitk.JoinSeries([sitk.GetImageFromArray(samples() + k) for k in range(3)])
    sitk.WriteImage(film, str(tmp_path / "film.mha"))
    np.testing.assert_array_equal(read(tmp_path / "film.mha", "t=2").values, samples() + 2)


# ---- VTK ---------------------------------------------------------------------------------------


def image_data(path, cells=False, **arrays):
    image = vtkImageData()
    shape = next(iter(arrays.values())).shape[:3]
    image.SetExtent(*(end for n in shape[::-1] for end in (10, 9 + n + cells)))
    image.SetSpacing(0.5, 1.5, 2.0)
    image.SetOrigin(1.0, 2.0, 3.0)
    data = image.GetCellData() if cells else image.GetPointData()
    for name, values in arrays.items():
        array = numpy_to_vtk(values.reshape(math.prod(shape), -1))
        array.SetName(name)
        data.AddArray(array)
    writer = vtkXMLImageDataWriter()
    writer.SetFileName(os.fspath(path))
    writer.SetInputData(image)
    writer.Write()
    return path


def test_an_extent_that_does_not_begin_at_zero(tmp_path):
    grid = read(image_data(tmp_path / "a.vti", a=samples()))
    np.testing.assert_array_equal(grid.values, samples())
    np.testing.assert_allclose(grid.world(np.array(grid.origin)), [23.0, 17.0, 6.0])


def test_samples_of_cells_lie_at_their_centres(tmp_path):
    grid = read(image_data(tmp_path / "a.vti", cells=True, a=samples()))
    np.testing.assert_array_equal(grid.values, samples())
    np.testing.assert_allclose(grid.world(np.array(grid.origin)), [24.0, 17.75, 6.25])
    assert grid.notes == ("cell data: the samples lie at the centres of the cells",)


def test_arrays_and_components_are_chosen_by_name(tmp_path):
    path = image_data(tmp_path / "a.vti", a=samples(), v=samples(shape=(4, 5, 6, 3)))
    with pytest.raises(InputError, match=r"holds 2 arrays, .* a \(1 per point\), v \(3 per point"):
        read(path)
    assert read(path, "a").metadata["name"] == "a"
    with pytest.raises(InputError, match="choose with a key such as component=0"):
        read(path, "v")
    part = read(path, "v,component=1,z=2")
    np.testing.assert_array_equal(part.values, samples(shape=(4, 5, 6, 3))[2, ..., 1])
    with pytest.raises(InputError, match="holds no array 'b'; it has a"):
        read(path, "b")


def test_legacy_files_keep_all_digits_and_vtk_reads_them(tmp_path):
    affine = np.diag([-30.125, 1.5, 0.1, 1.0])
    affine[:3, 3] = [5_123_456.789, 400_000.125, -0.3]
    grid = Grid(samples("int16"), affine=affine, metadata={"name": "height above sea"})
    write(tmp_path / "a.vtk", grid)
    same_places(read(tmp_path / "a.vtk"), grid, rtol=1e-15)
    reader = vtkDataSetReader()
    reader.SetFileName(str(tmp_path / "a.vtk"))
    reader.Update()
    assert reader.GetOutput().GetPointData().GetScalars().GetName() == "height_above_sea"
    assert reader.GetOutput().GetPoint(0) == pytest.approx(
        (-0.3, 400_000.125, 5_123_456.789 - 3 * 30.125), rel=1e-15
    )


def test_vtk_data_that_are_no_image(tmp_path):
    (tmp_path / "a.vtk").write_text(
        "# vtk DataFile Version 3.0\nmesh\nASCII\nDATASET POLYDATA\nPOINTS 1 float\n0 0 0\n"
    )
    with pytest.raises(InputError, match="holds a vtkPolyData; image data"):
        read(tmp_path / "a.vtk")


def test_truncated_legacy_data_are_refused(tmp_path):
    write(tmp_path / "a.vtk", Grid(samples()))
    whole = (tmp_path / "a.vtk").read_bytes()
    (tmp_path / "a.vtk").write_bytes(whole[:-50])
    with pytest.raises(InputError, match="is damaged or no image data"):
        read(tmp_path / "a.vtk")


@pytest.mark.parametrize(
    ("size", "said"),
    [
        ("3000 3000 300", r"is truncated: its header promises 2700000000 samples, \d+ bytes are"),
        ("100000 100000 100000", r"an array of shape .* needs .* this machine has"),
    ],
)
def test_the_size_in_a_legacy_header_is_checked_first(tmp_path, monkeypatch, size, said):
    monkeypatch.setattr("contourfair_jax._support.memory.physical_memory", lambda: 2**40)
    write(tmp_path / "a.vtk", Grid(samples()))
    whole = (tmp_path / "a.vtk").read_bytes()
    larger = whole.replace(b"DIMENSIONS 6 5 4", b"dimensions " + size.encode())
    (tmp_path / "a.vtk").write_bytes(larger)
    with pytest.raises(InputError, match=said):
        read(tmp_path / "a.vtk")


# ---- cube files and CCP4 maps ------------------------------------------------------------------


def test_a_cube_file(tmp_path):
    for angstrom, units in ((False, "bohr"), (True, "angstrom")):
        (tmp_path / "a.cube").write_bytes(cube(angstrom=angstrom))
        grid = read(tmp_path / "a.cube")
        np.testing.assert_array_equal(grid.values, samples())
        np.testing.assert_allclose(
            grid.affine[:3], [[2, 0, 0, 3], [0, 1.5, 0.25, 2], [0, 0, 0.5, 1]]
        )
        assert grid.metadata == {"title": "water density", "space units": units}


def test_orbitals_of_a_cube_file_are_chosen_from(tmp_path):
    (tmp_path / "a.cube").write_bytes(cube(orbitals=3))
    with pytest.raises(InputError, match="choose with a key such as orbital=0"):
        read(tmp_path / "a.cube")
    np.testing.assert_array_equal(read(tmp_path / "a.cube", "2").values, samples() + 2000)


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("turns", [(1, 2, 3), (2, 1, 3), (3, 1, 2)])
def test_a_ccp4_map_in_any_order(tmp_path, order, turns):
    (tmp_path / "a.ccp4").write_bytes(ccp4(order, turns))
    grid = read(tmp_path / "a.ccp4")
    np.testing.assert_array_equal(grid.values, samples())
    np.testing.assert_allclose(grid.affine[:3], [[2, 0, 0, 60], [0, 1.5, 0, 30], [0, 0, 0.5, 5]])
    assert np.count_nonzero(grid.affine[:3, :3]) == 3
    assert grid.notes == ()


def test_skewed_cells_are_said(tmp_path):
    (tmp_path / "a.ccp4").write_bytes(ccp4(gamma=120.0))
    grid = read(tmp_path / "a.ccp4")
    assert "the axes are not perpendicular" in grid.notes[0]
    np.testing.assert_allclose(grid.affine[2, :3], [0.0, -0.75, 0.5], atol=1e-12)
    assert grid.spacing == pytest.approx((2.0, 1.5, 0.5))


@pytest.mark.parametrize(("name", "whole"), [("a.cube", cube()), ("a.ccp4", ccp4())])
def test_truncated_cube_files_and_maps(tmp_path, name, whole):
    for length in (len(whole) - 9, len(whole) - 60):
        (tmp_path / name).write_bytes(whole[:length])
        with pytest.raises(InputError, match="is truncated: "):
            read(tmp_path / name)
    (tmp_path / name).write_bytes(whole[:40])
    with pytest.raises(InputError, match=r"ends within its header|does not begin like one"):
        read(tmp_path / name)


# ---- DICOM -------------------------------------------------------------------------------------


def test_a_folder_of_slices_is_a_volume(tmp_path):
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "readme.txt").write_text("not an image")
    grid = read(slices(tmp_path / "scan", UP))
    (note,) = grid.notes
    assert note.startswith("5 files, ")
    assert note.endswith(" are read; other files in the folder are left out: 1")
    (tmp_path / "scan" / "readme.txt").unlink()
    assert read(tmp_path / "scan").notes == ()
    assert grid.shape == (5, 128, 128)
    assert (grid.values[:, 0, 0] + 1024).tolist() == [1, 3, 4, 0, 2]
    np.testing.assert_allclose(grid.world(np.array(grid.origin)), [5.0, -20.0, -10.0])
    assert grid.spacing == pytest.approx((2.5, 0.661468, 0.661468))
    assert grid.units == "HU"
    assert grid.metadata["space"] == LPS
    assert not any("CompressedSamples" in text for text in grid.metadata.values())
    np.testing.assert_array_equal(read(tmp_path / "scan", "z=1").values, grid.values[1])


def test_the_only_slice_in_a_folder_of_other_files_is_named(tmp_path):
    (file,) = slices(tmp_path / "scan", UP[:1]).iterdir()
    for name in ("a.png", "b.nii"):
        (tmp_path / "scan" / name).write_bytes(b"no slice")
    said = f"{file.name} alone is read; other files in the folder are left out: 2"
    assert read(tmp_path / "scan").notes == (said,)


def test_itk_places_the_series_alike(tmp_path):
    places = [(-10.0, 5.0 + 2.5 * k, -20.0) for k in (3, 0, 4, 1, 2)]
    folder = slices(tmp_path / "scan", places, ImageOrientationPatient=[1, 0, 0, 0, 0, -1])
    grid = read(folder)
    names = sitk.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder))
    image = sitk.ReadImage(names)
    index = (3, 2, 1)
    ours = grid.world(np.array(grid.origin) + np.array(index[::-1]) * grid.spacing)[::-1]
    value = grid.values[index[::-1]]
    theirs = image.TransformPhysicalPointToIndex(ours.tolist())
    assert image.GetPixel(theirs) == value


@pytest.mark.parametrize(
    ("places", "said"),
    [
        ([UP[0], UP[1], UP[2]], r"not evenly spaced \(up to 0\.5 slices off\)"),
        ([UP[0], UP[0], UP[1]], "several images at one place"),
    ],
)
def test_series_with_gaps_or_doubles_are_refused(tmp_path, places, said):
    with pytest.raises(InputError, match=said):
        read(slices(tmp_path / "scan", places))


def test_series_that_do_not_fit_together(tmp_path):
    uid = generate_uid()
    folder = slices(tmp_path / "scan", UP[:2], uid=uid)
    slices(folder, UP[2:], number=8, uid=uid, ImageOrientationPatient=[0, 1, 0, 0, 0, 1])
    with pytest.raises(InputError, match="do not lie behind one another"):
        read(folder)


def test_several_series_in_a_folder(tmp_path):
    folder = slices(tmp_path / "scan", UP)
    slices(folder, UP[:1], number=9)
    with pytest.raises(InputError, match=r"holds 2 series, .* 5 images; .* 1 images"):
        read(folder)
    assert read(folder, "7").shape == (5, 128, 128)
    assert read(folder, "9").shape == (128, 128)
    assert read(folder, "7,z=2").shape == (128, 128)
    with pytest.raises(InputError, match="choose one by its number: 7 head"):
        read(folder, "8")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="is a folder without DICOM images"):
        read(tmp_path / "empty")


@pytest.mark.parametrize(
    ("name", "shape", "kind"),
    [
        ("MR_small.dcm", (64, 64), "int16"),
        ("MR_small_RLE.dcm", (64, 64), "int16"),
        ("MR_small_bigendian.dcm", (64, 64), "int16"),
        ("image_dfl.dcm", (512, 512), "int16"),
        ("rtdose.dcm", (15, 10, 10), "float64"),
    ],
)
def test_kinds_of_dicom_files(name, shape, kind):
    grid = read(get_testdata_file(name))
    assert grid.shape == shape
    assert grid.values.dtype == kind
    if name == "rtdose.dcm":
        assert grid.values.max() == pytest.approx(1.254, rel=1e-6)
        assert grid.units == "RELATIVE"
    if name.startswith("MR_small"):
        np.testing.assert_array_equal(grid.values, read(get_testdata_file("MR_small.dcm")).values)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("examples_rgb_color.dcm", r"holds a colour image \(RGB\)"),
        ("rtplan.dcm", "is a DICOM file without an image"),
        ("MR_truncated.dcm", "cannot be read as DICOM"),
    ],
)
def test_dicom_files_that_are_refused(name, said):
    with pytest.raises(InputError, match=said):
        read(get_testdata_file(name))


@pytest.mark.parametrize(
    ("changes", "thick"),
    [({}, 5.0), ({"SpacingBetweenSlices": 2.5}, 2.5), ({"SpacingBetweenSlices": None}, 5.0)],
)
def test_a_slice_keeps_its_place_and_thickness(tmp_path, changes, thick):
    (path,) = slices(tmp_path / "scan", [(-10.0, -20.0, -75.5)], **changes).iterdir()
    slice_ = read(path.rename(tmp_path / "a.dcm"))
    write(tmp_path / "a.nii", slice_)
    found = nibabel.load(tmp_path / "a.nii")
    np.testing.assert_allclose(found.affine[:3, 3], [10.0, 20.0, -75.5])
    np.testing.assert_allclose(found.header.get_zooms(), [0.661468, 0.661468, thick])
    if importlib.util.find_spec("rasterio"):
        assert "where the slice of a volume lies as text" in write(tmp_path / "a.tif", slice_)[0]


def test_padding_is_missing(tmp_path):
    folder = slices(tmp_path / "scan", UP, PixelPaddingValue=3)
    grid = read(folder)
    assert grid.missing_count == 128 * 128
    assert grid.values.dtype == np.float32


def enhanced(path, places):
    """Frames with their own place and scale, as newer scanners write them."""
    image = pydicom.dcmread(get_testdata_file("CT_small.dcm"))
    for name in ("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing"):
        delattr(image, name)
    del image.RescaleSlope, image.RescaleIntercept
    image.NumberOfFrames, image.Rows, image.Columns = len(places), 4, 6
    image.PixelData = np.repeat(np.arange(len(places), dtype="<i2"), 24).tobytes()

    def group(**items):
        outer = pydicom.Dataset()
        for name, values in items.items():
            inner = pydicom.Dataset()
            for key, value in values.items():
                setattr(inner, key, value)
            setattr(outer, name, pydicom.Sequence([inner]))
        return outer

    image.SharedFunctionalGroupsSequence = pydicom.Sequence(
        [
            group(
                PixelMeasuresSequence={"PixelSpacing": [1.5, 0.5]},
                PlaneOrientationSequence={"ImageOrientationPatient": [1, 0, 0, 0, 1, 0]},
            )
        ]
    )
    image.PerFrameFunctionalGroupsSequence = pydicom.Sequence(
        [
            group(
                PlanePositionSequence={"ImagePositionPatient": list(place)},
                PixelValueTransformationSequence={"RescaleSlope": "2", "RescaleIntercept": str(k)},
            )
            for k, place in enumerate(places)
        ]
    )
    image.save_as(path)
    return path


def test_frames_with_places_are_a_volume(tmp_path):
    grid = read(enhanced(tmp_path / "a.dcm", UP))
    assert grid.shape == (5, 4, 6)
    assert grid.spacing == (2.5, 1.5, 0.5)
    assert grid.values[:, 0, 0].tolist() == [3.0, 9.0, 12.0, 0.0, 6.0]


def test_frames_without_places_are_a_film(tmp_path):
    path = enhanced(tmp_path / "a.dcm", [UP[0]] * 3)
    with pytest.raises(InputError, match="frame 3, y 4, x 6: choose with a key such as frame=0"):
        read(path)
    grid = read(path, "2")
    assert grid.shape == (4, 6)
    assert grid.values[0, 0] == 6.0
