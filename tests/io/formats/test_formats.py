"""What every format must do: samples, places, gaps and texts come back; and how files are read."""

import os
import sys
import tomllib

import numpy as np
import pytest
from file_helpers import (  # noqa: F401
    STEPS,
    WRITTEN_3D,
    inside,
    oblique,
    placed,
    same_places,
    samples,
)
from helpers import ROOT

from contourfair_jax.io import (
    FORMATS,
    Grid,
    InputError,
    MissingPackageError,
    _isolate,
    check_writable,
    read,
    write,
)

DTYPES = ("uint8", "int16", "uint16", "int32", "int64", "float32", "float64")
DOWN = STEPS * [[-1], [1], [-1], [1]]
KEEP_NODATA = (".nc", ".zarr", ".nrrd", ".nhdr", ".mha", ".mhd", ".vti")


def back(tmp_path, suffix: str, grid: Grid) -> tuple[Grid, tuple[str, ...]]:
    notes = write(tmp_path / f"grid{suffix}", grid)
    return read(tmp_path / f"grid{suffix}"), notes


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", WRITTEN_3D)
def test_samples_of_every_type_come_back_exactly(tmp_path, suffix):
    for dtype in DTYPES:
        grid, _ = back(tmp_path, suffix, Grid(samples(dtype)))
        np.testing.assert_array_equal(grid.values, samples(dtype))
        assert grid.values.dtype == grid.source_dtype == dtype
        assert grid.missing is None
        assert grid.axes == ("z", "y", "x")


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", WRITTEN_3D)
@pytest.mark.parametrize("affine", [STEPS, DOWN, oblique()], ids=["up", "down", "oblique"])
def test_places_come_back(tmp_path, suffix, affine):
    grid = Grid(samples(), affine=affine)
    if suffix == ".vtk" and np.count_nonzero(affine[:3, :3]) > 3:
        with pytest.raises(InputError, match=r"no turned axes; use \.vti"):
            write(tmp_path / "grid.vtk", grid)
        return
    again, notes = back(tmp_path, suffix, grid)
    assert notes == ()
    same_places(again, grid)
    if suffix != ".vtk":
        np.testing.assert_allclose(again.affine, affine, rtol=1e-6, atol=1e-6)
        np.testing.assert_array_equal(again.values, grid.values)


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", [*WRITTEN_3D, ".npz"])
@pytest.mark.parametrize("affine", [DOWN, oblique()], ids=["down", "oblique"])
def test_samples_of_a_refined_file_lie_on_those_of_the_original(tmp_path, suffix, affine):
    if suffix == ".vtk":
        affine = DOWN
    grid = Grid(samples(), affine=affine)
    fine = np.full((13, 17, 21), -1.0, np.float32)
    fine[::4, ::4, ::4] = grid.values
    again, _ = back(tmp_path, suffix, grid.refined(fine, 4))
    rows = placed(again)
    same = rows[rows[:, -1] >= 0]
    np.testing.assert_allclose(same, placed(grid), rtol=1e-6, atol=1e-5)


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", WRITTEN_3D)
@pytest.mark.parametrize("nodata", [None, -9999.0])
def test_gaps_come_back(tmp_path, suffix, nodata):
    values = samples()
    values[1, 2, 3:5] = np.nan
    grid = Grid(values, missing=np.isnan(values), nodata=nodata)
    again, notes = back(tmp_path, suffix, grid)
    np.testing.assert_array_equal(again.missing, grid.missing)
    np.testing.assert_array_equal(again.values, values)
    if nodata is not None and suffix in KEEP_NODATA:
        assert again.nodata == nodata
    else:
        assert again.nodata is None
        assert bool(notes) == (nodata is not None)


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", WRITTEN_3D)
def test_texts_come_back_or_are_said_to_be_lost(tmp_path, suffix):
    metadata = {"description": "a hill", "space": "left-posterior-superior", "space units": "mm"}
    grid = Grid(samples(), affine=STEPS, units="HU", crs="EPSG:32633", metadata=metadata)
    again, notes = back(tmp_path, suffix, grid)
    lost = " ".join(notes)
    for name in ("units", "crs"):
        assert (getattr(again, name) == getattr(grid, name)) != (name in lost)
    if suffix != ".vtk":
        assert again.metadata["description"] == "a hill"
        assert again.metadata["space units"] == "mm"


