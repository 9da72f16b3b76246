"""On a GPU: times beside its memory bandwidth and arithmetic, agreement with the CPU, cupyx.

The device is timed with everything on it: samples, fields and query points, all float32.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import contourfair_jax as cf
from benchmarks.common import clock, report
from benchmarks.common.report import Result, Track, size
from benchmarks.speed import machine
from benchmarks.speed.cost import waves
from benchmarks.speed.targets import fairing, operations, reverse_over_forward

X64 = True  # the references; what is timed is float32
REPEATS = 3
TOLERANCE = 1e-3
METHODS: dict[str, Callable[[], cf.AbstractFairing]] = {
    "local": cf.LocalFairing,
    "global": lambda: cf.GlobalFairing(tolerance=TOLERANCE),
}
BUILDS = (
    ("local", (4096, 4096)),
    ("global", (4096, 4096)),
    ("local", (64, 64, 64)),
    ("global", (256, 256, 256)),
)
SMALL_BUILDS = (
    ("local", (512, 512)),
    ("global", (512, 512)),
    ("local", (16, 16, 16)),
    ("global", (48, 48, 48)),
)
REVERSE = (
    ("local", (1024, 1024)),
    ("global", (1024, 1024)),
    ("local", (32, 32, 32)),
    ("global", (96, 96, 96)),
)
SMALL_REVERSE = (("local", (256, 256)), ("global", (256, 256)))
AGREEMENT = ((192, 160), (20, 18, 16))


def build(name: str, shape: tuple[int, ...], peak: float, bandwidth: float) -> Result:
    """Seconds of one fairing, and what its operations and its samples and net alone take."""
    method = METHODS[name]()
    seconds = clock.median(fairing(shape, method).run, REPEATS)
    count = int(np.prod(shape))
    moved = 4 * (1 + 3 ** len(shape)) * count
    return {
        "what": name,
        "shape": list(shape),
        "seconds": seconds,
        "ns_per_sample": 1e9 * seconds / count,
        "over_arithmetic": seconds / (operations(fairing(shape, method).run()) / peak),
        "over_bandwidth": seconds / (moved / bandwidth),
    }


def agreement(name: str, shape: tuple[int, ...]) -> Result:
    """Largest difference of the net from the CPU's in float64, over the spread of the samples."""
    values = waves(shape).astype(np.float64)
    method = METHODS[name]() if name == "local" else cf.GlobalFairing(tolerance=1e-6)

    def net(dtype: Any, platform: str) -> np.ndarray:
        with jax.default_device(jax.devices(platform)[0]):
            samples = jnp.asarray(values, dtype)
            return np.asarray(cf.fair_field(samples, method=method).control_points, float)

    reference = net(jnp.float64, "cpu")
    backend = jax.default_backend()
    off = {
        str(jnp.dtype(dtype)): float(np.abs(net(dtype, backend) - reference).max())
        for dtype in (jnp.float32, jnp.float64)
    }
    return {"what": name, "shape": list(shape), **{k: v / np.ptp(values) for k, v in off.items()}}


def reverse(name: str, shape: tuple[int, ...]) -> Result:
    """What the gradient of a loss in the samples takes beyond the fairing."""
    ratio = reverse_over_forward(shape, METHODS[name]())
    return {"what": name, "shape": list(shape), "reverse_over_forward": ratio}


