"""Files of VTK, read by the library into arrays: unstructured grids, their parts, collections of them over time."""

from __future__ import annotations

import mmap
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.trial import attempt
from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.core.files.plain import DEFLATE_RATIO, check_plain, content, leading
from elvis.plugins.recognition import found_instead

#: how much of a file tells what it is
_START = 4096

_KINDS = {
    b"UnstructuredGrid": "grid",
    b"PUnstructuredGrid": "parts",
    b"vtkMultiBlockDataSet": "blocks",
    b"Collection": "series",
}

_UNSTRUCTURED = "save an unstructured grid (.vtu), in ParaView by the filter Append Datasets"

#: what other kinds of its data sets hold, and what to do
_OTHERS = {
    b"POLYDATA": "a surface of polygons (PolyData) without a volume: save the volume as an unstructured grid (.vtu)",
    b"STRUCTUREDGRID": f"a structured grid of linear cells: {_UNSTRUCTURED}",
    b"RECTILINEARGRID": f"a rectilinear grid of linear cells: {_UNSTRUCTURED}",
    b"IMAGEDATA": f"an image of points on a lattice (ImageData): {_UNSTRUCTURED}",
    b"STRUCTUREDPOINTS": f"an image of points on a lattice (StructuredPoints): {_UNSTRUCTURED}",
    b"HYPERTREEGRID": f"a hyper tree grid: {_UNSTRUCTURED}",
    b"TABLE": "a table of values without cells: give the grid",
    b"FIELD": "arrays without cells: give the grid",
}

#: what XML declares a number of
_COUNT = re.compile(rb"""\b(NumberOf\w+)\s*=\s*["']\s*(\d{1,400})""")

_TRIAL = """
from pathlib import Path
from vtkmodules import vtkIOLegacy, vtkIOXML
from elvis.converters.vtk_files import kind_of, read_one
from elvis.core.errors import FormatError
bound()
for name in sys.argv[1:]:
    with suppress(FormatError):
        read_one(Path(name))
os._exit(0)
"""

#: arrays of the library's own, and those with a meaning of their own
_DEGREES, _WEIGHTS, _GHOSTS = "HigherOrderDegrees", "RationalWeights", "vtkGhostType"
_TIMES = ("TimeValue", "TIME", "time", "Time")

#: bits of a ghost cell: it is another part's, or it is hidden
_DUPLICATE, _HIDDEN = 1, 32


@dataclass(eq=False)
class Grid:
    """An unstructured grid.

    name         of the block that it is
    points       (n, 3)
    types        (m,) of the cells, their nodes are nodes[offsets[i]:offsets[i + 1]]
    ghosts       (m,) whether a cell belongs to another part
    degrees      (m, 3) or None; weights (n,) or None
    point_data, cell_data   (n, k) and (m, k) by name
    """

    file: str
    name: str
    points: Floats
    types: Ints
    nodes: Ints
    offsets: Ints
    ghosts: Ints
    degrees: Ints | None = None
    weights: Floats | None = None
    point_data: dict[str, Floats] = field(default_factory=dict)
    cell_data: dict[str, Floats] = field(default_factory=dict)
    time: float | None = None


def kind_of(path: Path) -> str:
    """``legacy``, ``grid``, ``parts``, ``blocks`` or ``series``, told by the first bytes; empty for other files."""
    start = leading(path, _START)
    if start.startswith(b"# vtk DataFile"):
        return "legacy" if re.search(rb"(?i)DATASET\s+UNSTRUCTURED_GRID", start) else ""
    found = re.search(rb"<VTKFile[^>]*?\btype\s*=\s*[\"'](\w+)[\"']", start)
    return _KINDS.get(found[1], "") if found else ""


def other_kind(path: Path) -> str:
    """What a file of VTK's holds that is no unstructured grid, and what to do; empty for files of others."""
    start = leading(path, _START)
    found = re.search(rb"<VTKFile[^>]*?\btype\s*=\s*[\"'](\w+)[\"']", start)
    if found is None and start.startswith(b"# vtk DataFile"):
        found = re.search(rb"(?im)^\s*(?:DATASET\s+)?(\w+)", start.split(b"\n", 3)[-1])
    if found is None:
        return ""
    kind = found[1].upper().replace(b"_", b"").removeprefix(b"VTK")
    words = _OTHERS.get(kind) or _OTHERS.get(kind.removeprefix(b"P"))
    return words or f"VTK data of the kind {found[1].decode('ascii', 'replace')}: {_UNSTRUCTURED}"


def read(paths: Sequence[Path], step: int = -1) -> list[Grid]:
    """The grids of all files; of a series those of one step."""
    files: list[tuple[Path, float | None]] = []
    for path in paths:
        if not kind_of(path):
            other = other_kind(path) or found_instead(path)
            raise FormatError(f"expected an unstructured grid of VTK, found {other}", file=path)
        if kind_of(path) == "series":
            time, members = _members(path, step)
            files += [(member, time) for member in members]
        else:
            files.append((path, None))
    _try([path for path, _ in files])
    grids: list[Grid] = []
    for path, when in files:
        found = read_one(path)
        for grid in found:
            grid.time = grid.time if when is None else when
        grids += found
    return grids


