"""Small experiments on what users of contours complain about, for every method.

1. Marschner-Lobb volume: value and normal errors at random points.
2. Antialiased disk: turning and bending of its mid contour, mean over sub-pixel positions.
3. Binary disk: the same, nothing to go by but 0 and 1.
4. Thin oblique ridges: how many break at half height.
5. Real data: benchmark ``real``.
6. Awkward cases: benchmark ``robustness``.
"""

from collections.abc import Callable
from typing import cast

import jax.numpy as jnp
import numpy as np
from scipy import ndimage

from benchmarks.common import engine, metrics, peers, report
from benchmarks.common.fields import VOLUME, marschner_lobb, marschner_lobb_gradient
from benchmarks.common.peers import Array, Method
from benchmarks.common.report import Result, Track

X64 = True
SIZE, RADIUS = 16, 4.3
ANGLES = np.deg2rad(np.arange(10.0, 46.0, 7.0))
OFFSETS = (0.0, 1.0 / 3.0, 2.0 / 3.0)
WIDTHS = (0.45, 0.5, 0.55)
METHODS: dict[str, Method] = {**peers.SPLINES, **engine.MAIN}


def _normal_error(gradient: Array, truth: Array) -> float:
    """Mean angle in degrees between gradients."""
    cosine = np.sum(gradient * truth, axis=-1) / (
        np.linalg.norm(gradient, axis=-1) * np.linalg.norm(truth, axis=-1)
    )
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean())


def _differences(evaluate: Callable[[Array], Array], points: Array, step: float = 1e-5) -> Array:
    """Central differences, in units of the points."""
    shifts = step * np.eye(points.shape[1])
    slopes = [(evaluate(points + s) - evaluate(points - s)) / (2.0 * step) for s in shifts]
    return np.stack(slopes, axis=-1)


def marschner_lobb_volume(track: Track, count: int = 60_000) -> Result:
    """Protocol 1: RMS error and mean normal error at random points with all ``|x| < 0.85``."""
    points = np.random.default_rng(1).uniform(-0.85, 0.85, (count, 3))
    values, slopes = marschner_lobb(*points.T), marschner_lobb_gradient(*points.T)
    samples, spacing = VOLUME.samples(), VOLUME.spacing
    index = (points + 1.0) / spacing
    rows: Result = {}
    for name in track([*peers.POINTS, *engine.MAIN], "Marschner-Lobb volume"):
        if name in peers.POINTS:
            spline = peers.POINTS[name]
            found = spline(samples, index)
            gradient = _differences(lambda p, f=spline: f(samples, p), index)
        else:
            field = engine.field(samples, spacing, name)
            where = jnp.asarray(points + 1.0)
            found, gradient = np.asarray(field(where)), np.asarray(field.gradient(where))
        rows[name] = {
            "rms": metrics.rms(found - values),
            "normal_degrees": _normal_error(gradient, slopes),
        }
    return rows


def disk_samples(centre: Array, antialiased: bool, fine: int = 16) -> Array:
    """Disk of radius 4.3 on 16 x 16: covered fraction of each pixel, or 0 and 1."""
    if antialiased:
        axis = (np.arange(SIZE * fine) + 0.5) / fine - 0.5
    else:
        axis, fine = np.arange(SIZE, dtype=float), 1
    inside = np.hypot(axis[:, None] - centre[0], axis[None, :] - centre[1]) < RADIUS
    return inside.reshape(SIZE, fine, SIZE, fine).mean(axis=(1, 3))


def disks(track: Track, antialiased: bool, positions: int = 16, factor: int = 6) -> Result:
    """Protocols 2 and 3: mean turning and bending over sub-pixel positions."""
    rows: Result = {}
    for name in track(list(METHODS), "disk"):
        centres = 7.5 + np.random.default_rng(2).uniform(-0.5, 0.5, (positions, 2))
        shapes = []
        for centre in centres:
            samples = disk_samples(centre, antialiased)
            refined = METHODS[name](samples, 1.0, factor)
            shapes.append(metrics.contour_shape(refined, 0.5, factor, RADIUS))
        rows[name] = {
            "turning": float(np.mean([s.turning for s in shapes])),
            "bending": float(np.mean([s.bending for s in shapes])),
        }
    return rows


def ridge_samples(angle: float, offset: float, width: float) -> Array:
    """Gaussian ridge ``exp(-(d / width)^2)`` on 16 x 16; ``d`` is in samples."""
    axis = np.arange(SIZE) - (SIZE - 1) / 2.0
    distance = np.sin(angle) * axis[:, None] - np.cos(angle) * axis[None, :] - offset
    return np.exp(-((distance / width) ** 2))


def is_broken(refined: Array, factor: int, margin: int = 3) -> bool:
    """Whether the set above one half is not one piece, ``margin`` cells away from the border."""
    cut = slice(margin * factor, -margin * factor)
    _, count = cast(tuple[Array, int], ndimage.label(refined[cut, cut] >= 0.5))
    return count != 1


def ridges(track: Track, factor: int = 6) -> Result:
    """Protocol 4: broken ridges out of 18 (six angles, three offsets), per ridge width."""
    rows: Result = {}
    for name in track(list(METHODS), "ridges"):
        rows[name] = {
            f"broken at width {width}": sum(
                is_broken(METHODS[name](ridge_samples(a, o, width), 1.0, factor), factor)
                for a in ANGLES
                for o in OFFSETS
            )
            for width in WIDTHS
        }
    return rows


def run(track: Track = report.silent) -> Result:
    """Protocols 1 to 4."""
    return {
        "marschner_lobb": marschner_lobb_volume(track),
        "antialiased_disk": disks(track, antialiased=True),
        "binary_disk": disks(track, antialiased=False),
        "ridges": ridges(track),
    }


def tables(result: Result) -> dict[str, str]:
    """One row per method."""
    rows = []
    for name, disk in result["antialiased_disk"].items():
        volume = result["marschner_lobb"].get(name, {})
        degrees = volume.get("normal_degrees")
        binary, broken = result["binary_disk"][name], result["ridges"][name]
        rows.append(
            [
                name,
                report.figure(volume.get("rms")),
                f"{degrees:.1f}" if degrees is not None else None,
                f"{disk['turning']:.2f}",
                f"{disk['bending']:.2f}",
                f"{binary['turning']:.2f}",
                f"{binary['bending']:.1f}",
                " / ".join(map(str, broken.values())),
            ]
        )
    header = [
        "method",
        "Marschner-Lobb 41³, RMS",
        "normals, degrees off",
        "disk: turning / 2π",
        "bending / circle's",
        "binary disk: turning",
        "bending",
        f"broken ridges of 18, width {' / '.join(map(str, WIDTHS))}",
    ]
    return {"protocols": report.table(header, rows)}
