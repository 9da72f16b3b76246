"""The lock file fits the project: every requirement is in it, pinned, from no named place."""

import re
import tomllib

from helpers import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")


def locked() -> dict[str, set[Version]]:
    """Versions by name; a package may have several, for different releases of Python."""
    found: dict[str, set[Version]] = {}
    for name, version in re.findall(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)", LOCK, re.MULTILINE):
        found.setdefault(canonicalize_name(name), set()).add(Version(version))
    return found


def requirements() -> list[Requirement]:
    """What the project, its extras and the groups of `dev` ask for."""
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project = content["project"]
    lines = [*project["dependencies"], *content["build-system"]["requires"]]
    for extra in project["optional-dependencies"].values():
        lines += extra
    groups = content["dependency-groups"]
    for group in groups["dev"]:
        lines += groups[group["include-group"]]
    parsed = [Requirement(line) for line in lines]
    return [each for each in parsed if canonicalize_name(each.name) != project["name"]]


def test_every_requirement_is_locked():
    versions = locked()
    for requirement in requirements():
        pinned = versions.get(canonicalize_name(requirement.name), set())
        assert pinned, f"{requirement.name} is not in the lock file: run make lock"
        assert all(version in requirement.specifier for version in pinned), requirement


def test_every_package_has_hashes_and_no_address():
    entries = re.split(r"^(?=[a-z0-9])", LOCK, flags=re.MULTILINE)[1:]
    assert len(entries) >= len(locked())
    assert all("--hash=sha256:" in entry for entry in entries)
    assert not re.search(r"https?:|file:|--index|--find-links", LOCK)


def test_the_extra_for_meshes_has_two_names():
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = content["project"]["optional-dependencies"]
    assert extras["mesh"] == ["contourfair-jax[vtk]"]
    assert any(line.startswith("vtk") for line in extras["vtk"])
