"""Examples of the documents run, links lead somewhere, tables are those of the results."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT
from typer.testing import CliRunner

import contourfair_jax as cf
from contourfair_jax import demo
from contourfair_jax.io import example, read

README = ROOT / "README.md"
PAGES = [README, *sorted((ROOT / "docs").rglob("*.md"))]
"""Those whose examples run."""
OTHERS = ["CONTRIBUTING.md", "CHANGELOG.md", "benchmarks/README.md", "notebooks/README.md"]
DOCUMENTS = [*PAGES, *(ROOT / name for name in OTHERS)]


def name_of(document: Path) -> str:
    return document.relative_to(ROOT).as_posix()


def text_of(document: Path) -> str:
    return document.read_text(encoding="utf-8")


def blocks(document: Path, language: str) -> list[str]:
    """The code blocks in a language, in order."""
    pattern = rf"^```{language}\n(.*?)^```"
    return re.findall(pattern, text_of(document), re.MULTILINE | re.DOTALL)


def commands(document: Path) -> list[list[str]]:
    """The lines of the blocks for the shell, as words."""
    return [shlex.split(line) for block in blocks(document, "sh") for line in block.splitlines()]


WITH_EXAMPLES = [page for page in PAGES if blocks(page, "python")]
WITH_COMMANDS = [page for page in PAGES if commands(page)]
WITH_TABLES = [each for each in DOCUMENTS if re.search(r"^<!-- table:", text_of(each), re.M)]


def run(script: str, folder: Path) -> str:
    """Output of a Python script that starts as a user's would, with x64 off."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "JAX_ENABLE_X64": "0"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_readme_is_short():
    assert len(text_of(README).splitlines()) <= 200


def test_examples_are_found():
    assert {name_of(page) for page in WITH_EXAMPLES} >= {"README.md", "docs/methods.md"}
    assert {name_of(page) for page in WITH_COMMANDS} >= {"README.md", "docs/command-line.md"}
    assert {name_of(each) for each in WITH_TABLES} >= {"README.md", "benchmarks/README.md"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["README.md", "docs/fields.md"])
def test_first_example_prints_the_shapes_that_it_says(tmp_path, name):
    first = blocks(ROOT / name, "python")[0]
    printed = run(first, tmp_path)
    shown = re.findall(r"\(\d+, \d+\)", " ".join(re.findall(r"# (.*)", first)))
    assert len(shown) == 2
    assert all(text in printed for text in shown)


def test_the_example_of_the_accessor_prints_what_it_says(tmp_path):
    files = ROOT / "docs" / "files.md"
    (example,) = (block for block in blocks(files, "python") if "fair.upsample" in block)
    assert "'lat': 41, 'lon': 61" in run(example, tmp_path)


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=name_of)
def test_commands_read_what_was_written_before(page):
    scripts = "".join(blocks(page, "python"))
    there = set(re.findall(r"\b(?:write|np\.save)\(\"([^\"]+)\"", scripts))
    for command in commands(page):
        assert command[0] == "contourfair"
        written = command[command.index("-o") + 1] if "-o" in command else ""
        named = {word for word in command if re.search(r"\.[a-z]+$", word)} - {written}
        assert named, command
        assert named <= there, command
        there.add(written)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=name_of)
def test_examples_and_commands_run(page, tmp_path):
    for script in blocks(page, "python"):
        run(script, tmp_path)
    calls = [command[1:] for command in commands(page)]
    if calls:
        checks = "".join(f"assert main({call!r}) == 0\n" for call in calls)
        run(f"from contourfair_jax.cli import main\n{checks}", tmp_path)
    for call in calls:
        if "-o" in call:
            assert (tmp_path / call[call.index("-o") + 1]).stat().st_size > 1000


