"""Peak memory of one fairing above its inputs and outputs, each in a process of its own."""

import json
import resource
import subprocess
import sys
import time

from benchmarks import engine, report
from benchmarks.report import Result, Track

X64 = False
CASES = (
    (engine.LOCAL, (1024, 1024)),
    (engine.LOCAL, (4096, 4096)),
    (engine.LOCAL, (64, 64, 64)),
    (engine.GLOBAL, (1024, 1024)),
    (engine.GLOBAL, (64, 64, 64)),
)
LIMIT_GIB = 2.0


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def child(name: str, shape: tuple[int, ...]) -> Result:
    """Run one case in this process: peak after a small fairing and after the case."""
    import jax.numpy as jnp

    import contourfair_jax as cf
    from benchmarks.cost import waves

    method = engine.OBJECTS[name]()
    # The libraries and the compiler are paid for by a fairing of the smallest size.
    cf.fair_field(jnp.zeros((5,) * len(shape)), method=method).control_points.block_until_ready()
    before = _peak()
    values = jnp.asarray(waves(shape))
    given = _peak()
    start = time.perf_counter()
    net = cf.fair_field(values, method=method).control_points.block_until_ready()
    seconds = time.perf_counter() - start
    peak = _peak()
    return {
        "inputs_outputs_bytes": int(values.nbytes + net.nbytes),
        "baseline_bytes": before,
        "peak_before_bytes": given,
        "peak_bytes": peak,
        "above_bytes": max(0, peak - before - int(values.nbytes + net.nbytes)),
        "first_call_s": seconds,
    }


def run(track: Track = report.silent) -> Result:
    """All cases of the methods that the engine has."""
    rows = []
    for name, shape in track([c for c in CASES if c[0] in engine.OBJECTS], "memory"):
        command = [sys.executable, "-m", "benchmarks.memory", name, *map(str, shape)]
        call = subprocess.run(command, capture_output=True, text=True, check=False)
        if call.returncode:
            rows.append({"method": name, "shape": list(shape), "failed": call.stderr[-300:]})
        else:
            rows.append({"method": name, "shape": list(shape), **json.loads(call.stdout)})
    return {"limit_gib": LIMIT_GIB, "rows": rows}


def tables(result: Result) -> dict[str, str]:
    """MiB of inputs and outputs, and above them."""
    rows = [
        [
            r["method"],
            report.size(r["shape"]),
            f"{r['inputs_outputs_bytes'] / 2**20:.0f}",
            f"{r['above_bytes'] / 2**20:.0f}",
            f"{r['first_call_s']:.1f}",
        ]
        for r in result["rows"]
        if "above_bytes" in r
    ]
    header = ["method", "samples", "in and out, MiB", "above them, MiB", "s, compiling included"]
    return {"memory": report.table(header, rows)}


if __name__ == "__main__":
    print(json.dumps(child(sys.argv[1], tuple(map(int, sys.argv[2:])))))
