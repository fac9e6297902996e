"""Files of VTK: unstructured grids, their parts, collections of them over time, read by the library elsewhere."""

from __future__ import annotations

import math
import mmap
import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import lru_cache
from os.path import exists, isfile
from pathlib import Path
from typing import Any

from elvis.converters.shared.apart import Apart, LibraryError
from elvis.converters.vtk.hdf import files_of, is_vtkhdf, other_type, read_vtkhdf
from elvis.converters.vtk.packing import check_packed
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.data.moments import checked_step
from elvis.core.files.plain import check_plain, content, json_content, leading, unpacked_limit
from elvis.plugins.conversion.recognition import found_instead

#: number of bytes that identify a file
_START = 4096

_KINDS = {
    b"UnstructuredGrid": "grid",
    b"PUnstructuredGrid": "parts",
    b"vtkMultiBlockDataSet": "blocks",
    b"Collection": "series",
}

_UNSTRUCTURED = "save an unstructured grid (.vtu), in ParaView by the filter Append Datasets"

#: content of other kinds of its data sets, and advice
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

#: beginning of lists of files in JSON
_SERIES = re.compile(rb"""\s*\{[^{}\[\]]*"file-series-version\"""")

#: beginning of HDF5 files
_HDF5 = b"\x89HDF\r\n"

#: numbers that XML declares
_COUNT = re.compile(rb"""\b(NumberOf\w+)\s*=\s*["']\s*(\d{1,400})""")

#: reads in another process
_WORKER = "elvis.converters.vtk.library:Library"


@dataclass(eq=False)
class Grid:
    """An unstructured grid.

    name         of the block
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
    """``legacy``, ``grid``, ``parts``, ``blocks``, ``series`` or ``hdf``, judged by the first bytes.

    Empty for others.
    """
    start = leading(path, _START)
    if start.startswith(_HDF5) and is_vtkhdf(path):
        return "hdf"
    if _SERIES.match(start):
        return "series"
    if start.startswith(b"# vtk DataFile"):
        return "legacy" if re.search(rb"(?i)DATASET\s+UNSTRUCTURED_GRID", start) else ""
    found = re.search(rb"<VTKFile[^>]*?\btype\s*=\s*[\"'](\w+)[\"']", start)
    return _KINDS.get(found[1], "") if found else ""


def other_kind(path: Path) -> str:
    """A description of a VTK file without an unstructured grid, with advice; empty for other programs' files."""
    start = leading(path, _START)
    if start.startswith(_HDF5):
        return other_type(path)
    found = re.search(rb"<VTKFile[^>]*?\btype\s*=\s*[\"'](\w+)[\"']", start)
    if found is None and start.startswith(b"# vtk DataFile"):
        found = re.search(rb"(?im)^\s*(?:DATASET\s+)?(\w+)", start.split(b"\n", 3)[-1])
    if found is None:
        return ""
    kind = found[1].upper().replace(b"_", b"").removeprefix(b"VTK")
    words = _OTHERS.get(kind) or _OTHERS.get(kind.removeprefix(b"P"))
    return words or f"VTK data of the kind {found[1].decode('ascii', 'replace')}: {_UNSTRUCTURED}"


def read(paths: Sequence[Path], step: int = -1) -> tuple[list[Grid], list[Path]]:
    """The grids of all files, for a series the grids of one step; and their files."""
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
    every = _with_pieces([path for path, _ in files])
    rows = {piece for path, _ in files if kind_of(path) == "hdf" for piece in _pieces(path)}
    files = [(path, time) for path, time in files if path not in rows]
    _checked_size(every)
    parts = dict.fromkeys((part, when) for path, when in files for part in _parts(path))
    grids: list[Grid] = []
    # a small file among large ones allows no more than the largest
    with _Reader(max((_size(_with_pieces([part])) for part, _ in parts), default=0)) as reader:
        for part, when in parts:
            found = [Grid(str(part), **own) for own in reader.grids(part, step)]
            for grid in found:
                grid.time = grid.time if when is None else when
            grids += found
    return grids, every


def overlap(path: Path, other: Path) -> float:
    """The share of some cells of a file whose centres lie in cells of another; raises FormatError as `read`."""
    size = _checked_size(_with_pieces([path, other]))
    with Apart(_WORKER, size) as library:
        return float(_ask(library, path, size, "overlap", str(path), kind_of(path), str(other), kind_of(other)))


def array_names(path: Path) -> frozenset[str]:
    """The names of the arrays in a file; raises FormatError as `read`."""
    size = _checked_size(_with_pieces([path]))
    with Apart(_WORKER, size) as library:
        return frozenset(_ask(library, path, size, "arrays", str(path), kind_of(path)))


