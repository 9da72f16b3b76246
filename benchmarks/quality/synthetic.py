"""Made-up fields of many kinds: every fourth sample is kept, all others are compared.

Each family varies one parameter, from what the samples resolve well to what they barely do.
Lengths are in distances of samples that are kept.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from benchmarks.common import engine, metrics, peers, report
from benchmarks.common.peers import Array
from benchmarks.common.report import Result, Track

FACTOR = 4
# Samples kept along each axis of a plane and of a volume.
PLANE, VOLUME = 45, 15
SEED = 20


@dataclass(frozen=True)
class Member:
    """One field of a family, on the fine grid."""

    family: str
    name: str
    truth: Array


def _axes(count: int, ndim: int) -> list[Array]:
    """Coordinates in samples that are kept, on the fine grid."""
    axis = np.arange(FACTOR * (count - 1) + 1) / FACTOR
    return list(np.meshgrid(*[axis] * ndim, indexing="ij"))


def _smooth_noise(random: np.random.Generator, shape: tuple[int, ...], sigma: float) -> Array:
    pad = round(4 * FACTOR * sigma)
    noise = random.standard_normal([n + 2 * pad for n in shape])
    smooth = ndimage.gaussian_filter(noise, FACTOR * sigma)
    smooth = smooth[tuple(slice(pad, pad + n) for n in shape)]
    return smooth / smooth.std()


def _bumps(random: np.random.Generator, axes: list[Array], sigma: float, count: int) -> Array:
    total = np.zeros_like(axes[0])
    for _ in range(count):
        centre = random.uniform(0, axes[0].max(), len(axes))
        away = sum((x - c) ** 2 for x, c in zip(axes, centre, strict=True))
        total += random.uniform(0.3, 1.0) * np.exp(-away / (2 * sigma**2))
    return total


def _fractal(random: np.random.Generator, shape: tuple[int, ...], exponent: float) -> Array:
    """Noise whose spectrum falls with that power of the frequency, as that of terrain."""
    frequency = np.sqrt(sum(k**2 for k in np.meshgrid(*map(np.fft.fftfreq, shape), indexing="ij")))
    frequency[(0,) * len(shape)] = np.inf
    spectrum = np.fft.fftn(random.standard_normal(shape)) * frequency ** (-exponent / 2)
    field = np.real(np.fft.ifftn(spectrum))
    return field / field.std()


def planes() -> Iterator[Member]:
    """The fields in 2-D."""
    random = np.random.default_rng(SEED)
    x, y = axes = _axes(PLANE, 2)
    u, v = (2 * each / (PLANE - 1) - 1 for each in axes)
    shape = x.shape
    for sigma in (0.75, 1.25, 1.75, 2.5, 4.0):
        yield Member("smooth noise", f"sigma {sigma}", _smooth_noise(random, shape, sigma))
    for sigma in (1.2, 2.0, 3.5):
        yield Member("Gaussians", f"sigma {sigma}", _bumps(random, axes, sigma, 40))
    for length in (3.5, 5.0, 9.0):
        turn = 2 * np.pi / length
        yield Member("plane waves", f"length {length}", np.sin(turn * (0.6 * x - 0.8 * y)))
        yield Member("rings", f"length {length}", np.cos(turn * np.hypot(x - 18.3, y - 24.1)))
        waves = np.sin(turn * x) * np.cos(turn * y + 0.4)
        yield Member("products of waves", f"length {length}", waves)
    for exponent in (2.0, 2.7, 3.4, 4.0):
        rough = _fractal(random, shape, exponent)
        noise = 0.03 * random.standard_normal(shape)
        yield Member("fractal", f"exponent {exponent}", rough)
        yield Member("fractal, rounded", f"exponent {exponent}", np.round(20 * rough))
        yield Member("fractal, noisy", f"exponent {exponent}", rough + noise)
    for width in (1.0, 1.5, 2.5):
        yield Member("edges", f"oblique {width}", np.tanh((x - 0.45 * y - 11) / width))
        disk = np.tanh((13.2 - np.hypot(x - 21.3, y - 20.8)) / width)
        yield Member("edges", f"disk {width}", disk)
        stripes = np.sin(2 * np.pi * (x + 2 * np.sin(0.2 * y)) / (8 * width))
        yield Member("edges", f"stripes {width}", np.tanh(2 * stripes / width))
        across = (x - 0.8 * y - 6) / np.hypot(1, 0.8)
        yield Member("ridges", f"width {width}", np.exp(-(across**2) / (2 * width**2)))
    yield Member("kinks", "cone", np.hypot(x - 20.3, y - 25.1))
    yield Member("kinks", "roof", np.abs(x - 0.3 * y - 9) + 0.3 * np.abs(y - 20))
    yield Member("kinks", "root", np.sqrt(np.abs(u**2 + v - 0.3)))
    saddle = 3 * (1 - u) ** 2 * np.exp(-9 * u**2 - (3 * v + 1) ** 2) - np.exp(-((3 * u + 1) ** 2))
    yield Member("very smooth", "peaks", saddle)
    yield Member("very smooth", "Runge", 1 / (1 + 12 * (u**2 + v**2)))
    yield Member("white noise", "", random.standard_normal(shape))


def volumes() -> Iterator[Member]:
    """The fields in 3-D."""
    random = np.random.default_rng(SEED + 1)
    axes = _axes(VOLUME, 3)
    for sigma in (0.75, 1.25, 2.0):
        noise = _smooth_noise(random, axes[0].shape, sigma)
        yield Member("smooth noise, 3-D", f"sigma {sigma}", noise)
        yield Member("Gaussians, 3-D", f"sigma {sigma}", _bumps(random, axes, sigma, 60))
    for width in (1.0, 2.0):
        radius = np.sqrt(sum((x - c) ** 2 for x, c in zip(axes, (6.7, 7.1, 7.4), strict=True)))
        yield Member("edges, 3-D", f"ball {width}", np.tanh((4.6 - radius) / width))


def score(member: Member) -> Result:
    """PSNR in dB at the samples that were not kept, per method."""
    kept = (slice(None, None, FACTOR),) * member.truth.ndim
    left = np.ones(member.truth.shape, bool)
    left[kept] = False
    coarse = np.ascontiguousarray(member.truth[kept])
    spacing = (1.0,) * member.truth.ndim
    methods = {**peers.SPLINES, **engine.RECONSTRUCT}
    if member.truth.ndim == 3:
        methods.pop(engine.LOCAL)
    psnr = {
        name: metrics.psnr(method(coarse, spacing, FACTOR)[left], member.truth[left])
        for name, method in methods.items()
    }
    return {"family": member.family, "name": member.name, "psnr": psnr}


def run(track: Track = report.silent) -> Result:
    """Score all fields."""
    members = [*planes(), *volumes()]
    return {"members": [score(each) for each in track(members, "made-up fields")]}


def gains(members: list[Result], method: str) -> list[float]:
    """PSNR of `method` above the best spline, of those fields that it was tried on."""
    return [
        each["psnr"][method] - max(each["psnr"][name] for name in peers.SPLINES)
        for each in members
        if method in each["psnr"]
    ]


def tables(result: Result) -> dict[str, str]:
    """One row per family: the mean gain of each method, and the worst of the tuned one."""
    members = result["members"]
    families = list(dict.fromkeys(each["family"] for each in members))
    rows: list[list[object]] = []
    for family in [*families, None]:
        inside = [each for each in members if family in (None, each["family"])]
        gained = [gains(inside, name) for name in engine.RECONSTRUCT]
        means = [f"{np.mean(values):+.2f}" if values else "–" for values in gained]
        worst = f"{min(gains(inside, engine.TUNED)):+.2f}"
        rows.append([family or "**all**", len(inside), *means, worst])
    header = ["family", "fields", *[f"{name}, dB" for name in engine.RECONSTRUCT], "tuned, worst"]
    return {"synthetic": report.table(header, rows)}
