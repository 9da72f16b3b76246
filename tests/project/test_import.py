"""What importing the package, asking for help and reading files load, and what they do not."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import contourfair_jax as cf

HEAVY = {"jax", "equinox", "matplotlib", "rasterio", "xarray", "PIL", "scipy", "pandas"}

# Runs in a process of its own: here the tests themselves have loaded everything.
LOADED = """
import contextlib, io, sys
with contextlib.redirect_stdout(io.StringIO()):
    {code}
print(*({heavy} & set(sys.modules)))
"""


def loaded_by(code: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", LOADED.format(code=code, heavy=HEAVY)],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "code",
    [
        "import contourfair_jax",
        "import contourfair_jax.io",
        "from contourfair_jax.cli import main; assert main(['--help']) == 0",
        "from contourfair_jax.cli import main; assert main(['upsample', '--help']) == 0",
        "from contourfair_jax.cli import main; assert main(['--version']) == 0",
        "from contourfair_jax.io import example; example()",
    ],
)
def test_nothing_heavy_is_imported(code):
    assert loaded_by(code) == set()


def test_jax_is_imported_with_the_first_name():
    assert "jax" in loaded_by("import contourfair_jax as cf; cf.fair_field")


def test_every_public_name_comes_from_its_module():
    assert set(cf.__all__) == set(cf._MODULE_OF)
    assert set(cf.__all__) <= set(dir(cf))
    for name, home in cf._MODULE_OF.items():
        assert getattr(cf, name) is getattr(import_module(f"contourfair_jax.{home}"), name)


@pytest.mark.parametrize("name", cf._MODULES)
def test_public_modules_are_attributes(name):
    assert name in dir(cf)
    assert getattr(cf, name).__name__ == f"contourfair_jax.{name}"


def test_type_checkers_see_the_same_names():
    lines = Path(cf.__file__).read_text().splitlines()
    seen = {line.split(" as ")[1]: line.split()[1] for line in lines if line.startswith("    from")}
    modules = dict.fromkeys(cf._MODULES, ".")
    assert seen == {name: f".{home}" for name, home in cf._MODULE_OF.items()} | modules


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'fair_fields'"):
        _ = cf.fair_fields
    with pytest.raises(ImportError):
        from contourfair_jax import fair_fields  # noqa: F401
