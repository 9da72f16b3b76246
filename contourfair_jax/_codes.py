"""One number for each crossing of an edge, the same from both sides of the edge."""

from dataclasses import dataclass

import numpy as np

from ._subdivide import MAX_DEPTH

# More than a level crosses a straight line within a cell in one direction: a cubic has three roots.
RANKS = 8


@dataclass(frozen=True)
class Codes:
    """Numbers for level, straight line, cell along it and direction; leaves room for a rank.

    Parameters
    ----------
    levels : int
        How many.
    cells : int
        Of the grid, along its longer axis.
    """

    levels: int
    cells: int

    def __post_init__(self) -> None:
        if self.levels * 4 * self._values * self.cells * RANKS >= 1 << 63:
            raise ValueError(
                f"levels: {self.levels} are too many for {self.cells} cells along an axis; "
                "call once for each part of them"
            )

    @property
    def _values(self) -> int:
        return (self.cells << MAX_DEPTH) + 1

    def encode(
        self,
        level: np.ndarray,
        axis: np.ndarray,
        value: np.ndarray,
        cell: np.ndarray,
        up: np.ndarray,
    ) -> np.ndarray:
        """The number of a crossing.

        Parameters
        ----------
        level : array of int
        axis : array of int
            The coordinate that is constant along the edge.
        value : array of int
            Its value, in units of `2**-MAX_DEPTH` cells.
        cell : array of int
            The cell of the grid along the edge.
        up : array of int
            1 where the line passes to larger values of this coordinate.
        """
        return (((level * 2 + axis) * self._values + value) * self.cells + cell) * 2 + up

    def decode(self, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Axis, value, cell and direction."""
        rest, up = np.divmod(codes, 2)
        rest, cell = np.divmod(rest, self.cells)
        rest, value = np.divmod(rest, self._values)
        return rest % 2, value, cell, up
