"""The coarsest tree that is proved to be near to a field."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import jax
import numpy as np
from numpy.typing import ArrayLike

from .._bezier.host import HostField
from .._bezier.nets import PlacedNet
from .._bezier.subdivision import dyadic_parts
from .._support.checks import Scalar
from .._support.memory import check_memory
from .._support.public import former_keyword
from .._support.results import Progress, untold
from ._tree import MOST_DEPTH, Tree, balance, split, whole

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    from .._grid.grid import Grid


_BATCH = 1 << 13
_BYTES_PER_LEAF = 1500


@dataclass(frozen=True, eq=False)
class AdaptiveField:
    """A continuous field, linear along the axes in each of its leaves.

    Parameters
    ----------
    vertices : array, shape (n, ndim)
        In physical coordinates.
    values : array, shape (n,)
    leaves : array of int, shape (m, 2^ndim)
        Corners, those along the last axis next to each other.
    depths : array of int, shape (m,)
        How often the cell of the grid was halved.
    error : float
        Proved: the field is nowhere farther away.
    """

    vertices: np.ndarray
    values: np.ndarray
    leaves: np.ndarray
    depths: np.ndarray
    error: float
    _tree: Tree
    _spacing: np.ndarray
    _origin: np.ndarray

    def __len__(self) -> int:
        return len(self.leaves)

    def __repr__(self) -> str:
        return f"AdaptiveField({len(self)} leaves, error at most {self.error:.3g})"

    @cached_property
    def _first(self) -> np.ndarray:
        """Number of the first leaf of each depth."""
        return np.cumsum([0, *map(len, self._tree.corners)])

    def __call__(self, points: ArrayLike) -> np.ndarray:
        """Values at physical coordinates, shape (..., ndim) -> (...); NaN where there is no leaf.

        Raises
        ------
        ValueError
            For points whose last axis is not `ndim` long.
        """
        points = np.asarray(points, dtype=np.float64)
        ndim = self._tree.ndim
        if points.ndim < 1 or points.shape[-1] != ndim:
            raise ValueError(f"points must have shape (..., {ndim}), got {points.shape}")
        cells = ((points - self._origin) / self._spacing).reshape(-1, ndim)
        # Rounding may take points of the border beyond it.
        away = abs(self._origin / self._spacing) + self._tree.cells
        border = np.clip(cells, 0, self._tree.cells)
        near = abs(cells - border) <= 4 * np.finfo(float).eps * away
        cells = np.where(near, border, cells)
        depth, number = self._tree.locate(cells)
        inside = np.flatnonzero(number >= 0)
        leaf = self._first[depth[inside]] + number[inside]
        corner = np.concatenate(self._tree.corners)[leaf]
        at = cells[inside] * 2.0 ** depth[inside, None] - corner
        values = np.full(len(cells), np.nan)
        values[inside] = _multilinear(self.values[self.leaves[leaf]], at)
        return values.reshape(points.shape[:-1])

    def to_vtk(self, grid: "Grid | None" = None) -> "vtkUnstructuredGrid":
        """Quads or hexahedra of VTK with point data ``field`` and cell data ``depth``.

        Coordinate k is x, y, z of VTK in this order, or world coordinates, x first, with the grid
        of the samples.  Needs the extra ``vtk``.
        """
        from .._vtk import leaf_grid

        return leaf_grid(self, grid)


@former_keyword("tolerance", "error")
def adaptive(field: PlacedNet, error: Scalar, *, progress: Progress = untold) -> AdaptiveField:
    """The coarsest quadtree (octree) over the cells of a field that is proved to be near to it.

    Parameters
    ----------
    field : BezierField
    error : float
        Largest difference from the field, in the units of its values: no distance, as is the
        `tolerance` of contours and isosurfaces.
    progress : callable
        Called as ``progress(done, all)`` with leaves that are final, and an estimate of all.

    Returns
    -------
    AdaptiveField
        Neighbouring leaves differ by one halving at most.  Cells that hold NaN have no leaves.

    Raises
    ------
    ValueError
        For an error that is not above zero, that needs cells halved more than 10 times, or more
        leaves than fit in memory.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import contourfair_jax as cf
    >>> x = jnp.linspace(-1.0, 1.0, 10)
    >>> field = cf.fair_field(jnp.exp(-20 * (x[:, None] ** 2 + x**2)))
    >>> grid = field.adaptive(0.01)
    >>> len(grid) < 0.5 * field.refine(8).size, grid.error <= 0.01
    (True, True)
    """
    error = check_error(error)
    host = HostField.of(field)
    tree = whole(host.valid)
    while True:
        check_memory(_BYTES_PER_LEAF * len(tree), f"{len(tree)} leaves")
        corners = _corner_values(host, tree)
        errors = [_errors(host, part, k, corners[k]) for k, part in enumerate(tree.corners)]
        chosen = [of_leaves > error for of_leaves in errors]
        if not any(mask.any() for mask in chosen):
            break
        expected = _check_reach(errors, error, tree.ndim)
        progress(sum(int((~mask).sum()) for mask in chosen), max(expected, len(tree)))
        tree = balance(split(tree, chosen))
    return _assembled(field, tree, corners, max((e.max(initial=0.0) for e in errors), default=0.0))


def _check_reach(errors: list[np.ndarray], most: float, ndim: int) -> int:
    """About how many leaves there will be; refuses too many, or too many halvings, early.

    Halving takes errors down to a quarter; at first to less, where the field is far from quadratic.
    From the second pass on, the leaves to come are estimated from a quarter of the errors: those
    that there are stand for the largest in their leaf, not for the mean.
    """
    finest, count = 0, 0.0
    for depth, of_leaves in enumerate(errors):
        share = of_leaves / most
        if (share > 1).any():
            finest = depth + 1
        if len(errors) > 1:
            share = np.maximum(0.25 * share, 1.0)
            count += float((share ** (ndim / 2)).sum())
            finest = max(finest, depth + int(np.ceil(0.5 * np.log2(share.max(initial=1.0)))))
    if finest > MOST_DEPTH:
        raise ValueError(
            f"an error of {most:g} needs cells halved more than {MOST_DEPTH} times; "
            "allow a larger one"
        )
    what = f"an error of {most:g}, with about {count:.0f} leaves,"
    check_memory(int(_BYTES_PER_LEAF * count), what)
    return int(count)


def uniform_error(field: PlacedNet, depth: int) -> float:
    """Proved error of the multilinear interpolant where all cells are halved `depth` times.

    As of an `AdaptiveField` with leaves of one depth.
    """
    host = HostField.of(field)
    tree = whole(host.valid)
    for _ in range(depth):
        tree = split(tree, [np.ones(len(part), bool) for part in tree.corners])
    values = _true_corners(host, tree.corners[depth], depth)
    return float(_errors(host, tree.corners[depth], depth, values).max(initial=0.0))


def check_error(error: Scalar, name: str = "error") -> float:
    """The error as a float; ValueError, with its name, unless it is a number above zero."""
    known = isinstance(error, int | float | np.number | np.ndarray | jax.Array)
    known = known and np.ndim(error) == 0 and np.asarray(error).dtype.kind in "fiu"
    if not known or not 0 < error < np.inf:
        raise ValueError(f"{name} must be above zero, in the units of the values, got {error!r}")
    return float(error)


def _bits(ndim: int) -> np.ndarray:
    return np.array(list(np.ndindex((2,) * ndim)))


def _true_corners(host: HostField, corner: np.ndarray, depth: int) -> np.ndarray:
    """Values of the field at the corners of leaves, shape (n, 2^ndim)."""
    ends = _leaf_nets(host, corner, depth)[np.ix_(*[(0, 3)] * host.ndim)]
    return ends.reshape(2**host.ndim, len(corner)).T


def _corner_values(host: HostField, tree: Tree) -> list[np.ndarray]:
    """Values at the corners of all leaves, those of larger neighbours in their edges and faces.

    From coarse to fine, so that what a leaf takes from a larger neighbour is final.
    """
    sides = _bits(tree.ndim) - 1
    by_depth: list[np.ndarray] = []
    for depth, corner in enumerate(tree.corners):
        values = _true_corners(host, corner, depth)
        if depth:
            vertices = corner[:, None] + _bits(tree.ndim)
            hanging = (vertices % 2).any(-1)
            for side in sides:  # The larger leaf may lie on any side; all give the same value.
                parent = (vertices + side) >> 1
                number = np.where(hanging, tree.find(parent, depth - 1), -1)
                rows = number >= 0
                at = 0.5 * vertices[rows] - parent[rows]
                values[rows] = _multilinear(by_depth[depth - 1][number[rows]], at)
        by_depth.append(values)
    return by_depth


def _errors(host: HostField, corner: np.ndarray, depth: int, values: np.ndarray) -> np.ndarray:
    """Largest distance of the Bezier points of leaves from those of their interpolants."""
    thirds = np.array(list(np.ndindex((4,) * host.ndim))) / 3
    weights = np.prod(np.where(_bits(host.ndim)[:, None], thirds, 1 - thirds), axis=-1)
    errors = np.zeros(len(corner))
    for start in range(0, len(corner), _BATCH):
        part = slice(start, start + _BATCH)
        nets = _leaf_nets(host, corner[part], depth).reshape(len(thirds), -1)
        errors[part] = np.abs(nets - weights.T @ values[part].T).max(0)
    return errors


def _leaf_nets(host: HostField, corner: np.ndarray, depth: int) -> np.ndarray:
    """Bezier points of leaves, shape (4, ..., 4, n)."""
    cell, offset = corner >> depth, corner & ((1 << depth) - 1)
    return dyadic_parts(host.gather(cell), offset, depth)


def _multilinear(corners: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolants (n, 2^ndim) at points (n, ndim) of the unit cube."""
    weights = np.where(_bits(at.shape[1]), at[:, None], 1 - at[:, None]).prod(-1)
    return (weights * corners).sum(1)


def _assembled(
    field: PlacedNet, tree: Tree, corners: list[np.ndarray], error: float
) -> AdaptiveField:
    """Vertices numbered once each."""
    finest = len(tree.corners) - 1
    places = np.concatenate(
        [
            (part[:, None] + _bits(tree.ndim)) << (finest - depth)
            for depth, part in enumerate(tree.corners)
        ]
    )
    flat = places.reshape(-1, tree.ndim)
    vertices, first, number = np.unique(flat, axis=0, return_index=True, return_inverse=True)
    spacing, origin = (np.asarray(x, dtype=np.float64) for x in (field.spacing, field.origin))
    return AdaptiveField(
        vertices / 2**finest * spacing + origin,
        np.concatenate(corners).reshape(-1)[first],
        number.reshape(places.shape[:-1]),
        np.repeat(np.arange(finest + 1), [len(part) for part in tree.corners]),
        float(error),
        tree,
        spacing,
        origin,
    )
