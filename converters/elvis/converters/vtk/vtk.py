"""VTK files: unstructured grids of linear, quadratic, Lagrange and Bezier cells.

The library reads, renumbers and evaluates the functions of its cells at points of the reference cell, which it does to
rounding; its search for a point in a curved cell is not used, for it follows linear pieces.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

import numpy as np

from elvis.converters.shared.inputs import STEP, step_number
from elvis.converters.vtk.cells import LAGRANGE, shape_of
from elvis.converters.vtk.files import Grid, array_names, files_by_time, kind_of, other_kind, overlap, read
from elvis.converters.vtk.hdf import times_in
from elvis.converters.vtk.nodes import FAMILIES, node_family
from elvis.converters.vtk.numbering import exchanged, reversed_faces, row_of_nodes, running, third_face, upright
from elvis.converters.vtk.parts import Part, PartsByPlace, drop_copies, parts_of
from elvis.converters.vtk.times import time_in
from elvis.core.base.errors import FormatError
from elvis.core.base.needing import is_there
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import NodalBlock, NodalConverter, component_names
from elvis.plugins.conversion.plugin import DOUBLE, SINGLE, Elements, Option, Reads

#: the end of the name of a file of one process, as DOLFINx writes it, and of one part, as VTK's writer of HDF5 does
_PROCESS = re.compile(
    r"(?P<stem>.*)(?:_p(?P<number>\d+)(?P<step>_\d{6})(?P<suffix>\.\w+)|_part\d+(?P<hdf>\.(?:vtkhdf|hdf)))"
)
#: meshes overlap if more than this share of the cells of one lie in the other
_OVERLAPPING = 0.5


class Vtk(NodalConverter):
    """Grids of one step, as one mesh."""

    format = "VTK unstructured grids (.vtu, .pvtu, .vtk, .vtm, .pvd, .series, .vtkhdf)"
    keeps = "linear, quadratic, Lagrange and Bezier cells, point and cell data, blocks by name, time"
    loses = "cells of lower dimension, text arrays, slits between cells whose points coincide"
    reads = Reads(
        "all",
        "any",
        "Lagrange (even or Gauss-Lobatto), Bézier, quadratic, constant",
        "none",
        "`.pvd`, `.series`, `.vtkhdf`, numbered files",
        "`.pvtu`, `_p0_`, `.vtkhdf`, files that don't overlap",
        "by place",
        "no",
    )
    needs: ClassVar[tuple[str, ...]] = ("vtk",)
    options = (
        Option("nodes", "Nodes of Lagrange cells.", ("auto", *FAMILIES), "auto"),
        Option("hexahedra", "Numbering of the edges of Lagrange hexahedra.", ("auto", "as-read", "exchanged"), "auto"),
        Option(
            "wedges", "Numbering of the third quadrilateral of Lagrange wedges.", ("auto", "as-read", "vtk8"), "auto"
        ),
        STEP,
    )

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether all are unstructured grids or lists of them."""
        return bool(paths) and all(kind_of(path) for path in paths)

    @classmethod
    def needs_of(cls, paths: Sequence[Path]) -> tuple[str, ...]:
        """VTKHDF is read without the library."""
        return () if all(kind_of(path) == "hdf" for path in paths) else cls.needs

    @classmethod
    def whole(cls, path: Path) -> Path:
        """The name without the number of a process or part."""
        marks = _PROCESS.fullmatch(path.name)
        if marks is None:
            return path
        return path.with_name(f"{marks['stem']}{marks['step'] or ''}{marks['suffix'] or marks['hdf']}")

    @classmethod
    def joins(cls, paths: Sequence[Path]) -> bool:
        """Whether meshes don't overlap, or hold different fields.

        Raises FormatError if some overlap and others don't.
        """
        kinds = {kind_of(path) for path in paths}
        if "series" in kinds:
            return True
        if "hdf" in kinds and not is_there("vtkmodules"):  # the library determines whether meshes overlap
            return False
        overlapping: list[bool] = []
        for other in dict.fromkeys((paths[1], paths[-1])):
            with suppress(FormatError):  # a damaged file is a step that is skipped
                overlapping.append(overlap(paths[0], other) > _OVERLAPPING)
        if not any(overlapping):
            return bool(overlapping)
        if not all(overlapping):
            raise FormatError("expected parts of one mesh, or steps, found both: give one step", file=paths[0])
        with suppress(FormatError):
            names = [array_names(path) for path in paths[:2]]
            return all(names) and not names[0] & names[1]
        return False

    @classmethod
    def hint(cls, path: Path) -> str:
        """VTK's other data sets."""
        return other_kind(path)

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The times of a collection; for files, the first time found."""
        series = [path for path in paths if kind_of(path) == "series"]
        if series:
            return list(files_by_time(series[0]))
        if paths and kind_of(paths[0]) == "hdf":
            return times_in(paths[0])
        found = (time_in(path) for path in paths)
        return [time for time in found if time is not None][:1]

    def __init__(
        self,
        paths: Sequence[Path],
        nodes: str = "auto",
        hexahedra: str = "auto",
        wedges: str = "auto",
        step: str | None = None,
    ) -> None:
        self._grids, self.further_files = self.read_grids(paths, step_number(step))
        self.notes, self.warnings = [], _missing_processes(paths)
        self._parts = self._collect(_dimension(self._grids, paths))
        self._check_edges(hexahedra)
        self._number_wedges(wedges)
        self._number_curves()
        self._place_nodes(nodes)
        self.blocks = [_block(part) for part in self._parts]
        self._add_fields(True)
        self._add_fields(False)
        self.time = self._grids[0].time
        self.precision = self._precision()

    @staticmethod
    def read_grids(paths: Sequence[Path], step: int) -> tuple[list[Grid], list[Path] | None]:
        """The grids of a step, and their files, or None if conversions are not to be cached."""
        return read(paths, step)

    def _collect(self, dimension: int) -> list[Part]:
        """The cells of one kind of each grid, by number; grids of the same cells are taken together."""
        result: list[list[Part]] = []
        by_place = PartsByPlace(self._grids)
        first = lower = repeated = 0
        for grid in self._grids:
            own, left = parts_of(grid, dimension, first)
            lower += left
            leading = by_place.coincident(own)
            if leading is None:
                result.append(own)
                by_place.add(own)
                first += len(grid.types)
            else:
                leading[:] = [part.join(other) for part, other in zip(leading, own, strict=True)]
                repeated += sum(len(part.rows) for part in own)
        parts = [part for parts in result for part in parts]
        copies = drop_copies(parts)
        total = sum(int((grid.ghosts == 0).sum()) for grid in self._grids) - repeated
        omitted = {"cells of lower dimension": lower, "cells that are listed twice, each once,": copies}
        self.declared = Declared(total, omitted=omitted)
        return [part for part in parts if len(part.rows)]

    def _every(self) -> list[Part]:
        return [each for part in self._parts for each in (part, *part.companions)]

    def _check_edges(self, hexahedra: str) -> None:
        """Exchange the nodes of two edges of each file's Lagrange hexahedra if requested, or if positions require it.

        Raises FormatError if the nodes of only some cells of a file require it, or if this contradicts the option.
        """
        known = [part for part in self._every() if LAGRANGE.get(part.cell.kind.type) is Shape.HEXAHEDRON]
        for file in dict.fromkeys(part.grid.file for part in known):
            parts = [part for part in known if part.grid.file == file]
            own, other = np.sum([_edges(part) for part in parts], axis=0)
            is_exchanged = hexahedra == "exchanged" or (hexahedra == "auto" and other > 0)
            if own if is_exchanged else other:
                raise FormatError(
                    f"expected nodes of edges near their edges, found {own} such hexahedra, and {other} with the "
                    f"nodes of two edges exchanged, as in files with a wrong version; see the option hexahedra",
                    file=file,
                )
            if is_exchanged:
                for part in parts:
                    pair = upright(part.cell)
                    part.nodes[:, np.concatenate(pair)] = part.nodes[:, np.concatenate(pair[::-1])]
            if is_exchanged and hexahedra == "auto":
                name = Path(file).name
                told = f"{name}: edges of hexahedra are numbered as before version 2.1, and were read accordingly"
                self.warnings = [*self.warnings, f"{told} (option hexahedra)"]

    def _number_wedges(self, wedges: str) -> None:
        """Mirror the nodes of a face of Lagrange wedges if requested, or if they are mirrored.

        Raises FormatError in doubt.
        """
        known = [part for part in self._every() if LAGRANGE.get(part.cell.kind.type) is Shape.PRISM]
        for file in dict.fromkeys(part.grid.file for part in known):
            parts = [part for part in known if part.grid.file == file]
            if wedges == "auto" and not _is_mirrored(parts, file):
                continue
            if wedges != "as-read":
                for part in parts:
                    inside, mirrored = third_face(part.cell)
                    part.nodes[:, inside] = part.nodes[:, mirrored]
            note = "wedges are numbered as by VTK 8, and were read accordingly (option wedges)"
            if wedges == "auto" and note not in self.notes:
                self.notes = [*self.notes, note]

    def _number_curves(self) -> None:
        """Take the nodes of curves one after another where all cells of a file lie so, as Firedrake writes them."""
        known = [part for part in self._every() if LAGRANGE.get(part.cell.kind.type) is Shape.SEGMENT]
        for file in dict.fromkeys(part.grid.file for part in known):
            parts = [part for part in known if part.grid.file == file]
            own, in_rows = np.sum([running(part.places(part.nodes), part.cell) for part in parts], axis=0)
            if own or in_rows < sum(len(part.rows) for part in parts):
                continue
            for part in parts:
                part.nodes[:] = part.nodes[:, row_of_nodes(part.cell)]
            note = "nodes of curves follow one another, though VTK puts both ends first, and were read accordingly"
            if note not in self.warnings:
                self.warnings = [*self.warnings, note]

    def _place_nodes(self, nodes: str) -> None:
        """Move the nodes of Lagrange cells to Gauss or Gauss-Lobatto places if requested, or if cells imply it."""
        known = [part for part in self._every() if part.cell.is_even]
        found = node_family(known)
        family = found.name if nodes == "auto" else nodes
        self.notes = [*self.notes, *found.notes(nodes)]
        if nodes == "auto" and found.doubt:
            self.warnings = [*self.warnings, found.doubt]
        for part in known:
            part.cell.place_nodes(family)

    def _add_fields(self, on_points: bool) -> None:
        """Point data, continuous where they agree; or cell data, constant."""
        names = dict.fromkeys(name for part in self._every() for name in part.arrays(on_points))
        taken = {name for part in self._every() for name in part.grid.point_data} if not on_points else set()
        for name in names:
            holders = [part.holder(name, on_points) for part in self._parts]
            widths = {part.arrays(on_points)[name].shape[1] for part in holders if part is not None}
            if len(widths) > 1:
                found = " and ".join(map(str, sorted(widths)))
                raise FormatError(
                    f"expected the same number of components everywhere, found {found}", place=f"array {name}"
                )
            is_polynomial = not on_points or not any(part is not None and part.is_rational for part in holders)
            labels = component_names(f"{name}_cell" if name in taken else name, widths.pop())
            values = [None if part is None else part.field(name, on_points) for part in holders]
            self.add_field((on_points, name), labels, values, on_points, is_polynomial)

    def _precision(self) -> float:
        arrays = [a for part in self._every() for a in (part.grid.points, *part.grid.point_data.values())]
        return SINGLE if any(a.dtype == np.float32 for a in arrays) else DOUBLE


def _missing_processes(paths: Sequence[Path]) -> list[str]:
    """A message if parts of other processes lie next to the given files."""
    wholes = {Vtk.whole(path) for path in paths if _PROCESS.fullmatch(path.name)}
    given = {path.name for path in paths}
    every = (each for folder in {path.parent for path in wholes} for each in folder.iterdir())
    others = (each for each in every if _PROCESS.fullmatch(each.name) and each.name not in given)
    missing = sorted({each.name for each in others if Vtk.whole(each) in wholes})
    if not missing:
        return []
    return [f"a part of a mesh by name: also give {', '.join(missing[:3])} for the complete mesh"]


def _edges(part: Part) -> tuple[int, int]:
    """In how many hexahedra the nodes of two edges lie near their own edge, and in how many near the other's."""
    return exchanged(part.places(part.nodes), part.cell, upright(part.cell))


