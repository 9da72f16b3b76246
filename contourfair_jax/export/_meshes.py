"""Isosurfaces and leaves as files of meshes; needs the extra ``vtk``."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from .._grid.grid import Grid
from .._support.errors import InputError
from .._vtk import leaf_grid, triangle_mesh, vtk_module
from ..io import replacing
from ..io._outputs import known_suffix

if TYPE_CHECKING:
    from ..adaptive import AdaptiveField
    from ..isosurface import Isosurface


# Writers by ending: module, class, and whether positions are stored as float32.
_WRITERS = {
    ".vtp": ("vtkIOXML", "vtkXMLPolyDataWriter", False),
    ".ply": ("vtkIOPLY", "vtkPLYWriter", True),
    ".stl": ("vtkIOGeometry", "vtkSTLWriter", True),
    ".obj": ("vtkIOGeometry", "vtkOBJWriter", False),
}

MESH_SUFFIXES = tuple(_WRITERS)


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
    module, name, single = _WRITERS[known_suffix(path, _WRITERS)]
    writer = getattr(vtk_module(module), name)()
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
        support = vtk_module("util.numpy_support")
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
    _write(path, vtk_module("vtkIOXML").vtkXMLUnstructuredGridWriter(), leaf_grid(adaptive, grid))


def _write(path: str | os.PathLike[str], writer: Any, data: Any) -> None:
    writer.SetInputData(data)
    with replacing(path) as partial:
        writer.SetFileName(os.fspath(partial))
        writer.Write()
        if writer.GetErrorCode() or not partial.stat().st_size:
            raise OSError(f"VTK could not write it, error {writer.GetErrorCode()}")
