"""Exact contours: crossings and proofs on all real fields, time and memory beside contourpy.

The peer traces the same field refined four times.  Its time does not include the refinement, its
memory includes the refined samples that it needs; ours includes all that is not the field.  Both
run in one thread; times are processor seconds, which other load on the machine does not change.
"""

import gc
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from contourpy import LineType, contour_generator
from scipy.ndimage import gaussian_filter

import contourfair_jax as cf
from benchmarks.common import data, engine, report
from benchmarks.common.inside import even_levels
from benchmarks.common.report import Result, Track
from contourfair_jax import AbstractFairing, BezierField, io, metrics

X64 = True
SIZE, FACTOR, LEVELS = 1024, 4, 10
KINDS = ("even", "samples")
TOLERANCES = (0.1, 0.03, 0.01, 0.003, 0.001)
_REPEATS = 3
_CHECKED = 1 << 17


def _basins(path: Path) -> tuple[np.ndarray, None, None]:
    with np.load(path, allow_pickle=False) as archive:
        return archive["data"], None, None


def _grid(path: Path) -> tuple[np.ndarray, None, None]:
    return io.read(path).values, None, None


# Labels, plateaus and missing samples: too odd for other tables.  Of volumes the middle slice.
EXTRA: dict[str, tuple[str, Callable]] = {
    "river basins": ("basin_mask.npz", _basins),
    "raster with missing samples": ("float_raster_with_nodata.tif", _grid),
    "temperature 3×3": ("nouragues_3x3.npz", data._pick(0)),
    "CT head": ("headsq_quarter.nrrd", _grid),
    "iron protein": ("ironProt.vtk", _grid),
    "channel facies": ("channels_facies.npz", data._pick()),
    "MR average": ("avg152T1_RL_nifti.nii.gz", _grid),
    "MR, few samples": ("anatomical.nii", _grid),
}
# Whose contours are also traced with the other method.
GLOBAL = "Maunga Whau terrain"


def raw_fields(folder: Path = data.FOLDER) -> Iterator[tuple[str, np.ndarray]]:
    """Names and samples, NaN where missing, of the plane data sets and of slices of volumes."""
    for name, (file, read) in {**data.PLANE, **EXTRA, **data.VOLUME}.items():
        if not (folder / file).exists():
            continue
        values, valid, _ = read(folder / file)
        values = np.asarray(values, np.float64)
        values = np.where(np.isfinite(values) & (True if valid is None else valid), values, np.nan)
        if values.ndim == 3:
            name, values = f"{name}, slice", values[:, :, values.shape[2] // 2]
        yield name, values


def levels_of(samples: np.ndarray, kind: str, count: int = LEVELS) -> np.ndarray:
    """Levels evenly between the extremes, or such that samples have: plateaus lie on them."""
    if kind == "even":
        return even_levels(samples, count)
    present = np.sort(samples[np.isfinite(samples)])
    levels = present[np.linspace(0, len(present) - 1, count + 2).astype(int)[1:-1]]
    return np.unique(levels)


def real_case(
    name: str, samples: np.ndarray, method: AbstractFairing | None = None
) -> list[Result]:
    """Crossings, unproved pieces and size for both kinds of levels."""
    field = cf.fair_field(samples, method=method)
    rows = []
    for kind in KINDS:
        start = time.process_time()
        lines = field.contours(levels_of(samples, kind))
        seconds = time.process_time() - start
        rows.append(
            {
                "field": name,
                "shape": list(samples.shape),
                "levels": kind,
                "lines": len(lines),
                "vertices": sum(len(line.points) for line in lines),
                "crossings": metrics.crossings(lines),
                "unproved": lines.unproved,
                "seconds": seconds,
            }
        )
    return rows


def large_fields() -> dict[str, np.ndarray]:
    """Samples of the fields that are timed: smooth noise, and terrain of all scales."""
    noise = np.random.default_rng(0).standard_normal((SIZE, SIZE))
    waves = [np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE)[None, :]]
    radius = np.sqrt(waves[0] ** 2 + waves[1] ** 2)
    radius[0, 0] = np.inf
    terrain = np.fft.irfft2(np.fft.rfft2(noise) / radius**2, s=noise.shape)
    return {"smooth noise": gaussian_filter(noise, 6.0, mode="wrap"), "terrain": terrain}


