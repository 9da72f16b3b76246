"""Global fairing in tiles: how far it is from the whole grid, in both precisions."""

import numpy as np

from benchmarks.common import report
from benchmarks.common.report import Result, Track

X64 = True
FACTOR = 2


def _waves(shape: tuple[int, ...]) -> np.ndarray:
    """Smooth waves in all directions."""
    axes = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    phase = sum(x / (5 + 2 * k) for k, x in enumerate(axes))
    return np.sin(phase) + np.cos(axes[-1] / 9)


def _ridge(shape: tuple[int, int]) -> np.ndarray:
    """A thin ridge that crosses the borders of tiles at a small angle."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.exp(-(((y - 0.4 * shape[0] - 0.15 * x) / 2) ** 2))


def fields() -> dict[str, np.ndarray]:
    """Samples by name; each has several tiles."""
    from contourfair_jax.io import example

    rng = np.random.default_rng(0)
    return {
        "noise": rng.standard_normal((300, 400)),
        "thin ridge": _ridge((300, 400)),
        "terrain": example("jacksboro").values.astype(np.float64),
        "noise, volume": rng.standard_normal((24, 32, 140)),
        "waves, volume": _waves((24, 32, 140)),
    }


def deviation(values: np.ndarray, dtype: str) -> Result:
    """Largest difference over the range, computed in `dtype`, from the whole grid in float64."""
    import contourfair_jax as cf
    from contourfair_jax import tiles

    exact = cf.GlobalFairing(tolerance=1e-9)
    whole = np.asarray(cf.fair_field(values, method=exact).refine(FACTOR))
    count, largest = 0, 0.0
    for region, part in tiles.refine_tiles(
        values, FACTOR, method=cf.GlobalFairing(), dtype=np.dtype(dtype)
    ):
        count += 1
        largest = max(largest, float(np.abs(part - whole[region]).max()))
    return {"tiles": count, dtype: largest / float(np.ptp(values))}


def run(track: Track = report.silent) -> Result:
    """All fields, in both precisions."""
    rows = []
    for name, values in track(list(fields().items()), "seams"):
        row = {"field": name, "shape": list(values.shape)}
        for dtype in ("float64", "float32"):
            row |= deviation(values, dtype)
        rows.append(row)
    return {"factor": FACTOR, "rows": rows}


def tables(result: Result) -> dict[str, str]:
    """Deviations over the range."""
    rows = [
        [
            r["field"],
            report.size(r["shape"]),
            r["tiles"],
            f"{r['float64']:.0e}",
            f"{r['float32']:.0e}",
        ]
        for r in result["rows"]
    ]
    header = ["global fairing", "samples", "tiles", "float64", "float32"]
    return {"seams": report.table(header, rows)}
