"""Seconds to deliver a four times finer grid, against the number of samples; engine and peers."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy import ndimage

import contourfair_jax as cf
from benchmarks.common import clock, gmt, peers, report
from benchmarks.common.report import Result, Track
from benchmarks.speed.cost import waves

X64 = False
SIZES = (64, 128, 256, 512, 1024)
FACTOR = 4
# A method that takes longer is not tried on larger grids, whose times follow from the last.
PATIENCE = 6.0
BUDGET = 3.0  # seconds after which a method is not called again
PICTURE = report.RESULTS / "upsampling.png"

OURS = {"local": cf.LocalFairing(), "global": cf.GlobalFairing(tolerance=1e-3)}
ZOOM = "cubic (ndimage.zoom)"
INTERPAX = "cubic2 (interpax)"
RBF = "thin-plate RBF (SciPy, 30 neighbours)"
GMT = "GMT surface"
NAMES = (*OURS, ZOOM, INTERPAX, RBF, GMT)


def _fair(values: np.ndarray, method: Any) -> Callable[[], Any]:
    samples = jnp.asarray(values)
    program = jax.jit(lambda v: cf.fair_field(v, method=method).refine(FACTOR))
    return partial(program.lower(samples).compile(), samples)


def _interpax(values: np.ndarray) -> Callable[[], Any]:
    import interpax

    samples = jnp.asarray(values)
    knots = [jnp.arange(n, dtype=samples.dtype) for n in values.shape]
    axes = peers.refined_axes(values.shape, FACTOR)
    where = [jnp.asarray(w.ravel(), samples.dtype) for w in np.meshgrid(*axes, indexing="ij")]
    evaluate: Callable[..., Any] = interpax.interp2d
    program = jax.jit(lambda v: evaluate(*where, *knots, v, method="cubic2"))
    return partial(program.lower(samples).compile(), samples)


def delivery(name: str, values: np.ndarray) -> Callable[[], Any]:
    """What is timed: samples in, finer grid out; compiled before."""
    if name in OURS:
        return _fair(values, OURS[name])
    if name == INTERPAX:
        return _interpax(values)
    if name == ZOOM:
        return lambda: ndimage.zoom(values, FACTOR, order=3)
    method = {RBF: peers.thin_plate_rbf, GMT: gmt.surface}[name]
    return lambda: method(values.astype(np.float64), 1.0, FACTOR)


def run(track: Track = report.silent) -> Result:
    """Every method on every size that it has patience for."""
    names = [name for name in NAMES if name != GMT or gmt.version()]
    seconds: Result = {name: {} for name in names}
    for size in track(SIZES, "upsampling"):
        values = waves((size, size))
        for name in names:
            if max(seconds[name].values(), default=0.0) < PATIENCE:
                timed = delivery(name, values)
                seconds[name][str(size)] = clock.median(timed, 3, BUDGET)
    return {"factor": FACTOR, "gmt": gmt.version(), "seconds": seconds}


def draw(result: Result) -> Figure:
    """Seconds against samples, both logarithmic."""
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    for name, times in result["seconds"].items():
        samples = [int(size) ** 2 for size in times]
        style = {"lw": 2.5} if name in OURS else {"lw": 1.2, "ls": "--"}
        axes.loglog(samples, list(times.values()), marker="o", ms=4, label=name, **style)
    axes.set_xlabel("samples")
    axes.set_ylabel(f"seconds to a {result['factor']} times finer grid")
    axes.grid(which="both", alpha=0.25)
    axes.legend(fontsize=8)
    return figure


def tables(result: Result) -> dict[str, str]:
    """Seconds of every method, one column per size."""
    rows = [
        [name, *[f"{times[str(n)]:.3g}" if str(n) in times else None for n in SIZES]]
        for name, times in result["seconds"].items()
    ]
    header = ["method", *[f"{report.size((n, n))}, s" for n in SIZES]]
    return {"upsampling": report.table(header, rows)}
