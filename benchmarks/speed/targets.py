"""The project's targets of speed, each a ratio of two times taken in one run."""

import functools
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy import ndimage

import contourfair_jax as cf
from benchmarks.common import clock, report
from benchmarks.common.naive import fair_naively
from benchmarks.common.report import Result, Track, size
from benchmarks.speed import machine
from benchmarks.speed.cost import sample_gradient, waves

X64 = False
POINTS = 1_000_000
PRODUCT = 2048  # a size at which a product of matrices reaches the machine's rate
MOST_NAIVE = {2: 256, 3: 14}  # samples per axis, by dimension
LOCAL, GLOBAL = cf.LocalFairing(), cf.GlobalFairing(tolerance=1e-3)
STARTED = "import time; t = time.perf_counter(); import {}; print(time.perf_counter() - t)"


class Compiled(NamedTuple):
    """A program with its samples, and the seconds to trace and compile it."""

    run: Callable[[], Any]
    seconds: float


def _compiled(function: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    return partial(jax.jit(function).lower(*arguments).compile(), *arguments)


@functools.cache
def fairing(shape: tuple[int, ...], method: Any) -> Compiled:
    """Compiled once for all that is timed with it."""
    values = jnp.asarray(waves(shape))
    start = time.perf_counter()
    run = _compiled(lambda v: cf.fair_field(v, method=method), values)
    return Compiled(run, time.perf_counter() - start)


def _inner(shape: tuple[int, ...]) -> int:
    return int(np.prod([n - 2 for n in shape]))


def local_operations(ndim: int, iterations: int = 3, order: int = 4) -> float:
    """Floating-point operations of local fairing per vertex, as the engine does it.

    Products with the parity tables, gradients, forces and a symmetric elimination; what is done
    point by point does not count.  Parity leaves a 2^ndim-th of the points to the assembly.
    """
    fairing, every, pairs = 5**ndim - 3**ndim, 5**ndim, ndim * (ndim + 1) // 2
    points = (2 * order) ** ndim
    entries = fairing * (fairing + 1) // 2
    assembly = 2 * entries * pairs * order**ndim
    gradients = 2 * ndim * points * every
    right = 2 * pairs * points * (3**ndim + fairing)
    return float(iterations * (assembly + gradients + right + fairing**3 / 3))


def global_operations(ndim: int, steps: int, iterations: int = 3) -> float:
    """Floating-point operations of global fairing per sample: products with cells' matrices.

    Every iteration needs one for the right-hand side, one for the first residual and one for the
    normals beside those of its steps.
    """
    return 2.0 * ndim * (ndim + 1) / 2 * 16.0**ndim * (steps + 3 * (iterations + 1))


def operations(field: cf.BezierField) -> float:
    """Floating-point operations of the fit, global if it reports steps, or else local."""
    if field.report is None:
        return local_operations(field.ndim) * _inner(field.shape)
    steps = int(field.report.steps.sum())
    return global_operations(field.ndim, steps) * float(np.prod(field.shape))


def over_roofline(shape: tuple[int, ...], method: Any) -> float:
    """Seconds of fairing over those of its operations at the rate of a large product."""
    product, work = machine.matrix_product(PRODUCT)
    last: list[cf.BezierField] = []

    def fit() -> cf.BezierField:
        last[:] = [fairing(shape, method).run()]
        return last[0]

    return clock.ratio(fit, product) * work / operations(last[0])


def roofline(shape: tuple[int, ...], method: Any, name: str, most: float | None = 3) -> Result:
    """Against the roofline of its own operations."""
    ratio = over_roofline(shape, method)
    return _target(f"{name} {size(shape)}: engine / roofline", ratio, most, "most")


def straightforward(shape: tuple[int, ...], least: float) -> Result:
    """Against local fairing without tricks, per vertex: on a large grid that would take minutes."""
    few = tuple(min(n, MOST_NAIVE[len(shape)]) for n in shape)
    naive = _compiled(fair_naively, jnp.asarray(waves(few)))
    slower = clock.ratio(naive, fairing(shape, LOCAL).run) * _inner(shape) / _inner(few)
    return _target(f"local {size(shape)}: straightforward / engine", slower, least, "least")


def lapack(shape: tuple[int, ...], least: float | None) -> Result:
    """Against the same with LAPACK's solver."""
    lu = fairing(shape, cf.LocalFairing(solver=cf.LU())).run
    slower = clock.ratio(lu, fairing(shape, LOCAL).run)
    return _target(f"local {size(shape)}: with `LU()` / engine", slower, least, "least")


def cubic_zoom(shape: tuple[int, ...]) -> Result:
    """Global fairing against cubic zoom by 4."""
    values = waves(shape)
    zoom = clock.ratio(fairing(shape, GLOBAL).run, lambda: ndimage.zoom(values, 4, order=3))
    return _target(f"global {size(shape)}: engine / ndimage.zoom(3) by 4", zoom, 2, "most")


def volumes(few: tuple[int, ...], many: tuple[int, ...]) -> list[Result]:
    """Global fairing against its roofline; seconds of local fairing, and per sample over those."""
    fields: list[cf.BezierField] = []
    whole = clock.median(lambda: fields.append(fairing(many, GLOBAL).run()) or fields[-1], 1)
    roof = operations(fields[-1]) / machine.rate(PRODUCT)
    seconds = clock.median(fairing(few, LOCAL).run, 1)
    each = seconds / np.prod(few) * np.prod(many) / whole
    name = f"per sample, local {size(few)} / global {size(many)}"
    return [
        _target(f"global {size(many)}: engine / roofline", whole / roof, 3, "most"),
        _target(f"local {size(few)}: s", seconds, 90, "most"),
        _target(name, each, 10, "least"),
    ]


def linear(few: tuple[int, ...], many: tuple[int, ...], method: Any, name: str) -> Result:
    """Time per sample of a large grid against that of a smaller one."""
    longer = clock.ratio(fairing(many, method).run, fairing(few, method).run)
    each = longer * np.prod(few) / np.prod(many)
    return _target(f"{name}: per sample, {size(many)} / {size(few)}", each, 1.15, "most")


def refine(shape: tuple[int, ...]) -> Result:
    """`refine(4)` against linear zoom."""
    field = cf.fair_field(waves(shape), method=cf.GlobalFairing(iterations=0))
    ours = _compiled(lambda f: f.refine(4), field)
    values = waves(shape)
    ratio = clock.ratio(ours, lambda: ndimage.zoom(values, 4, order=1, grid_mode=False))
    return _target(f"refine(4) of {size(shape)}: engine / ndimage.zoom(1)", ratio, 1, "most")


def queries(shape: tuple[int, ...]) -> list[Result]:
    """Value, gradient and Hessian at random points against the value alone of peers."""
    import interpax

    ndim = len(shape)
    field = cf.fair_field(waves(shape), method=cf.GlobalFairing(iterations=0))
    points = np.random.default_rng(0).uniform(0, 1, (POINTS, ndim)) * (np.array(shape) - 1)
    points = jnp.asarray(points, jnp.float32)
    ours = _compiled(lambda f, p: f.jet(p), field, points)
    values, columns = waves(shape), np.asarray(points).T
    spline = clock.ratio(ours, lambda: ndimage.map_coordinates(values, columns, order=3))
    axes = [jnp.arange(n, dtype=jnp.float32) for n in shape]
    function = {2: interpax.interp2d, 3: interpax.interp3d}[ndim]
    evaluate = partial(function, method="cubic")
    peer = _compiled(lambda v, *q: evaluate(*q, *axes, v), jnp.asarray(values), *points.T)
    cubic = clock.ratio(ours, peer)
    name = f"10^6 values, gradients, Hessians in {ndim}-D: engine /"
    return [
        _target(f"{name} values of interpax cubic", cubic, 1, "most"),
        _target(f"{name} values of map_coordinates(3)", spline, 1, "most"),
    ]


def reverse_over_forward(shape: tuple[int, ...], method: Any) -> float:
    """What the gradient of a loss in the samples takes beyond the fairing."""
    return clock.ratio(sample_gradient(shape, method), fairing(shape, method).run) - 1


def reverse(shape: tuple[int, ...], method: Any, name: str) -> Result:
    """The reverse pass against its limit."""
    ratio = reverse_over_forward(shape, method)
    return _target(f"{name} {size(shape)}: reverse pass / forward", ratio, 3.0, "most")


def compilation(shape: tuple[int, ...], method: Any, name: str) -> Result:
    """Seconds to trace and compile."""
    seconds = fairing(shape, method).seconds
    return _target(f"{name} {size(shape)}: compile, s", seconds, 5.0, "most")


def start_up() -> Result:
    """Seconds of the import above JAX's own."""

    def seconds(module: str) -> float:
        command = [sys.executable, "-c", STARTED.format(module)]
        runs = [subprocess.run(command, capture_output=True, check=True) for _ in range(3)]
        return min(float(run.stdout) for run in runs)

    extra = seconds("contourfair_jax; contourfair_jax.fair_field") - seconds("jax")
    return _target("import above JAX's own, s", extra, 1.0, "most")


def run(track: Track = report.silent, short: bool = False) -> Result:
    """All targets; `short` takes small grids, whose ratios say less, and leaves out the slowest."""
    plane, volume = ((256, 256), (24,) * 3) if short else ((1024, 1024), (128,) * 3)
    few, many = ((128, 128), (256, 256)) if short else ((512, 512), (2048, 2048))
    block, cube = ((8,) * 3, (24,) * 3) if short else ((24,) * 3, (64,) * 3)
    jobs: list[Callable[[], list[Result]]] = [
        lambda: [straightforward(block, 8.0)],
        lambda: [roofline(few if short else plane, LOCAL, "local")],
        lambda: [roofline(block, LOCAL, "local")],
        lambda: [cubic_zoom(plane), roofline(plane, GLOBAL, "global", None)],
        lambda: [roofline(volume, GLOBAL, "global")] if short else volumes(cube, volume),
        lambda: [refine(plane), refine(cube)],
        lambda: queries(plane),
        lambda: queries(cube),
        lambda: [linear(few, many, LOCAL, "local"), linear(few, many, GLOBAL, "global")],
        lambda: [reverse(few, LOCAL, "local"), reverse(few, GLOBAL, "global")],
        lambda: [compilation(s, LOCAL, "local") for s in (many, block)],
        lambda: [compilation(s, GLOBAL, "global") for s in (many, volume)],
        lambda: [start_up()],
    ]
    if not short:
        jobs += [
            lambda: [straightforward((256, 256), 5.0)],
            lambda: [lapack(plane, 5.0), lapack(block, None)],
            lambda: [reverse(block, LOCAL, "local"), reverse(cube, GLOBAL, "global")],
        ]
    rows = [row for job in track(jobs, "targets") for row in job()]
    return {"short": short, "rows": rows}


def _target(name: str, measured: float, limit: float | None, kind: str) -> Result:
    reached = limit is None or (measured >= limit if kind == "least" else measured <= limit)
    return {"target": name, "measured": measured, kind: limit, "reached": bool(reached)}


def tables(result: Result) -> dict[str, str]:
    """Measured, asked for, and whether it is reached."""

    def asked(row: Result) -> str | None:
        if row.get("least") is not None:
            return f"≥ {row['least']:g}"
        return f"≤ {row['most']:g}" if row.get("most") is not None else None

    rows = [
        [
            row["target"],
            f"{row['measured']:.3g}",
            asked(row),
            None if asked(row) is None else ("yes" if row["reached"] else "no"),
        ]
        for row in result["rows"]
    ]
    return {"targets": report.table(["target", "measured", "asked", "reached"], rows)}
