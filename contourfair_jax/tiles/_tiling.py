"""Division of a grid into tiles: by its shape, the factor and the method alone.

Tiles are counted from the first sample, T cells along each axis.  Every tile is computed from a
block of the same shape, T cells and a halo on both sides; blocks that would reach over the end of
the grid are moved inwards, so that the border of the grid is the border of a block.  One compiled
program then serves all tiles, and no result depends on who computes which tile when.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .._grid.affine import refined_shape

Slices = tuple[slice, ...]


@dataclass(frozen=True)
class Tile:
    """One tile.

    Parameters
    ----------
    number
        Its number, last axis fastest.
    block
        The samples that it is computed from.
    offset
        First cell of the refined window, counted from the start of the block.
    cut
        The part of the refined window that belongs to the tile.
    region
        The part of the whole refined grid that it is.
    """

    number: int
    block: Slices
    offset: tuple[int, ...]
    cut: Slices
    region: Slices


@dataclass(frozen=True)
class Tiling:
    """The tiles of a grid.

    Parameters
    ----------
    shape
        Samples per axis.
    factors
        How many times finer the result is along each axis.
    cells
        Cells along each axis of a tile.
    halo
        Cells around a tile that its block has besides.
    """

    shape: tuple[int, ...]
    factors: tuple[int, ...]
    cells: int
    halo: int

    @property
    def block(self) -> tuple[int, ...]:
        """Samples per axis of every block."""
        return tuple(min(n, self.cells + 2 * self.halo + 1) for n in self.shape)

    @property
    def window(self) -> tuple[int, ...]:
        """Cells per axis that are refined of every block."""
        return tuple(min(n - 1, self.cells) for n in self.shape)

    @property
    def counts(self) -> tuple[int, ...]:
        """Tiles per axis."""
        return tuple(-(-(n - 1) // self.cells) for n in self.shape)

    @property
    def fine_shape(self) -> tuple[int, ...]:
        """Samples per axis of the result."""
        return refined_shape(self.shape, self.factors)

    @property
    def own(self) -> tuple[int, ...]:
        """Samples per axis of the result that a tile owns, if it is not the last."""
        return tuple(factor * self.cells for factor in self.factors)

    @property
    def fine_window(self) -> tuple[int, ...]:
        """Samples per axis of the refined window."""
        return refined_shape([cells + 1 for cells in self.window], self.factors)

    @property
    def chunks(self) -> tuple[int, ...]:
        """Samples per axis of chunks of the result that each belong to one tile."""
        return tuple(
            fine if count == 1 else own
            for fine, count, own in zip(self.fine_shape, self.counts, self.own, strict=True)
        )

    def __len__(self) -> int:
        return math.prod(self.counts)

    def __iter__(self) -> Iterator[Tile]:
        return map(self.tile, range(len(self)))

    def tile(self, number: int) -> Tile:
        """The tile of a number."""
        axes = zip(np.unravel_index(number, self.counts), self.shape, self.factors, strict=True)
        block, offset, cut, region = zip(
            *(self._along(int(k), n, factor) for k, n, factor in axes), strict=True
        )
        return Tile(number, block, offset, cut, region)

    def _along(self, position: int, n: int, factor: int) -> tuple[slice, int, slice, slice]:
        """Block, offset, cut and region along one axis of `n` samples."""
        first = position * self.cells
        last = min(first + self.cells, n - 1)
        block = min(n, self.cells + 2 * self.halo + 1)
        start = min(max(first - self.halo, 0), n - block)
        window = min(first, n - 1 - min(n - 1, self.cells))
        closing = int(last == n - 1)
        begin, end = factor * first, factor * last + closing
        shift = factor * window
        return (
            slice(start, start + block),
            window - start,
            slice(begin - shift, end - shift),
            slice(begin, end),
        )
