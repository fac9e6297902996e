"""The usual way, by VTK, for the scenes: surfaces of refined faces, marched isosurfaces, contours as polylines."""

from __future__ import annotations

from typing import Any

import linear
import numpy as np
from measuring import Timing, once

from elvis import CutSurface, Dataset, Faces, Isosurface, Plane, Shape
from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.expansion import values
from elvis.plugins.faces import native_faces
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Frame

STAGES = ("refine", "extract", "draw")
#: share of the range that one step of an 8-bit colour map spans, and pixels that an isosurface may be off
STEP, HALF = 1 / 256, 0.5


def lattice(level: int) -> tuple[Floats, Ints]:
    """Points (q, 2) of the reference triangle and the 4^level triangles (k, 3) between them that fill it."""
    n = 1 << level
    number = np.full((n + 2, n + 2), -1)
    places = [(i, j) for j in range(n + 1) for i in range(n + 1 - j)]
    for row, (i, j) in enumerate(places):
        number[i, j] = row
    lower = [(number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in places if i + j < n]
    upper = [(number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]) for i, j in places if i + j < n - 1]
    return np.array(places) * (2.0 / n) - 1.0, np.array(lower + upper)


class FacePieces:
    """Chosen faces of a dataset's tetrahedra in 4^level linear triangles each; tables are at hand beforehand.

    counts  of faces, by block and by face of the reference element
    """

    def __init__(self, dataset: Dataset, field: str, words: tuple[str, ...], level: int) -> None:
        points, self._cells = lattice(level)
        parts = patches(dataset, [field])
        faces = native_faces(dataset, [patch.element_ids for patch in parts])
        self._parts = []
        for block, rows in zip(faces.blocks, faces.select(words), strict=True):
            patch = parts[block.part]
            assert patch.shape is Shape.TETRAHEDRON
            for local, frame in enumerate(block.frames):
                chosen = block.element[rows[block.local[rows] == local]]
                where = frame[0] + points @ frame[1:]
                tables = values(patch.geometry, where), values(patch.fields[0], where)  # type: ignore[arg-type]
                places = np.ascontiguousarray(patch.geometry_coefficients[chosen].transpose(0, 2, 1))
                self._parts.append((*tables, places, patch.coefficients[0][chosen]))  # type: ignore[index]
        self.counts = [len(modes) for *_, modes in self._parts]
        self.count = sum(self.counts) * len(self._cells)

    def grid(self, shift: float = 0.0) -> Any:
        """The triangles as vtkPolyData, with the values raised by ``shift``."""
        import vtk
        from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

        points = np.concatenate([np.matmul(table, places).reshape(-1, 3) for table, _, places, _ in self._parts])
        scalars = np.concatenate([(modes @ table.T).reshape(-1) for _, table, _, modes in self._parts]) + shift
        each = self._parts[0][0].shape[0]
        starts = np.arange(len(points) // each, dtype=np.int64) * each
        cells = np.ascontiguousarray((starts[:, None, None] + self._cells).reshape(-1))
        surface, positions, triangles = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
        positions.SetData(numpy_to_vtk(points))
        offsets = np.arange(0, len(cells) + 1, 3, dtype=np.int64)
        triangles.SetData(numpy_to_vtkIdTypeArray(offsets), numpy_to_vtkIdTypeArray(cells))
        surface.SetPoints(positions)
        surface.SetPolys(triangles)
        array = numpy_to_vtk(scalars)
        array.SetName("u")
        surface.GetPointData().SetScalars(array)
        return surface


class Rival:
    """VTK's picture of a frame's scene after some refinements; the seconds of its stages are retained for every run."""

    def __init__(self, dataset: Dataset, frame: Frame, level: int) -> None:
        (self._item,), self._frame, self._level = frame.scene.every_object, frame, level
        if isinstance(self._item, Faces):
            self.pieces: Any = FacePieces(dataset, frame.scene.field, self._item.select, level)
        else:
            self.pieces = linear.Pieces(dataset, frame.scene.field, level)

        # all values are raised above 0, which is the background of `linear.Gauge`
        self._low, self._high = frame.range
        self._span = self._high - self._low
        self._shift = 3 * self._span - self._low
        self._canvas = Canvas(frame.view, self._low + self._shift, self._high + self._shift)
        self.stages = {stage: Timing() for stage in STAGES}
        self.first = once(self.picture)[1]
        self.errors = self._off_the_surface() if isinstance(self._item, Isosurface) else self._off_the_values()
        self._shown = None

    @property
    def dimension(self) -> int:
        """Of the pieces: triangles or tetrahedra."""
        return 2 if isinstance(self._item, Faces) else 3

    def picture(self) -> Any:
        """Refine, extract surfaces and contours, draw."""
        grid = self.stages["refine"].run(lambda: self.pieces.grid(self._shift))
        self._shown, lines = self.stages["extract"].run(lambda: self._extracted(grid))
        self._bytes = 1024 * grid.GetActualMemorySize()
        return self.stages["draw"].run(lambda: self._canvas.both(self._shown, lines))

    def _extracted(self, grid: Any) -> tuple[Any, Any]:
        triangles = self._surface(grid)
        asked = self._item.style.contours  # type: ignore[union-attr]
        if asked is None:
            return triangles, None
        marks = np.linspace(self._low, self._high, asked.count + 2)[1:-1]
        return triangles, contours(triangles, marks + self._shift)

    def _surface(self, grid: Any) -> Any:
        if isinstance(self._item, Faces):
            return grid
        if isinstance(self._item, CutSurface):
            assert isinstance(self._item.surface, Plane)
            return linear.section(grid, self._item.surface)
        return marched(grid, self._item.values[0] + self._shift)  # type: ignore[union-attr]

    def record(self, timing: Timing) -> dict[str, Any]:
        """Its numbers next to the exact frame."""
        stages = {stage: taken.record() for stage, taken in self.stages.items()}
        own = {"refinements": self._level, "pieces": self.pieces.count, "bytes": self._bytes, "stages": stages}
        return {**own, **timing.record(), **self.errors}

    def _off_the_values(self) -> dict[str, float]:
        """Pixels off by a colour, and those seen by one side only, as shares of those that are seen."""
        frame = self._frame
        shown = linear.Gauge(frame.view, self._span).values(self._shown) - self._shift
        both = np.isfinite(shown) & frame.seen
        error = np.abs(shown - frame.field)[both] / self._span
        missed = float((np.isfinite(shown) != frame.seen).sum() / frame.seen.sum())
        return {"wrong": float((error > STEP).mean()), "greatest": float(error.max()), "missed": missed}

    def _off_the_surface(self) -> dict[str, float]:
        """Pixels where the surface is off by more than half a pixel, or seen by one side only, of those seen by any."""
        frame, depths = self._frame, self._canvas.depths(self._shown)
        both = np.isfinite(depths) & frame.seen
        height = frame.view.camera.height / frame.view.height  # type: ignore[operator]
        slope = np.abs(frame.normal @ frame.view.camera.basis()[2])
        off = np.abs(depths[both] - frame.depth[both]) * slope[both] / height
        any_sees = (np.isfinite(depths) | frame.seen).sum()
        missed = any_sees - both.sum()
        return {"wrong": float(((off > HALF).sum() + missed) / any_sees), "missed": float(missed / any_sees)}


class Canvas(linear.Canvas):
    """A canvas with lines over its triangles, whose depths can be read."""

    def __init__(self, view: View, low: float, high: float) -> None:
        super().__init__(view, low, high)
        import vtk

        self._lines = vtk.vtkPolyDataMapper()
        self._lines.ScalarVisibilityOff()
        self._lines.SetResolveCoincidentTopologyToPolygonOffset()
        actor = vtk.vtkActor()
        actor.SetMapper(self._lines)
        actor.GetProperty().SetColor(0, 0, 0)
        actor.GetProperty().LightingOff()
        self._actor = actor
        self._eye, at = np.array(view.camera.eye), np.array(view.camera.at)
        distance = float(np.linalg.norm(at - self._eye))
        self._near, self._far = 1e-3 * distance, 3.0 * distance
        self._scene.GetActiveCamera().SetClippingRange(self._near, self._far)

    def both(self, triangles: Any, lines: Any) -> Any:
        """(height, width, 3) colours, read back."""
        if lines is not None:
            self._lines.SetInputData(lines)
            self._scene.AddActor(self._actor)
        return self.image(triangles)

    def depths(self, triangles: Any) -> Floats:
        """(height, width) depths along the view; infinite where nothing is seen."""
        import vtk
        from vtk.util.numpy_support import vtk_to_numpy

        self.image(triangles)
        width, height = self._size
        buffer = vtk.vtkFloatArray()
        self._window.GetZbufferData(0, 0, width - 1, height - 1, buffer)
        z = vtk_to_numpy(buffer).astype(np.float64).reshape(height, width)[::-1]
        return np.where(z < 1.0, self._near + z * (self._far - self._near), np.inf)


def marched(grid: Any, value: float) -> Any:
    """The triangles of an isosurface of linear tetrahedra, by all cores."""
    import vtk

    march = vtk.vtkContour3DLinearGrid()
    march.SetInputData(grid)
    march.SetValue(0, value)
    march.SetMergePoints(False)
    march.SetComputeNormals(False)
    march.Update()
    return linear.joined(march.GetOutputDataObject(0))


def contours(triangles: Any, marks: Floats) -> Any:
    """Lines of equal value on triangles."""
    import vtk

    lines = vtk.vtkContourFilter()
    lines.SetInputData(triangles)
    for number, mark in enumerate(marks):
        lines.SetValue(number, float(mark))
    lines.Update()
    return lines.GetOutput()
