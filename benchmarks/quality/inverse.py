"""Inverse problems on real data: contours to DEM, missing slices, scattered points."""

import time
from collections.abc import Callable, Iterator

import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicSpline, RBFInterpolator, griddata
from skimage.measure import find_contours

import contourfair_jax as cf
from benchmarks.common import data, gmt, metrics, report
from benchmarks.common.peers import Array
from benchmarks.common.report import Result, Track
from contourfair_jax import inverse
from contourfair_jax.io import InputError, example, read

X64 = True
TERRAIN = ((164, 228), (180, 244))
INTERVAL = 20.0
SLICES = 3
POINTS = 400
# Elevations are whole metres.
SIGMA = 1 / np.sqrt(12.0)
# What the fair fields of the results are made of; the fit itself is linear.
LINEAR = cf.LocalFairing(iterations=0)

Fill = Callable[[], Array]


def _terrain() -> Array:
    return example("jacksboro").crop(TERRAIN).values.astype(float)


def _fitted(observations: object, shape: tuple[int, ...], prior: inverse.ThinPlate) -> Array:
    fit = inverse.fit_samples(observations, shape, method=LINEAR, regularisation=prior)  # pyright: ignore
    return np.asarray(fit.samples)


def contour_points(truth: Array) -> tuple[list, Array, Array]:
    """Lines of the bilinear field every `INTERVAL`; all their vertices and levels."""
    levels = np.arange(np.ceil(truth.min() / INTERVAL) * INTERVAL, truth.max(), INTERVAL)
    # Levels that samples have would give lines through samples only; half a metre avoids it.
    lines = [(level + 0.5, line) for level in levels for line in find_contours(truth, level + 0.5)]
    points = np.concatenate([line for _, line in lines])
    values = np.concatenate([np.full(len(line), level) for level, line in lines])
    return lines, points, values


def _peers(points: Array, values: Array, shape: tuple[int, ...]) -> dict[str, Fill]:
    """What is fitted to points by others."""
    grid = tuple(np.indices(shape))
    nearest = griddata(points, values, grid, "nearest")

    def gridded(kind: str) -> Array:
        found = griddata(points, values, grid, kind)
        return np.where(np.isnan(found), nearest, found)

    methods: dict[str, Fill] = {
        "linear": lambda: gridded("linear"),
        "cubic": lambda: gridded("cubic"),
    }
    if gmt.version():
        methods |= {
            "GMT surface": lambda: gmt.surface_points(points, values, shape, 0.0),
            "GMT surface T .25": lambda: gmt.surface_points(points, values, shape, 0.25),
        }
    return methods


def dem_from_contours() -> Iterator[tuple[str, Array, Array | None, dict[str, Fill]]]:
    """Terrain from its own contour lines."""
    truth = _terrain()
    lines, points, values = contour_points(truth)
    observed = inverse.ContourLines(lines, sigma=SIGMA)
    ours: dict[str, Fill] = {
        "fit": lambda: _fitted(observed, truth.shape, inverse.ThinPlate()),
        "fit, tension 1": lambda: _fitted(observed, truth.shape, inverse.ThinPlate(1e-3, 1.0)),
    }
    yield "terrain from 20 m contours", truth, None, {**_peers(points, values, truth.shape), **ours}


