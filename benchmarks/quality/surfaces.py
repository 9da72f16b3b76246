"""Isosurfaces of all real volumes: whether they are closed, their shape, and the time."""

import time

import numpy as np

import contourfair_jax as cf
from benchmarks.common import data, engine, report
from benchmarks.common.data import RealField
from benchmarks.common.inside import edges_of
from benchmarks.common.report import Result, Track

X64 = True
TOLERANCE = 0.1
SHARES = (0.25, 0.5)
# One volume at the default tolerance too.
FINE, FINE_TOLERANCE = "nucleon", 0.01


def _open_edges(mesh: "cf.Isosurface", upper: np.ndarray) -> int:
    """Edges without two triangles that do not lie in a face of the grid, where surfaces end."""
    edges = edges_of(mesh.triangles)
    ends = mesh.vertices[edges.ends[edges.faces != 2]]
    slack = 1e-9 * upper
    in_face = (ends <= slack).all(1) | (ends >= upper - slack).all(1)
    return int(np.count_nonzero(~in_face.any(-1)))


def score(field: RealField, tolerance: float) -> list[Result]:
    """One row per level: shares of the range of the samples."""
    fair = engine.field(field.values, field.spacing, engine.DEFAULT)
    upper = (np.array(field.values.shape) - 1) * np.array(field.spacing)
    rows = []
    for share in SHARES:
        start = time.perf_counter()
        mesh = fair.isosurface(
            float(field.values.min() + share * np.ptp(field.values)), tolerance=tolerance
        )
        rows.append(
            {
                "volume": field.name,
                "shape": list(field.values.shape),
                "share": share,
                "tolerance": tolerance,
                "triangles": len(mesh.triangles),
                "euler": mesh.euler_characteristic,
                "open": _open_edges(mesh, upper),
                "unmet": mesh.unmet,
                "unproved": mesh.unproved,
                "seconds": time.perf_counter() - start,
            }
        )
    return rows


def run(track: Track = report.silent) -> Result:
    """Score all volumes that there are."""
    cases = [*((name, TOLERANCE) for name in data.SURFACE), (FINE, FINE_TOLERANCE)]
    rows = []
    for name, tolerance in track(cases, "isosurfaces"):
        field = data.load(data.SURFACE, name)
        rows += [] if field is None else score(field, tolerance)
    return {"rows": rows}


def tables(result: Result) -> dict[str, str]:
    """One row per volume and level."""
    header = ["volume", "samples", "level", "tolerance", "triangles", "Euler", "open edges"]
    header += ["unmet edges", "unproved cells", "s"]
    rows = [
        [
            row["volume"],
            report.size(row["shape"]),
            f"{100 * row['share']:.0f} %",
            f"{row['tolerance']:g}",
            row["triangles"],
            row["euler"],
            row["open"],
            row["unmet"],
            row["unproved"],
            f"{row['seconds']:.1f}",
        ]
        for row in result["rows"]
    ]
    return {"surfaces": report.table(header, rows)}