def anchors(text: str) -> set[str]:
    """What links to the headings of a page are called."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def links(document: Path) -> list[str]:
    """The links of a document to files beside it."""
    return [link for link in re.findall(r"\]\(([^)]+)\)", text_of(document)) if "://" not in link]


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_links_lead_somewhere(document):
    for link in links(document):
        name, _, heading = link.partition("#")
        target = document.parent / name if name else document
        assert target.exists(), link
        assert not heading or heading in anchors(text_of(target)), link


def test_the_readme_leads_to_every_document():
    linked = {(ROOT / link.partition("#")[0]).resolve() for link in links(README)}
    assert linked >= set(DOCUMENTS) - {README}


def test_files_named_to_contributors_exist():
    named = re.findall(r"`([\w.-]+(?:/[\w.-]*)+|_\w+\.py)`", text_of(ROOT / "CONTRIBUTING.md"))
    assert len(named) >= 40
    places = [ROOT, ROOT / "contourfair_jax"]
    absent = [name for name in named if not any((place / name).exists() for place in places)]
    assert not absent


def test_every_table_has_a_result():
    from benchmarks import __main__ as suite

    assert set(WITH_TABLES) <= set(suite.DOCUMENTS)
    made = suite.all_tables()
    for document in WITH_TABLES:
        for name, first in re.findall(r"^<!-- table:(\S+) -->\n(.)", text_of(document), re.M):
            assert first == "|", name
            assert name in made


def test_tables_are_those_of_the_results():
    command = [sys.executable, "-m", "benchmarks", "tables", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def targets_of(document: Path) -> set[str]:
    """What the document tells to make."""
    named = re.findall(r"(?:^    |`)make ([a-z-]+(?: [a-z-]+)*)", text_of(document), re.MULTILINE)
    return set(" ".join(named).split())


def test_make_targets_exist():
    there = set(re.findall(r"^([a-z-]+):", text_of(ROOT / "Makefile"), re.MULTILINE))
    assert targets_of(README) >= {"demo", "test", "bench"}
    assert set.union(*map(targets_of, DOCUMENTS)) <= there
    hooks = text_of(ROOT / ".pre-commit-config.yaml")
    entries = re.findall(r"^ +entry: (.+)$", hooks, re.MULTILINE)
    assert entries == ["make lint", "make types"]
    assert "://" not in hooks


def test_the_version_is_the_same_everywhere():
    citation = text_of(ROOT / "CITATION.cff")
    assert re.search(r"^version: (.+)$", citation, re.MULTILINE).group(1) == cf.__version__
    assert f"\n## {cf.__version__}\n" in text_of(ROOT / "CHANGELOG.md")


def test_documents_are_in_the_source_distribution():
    content = tomllib.loads(text_of(ROOT / "pyproject.toml"))
    packed = content["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    for each in (*DOCUMENTS, ROOT / "CITATION.cff", ROOT / ".pre-commit-config.yaml"):
        assert each.relative_to(ROOT).parts[0] in packed


def test_pictures_are_small():
    pictures = list((ROOT / "notebooks" / "pictures").glob("*.png"))
    assert pictures
    assert all(picture.stat().st_size < 300_000 for picture in pictures)


@pytest.mark.slow
def test_demo_shows_what_fairing_does(tmp_path, capsys):
    grid = example().crop([(0, 90), (0, 403)])
    with demo.float_width(single=False):
        rows, written = demo.run(grid, tmp_path, demo.METHODS, demo.Reporter(quiet=True))
    bilinear, faired = rows["bilinear"], [rows[name] for name in ("local", "global")]
    assert bilinear.slope_jump > 0.1
    for row in rows.values():
        assert row.sample_error < 1e-9
    for row in faired:
        assert row.slope_jump < 1e-12
        assert row.contours < bilinear.contours
        assert row.turns < bilinear.turns
        assert row.bending < 0.7 * bilinear.bending
    finer, lines, figure = written
    stored = read(finer)
    assert stored.shape == (4 * 89 + 1, 4 * 402 + 1)
    np.testing.assert_array_equal(stored.values[::4, ::4], grid.values)
    assert lines.stat().st_size > 10_000
    assert figure.stat().st_size > 10_000


def test_demo_says_what_is_wrong(tmp_path):
    file = tmp_path / "file"
    file.touch()
    result = CliRunner().invoke(demo.app, ["--folder", str(file), "--quiet"])
    assert result.exit_code == 2
    assert "Traceback" not in result.output
