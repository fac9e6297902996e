"""GMF meshes and solutions (.mesh, .meshb, .sol, .solb) of any order, as libMeshb writes them and Vizir reads them.

Tables in the files give the order of nodes in the lattice of an element and of a solution; a flag marks nodes that are
control points.  Layout: libMeshb, documentation of version 7.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis.converters.gmf.files import ELEMENTS, GmfFile, Section, is_gmf, section_name, solution_name, type_sizes
from elvis.converters.gmf.nodes import Bernstein, guessed, is_lattice, unit_points
from elvis.converters.gmf.nodes import lattice as all_nodes
from elvis.converters.shared.inputs import check_roles, check_rows, excess_of_parts
from elvis.converters.shared.unit import UNIT, unit_basis
from elvis.core.base.arrays import Ints, distinct, narrow_ints, rows_by_number
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import NodalBlock, NodalConverter, NodalValues, ShapeFunctions, nearest_nodes
from elvis.plugins.conversion.plugin import DOUBLE, SINGLE, Boundary, Elements, PyramidSpace, Reads

_SHAPES = {
    "Triangles": Shape.TRIANGLE,
    "Quadrilaterals": Shape.QUADRILATERAL,
    "Tetrahedra": Shape.TETRAHEDRON,
    "Pyramids": Shape.PYRAMID,
    "Prisms": Shape.PRISM,
    "Hexahedra": Shape.HEXAHEDRON,
}

_ORDERS = (1, 2, 3, 4)

_TYPES = {1: "scalar", 2: "vector", 3: "tensor", 4: "matrix"}

#: components of symmetric matrices, row by row of the lower half
_SYMMETRIC = {2: ("xx", "xy", "yy"), 3: ("xx", "xy", "yy", "xz", "yz", "zz")}

#: tolerance for positions of control points times the degree; the highest plausible degree
_POSITION_ROUNDING, _HIGHEST_DEGREE = 1e-5, 30


class Gmf(NodalConverter):
    """A mesh, with the solution that goes with it."""

    format = "GMF mesh and solution (.mesh, .meshb, .sol, .solb)"
    keeps = "elements of all shapes to order 4, nodes or Bezier points, solutions of any degree, references, time"
    loses = "corners, ridges, normals, edges in 3D; solutions on faces"
    reads = Reads(
        "all",
        "1 to 4 (map), any (fields)",
        "nodal, Bernstein, constant",
        "references by number",
        "none",
        "none",
        "by place",
        "no",
    )
    further_files = ()

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether every file begins as files of this family do."""
        return all(is_gmf(path) for path in paths)

    def __init__(self, paths: Sequence[Path]) -> None:
        mesh, solution = _roles(paths)
        self._mesh, self.notes, self.blocks = mesh, [], []
        vertices = mesh.sections["Vertices"]
        self._places = vertices.reals
        self._parts: list[tuple[str, Ints]] = []
        self.precision = SINGLE if mesh.real_size == 4 else DOUBLE
        dimension = 3 if _sections(mesh, 3) else 2
        parts = _sections(mesh, dimension)
        references = [mesh.sections[name].integers[:, -1] for *_, name in parts]
        excess = excess_of_parts(references, "references of elements")
        different = {number for own in references for number in distinct(own).tolist()}
        self._has_regions = len(different) > 1 and not excess
        for kind, order, name in parts:
            self._read_elements(kind, order, name)
        if not self.blocks:
            raise FormatError("expected elements, found none", file=mesh.path)
        of_sides = [mesh.sections[name].integers[:, -1] for *_, name in _sections(mesh, dimension - 1)]
        unnamed = excess_of_parts(of_sides, "references of sides")
        self.boundaries = [] if unnamed else self._borders(dimension - 1)
        self.declared = self._declared(dimension, not unnamed)
        self.warnings = [*mesh.remarks, *(remark for remark in (excess, unnamed) if remark)]
        if solution is not None:
            self._read_solution(solution)
            self.warnings += [f"{solution.path.name}: {remark}" for remark in solution.remarks]
        # blocks and boundaries hold what they need of the tables
        mesh.sections.clear()

    def _read_elements(self, kind: str, order: int, name: str) -> None:
        """One block for every reference that elements of a kind and order have."""
        shape, path = _SHAPES[kind], self._mesh.path
        table = self._mesh.sections[name].integers
        nodes, references = table[:, :-1] - 1, table[:, -1]
        if not self._has_regions:
            references = np.zeros_like(references)
        check_rows(nodes, len(self._places), "vertices", 1, path, name)
        entries = self._entries(kind, order, name, nodes)
        is_bezier = bool(self._mesh.value("BezierBasis"))
        functions = _functions(shape, order, entries, is_bezier, path, name)
        corners = nearest_nodes(unit_points(shape, entries), order * UNIT[shape].frame)
        start, blocks = sum(map(len, self.blocks)), list(self.blocks)
        for reference, rows in rows_by_number(references):
            own = narrow_ints(nodes[rows], len(self._places))
            block = Elements(
                shape,
                len(rows),
                order,
                own if np.array_equal(corners, np.arange(own.shape[1])) else own[:, corners],
                ids=narrow_ints(start + rows, start + len(table)),
                region=f"ref{reference}" if self._has_regions else "",
                pyramid=PyramidSpace.RATIONAL,
                key=NodalBlock(NodalValues(self._places, functions, own)),
            )
            blocks.append(block)
            self._parts.append((name, rows))
        self.blocks = blocks

    def _entries(self, kind: str, order: int, name: str, nodes: Ints) -> Ints:
        """(n, k) the place in the lattice of each node: as the table says, or as the nodes of most elements lie."""
        shape, letter = _SHAPES[kind], ELEMENTS[kind][2]
        table = self._mesh.sections.get(f"{kind}{letter}{order}Ordering")
        if table is not None:
            if not is_lattice(shape, order, table.integers):
                expected = f"every node of a {shape.label.lower()} of order {order} once"
                raise FormatError(f"expected {expected}, found others", file=self._mesh.path, place=f"{name}Ordering")
            return table.integers
        if order == 1:
            return all_nodes(shape, 1)
        found = guessed(shape, order, self._places[nodes])
        if found is None:
            raise FormatError(f"expected a table {name}Ordering, found none", file=self._mesh.path, place=name)
        self.notes = [*self.notes, f"no table orders the nodes of {name}: they are matched by position"]
        return found

    def _declared(self, dimension: int, has_boundaries: bool) -> Declared:
        """Rows of the tables of elements, and rows of one dimension lower by reference."""
        elements = sum(len(self._mesh.sections[name].integers) for *_, name in _sections(self._mesh, dimension))
        counts: dict[str, int] = {}
        for *_, name in _sections(self._mesh, dimension - 1) if has_boundaries else ():
            references = self._mesh.sections[name].integers[:, -1]
            for reference, rows in rows_by_number(references):
                boundary = f"boundary{reference}"
                counts[boundary] = counts.get(boundary, 0) + len(rows)
        return Declared(elements, counts)

    def _borders(self, dimension: int) -> list[Boundary]:
        """Elements of one dimension less, by reference."""
        found: dict[int, list[Ints]] = {}
        for kind, _, name in _sections(self._mesh, dimension):
            table = self._mesh.sections[name].integers
            corners = table[:, : ELEMENTS[kind][0]] - 1
            for reference, rows in rows_by_number(table[:, -1]):
                found.setdefault(reference, []).append(corners[rows])
        return [Boundary(f"boundary{reference}", vertices=faces) for reference, faces in sorted(found.items())]

    def _read_solution(self, file: GmfFile) -> None:
        if file.dimension != self._mesh.dimension:
            found = f"dimension {file.dimension}"
            raise FormatError(f"expected a solution of dimension {self._mesh.dimension}, found {found}", file=file.path)
        if file.real_size == 4:
            self.precision = SINGLE
        self.time = file.value("Time")
        groups = {"SolAtVertices": self._at_vertices, "SolAt": self._constant, "HOSolAt": self._high_order}
        counts: dict[str, int] = {}
        for group, read in groups.items():
            types, values = read(file)
            if types:
                self._name_fields(group, types, values, counts)
        if not self.fields:
            raise FormatError("expected a solution on the elements of the mesh, found none", file=file.path)

    def _name_fields(
        self, group: str, types: Sequence[int], values: Sequence[NodalValues | None], counts: dict[str, int]
    ) -> None:
        """Fields by their type, numbered where there are several; the format has no names for them."""
        labels = []
        for kind in types:
            counts[_TYPES[kind]] = number = counts.get(_TYPES[kind], 0) + 1
            name = _TYPES[kind] + (str(number) if number > 1 else "")
            labels += [f"{name}{suffix}" for suffix in _suffixes(kind, self._mesh.dimension)]
        self.add_field(group, labels, values, is_continuous=group == "SolAtVertices")

    def _at_vertices(self, file: GmfFile) -> tuple[tuple[int, ...], list[NodalValues | None]]:
        section = file.sections.get("SolAtVertices")
        if section is None:
            return (), []
        if self._mesh.value("BezierBasis"):
            raise FormatError("expected values at nodes, found a mesh with control points", file=file.path)
        self._check_count(file, "SolAtVertices", section, len(self._places), "vertices")
        values = section.reals.reshape(-1, file.width(section.types, "SolAtVertices"))
        return section.types, [replace(self.nodal(block).geometry, values=values) for block in self.blocks]

    def _constant(self, file: GmfFile) -> tuple[tuple[int, ...], list[NodalValues | None]]:
        return self._by_element(file, lambda kind, order: f"SolAt{kind}" if order == 1 else "")

    def _high_order(self, file: GmfFile) -> tuple[tuple[int, ...], list[NodalValues | None]]:
        return self._by_element(file, solution_name)

    def _by_element(
        self, file: GmfFile, named: Callable[[str, int], str]
    ) -> tuple[tuple[int, ...], list[NodalValues | None]]:
        """Types of the fields of a group, the same on all elements, and their values on every block."""
        types: tuple[int, ...] = ()
        found: dict[str, NodalValues] = {}
        read = {name for name, _ in self._parts}
        for kind, order, name in _sections(self._mesh, 3) + _sections(self._mesh, 2):
            section = file.sections.get(named(kind, order)) if name in read else None
            if section is None:
                continue
            place = named(kind, order)
            self._check_count(file, place, section, len(self._mesh.sections[name].integers), "elements")
            if types not in ((), section.types):
                raise FormatError(f"expected the types {types}, found {section.types}", file=file.path, place=place)
            types = section.types
            values = section.reals.reshape(len(section.reals), section.nodes, file.width(types, place))
            found[name] = NodalValues(values, _solution_functions(file, place, _SHAPES[kind], section))
        return types, [_part(found.get(name), rows) for name, rows in self._parts]

    @staticmethod
    def _check_count(file: GmfFile, place: str, section: Section, count: int, what: str) -> None:
        if len(section.reals) != count:
            found = f"on {len(section.reals)}"
            raise FormatError(f"expected values on {count} {what}, found {found}", file=file.path, place=place)


