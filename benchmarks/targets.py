"""The project's targets of speed, each a ratio of two times taken in one run."""

import functools
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy import ndimage

import contourfair_jax as cf
from benchmarks import clock, machine, report
from benchmarks.cost import sample_gradient, waves
from benchmarks.naive import fair_naively
from benchmarks.report import Result, Track, size

X64 = False
POINTS = 1_000_000
LOCAL, GLOBAL = cf.LocalFairing(), cf.GlobalFairing(tolerance=1e-3)
STARTED = "import time; t = time.perf_counter(); import {}; print(time.perf_counter() - t)"


class Compiled(NamedTuple):
    """A program with its samples, and the seconds to trace and compile it."""

    run: Callable[[], Any]
    seconds: float


@functools.cache
def fairing(shape: tuple[int, ...], method: Any) -> Compiled:
    """Compiled once for all that is timed with it."""
    values = jnp.asarray(waves(shape))
    start = time.perf_counter()
    program = jax.jit(lambda v: cf.fair_field(v, method=method).control_points)
    compiled = program.lower(values).compile()
    return Compiled(partial(compiled, values), time.perf_counter() - start)


def seconds_of(shape: tuple[int, ...], method: Any) -> float:
    """Seconds of fairing `waves(shape)`."""
    return clock.median(fairing(shape, method).run, 3)


def _inner(shape: tuple[int, ...]) -> int:
    return int(np.prod([n - 2 for n in shape]))


def local_operations(ndim: int, iterations: int = 3, order: int = 4) -> float:
    """Floating-point operations of local fairing per vertex, as the engine does it.

    Products with the parity tables, gradients, forces and a symmetric elimination; what is done
    point by point does not count.
    """
    fairing, every, pairs = 5**ndim - 3**ndim, 5**ndim, ndim * (ndim + 1) // 2
    points = (2 * order) ** ndim
    even_odd = [(3, 2)] * ndim  # functions of an axis that are even, odd
    sizes = np.zeros(2**ndim, int)
    for block in range(2**ndim):
        digits = [block >> axis & 1 for axis in range(ndim)]
        whole = np.prod([even_odd[axis][digit] for axis, digit in enumerate(digits)])
        given = np.prod([(2, 1)[digit] for digit in digits])
        sizes[block] = whole - given
    entries = sum(
        sizes[p] * sizes[p ^ both]
        for both in range(2**ndim)
        for p in range(2**ndim)
        if p <= p ^ both
    )
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


def operations(shape: tuple[int, ...], method: Any) -> float:
    """Floating-point operations of one fairing of `waves(shape)`."""
    if isinstance(method, cf.LocalFairing):
        return local_operations(len(shape)) * _inner(shape)
    fitted = cf.fair_field(waves(shape), method=method).report
    assert fitted is not None
    return global_operations(len(shape), int(fitted.steps.sum())) * float(np.prod(shape))


def local(shape: tuple[int, ...], peak: float, least: float, short: bool) -> list[Result]:
    """Against a straightforward program and against the roofline of its own operations."""
    seconds = seconds_of(shape, LOCAL)
    values = jnp.asarray(waves(shape))
    naive = clock.median(partial(fair_naively.lower(values).compile(), values), 3)
    floor = operations(shape, LOCAL) / peak
    name = f"local {size(shape)}"
    rows = [
        _target(f"{name}: straightforward / engine", naive / seconds, least, "least"),
        _target(f"{name}: engine / roofline", seconds / floor, 3.0, "most"),
    ]
    if not short:
        lu = seconds_of(shape, cf.LocalFairing(solver=cf.LU()))
        rows.insert(1, _target(f"{name}: with `LU()` / engine", lu / seconds, None, "least"))
    return rows


def whole(shape: tuple[int, ...], peak: float) -> tuple[float, Result]:
    """Seconds of global fairing, and against the roofline of its own operations."""
    floor = operations(shape, GLOBAL) / peak
    seconds = seconds_of(shape, GLOBAL)
    return seconds, _target(
        f"global {size(shape)}: engine / roofline", seconds / floor, 3.0, "most"
    )


