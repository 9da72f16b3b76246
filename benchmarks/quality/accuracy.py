"""Errors against analytic fields: engine, splines, radial basis functions and GMT."""

import time

from benchmarks.common import engine, gmt, metrics, peers, report
from benchmarks.common.fields import PLANE, VOLUME, Case
from benchmarks.common.inside import even_levels
from benchmarks.common.peers import Array, Method
from benchmarks.common.report import Result, Track

X64 = True
MAIN = (
    peers.LINEAR,
    peers.CUBIC,
    peers.QUINTIC,
    engine.LOCAL,
    engine.GLOBAL,
    engine.ROBUST,
    engine.SMOOTH,
    engine.TUNED,
)
OTHERS = (
    peers.CATMULL_ROM,
    *peers.OTHER_ENDS,
    "thin-plate RBF",
    "GMT surface",
    "GMT surface T .25",
    "GMT greenspline",
    "interpax cubic2",
    engine.DEFAULT,
    engine.SMALL_WEIGHT,
    engine.CLEAN,
    engine.WAVES,
)


def _methods(case: Case) -> dict[str, Method]:
    methods: dict[str, Method] = {**peers.SPLINES, **peers.OTHER_ENDS, **engine.METHODS}
    if case.ndim == 2:
        methods["thin-plate RBF"] = peers.thin_plate_rbf
        methods["interpax cubic2"] = peers.interpax_cubic2
        if gmt.version():
            methods["GMT surface"] = gmt.surface
            methods["GMT surface T .25"] = gmt.surface_tension
            methods["GMT greenspline"] = gmt.greenspline
    return methods


def score(method: Method, case: Case, samples: Array, truth: Array) -> Result:
    """RMS error, contour components, largest error at the samples and seconds of one method."""
    start = time.perf_counter()
    try:
        refined = method(samples, case.spacing, case.factor)
    except gmt.NotConverged as error:
        return {"failed": str(error)}
    seconds = time.perf_counter() - start
    at_samples = refined[(slice(None, None, case.factor),) * case.ndim] - samples
    row: Result = {
        "rms": metrics.rms(case.interior(refined) - case.interior(truth)),
        "at_samples": float(abs(at_samples).max()),
        "seconds": seconds,
    }
    if case.ndim == 2:
        row["parts"] = metrics.parts(refined, even_levels(samples))
    return row


def run(track: Track = report.silent, cases: tuple[Case, ...] = (*PLANE, VOLUME)) -> Result:
    """Score every method on every case."""
    jobs = [(case, name, method) for case in cases for name, method in _methods(case).items()]
    rows: Result = {case.name: {"methods": {}} for case in cases}
    known: dict[str, tuple[Array, Array]] = {}
    for case, name, method in track(jobs, "accuracy"):
        if case.name not in known:
            known = {case.name: (case.samples(), case.truth())}
            samples, truth = known[case.name]
            if case.ndim == 2:
                rows[case.name]["parts"] = metrics.parts(truth, even_levels(samples))
        rows[case.name]["methods"][name] = score(method, case, *known[case.name])
    return {"gmt": gmt.version(), "cases": rows}


def _table(result: Result, columns: tuple[str, ...], with_parts: bool) -> str:
    names = [c for c in columns if any(c in r["methods"] for r in result["cases"].values())]
    rows = []
    for case, row in result["cases"].items():
        scores = [row["methods"].get(name, {}) for name in names]
        values = [s.get("rms") for s in scores]
        cells = [report.figure(v) for v in values]
        if with_parts:
            counts = [s.get("parts") for s in scores]
            cells = [
                f"{c}, {n}" if c and n is not None else c
                for c, n in zip(cells, counts, strict=True)
            ]
        truth = row.get("parts")
        rows.append([case, truth, *report.bold_least(cells, values)])
    return report.table(["test", "true parts", *names], rows)


def tables(result: Result) -> dict[str, str]:
    """Main columns (with contour components) and everything else."""
    return {
        "accuracy": _table(result, MAIN, with_parts=True),
        "accuracy-others": _table(result, (*OTHERS, engine.GLOBAL), with_parts=False),
    }
