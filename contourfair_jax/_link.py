"""Arcs of neighbouring leaves joined into lines, without a loop over arcs.

An arc is followed by the one that starts where it ends: on the same edge, at the same level, and
passing it in the same direction.  Leaves of different sizes meet along edges of different lengths,
so what is compared is the straight line that the edge is part of, and the rank of the crossing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ._arcs import Arcs
from ._ragged import ranges
from ._subdivide import MAX_DEPTH

# More than a level crosses a straight line within a cell in one direction: a cubic has three roots.
_RANKS = 8


@dataclass(frozen=True)
class Lines:
    """Lines of all levels, sorted by level, in units of cells; larger values on their left.

    Parameters
    ----------
    points : array, shape (n, 2)
        The vertices of all lines, one line after the other; the first vertex of a loop is repeated
        as its last.
    bounds : array of int, shape (lines + 1,)
        Line k is `points[bounds[k] : bounds[k + 1]]`.
    level : array of int, shape (lines,)
    closed : array of bool, shape (lines,)
    edges : array of int, shape (2, 4, lines)
        Where lines that are not closed start and stop, as in `Arcs`.
    """

    points: np.ndarray
    bounds: np.ndarray
    level: np.ndarray
    closed: np.ndarray
    edges: np.ndarray

    def pieces(self) -> list[np.ndarray]:
        """The vertices of each line."""
        return np.split(self.points, self.bounds[1:-1]) if len(self.level) else []


def link(found: Sequence[Arcs], n_levels: int, shape: tuple[int, int]) -> Lines:
    """Join arcs to lines.

    Parameters
    ----------
    found : sequence of Arcs
    n_levels : int
    shape : tuple of int
        Cells of the grid along each axis.
    """
    if not found:
        none = np.empty(0, int)
        loops = none.astype(bool)
        return Lines(np.empty((0, 2)), np.zeros(1, int), none, loops, np.empty((2, 4, 0), int))
    level = np.concatenate([part.level for part in found])
    count = np.concatenate([part.count for part in found])
    points = np.concatenate([part.points for part in found])
    ends = np.concatenate([part.ends for part in found], axis=1)
    edges = np.concatenate([part.edges for part in found], axis=-1)
    codes = _codes(level, edges, n_levels, shape)
    starts, stops = (_ranked(codes[k], edges[k, 0], ends[k]) for k in (0, 1))
    follows = _matches(*starts, *stops)
    head, rank, closed = chains(follows)
    heads = np.flatnonzero(rank == 0)
    heads = heads[np.argsort(level[heads], kind="stable")]
    number = np.empty(len(level), int)
    number[heads] = np.arange(len(heads))
    number = number[head]
    order = np.argsort(number * (rank.max() + 1) + rank)
    last = np.append(np.flatnonzero(np.diff(number[order])), len(order) - 1)
    offset = np.cumsum(count) - count
    joined = points[ranges(offset[order], count[order])]
    bounds = np.append(0, np.cumsum(count[order])[last])
    final = np.where(closed[heads, None], ends[0, heads], ends[1, order[last]])
    joined = np.insert(joined, bounds[1:], final, axis=0)
    bounds = bounds + np.arange(len(bounds))
    points, bounds = _without_repeats(joined, bounds)
    outer = np.stack([edges[0][:, heads], edges[1][:, order[last]]])
    return Lines(points, bounds, level[heads], closed[heads], outer)


def _codes(level: np.ndarray, edges: np.ndarray, n_levels: int, shape: tuple) -> np.ndarray:
    """One number for level, line, cell along it and direction, of both ends; room for a rank."""
    most = max(shape)
    values = (most << MAX_DEPTH) + 1
    if n_levels * 2 * values * most * 2 * _RANKS >= 1 << 63:
        raise ValueError(
            f"levels: {n_levels} are too many for {shape[0]} x {shape[1]} cells; "
            "call once for each part of them"
        )
    axis, value, cell, up = edges.transpose(1, 0, 2)
    return (((level * 2 + axis) * values + value) * most + cell) * 2 + up


def _ranked(code: np.ndarray, axis: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The order of the codes along the lines, and in this order each with its rank among equals."""
    order = np.argsort(code)
    ordered = code[order]
    equal = np.flatnonzero(ordered[1:] == ordered[:-1])
    tied = np.union1d(equal, equal + 1)
    chosen = order[tied]
    along = np.where(axis[chosen] == 0, at[chosen, 1], at[chosen, 0])
    order[tied] = chosen[np.lexsort((along, ordered[tied]))]
    first = np.flatnonzero(np.diff(ordered[tied], prepend=-1))
    length = np.diff(first, append=len(tied))
    ordered *= _RANKS
    ordered[tied] += np.minimum(np.arange(len(tied)) - np.repeat(first, length), _RANKS - 1)
    return order, ordered


def _matches(
    start_order: np.ndarray, starts: np.ndarray, stop_order: np.ndarray, stops: np.ndarray
) -> np.ndarray:
    """For every arc the one that starts where it stops, or -1; codes are sorted."""
    place = np.minimum(np.searchsorted(starts, stops), len(starts) - 1)
    follows = np.empty(len(starts), int)
    follows[stop_order] = np.where(starts[place] == stops, start_order[place], -1)
    return follows


def chains(follows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First arc of the chain of every arc, its rank in it, and whether the chain is a loop."""
    n = len(follows)
    before = np.full(n, -1)
    joined = np.flatnonzero(follows >= 0)
    before[follows[joined]] = joined
    head, rank = _jump(before)
    looped = np.flatnonzero(before[head] >= 0)
    closed = np.full(n, False)
    closed[looped] = True
    if len(looped):
        least, jump = np.arange(n), before.copy()
        for _ in range(_rounds(len(looped))):
            least[looped] = np.minimum(least[looped], least[jump[looped]])
            jump[looped] = jump[jump[looped]]
        before[least[looped]] = -1
        head, rank = _jump(before)
    return head, rank, closed


def _jump(before: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Follow `before` to its end by doubling: where it ends, and after how many steps."""
    head = np.where(before < 0, np.arange(len(before)), before)
    rank = (before >= 0).astype(int)
    for _ in range(_rounds(len(before))):
        rank += rank[head]
        farther = head[head]
        if np.array_equal(farther, head):
            break
        head = farther
    return head, rank


def _rounds(n: int) -> int:
    return int(n).bit_length() + 1


def _without_repeats(points: np.ndarray, bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices without those that equal the one before on the same line."""
    kept = np.append(True, (points[1:] != points[:-1]).any(1))
    kept[bounds[:-1]] = True
    return points[kept], np.append(0, np.cumsum(kept))[bounds]