def refine(shape: tuple[int, ...]) -> Result:
    """`refine(4)` against linear zoom."""
    field = cf.fair_field(waves(shape), method=cf.GlobalFairing(iterations=0))
    ours = clock.median(eqx.Partial(eqx.filter_jit(lambda f: f.refine(4)), field), 5)
    values = waves(shape)
    zoom = clock.median(lambda: ndimage.zoom(values, 4, order=1, grid_mode=False), 3)
    return _target(f"refine(4) of {size(shape)}: engine / ndimage.zoom(1)", ours / zoom, 1, "most")


def queries(shape: tuple[int, ...]) -> list[Result]:
    """Value, gradient and Hessian at random points against the value alone of peers."""
    import interpax

    ndim = len(shape)
    field = cf.fair_field(waves(shape), method=cf.GlobalFairing(iterations=0))
    points = np.random.default_rng(0).uniform(0, 1, (POINTS, ndim)) * (np.array(shape) - 1)
    points = jnp.asarray(points, jnp.float32)
    everything = eqx.filter_jit(lambda f, p: f.jet(p))
    ours = clock.median(lambda: everything(field, points), 3)
    values, columns = waves(shape), np.asarray(points).T
    spline = clock.median(lambda: ndimage.map_coordinates(values, columns, order=3), 1)
    axes = [jnp.arange(n, dtype=jnp.float32) for n in shape]
    function = {2: interpax.interp2d, 3: interpax.interp3d}[ndim]
    peer = jax.jit(lambda v, *q: function(*q, *axes, v, method="cubic"))
    theirs = clock.median(partial(peer, jnp.asarray(values), *points.T), 3)
    name = f"10^6 values, gradients, Hessians in {ndim}-D: engine /"
    return [
        _target(f"{name} values of interpax cubic", ours / theirs, 1.0, "most"),
        _target(f"{name} values of map_coordinates(3)", ours / spline, 1.0, "most"),
    ]


def reverse_over_forward(shape: tuple[int, ...], method: Any) -> float:
    """What the gradient of a loss in the samples takes beyond the fairing."""
    forward = seconds_of(shape, method)
    return sample_gradient(shape, lambda: method) / forward - 1


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
    """All targets; `short` takes small grids, whose ratios say less, and no reverse pass in 3-D."""
    peak = 1e9 * machine.run()["peak_gflops"]
    plane, volume = ((256, 256), (24,) * 3) if short else ((1024, 1024), (64,) * 3)
    few, many = ((128, 128), (256, 256)) if short else ((512, 512), (2048, 2048))
    block, cube = ((8,) * 3, (24,) * 3) if short else ((48,) * 3, (48,) * 3)

    def planar() -> list[Result]:
        seconds, roofline = whole(plane, peak)
        values = waves(plane)
        zoom = clock.median(lambda: ndimage.zoom(values, 4, order=3), 3)
        name = f"global {size(plane)}: engine / ndimage.zoom(3) by 4"
        return [_target(name, seconds / zoom, 2.0, "most"), roofline]

    def linear(method: Any, name: str) -> list[Result]:
        each = [seconds_of(s, method) / np.prod(s) for s in (few, many)]
        text = f"{name}: per sample, {size(many)} / {size(few)}"
        return [_target(text, each[1] / each[0], 1.15, "most")]

    jobs: list[Callable[[], list[Result]]] = [
        lambda: local(few if short else plane, peak, 5.0, short),
        lambda: local(block if short else (24,) * 3, peak, 8.0, short),
        planar,
        lambda: [whole(volume, peak)[1]],
        lambda: [refine(plane), refine(volume)],
        lambda: queries(plane),
        lambda: queries(volume),
        lambda: linear(LOCAL, "local"),
        lambda: linear(GLOBAL, "global"),
        lambda: [reverse(few, LOCAL, "local")],
        lambda: [reverse(few, GLOBAL, "global")],
        lambda: [] if short else [reverse(cube, GLOBAL, "global")],
        lambda: [] if short else [reverse(block, LOCAL, "local")],
        lambda: [compilation(s, LOCAL, "local") for s in (many, block)],
        lambda: [compilation(s, GLOBAL, "global") for s in (many, cube)],
        lambda: [start_up()],
    ]
    rows = [row for job in track(jobs, "targets") for row in job()]
    return {"short": short, "peak_gflops": peak / 1e9, "rows": rows}


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
