"""How far reconstructions are above the best spline, over all fields of a kind."""

import numpy as np

from benchmarks.common import engine, report
from benchmarks.quality import real, synthetic


def table() -> str | None:
    """Means and worst fields of what is stored; None where something is not."""
    plane, volume, made_up = (report.load(name) for name in ("real2d", "real3d", "synthetic"))
    if plane is None or volume is None or made_up is None:
        return None
    rows: list[list[object]] = []
    for kind, result in (("real, 2-D", plane), ("real, 3-D", volume)):
        each = [list(real.gains(result, name).values()) for name in engine.RECONSTRUCT]
        rows.append([kind, len(result["fields"]), *map(_mean_and_worst, each)])
    members = made_up["members"]
    each = [synthetic.gains(members, name) for name in engine.RECONSTRUCT]
    rows.append(["made up", len(members), *map(_mean_and_worst, each)])
    return report.table(["fields", "number", *[f"{name}, dB" for name in engine.RECONSTRUCT]], rows)


def _mean_and_worst(values: list[float]) -> str | None:
    return f"{np.mean(values):+.2f} ({min(values):+.2f})" if values else None
