"""How good a reconstruction is: errors, contour components, turning and bending of contours."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.measure import find_contours

Array = NDArray[np.float64]


def rms(error: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(error))))


def psnr(reconstruction: Array, truth: Array) -> float:
    """Peak signal-to-noise ratio in dB; the peak is the range of ``truth``."""
    return float(20.0 * np.log10(np.ptp(truth) / rms(reconstruction - truth)))


def parts(refined: Array, levels: Array) -> int:
    """Number of contour components over all levels."""
    return sum(len(find_contours(refined, level)) for level in levels)


def overshoot(refined: Array, samples: Array) -> float:
    """How far the reconstruction leaves the samples' range, as a fraction of that range."""
    low, high = samples.min(), samples.max()
    excess = max(low - refined.min(), refined.max() - high, 0.0)
    return float(excess / (high - low))


@dataclass(frozen=True)
class Shape:
    """What a closed contour looks like beside a circle.

    Parameters
    ----------
    turning : float
        Total absolute turning over ``2 pi``; 1 for every convex curve.
    bending : float
        Integral of squared curvature over that of the circle of the given radius.
    """

    turning: float
    bending: float


def contour_shape(refined: Array, level: float, scale: float, radius: float) -> Shape:
    """Turning and bending of the longest contour at ``level``.

    Parameters
    ----------
    refined : array, shape (ny, nx)
    level : float
    scale : float
        Refined cells per sample.
    radius : float
        Radius, in samples, of the circle that bending is divided by.
    """
    line = max(find_contours(refined, level), key=len)[:-1] / scale
    line = line[np.linalg.norm(line - np.roll(line, 1, axis=0), axis=1) > 1e-9]
    edges = np.roll(line, -1, axis=0) - line
    lengths = np.linalg.norm(edges, axis=1)
    headings = np.arctan2(edges[:, 1], edges[:, 0])
    angles = np.angle(np.exp(1j * (headings - np.roll(headings, 1))))
    at_vertex = 0.5 * (lengths + np.roll(lengths, 1))
    bending = np.sum(angles**2 / at_vertex)
    return Shape(
        turning=float(np.abs(angles).sum() / (2.0 * np.pi)),
        bending=float(bending * radius / (2.0 * np.pi)),
    )
