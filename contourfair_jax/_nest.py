"""Which outer ring each hole belongs to."""

from collections.abc import Sequence

import numpy as np

from ._ragged import batches, ranges

_BATCH = 1 << 20


def parents(rings: Sequence[np.ndarray], holes: Sequence[int]) -> list[int]:
    """For each hole the outer ring around it that is next to it.

    From the vertex of the hole that is lowest along axis 1 one looks down along this axis.  What is
    seen first is the outer ring, or another hole of the same polygon.

    Parameters
    ----------
    rings : sequence of arrays, shape (n, 2)
        Closed, in units of cells, and without a point in common.
    holes : sequence of int
        Which of the rings are holes.
    """
    if not len(holes):
        return []
    eyes = np.array([rings[hole][np.argmin(rings[hole][:, 1])] for hole in holes])
    seen = _seen(rings, eyes)
    above = dict(zip(holes, seen.tolist(), strict=True))
    found = []
    for hole in holes:
        ring = above[hole]
        while ring in above:
            ring = above[ring]
        found.append(ring)
    return found


def _seen(rings: Sequence[np.ndarray], eyes: np.ndarray) -> np.ndarray:
    """The ring met first from each point downwards along axis 1, -1 where there is none."""
    starts = np.concatenate([ring[:-1] for ring in rings])
    ends = np.concatenate([ring[1:] for ring in rings])
    number = np.repeat(np.arange(len(rings)), [len(ring) - 1 for ring in rings])
    low, high = np.minimum(starts[:, 0], ends[:, 0]), np.maximum(starts[:, 0], ends[:, 0])
    first, last = np.floor(low).astype(int), np.floor(high).astype(int)
    spans = last - first + 1
    segment = np.repeat(np.arange(len(low)), spans)
    row = ranges(first, spans)
    order = np.argsort(row, kind="stable")
    segment, row = segment[order], row[order]
    eye_row = np.floor(eyes[:, 0]).astype(int)
    begin, stop = np.searchsorted(row, eye_row), np.searchsorted(row, eye_row, side="right")
    seen, best = np.full(len(eyes), -1), np.full(len(eyes), -np.inf)
    for here in batches(stop - begin, _BATCH):
        count = stop[here] - begin[here]
        eye, candidate = np.repeat(here, count), segment[ranges(begin[here], count)]
        across = eyes[eye, 0]
        spanned = (low[candidate] <= across) & (across < high[candidate])
        eye, candidate = eye[spanned], candidate[spanned]
        a, b = starts[candidate], ends[candidate]
        at = a[:, 1] + (b[:, 1] - a[:, 1]) * ((eyes[eye, 0] - a[:, 0]) / (b[:, 0] - a[:, 0]))
        under = at < eyes[eye, 1]
        eye, candidate, at = eye[under], candidate[under], at[under]
        np.maximum.at(best, eye, at)
        nearest = at == best[eye]
        seen[eye[nearest]] = number[candidate[nearest]]
    return seen
