"""Strict settings for every test, checked annotations, seeds, and the folder of real data.

Every annotated function of the package checks what it is given and what it returns: types,
dtypes and the shapes of arrays.

``JAX_ENABLE_X64=1`` (the default here) runs everything; ``JAX_ENABLE_X64=0`` runs only what is
marked ``both_precisions``.  ``CONTOURFAIR_CHECKED=0`` leaves annotations unchecked, as in use: slow
tests run so.  ``CONTOURFAIR_TEST_SEED`` sets the seed of `rng`;
``CONTOURFAIR_DATA`` says where the real data sets are.
"""

import os
from pathlib import Path

os.environ.setdefault("JAX_ENABLE_X64", "1")

import jax
import numpy as np
import pytest
from jaxtyping import install_import_hook

if os.environ.get("CONTOURFAIR_CHECKED", "1") == "1":
    install_import_hook("contourfair_jax", "shape_checks.checked")

from helpers import DATA, SEED

from contourfair_jax import cli

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

MOST_MAPS = 25_000


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "both_precisions: run with x64 on and with x64 off (all others only with it on)"
    )
    config.addinivalue_line("markers", "requires_x64: skipped where x64 is off")


def pytest_report_header():
    return [f"x64: {jax.config.jax_enable_x64}, seed: {SEED}, data: {DATA}"]


def pytest_collection_modifyitems(config, items):
    if jax.config.jax_enable_x64:
        return
    kept = [item for item in items if item.get_closest_marker("both_precisions")]
    left = [item for item in items if not item.get_closest_marker("both_precisions")]
    config.hook.pytest_deselected(items=left)
    items[:] = kept
    for item in items:
        if item.get_closest_marker("requires_x64"):
            item.add_marker(pytest.mark.skip(reason="needs JAX_ENABLE_X64=1"))


@pytest.fixture(scope="session")
def x64() -> bool:
    """Whether 64-bit types are on."""
    return bool(jax.config.jax_enable_x64)


@pytest.fixture
def rng() -> np.random.Generator:
    """A random generator; a failing test prints the seed that repeats it."""
    print(f"CONTOURFAIR_TEST_SEED={SEED}")
    return np.random.default_rng(SEED)


@pytest.fixture
def shared_data() -> Path:
    """The folder of real data sets; mark tests that use it with ``data``."""
    if not DATA.is_dir():
        pytest.skip(f"no real data at {DATA}; set CONTOURFAIR_DATA to the folder that has them")
    return DATA


@pytest.fixture
def run(capsys):
    """Run the command line: exit code, stdout, stderr."""

    def call(*arguments) -> tuple[int, str, str]:
        code = cli.main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture(autouse=True, scope="module")
def few_programs():
    """Let programs go when they are many: a process may only map so many (65530 by default)."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > MOST_MAPS:
        jax.clear_caches()
