"""Fields and triangle meshes as VTK data sets, and meshes as files; needs the extra ``vtk``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ._single import merged
from .io import Grid, InputError, MissingPackageError, replacing

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkPolyData, vtkUnstructuredGrid

    from ._bezier import PlacedNet
    from .adaptive import AdaptiveField
    from .isosurface import Isosurface

# Writers by ending: module, class, and whether positions are stored as float32.
_WRITERS = {
    ".vtp": ("vtkIOXML", "vtkXMLPolyDataWriter", False),
    ".ply": ("vtkIOPLY", "vtkPLYWriter", True),
    ".stl": ("vtkIOGeometry", "vtkSTLWriter", True),
    ".obj": ("vtkIOGeometry", "vtkOBJWriter", False),
}
MESH_SUFFIXES = tuple(_WRITERS)


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
    model, support = _modules("vtkCommonDataModel"), _modules("util.numpy_support")
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
    model, support = _modules("vtkCommonDataModel"), _modules("util.numpy_support")
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
    model, support = _modules("vtkCommonDataModel"), _modules("util.numpy_support")
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


def write_mesh(
    path: str | os.PathLike[str], mesh: Isosurface, grid: Grid | None = None
) -> tuple[str, ...]:
    """Store a mesh in the format that the name ends in: .vtp, .ply, .stl or .obj.

    Needs the extra ``vtk``.  Normals are kept by all but .stl, curvatures by .vtp only.  A mesh
    without triangles is a valid file in every format.

    Parameters
    ----------
    path : str or path
    mesh : Isosurface
    grid : Grid
        Whose samples the field was made from: the file is then in its world coordinates, x first.
        By default it is in the coordinates of the field, that of axis 0 first.

    Returns
    -------
    tuple of str
        What is to be known about the file.

    Raises
    ------
    InputError
        For another ending, or a file that cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _WRITERS:
        raise InputError(f"{path}: the name must end in {', '.join(_WRITERS)}")
    module, name, single = _WRITERS[suffix]
    writer = getattr(_modules(module), name)()
    if hasattr(writer, "SetFileTypeToBinary"):
        writer.SetFileTypeToBinary()
    data = triangle_mesh(mesh, grid, single)
    notes: tuple[str, ...] = ()
    if single:
        notes = ("positions are rounded to 7 digits, as the format has float32",)
        gone = len(mesh.triangles) - data.GetNumberOfPolys()
        if gone:
            notes += (f"triangles left out, as this rounds their corners to one: {gone}",)
        # The writer of .ply leaves out float64 normals.
        support = _modules("util.numpy_support")
        normals = support.vtk_to_numpy(data.GetPointData().GetNormals()).astype(np.float32)
        data.GetPointData().SetNormals(support.numpy_to_vtk(normals, deep=True))
    _write(path, writer, data)
    return notes


def write_leaves(
    path: str | os.PathLike[str], adaptive: AdaptiveField, grid: Grid | None = None
) -> None:
    """Store the leaves of an adaptive field as a .vtu; `grid` as for `write_mesh`."""
    if not len(adaptive):
        raise InputError(f"{path}: every cell is missing, nothing to write")
    _write(path, _modules("vtkIOXML").vtkXMLUnstructuredGridWriter(), leaf_grid(adaptive, grid))


def _write(path: str | os.PathLike[str], writer: Any, data: Any) -> None:
    writer.SetInputData(data)
    with replacing(path) as partial:
        writer.SetFileName(os.fspath(partial))
        writer.Write()
        if writer.GetErrorCode() or not partial.stat().st_size:
            raise OSError(f"VTK could not write it, error {writer.GetErrorCode()}")


def _points(places: np.ndarray) -> Any:
    points = _modules("vtkCommonCore").vtkPoints()
    points.SetData(_modules("util.numpy_support").numpy_to_vtk(places, deep=True))
    return points


def _modules(name: str) -> Any:
    import importlib

    try:
        return importlib.import_module(f"vtkmodules.{name}")
    except ImportError as error:
        raise MissingPackageError("VTK is needed: pip install 'contourfair-jax[vtk]'") from error