class _Peak:
    """Largest resident memory of this process while the block runs, above that at its start."""

    def __enter__(self) -> "_Peak":
        import psutil

        gc.collect()
        self._process = psutil.Process()
        self._start = self._process.memory_info().rss
        self.bytes, self._running = 0, True
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def _watch(self) -> None:
        while self._running:
            self.bytes = max(self.bytes, self._process.memory_info().rss - self._start)
            time.sleep(0.001)

    def __exit__(self, *error: object) -> None:
        self._running = False
        self._thread.join()


def _ours(net: np.ndarray) -> Callable[[np.ndarray], list]:
    field = BezierField(jnp.asarray(net), jnp.ones(2), jnp.zeros(2))

    def lines(levels: np.ndarray) -> list:
        return [(line.level, line.points) for line in field.contours(levels)]

    return lines


def _peer(refined: np.ndarray) -> Callable[[np.ndarray], list]:
    def lines(levels: np.ndarray) -> list:
        generator = contour_generator(z=refined, line_type=LineType.Separate)
        return [(float(v), line) for v in levels for line in generator.lines(v)]

    return lines


def child(who: str, file: str, levels: np.ndarray) -> Result:
    """Time and memory of one tracer in this process."""
    engine.use_x64(True)
    small = np.add.outer(np.arange(7.0), np.arange(7.0) ** 2)
    make = _ours if who == "ours" else _peer
    make(small)(np.array([3.5]))
    given = np.load(file) if who == "ours" else None
    trace = make(given) if given is not None else None
    with _Peak() as peak:
        if trace is None:
            trace = make(np.load(file))
        start = time.process_time()
        lines = trace(levels)
        times = [time.process_time() - start]
    vertices = sum(len(points) for _, points in lines)
    for _ in range(_REPEATS - 1):
        start = time.process_time()
        trace(levels)
        times.append(time.process_time() - start)
    return {
        "seconds": float(np.median(times)),
        "peak_bytes": peak.bytes,
        "lines": len(lines),
        "vertices": vertices,
    }


def large_case(name: str, samples: np.ndarray) -> Result:
    """Both tracers on one field, each in a process of its own, and how true their lines are."""
    field = cf.fair_field(samples)
    levels = levels_of(samples, "even")
    refined = np.asarray(field.refine(FACTOR))
    row: Result = {"field": name, "size": SIZE}
    with tempfile.TemporaryDirectory() as folder:
        for who, given in (("ours", np.asarray(field.control_points)), ("contourpy", refined)):
            file = str(Path(folder) / f"{who}.npy")
            np.save(file, given)
            command = [
                sys.executable,
                "-m",
                "benchmarks.quality.contours",
                who,
                file,
                *map(str, levels),
            ]
            call = subprocess.run(command, capture_output=True, text=True, check=True)
            row[who] = json.loads(call.stdout)
    ours = field.contours(levels)
    row["ours"] |= truth(field, [(line.level, line.points) for line in ours])
    row["ours"] |= {"unproved": ours.unproved, "crossings": metrics.crossings(ours)}
    scaled = [(v, line[:, ::-1] / FACTOR) for v, line in _peer(refined)(levels)]
    row["contourpy"] |= truth(field, scaled)
    return row


