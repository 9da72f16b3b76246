"""The README's examples run, links lead somewhere, tables are those of the results."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from contourfair_jax import demo
from contourfair_jax.io import example, read

ROOT = Path(__file__).resolve().parent.parent
READMES = [ROOT / "README.md", ROOT / "benchmarks" / "README.md"]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """The code blocks in a language, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


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


@pytest.mark.slow
def test_first_example_runs(tmp_path):
    first = blocks("python")[0]
    printed = run(first, tmp_path)
    shown = re.findall(r"# (\([\d, ]+\))", first)
    assert len(shown) == 2
    assert all(text in printed for text in shown)


def test_the_example_of_the_accessor_prints_what_it_says(tmp_path):
    (example,) = (block for block in blocks("python") if "fair.upsample" in block)
    assert "'lat': 41, 'lon': 61" in run(example, tmp_path)


def commands() -> list[list[str]]:
    return [shlex.split(line) for block in blocks("sh") for line in block.splitlines()]


def test_commands_read_what_was_written_before():
    there = set(re.findall(r"write\(\"([^\"]+)\"", "".join(blocks("python"))))
    for command in commands():
        written = command[command.index("-o") + 1] if "-o" in command else ""
        named = {word for word in command if re.search(r"\.[a-z]+$", word)} - {written}
        assert named, command
        assert named <= there, command
        there.add(written)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_other_examples_and_commands_run(tmp_path):
    for script in blocks("python")[1:]:
        run(script, tmp_path)
    assert (tmp_path / "dem.tif").exists()
    assert {command[0] for command in commands()} == {"contourfair"}
    calls = "".join(f"assert main({command[1:]!r}) == 0\n" for command in commands())
    run(f"from contourfair_jax.cli import main\n{calls}", tmp_path)
    for command in commands():
        if "-o" in command:
            assert (tmp_path / command[command.index("-o") + 1]).stat().st_size > 1000


def anchors(text: str) -> set[str]:
    """What links to the headings of a page are called."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("readme", READMES, ids=["project", "benchmarks"])
def test_links_lead_somewhere(readme):
    text = readme.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link]
    assert len(links) >= 4
    for link in links:
        name, _, heading = link.partition("#")
        target = readme.parent / name
        assert target.exists(), link
        assert not heading or heading in anchors(target.read_text(encoding="utf-8")), link


@pytest.mark.parametrize("readme", READMES, ids=["project", "benchmarks"])
def test_every_table_has_a_result(readme):
    places = re.findall(r"<!-- table:(\S+) -->\n(.)", readme.read_text(encoding="utf-8"))
    assert len(places) >= 3
    assert all(first == "|" for _, first in places)


def test_make_targets_exist():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"(?:^    |`)make ([a-z-]+)", TEXT, re.MULTILINE))
    assert named >= {"demo", "test", "bench"}
    assert named <= targets


def test_tables_are_those_of_the_results():
    command = [sys.executable, "-m", "benchmarks", "tables", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_pictures_are_small():
    pictures = list((ROOT / "notebooks" / "pictures").glob("*.png"))
    assert pictures
    assert all(picture.stat().st_size < 300_000 for picture in pictures)


@pytest.mark.slow
def test_demo_shows_what_fairing_does(tmp_path, capsys):
    grid = example().crop([(0, 90), (0, 403)])
    with demo.precision(single=False):
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
