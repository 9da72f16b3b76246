"""Leaves of adaptive grids beside the cells of uniform refinement for the same proved error."""

import time

import numpy as np

from benchmarks.common import data, engine, report
from benchmarks.common.data import RealField
from benchmarks.common.report import Result, Track
from contourfair_jax.adaptive import uniform_error

X64 = True
DEPTH = {2: 3, 3: 2}
FIELDS = ("Maunga Whau terrain", "air temperature", "CT slice", "ocean temperature", "retina")
VOLUMES = ("nucleon", "hydrogen orbital", "benzene orbital")


def score(field: RealField) -> Result:
    """The error of cells halved `DEPTH` times, and the leaves that are proved to have no more."""
    fair = engine.field(field.values, field.spacing, engine.DEFAULT)
    depth = DEPTH[field.values.ndim]
    error = uniform_error(fair, depth)
    start = time.perf_counter()
    grid = fair.adaptive(error)
    return {
        "shape": list(field.values.shape),
        "error": error / float(np.ptp(field.values)),
        "uniform": int(np.prod(np.array(field.values.shape) - 1)) * 2 ** (depth * fair.ndim),
        "leaves": len(grid),
        "seconds": time.perf_counter() - start,
    }


def run(track: Track = report.silent) -> Result:
    """Score the fields that there are."""
    wanted = [(data.PLANE, n) for n in FIELDS] + [(data.VOLUME, n) for n in VOLUMES]
    rows: Result = {}
    for names, name in track(wanted, "adaptive grids"):
        field = data.load(names, name)
        if field is not None:
            rows[name] = score(field)
    return {"rows": rows}


def tables(result: Result) -> dict[str, str]:
    """One row per field."""
    header = ["field", "samples", "error / range", "uniform cells", "leaves", "fewer by", "s"]
    rows = [
        [
            name,
            report.size(row["shape"]),
            f"{row['error']:.1e}",
            row["uniform"],
            row["leaves"],
            f"{row['uniform'] / row['leaves']:.0f}×",
            f"{row['seconds']:.1f}",
        ]
        for name, row in result["rows"].items()
    ]
    return {"leaves": report.table(header, rows)}