class _Reader(ExitStack):
    """Reads HDF5 files without the library, and starts the library for the first other file.

    size  in bytes of all files that one of its questions may be about
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        self._size = size
        self._library: Apart | None = None

    def grids(self, path: Path, step: int) -> list[dict[str, Any]]:
        """The data of the grids in a file, or in the files that it names.

        Raises FormatError with a library's complaint.
        """
        if kind_of(path) == "hdf":
            return read_vtkhdf(path, step)
        if self._library is None:
            self._library = self.enter_context(Apart(_WORKER, self._size))
        size = _size(_with_pieces([path]))
        found: list[dict[str, Any]] = _ask(self._library, path, size, "grids", str(path), kind_of(path))
        return found


def _ask(library: Apart, path: Path, size: int, method: str, *given: str) -> Any:
    """The library's result; raises FormatError that names ``path`` if it fails."""
    try:
        return library.ask(method, *given, size=size)
    except LibraryError as failure:
        raise FormatError(f"expected a complete VTK file, found {failure.reason}", file=path) from failure


def _parts(path: Path) -> list[Path]:
    """The files that an index of parts names, each with a version of its own; otherwise the file itself."""
    if kind_of(path) != "parts":
        return [path]
    names = _named(path)
    missing = [name for name in names if not kind_of(path.parent / name)]
    if missing:
        raise FormatError(f"expected its part {missing[0]} next to it, found none", file=path)
    return [part for name in names for part in _parts(path.parent / name)]


def _with_pieces(paths: Sequence[Path]) -> list[Path]:
    """The files, and the files that they name."""
    every, left = dict.fromkeys(paths), list(paths)
    while left:
        found = [piece for piece in _pieces(left.pop()) if piece not in every]
        every.update(dict.fromkeys(found))
        left += found
    return list(every)


def _size(paths: Sequence[Path]) -> int:
    """Bytes of all files."""
    return sum(path.stat().st_size for path in paths)


def _checked_size(paths: Sequence[Path]) -> int:
    """Bytes of all files; raises FormatError if one declares more than these hold."""
    size = _size(paths)
    for path in paths:
        _check_counts(path, size)
    return size


def _check_counts(path: Path, size: int) -> None:
    """Raise FormatError if XML declares more of something than ``size`` bytes of all files hold, even packed."""
    if kind_of(path) == "legacy" or leading(path, _START).startswith(_HDF5):
        return
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as raw:
        end = raw.find(b"<AppendedData")
        for found in _COUNT.finditer(raw, 0, end if end >= 0 else len(raw)):
            if int(found[2]) > unpacked_limit(size):
                expected = f"at most {unpacked_limit(size)}, from {size} bytes"
                place = found[1].decode("ascii")
                raise FormatError(f"expected {expected}, found {int(found[2])}", file=path, place=place)
        check_packed(path, raw, size)


def _pieces(path: Path) -> list[Path]:
    """The files that an index of parts, blocks or virtual arrays names.

    Raises FormatError if one of these is not a plain file.
    """
    kind = kind_of(path)
    if kind not in ("parts", "blocks", "hdf"):
        return []
    found = files_of(path) if kind == "hdf" else [path.parent / name for name in _named(path)]
    for each in found:
        if exists(each):
            check_plain(each)
    return [each for each in found if isfile(each)]


def _named(path: Path) -> list[str]:
    """The names of files in one of parts or blocks."""
    names = re.findall(rb"""\b(?:Source|file)\s*=\s*["']([^"'\0]*)["']""", content(path))
    return [name.decode("utf-8", "replace") for name in names]


def files_by_time(path: Path) -> Mapping[float, Sequence[str]]:
    """The names of the files of each time of a series, ascending: a collection (.pvd) or a list in JSON (.series)."""
    state = path.stat()
    return _files_by_time(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=1)
def _files_by_time(path: Path, changed: int, size: int) -> Mapping[float, Sequence[str]]:
    """`files_by_time` of the only series that is read, again for each of its steps, until the file changes."""
    from xml.etree import ElementTree

    found: dict[float, list[str]] = {}
    try:
        if _SERIES.match(leading(path, _START)):
            entries = [(entry["time"], entry["name"]) for entry in json_content(path)["files"]]
        else:
            listed = ElementTree.parse(path).iter("DataSet")
            entries = [(entry.get("timestep", 0), entry.attrib["file"]) for entry in listed]
        for time, name in entries:
            found.setdefault(float(time), []).append(str(name))
    except (ElementTree.ParseError, ValueError, KeyError, TypeError) as error:
        raise FormatError(f"expected a list of files with their times, found: {error}", file=path) from None
    return dict(sorted(found.items()))


def _members(path: Path, step: int) -> tuple[float, list[Path]]:
    """Time and files of one step of a series."""
    listed = files_by_time(path)
    if not listed or any(map(math.isnan, listed)):
        raise FormatError("expected a list of files with their times, found one without", file=path)
    time = list(listed)[checked_step(step, len(listed), path)]
    members = [path.parent / name for name in listed[time]]
    for member in members:
        if not kind_of(member):
            raise FormatError(f"expected a VTK file {member.name} next to it, found none", file=path)
    return time, members
