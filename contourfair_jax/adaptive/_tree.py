"""Quadtrees and octrees over the cells of a grid, any dimension: leaves, neighbours, balance.

A leaf of depth k is a cell halved k times; its corner counts in units of `2**-k` cells.
"""

import itertools
from dataclasses import dataclass

import numpy as np

# Corners of a leaf at depth MOST_DEPTH of the largest grids still fit in 64-bit numbers.
MOST_DEPTH = 10


@dataclass(frozen=True)
class Tree:
    """Leaves of all depths.

    Parameters
    ----------
    cells : tuple of int
        Cells of the grid along each axis.
    corners : tuple of arrays of int, each of shape (n_k, ndim)
        Lower corners of the leaves of depth k, sorted.
    """

    cells: tuple[int, ...]
    corners: tuple[np.ndarray, ...]

    @property
    def ndim(self) -> int:
        """Spatial dimensions."""
        return len(self.cells)

    def __len__(self) -> int:
        return sum(map(len, self.corners))

    def key(self, corner: np.ndarray, depth: int) -> np.ndarray:
        """Corners as numbers that sort alike; -1 outside the grid."""
        shape = np.array(self.cells) << depth
        inside = np.all((corner >= 0) & (corner < shape), axis=-1)
        key = np.zeros(corner.shape[:-1], np.int64)
        for axis, n in enumerate(shape):
            key = key * n + corner[..., axis]
        return np.where(inside, key, -1)

    def find(self, corner: np.ndarray, depth: int) -> np.ndarray:
        """Number among the leaves of this depth, -1 where there is no such leaf."""
        if not len(self.corners[depth]):
            return np.full(corner.shape[:-1], -1)
        known = self.key(self.corners[depth], depth)
        key = self.key(corner, depth)
        at = np.minimum(np.searchsorted(known, key), len(known) - 1)
        return np.where(known[at] == key, at, -1)

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depth and number of the leaf that holds each point (n, ndim) in cells; -1 for none.

        The leaf above for a point on a face, but the last one at the upper border of the grid.
        """
        depths, numbers = np.full(len(points), -1), np.full(len(points), -1)
        for depth in range(len(self.corners)):
            highest = (np.array(self.cells) << depth) - 1
            with np.errstate(invalid="ignore"):
                scaled = points * 2.0**depth
                outside = ~np.all((scaled >= 0) & (scaled <= highest + 1), axis=1)
                corner = np.where(outside[:, None], -1, np.floor(scaled)).astype(np.int64)
            found = self.find(np.minimum(corner, highest), depth)
            depths[found >= 0] = depth
            numbers = np.where(found >= 0, found, numbers)
        return depths, numbers


def whole(valid: np.ndarray) -> Tree:
    """The cells of a grid where a mask is true, unsplit."""
    return Tree(valid.shape, (np.argwhere(valid),))


def split(tree: Tree, chosen: list[np.ndarray]) -> Tree:
    """Halve the chosen leaves of every depth along all axes."""
    bits = np.array(list(itertools.product((0, 1), repeat=tree.ndim)))
    corners = [part[~mask] for part, mask in zip(tree.corners, chosen, strict=True)]
    corners.append(np.zeros((0, tree.ndim), np.int64))
    for depth, (part, mask) in enumerate(zip(tree.corners, chosen, strict=True)):
        children = (2 * part[mask][:, None] + bits).reshape(-1, tree.ndim)
        corners[depth + 1] = np.concatenate([corners[depth + 1], children])
    if not len(corners[-1]):
        corners.pop()
    ordered = [part[np.argsort(tree.key(part, k))] for k, part in enumerate(corners)]
    return Tree(tree.cells, tuple(ordered))


def balance(tree: Tree) -> Tree:
    """Halve leaves until neighbours, across corners too, differ by one depth at most."""
    steps = np.array(list(itertools.product((-1, 0, 1), repeat=tree.ndim)))
    for depth in range(len(tree.corners) - 1, 1, -1):
        while True:
            parents = np.unique(tree.corners[depth] >> 1, axis=0)
            around = (parents[:, None] + steps).reshape(-1, tree.ndim)
            chosen = [np.zeros(len(part), bool) for part in tree.corners]
            for coarser in range(depth - 1):
                found = tree.find(around >> (depth - 1 - coarser), coarser)
                chosen[coarser][found[found >= 0]] = True
            if not any(mask.any() for mask in chosen):
                break
            tree = split(tree, chosen)
    return tree
