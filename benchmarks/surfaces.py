"""Isosurfaces of all real volumes: whether they are closed, their shape, and the time."""

import time

import numpy as np

import contourfair_jax as cf
from benchmarks import data, engine, report
from benchmarks.data import RealField
from benchmarks.report import Result, Track
from contourfair_jax._split import edges_of

X64 = True
TOLERANCE = 0.1
SHARES = (0.25, 0.5)


def _open_edges(mesh: "cf.Isosurface", upper: np.ndarray) -> int:
    """Edges without two triangles that do not lie in a face of the grid, where surfaces end."""
    edges = edges_of(mesh.triangles)
    ends = mesh.vertices[edges.ends[edges.faces != 2]]
    slack = 1e-9 * upper
    in_face = (ends <= slack).all(1) | (ends >= upper - slack).all(1)
    return int(np.count_nonzero(~in_face.any(-1)))


def score(field: RealField) -> list[Result]:
    """One row per level: shares of the range of the samples."""
    fair = engine.field(field.values, field.spacing, engine.DEFAULT)
    upper = (np.array(field.values.shape) - 1) * np.array(field.spacing)
    rows = []
    for share in SHARES:
        start = time.perf_counter()
        mesh = fair.isosurface(
            float(field.values.min() + share * np.ptp(field.values)), tolerance=TOLERANCE
        )
        rows.append(
            {
                "volume": field.name,
                "shape": list(field.values.shape),
                "share": share,
                "triangles": len(mesh.triangles),
                "euler": mesh.euler_characteristic,
                "open": _open_edges(mesh, upper),
                "unmet": mesh.unmet,
                "seconds": time.perf_counter() - start,
            }
        )
    return rows


def run(track: Track = report.silent) -> Result:
    """Score all volumes that there are."""
    fields = [data.load(data.VOLUME, name) for name in data.VOLUME]
    rows = [row for field in track(fields, "isosurfaces") if field for row in score(field)]
    return {"tolerance": TOLERANCE, "rows": rows}


def tables(result: Result) -> dict[str, str]:
    """One row per volume and level."""
    header = ["volume", "samples", "level", "triangles", "Euler", "open edges", "unmet edges", "s"]
    rows = [
        [
            row["volume"],
            report.size(row["shape"]),
            f"{100 * row['share']:.0f} %",
            row["triangles"],
            row["euler"],
            row["open"],
            row["unmet"],
            f"{row['seconds']:.1f}",
        ]
        for row in result["rows"]
    ]
    return {"surfaces": report.table(header, rows)}
