"""The default path calls no LAPACK, and so cannot hang in it; the README says why that matters."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import hang_worker
import jax
import pytest
from helpers import ROOT
from packaging.specifiers import SpecifierSet
from packaging.version import Version

import contourfair_jax as cf

WORKER = ROOT / "tests" / "workers" / "hang_worker.py"
# A hang never ends; compilation on a busy machine takes a minute.
LIMIT = 240
METHODS = [name for name in hang_worker.METHODS if name != "lu"]
SMALL = ("small", "local")
OTHERS = [(k, m) for k in hang_worker.KINDS for m in METHODS if (k, m) != SMALL]


def finish(kind: str, method: str, jax_folder: Path | None = None, processes: int = 1) -> str:
    """The version of JAX under which the worker finished, in so many processes at once.

    Fails if one did not.
    """
    folders = [str(ROOT)] if jax_folder is None else [str(jax_folder), str(ROOT)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    command = [sys.executable, str(WORKER), kind, method]
    running = [
        subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(processes)
    ]
    versions = set()
    try:
        for process in running:
            said, errors = process.communicate(timeout=LIMIT)
            assert process.returncode == 0, errors
            word, version = said.split()
            assert word == "done"
            versions.add(version)
    except subprocess.TimeoutExpired:
        pytest.fail(f"{method} fairing ({kind}) still ran after {LIMIT} s: it hangs")
    finally:
        for process in running:
            process.kill()
            process.communicate()
    (version,) = versions
    return version


@pytest.mark.slow
@pytest.mark.timeout(LIMIT + 30)
def test_default_path_does_not_hang():
    assert finish(*SMALL) == jax.__version__


@pytest.mark.slow
@pytest.mark.timeout(2 * LIMIT + 30)
@pytest.mark.parametrize("method", METHODS)
def test_two_processes_at_once_do_not_hang(method):
    assert finish("small", method, processes=2) == jax.__version__


@pytest.mark.slow
@pytest.mark.timeout(LIMIT + 30)
@pytest.mark.parametrize(("kind", "method"), OTHERS)
def test_no_method_hangs(kind, method):
    assert finish(kind, method) == jax.__version__


def pip(*arguments: str, seconds: float = 300) -> subprocess.CompletedProcess:
    """Run pip of this environment."""
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=seconds)


def other_versions() -> list[str]:
    """Releases of JAX for this Python in the supported range, and 0.10.2, which users may have."""
    listed = pip("index", "versions", "jax")
    found = re.search(r"^Available versions: (.+)$", listed.stdout, re.MULTILINE)
    if listed.returncode != 0 or found is None:
        pytest.skip(f"pip reaches no registry: {listed.stderr.strip()[-200:]}")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (requirement,) = [line for line in project["dependencies"] if re.match(r"jax\b", line)]
    supported = SpecifierSet(requirement.removeprefix("jax"))
    available = found.group(1).split(", ")
    wanted = [text for text in available if text in supported or text == "0.10.2"]
    return sorted({*wanted} - {jax.__version__}, key=Version)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_default_path_does_not_hang_on_other_releases_of_jax(tmp_path):
    versions = other_versions()
    if not versions:
        pytest.skip(f"no other supported release of JAX can be installed, only {jax.__version__}")
    tried = []
    for version in versions:
        folder = tmp_path / version
        target = ["--target", str(folder), "--no-deps", "--quiet"]
        installed = pip("install", *target, f"jax=={version}", f"jaxlib=={version}")
        if installed.returncode == 0:
            assert finish("plane", "local", folder) == version
            tried.append(version)
    print("finished with JAX", ", ".join(tried))
    if not tried:
        pytest.skip(f"pip installed none of JAX {', '.join(versions)}")


def custom_calls(method, shape) -> set[str]:
    """Foreign functions that forward and gradient call by name."""

    def loss(values):
        return cf.fair_field(values, method=method).control_points.sum()

    lowered = jax.jit(jax.value_and_grad(loss)).lower(jax.ShapeDtypeStruct(shape, "float32"))
    return set(re.findall(r"custom_call @(\w+)", lowered.as_text()))


@pytest.mark.slow
@pytest.mark.both_precisions
@pytest.mark.parametrize("shape", [(6, 5), (4, 5, 6)])
@pytest.mark.parametrize("method", METHODS)
def test_no_foreign_calls(method, shape):
    assert custom_calls(hang_worker.METHODS[method](), shape) == set()


def test_foreign_calls_are_found():
    # What the tests above look for is there where a solver does call LAPACK.
    calls = custom_calls(cf.LocalFairing(solver=cf.LU()), (6, 5))
    assert any("lapack" in name for name in calls)
