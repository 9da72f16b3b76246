"""Grids to resample to: with another spacing, or like another grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .._support.errors import InputError
from .grid import Grid, no_samples
from .reference import same_system

# Points this near to samples along an axis, in steps, are there: coordinates are rounded.
NEAR = 1e-6


def spaced(grid: Grid, steps: Sequence[float]) -> Grid:
    """An outline from the first sample of the grid on, with other steps, within its samples.

    Raises
    ------
    InputError
        A step is longer than the grid.
    """
    ratios = np.asarray(steps) / grid.steps
    last = np.asarray(grid.shape) - 1
    for name, step, whole in zip(grid.axes, steps, last * grid.steps, strict=True):
        if step > whole * (1 + NEAR):
            raise InputError(
                f"--spacing {step:g} is longer than all of axis {name!r}, {whole:g} in the "
                "coordinates of the file"
            )
    shape = tuple(int(n) + 1 for n in np.floor(last / ratios + NEAR))
    return grid.on_finer(no_samples(shape, grid.values.dtype), (1 / ratios).tolist())


def alike(grid: Grid, other: Grid) -> Grid:
    """An outline with what `grid` says of its samples, where those of `other` lie.

    Raises
    ------
    InputError
        The grids have no common coordinates.
    """
    if grid.ndim != other.ndim:
        raise InputError(f"--like is {other.ndim}-D, the samples are {grid.ndim}-D")
    if grid.axes != other.axes and set(grid.axes) == set(other.axes):
        raise InputError(
            f"--like has the axes {', '.join(other.axes)}, the samples {', '.join(grid.axes)}: "
            "both must be in one order"
        )
    if (grid.affine is None) != (other.affine is None):
        which = "the samples lie" if grid.affine is None else "those of --like lie"
        raise InputError(f"it is not known where {which}, so the files have no common coordinates")
    if grid.crs and other.crs and not same_system(grid.crs, other.crs):
        raise InputError("--like has another coordinate reference system; reproject one of them")
    ratios = np.asarray(grid.steps) / other.steps
    return replace(
        grid.on_finer(no_samples(other.shape, grid.values.dtype), ratios.tolist()),
        origin=other.origin if other.affine is None else (),
        affine=other.affine,
        crs=grid.crs or other.crs,
    )


def coarsening(grid: Grid, outline: Grid) -> float:
    """Ratio of the spacing of the outline to that of the grid, along the worst axis."""
    return float(np.divide(outline.steps, grid.steps).max())
