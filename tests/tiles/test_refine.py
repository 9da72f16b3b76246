"""Tiles: the same result however the work is cut, divided, interrupted; nothing is lost."""

import json
import os
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import tile_worker
import xarray as xr
import zarr
from helpers import SEED
from shape_checks import refused

import contourfair_jax as cf
from contourfair_jax import tiles
from contourfair_jax.cli import main
from contourfair_jax.io import Grid, InputError, read, write
from contourfair_jax.tiles import _job, _program, _source
from contourfair_jax.tiles._source import survey
from contourfair_jax.tiles._tiling import Tiling

METHOD = tile_worker.METHOD
SHAPE = (31, 42)
WORKER = Path(tile_worker.__file__)


class Other(cf.AbstractFairing):
    """A method of which no overlap of tiles is known."""

    def fit(self, values, spacing):
        raise NotImplementedError


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch):
    """Tiles of 8 x 8 or 4 x 4 x 4 cells."""
    for method, overlap in tile_worker.SMALL.items():
        monkeypatch.setitem(_program._OVERLAPS, method, overlap)


@pytest.fixture(scope="module")
def samples():
    return np.random.default_rng(SEED).standard_normal(SHAPE)


@pytest.fixture(scope="module")
def whole(samples):
    return np.asarray(cf.fair_field(samples, method=METHOD).refine(2))


def refined(source, target, **settings):
    outcome = tiles.refine_to(source, target, 2, **{"method": METHOD, **settings})
    assert not Path(f"{target}.partial").exists()
    stored = np.load(target) if str(target).endswith(".npy") else zarr.open_array(target)[:]
    assert stored.shape == outcome.shape
    return stored


@pytest.mark.parametrize("halo", [1, 3])
@pytest.mark.parametrize("cells", [4, 5])
@pytest.mark.parametrize("shape", [(3, 21), (5, 6), (9, 10, 4), (17, 16)])
def test_tiles_are_a_partition_in_whole_chunks(shape, cells, halo):
    factors = (3, 2, 4)[: len(shape)]
    tiling = Tiling(shape, factors, cells, halo)
    owner = np.full(tiling.fine_shape, -1)
    chunks = set()
    for tile in tiling:
        assert (owner[tile.region] == -1).all()
        owner[tile.region] = tile.number
        index = [range(part.start, part.stop) for part in tile.region]
        cut = [range(part.start, part.stop) for part in tile.cut]
        blocks = [part.start for part in tile.block]
        assert [len(range(part.start, part.stop)) for part in tile.block] == [*tiling.block]
        for axis, n in enumerate(shape):
            assert 0 <= blocks[axis] <= n - tiling.block[axis]
            assert 0 <= tile.offset[axis] <= tiling.block[axis] - 1 - tiling.window[axis]
            start = factors[axis] * (blocks[axis] + tile.offset[axis])
            assert index[axis][0] - start == cut[axis][0]
            # Cells whose halo is not in the block are those at the border of the grid.
            factor = factors[axis]
            first, last = index[axis][0] // factor, -(-index[axis][-1] // factor)
            assert blocks[axis] in (0, max(blocks[axis], 0))
            assert blocks[axis] == 0 or first - blocks[axis] >= min(halo, first)
            end = blocks[axis] + tiling.block[axis]
            assert end == n or end - 1 - last >= halo
        own = {tuple(int(i) for i in np.array([r[0] for r in index]) // tiling.chunks)}
        assert not own & chunks
        chunks |= own
    assert (owner >= 0).all()


def test_every_way_of_running_gives_the_same_bits(tmp_path, samples, whole):
    first = refined(samples, tmp_path / "memory.npy")
    np.testing.assert_allclose(first, whole, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(first[::2, ::2], samples)
    np.save(tmp_path / "c.npy", samples)
    shutil.copy(tmp_path / "c.npy", tmp_path / "UPPER.NPY")
    np.save(tmp_path / "f.npy", np.asfortranarray(samples))
    sources = {
        "path.npy": tmp_path / "c.npy",
        "upper.npy": tmp_path / "UPPER.NPY",
        "fortran.zarr": tmp_path / "f.npy",
        "map.npy": np.load(tmp_path / "c.npy", mmap_mode="r"),
        "part.npy": np.load(tmp_path / "c.npy", mmap_mode="r")[:, :],
        "swapped.npy": samples.astype(">f8"),
        "labelled.zarr": xr.DataArray(samples, dims=("y", "x")),
    }
    for chunks in ((7, 9), (31, 5)):
        path = tmp_path / f"in{chunks[0]}.zarr"
        array = zarr.create_array(str(path), shape=SHAPE, chunks=chunks, dtype="f8")
        array[:] = samples
        sources[f"zarr{chunks[0]}.zarr"] = path
        sources[f"array{chunks[0]}.npy"] = zarr.open_array(path, mode="r")
    for name, source in sources.items():
        np.testing.assert_array_equal(refined(source, tmp_path / name), first, name)
    with ThreadPoolExecutor(2) as threads:
        np.testing.assert_array_equal(
            refined(samples, tmp_path / "threads.zarr", workers=threads), first
        )
    backwards = np.zeros_like(first)
    for region, values in reversed(list(tiles.refine_tiles(samples, 2, method=METHOD))):
        backwards[region] = values
    np.testing.assert_array_equal(backwards, first)


@pytest.mark.slow
def test_processes_give_the_same_bits(tmp_path, samples):
    first = refined(samples, tmp_path / "one.zarr", workers=1)
    np.testing.assert_array_equal(refined(samples, tmp_path / "two.zarr", workers=2), first)
    assert zarr.open_array(tmp_path / "two.zarr").chunks == (16, 16)


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bits(tmp_path, samples):
    distributed = pytest.importorskip("distributed")
    first = refined(samples, tmp_path / "one.zarr")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
        client.get_executor() as executor,
    ):
        second = refined(samples, tmp_path / "two.zarr", workers=executor)
    np.testing.assert_array_equal(second, first)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "dtype"),
    [(SHAPE, "float32"), (SHAPE, "int16"), ((11, 6, 9), "float32")],
)
def test_volumes_gaps_and_types(tmp_path, rng, shape, dtype):
    values = (100 * rng.standard_normal(shape)).astype(dtype)
    if dtype == "float32":
        values[4, 3] = np.nan
        values[0, 0] = np.inf
    fine = refined(values, tmp_path / "fine.zarr")
    assert fine.dtype == np.float32
    known = np.where(np.isinf(values), np.nan, values.astype(np.float32))
    expected = np.asarray(cf.fair_field(known, method=METHOD).refine(2))
    np.testing.assert_allclose(fine, expected, rtol=0, atol=3e-4)


