"""Gaps that reach beyond the block of a tile, which global fairing cannot fill tile by tile.

Within a gap nothing holds the field, so that it depends on all samples around the gap: a block that
has those of one side only gives another field than its neighbour.  On noise, a gap that ends a
third of the halo (8 of 24 cells) before the end of the block is filled to 1e-4 of the range, one
that ends 2 cells before it to 1e-1; cells beside the gap are then off by 3e-4.
"""

from collections.abc import Iterator

import numpy as np

from .._fairing.global_fairing.method import GlobalFairing
from .._fairing.method import AbstractFairing
from .._support.errors import InputError
from ._tiling import Tile, Tiling

# Samples of a gap that are no farther from its rim are held from there.
_RIM = 2

_REMEDY = (
    "fair the whole grid with fair_field, or locally, or leave the gaps (fill=False, no --fill)"
)


def check_gaps(method: AbstractFairing, block: np.ndarray, tile: Tile, tiling: Tiling) -> None:
    """Refuse to fill gaps that `is_cut` tells of.

    Raises
    ------
    InputError
        The tile has such a gap.
    """
    if is_cut(method, block, tile, tiling):
        raise refusal(1, tile)


def refusal(count: int, first: Tile) -> InputError:
    """The error about `count` tiles that cannot be filled."""
    where = " x ".join(f"{part.start}:{part.stop}" for part in first.block)
    return InputError(
        f"missing samples reach too far beyond {count} tile{'s' * (count > 1)} to be filled "
        f"(the first within samples {where}); {_REMEDY}"
    )


def is_cut(
    method: AbstractFairing, block: np.ndarray, tile: Tile, tiling: Tiling, fill: bool = True
) -> bool:
    """Whether a gap beside or in a tile reaches so far that its block does not show its other side.

    Parameters
    ----------
    block
        The samples of the tile's block, missing ones NaN.
    fill
        Whether gaps are filled; if not, tiles without any sample have no field to be wrong.
    """
    missing = np.isnan(block)
    near = tuple(
        slice(max(first - 2 * _RIM, 0), first + cells + 1 + 2 * _RIM)
        for first, cells in zip(tile.offset, tiling.window, strict=True)
    )
    if not isinstance(method, GlobalFairing) or (missing[near].all() and not fill):
        return False
    core = _core(missing)
    if not core.any():
        return False
    from skimage.measure import label

    gaps = np.asarray(label(core))
    beside = gaps[near]
    return any(np.isin(gaps[edge], beside[beside > 0]).any() for edge in _edges(tile, tiling))


def _core(missing: np.ndarray) -> np.ndarray:
    """Missing samples all of whose neighbours are missing, as far as a rim is wide."""
    for axis in range(missing.ndim):
        ends = [(_RIM, _RIM) if k == axis else (0, 0) for k in range(missing.ndim)]
        padded = np.pad(missing, ends, constant_values=True)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _RIM + 1, axis)
        missing = np.all(windows, axis=-1, keepdims=True)[..., 0]
    return missing


def _edges(tile: Tile, tiling: Tiling) -> Iterator[tuple[slice, ...]]:
    """The parts of a block near those of its ends that are not ends of the grid."""
    margin = tiling.halo // 3 + _RIM
    whole = (slice(None),) * len(tiling.shape)
    for axis, (part, n) in enumerate(zip(tile.block, tiling.shape, strict=True)):
        if part.start > 0:
            yield *whole[:axis], slice(margin), *whole[axis + 1 :]
        if part.stop < n:
            yield *whole[:axis], slice(-margin, None), *whole[axis + 1 :]
