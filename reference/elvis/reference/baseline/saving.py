"""Linear meshes as files: surfaces as PLY and GLB, volumes and surfaces as VTU."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.files.output import replacing
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.extras import comparison_module

#: formats, and what each holds: corners of its simplices
FORMATS = {"ply": (3,), "glb": (3,), "vtu": (3, 4)}


def save_mesh(mesh: LinearMesh, path: Path) -> None:
    """Write a mesh in the format of the suffix, with its values at the corners where the format has a place for them.

    PLY and GLB hold surfaces in single precision, VTU surfaces and tetrahedra in double precision, with element ids.
    Raises ElvisError for another suffix, or for tetrahedra in a format of surfaces.
    """
    kinds = FORMATS.get(path.suffix.lower().removeprefix("."))
    if kinds is None:
        raise ElvisError(f"{path}: expected a name that ends in .{', .'.join(FORMATS)}, found {path.suffix or 'none'}")
    if mesh.simplices.shape[1] not in kinds:
        raise ElvisError(f"{path}: expected a surface, found tetrahedra, which need a .vtu file")
    with replacing(path) as temporary:
        (_save_vtu if path.suffix.lower() == ".vtu" else _save_surface)(mesh, temporary)


def _save_surface(mesh: LinearMesh, path: Path) -> None:
    """A surface through trimesh."""
    made = comparison_module("trimesh").Trimesh(mesh.points, mesh.simplices, process=False)
    for name, values in mesh.values.items():
        made.vertex_attributes["".join(letter if letter.isalnum() else "_" for letter in name)] = values.astype(
            np.float32
        )
    path.write_bytes(made.export(file_type=path.suffix.lower().removeprefix(".")))


def unstructured_grid(mesh: LinearMesh, extra: str = "compare") -> Any:
    """A linear mesh as VTK's unstructured grid, without values; ``extra`` brings VTK."""
    numpy_support = comparison_module("vtkmodules.util.numpy_support", extra)
    core = comparison_module("vtkmodules.vtkCommonCore", extra)
    model = comparison_module("vtkmodules.vtkCommonDataModel", extra)
    points, cells, grid = core.vtkPoints(), model.vtkCellArray(), model.vtkUnstructuredGrid()
    points.SetData(numpy_support.numpy_to_vtk(mesh.points, deep=True))
    corners = mesh.simplices.shape[1]
    ends = np.arange(0, mesh.simplices.size + 1, corners, dtype=np.int64)
    flat = mesh.simplices.astype(np.int64).ravel()
    cells.SetData(*(numpy_support.numpy_to_vtkIdTypeArray(array, deep=True) for array in (ends, flat)))
    grid.SetPoints(points)
    grid.SetCells(model.VTK_TRIANGLE if corners == 3 else model.VTK_TETRA, cells)
    return grid


def _save_vtu(mesh: LinearMesh, path: Path) -> None:
    """Any mesh through VTK."""
    grid = unstructured_grid(mesh, "converters")
    numpy_support = comparison_module("vtkmodules.util.numpy_support", "converters")
    for data, name, values in (
        *((grid.GetPointData(), name, values) for name, values in mesh.values.items()),
        (grid.GetCellData(), "element", mesh.element),
    ):
        array = numpy_support.numpy_to_vtk(values, deep=True)
        array.SetName(name)
        data.AddArray(array)
    writer = comparison_module("vtkmodules.vtkIOXML", "converters").vtkXMLUnstructuredGridWriter()
    # to memory, since the library reports a full disk in its own way
    writer.WriteToOutputStringOn()
    writer.SetInputData(grid)
    if not writer.Write():
        raise ElvisError(f"{path}: cannot be written: VTK fails to make the file")
    path.write_text(writer.GetOutputString(), encoding="utf-8")