@pytest.mark.slow
def test_global_tiles_agree_with_the_whole(tmp_path):
    """With the halo that users get, seams are below 1e-5 of the range, on noise too."""
    halo = 24
    _program._OVERLAPS[cf.GlobalFairing] = _program.Overlap(halo, {2: 12})
    noise = np.random.default_rng(SEED).standard_normal((7, 80))
    method = cf.GlobalFairing(iterations=2)
    fine = refined(noise, tmp_path / "fine.npy", method=method)
    exact = cf.GlobalFairing(iterations=2, tolerance=1e-9)
    whole = np.asarray(cf.fair_field(noise, method=exact).refine(2))
    assert np.abs(fine - whole).max() < 1e-5 * np.ptp(noise)


@pytest.mark.slow
def test_gaps_that_tiles_cannot_fill(tmp_path, capsys):
    noise = np.random.default_rng(SEED).standard_normal((9, 41))
    method = cf.GlobalFairing(iterations=1)
    narrow, wide = noise.copy(), noise.copy()
    narrow[:, 17:19] = np.nan
    wide[:, 14:29] = np.nan
    source, target = tmp_path / "wide.npy", tmp_path / "fine.npy"
    np.save(source, wide)
    outcome = tiles.refine_to(narrow, target, 2, method=method)
    assert (outcome.cut, outcome.missing) == (0, 0)
    with pytest.raises(
        InputError, match=r"reach too far beyond 2 tiles .* 0:9 x 2:23\).*fill=False"
    ):
        tiles.refine_to(source, target, 2, method=method)
    with pytest.raises(InputError, match="reach too far beyond 1 tile to be filled"):
        list(tiles.refine_tiles(wide, 2, method=method))
    assert not np.isnan(np.load(target)).any()
    with pytest.warns(UserWarning, match="beside gaps that reach far beyond them, 2 of 5 tiles"):
        outcome = tiles.refine_to(source, target, 2, method=method, fill=False)
    stored = np.load(target)
    expected = np.zeros(stored.shape, bool)
    expected[:, 2 * 13 + 1 : 2 * 29] = True
    np.testing.assert_array_equal(np.isnan(stored), expected)
    assert (outcome.cut, outcome.gaps, outcome.missing) == (2, 9 * 15, expected.sum())
    call = ["upsample", str(source), "-o", str(tmp_path / "fine.zarr"), "-m", "global", "-f", "2"]
    assert main([*call, "--fill"]) == 2
    assert "leave the gaps (fill=False, no --fill)" in capsys.readouterr().err
    assert main([*call, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["missing"] == outcome.missing
    assert any("2 of 5 tiles have seams" in note for note in said["notes"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"source": np.zeros(5)}, "source must be 2-D or 3-D"),
        ({"source": np.zeros((2, 5))}, "at least 3 samples"),
        ({"source": np.zeros((4, 4), complex)}, "source must hold real numbers"),
        ({"factor": 0}, "factor must be an integer"),
        ({"spacing": (1.0, -1.0)}, "spacing must be finite and above zero"),
        ({"spacing": 1e-46}, "spacing must be finite and above zero, in float32 too"),
        ({"spacing": (1.0, 1.0, 1.0)}, "spacing must be one real number or 2 of them"),
        ({"dtype": "int32"}, "dtype must be float32 or float64"),
        ({"workers": 0}, "workers must be an integer"),
        ({"memory": 1000}, "memory must be at least"),
        ({"method": cf.GlobalFairing(sigma=0.1)}, "method.sigma looks at the whole grid"),
        ({"method": cf.GlobalFairing(norm=1.5)}, "method.norm below 2 weighs cells by the mean"),
        (
            {"method": cf.GlobalFairing(converge=0.01)},
            "method.converge stops by the changes of the whole grid",
        ),
        (
            {"method": cf.GlobalFairing(border_degree=4)},
            "method.border_degree continues every tile",
        ),
        ({"method": "local"}, r"method must be an object such as LocalFairing\(\), got 'local'"),
        (
            {"method": Other()},
            r"must be one of LocalFairing\(\), GlobalFairing\(\) for tiles",
        ),
        ({"target": "fine.tif"}, "the name must end in .zarr, .npy"),
        ({"target": "absent/fine.npy"}, "there is no folder"),
        ({"source": "absent.npy"}, "there is no such file"),
    ],
)
def test_arguments_are_checked(tmp_path, arguments, said):
    call = {"source": np.zeros((4, 5)), "factor": 2, "target": "fine.npy", **arguments}
    source, target, factor = call.pop("source"), tmp_path / call.pop("target"), call.pop("factor")
    with refused(ValueError, match=said):
        tiles.refine_to(source, target, factor, **call)
    assert list(tmp_path.iterdir()) == []


