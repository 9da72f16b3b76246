"""A grid larger than a budget of memory: refined in tiles by processes; peak memory and rate."""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import psutil

from benchmarks.common import report
from benchmarks.common.report import Result, Track

X64 = False
LIMIT_GIB = 4.0
FACTOR = 2


def write_source(path: Path, size: int) -> None:
    """Waves and noise, float32, written a row of chunks at a time."""
    import zarr

    chunk = min(size, 1024)
    array = zarr.create_array(
        str(path), shape=(size, size), chunks=(chunk, chunk), dtype=np.float32
    )
    rng = np.random.default_rng(0)
    y = np.arange(size, dtype=np.float32)[None, :] / 37
    for start in range(0, size, chunk):
        x = np.arange(start, min(start + chunk, size), dtype=np.float32)[:, None] / 23
        noise = rng.standard_normal((len(x), size), np.float32)
        array[start : start + len(x)] = np.sin(x + np.cos(y)) + np.float32(0.1) * noise


class Peak:
    """Largest memory of this process and all below it, looked at ten times a second."""

    def __init__(self) -> None:
        self.bytes = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    def __enter__(self) -> "Peak":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        own = psutil.Process()
        while not self._over.wait(0.1):
            total = 0
            for process in [own, *own.children(recursive=True)]:
                try:
                    total += process.memory_info().rss
                except psutil.Error:  # it has just ended
                    continue
            self.bytes = max(self.bytes, total)


def child(size: int, workers: int, method: str) -> Result:
    """One run, in this process and its workers."""
    import zarr

    import contourfair_jax as cf
    from contourfair_jax import tiles

    chosen = {"local": cf.LocalFairing, "global": cf.GlobalFairing}[method]()
    marks: list[tuple[float, int]] = []

    def progress(done: int, total: int) -> None:
        marks.append((time.perf_counter(), done))

    with tempfile.TemporaryDirectory(dir=".") as folder:
        source, target = Path(folder) / "in.zarr", Path(folder) / "out.zarr"
        write_source(source, size)
        start = time.perf_counter()
        with Peak() as peak:
            outcome = tiles.refine_to(
                source, target, FACTOR, method=chosen, workers=workers, progress=progress
            )
        seconds = time.perf_counter() - start
        stored = zarr.open_array(target, mode="r")
        given = zarr.open_array(source, mode="r")
        ends = [slice(0, 64), slice(size - 64, size)]
        kept = all(
            np.array_equal(
                np.asarray(stored[FACTOR * s.start : FACTOR * s.stop : FACTOR, ::FACTOR]),
                np.asarray(given[s]),
            )
            for s in ends
        )
    # From the first tile after the first of every worker: their programs are compiled then.
    first = marks[min(2 * workers, len(marks) - 2)]
    steady = (marks[-1][1] - first[1]) / outcome.tiles * size**2 / (marks[-1][0] - first[0])
    return {
        "method": method,
        "size": size,
        "factor": FACTOR,
        "workers": workers,
        "tiles": outcome.tiles,
        "seconds": seconds,
        "samples_per_s": steady,
        "peak_gib": peak.bytes / 2**30,
        "samples_kept": kept,
    }


def run(
    track: Track = report.silent, size: int = 2048, workers: int = 2, method: str = "local"
) -> Result:
    """One size, beside the stored ones of other sizes and methods."""
    command = [sys.executable, "-m", "benchmarks.endurance.tiles", str(size), str(workers), method]
    rows = []
    for _ in track([size], "tiles"):
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
    stored = (report.load("tiles") or {}).get("rows", [])
    rows += [r for r in stored if (r["size"], r["method"]) != (size, method)]
    order = sorted(rows, key=lambda row: (row["method"] != "local", row["size"]))
    return {"limit_gib": LIMIT_GIB, "rows": order}


def tables(result: Result) -> dict[str, str]:
    """Size, time, rate and memory."""
    rows = [
        [
            r["method"],
            f"{r['size']}×{r['size']}",
            f"{r['factor']}×",
            r["workers"],
            f"{r['seconds']:.0f}",
            f"{r['samples_per_s'] / 1e3:.0f}",
            f"{r['peak_gib']:.2f}",
        ]
        for r in result["rows"]
    ]
    header = ["method", "samples", "finer", "processes", "s", "thousand samples / s", "peak GiB"]
    return {"tiles": report.table(header, rows)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("size", type=int)
    parser.add_argument("workers", type=int)
    parser.add_argument("method")
    print(json.dumps(child(**vars(parser.parse_args()))))
