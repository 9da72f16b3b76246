"""Connected parts of the samples above a level, under the bilinear interpolant."""

import numpy as np


def components(samples: np.ndarray, level: float) -> np.ndarray:
    """Number the connected parts of `{f > level}` at the samples; -1 at those not above.

    Neighbours along an axis that are both above are connected; those across a cell where the
    bilinear interpolant is above the level all the way between them.  NaN is not above.
    """
    above = samples > level
    label = np.arange(samples.size).reshape(samples.shape)
    pairs = [
        _pairs(label[1:], label[:-1], above[1:] & above[:-1]),
        _pairs(label[:, 1:], label[:, :-1], above[:, 1:] & above[:, :-1]),
    ]
    f00, f01, f10, f11 = samples[:-1, :-1], samples[:-1, 1:], samples[1:, :-1], samples[1:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        saddle = (f00 * f11 - f01 * f10) / (f00 + f11 - f01 - f10) > level
    one = above[:-1, :-1] & above[1:, 1:] & saddle
    other = above[:-1, 1:] & above[1:, :-1] & saddle
    pairs.append(_pairs(label[:-1, :-1], label[1:, 1:], one & ~other))
    pairs.append(_pairs(label[:-1, 1:], label[1:, :-1], other & ~one))
    root = connect(samples.size, np.concatenate(pairs, axis=1)).reshape(samples.shape)
    numbered = np.full(samples.shape, -1)
    numbered[above] = np.unique(root[above], return_inverse=True)[1]
    return numbered


def _pairs(one: np.ndarray, other: np.ndarray, joined: np.ndarray) -> np.ndarray:
    return np.stack([one[joined], other[joined]])


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