def test_sizes_are_checked_before_the_start(tmp_path, samples, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    target = tmp_path / "fine.npy"
    stopped(tmp_path, samples, target)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=20000))
    with pytest.raises(InputError, match=r"other.npy: 61 x 83 samples are 39.6 KiB, the disk has"):
        refined(samples, tmp_path / "other.npy")
    refined(samples, target, resume=True)  # room that is set aside already counts
    refined(samples, tmp_path / "compressed.zarr")
    monkeypatch.setattr(_job, "physical_memory", lambda: 1000)
    with pytest.raises(InputError, match=r"one tile at factor 2 needs .* smaller --factor"):
        refined(samples, target)
    assert not list(tmp_path.glob("*.partial"))


@pytest.mark.parametrize("suffix", [".npy", ".zarr"])
def test_missing_samples_are_counted(tmp_path, samples, suffix):
    values = samples.copy()
    values[4, 3:6] = np.nan
    values[30, 0] = -np.inf
    target = tmp_path / f"fine{suffix}"
    plain = tiles.refine_to(values, tmp_path / "plain.npy", 2, method=METHOD)
    stopped(tmp_path, values, target, after=9)
    outcome = tiles.refine_to(values, target, 2, method=METHOD, resume=True)
    stored = np.load(target) if suffix == ".npy" else zarr.open_array(target)[:]
    assert (outcome.gaps, outcome.missing) == (4, np.isnan(stored).sum())
    assert outcome.missing == plain.missing > 4
    with pytest.raises(InputError, match="every sample is missing"):
        refined(np.full(SHAPE, np.nan), tmp_path / "nothing.npy")
    # Infinite in the precision to compute in.
    outcome = tiles.refine_to(5e38 * values, target, 2, dtype="f4", method=METHOD)
    assert outcome.gaps == (~(np.abs(5e38 * values) <= np.finfo("f4").max)).sum() > 100


