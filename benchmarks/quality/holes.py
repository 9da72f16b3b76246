"""Missing samples: fill them, compare with the samples that were taken away."""

import time

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

import contourfair_jax as cf
from benchmarks.common import data, engine, gmt, metrics, peers, report
from benchmarks.common.peers import Array
from benchmarks.common.report import Result, Track

X64 = True
SIZE = 96
FIELDS = ("Jacksboro terrain", "Mt St Helens terrain", "geopotential 500 hPa", "CT slice")
Mask = NDArray[np.bool_]


def _scattered(shape: tuple[int, ...]) -> Mask:
    return np.random.default_rng(3).uniform(size=shape) < 0.3


def _blocks(shape: tuple[int, ...]) -> Mask:
    missing = np.zeros(shape, bool)
    for row in range(10, shape[0] - 12, 24):
        for column in range(10, shape[1] - 12, 24):
            missing[row : row + 8, column : column + 8] = True
    return missing


def _clouds(shape: tuple[int, ...]) -> Mask:
    noise = np.random.default_rng(4).standard_normal(shape)
    smooth = ndimage.gaussian_filter(noise, 4.0, mode="wrap")
    return smooth > np.quantile(smooth, 0.8)


def _corner(shape: tuple[int, ...]) -> Mask:
    rows, columns = np.indices(shape)
    return rows + columns < 24


PATTERNS = {
    "30 % at random": _scattered,
    "8x8 blocks": _blocks,
    "clouds, 20 %": _clouds,
    "a corner": _corner,
}


def triangulated(values: Array) -> Array:
    """Linear interpolation over a Delaunay triangulation; nearest outside its hull."""
    valid = np.isfinite(values)
    known, wanted = np.argwhere(valid), np.argwhere(~valid)
    found = LinearNDInterpolator(known, values[valid])(wanted)
    outside = np.isnan(found)
    found[outside] = NearestNDInterpolator(known, values[valid])(wanted[outside])
    filled = values.copy()
    filled[~valid] = found
    return filled


def _rbf(values: Array) -> Array:
    return peers.thin_plate_rbf(values, 1.0, 1)


def _gmt_surface(values: Array) -> Array:
    return gmt.surface(values, 1.0, 1)


def _gmt_tension(values: Array) -> Array:
    return gmt.surface(values, 1.0, 1, 0.25)


def _fair(values: Array) -> Array:
    return np.asarray(engine.field(values, 1.0, engine.DEFAULT).samples)


def _fair_tuned(values: Array) -> Array:
    return np.asarray(engine.field(values, 1.0, engine.TUNED).samples)


FILLERS = {
    "triangulation": triangulated,
    "biharmonic": peers.biharmonic,
    "thin-plate RBF": _rbf,
}
if gmt.version():
    FILLERS |= {"GMT surface": _gmt_surface, "GMT surface T .25": _gmt_tension}
FILLERS[engine.DEFAULT] = _fair
if hasattr(cf, "tune"):
    FILLERS[engine.TUNED] = _fair_tuned


def run(track: Track = report.silent) -> Result:
    """PSNR in dB at the missing samples for every field, pattern and method."""
    cases, skipped = [], []
    for name in FIELDS:
        field = data.load(data.PLANE, name)
        if field is None:
            skipped.append(name)
            continue
        truth = np.ascontiguousarray(field.values[:SIZE, :SIZE])
        cases += [(name, pattern, truth) for pattern in PATTERNS]
    rows: list[Result] = []
    for name, pattern, truth in track(cases, "holes"):
        missing = PATTERNS[pattern](truth.shape)
        given = np.where(missing, np.nan, truth)
        row: Result = {"field": name, "pattern": pattern, "missing": int(missing.sum())}
        row["methods"] = {}
        for method, fill in FILLERS.items():
            start = time.perf_counter()
            try:
                filled = fill(given)
            except gmt.NotConverged as error:
                row["methods"][method] = {"failed": str(error)}
                continue
            seconds = time.perf_counter() - start
            # The peak is the range of the whole field, so that patterns compare.
            error = metrics.rms(filled[missing] - truth[missing])
            decibels = float(20.0 * np.log10(np.ptp(truth) / error))
            row["methods"][method] = {"psnr": decibels, "seconds": seconds}
        rows.append(row)
    return {"rows": rows, "skipped": skipped}


def tables(result: Result) -> dict[str, str]:
    """One row per field and pattern, the best in bold."""
    names = list(result["rows"][0]["methods"]) if result["rows"] else []
    rows = []
    for row in result["rows"]:
        values = [row["methods"][n].get("psnr") for n in names]
        cells = [None if v is None else f"{v:.1f}" for v in values]
        worst_first = [None if v is None else -v for v in values]
        rows.append([row["field"], row["pattern"], *report.bold_least(cells, worst_first)])
    return {"holes": report.table(["field", "missing", *names], rows)}