# Metadata, and a part of it as it must be where the format keeps text in the lines of its header.
AWKWARD = {
    "line ends": (
        {"history": "a\r\nb\n", "title": "one\ntwo", "name": "x\ny"},
        {"history": "a b"},
    ),
    "names": (
        {"global:history": "a", "global:b": "c:=d", "#e": "f", "g:=h": "i = j", "type ": "k"},
        {"global_history": "a", "global_b": "c:=d", "e": "f", "g_h": "i = j"},
    ),
    "empty": ({"title": "", "name": "", "history": "\n", "": "x"}, {}),
    "long": ({"history": "x" * 40_000, "title": "\u20ac" * 250}, {}),
    "layout": ({"ElementDataFile": "none", "HeaderSize": "7", "dimension": "9"}, {}),
}


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", WRITTEN_3D)
@pytest.mark.parametrize("case", AWKWARD)
def test_texts_of_any_kind_leave_the_file_readable(tmp_path, suffix, case):
    metadata, kept = AWKWARD[case]
    grid = Grid(samples(), affine=STEPS, units="m\ns", metadata=metadata)
    again, _ = back(tmp_path, suffix, grid)
    same_places(again, grid)
    np.testing.assert_array_equal(again.values, grid.values)
    if suffix in (".nrrd", ".nhdr", ".mha", ".mhd"):
        assert again.units == "m s"
        assert kept.items() <= again.metadata.items()


@pytest.mark.usefixtures("inside")
def test_texts_that_a_header_cannot_hold_are_said_to_be_lost(tmp_path):
    grid = Grid(samples(), units="\u00b5m", metadata={"history": "x" * 40_000})
    again, notes = back(tmp_path, ".nrrd", grid)
    assert again.units == "?m"
    assert "other characters of its texts" in notes[0]
    again, notes = back(tmp_path, ".mha", grid)
    assert again.units == "\u00b5m"
    assert "texts are cut to 32000 bytes" in notes[0]


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", WRITTEN_3D)
def test_images_are_images_again(tmp_path, suffix):
    affine = np.array([[-30.0, 0.0, 5e6], [0.0, 20.0, 4e5], [0.0, 0.0, 1.0]])
    grid = Grid(samples(shape=(7, 9)), affine=affine)
    again, _ = back(tmp_path, suffix, grid)
    assert again.axes == ("y", "x")
    same_places(again, grid)


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", WRITTEN_3D)
@pytest.mark.parametrize("shape", [(1, 9), (9, 1), (3, 3), (3, 3, 3)])
def test_thin_and_tiny_arrays(tmp_path, suffix, shape):
    grid = Grid(samples(shape=shape), spacing=(2.0,) * len(shape))
    again, _ = back(tmp_path, suffix, grid)
    assert again.shape == shape
    assert again.spacing == (2.0,) * len(shape)
    np.testing.assert_array_equal(again.values, grid.values)


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", WRITTEN_3D)
def test_the_order_of_axes_does_not_move_samples(tmp_path, suffix):
    affine = np.diag([2.0, 1.5, 0.5, 1.0])
    affine[:3, 3] = [1.0, 2.0, 3.0]
    grid = Grid(samples(), axes=("x", "y", "z"), affine=affine)
    again, _ = back(tmp_path, suffix, grid)
    if again.axes == ("z", "y", "x"):
        again = Grid(
            again.values.T,
            axes=("x", "y", "z"),
            affine=again.affine[np.ix_([2, 1, 0, 3], [2, 1, 0, 3])],
        )
    same_places(again, grid)
    assert again.axes == grid.axes


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", WRITTEN_3D)
def test_a_metric_spacing_is_kept_or_said_to_be_lost(tmp_path, suffix):
    grid = Grid(samples(), affine=STEPS, spacing=(20.0, 15.0, 5.0))
    again, notes = back(tmp_path, suffix, grid)
    assert (again.spacing == grid.spacing) != ("not the metric spacing" in " ".join(notes))