@pytest.mark.parametrize("dtype", ["f8", "i2"])
def test_masked_samples_are_missing(tmp_path, samples, dtype):
    values = np.ma.masked_array((100 * samples).astype(dtype), np.zeros(SHAPE, bool))
    values[4, 3:6] = np.ma.masked
    holed = values.astype("f8").filled(np.nan)
    expected = refined(holed, tmp_path / "holed.npy", dtype="f8")
    for region, fine in tiles.refine_tiles(values, 2, method=METHOD, dtype="f8"):
        np.testing.assert_array_equal(fine, expected[region])
    stopped(tmp_path, values, tmp_path / "fine.npy")
    with pytest.raises(InputError, match="for content of the input was"):
        tiles.refine_to(values.data, tmp_path / "fine.npy", 2, method=METHOD, resume=True)
    with ThreadPoolExecutor(2) as threads:
        for workers in (1, threads):
            target = tmp_path / "again.npy"
            outcome = tiles.refine_to(values, target, 2, method=METHOD, dtype="f8", workers=workers)
            np.testing.assert_array_equal(np.load(target), expected)
            assert (outcome.gaps, outcome.missing) == (3, np.isnan(expected).sum())


def test_a_survey_is_the_same_whatever_the_chunks(samples, monkeypatch):
    values = np.ma.masked_array((100 * samples).astype("i2"), samples > 1)
    whole = survey(values, np.dtype("f4"))
    monkeypatch.setattr(_source, "_SLAB_BYTES", 300)
    assert survey(values, np.dtype("f4")) == whole
    assert whole.missing == (samples > 1).sum()
    assert survey(np.ma.array(values.data), np.dtype("f4")) == survey(values.data, np.dtype("f4"))


def stopped(tmp_path, samples, target, after=7):
    """A run that ends by an error of its caller after some tiles."""

    class Stop(Exception):
        pass

    def progress(done, total):
        if done == after:
            raise Stop

    with pytest.raises(Stop):
        tiles.refine_to(samples, target, 2, method=METHOD, progress=progress)
    assert Path(f"{target}.partial").is_dir()


def test_other_settings_or_input_are_not_resumed(tmp_path, samples):
    target = tmp_path / "fine.zarr"
    stopped(tmp_path, samples, target)
    other = samples.copy()
    other[3, 4] += 1
    for source, settings, said in (
        (samples, {"method": cf.LocalFairing()}, "method.iterations was 0 and is 3"),
        (samples, {"spacing": 2.0}, "spacing was"),
        (samples, {"dtype": "float32"}, "precision was"),
        (samples[:-1], {}, "shape of the input was"),
        (other, {}, "content of the input was"),
    ):
        with pytest.raises(InputError, match=said):
            refined(source, target, resume=True, **settings)
    with pytest.raises(InputError, match="an unfinished run is in"):
        refined(samples, target)
    seen = []
    outcome = tiles.refine_to(
        samples, target, 2, method=METHOD, resume=True, progress=lambda *counts: seen.append(counts)
    )
    assert outcome.resumed == 7
    assert seen[0] == (7, 24)
    assert seen[-1] == (24, 24)
    np.testing.assert_array_equal(
        zarr.open_array(target)[:], refined(samples, tmp_path / "undisturbed.zarr")
    )


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("done", lambda data: b""),
        ("done", lambda data: data[:-1]),
        ("done", lambda data: bytes([7]) + data[1:]),
        ("done", None),
        ("data.npy", lambda data: data[:-1]),
        ("data.npy", lambda data: b"\0" * len(data)),
        ("settings.json", lambda data: data[:9]),
    ],
)
def test_a_damaged_run_is_not_resumed(tmp_path, samples, name, damage):
    target = tmp_path / "fine.npy"
    stopped(tmp_path, samples, target)
    path = tmp_path / "fine.npy.partial" / name
    data = path.read_bytes()
    path.unlink()
    if damage is not None:
        path.write_bytes(damage(data))
    for _ in range(2):
        with pytest.raises(InputError, match=rf"{name}: .*delete .*partial to start afresh"):
            refined(samples, target, resume=True)
    assert not target.exists()
    path.write_bytes(data)
    refined(samples, target, resume=True)


