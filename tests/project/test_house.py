"""How the package is laid out: floors, circles, sizes, what is imported early; see CONTRIBUTING."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from helpers import ROOT

PACKAGE = ROOT / "contourfair_jax"

# Imports go down only: to a smaller number, or within a package.
FLOORS = (
    ("_version",),
    ("_support",),
    ("_bezier", "_grid"),
    ("_fairing", "io", "_level_sets"),
    ("contours", "isosurface"),
    ("_vtk",),
    ("adaptive",),
    ("_field", "export"),
    ("_fair", "_resample", "geometry", "plot"),
    ("metrics", "inverse", "tiles"),
    ("",),
    ("xarray", "cli"),
    ("demo", "__main__"),
)
FLOOR = {name: number for number, names in enumerate(FLOORS) for name in names}
MOST_LINES, FEWEST_LINES, MOST_MODULES = 500, 40, 12
# Importing these must not import JAX; nor these rich, VTK, optimistix and lineax.
WITHOUT_JAX = (
    "_support.errors",
    "_support.memory",
    "_support.results",
    "_grid.grid",
    "_grid.affine",
    "_grid.missing",
    "_grid.periodic",
    "_grid.reference",
    "_grid.resample",
    "_bezier.linear",
    "io",
    "plot",
    "cli",
)
LIGHT = ("_fair", "contours", "isosurface", "_fairing.tuning", "adaptive", "metrics", "tiles")


@cache
def modules() -> dict[str, Path]:
    """The file of every module, by its name within the package."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imports() -> list[tuple[str, str]]:
    """Pairs of a module and one that it imports, annotations and functions included."""
    known, pairs = modules(), []
    for name, path in known.items():
        parts = name.split(".") if name else []
        package = parts if path.name == "__init__.py" else parts[:-1]
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.ImportFrom) or not node.level:
                continue
            base = package[: len(package) - node.level + 1]
            target = ".".join([*base, *(node.module.split(".") if node.module else [])])
            for alias in node.names:
                inner = f"{target}.{alias.name}".strip(".")
                pairs.append((name, inner if inner in known else target))
    return pairs


def test_every_room_is_on_a_floor():
    assert {name.split(".")[0] for name in modules()} == set(FLOOR)


def test_imports_go_down():
    upwards = [
        pair
        for pair in imports()
        for here, there in [[name.split(".")[0] for name in pair]]
        if here not in (there, "") and FLOOR[there] >= FLOOR[here]
    ]
    assert not upwards


def test_nothing_is_imported_in_a_circle():
    needs = {name: {there for here, there in imports() if here == name} for name in modules()}
    # The names of the whole package are imported lazily, by text.
    needs[""] = set()
    open_ = dict(needs)
    while done := [name for name, of in open_.items() if not of & (open_.keys() - {name})]:
        for name in done:
            del open_[name]
    assert not open_


def test_absolute_names_of_the_package_are_not_imported_within():
    for name, path in modules().items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and not node.level:
                assert (node.module or "").split(".")[0] != "contourfair_jax", name


@pytest.mark.parametrize("name", sorted(modules()))
def test_size_of_a_file(name):
    lines = modules()[name].read_text().splitlines()
    assert len(lines) <= MOST_LINES
    if modules()[name].name != "__init__.py" and len(lines) < FEWEST_LINES:
        # A small room says in its first line why it is one.
        assert ", alone because" in lines[0]


def test_few_modules_lie_outside_of_packages():
    assert len(list(PACKAGE.glob("*.py"))) <= MOST_MODULES


def test_an_underscore_stands_once_on_a_path():
    for name in modules():
        private = [part for part in name.split(".") if part.startswith("_") and part != "__main__"]
        assert len(private) <= 1, name


def test_data_classes_are_frozen():
    for name, path in modules().items():
        for node in ast.walk(ast.parse(path.read_text())):
            for made in node.decorator_list if isinstance(node, ast.ClassDef) else ():
                if "dataclass" in ast.unparse(made):
                    assert "frozen=True" in ast.unparse(made), (name, node.name)


def test_benchmarks_import_private_names_in_one_place():
    users = {
        path.name
        for path in (ROOT / "benchmarks").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("contourfair_jax")
        if any(part.startswith("_") for part in f"{node.module}.".split(".")[1:])
        or any(alias.name.startswith("_") for alias in node.names)
    }
    assert users == {"inside.py"}


def loaded(module: str) -> set[str]:
    """Top-level packages that importing a module of the package brings."""
    code = f"import sys, contourfair_jax.{module}; print(*{{n.split('.')[0] for n in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize("module", WITHOUT_JAX)
def test_what_imports_without_jax(module):
    assert not loaded(module) & {"jax", "equinox", "matplotlib", "vtkmodules"}


@pytest.mark.parametrize("module", LIGHT)
def test_what_imports_without_more(module):
    assert not loaded(module) & {"rich", "vtkmodules", "optimistix", "lineax", "matplotlib"}
