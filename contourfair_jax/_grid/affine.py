"""Affine maps from sample index to world coordinates, in array order.

An affine map of a d-dimensional grid is a ``(d + 1, d + 1)`` matrix ``A`` with
``world = A[:d, :d] @ index + A[:d, d]``.  Index and world coordinates are both in array order
(a raster's are ``(row, column)`` and ``(y, x)``), and index 0 is the *centre* of the first sample.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._support.errors import InputError

# A coordinate may stray this far, in steps, from even spacing (float32 rounding does).
_UNEVEN = 0.01
# Degrees all the way round.
TURN = 360.0
SKEWED = "the axes are not perpendicular; fairing treats them as if they were"


def affine_from_axes(coordinates: Sequence[np.ndarray], names: Sequence[str]) -> np.ndarray:
    """The affine map of evenly spaced coordinates, one 1-D array per axis.

    Raises
    ------
    InputError
        A coordinate is not finite, not evenly spaced, or all the same.
    """
    ndim = len(coordinates)
    affine = np.eye(ndim + 1)
    for axis, (values, name) in enumerate(zip(coordinates, names, strict=True)):
        # Neighbours may each be rounded by one unit of their type.
        grain = np.spacing(np.abs(values).max()) if values.dtype.kind == "f" else 0.0
        values = np.asarray(values, dtype=np.float64)
        step = (values[-1] - values[0]) / (len(values) - 1) if len(values) > 1 else 1.0
        if not np.isfinite(values).all() or step == 0:
            raise InputError(f"coordinate {name!r} must be finite and change along its axis")
        stray = np.abs(values - values[0] - step * np.arange(len(values))).max() / abs(step)
        if stray > max(_UNEVEN, 2 * float(grain) / abs(step)):
            raise InputError(
                f"coordinate {name!r} is not evenly spaced (up to {stray:.2g} steps off); "
                "resample it, or save the array alone as .npy to use sample numbers"
            )
        affine[axis, axis] = step
        affine[axis, ndim] = values[0]
    return affine


def axes_from_affine(affine: np.ndarray, shape: Sequence[int]) -> list[np.ndarray] | None:
    """One coordinate array per axis, or None where the axes are turned against the world's."""
    ndim = len(shape)
    linear = affine[:ndim, :ndim]
    if np.count_nonzero(linear - np.diag(np.diag(linear))):
        return None
    return [affine[k, ndim] + affine[k, k] * np.arange(n) for k, n in enumerate(shape)]


def diagonal_affine(spacing: Sequence[float], origin: Sequence[float]) -> np.ndarray:
    """The map of a grid along the axes of its coordinates."""
    affine = np.diag([*spacing, 1.0])
    affine[:-1, -1] = origin
    return affine


def spacing_of(affine: np.ndarray) -> tuple[float, ...]:
    """The distance between neighbouring samples along each array axis."""
    linear = affine[:-1, :-1]
    return tuple(float(step) for step in np.sqrt((linear**2).sum(axis=0)))


def origin_of(affine: np.ndarray, spacing: Sequence[float]) -> tuple[float, ...]:
    """The world position of sample 0 where ``origin + spacing * index`` is the world, else zeros.

    Fields have positive spacing, so a north-up raster (whose y falls with the row) cannot have its
    world coordinates as field coordinates; `Grid.world` maps them.
    """
    ndim = len(spacing)
    if np.array_equal(affine[:ndim, :ndim], np.diag(spacing)):
        return tuple(float(value) for value in affine[:ndim, ndim])
    return (0.0,) * ndim


def is_turned(affine: np.ndarray) -> bool:
    """Whether steps along an axis change more than the coordinate of its name."""
    linear = np.abs(affine[:-1, :-1])
    return bool((linear - np.diag(np.diag(linear))).max() > 1e-9 * linear.max())


def is_skewed(affine: np.ndarray) -> bool:
    """Whether some axes of the grid are not perpendicular."""
    linear = affine[:-1, :-1] / np.asarray(spacing_of(affine))
    products = linear.T @ linear
    return bool(np.abs(products - np.eye(len(products))).max() > 1e-6)


def seam_note(name: str) -> str:
    """Note on an axis that goes all the way round."""
    return f"{name} goes all around; the cells between its last and first sample are left out"


def refined_shape(shape: Sequence[int], factors: Sequence[int]) -> tuple[int, ...]:
    """Samples per axis of a grid with that many times as many steps along each."""
    return tuple(factor * (n - 1) + 1 for n, factor in zip(shape, factors, strict=True))


def refine_affine(affine: np.ndarray, factors: Sequence[float]) -> np.ndarray:
    """The map of a grid with that many times as many steps; sample 0 stays where it is."""
    refined = affine.copy()
    refined[:-1, :-1] /= np.asarray(factors)
    return refined


def crop_affine(affine: np.ndarray, start: Sequence[int]) -> np.ndarray:
    """The map of the part of the grid that begins at sample `start`."""
    cropped = affine.copy()
    cropped[:-1, -1] += affine[:-1, :-1] @ np.asarray(start, dtype=np.float64)
    return cropped


def describe_factors(factors: Sequence[int]) -> str:
    """``4``, or ``1 x 1 x 4`` where they differ."""
    if len(set(factors)) == 1:
        return str(factors[0])
    return " x ".join(map(str, factors))
