"""The level set of a volume as a mesh: how its vertices are joined, and where they lie.

Every cell that may hold the level is sampled on a lattice, and the lattice is cut into blocks.  A
sample counts as inside or outside only, so that scikit-image's marching cubes puts all vertices in
the middle of lattice edges: the middle names the edge, blocks agree on the names, and the mesh is
watertight and manifold whatever the values are.  Each vertex then moves to the root of the field on
its edge, which has one, as its ends are on different sides of the level.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from skimage.measure import marching_cubes

from ._basis import bernstein
from ._host import HostField, lattice_values
from ._roots import cubic_root
from .io import check_memory

# Lattice steps per cell.
FACTOR = 2
# Cells per axis of a block.
_BLOCK = 16
_BYTES_PER_VERTEX = 1200


@dataclass(frozen=True)
class Surface:
    """Vertices in grid coordinates, shape (n, 3), and triangles, shape (m, 3)."""

    vertices: np.ndarray
    triangles: np.ndarray


def surface_of(field: HostField, level: float, rounding: float) -> Surface:
    """The mesh of the lattice, on the field; triangles turn left around the gradient.

    Parameters
    ----------
    field : HostField
        3-D.
    level : float
    rounding : float
        Error of values: cells that miss the level by no more are sampled too.
    """
    parts = list(_blocks(field, level, rounding))
    if not parts:
        return Surface(np.zeros((0, 3)), np.zeros((0, 3), int))
    names, triangles = zip(*parts, strict=True)
    offsets = np.cumsum([0, *map(len, names)])
    unique, number = np.unique(np.concatenate(names), return_inverse=True)
    joined = np.concatenate([part + k for part, k in zip(triangles, offsets[:-1], strict=True)])
    return Surface(_on_edges(field, unique, level), number[joined])


def name_shape(field: HostField) -> tuple[int, ...]:
    """Middles of lattice edges are numbered as points of the twice as fine lattice."""
    return tuple(2 * FACTOR * n + 1 for n in field.cells)


def _blocks(
    field: HostField, level: float, rounding: float
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Names of the vertices and triangles of every block that has any."""
    low, high = field.bounds
    active = field.valid & (low <= level + rounding) & (high > level - rounding)
    starts = np.unique(np.argwhere(active) // _BLOCK, axis=0) * _BLOCK
    total = 0
    for start in starts:
        window = tuple(slice(k, k + _BLOCK) for k in start)
        inside = _inside(field, active, window, level)
        if inside.all() or not inside.any():
            continue
        volume = inside.astype(np.float32) - np.float32(0.5)
        middles, triangles, _, _ = marching_cubes(
            volume, 0.0, method="lorensen", gradient_direction="descent"
        )
        triangles = triangles.astype(np.int64)
        cube = np.floor(middles[triangles].mean(1)).astype(int) // FACTOR
        triangles = triangles[field.valid[window][tuple(cube.T)]]
        if len(triangles):
            used, number = np.unique(triangles.ravel(), return_inverse=True)
            twice = np.rint(2 * middles[used]).astype(np.int64) + 2 * FACTOR * start
            total += len(used)
            check_memory(_BYTES_PER_VERTEX * total, "an isosurface of so many vertices")
            names = np.asarray(np.ravel_multi_index(tuple(twice.T), name_shape(field)))
            yield names, number.reshape(-1, 3)


def _inside(
    field: HostField, active: np.ndarray, window: tuple[slice, ...], level: float
) -> np.ndarray:
    """Which lattice points of a block are above the level."""
    low = field.bounds[0][window]
    # What is not sampled is on one side; NaN counts as below, and its cubes are dropped later.
    above = np.repeat(low > level, FACTOR, 0).repeat(FACTOR, 1).repeat(FACTOR, 2)
    inside = np.zeros(tuple(n + 1 for n in above.shape), bool)
    corners = np.array(list(np.ndindex(2, 2, 2)))
    for corner in corners:
        inside[tuple(slice(k, k + n) for k, n in zip(corner, above.shape, strict=True))] |= above
    local = np.argwhere(active[window])
    if len(local):
        values = lattice_values(field.gather(local + [part.start for part in window]), FACTOR)
        at = FACTOR * local.T
        for place in np.ndindex(values.shape[:-1]):
            inside[tuple(at + np.array(place)[:, None])] = values[place] > level
    return inside


def _on_edges(field: HostField, names: np.ndarray, level: float) -> np.ndarray:
    """The root of the field on every lattice edge, in grid coordinates."""
    twice = np.stack(np.unravel_index(names, name_shape(field)), axis=1)
    points = twice / (2 * FACTOR)
    along = (twice % 2).argmax(1)
    for axis in range(field.ndim):
        mine = np.flatnonzero(along == axis)
        if not len(mine):
            continue
        cell = field.locate(points[mine])
        local = points[mine] - cell
        p = np.moveaxis(field.gather(cell), axis, 0)
        for other in (k for k in range(field.ndim) if k != axis):
            p = np.einsum("an,a...n->...n", bernstein(3, local[:, other]).T, np.moveaxis(p, 1, 0))
        points[mine, axis] = _root(p, local[:, axis], level) + cell[:, axis]
    return points


def _root(points: np.ndarray, middle: np.ndarray, level: float) -> np.ndarray:
    """Roots of cubics (4, n) on the lattice edges with the given middles."""
    ends = middle - 0.5 / FACTOR, middle + 0.5 / FACTOR
    part = [_blossom(points, [ends[k < n] for k in range(3)]) for n in (0, 1, 2, 3)]
    root = cubic_root(np.stack(part), np.full(len(middle), level))
    return ends[0] + root / FACTOR


def _blossom(points: np.ndarray, at: list[np.ndarray]) -> np.ndarray:
    """The polar form of cubics: the Bezier points of a part of them, for its ends repeated."""
    for t in at:
        points = (1 - t) * points[:-1] + t * points[1:]
    return points[0]