def _try(paths: Sequence[Path]) -> None:
    """FormatError where the library dies of files, or takes too long; what it says of others comes with reading."""
    every, left = dict.fromkeys(paths), list(paths)
    while left:
        found = [piece for piece in _pieces(left.pop()) if piece not in every]
        every.update(dict.fromkeys(found))
        left += found
    size = sum(path.stat().st_size for path in every)
    for path in every:
        _check_counts(path, size)
    outcome = attempt(_TRIAL, paths, size)
    if outcome.status:
        names = ", ".join(path.name for path in paths[1:])
        among = f" (or among {names})" if names else ""
        raise FormatError(f"expected a whole VTK file, found {outcome.reason}{among}", file=paths[0])


def _check_counts(path: Path, size: int) -> None:
    """FormatError where XML declares more of something than ``size`` bytes of all files hold, even packed."""
    if kind_of(path) == "legacy":
        return
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as raw:
        end = raw.find(b"<AppendedData")
        for found in _COUNT.finditer(raw, 0, end if end >= 0 else len(raw)):
            if int(found[2]) > size * DEFLATE_RATIO:
                expected = f"at most {size * DEFLATE_RATIO}, as {size} bytes hold"
                place = found[1].decode("ascii")
                raise FormatError(f"expected {expected}, found {int(found[2])}", file=path, place=place)


def _pieces(path: Path) -> list[Path]:
    """The files that one of parts or blocks names; FormatError where one of these is no plain file."""
    if kind_of(path) not in ("parts", "blocks"):
        return []
    names = re.findall(rb"""\b(?:Source|file)\s*=\s*["']([^"'\0]*)["']""", content(path))
    found = [path.parent / name.decode("utf-8", "replace") for name in names]
    for each in found:
        if each.exists():
            check_plain(each)
    return [each for each in found if each.is_file()]


def _members(path: Path, step: int) -> tuple[float, list[Path]]:
    """Time and files of one step of a series."""
    from xml.etree import ElementTree

    try:
        entries = [entry.attrib for entry in ElementTree.parse(path).iter("DataSet")]
        times = sorted({float(entry.get("timestep", 0)) for entry in entries})
        time = times[step]
        names = [entry["file"] for entry in entries if float(entry.get("timestep", 0)) == time]
    except IndexError:
        raise FormatError(f"expected a step {step}, found {len(times)} steps", file=path) from None
    except (ElementTree.ParseError, ValueError, KeyError) as error:
        raise FormatError(f"expected a list of files with their times, found: {error}", file=path) from None
    members = [path.parent / name for name in names]
    for member in members:
        if not kind_of(member):
            raise FormatError(f"expected a VTK file {member.name} beside it, found none", file=path)
    return time, members


def read_one(path: Path) -> list[Grid]:
    """The grids of a file, or of the files that it names; FormatError with the first complaint of the library."""
    from vtkmodules import vtkIOLegacy, vtkIOXML

    reader: Any = {
        "legacy": vtkIOLegacy.vtkUnstructuredGridReader,
        "grid": vtkIOXML.vtkXMLUnstructuredGridReader,
        "parts": vtkIOXML.vtkXMLPUnstructuredGridReader,
        "blocks": vtkIOXML.vtkXMLMultiBlockDataReader,
    }[kind_of(path)]()
    if kind_of(path) == "legacy":
        reader.ReadAllScalarsOn()
        reader.ReadAllVectorsOn()
        reader.ReadAllTensorsOn()
        reader.ReadAllFieldsOn()
    reader.SetFileName(str(path))
    with _refusing(path):
        reader.Update()
    return [_grid(path, name, each) for name, each in _leaves(reader.GetOutputDataObject(0), "")]


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """FormatError with the first complaint of the library, which would print them all."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    before, ours, verbosity = (
        vtkOutputWindow.GetInstance(),
        vtkStringOutputWindow(),
        vtkLogger.GetCurrentVerbosityCutoff(),
    )
    vtkOutputWindow.SetInstance(ours)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkOutputWindow.SetInstance(before)
        vtkLogger.SetStderrVerbosity(vtkLogger.ConvertToVerbosity(verbosity))
    found = re.search(r"(?s)ERROR: In [^\n]*\n(?:\w+ \([^)]*\): )?(.*?)(?:\n\n|$)", ours.GetOutput())
    if found is not None:
        reason = " ".join(re.sub(r"vtk\w+ \(0x[0-9a-f]+\): ", "", found[1]).split())
        raise FormatError(f"expected a whole VTK file, found: {reason}", file=path)


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
    elif data.IsA("vtkMultiPieceDataSet"):
        for i in range(data.GetNumberOfPieces()):
            yield from _leaves(data.GetPiece(i), name)


def _grid(path: Path, name: str, data: Any) -> Grid:
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
    degrees, ghosts = on_cells.pop(_DEGREES, None), on_cells.pop(_GHOSTS, np.zeros((count, 1)))
    weights = on_points.pop(_WEIGHTS, None)
    on_points.pop(_GHOSTS, None)
    return Grid(
        str(path),
        name,
        points,
        types,
        nodes,
        offsets,
        (ghosts[:, 0].astype(np.int64) & (_DUPLICATE | _HIDDEN)),
        None if degrees is None else degrees.astype(np.int64),
        None if weights is None else weights[:, 0].astype(np.float64),
        on_points,
        on_cells,
        _time(data.GetFieldData()),
    )


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
    for name in _TIMES:
        array = data.GetArray(name)
        if array is not None and array.GetNumberOfTuples():
            return float(array.GetTuple1(0))
    return None
