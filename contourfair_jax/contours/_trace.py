"""From a field and levels to lines: arcs of all leaves, joined without a loop over arcs.

An arc is followed by the one that starts where it ends: on the same edge, at the same level, and
passing it in the same direction.  Leaves of different sizes meet along edges of different lengths,
so what is compared is the straight line that the edge is part of, and the rank of the crossing.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .._bezier.host import known
from .._bezier.nets import PlacedNet
from .._level_sets import Values
from .._support.arrays import batches, ranges
from .._support.results import Progress, untold
from ._arcs import RANKS, Arcs, Codes, arcs, concatenate
from ._pieces import grid_cells, leaves


def trace(
    net: np.ndarray,
    values: Values,
    levels: np.ndarray,
    tolerance: float,
    codes: Codes,
    progress: Progress = untold,
) -> tuple[Arcs, int]:
    """The arcs of sorted levels in a control net, and how many pieces were not proved.

    `progress` is called with the number of rows of cells that are done and of all.
    """
    rows = (len(net) - 1) // 3
    placed = values.placed(levels)
    found: list[Arcs] = []
    unproved = 0
    for cells in grid_cells(net, placed, values.middle):
        for group in leaves(cells, placed, tolerance, 4 * values.rounding):
            unproved += int(np.count_nonzero(~group.proved))
            found += arcs(group, placed, codes)
        progress(int(cells.corner[0, -1]) + 1, rows)
    return concatenate(found), unproved


def host_arrays(field: PlacedNet) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Net, spacing and origin of a 2-D field on the host.

    Raises
    ------
    ValueError
        For a field that is not 2-D, or traced.
    """
    field = known(field)
    if field.ndim != 2:
        raise ValueError(
            f"field must be 2-D to have contour lines, got {field.ndim}-D; "
            "take a slice of the samples, or the isosurface"
        )
    spacing, origin = (np.asarray(x, dtype=np.float64) for x in (field.spacing, field.origin))
    return np.asarray(field.control_points), spacing, origin


# Arcs joined in one go, of as many levels as that takes.
_BATCH = 1 << 16


@dataclass(frozen=True)
class Lines:
    """Lines sorted by level, in units of cells; larger values on their left.

    Parameters
    ----------
    points : array, shape (n, 2)
        The vertices of all lines, one line after the other; the first vertex of a loop is repeated
        as its last.
    bounds : array of int, shape (lines + 1,)
        Line k is `points[bounds[k] : bounds[k + 1]]`.
    level : array of int, shape (lines,)
    closed : array of bool, shape (lines,)
    codes : array of int, shape (lines, 2)
        Numbers of the crossings where lines that are not closed start and stop; see `Codes`.
    """

    points: np.ndarray
    bounds: np.ndarray
    level: np.ndarray
    closed: np.ndarray
    codes: np.ndarray

    def pieces(self) -> list[np.ndarray]:
        """The vertices of each line."""
        return np.split(self.points, self.bounds[1:-1]) if len(self.level) else []


def link(arcs: Arcs, codes: Codes) -> Iterator[Lines]:
    """Join arcs to lines, some levels after the other."""
    by_level = np.argsort(arcs.level, kind="stable")
    per_level = np.bincount(arcs.level, minlength=codes.levels)
    offset = np.cumsum(arcs.count, dtype=int) - arcs.count
    done = 0
    for levels in batches(per_level, _BATCH):
        size = int(per_level[levels].sum())
        if not size:
            continue
        chosen = by_level[done : done + size]
        done += size
        yield _link(arcs, chosen, offset, codes)


def join_lines(parts: Sequence[Lines]) -> Lines:
    """Lines of successive levels in one."""
    shifts = np.cumsum([0, *(len(part.points) for part in parts)])
    none = np.empty((0, 2))
    return Lines(
        np.concatenate([none, *(part.points for part in parts)]),
        np.concatenate(
            [np.zeros(1, int), *(p.bounds[1:] + s for p, s in zip(parts, shifts, strict=False))]
        ),
        np.concatenate([none[:, 0].astype(np.int32), *(part.level for part in parts)]),
        np.concatenate([none[:, 0].astype(bool), *(part.closed for part in parts)]),
        np.concatenate([none.astype(int), *(part.codes for part in parts)]),
    )


def _link(arcs: Arcs, chosen: np.ndarray, offset: np.ndarray, codes: Codes) -> Lines:
    """The lines that some arcs make; these are all of their levels."""
    level, count, offset = arcs.level[chosen], arcs.count[chosen].astype(int), offset[chosen]
    crossings, starts, stops = arcs.codes[chosen], arcs.points[offset], arcs.stops[chosen]
    follows = _matches(
        *_ranked(crossings[:, 0], starts, codes), *_ranked(crossings[:, 1], stops, codes)
    )
    head, rank, closed = chains(follows)
    heads = np.flatnonzero(rank == 0)
    heads = heads[np.argsort(level[heads], kind="stable")]
    number = np.empty(len(level), int)
    number[heads] = np.arange(len(heads))
    number = number[head]
    order = np.argsort(number * (rank.max() + 1) + rank)
    last = order[np.append(np.flatnonzero(np.diff(number[order])), len(order) - 1)]
    # Every arc brings its vertices but the last, and then every line its last one.
    sizes = np.bincount(number, count).astype(int)
    bounds = np.append(0, np.cumsum(sizes + 1))
    points = np.empty((bounds[-1], 2))
    inner = np.full(len(points), True)
    inner[bounds[1:] - 1] = False
    points[inner] = arcs.points[ranges(offset[order], count[order])]
    points[bounds[1:] - 1] = np.where(closed[heads, None], starts[heads], stops[last])
    outer = np.stack([crossings[heads, 0], crossings[last, 1]], axis=1)
    return Lines(*_without_repeats(points, bounds), level[heads], closed[heads], outer)


def _ranked(code: np.ndarray, at: np.ndarray, codes: Codes) -> tuple[np.ndarray, np.ndarray]:
    """The order of crossings along the lines, and in this order each with its rank among equals."""
    order = np.argsort(code)
    ordered = code[order]
    equal = np.flatnonzero(ordered[1:] == ordered[:-1])
    tied = np.union1d(equal, equal + 1)
    chosen = order[tied]
    axis = codes.decode(ordered[tied])[0]
    along = np.where(axis == 0, at[chosen, 1], at[chosen, 0])
    order[tied] = chosen[np.lexsort((along, ordered[tied]))]
    first = np.flatnonzero(np.diff(ordered[tied], prepend=-1))
    length = np.diff(first, append=len(tied))
    ordered *= RANKS
    ordered[tied] += np.minimum(np.arange(len(tied)) - np.repeat(first, length), RANKS - 1)
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