def test_a_full_disk_keeps_what_is_there(tmp_path, samples):
    target = tmp_path / "fine.npy"
    np.save(target, np.zeros(3))
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        for name, size in (("fine.npy", 20000), ("fine.zarr", 1500)):
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
            with pytest.raises(InputError, match=r"cannot be written \(File too large") as caught:
                tiles.refine_to(samples, tmp_path / name, 2, method=METHOD)
            assert "\n" not in str(caught.value)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
        signal.signal(signal.SIGXFSZ, handler)
    np.testing.assert_array_equal(np.load(target), np.zeros(3))
    refined(samples, target, resume=True)
    refined(samples, tmp_path / "fine.zarr", resume=True)


def test_read_only_and_taken_targets(tmp_path, samples):
    with pytest.raises(InputError, match="may not be written to"):
        tiles.refine_to(samples, "/proc/self/fine.zarr", 2, method=METHOD)
    (tmp_path / "taken.zarr").mkdir()
    (tmp_path / "taken.zarr" / "mine.txt").write_text("x")
    with pytest.raises(InputError, match="folder of something else"):
        tiles.refine_to(samples, tmp_path / "taken.zarr", 2, method=METHOD)


def test_one_process_at_a_time(tmp_path, samples):
    def progress(done, total):
        if done == 3:
            with pytest.raises(InputError, match="another process is writing it"):
                tiles.refine_to(samples, target, 2, method=METHOD, resume=True)

    target = tmp_path / "fine.npy"
    tiles.refine_to(samples, target, 2, method=METHOD, progress=progress)


def test_an_interrupted_end_is_finished(tmp_path, samples, monkeypatch):
    target = tmp_path / "fine.zarr"
    first = refined(samples, target)

    def rename(*names):
        if Path(names[0]).name == "data.zarr":
            raise KeyboardInterrupt
        return replace(*names)

    replace = os.replace
    monkeypatch.setattr(os, "replace", rename)
    with pytest.raises(KeyboardInterrupt):
        tiles.refine_to(samples + 1, target, 2, method=METHOD)
    monkeypatch.setattr(os, "replace", replace)
    assert not target.exists()
    second = refined(samples + 1, target, resume=True)
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(second, refined(samples + 1, tmp_path / "undisturbed.zarr"))


