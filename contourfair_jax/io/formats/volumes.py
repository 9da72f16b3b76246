"""Volumes of medicine and simulation: arrays are (z, y, x), whatever the file's order.

Files of these formats count x first; a sample that the file calls ``[i, j, k]`` is
``values[k, j, i]`` here, as in an image, and the world is (z, y, x) as well.  Axes beyond the
three, such as time, come first and must be chosen from with a key.

Medical formats disagree about the signs of x and y; ``metadata["space"]`` says which the world of
a grid has, and the writers turn it into what their format expects.

The affine map of a plane of a volume has two dimensions.  What it leaves out is kept as text, as a
map from ``(steps along the axis that is gone, world of the plane)`` to the world of the volume: its
first three rows.  It stays the same when the plane is refined or cropped.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from ..._grid.affine import SKEWED, crop_affine, is_skewed, spacing_of
from ..._grid.grid import Grid
from ..._grid.missing import mark_missing, numeric, restore_nodata
from ..._support.errors import InputError
from .keys import Part, describe_axes, index_of, parse_key

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


SPATIAL = ("z", "y", "x")
RAS, LPS = "right-anterior-superior", "left-posterior-superior"
_FLIP_XY = np.diag([-1.0, -1.0, 1.0, 1.0])


def select(key: str | None, axes: Sequence[str], shape: Sequence[int]) -> tuple[Part, ...]:
    """The part of the array that `key` chooses: one number or range per axis.

    A plain number chooses along the one axis that is not spatial.
    """
    name, parts = parse_key(key)
    others = [axis for axis in axes if axis not in SPATIAL]
    if name is not None:
        if len(others) != 1 or not name.lstrip("-").isdecimal():
            raise InputError(
                f"has no {name!r} to choose; choose along {describe_axes(axes, shape)}, as z=5"
            )
        parts[others[0]] = int(name)
    for axis, n in zip(axes, shape, strict=True):
        if axis in others and n == 1:
            parts.setdefault(axis, 0)
    index = index_of(parts, axes, shape)
    left = [axis for axis, part in zip(axes, index, strict=True) if isinstance(part, slice)]
    several = [axis for axis in left if axis in others]
    if several:
        choice = ",".join(f"{axis}=0" for axis in several)
        raise InputError(
            f"has the axes {describe_axes(axes, shape)}: choose with a key such as {choice}"
        )
    if len(left) < 2:
        raise InputError(f"{key} leaves {len(left)} axis; 2 or 3 are needed")
    return index


def volume_grid(
    values: np.ndarray,
    shape: Sequence[int],
    index: Sequence[Part],
    affine: np.ndarray | None,
    *,
    units: str = "",
    nodata: float | int | None = None,
    metadata: Mapping[str, str] | None = None,
    notes: tuple[str, ...] = (),
    source_dtype: np.dtype | None = None,
    crs: str | None = None,
) -> Grid:
    """A grid of the part `index` of the spatial axes, which have `shape` in the file.

    Parameters
    ----------
    values
        The samples of that part, (z, y, x) or (y, x) without the axes that a number chose.
    affine
        Index to world of the whole volume, in the order of `shape`; None where unknown.
    """
    samples = numeric(values)
    data, missing, more = mark_missing(samples, nodata)
    names = SPATIAL[-len(shape) :]
    kept = [k for k, part in enumerate(index) if isinstance(part, slice)]
    thin = [k for k, n in zip(kept, data.shape, strict=True) if n == 1]
    for k in thin[: max(len(kept) - 2, 0)]:
        position = kept.index(k)
        data = np.squeeze(data, axis=position)
        missing = None if missing is None else np.squeeze(missing, axis=position)
        kept.remove(k)
    place: dict[str, str] = {}
    if affine is not None:
        starts = [_start(part, n) for part, n in zip(index, shape, strict=True)]
        affine, place, said = of_axes(crop_affine(affine, starts), kept)
        more += said
    return Grid(
        data,
        axes=tuple(names[k] for k in kept),
        units=units,
        crs=crs,
        affine=affine,
        nodata=nodata,
        missing=missing,
        metadata=without_place(metadata or {}) | place,
        notes=notes + more,
        source_dtype=source_dtype or samples.dtype,
    )


def to_store(grid: Grid) -> tuple[np.ndarray, float | int | None]:
    """The array to store and its nodata value; missing samples of floats stay NaN."""
    stored, nodata = restore_nodata(grid)
    if grid.values.dtype.kind == "f":
        stored, nodata = grid.values, None if nodata is None or np.isnan(nodata) else nodata
    return stored.astype(stored.dtype.newbyteorder("="), copy=False), nodata


def to_xyz(grid: Grid, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """`values` of the grid as a volume with x first, its 4 x 4 affine map, and notes."""
    if grid.ndim not in (2, 3):
        raise InputError(f"the format holds 2-D or 3-D data, this is {grid.ndim}-D; use .npz")
    named = set(grid.axes) <= set(SPATIAL) and len(set(grid.axes)) == grid.ndim
    names = grid.axes if named else SPATIAL[-grid.ndim :]
    order = sorted(range(grid.ndim), key=lambda k: names[k])
    places = ["xyz".index(names[k]) for k in order]
    full = grid.from_index()
    notes: tuple[str, ...] = ()
    if not np.allclose(spacing_of(full), grid.spacing, rtol=1e-6):
        notes = ("the steps of the coordinates are kept, not the metric spacing",)
    affine = np.eye(4)
    thin = tuple(set(range(3)) - set(places))
    lifted = in_volume(grid, full) if named else None
    if lifted is None:
        affine[np.ix_(places, places)] = full[np.ix_(order, order)]
        affine[places, 3] = full[order, -1]
    else:
        affine[:3, [*thin, *places, 3]] = lifted[2::-1, [0, *(1 + k for k in order), 3]]
    return np.expand_dims(np.transpose(values, order), thin), affine, notes


def zyx(affine: np.ndarray) -> np.ndarray:
    """An affine map with x first as one with x last, and the other way round."""
    order = [*range(len(affine) - 1)][::-1]
    turned = affine.copy()
    turned[:-1, :-1] = affine[np.ix_(order, order)]
    turned[:-1, -1] = affine[order, -1]
    return turned


def in_space(affine: np.ndarray, grid: Grid, wanted: str) -> np.ndarray:
    """The x-first map `affine` of the grid with the world that a format expects."""
    have = canonical_space(grid.metadata.get("space", ""))
    return _FLIP_XY @ affine if {have, wanted} == {RAS, LPS} else affine


def canonical_space(name: str) -> str:
    """The long name of a space; empty where it is not one that the formats share."""
    known = {"ras": RAS, "lps": LPS, RAS: RAS, LPS: LPS}
    return known.get(name.strip().lower(), "")


def not_kept(grid: Grid, what: str, *fields: str) -> tuple[str, ...]:
    """A note that names those of the grid's `fields` that the format has no place for."""
    present = [name for name in fields if getattr(grid, name) not in (None, "")]
    return (f"{what} has no place for: {', '.join(present)}",) if present else ()


def _start(part: Part, n: int) -> int:
    chosen = range(n)[part]
    return chosen if isinstance(chosen, int) else chosen[0]
