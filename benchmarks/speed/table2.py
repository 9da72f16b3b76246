"""The paper's Table 2: seconds for thin plate and for one iteration on 7 x 7 and 10 x 10 samples.

Our reading: "thin-plate" is the whole field with 0 iterations; "one iteration" is the extra time
of each further iteration, here the slope between 0 and 8 iterations, compiled, samples in memory.
"""

import jax.numpy as jnp
import numpy as np

import contourfair_jax as cf
from benchmarks.common import clock, report
from benchmarks.common.report import Result, Track

X64 = False
SIZES = (7, 10)
ITERATIONS = 8


def _circle(size: int) -> jnp.ndarray:
    axis = np.linspace(-1.0, 1.0, size)
    return jnp.asarray(np.hypot(axis[:, None], axis[None, :]), jnp.float32)


def _seconds(size: int, iterations: int) -> float:
    values = _circle(size)
    method = cf.LocalFairing(iterations=iterations)
    return clock.median(lambda: cf.fair_field(values, method=method).control_points, repeats=101)


def run(track: Track = report.silent) -> Result:
    """Thin plate and per-iteration seconds for each size."""
    rows = []
    for size in track(SIZES, "table 2"):
        plate, many = _seconds(size, 0), _seconds(size, ITERATIONS)
        rows.append(
            {
                "vertices": size**2,
                "inner": (size - 2) ** 2,
                "thin_plate_s": plate,
                "iteration_s": (many - plate) / ITERATIONS,
            }
        )
    return {"rows": rows}


def tables(result: Result) -> dict[str, str]:
    """As the paper prints it, in milliseconds."""
    rows = [
        [
            f"{r['vertices']} ({r['inner']})",
            f"{1e3 * r['thin_plate_s']:.2f}",
            f"{1e3 * r['iteration_s']:.2f}",
        ]
        for r in result["rows"]
    ]
    header = ["vertices (inner)", "thin plate, ms", "one iteration, ms"]
    return {"table2": report.table(header, rows)}