@pytest.mark.parametrize("suffix", WRITTEN_3D)
def test_a_failed_write_leaves_what_was_there(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"grid{suffix}"
    write(path, Grid(samples("uint8")))
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}

    def no_space(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(InputError, match=r"cannot be written \(No space left on device\)"):
        write(path, Grid(samples("float64")))
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before
    assert set(os.listdir(tmp_path)) <= {path.name, "grid.raw"}


@pytest.mark.parametrize("suffix", WRITTEN_3D)
def test_formats_say_beforehand_what_they_cannot_hold(tmp_path, suffix):
    check_writable(tmp_path / f"grid{suffix}", Grid(samples()))
    if suffix not in (".nc", ".zarr"):
        with pytest.raises(InputError, match="2-D or 3-D data, this is 4-D"):
            check_writable(tmp_path / f"grid{suffix}", Grid(samples(shape=(3, 3, 3, 3))))
    assert os.listdir(tmp_path) == []


def test_formats_that_are_only_read_are_not_written(tmp_path):
    for suffix in (".dcm", ".dem", ".asc"):
        with pytest.raises(InputError, match=r"are not written; known suffixes: \.npy"):
            write(tmp_path / f"grid{suffix}", Grid(samples()))


# ---- a folder that is replaced ---------------------------------------------------------------


@pytest.mark.usefixtures("inside")
def test_a_zarr_folder_replaces_a_zarr_folder_and_nothing_else(tmp_path):
    target = tmp_path / "grid.zarr"
    for dtype in ("uint8", "int16"):
        write(target, Grid(samples(dtype)))
        assert read(target).values.dtype == dtype
    assert os.listdir(tmp_path) == ["grid.zarr"]
    (tmp_path / "mine.zarr").mkdir()
    (tmp_path / "mine.zarr" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="is a folder of something else, so it is not replaced"):
        write(tmp_path / "mine.zarr", Grid(samples()))
    with pytest.raises(InputError, match="is a folder of something else"):
        check_writable(tmp_path / "mine.zarr")
    assert (tmp_path / "mine.zarr" / "letter.txt").read_text() == "dear"
    (tmp_path / "file.zarr").write_text("")
    for use in (lambda path: write(path, Grid(samples())), read):
        with pytest.raises(InputError, match="is a file"):
            use(tmp_path / "file.zarr")


@pytest.mark.usefixtures("inside")
def test_a_link_to_a_zarr_folder_stays_one(tmp_path):
    write(tmp_path / "real.zarr", Grid(samples("uint8")))
    (tmp_path / "link.zarr").symlink_to(tmp_path / "real.zarr")
    write(tmp_path / "link.zarr", Grid(samples("int16")))
    assert (tmp_path / "link.zarr").is_symlink()
    assert read(f"{tmp_path}/real.zarr/").values.dtype == np.int16


# ---- a header with a file beside it ------------------------------------------------------------


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize("suffix", [".mhd", ".nhdr"])
def test_a_header_and_its_samples_are_replaced_together(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"grid{suffix}"
    (tmp_path / "grid.raw").write_text("mine")
    for use in (lambda: write(path, Grid(samples())), lambda: check_writable(path)):
        with pytest.raises(InputError, match=r"grid\.raw is there without it, so it is not repl"):
            use()
    assert (tmp_path / "grid.raw").read_text() == "mine"
    (tmp_path / "grid.raw").unlink()
    for dtype in ("uint8", "int16"):
        write(path, Grid(samples(dtype)))
        assert sorted(os.listdir(tmp_path)) == sorted([path.name, "grid.raw"])
        assert read(path).values.dtype == dtype
    replace = os.replace

    def full(source, target):
        if str(target).endswith(suffix):
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match=r"cannot be written \(No space left on device\)"):
        write(path, Grid(samples("float64")))
    assert os.listdir(tmp_path) == ["grid.raw"]  # no header beside samples of another


# ---- what is refused before any work -----------------------------------------------------------


@pytest.mark.parametrize("suffix", [".npy", ".zarr", ".mhd"])
def test_a_folder_that_may_not_be_written_to_is_said_at_once(tmp_path, suffix, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    with pytest.raises(InputError, match="may not be written to; choose another"):
        check_writable(tmp_path / f"grid{suffix}")


def test_compressed_files_are_said_to_be_so(tmp_path):
    for name in ("a.mha.gz", "a.nrrd.bz2", "a.zip"):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(InputError, match="is compressed as a whole; unpack it"):
            read(tmp_path / name)


# ---- reading in a process of its own -----------------------------------------------------------


@pytest.mark.parametrize("suffix", WRITTEN_3D)
def test_every_format_is_read_by_a_child(tmp_path, suffix):
    values = samples(">f4")
    values[0, 0, 0] = np.nan
    grid = Grid(values, missing=np.isnan(values), affine=STEPS)
    again, _ = back(tmp_path, suffix, grid)
    same_places(again, grid)
    assert again.values.flags.c_contiguous
    assert again.values.flags.writeable


def test_both_kinds_of_tiff_are_read_by_a_child(tmp_path, monkeypatch):
    monkeypatch.setattr("contourfair_jax.io.formats.tiff.read", None)  # here, not there
    for name, affine in (("plain", None), ("geo", np.diag([2.0, 1.5, 1.0]))):
        grid = Grid(samples(shape=(4, 5)), affine=affine)
        write(tmp_path / f"{name}.tif", grid)
        same_places(read(tmp_path / f"{name}.tif"), grid)


# What the child runs instead, what is then said.
PATCHED = """
import json, sys
sys.path[:] = json.loads(sys.argv[1])
import numpy
from contourfair_jax._support import memory
from contourfair_jax.io import Grid, _worker
from contourfair_jax.io.formats import nifti
def read(path, key):
    {}
nifti.read = read
_worker.main(*json.loads(sys.argv[2]))
"""
HALF = "import json; print(json.dumps(dict(shape=[9, 9], dtype='<f8', gaps=False))); print('x' * 9)"
FAULTS = {
    "crash": ("import os; os.kill(os.getpid(), 11)", r"crashes the library .* \(signal 11\)"),
    "hang": ("import time; time.sleep(60)", "was given up after 1 s"),
    "exit": ("import sys; sys.exit('no luck')", r"ended early, status 1 \(no luck\)"),
    "half": (HALF, r"ended early, status 0 \(it said nothing\)"),
    "nothing": ("", r"ended early, status 0 \(it said nothing\)"),
    "memory": (
        PATCHED.format("numpy.empty(memory.physical_memory() + 2**33, 'u1')"),
        "asks for more memory than this machine has",
    ),
    "fault": (PATCHED.format("raise KeyError('a\\nb')"), r"cannot be read as NIfTI: 'a\\nb'$"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_reader_that_fails_ends_in_one_line(tmp_path, monkeypatch, fault):
    code, said = FAULTS[fault]
    monkeypatch.setattr(_isolate, "_CODE", code)
    monkeypatch.setattr(_isolate, "_PATIENCE", 1.0 if fault == "hang" else 60.0)
    path = tmp_path / "grid.nii"
    path.write_bytes(b"")
    with pytest.raises(InputError, match=said) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_what_a_library_prints_is_not_taken_for_data(tmp_path, monkeypatch):
    chatty = "print('hello'); return Grid(numpy.ones((3, 3)))"
    monkeypatch.setattr(_isolate, "_CODE", PATCHED.format(chatty))
    (tmp_path / "grid.nii").write_bytes(b"")
    np.testing.assert_array_equal(read(tmp_path / "grid.nii").values, np.ones((3, 3)))


def test_a_child_that_cannot_start_is_one_line(tmp_path, monkeypatch):
    write(tmp_path / "grid.nii", Grid(samples()))
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(InputError, match="the process that reads it cannot start"):
        read(tmp_path / "grid.nii")


@pytest.mark.parametrize(
    "each",
    [row for row in FORMATS if row.outside and row.outside.packages],
    ids=lambda row: row.name,
)
def test_a_missing_package_names_the_extra(tmp_path, monkeypatch, each):
    path = tmp_path / f"grid{each.suffixes[0]}"
    path.mkdir() if each.folder else path.write_bytes(b"")
    for name in each.outside.packages:
        monkeypatch.setitem(sys.modules, name, None)
    extra = each.outside.extra
    with pytest.raises(MissingPackageError, match=rf"needs .*contourfair-jax\[{extra}\]"):
        read(path)
    if each.writer:
        with pytest.raises(MissingPackageError, match=rf"contourfair-jax\[{extra}\]"):
            check_writable(tmp_path / f"new{each.suffixes[0]}", Grid(samples()))


def test_the_extras_are_in_the_project_file():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras = project["project"]["optional-dependencies"]
    for each in FORMATS:
        if each.outside is not None:
            assert len(extras[each.outside.extra]) >= len(each.outside.packages)
            assert each.outside.extra in extras["all"][0]
