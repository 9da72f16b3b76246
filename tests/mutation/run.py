"""Mutants: small changes of the code that some test is to notice.

cosmic-ray finds the places and makes the changes; this program draws some of them, runs the tests
on each in a copy of the tree, and tells which survive::

    python tests/mutation/run.py --mutants 20 --seed 0 _bezier contours

Places are drawn first and a change at each place second: else most mutants would be binary
operators, of which each has eleven changes.  `--mutants 0` takes all changes at all places.

The tests nearest to a package run first; see `cosmic-ray.toml`.  With `--rest` the other fast tests
run on what survives them.  A run that takes longer than the limit there counts as killed.  Tests
that fail without any change are told and left out.

Left out by rule are changes that no test should notice: within annotations, signatures but for
their defaults, docstrings and other texts (messages and their numbers), statements that raise or
warn, aliases of types, imports, and what is for type checkers only; and changes that do not compile
or leave the program the same.

`--work` keeps cosmic-ray's databases in a folder, so that an interrupted run goes on, and `--retry`
runs the tests again on those that survived.
"""

import argparse
import ast
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from cosmic_ray.commands import init
from cosmic_ray.modules import find_modules
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import (
    MutationSpec,
    TestOutcome,
    WorkerOutcome,
    WorkItem,
    WorkResult,
)

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = tomllib.loads((Path(__file__).parent / "cosmic-ray.toml").read_text(encoding="utf-8"))
PACKAGES = SETTINGS["packages"]
LIMIT = SETTINGS["cosmic-ray"]["timeout"]
NOT_COPIED = shutil.ignore_patterns(".git", ".venv", "__pycache__", "*.egg-info", ".hypothesis")
# As in the Makefile: compile quickly, one thread, keep what is compiled.
ENVIRONMENT = {
    "JAX_ENABLE_X64": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false",
    "JAX_COMPILATION_CACHE_DIR": str(ROOT / ".venv" / "compiled"),
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1",
    "PYTHONDONTWRITEBYTECODE": "1",
}
# Imported once, before every run of tests is started as a copy of that process.
PRELOADED = ["jax", "equinox", "scipy.spatial", "scipy.ndimage", "skimage.measure", "beartype"]


