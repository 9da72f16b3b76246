"""GMT's ``surface`` and ``greenspline``, where the program ``gmt`` is installed (GMT 6).

Samples are scaled to ``[0, 1]`` on the way in and back on the way out, so that GMT's convergence
limits, which are absolute or in single precision, do not depend on units.
"""

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.common.peers import Array, Spacing


class NotConverged(RuntimeError):
    """GMT stopped with an error or returned values that are not finite."""


def version() -> str | None:
    """Version of the installed GMT, or None."""
    if shutil.which("gmt") is None:
        return None
    call = subprocess.run(["gmt", "--version"], capture_output=True, text=True, check=False)
    return call.stdout.strip() or None


def _gmt(arguments: list[str], folder: str, given: bytes = b"") -> bytes:
    call = subprocess.run(
        ["gmt", *arguments], input=given, cwd=folder, capture_output=True, check=False
    )
    if call.returncode:
        raise NotConverged(call.stderr.decode(errors="replace").strip()[-300:])
    return call.stdout


def _gridded(
    points: Array, values: Array, shape: tuple[int, ...], factor: int, command: list[str]
) -> Array:
    """Values on a grid that is `factor` times finer than `shape`, from scattered points."""
    rows, columns = shape
    low, span = values.min(), np.ptp(values) or 1.0
    table = np.column_stack([points[:, 1], points[:, 0], (values - low) / span])
    region = [f"-R0/{columns - 1}/0/{rows - 1}", f"-I{1.0 / factor!r}", "-bi3d", "-Gout.grd"]
    with tempfile.TemporaryDirectory() as folder:
        _gmt([*command, *region, "-Vq"], folder, table.astype(np.float64).tobytes())
        # ZBL: rows from the bottom, so that row 0 is y = 0 again.
        raw = _gmt(["grd2xyz", "out.grd", "-ZBLd", "-Vq"], folder)
        Path(folder, "out.grd").unlink(missing_ok=True)
    refined = np.frombuffer(raw).reshape((rows - 1) * factor + 1, (columns - 1) * factor + 1)
    if not np.isfinite(refined).all() or np.abs(refined).max() > 1e3:
        raise NotConverged("values are not finite or 1000 times the samples' range")
    return low + span * refined


def _interpolate(values: Array, factor: int, command: list[str]) -> Array:
    valid = np.isfinite(values)
    points = np.argwhere(valid).astype(float)
    return _gridded(points, values[valid], values.shape, factor, command)


def surface_points(
    points: Array, values: Array, shape: tuple[int, ...], tension: float = 0.0
) -> Array:
    """``gmt surface`` through scattered points, in units of the grid of `shape`."""
    command = ["surface", f"-T{tension}"]
    try:
        return _gridded(points, values, shape, 1, command)
    except NotConverged:
        return _gridded(points, values, shape, 1, [*command, "-Z1"])


def surface(values: Array, spacing: Spacing, factor: int, tension: float = 0.0) -> Array:
    """Continuous-curvature spline in tension on the refined grid (``gmt surface -T``).

    With its default over-relaxation (1.4) GMT 6.4 diverges on many fields at factor 2; those are
    run again without (``-Z1``).
    """
    command = ["surface", f"-T{tension}"]
    try:
        return _interpolate(values, factor, command)
    except NotConverged:
        return _interpolate(values, factor, [*command, "-Z1"])


def surface_tension(values: Array, spacing: Spacing, factor: int) -> Array:
    """``gmt surface -T0.25``, the setting its manual recommends for potential fields."""
    return surface(values, spacing, factor, 0.25)


def greenspline(values: Array, spacing: Spacing, factor: int) -> Array:
    """Minimum-curvature Green's functions, a dense solve (``gmt greenspline -Sc``)."""
    return _interpolate(values, factor, ["greenspline", "-Sc", "-Z1"])
