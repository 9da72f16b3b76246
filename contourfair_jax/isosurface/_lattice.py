"""The level set of a volume as a mesh: how its vertices are joined, and where they lie.

Every cell that may hold the level is sampled on a lattice, and the lattice is cut into blocks.  A
sample counts as inside or outside only, so that scikit-image's marching cubes puts all vertices in
the middle of lattice edges: the middle names the edge, blocks agree on the names, and the mesh is
watertight and manifold whatever the values are.  Each vertex then moves to the root of the field on
its edge, which has one, as its ends are on different sides of the level.  Parts that pass between
the points of the lattice are looked for with bounds, and have finer lattices of their own.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from skimage.measure import marching_cubes

from .._bezier.bernstein import bernstein
from .._bezier.host import HostField, lattice_values
from .._bezier.roots import cubic_root
from .._support.memory import check_memory
from ._small_parts import Pieces, small_parts

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


@dataclass(frozen=True)
class _Part:
    """Triangles (m, 3) of one block, and the middles of lattice edges that its vertices lie on.

    The middles (n, 3) count in units of half a lattice step.
    """

    middles: np.ndarray
    triangles: np.ndarray


def surface_of(
    field: HostField, level: float, rounding: float, progress: Callable[[int, int], None]
) -> tuple[Surface, int]:
    """The mesh of the lattice, on the field; triangles turn left around the gradient.

    Parameters
    ----------
    field : HostField
        3-D.
    level : float
    rounding : float
        Error of values: cells that miss the level by no more are sampled too.
    progress : callable
        Told how many blocks of cells are done, and how many there are.

    Returns
    -------
    Surface
    int
        Cells that may hold a part apart from the mesh and smaller than what is looked for.
    """
    low, high = field.bounds
    active = field.valid & (low <= level + rounding) & (high > level - rounding)
    mixed = np.zeros([FACTOR * n for n in field.cells], bool)
    parts, total = [], 0
    starts = np.unique(np.argwhere(active) // _BLOCK, axis=0) * _BLOCK
    for done, start in enumerate(starts):
        progress(done, len(starts))
        window = tuple(slice(k, k + _BLOCK) for k in start)
        inside = _inside(field, active, window, level)
        cubes = _crossed(inside) & _repeated(field.valid[window])
        mixed[tuple(slice(FACTOR * k, FACTOR * (k + _BLOCK)) for k in start)] = cubes
        if cubes.any():
            parts.append(_marched(inside, cubes, FACTOR * start))
            total += len(parts[-1].middles)
            check_memory(_BYTES_PER_VERTEX * total, "an isosurface of so many vertices")
    small, unproved = small_parts(field, active, mixed, level)
    surfaces = [_joined(field, parts, level, FACTOR)]
    surfaces += [_joined(field, _march_pieces(pieces), level, pieces.factor) for pieces in small]
    offsets = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    triangles = [surface.triangles + k for surface, k in zip(surfaces, offsets[:-1], strict=True)]
    vertices = np.concatenate([surface.vertices for surface in surfaces])
    return Surface(vertices, np.concatenate(triangles)), unproved


def _inside(
    field: HostField, active: np.ndarray, window: tuple[slice, ...], level: float
) -> np.ndarray:
    """True for the lattice points of a block that are above the level."""
    low = field.bounds[0][window]
    # What is not sampled is on one side; NaN counts as below, and its cubes are dropped later.
    above = _repeated(low > level)
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


def _repeated(cells: np.ndarray) -> np.ndarray:
    """Values of cells, repeated for the cubes of the lattice in them."""
    return np.repeat(cells, FACTOR, 0).repeat(FACTOR, 1).repeat(FACTOR, 2)


def _crossed(inside: np.ndarray) -> np.ndarray:
    """Cubes with corners on both sides."""
    corners = [
        inside[tuple(slice(k, n - 1 + k) for k, n in zip(corner, inside.shape, strict=True))]
        for corner in itertools.product((0, 1), repeat=3)
    ]
    return np.logical_or.reduce(corners) & ~np.logical_and.reduce(corners)


def _marched(inside: np.ndarray, cubes: np.ndarray, start: np.ndarray) -> _Part:
    """The triangles in the given cubes of a block of the lattice."""
    volume = inside.astype(np.float32) - np.float32(0.5)
    middles, triangles, _, _ = marching_cubes(
        volume, 0.0, method="lorensen", gradient_direction="descent"
    )
    cube = np.floor(middles[triangles].mean(1)).astype(int)
    triangles = triangles.astype(np.int64)[cubes[tuple(cube.T)]]
    used, number = np.unique(triangles.ravel(), return_inverse=True)
    return _Part(np.rint(2 * middles[used]).astype(np.int64) + 2 * start, number.reshape(-1, 3))


def _march_pieces(pieces: Pieces) -> list[_Part]:
    """The triangles in pieces, block by block; whatever lies between them is outside."""
    side, parts = FACTOR * _BLOCK, []
    # Blocks of both kinds of outside: four numbers name one.
    block = np.column_stack([pieces.corner // side, pieces.outside])
    unique, number = np.unique(block, axis=0, return_inverse=True)
    for k, (*start, outside) in enumerate(unique):
        mine = pieces.take(number.ravel() == k)
        start = side * np.array(start)
        at = (mine.corner - start).T
        inside, cubes = np.full((side + 1,) * 3, bool(outside)), np.zeros((side,) * 3, bool)
        cubes[tuple(at)] = True
        for corner in itertools.product((0, 1), repeat=3):
            inside[tuple(at + np.array(corner)[:, None])] = mine.above[:, *corner]
        if _crossed(inside).any():
            parts.append(_marched(inside, cubes, start))
    return parts


def _joined(field: HostField, parts: list[_Part], level: float, factor: int) -> Surface:
    """The blocks of a lattice as one mesh, on the field."""
    if not parts:
        return Surface(np.zeros((0, 3)), np.zeros((0, 3), int))
    # Middles of lattice edges are numbered as points of the twice as fine lattice.
    shape = tuple(2 * factor * n + 1 for n in field.cells)
    names = np.ravel_multi_index(tuple(np.concatenate([p.middles for p in parts]).T), shape)
    unique, number = np.unique(np.asarray(names), return_inverse=True)
    offsets = np.cumsum([0, *(len(part.middles) for part in parts)])
    joined = [part.triangles + k for part, k in zip(parts, offsets[:-1], strict=True)]
    twice = np.stack(np.unravel_index(unique, shape), axis=1)
    return Surface(_on_edges(field, twice, level, factor), number[np.concatenate(joined)])


def _on_edges(field: HostField, twice: np.ndarray, level: float, factor: int) -> np.ndarray:
    """The root of the field on lattice edges with the given middles, in grid coordinates."""
    points = twice / (2 * factor)
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
        points[mine, axis] = _root(p, local[:, axis], level, factor) + cell[:, axis]
    return points


def _root(points: np.ndarray, middle: np.ndarray, level: float, factor: int) -> np.ndarray:
    """Roots of cubics (4, n) on the lattice edges with the given middles."""
    ends = middle - 0.5 / factor, middle + 0.5 / factor
    part = [_blossom(points, [ends[k < n] for k in range(3)]) for n in (0, 1, 2, 3)]
    root = cubic_root(np.stack(part), np.full(len(middle), level))
    return ends[0] + root / factor


def _blossom(points: np.ndarray, at: list[np.ndarray]) -> np.ndarray:
    """The polar form of cubics: the Bezier points of a part of them, for its ends repeated."""
    for t in at:
        points = (1 - t) * points[:-1] + t * points[1:]
    return points[0]