def evaluation(shape: tuple[int, ...], factor: int, points: int, bandwidth: float) -> list[Result]:
    """`refine` and queries beside cubic and linear interpolation of cupyx, and the bandwidth."""
    import cupy  # pyright: ignore[reportMissingImports]
    from cupyx.scipy import ndimage  # pyright: ignore[reportMissingImports]

    def done(function: Callable[[], Any]) -> Callable[[], None]:
        def run() -> None:
            function()
            cupy.cuda.Device().synchronize()

        return run

    ndim, values = len(shape), waves(shape)
    field = cf.fair_field(jnp.asarray(values), method=cf.GlobalFairing(iterations=0))
    field = jax.block_until_ready(field)
    theirs = cupy.asarray(values)
    refine = eqx.Partial(eqx.filter_jit(lambda f: f.refine(factor)), field)
    ours = clock.median(refine, REPEATS)
    zoom = {
        order: clock.median(done(partial(ndimage.zoom, theirs, factor, order=order)), REPEATS)
        for order in (1, 3)
    }
    fine = np.prod([factor * (n - 1) + 1 for n in shape])
    rows: list[Result] = [
        {
            "what": f"refine({factor})",
            "shape": list(shape),
            "seconds": ours,
            "over_bandwidth": ours / (4 * (fine + field.control_points.size) / bandwidth),
            "over_linear": ours / zoom[1],
            "over_cubic": ours / zoom[3],
        }
    ]
    generator = np.random.default_rng(0)
    where = generator.uniform(0, 1, (points, ndim)) * (np.array(shape) - 1)
    places = jnp.asarray(where, jnp.float32)
    columns = cupy.asarray(where.T, cupy.float32)
    everything = eqx.filter_jit(lambda f, p: f.jet(p))
    ours = clock.median(lambda: everything(field, places), REPEATS)
    sample = done(partial(ndimage.map_coordinates, theirs, columns, order=3))
    coefficients = 4**ndim
    moved = 4 * points * (coefficients + ndim + 1 + ndim + ndim**2)
    rows.append(
        {
            "what": f"{points:.0e} values, gradients, Hessians",
            "shape": list(shape),
            "seconds": ours,
            "over_bandwidth": ours / (moved / bandwidth),
            "over_cubic": ours / clock.median(sample, REPEATS),
        }
    )
    return rows


def run(track: Track = report.silent, short: bool = False) -> Result:
    """Everything; `short` takes small grids, to see that it works."""
    if jax.default_backend() == "cpu":
        raise SystemExit("gpu: JAX sees no GPU here; install its wheels for one and run it again")
    rates = machine.run(sizes=(2048, 8192))
    peak, bandwidth = 1e9 * rates["peak_gflops"], 1e9 * rates["copy_gb_per_s"]
    plane, volume = ((512, 512), (48,) * 3) if short else ((4096, 4096), (192,) * 3)
    points = 100_000 if short else 10_000_000
    jobs: list[tuple[str, Callable[[], Any]]] = [
        *(("agreement", partial(agreement, n, s)) for n in METHODS for s in AGREEMENT),
        *(
            ("builds", partial(build, n, s, peak, bandwidth))
            for n, s in (SMALL_BUILDS if short else BUILDS)
        ),
        *(("reverse", partial(reverse, n, s)) for n, s in (SMALL_REVERSE if short else REVERSE)),
        ("evaluation", partial(evaluation, plane, 4, points, bandwidth)),
        ("evaluation", partial(evaluation, volume, 2, points, bandwidth)),
    ]
    result: Result = {"short": short, "rates": rates}
    for part, job in track(jobs, "gpu"):
        rows = job()
        result.setdefault(part, []).extend(rows if isinstance(rows, list) else [rows])
    return result


def tables(result: Result) -> dict[str, str]:
    """Times, the reverse pass, agreement."""
    columns = ("over_arithmetic", "over_bandwidth", "over_linear", "over_cubic")

    def short(value: float) -> str:
        return f"{value:.3g}" if value < 1000 else f"{value:.0f}"

    def figure(row: Result, name: str) -> str | None:
        return short(row[name]) if name in row else None

    times = [
        [
            row["what"],
            size(row["shape"]),
            short(1e3 * row["seconds"]),
            *(figure(row, name) for name in columns),
        ]
        for row in result["builds"] + result["evaluation"]
    ]
    header = [
        "what",
        "samples",
        "ms",
        "over its arithmetic",
        "over reading and writing",
        "over cupyx linear",
        "over cupyx cubic",
    ]
    others = [
        [row["what"], size(row["shape"]), figure(row, "float32"), figure(row, "float64"), None]
        for row in result["agreement"]
    ] + [
        [row["what"], size(row["shape"]), None, None, f"{row['reverse_over_forward']:.2g}"]
        for row in result["reverse"]
    ]
    other_header = [
        "method",
        "samples",
        "float32 from the CPU's float64",
        "float64 from it",
        "reverse pass / forward",
    ]
    return {
        "gpu": report.table(header, times),
        "gpu_checks": report.table(other_header, others),
    }
