"""Triangle meshes: edges, parts, normals, what is closed, and positions in single precision.

A mesh is *closed*, or watertight, where its triangles pass along every edge as often in one
direction as in the other.  They then are the border of a solid, which has a volume, also where
parts of it touch: two tetrahedra with an edge in common are closed.  Whether every edge has two
triangles is another question: whether the mesh is a manifold.
"""

from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np

Points = TypeVar("Points", jax.Array, np.ndarray)


@runtime_checkable
class TriangleMesh(Protocol):
    """The mesh of one level: an `Isosurface`, or one of another program.

    Parameters
    ----------
    level : float
    vertices : array, shape (n, 3)
        In physical coordinates.
    triangles : array of int, shape (m, 3)
        Numbers of vertices; triangles turn left around the gradient.
    """

    @property
    def level(self) -> float: ...

    @property
    def vertices(self) -> np.ndarray: ...

    @property
    def triangles(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Edges:
    """Edges of a mesh, each once.

    Parameters
    ----------
    ends : array of int, shape (n, 2)
        Vertices, the smaller number first.
    of_triangle : array of int, shape (m, 3)
        Edge k of a triangle goes from its corner k to the next.
    faces : array of int, shape (n,)
        How many triangles have the edge.
    """

    ends: np.ndarray
    of_triangle: np.ndarray
    faces: np.ndarray


def edges_of(triangles: np.ndarray) -> Edges:
    """The edges of triangles, shape (m, 3)."""
    pairs = np.sort(np.stack([triangles, np.roll(triangles, -1, 1)], axis=-1), axis=-1)
    keys = (pairs[..., 0] << 32) | pairs[..., 1]
    unique, number, faces = np.unique(keys, return_inverse=True, return_counts=True)
    ends = np.stack([unique >> 32, unique & 0xFFFFFFFF], axis=1)
    return Edges(ends, number.reshape(-1, 3), faces)


def triangle_normals(vertices: Points, triangles: np.ndarray) -> Points:
    """Normals of triangles, twice their area long; of arrays of NumPy or JAX."""
    first, second, third = (vertices[triangles[:, k]] for k in range(3))
    numpy: Any = np if isinstance(vertices, np.ndarray) else jnp
    return numpy.cross(second - first, third - first)


def open_edges(triangles: np.ndarray) -> int:
    """Number of edges passed more often in one direction than in the other: 0 if closed."""
    start = triangles.astype(np.int64)
    end = np.roll(start, -1, axis=1)
    edge = (np.minimum(start, end) << 32) | np.maximum(start, end)
    _, number = np.unique(edge, return_inverse=True)
    return int(np.count_nonzero(np.bincount(number.ravel(), np.sign(end - start).ravel())))


def connect(n: int, pairs: np.ndarray) -> np.ndarray:
    """Least member of the part of each of `n` nodes: hook larger roots to smaller, halve paths."""
    root = np.arange(n)
    one, other = pairs
    while len(one):
        low, high = np.minimum(root[one], root[other]), np.maximum(root[one], root[other])
        apart = low != high
        one, other, low, high = one[apart], other[apart], low[apart], high[apart]
        np.minimum.at(root, high, low)
        while not np.array_equal(root, farther := root[root]):
            root = farther
    return root


def merged(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The vertices that are left, and triangles between them, where edges of no length are gone.

    An edge whose ends have one position in float32 is contracted: the triangles on both its sides
    go, and each leaves one edge where it had two, so that a watertight mesh stays closed.  Two
    triangles that are then the same with opposite sides, and enclose nothing, go as well.
    """
    places = vertices.astype(np.float32)
    ends = edges_of(triangles).ends
    closed_up = (places[ends[:, 0]] == places[ends[:, 1]]).all(axis=1)
    if not closed_up.any():
        return np.arange(len(vertices)), triangles
    root = connect(len(vertices), ends[closed_up].T)
    corners = root[triangles]
    whole = (corners != np.roll(corners, -1, axis=1)).all(axis=1)
    corners = corners[whole]
    corners = corners[_without_folds(corners)]
    kept = np.zeros(len(vertices), bool)
    kept[corners] = True
    number = np.cumsum(kept) - 1
    return np.flatnonzero(kept), number[corners]


def _without_folds(triangles: np.ndarray) -> np.ndarray:
    """True for the triangles that stay when pairs of opposite ones are taken out."""
    order = np.argsort(triangles, axis=1)
    ids, number = np.unique(np.sort(triangles, axis=1), axis=0, return_inverse=True)
    sides = np.where((order[:, 1] - order[:, 0]) % 3 == 1, 1, -1)
    number = number.reshape(-1)
    balance = np.bincount(number, sides, minlength=len(ids))
    surplus = np.sign(balance)[number] == sides
    # Of those that are there more often than their opposites, as many as exceed them.
    rank = _rank(number * 2 + (sides > 0))
    return surplus & (rank < np.abs(balance)[number])


def _rank(keys: np.ndarray) -> np.ndarray:
    """Number of equal keys before each."""
    order = np.argsort(keys, kind="stable")
    _, first, count = np.unique(keys[order], return_index=True, return_counts=True)
    rank = np.empty(len(keys), int)
    rank[order] = np.arange(len(keys)) - np.repeat(first, count)
    return rank
