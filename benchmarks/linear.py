"""The usual way, by VTK: curved elements split into straight ones with linear fields, cut and drawn."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis import Dataset, Plane
from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.expansion import values
from elvis.scene.cameras.view import View

#: tetrahedra of one refinement: rows of the four vertices, then the midpoints 01 02 03 12 13 23
CHILDREN = np.array(
    [[0, 4, 5, 6], [4, 1, 7, 8], [5, 7, 2, 9], [6, 8, 9, 3], [4, 5, 6, 9], [4, 6, 8, 9], [4, 8, 7, 9], [4, 7, 5, 9]]
)
ENDS = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def refinement(level: int) -> tuple[Floats, Ints]:
    """Reference points (q, 3) in [-1, 1] and the 8^level tetrahedra (k, 4) between them that fill the reference one."""
    tetrahedra = np.vstack([np.zeros((1, 3), int), np.eye(3, dtype=int)])[None] << level
    for _ in range(level):
        middles = tetrahedra[:, ENDS].sum(axis=2) // 2
        tetrahedra = np.concatenate([tetrahedra, middles], axis=1)[:, CHILDREN].reshape(-1, 4, 3)
    points, cells = np.unique(tetrahedra.reshape(-1, 3), axis=0, return_inverse=True)
    return points * (2.0 / (1 << level)) - 1.0, cells.reshape(-1, 4)


class Pieces:
    """The tetrahedra of a dataset in 8^level linear pieces each; tables and coefficients are at hand beforehand."""

    def __init__(self, dataset: Dataset, field: str, level: int) -> None:
        points, self._cells = refinement(level)
        self._parts = [_tables(patch, points) for patch in patches(dataset, [field])]
        self.count = sum(len(modes) for *_, modes in self._parts) * len(self._cells)

    def grid(self, shift: float = 0.0) -> Any:
        """The pieces as a vtkUnstructuredGrid, with the values raised by ``shift``."""
        return self._grid(self._parts, shift)

    def grids(self, most: int = 1 << 22) -> Iterator[Any]:
        """The pieces as several grids of about ``most`` cells, where memory doesn't hold all of them at once."""
        step = max(1, most // len(self._cells))
        for table, field_table, places, modes in self._parts:
            for start in range(0, len(modes), step):
                rows = slice(start, start + step)
                yield self._grid([(table, field_table, places[rows], modes[rows])], 0.0)

    def _grid(self, parts: list[tuple[Floats, Floats, Floats, Floats]], shift: float) -> Any:
        points = _together([np.matmul(table, places).reshape(-1, 3) for table, _, places, _ in parts])
        scalars = _together([(modes @ table.T).reshape(-1) for _, table, _, modes in parts]) + shift
        each = len(parts[0][0])
        starts = np.arange(len(points) // each, dtype=np.int64) * each
        return unstructured(points, (starts[:, None, None] + self._cells).reshape(-1, 4), scalars)


def _tables(patch: Patch, points: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Tables of the modes of map and field at points, and the coefficients of both."""
    tables = [values(expansion, points) for expansion in (patch.geometry, patch.fields[0])]  # type: ignore[arg-type]
    places = np.ascontiguousarray(patch.geometry_coefficients.transpose(0, 2, 1))
    return tables[0], tables[1], places, patch.coefficients[0]  # type: ignore[return-value]


def _together(parts: list[Floats]) -> Floats:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def unstructured(points: Floats, cells: Ints, scalars: Floats) -> Any:
    """A vtkUnstructuredGrid of tetrahedra on the given arrays, which are not copied."""
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

    grid, positions, connectivity = vtk.vtkUnstructuredGrid(), vtk.vtkPoints(), vtk.vtkCellArray()
    positions.SetData(numpy_to_vtk(points))
    grid.SetPoints(positions)
    offsets = np.arange(0, cells.size + 1, 4, dtype=np.int64)
    connectivity.SetData(numpy_to_vtkIdTypeArray(offsets), numpy_to_vtkIdTypeArray(cells.reshape(-1)))
    grid.SetCells(vtk.VTK_TETRA, connectivity)
    array = numpy_to_vtk(scalars)
    array.SetName("u")
    grid.GetPointData().SetScalars(array)
    return grid


def section(grid: Any, plane: Plane) -> Any:
    """The triangles (vtkPolyData) in which a plane cuts a grid."""
    import vtk

    function, cutter = vtk.vtkPlane(), vtk.vtkPlaneCutter()
    function.SetOrigin(*plane.point)
    function.SetNormal(*plane.basis()[2])
    cutter.SetInputData(grid)
    cutter.SetPlane(function)
    cutter.ComputeNormalsOff()
    cutter.BuildTreeOff()
    cutter.BuildHierarchyOff()
    cutter.Update()
    return joined(cutter.GetOutputDataObject(0))


def joined(found: Any) -> Any:
    """One vtkPolyData of what a filter gave, in one or in several."""
    import vtk

    if isinstance(found, vtk.vtkPolyData):
        return found
    together = vtk.vtkAppendPolyData()
    for part in _leaves(found):
        together.AddInputData(part)
    together.Update()
    return together.GetOutput()


def _leaves(composite: Any) -> list[Any]:
    parts, iterator = [], composite.NewIterator()
    while not iterator.IsDoneWithTraversal():
        parts.append(iterator.GetCurrentDataObject())
        iterator.GoToNextItem()
    return parts


class Canvas:
    """An off-screen window with the camera of a view."""

    def __init__(self, view: View, low: float, high: float) -> None:
        import vtk

        self._size = (view.width, view.height)
        self._window, self._scene, self._mapper = vtk.vtkRenderWindow(), vtk.vtkRenderer(), vtk.vtkPolyDataMapper()
        self._window.SetOffScreenRendering(1)
        self._window.SetMultiSamples(0)
        self._window.SetSize(*self._size)
        self._window.AddRenderer(self._scene)
        self._scene.SetBackground(1, 1, 1)
        actor = vtk.vtkActor()
        actor.SetMapper(self._mapper)
        actor.GetProperty().LightingOff()
        self._scene.AddActor(actor)
        self._mapper.SetScalarRange(low, high)
        self._mapper.InterpolateScalarsBeforeMappingOn()
        _look(self._scene.GetActiveCamera(), view)

    def image(self, triangles: Any) -> NDArray[np.uint8]:
        """(height, width, 3) colours, read back."""
        import vtk
        from vtk.util.numpy_support import vtk_to_numpy

        width, height = self._size
        self._mapper.SetInputData(triangles)
        self._window.Render()
        pixels = vtk.vtkUnsignedCharArray()
        self._window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
        return np.asarray(vtk_to_numpy(pixels).reshape(height, width, 3)[::-1])


class Gauge(Canvas):
    """A canvas that shows numbers (32-bit floats) instead of colours: NaN where nothing is seen.

    Values must be at least ``least`` > 0, for the background is 0.
    """

    def __init__(self, view: View, least: float) -> None:
        super().__init__(view, 0, 1)
        import vtk

        self._least, self._pass = least, vtk.vtkValuePass()
        point_data = 3
        self._pass.SetInputArrayToProcess(point_data, "u")
        self._pass.SetInputComponentToProcess(0)
        collection, sequence, camera = vtk.vtkRenderPassCollection(), vtk.vtkSequencePass(), vtk.vtkCameraPass()
        collection.AddItem(self._pass)
        sequence.SetPasses(collection)
        camera.SetDelegatePass(sequence)
        self._scene.SetPass(camera)
        self._mapper.SetScalarModeToUsePointFieldData()
        self._mapper.SelectColorArray("u")

    def values(self, triangles: Any) -> Floats:
        """(height, width) values."""
        from vtk.util.numpy_support import vtk_to_numpy

        width, height = self._size
        self._mapper.SetInputData(triangles)
        self._window.Render()
        raw = vtk_to_numpy(self._pass.GetFloatImageDataArray(self._scene)).astype(np.float64)
        shown = raw.reshape(height, width, -1)[::-1, :, 0].copy()
        shown[shown < 0.5 * self._least] = np.nan
        return np.asarray(shown)


def _look(camera: Any, view: View) -> None:
    """The orthographic camera of a view."""
    assert view.camera.height is not None
    eye, at = np.array(view.camera.eye), np.array(view.camera.at)
    camera.ParallelProjectionOn()
    camera.SetParallelScale(0.5 * view.camera.height)
    camera.SetPosition(*eye)
    camera.SetFocalPoint(*at)
    camera.SetViewUp(*view.camera.basis()[1])
    camera.SetClippingRange(1e-3, 10 * float(np.linalg.norm(at - eye)))


def why_not() -> str | None:
    """Why VTK can't take part, in words; None where it can."""
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        import vtk
    except ImportError:
        return "VTK is not installed: pip install 'elvis-viz[benchmark]'"
    vtk.vtkObject.GlobalWarningDisplayOff()
    vtk.vtkSMPTools.SetBackend("STDThread")
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    if not window.SupportsOpenGL():
        return "VTK found no OpenGL: on Debian and Ubuntu install libegl1 and libgl1-mesa-dri"
    return None