def truth(field: BezierField, lines: list[tuple[float, np.ndarray]]) -> Result:
    """Error of vertices over the range, and distance of chords from the contour, in cells.

    Of the distances, found by Newton's method, the largest and the one that 99.9 % keep to: near
    saddles that a line passes on the wrong side, Newton can go far.
    """
    starts = np.concatenate([line[:-1] for _, line in lines])
    ends = np.concatenate([line[1:] for _, line in lines])
    levels = np.repeat([v for v, _ in lines], [len(line) - 1 for _, line in lines])
    chosen = np.random.default_rng(0).permutation(len(starts))[:_CHECKED]
    starts, ends, levels = starts[chosen], ends[chosen], levels[chosen]
    jet = jax.jit(lambda points: field.jet(points, outside="clamp"))
    vertex = np.abs(np.asarray(jet(starts)[0]) - levels).max() / np.ptp(np.asarray(field.samples))
    farthest = np.zeros(len(starts))
    for part in (0.0, 0.25, 0.5, 0.75):
        points = starts + part * (ends - starts)
        true = points
        for _ in range(6):
            value, gradient, _ = map(np.asarray, jet(true))
            squared = np.maximum((gradient**2).sum(1), 1e-300)
            true = true - ((value - levels) / squared)[:, None] * gradient
        farthest = np.maximum(farthest, np.linalg.norm(true - points, axis=1))
    return {
        "vertex_error": float(vertex),
        "chord_within": float(np.quantile(farthest, 0.999)),
        "chord_distance": float(farthest.max()),
    }


def tolerance_case(tolerance: float) -> Result:
    """Vertices and time against the tolerance, on the under-resolved waves of the tables."""
    axis = np.linspace(-1.0, 1.0, 41)
    radius = np.hypot(axis[:, None], axis[None, :])
    field = cf.fair_field(np.cos(12 * np.pi * np.cos(np.pi * radius / 2)))
    levels = levels_of(np.asarray(field.samples), "even")
    start = time.process_time()
    lines = field.contours(levels, tolerance)
    seconds = time.process_time() - start
    pairs = [(line.level, line.points) for line in lines]
    vertices = sum(len(points) for _, points in pairs)
    found: Result = {"tolerance": tolerance, "vertices": vertices, "seconds": seconds}
    return found | truth(field, pairs)


def run(track: Track = report.silent) -> Result:
    """All real fields, the large fields, and the tolerances."""
    cases: list[tuple] = list(raw_fields())
    globally = cf.GlobalFairing()
    cases += [(f"{name}, global", samples, globally) for name, samples in cases if name == GLOBAL]
    real = [row for case in track(cases, "real fields") for row in real_case(*case)]
    large = [large_case(*case) for case in track(list(large_fields().items()), "large fields")]
    return {"real": real, "large": large, "tolerances": [tolerance_case(t) for t in TOLERANCES]}


def tables(result: Result) -> dict[str, str]:
    """Real fields, the peer, tolerances."""
    real = [
        [
            f"{row['field']}, {row['levels']}",
            report.size(row["shape"]),
            row["lines"],
            row["vertices"],
            row["crossings"],
            row["unproved"],
            f"{row['seconds']:.2f}",
        ]
        for row in result["real"]
    ]
    header = ["field, levels", "samples", "lines", "vertices", "crossings", "unproved", "s"]
    large = [
        [f"{row['field']}, {who}", *_figures(row[who])]
        for row in result["large"]
        for who in ("ours", "contourpy")
    ]
    columns = [
        "1024×1024, 10 levels",
        "s",
        "MiB",
        "lines",
        "vertices",
        "off the level",
        "99.9 % within, cells",
    ]
    tolerances = [
        [
            f"{row['tolerance']:g}",
            row["vertices"],
            f"{row['chord_distance']:.2g}",
            f"{row['seconds']:.2f}",
        ]
        for row in result["tolerances"]
    ]
    return {
        "contours": report.table(header, real),
        "contours-peer": report.table(columns, large),
        "contours-tolerance": report.table(
            ["tolerance, cells", "vertices", "off by at most, cells", "s"], tolerances
        ),
    }


def _figures(row: dict[str, Any]) -> list[object]:
    return [
        f"{row['seconds']:.2f}",
        f"{row['peak_bytes'] / 2**20:.0f}",
        row["lines"],
        row["vertices"],
        f"{row['vertex_error']:.0e}",
        f"{row['chord_within']:.2g}",
    ]


if __name__ == "__main__":
    print(json.dumps(child(sys.argv[1], sys.argv[2], np.array(sys.argv[3:], float))))
