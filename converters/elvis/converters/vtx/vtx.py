"""VTX files, folders of ADIOS2's that DOLFINx writes: Lagrange cells of any order, with steps, in a block a process."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.shared.apart import Apart, LibraryError
from elvis.converters.shared.inputs import check_rows
from elvis.converters.vtk.files import Grid
from elvis.converters.vtk.vtk import Vtk
from elvis.core.base.arrays import Floats, Ints, distinct_bits
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import check_plain, leading, unpacked_limit
from elvis.plugins.conversion.plugin import Reads

#: the file of a folder that names the steps
_INDEX = "md.idx"
#: beginning of the format, and number of bytes that identify it
_BEGINNING = b"ADIOS-BP"
_HEAD = 64

#: reads in another process
_WORKER = "elvis.converters.vtx.library:Library"

#: arrays of the format itself
_POINTS, _CELLS, _IDS = "geometry", "connectivity", "vtkOriginalPointIds"


class Vtx(Vtk):
    """The grid of one step of a folder."""

    format = "VTX folders of DOLFINx (.bp), written by ADIOS2"
    keeps = "Lagrange cells of any order, values at nodes and on cells, complex functions as two fields, time"
    loses = "text and whole-number arrays"
    reads = Reads(
        "all but pyramids",
        "any",
        "Lagrange (even or Gauss-Lobatto), constant",
        "none",
        "steps of one folder",
        "blocks of one folder",
        "by place",
        "two fields, `u_real` and `u_imag`",
    )
    needs = ("adios2",)

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether this is one folder of ADIOS2's, or files in it."""
        return len(_folders(paths)) == 1

    @classmethod
    def needs_of(cls, paths: Sequence[Path]) -> tuple[str, ...]:
        """All of them."""
        return cls.needs

    @classmethod
    def whole(cls, path: Path) -> Path:
        """The folder itself."""
        return path

    @classmethod
    def joins(cls, paths: Sequence[Path]) -> bool:
        """Never: a folder holds all parts of a step."""
        return False

    @classmethod
    def hint(cls, path: Path) -> str:
        """Nothing else."""
        return ""

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The times of the steps."""
        (folder,) = _folders(paths)
        found: list[float] = _ask(folder, "times")
        return found

    @staticmethod
    def read_grids(paths: Sequence[Path], step: int) -> tuple[list[Grid], list[Path] | None]:
        """The grid of a step; conversions of folders are not cached."""
        (folder,) = _folders(paths)
        size = sum(each.stat().st_size for each in _members(folder))
        found = _ask(folder, "arrays", step, unpacked_limit(size))
        try:
            return [grid_of(str(folder), **found)], None
        except FormatError as error:
            raise error.within(folder) from error


def grid_of(file: str, time: float, type: int, schema: str, arrays: Mapping[str, Sequence[Any]]) -> Grid:
    """The grid of the blocks of all processes; raises FormatError if they don't fit together.

    type    of all cells
    schema  XML that names arrays at points and on cells
    arrays  (n, k) of each block by name
    """
    points = [np.asarray(block, np.float64) for block in arrays[_POINTS]]
    tables = [np.asarray(block, np.int64) for block in arrays[_CELLS]]
    _check_mesh(points, tables)
    starts = np.cumsum([0, *(len(own) for own in points)])
    cells = np.concatenate([own[:, 1:] + start for own, start in zip(tables, starts, strict=False)])
    grid = Grid(
        file=file,
        name="",
        points=np.concatenate(points),
        types=np.full(len(cells), type),
        nodes=cells.reshape(-1),
        offsets=np.arange(len(cells) + 1) * cells.shape[1],
        ghosts=_copies(cells, arrays[_IDS], [len(own) for own in points])
        if _IDS in arrays
        else np.zeros(len(cells), int),
        time=time,
    )
    counts = {"PointData": [len(own) for own in points], "CellData": [len(own) for own in tables]}
    for name, blocks in arrays.items():
        if name not in (_POINTS, _CELLS, _IDS):
            own = grid.cell_data if _section(name, schema, blocks, counts) == "CellData" else grid.point_data
            own[name] = _columns(name, blocks)
    return grid


def _columns(name: str, blocks: Sequence[Any]) -> Any:
    """(n, k) the rows of all blocks; raises FormatError if some have more components than others."""
    tables = [block[:, None] if block.ndim == 1 else block for block in blocks]
    widths = {table.shape[1] for table in tables}
    if len(widths) != 1 or not min(widths):
        raise FormatError(f"expected the same number of components in all blocks, found {sorted(widths)}", place=name)
    return np.concatenate(tables)


def _check_mesh(points: Sequence[Floats], tables: Sequence[Ints]) -> None:
    """Raise FormatError unless blocks of cells have nodes in blocks of points."""
    if not points or len(points) != len(tables) or any(own.ndim != 2 or own.shape[1] != 3 for own in points):
        raise FormatError(
            f"expected positions of three coordinates in {len(tables)} blocks, found others", place=_POINTS
        )
    is_sound = all(own.ndim == 2 and own.shape[1] > 1 and (own[:, 0] == own.shape[1] - 1).all() for own in tables)
    if not is_sound or len({own.shape[1] for own in tables}) > 1:
        raise FormatError("expected rows that begin with their number of nodes, found others", place=_CELLS)
    for own, places in zip(tables, points, strict=True):
        check_rows(own[:, 1:], len(places), "points", place=_CELLS)


def _copies(cells: Ints, numbers: Sequence[Any], counts: Sequence[int]) -> Ints:
    """(n,) 1 for cells that an earlier process also has, identified by global numbers of their nodes, else 0.

    numbers  of the nodes of each block; raises FormatError unless there are as many as ``counts``
    """
    rows = [np.size(block) for block in numbers]
    if rows != list(counts):
        raise FormatError(f"expected {list(counts)} rows in blocks, found {rows}", place=_IDS)
    ids = np.concatenate([np.ravel(block) for block in numbers])
    copies = np.ones(len(cells), np.int64)
    copies[distinct_bits(np.sort(ids[cells], axis=1))[0]] = 0
    return copies


def _section(name: str, schema: str, blocks: Sequence[Any], counts: Mapping[str, Sequence[int]]) -> str:
    """``PointData`` or ``CellData``, where an array belongs by the schema, else by its numbers of rows.

    Raises FormatError if it has other numbers of rows.
    """
    rows = [len(block) for block in blocks]
    fitting = [section for section, own in counts.items() if rows == own]
    named = [
        section
        for section in counts
        for part in re.findall(rf"<{section}>(.*?)</{section}>", schema, re.S)
        if re.search(rf"""Name=\\?["']{re.escape(name)}\\?["']""", part)
    ]
    found = [section for section in named if section in fitting] or fitting
    if not found:
        raise FormatError(f"expected {' or '.join(map(str, counts.values()))} rows in blocks, found {rows}", place=name)
    return found[0]


def _folders(paths: Sequence[Path]) -> list[Path]:
    """The folders of ADIOS2's that paths are, or lie in; none if one is something else."""
    found = dict.fromkeys(path if path.is_dir() else path.parent for path in paths)
    known = [folder for folder in found if leading(folder / _INDEX, _HEAD).startswith(_BEGINNING)]
    return known if len(known) == len(found) else []


def _members(folder: Path) -> list[Path]:
    """The files of a folder, which must all be plain."""
    members = sorted(folder.iterdir())
    for member in members:
        check_plain(member)
    return members


def _ask(folder: Path, method: str, *given: int) -> Any:
    """The library's result; raises FormatError if it fails."""
    size = sum(each.stat().st_size for each in _members(folder))
    with Apart(_WORKER, size) as library:
        try:
            return library.ask(method, str(folder), *given, size=size)
        except LibraryError as failure:
            raise FormatError(f"expected a complete ADIOS2 folder, found {failure.reason}", file=folder) from failure