def _roles(paths: Sequence[Path]) -> tuple[GmfFile, GmfFile | None]:
    """The mesh, and the solution where there is one; a mesh of the same name is sought next to a solution."""
    files = [GmfFile(path) for path in paths]
    meshes = [file for file in files if "Vertices" in file.sections]
    solutions = [file for file in files if file not in meshes]
    if not meshes and len(solutions) == 1:
        path = solutions[0].path
        candidates = [path.with_suffix(end) for end in (".meshb", ".mesh")]
        meshes = [GmfFile(each) for each in candidates if is_gmf(each)][:1]
        if not meshes or "Vertices" not in meshes[0].sections:
            names = " or ".join(each.name for each in candidates)
            raise FormatError(f"expected its mesh {names} next to it, found none; also give the mesh file", file=path)
    check_roles(len(meshes), len(solutions))
    return meshes[0], solutions[0] if solutions else None


def _part(values: NodalValues | None, rows: Ints) -> NodalValues | None:
    """The values on some of the elements."""
    return None if values is None else replace(values, values=values.values[rows])


def _sections(mesh: GmfFile, dimension: int) -> list[tuple[str, int, str]]:
    """Kind, order and keyword of the elements of a dimension that a mesh has."""
    found = [(kind, order, section_name(kind, order)) for kind in ELEMENTS for order in _ORDERS]
    present = [entry for entry in found if ELEMENTS[entry[0]][1] == dimension and entry[2] in mesh.sections]
    return [entry for entry in present if len(mesh.sections[entry[2]].integers)]