def _block(part: Part) -> Elements:
    return Elements(
        part.cell.shape,
        len(part.rows),
        part.cell.order,
        frame=part.cell.frame,
        ids=part.first + part.rows,
        region=part.grid.name,
        pyramid=part.cell.pyramid,
        is_polynomial=not part.is_rational,
        key=NodalBlock(part.nodal(part.grid.points)),
    )


def _dimension(grids: Sequence[Grid], paths: Sequence[Path]) -> int:
    """The highest dimension of a cell; raises FormatError if there are no cells."""
    shapes = [shape_of(kind, grid.file) for grid in grids for kind in np.unique(grid.types[grid.ghosts == 0]).tolist()]
    dimension = max((shape.dimension for shape in shapes if shape is not None), default=0)
    if not dimension:
        raise FormatError("expected cells, found none", file=paths[0])
    return dimension


def _is_mirrored(parts: Sequence[Part], file: str) -> bool:
    """Whether the wedges of a file have a face numbered as by VTK 8; raises FormatError if they are inconsistent."""
    asked = [part for part in parts if not np.array_equal(*third_face(part.cell))]
    votes = [reversed_faces(part.places(part.nodes), part.cell) for part in asked]
    own, other = np.sum(votes, axis=0) if votes else (1, 0)
    if bool(own) == bool(other):
        found = f"{own} as in VTK 9 and {other} as in VTK 8"
        raise FormatError(
            f"expected wedges of one numbering, found {found}; choose one with the option wedges", file=file
        )
    return bool(other)
