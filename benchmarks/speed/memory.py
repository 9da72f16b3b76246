"""Peak memory of fairing, and of gradients through it, above inputs and outputs.

Each case runs in a process of its own.
"""

import json
import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from benchmarks.common import engine, report
from benchmarks.common.report import Result, Track

X64 = False
FAIRING, GRADIENT = "fairing", "gradient"
CASES = (
    (engine.LOCAL, FAIRING, (4096, 4096)),
    (engine.LOCAL, FAIRING, (40, 40, 40)),
    (engine.GLOBAL, FAIRING, (1024, 1024)),
    (engine.GLOBAL, FAIRING, (64, 64, 64)),
    (engine.LOCAL, GRADIENT, (512, 512)),
    (engine.LOCAL, GRADIENT, (24, 24, 24)),
    (engine.GLOBAL, GRADIENT, (512, 512)),
    (engine.GLOBAL, GRADIENT, (48, 48, 48)),
)
LIMIT_GIB = 2.0


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def child(name: str, what: str, shape: tuple[int, ...]) -> Result:
    """Run one case in this process: peak after a small one and after the case."""
    import jax
    import jax.numpy as jnp

    import contourfair_jax as cf
    from benchmarks.speed.cost import waves

    method = engine.OBJECTS[name]()

    @jax.jit
    def fair(values: jax.Array) -> jax.Array:
        return cf.fair_field(values, method=method).control_points

    gradient = jax.jit(jax.grad(lambda values: jnp.sum(fair(values) ** 2)))
    work = fair if what == FAIRING else gradient
    # The libraries and the compiler are paid for by the smallest size.
    work(jnp.zeros((5,) * len(shape))).block_until_ready()
    before = _peak()
    values = jnp.asarray(waves(shape))
    given = _peak()
    result = work(values).block_until_ready()
    peak = _peak()
    return {
        "inputs_outputs_bytes": int(values.nbytes + result.nbytes),
        "baseline_bytes": before,
        "peak_before_bytes": given,
        "peak_bytes": peak,
        "above_bytes": max(0, peak - before - int(values.nbytes + result.nbytes)),
    }


def run(track: Track = report.silent) -> Result:
    """All cases, two at a time: their memory is their own."""
    with ThreadPoolExecutor(2) as pool:
        running = [pool.submit(_measured, *case) for case in CASES]
        rows = [future.result() for future in track(running, "memory")]
    return {"limit_gib": LIMIT_GIB, "rows": rows}


def _measured(name: str, what: str, shape: tuple[int, ...]) -> Result:
    command = [sys.executable, "-m", "benchmarks.speed.memory", name, what, *map(str, shape)]
    call = subprocess.run(command, capture_output=True, text=True, check=False)
    found = {"failed": call.stderr[-300:]} if call.returncode else json.loads(call.stdout)
    return {"method": name, "what": what, "shape": list(shape), **found}


def tables(result: Result) -> dict[str, str]:
    """MiB of inputs and outputs, and above them."""
    rows = [
        [
            r["method"],
            r["what"],
            report.size(r["shape"]),
            f"{r['inputs_outputs_bytes'] / 2**20:.0f}",
            f"{r['above_bytes'] / 2**20:.0f}",
        ]
        for r in result["rows"]
        if "above_bytes" in r
    ]
    header = ["method", "what", "samples", "in and out, MiB", "above them, MiB"]
    return {"memory": report.table(header, rows)}


if __name__ == "__main__":
    print(json.dumps(child(sys.argv[1], sys.argv[2], tuple(map(int, sys.argv[3:])))))
