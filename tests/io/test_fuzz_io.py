"""Damaged files of every format end in one line: no traceback, no crash, no hang.

Hundreds of files per format are cut, flipped and overwritten at random, and read one after the
other by the code that the child process of `read` runs, in a process with the same limits.  A
file that kills or stalls that process is then given to the command line, which must say so in a
line.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from file_helpers import UP, ccp4, cube, samples, slices
from helpers import SEED

from contourfair_jax.cli import main
from contourfair_jax.io import FORMATS, Format, Grid, _isolate, write
from contourfair_jax.io._table import NAMELESS_FOLDER

SECONDS = 20

# Reads the files that it is told of, a line each: module, reader, path; answers in JSON.
BATCH = """
import json, os, signal, sys
sys.path[:] = json.loads(sys.argv[1])
from importlib import import_module
from pathlib import Path
from contourfair_jax.io import InputError, _worker

def late(*_):
    print(json.dumps("late"), flush=True)
    os._exit(0)  # a library may swallow an exception raised here, and go on

signal.signal(signal.SIGALRM, late)
_worker._limit_memory()
for line in sys.stdin:
    module, reader, path = line.rstrip("\\n").split("\\t")
    read = getattr(import_module("contourfair_jax.io.formats." + module), reader)
    signal.alarm(int(sys.argv[2]))
    try:
        grid = read(Path(path), None)
        said = "read " + grid.values.dtype.kind + str(grid.values.size)
    except Exception as error:
        said = "refused " + _worker._fault(error)["error"]
    signal.alarm(0)
    print(json.dumps(said), flush=True)
