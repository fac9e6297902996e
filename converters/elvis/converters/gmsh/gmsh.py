"""Gmsh files: meshes of any order with their physical groups, and the data that goes with them.

Values are evaluated by the functions of their interpolation scheme if they have one, or else of the elements.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from elvis.converters.gmsh.data import MAGIC, Scheme, Section, beginning, scan
from elvis.converters.gmsh.joining import joined
from elvis.converters.gmsh.mesh import Functions, Group, Mesh, read_meshes
from elvis.converters.shared.inputs import STEP, step_number
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.data.moments import checked_step
from elvis.core.files.plain import leading
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import NodalBlock, NodalConverter, NodalValues, component_names
from elvis.plugins.conversion.plugin import Boundary, Elements, Option, PyramidSpace, Reads
from elvis.plugins.conversion.recognition import found_instead

#: number of bytes that identify a file, including comments at its beginning
_HEAD = 1 << 16


#: nodes of an element that have values: none usable, only the corners, all
_NOWHERE, _AT_CORNERS, _EVERYWHERE = 0, 1, 2


@dataclass(frozen=True, eq=False)
class _Values:
    """One field at one time, of all its sections: tags (n,) ascending, where their values begin, how many these are.

    table  (sum, components) values
    """

    name: str
    section: Section
    tags: Ints
    starts: Ints
    counts: Ints
    table: Floats

    @classmethod
    def of(cls, name: str, sections: Sequence[Section]) -> _Values:
        """The values of sections that are pieces of one field."""
        parts = [section.read() for section in sections]
        tags, counts, table = (np.concatenate([part[i] for part in parts]) for i in range(3))
        starts = np.cumsum(counts) - counts
        order = np.argsort(tags, kind="stable")
        return cls(name, sections[0], tags[order], starts[order], counts[order], table)

    def contradictions(self) -> int:
        """The number of tags that are listed again with other values."""
        again = np.flatnonzero(self.tags[1:] == self.tags[:-1])
        differs = self.counts[again] != self.counts[again + 1]
        for number in range(int(self.counts[again].max(initial=0))):
            has_value = ~differs & (number < self.counts[again])
            first, second = self.starts[again[has_value]] + number, self.starts[again[has_value] + 1] + number
            one, other = self.table[first], self.table[second]
            is_equal = (one == other) | (np.isnan(one) & np.isnan(other))
            differs[has_value] = ~is_equal.all(axis=1)
        return len(np.unique(self.tags[again[differs]]))

    def extent(self, group: Group, mesh: Mesh) -> Ints:
        """(n,) the nodes of the elements of a group that have values; for values of elements all or none.

        Corners count on their own only if no other nodes have values: fields of lower order than the mesh are written
        in this way.
        """
        if self.section.kind != "NodeData":
            return np.where(np.isin(group.tags, self.tags), _EVERYWHERE, _NOWHERE)
        is_known = np.isin(mesh.tags, self.tags)
        result = np.where(is_known[group.nodes].all(axis=1), _EVERYWHERE, _NOWHERE)
        corners = group.nodes[:, group.kind.corners]
        others = np.setdiff1d(group.nodes, corners)
        if len(others) and not is_known[others].any():
            result[is_known[corners].all(axis=1)] = _AT_CORNERS
        return result

    def places(self, group: Group, mesh: Mesh, is_at_corners: bool) -> tuple[Ints, Ints]:
        """First values of each element of a group, (n, nodes or 1), and their numbers."""
        if self.section.kind == "NodeData":
            count = len(group.kind.corners) if is_at_corners else group.nodes.shape[1]
            wanted = mesh.tags[group.nodes[:, :count]]
        else:
            wanted = group.tags[:, None]
        rows = np.searchsorted(self.tags, wanted)
        return self.starts[rows], self.counts[rows]


class Gmsh(NodalConverter):
    """A mesh, with data from the same file or others."""

    format = "Gmsh meshes and data (.msh, versions 1, 2.2 and 4)"
    keeps = (
        "all shapes and orders, serendipity elements, physical groups, node and element data with their schemes, time"
    )
    loses = "geometry behind the mesh, parametric coordinates, periodic links"
    reads = Reads(
        "all",
        "any, mixed, serendipity",
        "nodal, interpolation schemes, constant",
        "physical groups by name",
        "steps of data, numbered files",
        "partitions, in one file or several",
        "by place",
        "no",
    )
    needs = ("gmsh",)
    options: ClassVar[tuple[Option, ...]] = (STEP,)
    further_files = ()

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether all files start like Gmsh's."""
        return bool(paths) and all(_starts(path) for path in paths)

    @classmethod
    def hint(cls, path: Path) -> str:
        """Its scripts and lists of values, which hold no mesh."""
        head = leading(path, _HEAD)
        if re.search(rb"(?m)^\s*(View|T2|T3)\s*\"", head) or b"$PostFormat" in head:
            return "a list of values of Gmsh (.pos) without a mesh: save the view in a .msh file"
        if re.search(rb"(?m)^\s*(SetFactory|Point|Line|Circle|Include|Merge)\s*(\(|\")", head):
            return "a script of Gmsh (.geo) without a mesh: mesh it (gmsh -3), and give the .msh file"
        return ""

    @classmethod
    def joins(cls, paths: Sequence[Path]) -> bool:
        """Whether the meshes are partitions of one, or the data are other fields or lie on other nodes or elements."""
        first, second = (scan(path) for path in paths[:2])
        if first.has_mesh and second.has_mesh and first.is_partition and second.is_partition:
            return True
        known = {(section.name, section.kind): section for section in first.sections}
        shared = [section for section in second.sections if (section.name, section.kind) in known]
        if not shared:
            return bool(first.sections and second.sections) or first.has_mesh != second.has_mesh
        own, other = (section.read()[0] for section in (known[shared[0].name, shared[0].kind], shared[0]))
        return not np.isin(own, other).any()

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The times of the field with the most steps."""
        found: dict[tuple[str, str], set[tuple[float, int]]] = {}
        for section in (section for path in paths for section in scan(path).sections):
            found.setdefault((section.name, section.kind), set()).add((section.time, section.step))
        longest = max((sorted(steps) for steps in found.values()), key=len, default=[])
        return [time for time, _ in longest if not np.isnan(time)]

    def __init__(self, paths: Sequence[Path], step: str | None = None) -> None:
        number = step_number(step)
        for path in paths:
            if not _starts(path):
                found = self.hint(path) or found_instead(path)
                raise FormatError(f"expected {MAGIC.decode()} at the beginning, found {found}", file=path)
        contents = [scan(path) for path in paths]
        meshes = [each for each in contents if each.has_mesh]
        if not meshes:
            raise FormatError("expected also a file with a mesh, found only data", file=paths[0])
        sections = [section for each in contents for section in each.sections]
        has_element_data = any(section.kind != "NodeData" for section in sections)
        self.take_mesh(joined(read_meshes(meshes), [each.path for each in meshes], has_element_data))
        series = _series(sections, number)
        read = [_Values.of(name, sections) for name, _, sections in series]
        for values in read:
            self._check_tags(values.section, values.tags)
            if number_of := values.contradictions():
                what = "nodes" if values.section.kind == "NodeData" else "elements"
                left = f"{values.section.name} has several values on {number_of} {what}; the first ones are used"
                self.notes = [*self.notes, left]
        self._split(read)
        for values in read:
            self._add(values)
            time = values.section.time
            if not np.isnan(time):
                self.time = time if self.time is None else max(self.time, time)

    def take_mesh(self, mesh: Mesh) -> None:
        """Blocks, boundaries and notes of a mesh."""
        self._mesh, self._groups = mesh, mesh.groups
        self._known: dict[tuple[int, Shape], Functions] = {}
        self.blocks = [_block(group, mesh) for group in mesh.groups]
        self.boundaries = [Boundary(name, vertices=sides) for name, sides in mesh.sides.items()]
        self.notes = list(mesh.notes)
        self.declared = Declared(mesh.declared)
        self.warnings = [mesh.omission] if mesh.omission else []

    def _split(self, read: Sequence[_Values]) -> None:
        """Divide groups of elements if only some have certain values, so that each field is on whole groups."""
        groups = []
        for group in self._groups:
            columns = [values.extent(group, self._mesh) for values in read]
            if not columns or all(np.ptp(column) == 0 for column in columns):
                groups.append(group)
                continue
            _, which = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
            for number in range(int(which.max()) + 1):
                rows = np.flatnonzero(which.reshape(-1) == number)
                groups.append(replace(group, tags=group.tags[rows], nodes=group.nodes[rows]))
        self._groups = groups
        self.blocks = [_block(group, self._mesh) for group in groups]

    def _add(self, values: _Values) -> None:
        """A field on the groups that have it."""
        found = []
        for group in self._groups:
            extent = int(values.extent(group, self._mesh).max(initial=_NOWHERE))
            on_group = None if extent == _NOWHERE else self._on_group(group, values, extent == _AT_CORNERS)
            found.append(on_group)
        labels = component_names(values.name, values.table.shape[1])
        self.add_field(values.name, labels, found, values.section.kind == "NodeData")

    def _on_group(self, group: Group, values: _Values, is_at_corners: bool) -> NodalValues:
        """The values on a group whose elements all have them, at all nodes or only at corners."""
        section, starts, counts = values.section, *values.places(group, self._mesh, is_at_corners)
        if section.kind == "ElementData":
            return NodalValues(values.table[starts], None)
        if section.kind == "NodeData":
            functions = self._functions(group, section, starts.shape[1])
            return NodalValues(values.table[starts], functions)
        number = int(counts.max(initial=0))
        if (counts != number).any():
            raise _error(section, "the same number of values in elements of one type", f"{counts.min()} and {number}")
        functions = self._functions(group, section, number)
        return NodalValues(values.table[starts + np.arange(number)], functions)

    def _functions(self, group: Group, section: Section, count: int) -> Functions:
        """The functions that this many values on an element of a group belong to."""
        kind = group.kind
        scheme = section.schemes.get(kind.shape)
        if scheme is None and count == kind.functions.count:
            return kind.functions
        if scheme is None and count == len(kind.corners):
            return Functions.linear(kind)
        if scheme is None or len(scheme.coefficients) != count:
            wanted = kind.functions.count if scheme is None else len(scheme.coefficients)
            raise _error(section, f"{wanted} values in a {kind.name.lower()}", f"{count}")
        return self._of_scheme(group, section, scheme)

    def _of_scheme(self, group: Group, section: Section, scheme: Scheme) -> Functions:
        shape = group.kind.shape
        key = (id(scheme), shape)
        if key not in self._known:
            found = Functions.fit(shape, group.kind.frame, lambda points: scheme.values(points, shape))
            if found is None:
                raise _error(section, f"a scheme of polynomials for a {shape.label.lower()}", "another")
            self._known[key] = found
        return self._known[key]

    def _check_tags(self, section: Section, tags: Ints) -> None:
        """A note where some values belong to nothing in the mesh, as after saving a part.

        Raises FormatError if most do.
        """
        own = np.concatenate([group.tags for group in self._groups])
        known = self._mesh.tags if section.kind == "NodeData" else np.concatenate([own, self._mesh.others])
        what = "nodes" if section.kind == "NodeData" else "elements"
        unknown = np.setdiff1d(tags, known)
        if 2 * len(unknown) > len(tags):
            found = f"{len(unknown)} of {len(tags)} on others"
            raise _error(section, f"values on {what} of the mesh", found)
        if len(unknown):
            left = f"values of {section.name} on {len(unknown)} {what} that the mesh doesn't have were skipped"
            self.notes = [*self.notes, left]


def _starts(path: Path) -> bool:
    """Whether a file is in Gmsh's format, regardless of its name."""
    return beginning(leading(path, _HEAD)) >= 0


