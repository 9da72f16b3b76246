"""Command line of the benchmarks."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markdown import Markdown
from rich.progress import Progress

from benchmarks.common import engine, report
from benchmarks.common.report import Result, Track
from benchmarks.endurance import reliability, tiles
from benchmarks.quality import (
    accuracy,
    contours,
    gains,
    holes,
    inverse,
    leaves,
    noise,
    protocols,
    real,
    robustness,
    seams,
    surfaces,
    synthetic,
)
from benchmarks.speed import cost, gpu, machine, memory, parts, table2, targets, upsampling

HERE = Path(__file__).resolve().parent
DOCUMENTS = (
    HERE.parent / "README.md",
    *sorted((HERE.parent / "docs").rglob("*.md")),
    HERE / "README.md",
)
app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)


class Subject(StrEnum):
    """What a benchmark is about."""

    SPEED = "speed"
    QUALITY = "quality"
    ENDURANCE = "endurance"


@dataclass(frozen=True)
class Benchmark:
    """One command: how to run it, how to print it, its precision, and its subject.

    `timed` says that a table about quality shows seconds of the clock as well.
    """

    run: Callable[..., Result]
    tables: Callable[[Result], dict[str, str]]
    x64: bool
    about: str
    subject: Subject = Subject.QUALITY
    timed: bool = False

    @property
    def shared(self) -> bool:
        """Whether it may run while others run."""
        return self.subject is Subject.QUALITY and not self.timed


BENCHMARKS = {
    "machine": Benchmark(
        machine.run, machine.tables, False, "Rates of the machine.", Subject.SPEED
    ),
    "accuracy": Benchmark(accuracy.run, accuracy.tables, True, "Errors on analytic fields."),
    "real2d": Benchmark(real.run, real.tables, True, "Real 2-D fields, half the samples dropped."),
    "real3d": Benchmark(
        partial(real.run, ndim=3), real.tables, True, "Real volumes, half the samples dropped."
    ),
    "synthetic": Benchmark(
        synthetic.run, synthetic.tables, True, "Made-up fields, every fourth sample kept."
    ),
    "protocols": Benchmark(protocols.run, protocols.tables, True, "Disks, ridges, normals."),
    "robustness": Benchmark(
        robustness.run, robustness.tables, True, "Overshoot, NaN, seams, crossing lines."
    ),
    "holes": Benchmark(holes.run, holes.tables, True, "Missing samples filled."),
    "noise": Benchmark(noise.run, noise.tables, True, "Noisy samples smoothed."),
    "inverse": Benchmark(
        inverse.run,
        inverse.tables,
        True,
        "Contours to DEM, missing slices, scattered points.",
        timed=True,
    ),
    "contours": Benchmark(
        contours.run, contours.tables, contours.X64, "Contours proved, beside contourpy (minutes)."
    ),
    "surfaces": Benchmark(
        surfaces.run, surfaces.tables, True, "Isosurfaces of real volumes.", timed=True
    ),
    "leaves": Benchmark(
        leaves.run, leaves.tables, True, "Adaptive grids beside uniform ones.", timed=True
    ),
    "table2": Benchmark(table2.run, table2.tables, False, "The paper's Table 2.", Subject.SPEED),
    "cost": Benchmark(cost.run, cost.tables, False, "Time against size (minutes).", Subject.SPEED),
    "upsampling": Benchmark(
        upsampling.run,
        upsampling.tables,
        upsampling.X64,
        "Engine and peers, time against size.",
        Subject.SPEED,
    ),
    "targets": Benchmark(
        targets.run, targets.tables, False, "Ratios to reach; --short.", Subject.SPEED
    ),
    "parts": Benchmark(
        parts.run, parts.tables, False, "Where the time of fairing goes.", Subject.SPEED
    ),
    "memory": Benchmark(memory.run, memory.tables, False, "Peak memory (minutes).", Subject.SPEED),
    "gpu": Benchmark(gpu.run, gpu.tables, gpu.X64, "Times on a GPU; --short.", Subject.SPEED),
    "tiles": Benchmark(
        tiles.run, tiles.tables, False, "Larger than memory; --size.", Subject.ENDURANCE
    ),
    "seams": Benchmark(seams.run, seams.tables, seams.X64, "Tiles against the whole grid."),
    "reliability": Benchmark(
        reliability.run,
        reliability.tables,
        True,
        "Kills and damaged files survived (minutes).",
        Subject.ENDURANCE,
    ),
}


@contextmanager
def _tracker(quiet: bool) -> Iterator[Track]:
    with Progress(console=Console(stderr=True), disable=quiet, transient=True) as progress:

        def track(items: Sequence[Any], description: str) -> Iterable[Any]:
            return progress.track(items, description=description)

        yield track


def _run_one(name: str, quiet: bool, store: bool = True, **options: Any) -> None:
    benchmark = BENCHMARKS[name]
    engine.use_x64(benchmark.x64)
    start = time.perf_counter()
    with _tracker(quiet) as track:
        result = benchmark.run(track, **options)
    result["took_s"] = time.perf_counter() - start
    path = report.save(name, result) if store else None
    if not quiet:
        _show(name, result if path is None else None)
        if path is not None:
            took = f"{result['took_s']:.0f} s"
            typer.echo(f"wrote {path.relative_to(Path.cwd())} after {took}", err=True)


def _show(name: str, result: Result | None = None) -> None:
    """Print the tables of a result, or of the one that is stored."""
    for title, table in BENCHMARKS[name].tables(result or report.load(name) or {}).items():
        Console().print(Markdown(f"**{title}**\n\n{table}"))


def _command(name: str, benchmark: Benchmark) -> None:
    def command(quiet: Annotated[bool, typer.Option(help="Print nothing.")] = False) -> None:
        _run_one(name, quiet)

    app.command(name, help=benchmark.about)(command)


def _command_with_short(name: str, benchmark: Benchmark) -> None:
    def command(
        short: Annotated[bool, typer.Option(help="Small grids; nothing is stored.")] = False,
        quiet: Annotated[bool, typer.Option(help="Print nothing.")] = False,
    ) -> None:
        _run_one(name, quiet, store=not short, short=short)

    app.command(name, help=benchmark.about)(command)


for _name, _benchmark in BENCHMARKS.items():
    if _name in ("gpu", "targets"):
        _command_with_short(_name, _benchmark)
    elif _name != "tiles":
        _command(_name, _benchmark)


@app.command("tiles", help=BENCHMARKS["tiles"].about)
def run_tiles(
    size: Annotated[int, typer.Option(help="Samples along each of two axes.")] = 2048,
    workers: Annotated[int, typer.Option(help="Processes.")] = 2,
    method: Annotated[str, typer.Option(help="local or global.")] = "local",
    quiet: Annotated[bool, typer.Option(help="Print nothing.")] = False,
) -> None:
    """Refine a large grid in tiles."""
    _run_one("tiles", quiet, size=size, workers=workers, method=method)


@app.command("all")
def run_all(
    subject: Annotated[Subject | None, typer.Argument(help="Only those about this.")] = None,
    quiet: Annotated[bool, typer.Option(help="Print nothing.")] = False,
) -> None:
    """Run every benchmark but `gpu`, each in a process of its own, then rewrite the tables.

    Those that take times run alone, the others on all cores.
    """
    shared: list[str] = []
    for name, benchmark in BENCHMARKS.items():
        if name == "gpu" or subject not in (None, benchmark.subject):  # not all have a GPU
            continue
        if benchmark.shared:
            shared.append(name)
        else:
            _run_apart(name, quiet)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        running = [pool.submit(_run_apart, name, True) for name in shared]
        for name, done in zip(shared, running, strict=True):
            done.result()
            if not quiet:
                _show(name)
    write_tables(check=False)


def _run_apart(name: str, quiet: bool) -> None:
    """In a process of its own."""
    flags = ["--quiet"] if quiet else []
    subprocess.run([sys.executable, "-m", "benchmarks", name, *flags], check=True)


def all_tables() -> dict[str, str]:
    """Every table whose result is stored."""
    tables: dict[str, str] = {}
    for name, benchmark in BENCHMARKS.items():
        result = report.load(name)
        if result is not None:
            tables |= benchmark.tables(result)
    summary = gains.table()
    return tables if summary is None else tables | {"gains": summary}


@app.command("tables")
def write_tables(
    paths: Annotated[
        list[Path] | None, typer.Argument(help="Markdown with the markers; all documents if none.")
    ] = None,
    check: Annotated[bool, typer.Option(help="Change nothing; fail where out of date.")] = False,
) -> None:
    """Rewrite the tables between `<!-- table:NAME -->` and `<!-- end -->` from stored results."""
    tables = all_tables()
    for path in paths or DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        fresh = report.replace_tables(text, tables)
        if check and fresh != text:
            typer.echo(f"{path} is out of date: run python -m benchmarks tables", err=True)
            raise typer.Exit(1)
        if not check:
            path.write_text(fresh, encoding="utf-8")
    times = report.load("upsampling")
    if times is not None and not check:
        upsampling.draw(times).savefig(upsampling.PICTURE, dpi=120)


if __name__ == "__main__":
    app()
