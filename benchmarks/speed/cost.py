"""Time against size: compile, build and query apart."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import contourfair_jax as cf
from benchmarks.common import clock, report
from benchmarks.common.report import Result, Track

X64 = False
SHAPES = ((64, 64), (256, 256), (1024, 1024))
VOLUMES = ((12, 12, 12), (24, 24, 24), (32, 32, 32))
QUERIES = 100_000


def waves(shape: tuple[int, ...]) -> np.ndarray:
    """Rough but smooth samples, float32: a chirp with about four samples per period at most."""
    axes = [np.linspace(0.0, 1.0, n) for n in shape]
    radius = np.sqrt(sum(g**2 for g in np.meshgrid(*axes, indexing="ij")))
    return np.sin(0.25 * np.pi * max(shape) * radius**2).astype(np.float32)


def _methods() -> dict[str, Callable[[], Any]]:
    return {
        "local, thin plate": lambda: cf.LocalFairing(iterations=0),
        "local": lambda: cf.LocalFairing(iterations=3),
        "global": cf.GlobalFairing,
    }


def measure(shape: tuple[int, ...], make: Callable[[], Any]) -> Result:
    """Seconds to compile, to build, to query values and gradients."""
    values = jnp.asarray(waves(shape))
    method = make()
    generator = np.random.default_rng(0)
    points = generator.uniform(0.0, 1.0, (QUERIES, len(shape))) * (np.array(shape) - 1)
    points = jnp.asarray(points, jnp.float32)
    start = time.perf_counter()
    build = jax.jit(lambda v: cf.fair_field(v, method=method)).lower(values).compile()
    compile_s = time.perf_counter() - start
    built = []
    seconds = clock.median(lambda: built.append(build(values)) or built[-1], 5, budget=5.0)
    field = built[-1]
    evaluate = jax.jit(lambda f, p: f(p))
    gradient = jax.jit(lambda f, p: f.gradient(p))
    count = int(np.prod(shape))
    return {
        "shape": list(shape),
        "compile_s": compile_s,
        "build_s": seconds,
        "build_us_per_vertex": 1e6 * seconds / count,
        "query_us_per_point": 1e6 * clock.median(lambda: evaluate(field, points), 5) / QUERIES,
        "gradient_us_per_point": 1e6 * clock.median(lambda: gradient(field, points), 5) / QUERIES,
    }


def sample_gradient(shape: tuple[int, ...], method: Any) -> Callable[[], jax.Array]:
    """The gradient of a loss through the fairing, with respect to the samples, compiled."""
    values = jnp.asarray(waves(shape))

    def loss(samples: jax.Array) -> jax.Array:
        return jnp.sum(cf.fair_field(samples, method=method).control_points ** 2)

    return partial(jax.jit(jax.grad(loss)).lower(values).compile(), values)


def run(track: Track = report.silent) -> Result:
    """All sizes and methods."""
    jobs = [
        (shape, name, make)
        for name, make in _methods().items()
        for shape in (*SHAPES, *VOLUMES)
        if name != "local, thin plate" or shape in (SHAPES[1], VOLUMES[1])
    ]
    rows = []
    for shape, name, make in track(jobs, "cost"):
        rows.append({"method": name, **measure(shape, make)})
        if shape in (SHAPES[1], VOLUMES[0]):
            rows[-1]["sample_gradient_s"] = clock.median(sample_gradient(shape, make()), 3)
    return {"rows": rows}


def tables(result: Result) -> dict[str, str]:
    """One row per method and size."""
    rows = [
        [
            r["method"],
            report.size(r["shape"]),
            f"{r['compile_s']:.1f}",
            f"{r['build_s']:.3g}",
            f"{r['build_us_per_vertex']:.2f}",
            f"{r['query_us_per_point']:.2f}",
            f"{r['gradient_us_per_point']:.2f}",
            f"{r['sample_gradient_s']:.3g}" if "sample_gradient_s" in r else None,
        ]
        for r in result["rows"]
    ]
    header = [
        "method",
        "samples",
        "compile, s",
        "build, s",
        "build, µs per sample",
        "query, µs per point",
        "with gradient",
        "gradient in the samples, s",
    ]
    return {"cost": report.table(header, rows)}