def scattered_terrain() -> Iterator[tuple[str, Array, Array | None, dict[str, Fill]]]:
    """Terrain from a tenth of its samples."""
    truth = _terrain()
    chosen = np.random.default_rng(5).choice(truth.size, POINTS, replace=False)
    points = np.stack(np.unravel_index(chosen, truth.shape), axis=-1).astype(float)
    values = truth.ravel()[chosen]
    observed = inverse.Values(points, values, SIGMA)
    holes = np.full(truth.size, np.nan)
    holes[chosen] = values

    def filled(tension: float) -> Array:
        method = cf.GlobalFairing(tension=tension)
        return np.asarray(cf.fair_field(holes.reshape(truth.shape), method=method).samples)

    def rbf() -> Array:
        grid = np.indices(truth.shape).reshape(2, -1).T
        return RBFInterpolator(points, values)(grid).reshape(truth.shape)

    ours: dict[str, Fill] = {
        "thin-plate RBF": rbf,
        "fit": lambda: _fitted(observed, truth.shape, inverse.ThinPlate()),
        "fit, tension 1": lambda: _fitted(observed, truth.shape, inverse.ThinPlate(1e-3, 1.0)),
        "global, holes filled": lambda: filled(0.0),
    }
    name = f"terrain from {POINTS} of {truth.size} samples"
    yield name, truth, None, {**_peers(points, values, truth.shape), **ours}


def missing_slices() -> Iterator[tuple[str, Array, Array | None, dict[str, Fill]]]:
    """A CT volume from every third slice; nothing where the folder of real data is missing."""
    try:
        grid = read(data.FOLDER / "headsq_quarter.nrrd")
    except InputError:
        return
    steps = np.asarray(grid.spacing)
    truth = np.asarray(grid.values, float)[20:51, 8:56, 8:56]
    at, known = np.arange(len(truth)), truth[::SLICES]
    kept = np.zeros(truth.shape, bool)
    kept[::SLICES] = True
    points = np.argwhere(kept) * steps

    def fit() -> Array:
        found = inverse.fit_samples(
            inverse.Values(points, truth[kept], 1.0),
            truth.shape,
            spacing=steps,
            method=LINEAR,
        )
        return np.asarray(found.samples)

    def faired(method: cf.AbstractFairing) -> Array:
        spacing = steps * [SLICES, 1, 1]
        field = cf.fair_field(known, spacing=spacing, method=method)
        everywhere = jnp.asarray(np.moveaxis(np.indices(truth.shape), 0, -1) * steps)
        return np.asarray(field(everywhere))

    methods: dict[str, Fill] = {
        "linear": lambda: np.stack(
            [np.interp(at, at[::SLICES], column) for column in known.reshape(len(known), -1).T], 1
        ).reshape(truth.shape),
        "cubic": lambda: CubicSpline(at[::SLICES], known)(at),
        "fit": fit,
        "fair_field, local": lambda: faired(cf.LocalFairing()),
        "fair_field, global": lambda: faired(cf.GlobalFairing()),
    }
    yield "CT from every third slice", truth, ~kept, methods


def run(track: Track = report.silent) -> Result:
    """Root mean square error and time of every method on every task."""
    tasks = [
        task for make in (dem_from_contours, scattered_terrain, missing_slices) for task in make()
    ]
    rows = []
    for name, truth, judged, methods in track(tasks, "inverse problems"):
        row = {"task": name, "shape": list(truth.shape), "methods": {}}
        for method, fill in methods.items():
            start = time.perf_counter()
            try:
                difference = fill() - truth
            except gmt.NotConverged as error:
                row["methods"][method] = {"failed": str(error)}
                continue
            seconds = time.perf_counter() - start
            difference = difference if judged is None else difference[judged]
            row["methods"][method] = {"rms": metrics.rms(difference), "seconds": seconds}
        rows.append(row)
    return {"rows": rows, "gmt": gmt.version()}


def tables(result: Result) -> dict[str, str]:
    """One row per method, a column per task: error and, in brackets, seconds; the best in bold."""
    names = list(dict.fromkeys(name for row in result["rows"] for name in row["methods"]))
    columns = []
    for row in result["rows"]:
        found = [row["methods"].get(name, {}) for name in names]
        errors = [each.get("rms") for each in found]
        cells = report.bold_least([e and f"{e:.3g}" for e in errors], errors)
        columns.append(
            [c and f"{c} ({each['seconds']:.2g} s)" for c, each in zip(cells, found, strict=True)]
        )
    header = ["method", *(row["task"] for row in result["rows"])]
    return {"inverse": report.table(header, zip(names, *columns, strict=True))}
