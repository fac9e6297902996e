"""Worker for VTK's library in a separate process: unstructured grids as numbers, texts and arrays."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from elvis.converters.vtk.times import TIMES
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError

#: arrays of the library's own, and those with a meaning of their own
_DEGREES, _WEIGHTS, _GHOSTS = "HigherOrderDegrees", "RationalWeights", "vtkGhostType"
#: the name of the ghosts before version 6.3: cells of other parts have a level from 1 up
_LEVELS = "vtkGhostLevels"

#: bits of a ghost cell: it is another part's, or it is hidden
_DUPLICATE, _HIDDEN = 1, 32


#: number of cells of a file that are compared with cells of another one
_SAMPLED = 200
#: the centre of a cell lies in another one if it is nearer to it than this share of the cell's radius
_NEAR = 0.1


class Library:
    """The library, which reads files."""

    def __init__(self) -> None:
        from vtkmodules import vtkIOHDF, vtkIOLegacy, vtkIOXML

        self._readers: dict[str, Any] = {
            "legacy": vtkIOLegacy.vtkUnstructuredGridReader,
            "grid": vtkIOXML.vtkXMLUnstructuredGridReader,
            "parts": vtkIOXML.vtkXMLPUnstructuredGridReader,
            "blocks": vtkIOXML.vtkXMLMultiBlockDataReader,
            "hdf": vtkIOHDF.vtkHDFReader,
        }

    def grids(self, path: str, kind: str) -> list[dict[str, Any]]:
        """The data of an `elvis.converters.vtk.files.Grid`, for each grid in a file and in the files that it names.

        Raises FormatError with the library's first complaint, and if cells have missing points.
        """
        return [_grid(path, name, each) for name, each in self._grids(path, kind)]

    def overlap(self, path: str, kind: str, other: str, other_kind: str) -> float:
        """The share of the cells in a file whose centres lie in the cells of another file; copies don't count."""
        near = total = 0
        own = [each for _, each in self._grids(path, kind)]
        others = [each for _, each in self._grids(other, other_kind)]
        for each in (*own, *others):
            each.RemoveGhostCells()
        others = [each for each in others if each.GetNumberOfCells()]
        for each in own:
            centres, radii = _centres(each)
            is_near = np.zeros(len(centres), bool)
            for grid in others:
                is_near |= _distances(grid, centres) <= _NEAR * radii
            near += int(is_near.sum())
            total += len(centres)
        return near / max(total, 1)

    def arrays(self, path: str, kind: str) -> list[str]:
        """The names of the arrays at points and on cells in a file."""
        names: set[str] = set()
        for _, each in self._grids(path, kind):
            grid = _grid(path, "", each)
            names |= {*grid["point_data"], *grid["cell_data"]}
        return sorted(names)

    def _grids(self, path: str, kind: str) -> list[tuple[str, Any]]:
        """The grids in a file and in the files that it names, with the names of blocks."""
        found = list(_leaves(self._read(path, kind), ""))
        for _, grid in found:
            _name_ghosts(grid.GetCellData())
        return found

    def _read(self, path: str, kind: str) -> Any:
        """The library's data from a file; raises FormatError with its first complaint."""
        reader = self._readers[kind]()
        if kind == "legacy":
            reader.ReadAllScalarsOn()
            reader.ReadAllVectorsOn()
            reader.ReadAllTensorsOn()
            reader.ReadAllFieldsOn()
        reader.SetFileName(path)
        with _refusing(path):
            reader.Update()
        return reader.GetOutputDataObject(0)


def _name_ghosts(cells: Any) -> None:
    """Let an old array of levels be one of the present type."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    levels = cells.GetArray(_LEVELS)
    if levels is not None:
        is_copy = (vtk_to_numpy(levels).reshape(-1) > 0).astype(np.uint8)
        ghosts = numpy_to_vtk(is_copy * _DUPLICATE, deep=True)
        ghosts.SetName(_GHOSTS)
        cells.RemoveArray(_LEVELS)
        cells.AddArray(ghosts)


def _centres(grid: Any) -> tuple[Floats, Floats]:
    """The means (n, 3) of the nodes of some cells, and half the diameters (n,) of the boxes around these."""
    count = grid.GetNumberOfCells()
    centres, radii = [], []
    for i in np.unique(np.linspace(0, count - 1, _SAMPLED).astype(int)).tolist() if count else ():
        points = grid.GetCell(i).GetPoints()
        nodes = np.array([points.GetPoint(k) for k in range(points.GetNumberOfPoints())])
        centres.append(nodes.mean(axis=0))
        radii.append(np.linalg.norm(np.ptp(nodes, axis=0)) / 2)
    return np.array(centres).reshape(-1, 3), np.array(radii)


def _distances(grid: Any, places: Floats) -> Floats:
    """(n,) of places (n, 3) from the cells of a grid, curved ones taken by linear pieces."""
    from vtkmodules.vtkCommonCore import mutable
    from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator

    locator: Any = vtkStaticCellLocator()
    locator.SetDataSet(grid)
    locator.BuildLocator()
    found = np.empty(len(places))
    for i, place in enumerate(places.tolist()):
        closest, cell, part = [0.0] * 3, mutable(0), mutable(0)
        square: Any = mutable(0.0)
        locator.FindClosestPoint(place, closest, cell, part, square)
        found[i] = float(square) ** 0.5
    return found


@contextmanager
def _refusing(path: str) -> Iterator[None]:
    """Raise FormatError with the first complaint of the library, which would print them all."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    complaints = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(complaints)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    yield
    found = re.search(r"(?s)ERROR: In [^\n]*\n(?:\w+ \([^)]*\): )?(.*?)(?:\n\n|$)", complaints.GetOutput())
    if found is not None:
        complaint = re.sub(r"(?s) for request:.*|vtk\w+ \(0x[0-9a-f]+\): ", "", found[1])
        reason = " ".join(complaint.split())
        raise FormatError(f"expected a complete VTK file, found: {reason}", file=path)


