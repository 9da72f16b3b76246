"""Fields and triangle meshes as VTK data sets; needs the extra ``vtk``."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from ._grid.grid import Grid
from ._support.errors import needed
from .isosurface._mesh import merged

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkPolyData, vtkUnstructuredGrid

    from ._bezier.nets import PlacedNet
    from .isosurface import Isosurface


@runtime_checkable
class Leaves(Protocol):
    """Vertices, their values, and the corners and depths of leaves: those of an `AdaptiveField`."""

    @property
    def vertices(self) -> np.ndarray: ...

    @property
    def values(self) -> np.ndarray: ...

    @property
    def leaves(self) -> np.ndarray: ...

    @property
    def depths(self) -> np.ndarray: ...


def bezier_grid(field: PlacedNet) -> vtkUnstructuredGrid:
    """The field as Bezier cells of degree 3 that share the points of its net.

    Cells with NaN are left out.  Point data ``field`` has the Bezier points.
    """
    model, support = vtk_module("vtkCommonDataModel"), vtk_module("util.numpy_support")
    net = np.asarray(field.control_points)
    ndim, cells = field.ndim, tuple(n - 1 for n in field.shape)
    steps = np.asarray(field.spacing, dtype=np.float64) / 3
    places = np.zeros((net.size, 3))
    places[:, :ndim] = np.indices(net.shape).reshape(ndim, -1).T * steps
    places[:, :ndim] += np.asarray(field.origin, dtype=np.float64)
    kind = model.vtkBezierHexahedron if ndim == 3 else model.vtkBezierQuadrilateral
    local = np.array(list(np.ndindex((4,) * ndim)))
    order = np.array([kind.PointIndexFromIJK(*at, (3,) * ndim) for at in local.tolist()])
    local = local[np.argsort(order)]
    corners = 3 * np.array(list(np.ndindex(cells)))
    at = corners[:, None] + local
    points = np.asarray(np.ravel_multi_index(tuple(np.moveaxis(at, -1, 0)), net.shape))
    valid = np.isfinite(net.reshape(-1)[points]).all(axis=1)
    points = points[valid].astype(np.int64)
    grid = model.vtkUnstructuredGrid()
    grid.SetPoints(_points(places))
    array = model.vtkCellArray()
    offsets = np.arange(len(points) + 1) * 4**ndim
    array.SetData(
        *(support.numpy_to_vtkIdTypeArray(x, deep=True) for x in (offsets, points.ravel()))
    )
    grid.SetCells(kind().GetCellType(), array)
    values = support.numpy_to_vtk(net.reshape(-1), deep=True)
    values.SetName("field")
    grid.GetPointData().SetScalars(values)
    degrees = support.numpy_to_vtk(np.tile([3.0] * ndim + [1.0] * (3 - ndim), (len(points), 1)), 1)
    degrees.SetName("HigherOrderDegrees")
    grid.GetCellData().SetHigherOrderDegrees(degrees)
    return grid


def leaf_grid(adaptive: Leaves, grid: Grid | None = None) -> vtkUnstructuredGrid:
    """The leaves of an adaptive field as quads or hexahedra; see `AdaptiveField.to_vtk`."""
    model, support = vtk_module("vtkCommonDataModel"), vtk_module("util.numpy_support")
    ndim = adaptive.vertices.shape[1]
    vertices = adaptive.vertices
    turned = False
    if grid is not None:
        turned = np.linalg.det(_turn(grid)) < 0
        vertices = grid.world(vertices)[:, ::-1]
    places = np.zeros((len(vertices), 3))
    places[:, :ndim] = vertices
    # VTK goes round the face of axes 0 and 1, then round the opposite one; corners here count in
    # binary, the last axis first.
    round_ = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])[:: -1 if turned else 1]
    order = round_ @ np.array([2, 1])
    if ndim == 3:
        order = np.concatenate([2 * order, 2 * order + 1])
    leaves = adaptive.leaves[:, order].astype(np.int64)
    data = model.vtkUnstructuredGrid()
    data.SetPoints(_points(places))
    array = model.vtkCellArray()
    offsets = np.arange(len(leaves) + 1) * 2**ndim
    array.SetData(
        *(support.numpy_to_vtkIdTypeArray(x, deep=True) for x in (offsets, leaves.ravel()))
    )
    data.SetCells((model.vtkQuad if ndim == 2 else model.vtkHexahedron)().GetCellType(), array)
    for name, values, target in (
        ("field", adaptive.values, data.GetPointData()),
        ("depth", adaptive.depths, data.GetCellData()),
    ):
        column = support.numpy_to_vtk(values, deep=True)
        column.SetName(name)
        target.SetScalars(column)
    return data


def _turn(grid: Grid) -> np.ndarray:
    """Matrix from steps of the field to steps of the world, x first."""
    ends = grid.world(np.concatenate([np.zeros((1, grid.ndim)), np.eye(grid.ndim)]))[:, ::-1]
    return (ends[1:] - ends[0]).T


def triangle_mesh(mesh: Isosurface, grid: Grid | None = None, single: bool = False) -> vtkPolyData:
    """The mesh with normals and curvatures as point data.

    Parameters
    ----------
    mesh : Isosurface
    grid : Grid
        Whose samples the field was made from: positions and normals are then in world coordinates,
        x first.  By default they are in those of the field.
    single : bool
        Whether triangles are left out whose corners are not apart in single precision.
    """
    model, support = vtk_module("vtkCommonDataModel"), vtk_module("util.numpy_support")
    vertices, normals, triangles = mesh.vertices, mesh.normals, mesh.triangles
    if grid is not None:
        turn = _turn(grid)
        vertices = grid.world(vertices)[:, ::-1]
        normals = normals @ np.linalg.inv(turn)
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        triangles = triangles[:, ::-1] if np.linalg.det(turn) < 0 else triangles
    kept: Any = slice(None)
    if single:
        kept, triangles = merged(vertices, triangles)
    data = model.vtkPolyData()
    data.SetPoints(_points(np.ascontiguousarray(vertices[kept])))
    array = model.vtkCellArray()
    offsets = np.arange(len(triangles) + 1) * 3
    corners = np.ascontiguousarray(triangles, dtype=np.int64).ravel()
    array.SetData(*(support.numpy_to_vtkIdTypeArray(x, deep=True) for x in (offsets, corners)))
    data.SetPolys(array)
    for name, values in {
        "normals": normals,
        "mean_curvature": mesh.mean_curvature,
        "gaussian_curvature": mesh.gaussian_curvature,
    }.items():
        column = support.numpy_to_vtk(np.ascontiguousarray(values[kept]), deep=True)
        column.SetName(name)
        data.GetPointData().AddArray(column)
    data.GetPointData().SetActiveNormals("normals")
    return data


def _points(places: np.ndarray) -> Any:
    points = vtk_module("vtkCommonCore").vtkPoints()
    points.SetData(vtk_module("util.numpy_support").numpy_to_vtk(places, deep=True))
    return points


def vtk_module(name: str) -> Any:
    """A module of VTK, which is imported when it is first used."""
    needed("vtkmodules", "vtk", "a data set of VTK")
    return import_module(f"vtkmodules.{name}")
