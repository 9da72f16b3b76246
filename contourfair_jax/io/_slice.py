"""Where the plane of a volume lies: a grid of two axes, and its place in the three dimensions.

The affine map of a plane has two dimensions.  What it leaves out is kept as text, as a map from
``(steps along the axis that is gone, world of the plane)`` to the world of the volume: its first
three rows.  It stays the same when the plane is refined or cropped.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from ._geometry import SKEWED, is_skewed
from ._grid import Grid

SLICE = "slice_to_volume"  # the name of the text


def of_axes(
    affine: np.ndarray, kept: Sequence[int]
) -> tuple[np.ndarray, dict[str, str], tuple[str, ...]]:
    """The map of the axes `kept`, to those axes of the world that they lie along.

    Returns
    -------
    affine : array
    metadata : dict
        The place of a plane, unless it is the one that a plane has without.
    notes : tuple of str
    """
    ndim = len(affine) - 1
    linear = affine[:ndim, list(kept)]
    rows = np.flatnonzero(np.abs(linear).max(axis=1) > 1e-9 * np.abs(linear).max()).tolist()
    notes: tuple[str, ...] = ()
    if len(rows) == len(kept):
        within = affine[np.ix_([*rows, ndim], [*kept, ndim])]
    else:
        within = np.diag([*np.sqrt((linear**2).sum(axis=0)), 1.0])
        notes = ("the plane is oblique: its coordinates are distances within it",)
    if is_skewed(within):
        notes += (SKEWED,)
    metadata = {}
    if (ndim, len(kept)) == (3, 2):
        metadata = _place(affine, kept, rows)
    return within, metadata, notes


def _place(affine: np.ndarray, kept: Sequence[int], rows: list[int]) -> dict[str, str]:
    (gone,) = {0, 1, 2} - set(kept)
    lift = np.zeros((3, 4))
    lift[:, 0] = affine[:3, gone]
    lift[:, 3] = affine[:3, 3]
    if len(rows) == len(kept):
        lift[rows, [1, 2]] = 1.0
        lift[rows, 3] = 0.0
    else:
        linear = affine[:3, list(kept)]
        lift[:, 1:3] = linear / np.sqrt((linear**2).sum(axis=0))
    plain = np.zeros((3, 4))
    plain[[gone, *kept], range(3)] = 1.0
    return {} if np.array_equal(lift, plain) else {SLICE: json.dumps(lift.tolist())}


def in_volume(grid: Grid, affine: np.ndarray) -> np.ndarray | None:
    """The 4 x 4 map of a plane whose own is `affine`: the axis that is gone comes first.

    The world is (z, y, x); None where nothing is known of its place.
    """
    lift = _parsed(grid.metadata)
    if lift is None or grid.ndim != 2:
        return None
    plane = np.eye(4)
    plane[1:, 1:] = affine
    return lift @ plane


def without_place(metadata: Mapping[str, str]) -> dict[str, str]:
    """The texts without the place of a plane, which a file of volumes has in its map."""
    return {name: text for name, text in metadata.items() if name != SLICE}


def _parsed(metadata: Mapping[str, str]) -> np.ndarray | None:
    lift = np.eye(4)
    with suppress(KeyError, ValueError, TypeError):
        lift[:3] = np.asarray(json.loads(metadata[SLICE]), np.float64).reshape(3, 4)
        if np.isfinite(lift).all() and np.linalg.det(lift):
            return lift
    return None
