"""The baseline as VTK draws it: Lagrange cells of the data's own order, through VTK's own filters.

VTK cuts and contours such cells through a fixed lattice of linear pieces at their nodes, and draws faces after one
nonlinear subdivision, the default of ParaView.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.terminal import plain_names
from elvis.core.data.dataset import Dataset
from elvis.plugins.conversion.exporting import exporter
from elvis.reference.baseline.linear_drawing import surfaces_of
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.baseline.tracing import Tracer
from elvis.reference.composing import record
from elvis.reference.extras import comparison_module
from elvis.reference.record import Record
from elvis.scene import CutSurface, Cylinder, Faces, Isosurface, Plane, Scene, SceneObject, Sphere, Surface
from elvis.scene.cameras.view import View

#: ParaView's default level for curved faces
_SUBDIVISION = 1


class VtkBaseline:
    """A dataset as VTK holds it, and the seconds that it took."""

    def __init__(self, dataset: Dataset, names: Sequence[str]) -> None:
        """Raises ElvisError where VTK is missing, or has no cells for the data."""
        comparison_module("vtkmodules.vtkIOXML", "converters")
        start = perf_counter()
        with TemporaryDirectory() as folder:
            path = Path(folder) / "cells.vtu"
            exporter("vtu")(replace(dataset, time=None), names, None, path, report=len)
            reader = comparison_module("vtkmodules.vtkIOXML").vtkXMLUnstructuredGridReader()
            reader.SetFileName(str(path))
            reader.Update()
            self.grid = reader.GetOutput()
        self.is_flat = dataset.mesh.dimension == 2
        #: names of quantities, and of their arrays, without control characters
        self.arrays = dict(zip(names, plain_names(names), strict=True))
        self.seconds = {"mesh": perf_counter() - start}

    @property
    def counts(self) -> dict[str, int]:
        """Cells, points and bytes."""
        return {
            "simplices": self.grid.GetNumberOfCells(),
            "points": self.grid.GetNumberOfPoints(),
            "bytes": 1024 * self.grid.GetActualMemorySize(),
        }

    def draw(self, scene: Scene, view: View, ends: tuple[float, float]) -> Record:
        """The picture of a scene; raises ElvisError for objects that aren't drawn this way."""
        start, surfaces = perf_counter(), []
        for shown in scene.every_object:
            surfaces += surfaces_of(Tracer(self.triangles(shown, scene.field)), shown, scene, view, ends)
        picture = record(surfaces, scene, view, ends)
        self.seconds["draw"] = perf_counter() - start
        return picture

    def triangles(self, shown: SceneObject, field: str) -> LinearMesh:
        """An object as VTK makes it."""
        if self.is_flat and isinstance(shown, CutSurface | Faces):
            # 2D cells show themselves: a cutter finds nothing in their own plane
            made = comparison_module("vtkmodules.vtkFiltersGeometry").vtkDataSetSurfaceFilter()
            made.SetNonlinearSubdivisionLevel(_SUBDIVISION)
            return self._triangles_of(made, self.grid)
        match shown:
            case CutSurface(surface=surface):
                made = comparison_module("vtkmodules.vtkFiltersCore").vtkCutter()
                made.SetCutFunction(_function(surface))
            case Isosurface(values=values, quantity=quantity):
                made = comparison_module("vtkmodules.vtkFiltersCore").vtkContourFilter()
                made.SetInputArrayToProcess(0, 0, 0, 0, self.arrays[quantity or field])
                for number, value in enumerate(values):
                    made.SetValue(number, value)
            case Faces(select=("all",)):
                made = comparison_module("vtkmodules.vtkFiltersGeometry").vtkDataSetSurfaceFilter()
                made.SetNonlinearSubdivisionLevel(_SUBDIVISION)
                return self._triangles_of(made, self._merge())
            case _:
                raise ElvisError(
                    "the VTK baseline only draws planes, spheres, cylinders, isosurfaces and all outer faces"
                )
        return self._triangles_of(made, self.grid)

    def _merge(self) -> Any:
        """The grid with equal points made one, so that inner faces are known to be inner."""
        cleaner = comparison_module("vtkmodules.vtkFiltersCore").vtkStaticCleanUnstructuredGrid()
        cleaner.ToleranceIsAbsoluteOff()
        cleaner.SetTolerance(1e-9)
        cleaner.SetInputData(self.grid)
        cleaner.Update()
        return cleaner.GetOutput()

    def _triangles_of(self, made: Any, grid: Any) -> LinearMesh:
        """The triangles that a filter makes of a grid."""
        numpy_support = comparison_module("vtkmodules.util.numpy_support")
        triangles = comparison_module("vtkmodules.vtkFiltersCore").vtkTriangleFilter()
        made.SetInputData(grid)
        triangles.SetInputConnection(made.GetOutputPort())
        triangles.PassLinesOff()
        triangles.PassVertsOff()
        triangles.Update()
        found = triangles.GetOutput()
        if not found.GetNumberOfPolys():
            return _nothing(tuple(self.arrays))

        def column(data: Any, name: str) -> Any:
            return numpy_support.vtk_to_numpy(data.GetArray(name))

        points = numpy_support.vtk_to_numpy(found.GetPoints().GetData()).astype(np.float64)
        corners = numpy_support.vtk_to_numpy(found.GetPolys().GetConnectivityArray()).reshape(-1, 3)
        points_data = found.GetPointData()
        values = {name: column(points_data, array).astype(np.float64) for name, array in self.arrays.items()}
        element = column(found.GetCellData(), "element").astype(np.int64)
        return LinearMesh(points, values, np.full_like(points, np.nan), corners.astype(np.int32), element)


def _nothing(names: Sequence[str]) -> LinearMesh:
    """No triangles."""
    none: Floats = np.empty((0, 3))
    return LinearMesh(
        none, {name: np.empty(0) for name in names}, none, np.empty((0, 3), np.int32), np.empty(0, np.int64)
    )


def _function(surface: Surface) -> Any:
    """A surface as one of VTK's implicit functions."""
    functions = comparison_module("vtkmodules.vtkCommonDataModel")
    match surface:
        case Plane(point=point, normal=normal):
            made = functions.vtkPlane()
            made.SetOrigin(point)
            made.SetNormal(normal)
        case Sphere(center=center, radius=radius):
            made = functions.vtkSphere()
            made.SetCenter(center)
            made.SetRadius(radius)
        case Cylinder(point=point, axis=axis, radius=radius):
            made = functions.vtkCylinder()
            made.SetCenter(point)
            made.SetAxis(axis)
            made.SetRadius(radius)
        case _:
            raise ElvisError(f"the VTK baseline does not draw a {type(surface).__name__}")
    return made
