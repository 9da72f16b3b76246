"""Real data: drop every other sample, reconstruct, compare at the dropped ones."""

import time

import jax
import numpy as np

from benchmarks.common import data, engine, gmt, metrics, peers, report
from benchmarks.common.data import RealField
from benchmarks.common.inside import even_levels
from benchmarks.common.peers import Method
from benchmarks.common.report import Result, Track

OURS = tuple(engine.RECONSTRUCT)


def _methods(ndim: int) -> dict[str, Method]:
    methods: dict[str, Method] = {**peers.SPLINES, **peers.OTHER_ENDS}
    if ndim == 2 and gmt.version():
        methods["GMT surface T .25"] = gmt.surface_tension
    methods |= engine.RECONSTRUCT
    if ndim == 3:
        methods.pop(engine.LOCAL, None)
    return methods


def score(field: RealField, methods: dict[str, Method]) -> Result:
    """PSNR in dB at the dropped samples, overshoot, contour components, seconds per method."""
    ndim = field.values.ndim
    truth = field.values[tuple(slice(0, (n - 1) // 2 * 2 + 1) for n in field.values.shape)]
    kept = (slice(None, None, 2),) * ndim
    coarse = np.ascontiguousarray(truth[kept])
    dropped = np.ones(truth.shape, bool)
    dropped[kept] = False
    levels = even_levels(coarse)
    result: Result = {"shape": list(truth.shape), "methods": {}}
    if ndim == 2:
        result["parts"] = metrics.parts(truth, levels)
    for name, method in methods.items():
        start = time.perf_counter()
        try:
            refined = method(coarse, field.spacing, 2)
        except gmt.NotConverged as error:
            result["methods"][name] = {"failed": str(error)}
            continue
        row: Result = {
            "psnr": metrics.psnr(refined[dropped], truth[dropped]),
            "overshoot": metrics.overshoot(refined, coarse),
            "seconds": time.perf_counter() - start,
        }
        if ndim == 2:
            row["parts"] = metrics.parts(refined, levels)
        result["methods"][name] = row
    return result


def run(track: Track = report.silent, ndim: int = 2) -> Result:
    """Score all fields of one dimension; missing files are listed under ``skipped``."""
    names = data.PLANE if ndim == 2 else data.VOLUME
    fields: Result = {}
    skipped: list[str] = []
    for name in track(list(names), f"real data, {ndim}-D"):
        field = data.load(names, name)
        if field is None:
            skipped.append(name)
        else:
            fields[name] = score(field, _methods(ndim))
        # No other field has the same shape, and a process may only map so many programs.
        jax.clear_caches()
    return {"ndim": ndim, "fields": fields, "skipped": skipped}


def best_peer(methods: Result, names: tuple[str, ...] = tuple(peers.SPLINES)) -> tuple[str, float]:
    """Name and PSNR of the best of ``names`` for one field."""
    name = max(names, key=lambda n: methods[n]["psnr"])
    return name, methods[name]["psnr"]


def gains(result: Result, method: str) -> dict[str, float]:
    """PSNR of ``method`` above the best spline, per field."""
    return {
        name: row["methods"][method]["psnr"] - best_peer(row["methods"])[1]
        for name, row in result["fields"].items()
        if method in row["methods"]
    }


def tables(result: Result) -> dict[str, str]:
    """One row per field; the last rows give the mean and the worst gain."""
    ours = [n for n in OURS if any(n in f["methods"] for f in result["fields"].values())]
    rows: list[list[object]] = []
    for name, row in result["fields"].items():
        peer, best = best_peer(row["methods"])
        size = report.size(row["shape"])
        gained = [f"{gains(result, n)[name]:+.2f}" for n in ours]
        rows.append([name, size, peer, f"{best:.2f}", *gained])
    for label, reduce in (("mean", np.mean), ("worst", np.min)):
        values = [f"**{reduce(list(gains(result, n).values())):+.2f}**" for n in ours]
        rows.append([f"**{label}**", "", "", "", *values])
    header = ["field", "size", "best spline", "dB", *[f"{n}, dB over it" for n in ours]]
    return {f"real{result['ndim']}d": report.table(header, rows)}
