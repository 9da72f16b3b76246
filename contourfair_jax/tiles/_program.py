"""The one program that computes tiles: a block of samples in, its refined window out."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._bezier.nets import without_gaps
from .._fair import settings_as_arrays
from .._fairing.global_fairing.cell_weights import weighs_cells
from .._fairing.global_fairing.method import GlobalFairing
from .._fairing.local_fairing.method import LocalFairing
from .._fairing.method import AbstractFairing
from .._field import BezierField
from ._tiling import Tiling


class Overlap(NamedTuple):
    """The overlap of tiles that a method needs, and their size.

    Parameters
    ----------
    halo
        Cells around a tile that it is computed with.
    cells
        Cells per axis of a tile, by the number of dimensions: many more than the halo.
    """

    halo: int
    cells: dict[int, int]


# A cell of local fairing depends on the samples one step around it.  In global fairing the
# influence of a sample fades: on noise, seams are 1e-4 of the range with a halo of 8 cells, and
# with 16 no larger than what the tolerance leaves.  In gaps nothing fades; see `_gaps`.
_OVERLAPS: dict[type[AbstractFairing], Overlap] = {
    LocalFairing: Overlap(1, {2: 128, 3: 24}),
    GlobalFairing: Overlap(24, {2: 256, 3: 64}),
}

# Residual of the linear solves of global fairing: 1e-4 would leave seams of as much.
_TOLERANCE = 1e-6
# Samples along each axis of a refined tile, at most, by the number of dimensions.
_MOST = {2: 4096, 3: 256}


def tiling_of(method: AbstractFairing, shape: tuple[int, ...], factors: tuple[int, ...]) -> Tiling:
    """The tiles of a grid for a method.

    Raises
    ------
    ValueError
        The method, or one of its settings, needs the whole grid at once.
    """
    if type(method) not in _OVERLAPS:
        known = ", ".join(f"{each.__name__}()" for each in _OVERLAPS)
        raise ValueError(f"method must be one of {known} for tiles, got {method!r}")
    for name, why in (
        ("sigma", "looks at the whole grid"),
        ("cell_weights", "looks at the whole grid"),
        ("converge", "stops by the changes of the whole grid, which leaves seams"),
    ):
        if getattr(method, name, None) is not None:
            raise ValueError(
                f"method.{name} {why}, so it cannot be used in tiles; "
                "leave it None, or fair the whole grid with fair_field"
            )
    if weighs_cells(getattr(method, "norm", 2)):
        raise ValueError(
            "method.norm below 2 weighs cells by the mean of the whole grid, so it cannot be used "
            "in tiles; leave it 2, or fair the whole grid with fair_field"
        )
    if getattr(method, "border_degree", 0):
        raise ValueError(
            "method.border_degree continues every tile beyond its own edges, which leaves seams, "
            "so it cannot be used in tiles; leave it 0, or fair the whole grid with fair_field"
        )
    halo, cells = _OVERLAPS[type(method)]
    most = _MOST[len(shape)] // max(factors)
    return Tiling(shape, factors, max(4, min(cells[len(shape)], most)), halo)


def tile_method(method: AbstractFairing) -> AbstractFairing:
    """The method with which tiles are computed: global solves to a residual that hides seams."""
    if isinstance(method, GlobalFairing):
        return dataclasses.replace(method, tolerance=min(method.tolerance, _TOLERANCE))
    return method


def refine_block(
    method: AbstractFairing,
    block: Float[Array, "*block"],
    spacing: Float[Array, " ndim"],
    offset: Int[Array, " ndim"],
    window: tuple[int, ...],
    factors: tuple[int, ...],
    fill: bool = True,
) -> tuple[Float[Array, "*fine"], Bool[Array, ""]]:
    """Refine `window` cells of a block, those from the cell `offset` on.

    Cells with a missing corner get values if the method gives them and `fill` is set.

    Returns
    -------
    values : array, factor * window + 1 along every axis
    converged : bool array
    """
    net, report = method.fit(block, spacing)
    if not fill:
        net = without_gaps(net, jnp.isnan(block))
    points = tuple(3 * cells + 1 for cells in window)
    part = jax.lax.dynamic_slice(net, tuple(3 * offset), points)
    converged = jnp.asarray(True) if report is None else report.converged
    return BezierField(part, spacing, jnp.zeros_like(spacing)).refine(factors), converged


_compiled = eqx.filter_jit(refine_block)


class Program:
    """`refine_block` for NumPy arrays, in the precision of `dtype`, whatever the process uses.

    Parameters
    ----------
    method
        How to fair.
    spacing
        Distance of samples along each axis.
    dtype
        float32 or float64.
    fill
        Whether gaps that the method fills stay filled.
    """

    def __init__(
        self,
        method: AbstractFairing,
        spacing: Sequence[float],
        dtype: np.dtype,
        fill: bool = True,
    ) -> None:
        self._fill = fill
        self._dtype = np.dtype(dtype)
        with self._float_width():
            self._method = settings_as_arrays(tile_method(method), self._dtype)
            self._spacing = jnp.asarray(np.array(spacing), self._dtype)

    def __call__(
        self, block: np.ndarray, offset: Sequence[int], tiling: Tiling
    ) -> tuple[np.ndarray, bool]:
        """The refined window, and whether the method converged; a block of gaps stays one."""
        if np.isnan(block).all():
            return np.full(tiling.fine_window, np.nan, self._dtype), True
        with self._float_width():
            samples = jnp.asarray(block, self._dtype)
            values, converged = _compiled(
                self._method.prepare(samples),
                samples,
                self._spacing,
                jnp.asarray(np.array(offset), np.int32),
                tiling.window,
                tiling.factors,
                self._fill,
            )
            return np.asarray(values), bool(converged)

    def _float_width(self) -> Any:
        return jax.enable_x64(self._dtype == np.float64)


def tile_bytes(tiling: Tiling, itemsize: int) -> int:
    """About the memory that one tile takes while it is computed."""
    ndim, vertices = len(tiling.shape), math.prod(tiling.block)
    fine = math.prod(tiling.fine_window)
    return itemsize * (64 * 2**ndim * vertices + 4 * fine)
