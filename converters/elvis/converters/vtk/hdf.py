"""VTKHDF files: unstructured grids in HDF5, in parts and steps, and those in collections of blocks.

Layout: VTK documentation, "VTKHDF File Format", versions 1 and 2.  A grid is a group.  The parts of all steps stand one
after another in its arrays; each part has numbers of points, cells and entries of the connectivity, and one offset more
than cells.  The group Steps says where the parts of a step begin.  Arrays may be virtual ones, whose rows lie in files
of each step or part.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.converters.shared.hdf5 import attribute, holds, reading, text
from elvis.converters.shared.hdf5_virtual import dataset, source_files
from elvis.converters.shared.inputs import check_rows
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.data.moments import checked_step

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: the group that holds all, and the kind of groups that are read
_ROOT, _GRID = "VTKHDF", "UnstructuredGrid"

#: kinds of groups that hold others
_COLLECTIONS = ("PartitionedDataSetCollection", "MultiBlockDataSet")

#: the tree of blocks in a collection
_TREE = "Assembly"

#: arrays with a meaning of their own
_GHOSTS, _DEGREES, _WEIGHTS = "vtkGhostType", "HigherOrderDegrees", "RationalWeights"

#: bits of a ghost cell: it is another part's, or it is hidden
_DUPLICATE_OR_HIDDEN = 1 | 32


def is_vtkhdf(path: Path) -> bool:
    """Whether a file holds unstructured grids in this form."""
    if not holds(path, _ROOT):
        return False
    with suppress(FormatError), reading(path) as file:
        return bool(_grids(file))
    return False


def other_type(path: Path) -> str:
    """A description of a file in this form without an unstructured grid, with advice; empty for other files."""
    if not holds(path, _ROOT):
        return ""
    try:
        with reading(path) as file:
            kind = _type(file[_ROOT])
    except FormatError:
        return "a VTKHDF file that is damaged or whose blocks lie in other files: pass those files"
    return f"a VTKHDF file of the type {kind or 'none'}: save an unstructured grid (.vtkhdf or .vtu)"


def times_in(path: Path) -> list[float]:
    """The times of the steps of a file, none if it has no steps."""
    with reading(path) as file:
        grids = _grids(file)
        return _times(grids[0][1]) if grids else []


def files_of(path: Path) -> list[Path]:
    """The other files that hold rows of the arrays in a file."""
    with reading(path) as file:
        return source_files(file)


def read_vtkhdf(path: Path, step: int) -> list[dict[str, Any]]:
    """The data of an `elvis.converters.vtk.files.Grid`, for each grid in a file at a step."""
    with reading(path) as file:
        grids = _grids(file)
        if not grids:
            raise FormatError(f"expected a group of the type {_GRID}, found none", file=path, place=_ROOT)
        found = []
        for name, group in grids:
            times = _times(group)
            number = checked_step(step, len(times), path) if times else 0
            own = _GridReading(group, number, bool(times)).grid()
            found.append({**own, "name": name, "time": times[number] if times else None})
        return found


def _grids(file: h5py.File) -> list[tuple[str, h5py.Group]]:
    """The groups that are unstructured grids, with the names of blocks; groups below links are ignored."""
    import h5py

    root = file.get(_ROOT)
    if not isinstance(root, h5py.Group):
        raise FormatError(f"expected a group {_ROOT}, found none", file=file.filename)
    kind = _type(root)
    if kind == _GRID:
        return [("", root)]
    if kind not in _COLLECTIONS:
        raise FormatError(f"expected data of the type {_GRID}, found {kind or 'none'}", file=file.filename, place=_ROOT)
    members = [(name, root.get(name)) for name in root if isinstance(root.get(name, getlink=True), h5py.HardLink)]
    names = _names(root)
    return [
        (names.get(name, name), own) for name, own in members if isinstance(own, h5py.Group) and _type(own) == _GRID
    ]


def _names(root: h5py.Group) -> dict[str, str]:
    """The names of blocks in the tree of links, the group Assembly; names of several blocks are ignored."""
    import h5py

    links: dict[str, list[str]] = {}

    def add(place: str, link: object) -> None:
        if isinstance(link, h5py.SoftLink):
            links.setdefault(place.rpartition("/")[2], []).append(link.path.rpartition("/")[2])

    tree = root.get(_TREE) if isinstance(root.get(_TREE, getlink=True), h5py.HardLink) else None
    if isinstance(tree, h5py.Group):
        tree.visititems_links(add)
    return {blocks[0]: name for name, blocks in links.items() if len(blocks) == 1}


def _type(group: h5py.Group) -> str:
    return text(attribute(group, "Type")) if "Type" in group.attrs else ""


def _times(group: h5py.Group) -> list[float]:
    """The times of the steps of a grid."""
    if "Steps" not in group:
        return []
    return [float(time) for time in _numbers(group, "Steps/Values", "iuf")]


@dataclass(frozen=True)
class _Part:
    """Position of a part in the arrays of a grid: the first of its rows, and their number.

    first_offset  in the array of offsets, which has one more than cells
    """

    first_point: int
    points: int
    first_cell: int
    cells: int
    first_entry: int
    entries: int
    first_offset: int


@dataclass(eq=False)
class _GridReading:
    """A grid at a step: its parts are put together."""

    group: h5py.Group
    step: int
    has_steps: bool

    def grid(self) -> dict[str, Any]:
        """Points, cells and arrays of all parts."""
        parts = list(self._parts())
        points = [self._rows("Points", part.first_point, part.points) for part in parts]
        types = [self._rows("Types", part.first_cell, part.cells) for part in parts]
        lengths, nodes, first = [], [], 0
        for part in parts:
            own = self._cells(part)
            lengths.append(own[0])
            nodes.append(first + own[1])
            first += part.points
        on_points = self._arrays("PointData", sum(part.points for part in parts), parts[0].first_point if parts else 0)
        count = sum(part.cells for part in parts)
        on_cells = self._arrays("CellData", count, parts[0].first_cell if parts else 0)
        degrees, weights = on_cells.pop(_DEGREES, None), on_points.pop(_WEIGHTS, None)
        ghosts = on_cells.pop(_GHOSTS, np.zeros((count, 1)))
        on_points.pop(_GHOSTS, None)
        none = np.zeros(0, np.int64)
        return {
            "points": np.concatenate(points) if points else np.zeros((0, 3)),
            "types": np.concatenate([none, *types]).astype(np.int64),
            "nodes": np.concatenate([none, *nodes]),
            "offsets": np.cumsum(np.concatenate([np.zeros(1, np.int64), *lengths])),
            "ghosts": ghosts[:, 0].astype(np.int64) & _DUPLICATE_OR_HIDDEN,
            "degrees": None if degrees is None else degrees.astype(np.int64),
            "weights": None if weights is None else weights[:, 0].astype(np.float64),
            "point_data": on_points,
            "cell_data": on_cells,
        }

    def _cells(self, part: _Part) -> tuple[Ints, Ints]:
        """(n,) numbers of nodes of the cells of a part, and the nodes, counted from its first point."""
        ends = self._rows("Offsets", part.first_offset, part.cells + 1).astype(np.int64)
        own = self._rows("Connectivity", part.first_entry, part.entries).astype(np.int64)
        if ends[0] != 0 or ends[-1] != part.entries or (np.diff(ends) < 0).any():
            expected = f"ascending offsets from 0 to {part.entries}"
            raise FormatError(f"expected {expected}, found others", place=self._place("Offsets"))
        check_rows(own, part.points, "points", place=self._place("Connectivity"))
        return np.diff(ends), own

    def _parts(self) -> Iterator[_Part]:
        """The parts of the step."""
        sizes = [_numbers(self.group, name) for name in ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")]
        if len({len(own) for own in sizes}) > 1 or min(int(own.min(initial=0)) for own in sizes) < 0:
            raise FormatError(
                "expected equally many numbers of points, cells and ids, found others", place=self.group.name
            )
        first, count = 0, len(sizes[0])
        starts = [0, 0, 0]
        if self.has_steps:
            first, count = self._of_step("PartOffsets", 0), self._of_step("NumberOfParts", 1)
            starts = [self._of_step(name, 0) for name in ("PointOffsets", "CellOffsets", "ConnectivityIdOffsets")]
        if not 0 <= first <= first + count <= len(sizes[0]):
            raise FormatError(f"expected parts up to {len(sizes[0])}, found {first + count}", place=self.group.name)
        for number in range(first, first + count):
            points, cells, entries = (int(size[number]) for size in sizes)
            offset = starts[1] + _parts_before(sizes[1], starts[1], number)
            yield _Part(starts[0], points, starts[1], cells, starts[2], entries, offset)
            starts = [starts[0] + points, starts[1] + cells, starts[2] + entries]

    def _of_step(self, name: str, default: int) -> int:
        """The number of a step in the group Steps."""
        place = f"Steps/{name}"
        if place not in self.group:
            return default
        row = np.ravel(self._rows(place, self.step, 1))
        if not row.size or row.dtype.kind not in "iu":
            raise FormatError(f"expected a whole number for each step, found {row.dtype}", place=self._place(place))
        return int(row[0])

    def _rows(self, name: str, first: int, count: int) -> Any:
        """Rows of an array, which it holds."""
        found = dataset(self.group, name)
        if not found.ndim or found.dtype.kind not in "iuf" or not 0 <= first <= first + count <= len(found):
            what = getattr(found, "lack", "") or f"{found.dtype} of shape {found.shape}"
            raise FormatError(f"expected {first + count} rows of numbers, found {what}", place=self._place(name))
        return found[first : first + count]

    def _place(self, name: str) -> str:
        return f"{self.group.name}/{name}".lstrip("/")

    def _arrays(self, kind: str, count: int, first: int) -> dict[str, Floats]:
        """(count, k) by name, of points or cells.

        first  row of the step in arrays for which the group Steps names none
        """
        import h5py

        holder = self.group.get(kind)
        if not isinstance(holder, h5py.Group):
            return {}
        found: dict[str, Floats] = {}
        for name in holder:
            array = dataset(self.group, f"{kind}/{name}")
            if array.dtype.kind in "iuf" and array.ndim:
                start = self._of_step(f"{kind}Offsets/{name}", first) if self.has_steps else first
                values = self._rows(f"{kind}/{name}", start, count)
                found[name] = values.reshape(len(values), -1)
        return found


def _parts_before(cells: Ints, start: int, part: int) -> int:
    """Number of parts whose cells come before the cell ``start``, with which the cells of a part begin.

    Steps may share the cells of earlier parts: then these are fewer than parts before.
    """
    ends = np.cumsum(cells)
    if start == (ends[part - 1] if part else 0):
        return part
    return int(np.searchsorted(ends, start, side="right"))


def _numbers(group: h5py.Group, name: str, kinds: str = "iu") -> Any:
    """An array of one dimension."""
    found = dataset(group, name)
    if found.ndim != 1 or found.dtype.kind not in kinds:
        raise FormatError(f"expected numbers, found {found.dtype} of shape {found.shape}", place=f"{group.name}/{name}")
    return found[()]