def environment(**settings):
    """For processes that import the package as this one does."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **settings}


@pytest.mark.slow
def test_the_command_line_works_in_tiles(tmp_path, samples, capsys):
    affine = np.array([[-30.0, 0, 4e6], [0, 20.0, 5e5], [0, 0, 1]])
    values = samples.astype("float32")
    values[2, 3] = np.nan
    grid = Grid(values, affine=affine, crs="EPSG:32633", units="m", missing=np.isnan(values))
    source, target, plain = (tmp_path / name for name in ("in.zarr", "out.zarr", "out.npz"))
    write(source, grid)
    call = ["upsample", str(source), "--factor", "2", "--iterations", "0", "-o"]
    assert main([*call, str(plain)]) == 0
    capsys.readouterr()
    assert main([*call, str(target), "--resume", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["shape"], said["type"]) == ([61, 83], "float32")
    assert said["missing"] == np.isnan(read(plain).values).sum()
    note = "missing samples: 1 of 1302 (0.1%); they and the cells beside them stay missing"
    assert note in said["notes"]
    whole, tiled = read(plain), read(target)
    np.testing.assert_allclose(tiled.values, whole.values, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(tiled.values[::2, ::2], values)
    np.testing.assert_allclose(tiled.affine, whole.affine)
    assert "UTM zone 33N" in (tiled.crs or "") or tiled.crs == "EPSG:32633"
    assert (tiled.units, tiled.axes) == ("m", grid.axes)
    with xr.open_zarr(target, chunks=None) as data:  # no warning of missing consolidated metadata
        assert {"x", "y", "data"} <= set(data.variables)
    assert main([*call, str(tmp_path / "out.npy"), "--memory", "2", "-q"]) == 0
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), tiled.values)


def test_a_finished_output_is_not_computed_again(tmp_path, samples, capsys, monkeypatch):
    """Unless it is of other samples, or of another shape; and each is told."""
    monkeypatch.chdir(tmp_path)
    np.save("in.npy", samples)
    call = ["upsample", "in.npy", "--iterations", "0", "-o", "out.npy", "--resume"]
    assert main([*call, "-f", "2"]) == 0
    assert "there is no unfinished run, so all is computed" in capsys.readouterr().err
    first = os.stat("out.npy").st_mtime_ns
    assert main([*call, "-f", "2"]) == 0
    out, err = capsys.readouterr()
    assert "the output is there, whole, from an earlier run" in err
    assert out == "out.npy: 61 x 83 float64\n"
    assert os.stat("out.npy").st_mtime_ns == first
    os.utime("in.npy", (first / 1e9 + 10,) * 2)
    for factor, shape in ((2, (61, 83)), (3, (91, 124))):
        assert main([*call, "-f", str(factor)]) == 0
        assert "so all is computed" in capsys.readouterr().err
        assert np.load("out.npy").shape == shape


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["in.npy", "-o", "out.png", "--resume"], "outputs in .zarr and .npy"),
        (["in.npy", "-o", "out.zarr", "--workers", "0"], "--workers must be 1 or more"),
        (["in.npy", "-o", "in.npy", "--resume"], "is the input"),
        (["in.zarr", "-o", "in.zarr/out.zarr"], "lies in the input"),
        (["in.npy", "-o", "out.zarr", "--key", "zz"], "there is no 'zz' to choose"),
        (["complex.npy", "-o", "out.zarr"], "holds complex numbers"),
        (["text.npy", "-o", "out.zarr"], "holds <U3 values"),
        (["fields.npy", "-o", "out.zarr"], "real numbers are needed"),
        (["days.npy", "-o", "out.zarr"], "holds timedelta64[D] values"),
        (["complex.zarr", "-o", "out.zarr"], "holds complex numbers"),
        (["damaged.zarr", "-o", "out.zarr"], "damaged.zarr: cannot be read as Zarr: Zstd"),
        (["huge.zarr", "-o", "out.zarr"], "the disk has room for"),
        (["huge.zarr", "-o", "out.npy", "--workers", "2"], "the disk has room for"),
        (["bomb.zarr", "-o", "out.zarr"], "has chunks of 2.2 GiB for 400 bytes"),
        (["in.npy", "-o", "out.zarr", "-f", "1000000"], "take a smaller --factor"),
        (["gap.npy", "-o", "out.zarr"], "every sample is missing"),
        (["in.npy", "-o", "out.zarr", "--memory", "0.1"], "memory must be at least"),
        (["in.npy", "-o", "out.png", "--memory", "1"], "outputs in .zarr and .npy"),
        (["absent.zarr", "-o", "out.zarr"], "there is no such file"),
        (["bad.zarr", "-o", "out.zarr"], "cannot be read as Zarr"),
        (["row.npy", "-o", "out.zarr"], "fairing needs at least 3"),
        (["short.npy", "-o", "out.zarr"], "is truncated"),
        (["in.npy", "-o", "out.zarr", "-m", "best"], "method must be one of"),
    ],
)
def test_bad_calls_end_in_one_line(tmp_path, samples, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    np.save("in.npy", samples)
    np.save("row.npy", samples[:1])
    np.save("complex.npy", samples + 1j)
    np.save("text.npy", samples.astype("U3"))
    np.save("fields.npy", np.zeros(samples.shape, [("a", "f4"), ("b", "i4")]))
    np.save("days.npy", samples.astype("m8[D]"))
    for name, values in {"in.zarr": samples, "complex.zarr": samples + 1j}.items():
        zarr.create_array(name, data=values, chunks=(16, 16))
    shutil.copytree("in.zarr", "damaged.zarr")
    Path("damaged.zarr/c/1/1").write_bytes(Path("in.zarr/c/1/1").read_bytes()[:20])
    zarr.create_array("huge.zarr", shape=(10**9, 10**9), chunks=(10, 10), dtype="f8")
    zarr.create_array("bomb.zarr", shape=(10, 10), chunks=(20000, 30000), dtype="f4")
    np.save("gap.npy", np.full(SHAPE, np.nan))
    Path("short.npy").write_bytes(Path("in.npy").read_bytes()[:500])
    Path("bad.zarr").mkdir()
    Path("bad.zarr/zarr.json").write_text("{")
    assert main(["upsample", *arguments]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert said in lines[0]
    assert not list(tmp_path.rglob("out*"))


def start(source, target, workers, cache):
    """A process that refines slowly, with a compile cache; it is about to when this returns."""
    command = [sys.executable, str(WORKER), "refine", str(source), str(target), str(workers)]
    settings = environment(
        JAX_COMPILATION_CACHE_DIR=str(cache), JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS="0"
    )
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=settings,
    )
    assert process.stdout.readline() == "begins\n"
    return process


def ended(process):
    """Wait for a process that is left to end."""
    _, said = process.communicate(timeout=200)
    assert process.returncode == 0, said


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("suffix", "workers", "kills"),
    [
        (".zarr", 1, 3),
        pytest.param(".zarr", 1, 25, marks=pytest.mark.slow),
        pytest.param(".npy", 1, 25, marks=pytest.mark.slow),
        pytest.param(".zarr", 2, 6, marks=pytest.mark.slow),
    ],
)
def test_kills_lose_nothing(tmp_path, samples, suffix, workers, kills, record_property):
    """Killed at any time from the making of the output to its last renaming, then resumed."""
    source, target = tmp_path / "source.npy", tmp_path / f"fine{suffix}"
    np.save(source, samples)
    undisturbed = refined(samples, tmp_path / f"undisturbed{suffix}")

    def check():
        stored = np.load(target) if suffix == ".npy" else zarr.open_array(target)[:]
        np.testing.assert_array_equal(stored, undisturbed)

    ended(start(source, tmp_path / f"first{suffix}", workers, tmp_path / "cache"))
    process, began = start(source, target, workers, tmp_path / "cache"), time.monotonic()
    ended(process)
    span = time.monotonic() - began
    check()
    chance, count = random.Random(SEED), 0
    while count < kills:
        process = start(source, target, workers, tmp_path / "cache")
        try:
            process.wait(chance.uniform(0, span))
        except subprocess.TimeoutExpired:
            process.kill()
            count += 1
            process.communicate()
        else:  # it was faster: the next one starts afresh
            ended(process)
            check()
            shutil.rmtree(target) if target.is_dir() else target.unlink()
    ended(start(source, target, workers, tmp_path / "cache"))
    check()
    assert not list(tmp_path.rglob("*partial*"))
    record_property("kills", count)


@pytest.fixture
def four_devices(monkeypatch):
    flags = os.environ.get("XLA_FLAGS", "")
    monkeypatch.setenv("XLA_FLAGS", f"{flags} --xla_force_host_platform_device_count=4")


def on_mesh(tmp_path, samples, what, *more):
    np.save(tmp_path / "samples.npy", samples)
    command = [sys.executable, str(WORKER), what, str(tmp_path / "samples.npy"), *more]
    done = subprocess.run(command, capture_output=True, text=True, timeout=250, env=environment())
    assert done.returncode == 0, done.stderr
    return [float(text) for text in done.stdout.split()]


@pytest.mark.slow
def test_four_devices_agree_with_one(tmp_path, samples, four_devices):
    devices, from_tiles, from_whole = on_mesh(tmp_path, samples, "mesh", "values")
    assert devices == 4
    assert from_tiles == 0
    assert from_whole < 1e-13


@pytest.mark.slow
def test_explicit_axes_are_as_good(tmp_path, samples, four_devices):
    assert on_mesh(tmp_path, samples, "explicit") == [4, 0, 4, 0]


@pytest.mark.slow
def test_gradient_from_four_devices(tmp_path, samples, four_devices):
    assert on_mesh(tmp_path, samples, "mesh", "gradient")[0] < 1e-11


@pytest.mark.slow
def test_two_processes_are_one_machine(tmp_path, samples):
    np.save(tmp_path / "samples.npy", samples)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, str(WORKER), "pair", str(tmp_path / "samples.npy"), str(port)]
    pair = [
        subprocess.Popen([*command, number], stdout=-1, stderr=-1, text=True, env=environment())
        for number in "01"
    ]
    said = [process.communicate(timeout=250) for process in pair]
    assert [process.returncode for process in pair] == [0, 0], said
    assert all("equal 2 1" in out for out, _ in said)
