"""Triangles halved where their edges leave the level set, until they keep to a tolerance.

An edge is halved or not whatever triangle looks at it, so a watertight manifold mesh stays one.
The new vertex is the root of the field along the gradient in the middle of the edge, at most half
the edge away.  Edges whose halving would turn a triangle over are left as they are.
"""

from collections.abc import Callable

import numpy as np

from .._bezier.host import HostField
from .._bezier.roots import toward
from .._support.memory import check_memory
from ._lattice import Surface
from ._mesh import Edges, edges_of, triangle_normals

# Rounds of halving; each makes chords four times nearer.
_ROUNDS = 14
# A quadratic surface leaves a triangle by at most 4/3 of what it leaves the edges' middles by.
_SHARE = 0.7
_BYTES_PER_TRIANGLE = 600


def split(
    field: HostField,
    surface: Surface,
    level: float,
    tolerance: float,
    rounding: float,
    progress: Callable[[int, int], None],
) -> tuple[Surface, int]:
    """The surface with chords within `tolerance`, in cells, and how many edges are not.

    `progress` is told how many edges need no halving, of how many.
    """
    points, triangles = surface.vertices, surface.triangles
    normals = field.jet(points, 1)[1].T
    settled, unmet = np.zeros((0, 2), int), 0
    for _ in range(_ROUNDS):
        check_memory(_BYTES_PER_TRIANGLE * len(triangles), f"{len(triangles)} triangles")
        edges = edges_of(triangles)
        progress(len(settled), len(edges.ends))
        open_ = np.flatnonzero(~_among(edges.ends, settled))
        middles, far = _middles(field, points, edges, open_, level, _SHARE * tolerance, rounding)
        place = np.full(len(edges.ends), -1)
        wanted = far & np.isfinite(middles).all(1)
        place[open_[wanted]] = len(points) + np.arange(np.count_nonzero(wanted))
        candidates = np.concatenate([points, middles[wanted]])
        slopes = np.concatenate([normals, field.jet(middles[wanted], 1)[1].T])
        place = _upright(candidates, slopes, triangles, edges, place)
        kept = place[open_] >= 0
        settled = np.concatenate([settled, edges.ends[open_[~kept]]])
        unmet += int(np.count_nonzero(far & ~kept))
        if not kept.any():
            break
        chosen = np.concatenate([np.arange(len(points)), place[place >= 0]])
        place[place >= 0] = len(points) + np.arange(np.count_nonzero(kept))
        points, normals = candidates[chosen], slopes[chosen]
        triangles, _ = _halved(points, triangles, place[edges.of_triangle])
    return Surface(points, triangles), unmet


def _among(pairs: np.ndarray, others: np.ndarray) -> np.ndarray:
    """True for pairs of numbers that are among others."""
    one, other = ((rows[:, 0] << 32) | rows[:, 1] for rows in (pairs, others))
    return np.isin(one, other)


def _middles(
    field: HostField,
    points: np.ndarray,
    edges: Edges,
    chosen: np.ndarray,
    level: float,
    tolerance: float,
    rounding: float,
) -> tuple[np.ndarray, np.ndarray]:
    """The surface beside the middles of the chosen edges, and whether it is far from them."""
    first, last = (points[edges.ends[chosen, k]] for k in (0, 1))
    middle = 0.5 * (first + last)
    on_border = (first == 0) | (first == np.array(field.cells))
    on_border |= (first == np.rint(first)) & (edges.faces[chosen] == 1)[:, None]
    free = ~((first == last) & on_border)
    value, gradient = field.jet(middle, 1)
    gradient = np.where(free, gradient.T, 0.0)
    steepness = np.linalg.norm(gradient, axis=1)
    # Twice as near as the tolerance at first order is near.
    far = ~(np.abs(value[0] - level) <= 0.5 * tolerance * steepness + rounding)
    reach = 0.5 * np.linalg.norm(last - first, axis=1, keepdims=True)
    near_border = (middle < reach) | (middle > np.array(field.cells) - reach)
    on_surface = np.full_like(middle, np.nan)
    # Along the border where the gradient leads out of the grid before the surface is met.
    for direction in (gradient, np.where(near_border, 0.0, gradient)):
        size = np.linalg.norm(direction, axis=1)
        at = np.flatnonzero(far & (size > 0) & np.isnan(on_surface[:, 0]))
        normal = direction[at] / size[at, None]
        on_surface[at] = toward(field, middle[at], normal, reach[at, 0], level, rounding)
    return on_surface, far & ~(np.linalg.norm(on_surface - middle, axis=1) <= tolerance)


def _upright(
    points: np.ndarray,
    normals: np.ndarray,
    triangles: np.ndarray,
    edges: Edges,
    place: np.ndarray,
) -> np.ndarray:
    """`place` without the new vertices that would turn triangles against the gradient."""
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = np.nan_to_num(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    touched = np.flatnonzero((place[edges.of_triangle] >= 0).any(1))
    upright = _upright_triangles(points, normals, triangles[touched])
    touched = touched[upright]
    place = place.copy()
    while True:
        children, parents = _halved(points, triangles[touched], place[edges.of_triangle[touched]])
        turned = parents[~_upright_triangles(points, normals, children)]
        if not len(turned):
            return place
        place[edges.of_triangle[touched[turned]]] = -1


def _upright_triangles(
    points: np.ndarray, normals: np.ndarray, triangles: np.ndarray
) -> np.ndarray:
    """True for triangles that face the way that the normals at their corners point."""
    return (triangle_normals(points, triangles) * normals[triangles].sum(1)).sum(1) > 0


def _halved(
    points: np.ndarray, triangles: np.ndarray, middles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Triangles cut at vertices in the middle of their edges, -1 for none, and their parents."""
    marked = middles >= 0
    count = marked.sum(1)
    # Turned so that a single middle is on edge 0, and that a single edge without is edge 2.
    first = np.where(count == 1, marked.argmax(1), np.where(count == 2, (~marked).argmax(1) + 1, 0))
    turn = (first[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(triangles, turn, 1).T
    (a, b, c), (u, v, w) = corners, np.take_along_axis(middles, turn, 1).T
    two = count == 2
    across = np.zeros(len(triangles), bool)
    across[two] = _distance(points, a[two], v[two]) <= _distance(points, u[two], c[two])
    cuts = [
        (count == 0, [(a, b, c)]),
        (count == 1, [(a, u, c), (u, b, c)]),
        (two & across, [(u, b, v), (a, u, v), (a, v, c)]),
        (two & ~across, [(u, b, v), (a, u, c), (u, v, c)]),
        (count == 3, [(a, u, w), (u, b, v), (w, v, c), (u, v, w)]),
    ]
    pieces, parents = [], []
    for chosen, children in cuts:
        rows = np.flatnonzero(chosen)
        for child in children:
            pieces.append(np.stack([corner[rows] for corner in child], axis=1))
            parents.append(rows)
    return np.concatenate(pieces), np.concatenate(parents)


def _distance(points: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[one] - points[other], axis=1)