def _leaves(data: Any, name: str) -> Iterator[tuple[str, Any]]:
    """The unstructured grids in a tree of blocks, with their names."""
    if data is None:
        return
    if data.IsA("vtkUnstructuredGrid"):
        yield name, data
    elif data.IsA("vtkMultiBlockDataSet"):
        for i in range(data.GetNumberOfBlocks()):
            has_name = data.HasMetaData(i) and data.GetMetaData(i).Has(data.NAME())
            yield from _leaves(data.GetBlock(i), data.GetMetaData(i).Get(data.NAME()) if has_name else name)
    elif data.IsA("vtkPartitionedDataSetCollection"):
        for i in range(data.GetNumberOfPartitionedDataSets()):
            yield from _leaves(data.GetPartitionedDataSet(i), name)
    elif data.IsA("vtkPartitionedDataSet"):
        for i in range(data.GetNumberOfPartitions()):
            yield from _leaves(data.GetPartition(i), name)
    elif data.IsA("vtkMultiPieceDataSet"):
        for i in range(data.GetNumberOfPieces()):
            yield from _leaves(data.GetPiece(i), name)


def _grid(path: str, name: str, data: Any) -> dict[str, Any]:
    """The arrays of a grid of the library."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    cells, count = data.GetCells(), data.GetNumberOfCells()
    points = np.zeros((0, 3)) if data.GetPoints() is None else vtk_to_numpy(data.GetPoints().GetData())
    types, offsets, nodes = np.zeros(0, np.int64), np.zeros(1, np.int64), np.zeros(0, np.int64)
    if count:
        types = _integers(data.GetCellTypes() if _is_recent() else data.GetCellTypesArray())
        offsets, nodes = _integers(cells.GetOffsetsArray()), _integers(cells.GetConnectivityArray())
    if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(points):
        found = f"{nodes.min()} to {nodes.max()}"
        raise FormatError(f"expected points 0 to {len(points) - 1} in cells, found {found}", file=path)
    on_points, on_cells = _arrays(data.GetPointData(), len(points)), _arrays(data.GetCellData(), count)
    for own in (on_points, on_cells):
        own.pop("vtkOriginalPointIds", None)
        own.pop("vtkOriginalCellIds", None)
    ghosts = on_cells.pop(_GHOSTS, np.zeros((count, 1)))
    degrees = on_cells.pop(_marked(data.GetCellData().GetHigherOrderDegrees(), _DEGREES), None)
    weights = on_points.pop(_marked(data.GetPointData().GetRationalWeights(), _WEIGHTS), None)
    on_points.pop(_GHOSTS, None)
    return {
        "name": name,
        "points": points,
        "types": types,
        "nodes": nodes,
        "offsets": offsets,
        "ghosts": ghosts[:, 0].astype(np.int64) & (_DUPLICATE | _HIDDEN),
        "degrees": None if degrees is None else degrees.astype(np.int64),
        "weights": None if weights is None else weights[:, 0].astype(np.float64),
        "point_data": on_points,
        "cell_data": on_cells,
        "time": _time(data.GetFieldData()),
    }


def _is_recent() -> bool:
    """Whether grids give the types of their cells as an array that may be a rule."""
    from vtkmodules.vtkCommonCore import vtkVersion

    return (vtkVersion.GetVTKMajorVersion(), vtkVersion.GetVTKMinorVersion()) >= (9, 6)


def _integers(array: Any) -> Ints:
    """(n,) the numbers of an array, also of one that is a rule."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkIdTypeArray

    plain = vtkIdTypeArray()
    plain.DeepCopy(array)
    return np.asarray(vtk_to_numpy(plain), np.int64)


def _arrays(data: Any, count: int) -> dict[str, Floats]:
    """(n, k) by name, without numberings of points and cells and without text."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    numbering = [each.GetName() for each in (data.GetGlobalIds(), data.GetPedigreeIds()) if each is not None]
    found: dict[str, Floats] = {}
    for i in range(data.GetNumberOfArrays()):
        array = data.GetArray(i)
        if array is None or array.GetName() in numbering or array.GetNumberOfTuples() != count:
            continue
        values = vtk_to_numpy(array)
        found[array.GetName() or f"array{i}"] = values.reshape(len(values), -1)
    return found


def _time(data: Any) -> float | None:
    for name in TIMES:
        array = data.GetArray(name)
        if array is not None and array.GetNumberOfTuples():
            return float(array.GetTuple1(0))
    return None


def _marked(array: Any, usual: str) -> str:
    """The name of the array that a file marks for a purpose; the usual one where it marks none."""
    return usual if array is None else str(array.GetName())