def _suffixes(kind: int, dimension: int) -> tuple[str, ...]:
    """Suffixes that distinguish the components of a field of a type."""
    axes = "xyz"[:dimension]
    named = {1: ("",), 2: tuple(f"_{a}" for a in axes), 3: tuple(f"_{ab}" for ab in _SYMMETRIC[dimension])}
    suffixes = named.get(kind, tuple(f"_{a}{b}" for a in axes for b in axes))
    assert len(suffixes) == type_sizes(dimension)[kind]
    return suffixes


def _functions(shape: Shape, order: int, entries: Ints, is_bezier: bool, path: Path, place: str) -> ShapeFunctions:
    if is_bezier and shape is Shape.PYRAMID and order > 1:
        raise FormatError(
            "expected nodes, found control points of pyramids, which aren't known", file=path, place=place
        )
    if is_bezier and shape is not Shape.PYRAMID:
        return Bernstein(shape, order, entries)
    return unit_basis(shape, order, unit_points(shape, entries) / order)


def _solution_functions(file: GmfFile, place: str, shape: Shape, section: Section) -> ShapeFunctions:
    """The functions of the nodes of a solution, given by a table of positions or by the degree."""
    if not 0 <= section.degree <= _HIGHEST_DEGREE:
        expected = f"a degree from 0 to {_HIGHEST_DEGREE}"
        raise FormatError(f"expected {expected}, found {section.degree}", file=file.path, place=place)
    positions = file.sections.get(f"{place}NodesPositions")
    own = UNIT[shape].own
    if positions is not None:
        points = unit_points(shape, positions.reals)
    elif section.nodes == 1 and section.degree == 0:
        points = own.mean(axis=0, keepdims=True)
    elif section.nodes == len(own) and section.degree == 1:
        points = own
    else:
        raise FormatError(f"expected a table {place}NodesPositions, found none", file=file.path, place=place)
    if len(points) != section.nodes:
        expected = f"the positions of {section.nodes} nodes"
        raise FormatError(f"expected {expected}, found {len(points)}", file=file.path, place=f"{place}NodesPositions")
    if file.value("BezierBasis") and positions is not None and section.degree:
        entries = np.rint(positions.reals * section.degree).astype(np.int64)
        near = np.abs(positions.reals * section.degree - entries).max() < _POSITION_ROUNDING
        if near and is_lattice(shape, section.degree, entries) and shape is not Shape.PYRAMID:
            return Bernstein(shape, section.degree, entries)
        raise FormatError("expected control points on a lattice, found others", file=file.path, place=place)
    try:
        return unit_basis(shape, section.degree, points)
    except ElvisError as error:
        raise FormatError(str(error), file=file.path, place=f"{place}NodesPositions") from None
