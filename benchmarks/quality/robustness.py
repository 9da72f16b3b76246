"""Awkward cases: overshoot, NaN, reach of one sample, tile seams, crossing lines, holes in memory.

Protocol 6: what one bad or changed sample does, what seams tiles leave, whether lines of different
levels cross.
"""

import numpy as np
import shapely
from scipy import ndimage
from scipy.interpolate import CubicSpline
from skimage.measure import find_contours

from benchmarks.common import engine, fields, metrics, peers, report
from benchmarks.common.inside import even_levels
from benchmarks.common.peers import Array, Method
from benchmarks.common.report import Result, Track

X64 = True
METHODS: dict[str, Method] = {
    **peers.SPLINES,
    "interpax cubic2": peers.interpax_cubic2,
    **engine.MAIN,
}
SIZE, FACTOR = 32, 4
HALOS = (1, 2, 4, 8)


def _waves(size: int = SIZE) -> Array:
    axis = np.linspace(-1.0, 1.0, size)
    return fields.marschner_lobb_slice(*np.meshgrid(axis, axis, indexing="ij"))


def step_overshoot(method: Method) -> float:
    """Overshoot at a straight oblique 0-1 edge, 6 cells off the border, over the step."""
    axis = np.arange(SIZE) - SIZE / 2.0 + 0.5
    samples = (axis[:, None] - 0.4 * axis[None, :] > 0.0).astype(float)
    cut = slice(6 * FACTOR, -6 * FACTOR)
    return metrics.overshoot(method(samples, 1.0, FACTOR)[cut, cut], samples)


def nan_cells(method: Method) -> float | None:
    """Fraction of the refined grid that one NaN changes to NaN; None where it raises."""
    samples = _waves()
    samples[16, 16] = np.nan
    try:
        refined = method(samples, 1.0, FACTOR)
    except ValueError:
        return None
    return float(np.isnan(refined).mean())


def reach(method: Method, tolerance: float = 1e-12) -> int:
    """Farthest distance in cells at which one changed sample changes the result."""
    samples = _waves()
    bumped = samples.copy()
    bumped[16, 16] += 1.0
    change = np.abs(method(bumped, 1.0, FACTOR) - method(samples, 1.0, FACTOR)) > tolerance
    return int(np.ceil(np.abs(np.argwhere(change) / FACTOR - 16.0).max()))


def seam(method: Method, halo: int) -> float:
    """Largest difference between whole and tile (cells 12 to 20) with ``halo`` cells around it."""
    samples = _waves()
    region = slice(12 * FACTOR, 20 * FACTOR + 1)
    whole = method(samples, 1.0, FACTOR)[region, region]
    cut = slice(12 - halo, 20 + halo + 1)
    tile = method(np.ascontiguousarray(samples[cut, cut]), 1.0, FACTOR)
    inner = slice(halo * FACTOR, (halo + 8) * FACTOR + 1)
    return float(np.abs(tile[inner, inner] - whole).max())


def chaikin(line: Array, rounds: int = 3) -> Array:
    """Corner cutting."""
    closed = np.allclose(line[0], line[-1])
    for _ in range(rounds):
        first, second = line[:-1], line[1:]
        cut = np.stack([0.75 * first + 0.25 * second, 0.25 * first + 0.75 * second], axis=1)
        cut = cut.reshape(-1, 2)
        line = np.vstack([cut, cut[:1]]) if closed else np.vstack([line[:1], cut, line[-1:]])
    return line


def splined(line: Array) -> Array:
    """Cubic spline through the vertices, chord-length parameter, eight points per edge."""
    chords = np.linalg.norm(np.diff(line, axis=0), axis=1)
    kept = np.append(chords > 1e-9, True)
    line, chords = line[kept], chords[chords > 1e-9]
    if len(line) < 4:
        return line
    where = np.append(0.0, np.cumsum(chords))
    closed = np.allclose(line[0], line[-1])
    curve = CubicSpline(where, line, bc_type="periodic" if closed else "not-a-knot")
    return curve(np.interp(np.arange(8 * len(chords) + 1) / 8.0, np.arange(len(where)), where))


def averaged(line: Array, width: float = 2.0) -> Array:
    """Gaussian average over neighbouring vertices."""
    closed = np.allclose(line[0], line[-1])
    return ndimage.gaussian_filter1d(line, width, axis=0, mode="wrap" if closed else "nearest")


SMOOTHERS = {
    "bilinear, lines Chaikin 3x": chaikin,
    "bilinear, lines splined": splined,
    "bilinear, lines averaged": averaged,
}


def crossings(lines: list[tuple[float, Array]]) -> int:
    """Pairs of lines of different levels that meet."""
    shapes = [shapely.LineString(points) for _, points in lines if len(points) > 1]
    levels = [level for level, points in lines if len(points) > 1]
    tree = shapely.STRtree(shapes)
    first, second = tree.query(shapes, predicate="intersects")
    return sum(levels[i] < levels[j] for i, j in zip(first, second, strict=True))


def contour_lines(refined: Array, factor: int, levels: Array) -> list[tuple[float, Array]]:
    """Level and points, in samples, of every contour."""
    return [(float(v), line / factor) for v in levels for line in find_contours(refined, v)]


def crossing_lines(track: Track) -> Result:
    """Crossings among 40 levels of the under-resolved waves; bilinear lines smoothed as well."""
    samples = _waves(41)
    levels = even_levels(samples, 40)
    rough = contour_lines(samples, 1, levels)
    rows: Result = {
        name: crossings([(v, smooth(line)) for v, line in rough])
        for name, smooth in SMOOTHERS.items()
    }
    for name in track(list(METHODS), "crossing lines"):
        refined = METHODS[name](samples, 1.0, 8)
        rows[name] = crossings(contour_lines(refined, 8, levels))
    return rows


def run(track: Track = report.silent) -> Result:
    """All awkward cases for all methods."""
    rows: Result = {}
    for name in track(list(METHODS), "awkward cases"):
        method = METHODS[name]
        rows[name] = {
            "step_overshoot": step_overshoot(method),
            "nan_fraction": nan_cells(method),
            "reach_cells": reach(method),
            "seams": {str(halo): seam(method, halo) for halo in HALOS},
        }
    return {"methods": rows, "crossings": crossing_lines(track)}


def tables(result: Result) -> dict[str, str]:
    """One row per method."""
    rows: list[list[object]] = []
    for name, row in result["methods"].items():
        missing = row["nan_fraction"]
        rows.append(
            [
                name,
                f"{100 * row['step_overshoot']:.1f} %",
                "raises" if missing is None else f"{100 * missing:.1f} %",
                row["reach_cells"],
                *[f"{row['seams'][str(h)]:.0e}" for h in HALOS],
                result["crossings"][name],
            ]
        )
    for name in SMOOTHERS:
        rows.append([name, *[None] * (3 + len(HALOS)), result["crossings"][name]])
    header = [
        "method",
        "step overshoot",
        "one NaN spoils",
        "reach of a sample, cells",
        *[f"seam, halo {h}" for h in HALOS],
        "crossing lines",
    ]
    return {"robustness": report.table(header, rows)}