def main() -> int:
    """Draw, test, tell."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("packages", nargs="*", metavar="package", help=", ".join(PACKAGES))
    parser.add_argument("--mutants", type=int, default=25, help="of each package; 0 for all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rest", action="store_true", help="all fast tests on what survives")
    parser.add_argument("--retry", action="store_true", help="test again what survived")
    parser.add_argument("--work", type=Path, help="folder to keep the databases in")
    options = parser.parse_args()
    unknown = set(options.packages) - set(PACKAGES)
    if unknown:
        parser.error(f"unknown packages: {', '.join(sorted(unknown))}")
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    with tempfile.TemporaryDirectory() as temporary:
        tree, work = Path(temporary) / "tree", options.work or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        work = work.resolve()
        shutil.copytree(ROOT, tree, ignore=NOT_COPIED)
        os.chdir(tree)
        rows = [run_package(name, work, options) for name in options.packages or PACKAGES]
    print("\npackage      mutants  killed  survived")
    for name, killed, total in rows:
        print(f"{name:12s} {total:7d} {killed:7d} {total - killed:9d}")
    killed, total = sum(row[1] for row in rows), sum(row[2] for row in rows)
    print(f"killed: {killed} of {total}, {100 * killed / max(total, 1):.0f} %")
    return 0


# Drawing ----------------------------------------------------------------------------------


def run_package(name: str, work: Path, options: argparse.Namespace) -> tuple[str, int, int]:
    """Name, mutants killed, and mutants tested, of one package."""
    with use_db(str(work / f"{name}-{options.mutants}-{options.seed}.sqlite")) as database:
        if not database.num_work_items:
            draw(database, name, options.mutants, options.seed)
        if options.retry:
            for item, result in database.completed_work_items:
                if result.test_outcome == TestOutcome.SURVIVED:
                    database.set_result(item.job_id, WorkResult(WorkerOutcome.NO_TEST))
        again = {WorkerOutcome.NO_TEST}
        results = dict(database.results)
        pending = [
            item
            for item in sorted(database.work_items, key=place_of)
            if item.job_id not in results or results[item.job_id].worker_outcome in again
        ]
        stages = [tuple(PACKAGES[name]["tests"]), *[("tests",)] * options.rest]
        failing = [failures(stage) for stage in stages if pending]
        print(f"{name}: {len(pending)} mutants to test", flush=True)
        for number, item in enumerate(pending, 1):
            begin = time.monotonic()
            database.set_result(item.job_id, result := tested(item, stages, failing))
            took = time.monotonic() - begin
            outcome = result.test_outcome.value if result.test_outcome else "?"
            print(f"{name} {number}/{len(pending)} {outcome:8s} {took:4.0f} s  {told(item)}")
            print(f"    {result.output}", flush=True)
        done = [
            (item, result)
            for item, result in sorted(database.completed_work_items, key=lambda x: place_of(x[0]))
            if result.worker_outcome == WorkerOutcome.NORMAL
        ]
    for item, result in done:
        if result.test_outcome == TestOutcome.SURVIVED:
            print(f"\nsurvived: {told(item)}\n{result.diff}")
    killed = sum(result.test_outcome == TestOutcome.KILLED for _, result in done)
    return name, killed, len(done)


def draw(database: WorkDB, name: str, count: int, seed: int) -> None:
    """All mutants of a package as work items; those that are not drawn are marked as skipped."""
    modules = sorted(find_modules([Path("contourfair_jax") / name]))
    init(modules, database, {})
    items = sorted(database.work_items, key=place_of)
    left_out = {path: excluded(path.read_text(encoding="utf-8")) for path in modules}
    counted = [
        item
        for item in items
        if not any(
            begin <= item.mutations[0].start_pos < end
            for begin, end in left_out[item.mutations[0].module_path]
        )
    ]
    rng = random.Random(seed)
    if count:
        places: dict[tuple, list[WorkItem]] = {}
        for item in counted:
            places.setdefault(place_of(item)[:2], []).append(item)
        chosen: list[WorkItem] = []
        for place in rng.sample(sorted(places), len(places)):
            if len(chosen) == count:
                break
            at_place = rng.sample(places[place], len(places[place]))
            chosen += [item for item in at_place if mutated(item.mutations[0])[1]][:1]
    else:
        chosen = [item for item in counted if mutated(item.mutations[0])[1]]
    kept = {item.job_id for item in chosen}
    skipped = [item.job_id for item in items if item.job_id not in kept]
    database.set_multiple_results(skipped, WorkResult(WorkerOutcome.SKIPPED))
    print(f"{name}: {len(items)} mutants, {len(counted)} not left out, {len(kept)} drawn")


def place_of(item: WorkItem) -> tuple:
    """Where a mutant is, and which it is there; the numbers of items are random."""
    (spec,) = item.mutations
    return str(spec.module_path), spec.start_pos, spec.operator_name, spec.occurrence


def mutated(spec: MutationSpec) -> tuple[str, str | None]:
    """Source before and after; None where it does not compile, or is the same program."""
    source = spec.module_path.read_text(encoding="utf-8")
    operator = get_operator(spec.operator_name)(**spec.operator_args)
    changed = mutate_code(source, operator, spec.occurrence)
    try:
        same = changed is None or ast.dump(ast.parse(changed)) == ast.dump(ast.parse(source))
    except SyntaxError:
        return source, None
    return source, None if same else changed


def excluded(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """From where to where a module holds what is left out by rule; see above."""
    found = []

    def leave_out(node: ast.AST | None) -> None:
        if node is not None:
            found.append(((node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)))

    tree = ast.parse(source)
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(args=args, body=body):
                defaults = [*args.defaults, *(x for x in args.kw_defaults if x)]
                begin = (node.lineno, node.col_offset)
                for default in sorted(defaults, key=lambda x: (x.lineno, x.col_offset)):
                    found.append((begin, (default.lineno, default.col_offset)))
                    begin = (default.end_lineno, default.end_col_offset)
                found.append((begin, (body[0].lineno, body[0].col_offset)))
            case ast.AnnAssign(annotation=annotation):
                leave_out(annotation)
            case ast.Raise() | ast.JoinedStr() | ast.Import() | ast.ImportFrom():
                leave_out(node)
            case ast.Call(func=ast.Attribute(attr="warn")):
                leave_out(node)
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                leave_out(node)
    for node in tree.body:
        match node:
            case ast.Assign(value=ast.BinOp(op=ast.BitOr()) | ast.Subscript()):
                leave_out(node)
            case ast.Assign(value=ast.Call(func=ast.Name(id="TypeVar"))):
                leave_out(node)
    return found


def told(item: WorkItem) -> str:
    """File, line, change."""
    (spec,) = item.mutations
    operator = spec.operator_name.removeprefix("core/")
    return f"{spec.module_path}:{spec.start_pos[0]}:{spec.start_pos[1] + 1} {operator}"


# Testing ----------------------------------------------------------------------------------


@contextmanager
def in_place(spec: MutationSpec) -> Iterator[str]:
    """The copy of the tree with one mutant; gives the lines that differ."""
    source, changed = mutated(spec)
    if changed is None:
        raise ValueError(f"no such mutant: {spec}")
    spec.module_path.write_text(changed, encoding="utf-8")
    old, new = source.splitlines(), changed.splitlines()
    lines = [f"-{a}\n+{b}" for a, b in zip(old, [*new, *old[len(new) :]], strict=False) if a != b]
    try:
        yield "\n".join(lines)
    finally:
        spec.module_path.write_text(source, encoding="utf-8")


def tested(item: WorkItem, stages: list[tuple[str, ...]], failing: list[list[str]]) -> WorkResult:
    """Run the stages until one fails."""
    with in_place(item.mutations[0]) as diff:
        for stage, known in zip(stages, failing, strict=True):
            outcome, told_by = run_tests(stage, "-x", *(f"--deselect={test}" for test in known))
            if outcome != "passed":
                return WorkResult(WorkerOutcome.NORMAL, told_by, TestOutcome.KILLED, diff)
    return WorkResult(WorkerOutcome.NORMAL, "no test noticed", TestOutcome.SURVIVED, diff)


@cache
def failures(paths: tuple[str, ...]) -> list[str]:
    """Tests that fail without any change."""
    outcome, told_by = run_tests(paths)
    if outcome == "timeout":
        sys.exit(f"{' '.join(paths)}: the tests take longer than the limit without any change")
    failing = told_by.splitlines() if outcome == "failed" else []
    for test in failing:
        print(f"fails without any change, left out: {test}", flush=True)
    return failing


def run_tests(paths: tuple[str, ...], *options: str) -> tuple[str, str]:
    """How a run ended ("passed", "failed", "timeout"), and the tests that failed, one a line."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    log = Path("failed-tests.log").absolute()
    log.unlink(missing_ok=True)
    process = context.Process(target=_pytest, args=(os.getcwd(), paths, options, str(log)))
    process.start()
    process.join(LIMIT)
    if process.is_alive():
        process.kill()
        process.join()
        return "timeout", "time limit"
    if not log.exists():
        sys.exit(f"pytest did not start:\n{Path(f'{log}.txt').read_text(encoding='utf-8')}")
    failed = log.read_text(encoding="utf-8").strip()
    return ("passed" if process.exitcode == 0 else "failed"), failed or "an error of pytest"


class _Failed:
    """A plugin of pytest that writes down what fails."""

    def __init__(self, path: str) -> None:
        self.path = path

    def pytest_sessionstart(self) -> None:
        Path(self.path).touch()

    def pytest_runtest_logreport(self, report) -> None:
        if report.failed:
            self._note(report.nodeid)

    def pytest_collectreport(self, report) -> None:
        if report.failed:
            self._note(report.nodeid)

    def _note(self, name: str) -> None:
        with open(self.path, "a", encoding="utf-8") as file:
            print(name, file=file)


def _pytest(tree: str, paths: tuple[str, ...], options: tuple[str, ...], log: str) -> None:
    """In a process of its own: run the fast tests; what they print goes beside the log."""
    import pytest

    os.chdir(tree)
    sys.path.insert(0, tree)
    os.environ["PYTHONPATH"] = tree
    output = os.open(f"{log}.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    fixed = ["-q", "-p", "no:cacheprovider", "-m", "not slow and not data", "--timeout=120"]
    fixed += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # what is preloaded is no test
    code = pytest.main([*paths, *options, *fixed], plugins=[_Failed(log)])
    sys.stdout.flush()
    os._exit(int(code))


if __name__ == "__main__":
    sys.exit(main())