def _block(group: Group, mesh: Mesh) -> Elements:
    """The elements of a group."""
    kind = group.kind
    return Elements(
        kind.shape,
        len(group.tags),
        kind.functions.order,
        mesh.tags[group.nodes[:, kind.corners]],
        frame=kind.frame,
        ids=group.tags,
        region=group.regions[0] if group.regions else "",
        other_regions=tuple(group.regions[1:]),
        pyramid=PyramidSpace.RATIONAL,
        key=NodalBlock(NodalValues(mesh.places, kind.functions, group.nodes)),
    )


def _series(sections: Sequence[Section], step: int) -> list[tuple[str, str, list[Section]]]:
    """For each field, the sections of the step with a number."""
    found: dict[tuple[str, str], dict[tuple[float, int], list[Section]]] = {}
    for section in sections:
        found.setdefault((section.name, section.kind), {}).setdefault((section.time, section.step), []).append(section)
    names = [name for name, _ in found]
    result = []
    for (name, kind), steps in found.items():
        times = sorted(steps)
        first = steps[times[0]][0]
        own = steps[times[checked_step(step, len(times), first.path, _place(first))]]
        result.append((name if names.count(name) == 1 else f"{name}_{kind}", kind, own))
    return result


def _error(section: Section, expected: str, found: str) -> FormatError:
    return FormatError(f"expected {expected}, found {found}", file=section.path, place=_place(section))


def _place(section: Section) -> str:
    return f"${section.kind} {section.name!r}"