"""

WHOLE = {
    ".nhdr": b"NRRD0004\ntype: short\ndimension: 3\nsizes: 6 5 4\nspacings: 1 2 3\n"
    b"endian: little\nencoding: raw\ndata file: whole.raw\n",
    ".mhd": b"ObjectType = Image\nNDims = 3\nDimSize = 6 5 4\nElementSpacing = 1 2 3\n"
    b"ElementType = MET_SHORT\nElementByteOrderMSB = False\nElementDataFile = whole.raw\n",
    ".asc": b"ncols 4\nnrows 3\nxllcorner 10\nyllcorner 20\ncellsize 5\nNODATA_value -9\n"
    b"1 2 3 4\n5 6 -9 8\n9 10 11 12\n",
    ".cube": cube(),
    ".ccp4": ccp4(),
}


def usgs_dem(columns: int = 3, rows: int = 5) -> bytes:
    """A digital elevation model of a few points, in records of 1024 characters."""

    def numbers(*values: float) -> str:
        return "".join(f"{value:24.15E}".replace("E", "D") for value in values)

    right, top = 30.0 * columns, 30.0 * rows
    head = "A HILL".ljust(144) + "     1     1     1    10" + numbers(*[0.0] * 15)
    head += "     2     2     4" + numbers(0, 0, 0, top, right, top, right, 0, 1, 99, 0)
    head += f"     10.300000E+020.300000E+020.100000E+01     1{columns:6d}"
    profiles = [
        f"     1{k + 1:6d}{rows:6d}     1"
        + numbers(30.0 * k, 0.0, 0.0, 1.0, 99.0)
        + "".join(f"{10 * k + j:6d}" for j in range(rows))
        for k in range(columns)
    ]
    return "".join(record.ljust(1024) for record in (head, *profiles)).encode()


def make(row, folder: Path) -> Path:
    """A small whole file of a format."""
    suffix = row.suffixes[0] if row.suffixes else ""
    path = folder / f"whole{suffix}"
    affine = np.diag([2.0, 1.5, 0.5, 1.0])
    if row.writer and suffix not in WHOLE:
        flat = Grid(samples("uint8", (9, 11)), affine=affine[1:, 1:], crs="EPSG:32633")
        solid = Grid(samples("float32", (4, 5, 6)), affine=affine, units="m", nodata=-9999.0)
        write(path, flat if suffix in (".png", ".tif") else solid)
    elif suffix == ".dem":
        path.write_bytes(usgs_dem())
    elif suffix == ".dcm":
        shutil.copy(next(slices(folder / "one", UP[:1]).iterdir()), path)
    elif row is NAMELESS_FOLDER:
        slices(path, UP[1:4:2])
    else:
        path.write_bytes(WHOLE[suffix])
    return path


def damaged(whole: bytes, rng: np.random.Generator, kind: int) -> bytes:
    """The bytes cut, or with bits flipped, or overwritten: anywhere, or in the first 600."""
    if kind == 0 or not whole:
        return whole[: rng.integers(0, max(len(whole), 1))]
    data = np.frombuffer(whole, np.uint8).copy()
    end = min(len(data), 600) if kind % 2 else len(data)
    where = rng.integers(0, end, rng.integers(1, 9))
    if kind < 3:
        data[where] ^= (1 << rng.integers(0, 8, len(where))).astype(np.uint8)
    else:
        data[where] = rng.choice(np.frombuffer(b'\x00\xff\x7f\x80 09-.\n"{', np.uint8), len(where))
    return data.tobytes()


def damage(row, whole: Path, folder: Path, rng: np.random.Generator, count: int) -> list[Path]:
    """`count` damaged copies; of a folder one file is damaged, or missing."""
    made = []
    for k in range(count):
        target = folder / f"{k:04d}"
        target.mkdir()
        shutil.copy(whole.parent / "whole.raw", target)
        path = target / whole.name
        if row.folder:
            shutil.copytree(whole, path)
            files = sorted(each for each in path.rglob("*") if each.is_file())
            victim = files[rng.integers(len(files))]
        else:
            shutil.copy(whole, path)
            victim = path
        if row.folder and k % 10 == 9:
            victim.unlink()
        else:
            victim.write_bytes(damaged(victim.read_bytes(), rng, k % 5))
        made.append(path)
    return made


def batch(files: list[tuple[Format, Path]]) -> list[str | None]:
    """What was said about every file: None where the process died, ``late`` where it stalled."""
    said: list[str | None] = []
    command = [sys.executable, "-P", "-c", BATCH, json.dumps(sys.path), str(SECONDS)]
    while len(said) < len(files):
        rest = files[len(said) :]
        done = subprocess.run(
            command,
            input="".join(f"{row.module}\t{row.reader}\t{path}\n" for row, path in rest),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            timeout=280,
        )
        answers = [json.loads(line) for line in done.stdout.split("\n") if line.startswith('"')]
        said += answers
        if len(answers) < len(rest) and answers[-1:] != ["late"]:
            said.append(None)
    return said


def classic(path: Path, kind: str) -> None:
    """A NetCDF file of an older format."""
    data = xr.Dataset({"t": (("y", "x"), samples("float32", (9, 11)), {"units": "K"})})
    data = data.assign_coords(y=np.arange(9.0), x=np.arange(11.0))
    packing = {"dtype": "int16", "scale_factor": 0.5, "_FillValue": -1}
    data.to_netcdf(path, engine="netcdf4", format=kind, encoding={"t": packing})


# Further kinds of files of a format: the name of its row, the name of a file, how to make it.
KINDS = {
    "classic NetCDF": ("NetCDF", "whole.nc", lambda path: classic(path, "NETCDF3_CLASSIC")),
    "CDF-5": ("NetCDF", "whole.nc", lambda path: classic(path, "NETCDF3_64BIT_DATA")),
    "compressed NIfTI": ("NIfTI", "whole.nii.gz", lambda path: write(path, Grid(samples()))),
    "plain Zarr": ("Zarr", "whole.zarr", lambda path: zarr.save_array(path, samples())),
}
ROWS = {row.name: row for row in (*FORMATS, NAMELESS_FOLDER)}


def prepare(kind: str, folder: Path, count: int) -> tuple[Format, Path, list[Path]]:
    """The format, a whole file and `count` damaged ones, which depend on the seed only."""
    folder.mkdir()
    if kind in KINDS:
        name, file, maker = KINDS[kind]
        row, whole = ROWS[name], folder / file
        maker(whole)
    else:
        row = ROWS[kind]
        whole = make(row, folder)
    (folder / "whole.raw").write_bytes(samples("int16").tobytes())
    (folder / "damaged").mkdir()
    rng = np.random.default_rng([SEED, *kind.encode()])
    return row, whole, damage(row, whole, folder / "damaged", rng, count)


def check(kind: str, row: Format, paths: list[Path], said: list[str | None]) -> list[Path]:
    """One line about every file; those that killed the process, which must be their own."""
    refused = [text for text in said if text is not None and text.startswith("refused ")]
    fatal = [path for path, text in zip(paths, said, strict=True) if text in (None, "late")]
    assert all("\n" not in text for text in refused)
    assert len(refused) > len(paths) // 10
    assert row.outside is not None or not fatal
    return fatal


def check_command(paths: list[Path], fatal: list[Path], capsys) -> None:
    """The command line says in one line what is wrong, whatever happens to its child."""
    for path in paths:
        status = main(["info", str(path), "--quiet"])
        lines = capsys.readouterr().err.splitlines()
        assert (status, len(lines)) == (2, 1) or (status == 0 and path not in fatal)
        assert all(line.startswith(f"contourfair: {path}: ") for line in lines)


def test_some_damaged_files_of_every_format_end_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(_isolate, "_PATIENCE", SECONDS)
    made = {kind: prepare(kind, tmp_path / kind, 12) for kind in [*ROWS, *KINDS]}
    said = batch([(row, path) for row, whole, paths in made.values() for path in (whole, *paths)])
    fatal = []
    for kind, (row, _, paths) in made.items():
        first, *some = said[:13]
        said = said[13:]
        assert first is not None
        assert first.startswith("read "), f"{kind}: {first}"
        fatal += check(kind, row, paths, some)
    check_command(fatal[:5], fatal, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*ROWS, *KINDS])
def test_damaged_files_end_in_one_line(tmp_path, monkeypatch, capsys, kind, record_property):
    monkeypatch.setattr(_isolate, "_PATIENCE", SECONDS)
    row, _, paths = prepare(kind, tmp_path / "files", 250)
    fatal = check(kind, row, paths, batch([(row, path) for path in paths]))
    check_command([*fatal[:5], *paths[:3]], fatal, capsys)
    record_property("files", len(paths))
    record_property("fatal to the child", len(fatal))
