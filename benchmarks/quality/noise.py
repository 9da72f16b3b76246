"""Noisy samples of made-up fields: how much of the noise is left between and at them."""

from collections.abc import Callable, Iterator

import jax.numpy as jnp
import numpy as np
from scipy import ndimage
from scipy.interpolate import RectBivariateSpline

import contourfair_jax as cf
from benchmarks.common import engine, metrics, peers, report
from benchmarks.common.peers import Array, Method
from benchmarks.common.report import Result, Track
from benchmarks.quality import synthetic
from benchmarks.quality.synthetic import FACTOR

# Noise as a part of the standard deviation of the field.
PARTS = (0.05, 0.2)
SEED = 7
FIELDS = (
    ("smooth noise", "sigma 1.75"),
    ("Gaussians", "sigma 2.0"),
    ("rings", "length 5.0"),
    ("fractal", "exponent 3.4"),
    ("edges", "disk 1.5"),
    ("edges", "stripes 2.5"),
    ("ridges", "width 1.5"),
    ("kinks", "roof"),
    ("very smooth", "peaks"),
)
# What peers are tried with that have no rule of their own: the best of these, the truth known.
WIDTHS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4)
STIFFNESSES = (1e-3, 1e-2, 0.1, 1.0, 10.0)


def _smoothing_spline(noisy: Array, noise: float) -> Iterator[Array]:
    """Whose sum of squares is that of the noise."""
    axes = [np.arange(float(n)) for n in noisy.shape]
    finer = peers.refined_axes(noisy.shape, FACTOR)
    allowed = noise**2 * noisy.size
    spline = RectBivariateSpline(axes[0], axes[1], noisy, s=allowed)  # pyright: ignore
    yield spline(finer[0], finer[1])


def _filtered_spline(noisy: Array, noise: float) -> Iterator[Array]:
    """Through samples that a Gaussian was run over."""
    for width in WIDTHS:
        yield peers.cubic(ndimage.gaussian_filter(noisy, width, mode="nearest"), 1.0, FACTOR)


def _thin_plate(noisy: Array, noise: float) -> Iterator[Array]:
    """Smoothing thin-plate splines over all samples."""
    for stiffness in STIFFNESSES:
        yield peers.thin_plate_rbf(noisy, 1.0, FACTOR, smoothing=stiffness, neighbors=None)


def _untold(refine: Method):
    """A method of the other tables, which does not know the noise."""

    def method(noisy: Array, noise: float) -> Iterator[Array]:
        yield refine(noisy, 1.0, FACTOR)

    return method


def _told(choose: Callable[[Array, float], cf.AbstractFairing]):
    """Ours with settings that are chosen with the noise known."""

    def method(noisy: Array, noise: float) -> Iterator[Array]:
        samples = jnp.asarray(noisy)
        yield np.asarray(cf.fair_field(samples, method=choose(noisy, noise)).refine(FACTOR))

    return method


METHODS: dict[str, Callable[[Array, float], Iterator[Array]]] = {
    "cubic": _untold(peers.cubic),
    "smoothing spline, told": _smoothing_spline,
    "filter and cubic, best": _filtered_spline,
    "thin-plate RBF, best": _thin_plate,
    engine.TUNED: _untold(engine.METHODS[engine.TUNED]),
    "global, told": _told(lambda noisy, noise: cf.GlobalFairing(sigma=noise)),
    "tuned, told": _told(lambda noisy, noise: cf.tune(noisy, sigma=noise)),
    engine.NOISY: _untold(engine.METHODS[engine.NOISY]),
}


def run(track: Track = report.silent) -> Result:
    """Root mean square errors, as parts of the noise."""
    random = np.random.default_rng(SEED)
    members = {(each.family, each.name): each.truth for each in synthetic.planes()}
    rows: list[Result] = []
    for key in track(list(FIELDS), "noisy fields"):
        truth = members[key]
        samples = truth[::FACTOR, ::FACTOR]
        for part in PARTS:
            noise = part * float(truth.std())
            noisy = samples + noise * random.normal(size=samples.shape)
            left = {
                name: min(metrics.rms(each - truth) for each in method(noisy, noise)) / noise
                for name, method in METHODS.items()
            }
            rows.append({"family": key[0], "name": key[1], "noise": part, "left": left})
    return {"rows": rows}


def tables(result: Result) -> dict[str, str]:
    """One row per field and noise; the last one has geometric means."""
    rows: list[list[object]] = []
    names = list(result["rows"][0]["left"])
    for row in result["rows"]:
        values = [row["left"][name] for name in names]
        cells = report.bold_least([report.figure(value, 2) for value in values], values)
        rows.append([f"{row['family']}, {row['name']}", f"{100 * row['noise']:.0f} %", *cells])
    means = [np.exp(np.mean([np.log(row["left"][n]) for row in result["rows"]])) for n in names]
    rows.append(["**mean**", "", *[report.figure(float(mean), 2) for mean in means]])
    return {"noise": report.table(["field", "noise", *names], rows)}
