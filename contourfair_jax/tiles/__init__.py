"""Grids larger than memory: refined tile by tile, by several processes, with nothing lost.

Tiles are cut by the shape of the grid, the factor and the method alone, and computed by one
program.  So the result is the same, bit for bit, whoever computes which tile in which order, and
after any number of interruptions.  Local fairing is exact in tiles: cells depend on the samples one
step around them.  For global fairing tiles overlap by 24 cells, and seams stay below 1e-5 of the
range of the samples.

Gaps: local fairing leaves them.  Global fairing fills those that end well within the overlap, to
some 1e-4 of the range, and refuses wider ones that reach beyond a tile, for what is in them depends
on all samples around.  With ``fill=False`` gaps of any size stay missing; cells beside those that
reach beyond a tile may have seams up to 1e-3, of which a warning tells.
"""

from .._support.public import public as _public
from ._devices import refine_sharded as refine_sharded
from ._job import Outcome as Outcome
from ._refine import refine_tiles as refine_tiles
from ._refine import refine_to as refine_to

__all__ = [
    "Outcome",
    "refine_sharded",
    "refine_tiles",
    "refine_to",
]

_public(
    __name__,
    "contourfair_jax.tiles.refine_tiles or refine_to",
)
