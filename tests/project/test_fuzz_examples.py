"""Any bytes, and any words on the command line, end in a result or in one line: no traceback.

Beside the damaged files of `test_fuzz_io`, which are read by a child process, this is about the
readers that run in this one, and about options.  The engine is left out: every field is one that
was found before.
"""

import io
import os
import re
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from file_helpers import ccp4, cube
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import contourfair_jax as cf
from contourfair_jax import cli
from contourfair_jax.io import Grid, InputError, read, write

FEW = settings(
    max_examples=150, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
MANY = settings(FEW, max_examples=1000)
EFFORTS = [FEW, pytest.param(MANY, marks=pytest.mark.slow)]


def stored(suffix: str, folder: Path) -> bytes:
    path = folder / f"whole{suffix}"
    values = np.arange(20.0).reshape(4, 5).astype("uint8" if suffix == ".png" else "float32")
    write(path, Grid(values, spacing=(2.0, 1.0), units="m"))
    return path.read_bytes()


def words_of_npy(shape: object, kind: object) -> bytes:
    """A header that says anything, before a few samples."""
    stream = io.BytesIO()
    header = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape!r}, }}\n".encode()
    stream.write(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(99))
    return stream.getvalue()


@st.composite
def damage(draw, whole: bytes) -> bytes:
    """The bytes with some replaced by others, of another length perhaps; or cut."""
    data = whole
    for _ in range(draw(st.integers(0, 4))):
        start = draw(st.integers(0, len(data)))
        stop = start + draw(st.sampled_from([0, 1, 2, 4, 30]))
        data = data[:start] + draw(st.binary(max_size=6)) + data[stop:]
    return data[: draw(st.integers(0, len(data)))] if draw(st.integers(0, 3)) == 0 else data


HEADERS = st.builds(
    words_of_npy,
    st.one_of(st.lists(st.integers(-2, 2**63), max_size=4).map(tuple), st.none(), st.text()),
    st.sampled_from(["<f4", ">i8", "|O", "<U9", "|V3", "<c8", "", "<f99", [("a", "<f4")], 7]),
)


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("suffix", [".npy", ".npz", ".png", ".cube", ".ccp4"])
def test_any_bytes_are_read_or_refused_in_one_line(tmp_path, suffix, effort):
    whole = {".cube": cube, ".ccp4": ccp4}.get(suffix, lambda: stored(suffix, tmp_path))()
    kinds = [damage(whole), st.binary(max_size=300)] + [HEADERS] * (suffix == ".npy")
    path = tmp_path / f"any{suffix}"

    @effort
    @given(st.one_of(kinds), st.sampled_from([None, "data", "z=1", "t=0,x=1:", "1", ""]))
    def check(data, key):
        path.write_bytes(data)
        try:
            said = None if read(path, key).values.size else "nothing"
        except InputError as error:
            said = str(error)
        assert said is None or (said.startswith(f"{path}: ") and len(said.splitlines()) == 1)

    check()


COMMANDS = re.split(r"\s", "info upsample resample contours compare isosurface adaptive metrics")
FLAGS = re.split(r"\s", "-q --quiet --json --float32 --fill --filled --help --version --nope --")
NUMBERS = re.split(r"\s", "0 1 2 3 -1 0.5 1e-9 1e400 nan inf 9999999999999999999 x 1,2 50,100 , : ")
INPUTS = re.split(r"\s", "in.npy volume.npy gaps.npz text.npy folder.npy absent.npy no/in.npy . /")
FILES = [
    *INPUTS,
    *(f"o{suffix}" for suffix in (".npy", ".tif", ".svg", ".csv", ".geojson", ".vtp", ".vtu")),
    *("o.png", "o.xyz", ".npy", "\udcff.npy", 300 * "a", 300 * "a" + ".npy", ""),
]
VALUES = {
    "-o": FILES,
    "--output": FILES,
    "--plot": FILES,
    "--factor": NUMBERS,
    "--spacing": NUMBERS,
    "--like": INPUTS,
    "--like-key": ["data", "t=0", "1", ""],
    "--sigma": [*NUMBERS, "auto", "Auto "],
    "--periodic": ["x", "y", "x,y", "q", ",", ""],
    "--levels": NUMBERS,
    "--interval": NUMBERS,
    "--count": NUMBERS,
    "--level": NUMBERS,
    "--tolerance": NUMBERS,
    "--iterations": NUMBERS,
    "--thin-plate-weight": NUMBERS,
    "--workers": ["0", "1", "-1", "x"],
    "--method": ["local", "global", "tune", "best", ""],
    "--crop": ["all", "0:5,0:5", "5:1,0:3", "::", "1:99,0:3", ",", ""],
    "--key": ["data", "t=0", "=", ",", "x=1:", "1", "", "=,=", "a,b=c"],
}
# No argument of a program holds a zero byte.
TEXTS = st.text(st.characters(exclude_characters="\0"), max_size=8)
OPTIONS = st.one_of(
    st.sampled_from(FLAGS).map(lambda flag: [flag]),
    st.sampled_from([*VALUES]).flatmap(
        lambda name: st.sampled_from(VALUES[name]).map(lambda value: [name, value])
    ),
    TEXTS.map(lambda text: [text]),
)
CALLS = st.tuples(
    st.sampled_from(COMMANDS),
    st.one_of(st.sampled_from(FILES), TEXTS),
    st.one_of(st.just([]), st.sampled_from(FILES).map(lambda name: ["-o", name])),
    st.lists(OPTIONS, max_size=4).map(lambda options: [*chain.from_iterable(options)]),
).map(lambda parts: [parts[0], parts[1], *parts[2], *parts[3]])


@pytest.fixture
def fields(monkeypatch):
    """In the place of fairing: a field of the right shape, or a refusal."""
    made = {}

    def found(grid, *_):
        if grid.ndim != 2 or grid.shape != (5, 6):
            raise InputError("is not what this test is about")
        if not made:
            made["it"] = cf.fair_field(np.add.outer(np.arange(5.0) ** 2, np.arange(6.0)))
        return made["it"]

    for module in ("_compare", "_upsample", "_steps", "_metrics"):
        monkeypatch.setattr(f"contourfair_jax.cli.{module}.fair", found)


@pytest.mark.usefixtures("fields")
@pytest.mark.parametrize("effort", EFFORTS)
def test_any_call_ends_in_a_result_or_in_one_line(tmp_path, monkeypatch, capsys, effort):
    monkeypatch.chdir(tmp_path)
    np.save("in.npy", np.add.outer(np.arange(5.0) ** 2, np.arange(6.0)))
    np.save("volume.npy", np.zeros((3, 3, 3)))
    np.savez("gaps.npz", data=np.where(np.eye(5, 6), np.nan, 1.0), more=np.ones((2, 2)))
    Path("text.npy").write_text("hello")
    os.mkdir("folder.npy")

    @effort
    @given(CALLS)
    def check(arguments):
        code = cli.main(arguments)
        said = capsys.readouterr().err
        assert code in (0, 2), (arguments, said)
        assert "Traceback" not in said
        assert "internal error" not in said

    check()
