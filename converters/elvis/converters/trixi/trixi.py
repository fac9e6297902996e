"""Meshes, solutions and restart files of Trixi.jl: values at the Gauss-Lobatto nodes of lines, squares and cubes.

A solution names its mesh, and that may name further files; all are sought next to each other.  Layout: Trixi.jl,
`save_solution_file`, `save_mesh_file`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elvis.converters.shared.hdf5 import attribute, holds, number, reading, require, text
from elvis.converters.shared.inputs import by_kind, check_roles
from elvis.converters.shared.unit import directed_sides
from elvis.converters.trixi.forest import Forest, p4est_cells, t8code_cells
from elvis.converters.trixi.hohqmesh import DIRECTED, is_plane_mesh, read_plane_mesh
from elvis.converters.trixi.mapping import Mapping
from elvis.converters.trixi.mesh import SHAPES, Cells, dimension_of, in_cells, next_to, structured_cells, tree_cells
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import leading
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import NodalBasis, NodalBlock, NodalConverter, NodalValues, tensor_nodes
from elvis.plugins.conversion.plugin import SINGLE, Boundary, Elements, Option, Reads

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: the highest order of a solution
_HIGHEST = 30

#: families of nodes along a line
_NODES = {"lobatto": lobatto, "gauss": gauss}

#: beginning of p4est's files
_P4EST = (b"p4est", b"p8est")

#: a variable of nodes that is constant around each of them
_CONSTANT_AROUND = "limiting_coefficient"


class Trixi(NodalConverter):
    """A mesh, with the solution that goes with it."""

    format = "Trixi.jl mesh and solution or restart (mesh.h5, solution_000000000.h5; p4est_data, .mesh of HOHQMesh)"
    keeps = "curved elements of any order, boundaries, all variables, variables of elements and of nodes, time"
    loses = "meshes of DGMulti and views on parts of meshes"
    reads = Reads(
        "segments, quadrilaterals, hexahedra",
        "any",
        "Gauss-Lobatto, Gauss, constant",
        "by name",
        "numbered files",
        "one file",
        "trees, p4est, t8code",
        "no",
    )
    options = (
        Option("nodes", "Nodes of the solution, which its file doesn't state.", tuple(_NODES), "lobatto"),
        Option("mapping", "Julia definitions used by the mapping of a structured mesh but missing from its file."),
    )

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether these are meshes and solutions of Trixi.jl, with the files that a mesh names."""
        kinds = [_kind(path) for path in paths]
        return all(kinds) and ("mesh" in kinds or "solution" in kinds)

    @classmethod
    def hint(cls, path: Path) -> str:
        """The files that a mesh names."""
        if leading(path, 5) in _P4EST:
            return "a forest of p4est, without the coordinates of its trees: give Trixi's mesh file"
        return "a mesh of HOHQMesh (ISM-V2): give Trixi's mesh file next to it" if is_plane_mesh(path) else ""

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The time of the solution."""
        for path in paths:
            if _kind(path) == "solution":
                with reading(path) as file:
                    return [number(file, "time")]
        return ()

    def __init__(self, paths: Sequence[Path], nodes: str = "lobatto", mapping: str | None = None) -> None:
        roles = by_kind(paths, _kind)
        self._others, self._mapping, self._nodes = roles["other"], mapping or "", nodes
        solutions = roles["solution"]
        check_roles(len(roles["mesh"]) or len(solutions), len(solutions))
        solution = solutions[0] if solutions else None
        mesh = roles["mesh"][0] if roles["mesh"] else _mesh_of(solutions[0])
        self.further_files = [mesh]
        head = None if solution is None else _head(solution)
        with reading(mesh) as file:
            cells = self._cells(file, mesh, head)
        self._take_cells(cells)
        if solution is not None and head is not None:
            with reading(solution) as file:
                self._read_solution(file, head)

    def _cells(self, file: h5py.File, path: Path, head: Head | None) -> Cells:
        """The elements of the mesh."""
        kind = text(attribute(file, "mesh_type"))
        if kind == "TreeMesh":
            return tree_cells(file)
        if kind == "StructuredMesh":
            return structured_cells(
                file, None if head is None else head.order, None if head is None else head.count, self._mapping
            )
        if kind == "T8codeMesh":
            return t8code_cells(file)
        if kind == "P4estMesh":
            cells, other = p4est_cells(file, path.parent, self._others)
            self.further_files = [path, other]
            return cells
        if kind == "UnstructuredMesh2D":
            other = next_to(path.parent, text(attribute(file, "mesh_filename")), self._others)
            self.further_files = [path, other]
            plane = read_plane_mesh(other)
            names = np.empty_like(plane.names)
            names[:, DIRECTED] = plane.names
            count = len(plane.places)
            levels = np.zeros(count, np.int64)
            return Forest(plane.line, plane.places, names, plane.links, levels + 1, levels).cells()
        known = "TreeMesh, StructuredMesh, UnstructuredMesh2D, P4estMesh or T8codeMesh"
        raise FormatError(f"expected a {known}, found a {kind}", place="mesh_type")

    def _take_cells(self, cells: Cells) -> None:
        dimension = cells.names.shape[1] // 2
        shape, sides = SHAPES[dimension], directed_sides(SHAPES[dimension])
        order = len(cells.line) - 1
        basis = NodalBasis(shape, order, tensor_nodes(shape, tuple(cells.line.tolist())))
        geometry = NodalValues(cells.places, basis)
        if cells.mapping is not None:
            geometry = _MappedPlaces(cells.places, basis, mapping=cells.mapping[0], size=cells.mapping[1])
        count = len(cells.places)
        block = Elements(
            shape, count, order, ids=np.arange(count), is_polynomial=cells.mapping is None, key=NodalBlock(geometry)
        )
        self.blocks, self.is_conforming = [block], cells.is_conforming
        for name in dict.fromkeys(cells.names[cells.names != ""].tolist()):
            rows, directions = np.nonzero(cells.names == name)
            self.boundaries = [*self.boundaries, Boundary(name, sides=[(0, rows, sides[directions])])]
        rows, directions = np.nonzero(cells.mortars)
        self.mortars = [(0, rows, sides[directions])] if len(rows) else []

    def _read_solution(self, file: h5py.File, head: Head) -> None:
        block = self.blocks[0]
        shape, count = block.shape, len(block)
        if head.count != count or head.dimension != shape.dimension:
            expected = f"a solution on the {count} elements of the mesh in {shape.dimension} dimensions"
            found = f"one on {head.count} in {head.dimension}"
            raise FormatError(f"expected {expected}, found {found}", file=file.filename)
        self.declared = Declared(head.count)
        line = _NODES[self._nodes](head.order + 1)[0]
        basis = NodalBasis(shape, head.order, tensor_nodes(shape, tuple(line.tolist())))
        taken: set[str] = set()
        for kind, own in (("variables", basis), ("element_variables", None), ("node_variables", basis)):
            for place in _places(file, kind, head.variables if kind == "variables" else None):
                name = _unused(text(attribute(require(file, place), "name")), taken)
                self._add_variable(file, place, name, own)
        self.time = number(file, "time")
        self.metadata = {key: text(attribute(file, key)) for key in ("equations", "timestep") if key in file.attrs}

    def _add_variable(self, file: h5py.File, place: str, name: str, basis: NodalBasis | None) -> None:
        """A field of a dataset: values at the nodes of a basis, or one for each element."""
        block = self.blocks[0]
        nodes = 1 if basis is None else (basis.order + 1) ** block.shape.dimension
        found = require(file, place)
        if found.dtype.kind not in "iuf" or found.size != len(block) * nodes:
            expected = f"{len(block) * nodes} numbers"
            raise FormatError(f"expected {expected}, found {found.dtype} of shape {found.shape}", place=place)
        values = np.asarray(found[()], np.float64).reshape(len(block), nodes, 1)
        self.add_field(place, [name], [NodalValues(values, basis)])
        if found.dtype == np.float32:
            self.precision = SINGLE
        if basis is not None and name == _CONSTANT_AROUND:
            words = f"{name} is constant around each node; between nodes it was interpolated"
            self.warnings = [*self.warnings, words]


@dataclass(frozen=True, eq=False, kw_only=True)
class _MappedPlaces(NodalValues):
    """Places of the cells of a structured mesh by its mapping.

    size  numbers of cells along each direction
    """

    mapping: Mapping
    size: Ints

    def at(self, rows: slice | Ints, points: Floats) -> Floats:
        """(r, n, d) places at reference points (n, d) of elements ``rows``."""
        own = in_cells(self.size, np.arange(int(np.prod(self.size)))[rows], points)
        return self.mapping.at(own.reshape(-1, len(self.size))).reshape(own.shape)


@dataclass(frozen=True)
class Head:
    """The header of a solution."""

    dimension: int
    order: int
    count: int
    variables: int


def _head(path: Path) -> Head:
    with reading(path) as file:
        order, count, variables = (number(file, name) for name in ("polydeg", "n_elements", "n_vars"))
        if not 0 <= order <= _HIGHEST or count < 1 or variables < 0:
            expected = f"a degree from 0 to {_HIGHEST} on some elements"
            raise FormatError(f"expected {expected}, found {order:g} on {count:g}", place="polydeg")
        return Head(dimension_of(file), int(order), int(count), int(variables))


def _kind(path: Path) -> str:
    """``mesh``, ``solution``, ``other`` for what a mesh names; empty for any other file."""
    if leading(path, 5) in _P4EST or is_plane_mesh(path):
        return "other"
    if not holds(path):
        return ""
    names = _attribute_names(path)
    if not {"mesh_type", "ndims"} <= names:
        return ""
    return "solution" if {"mesh_file", "polydeg"} <= names else "mesh"


def _attribute_names(path: Path) -> set[str]:
    try:
        with reading(path) as file:
            return set(file.attrs)
    except FormatError:
        return set()


def _mesh_of(solution: Path) -> Path:
    """The mesh that a solution names."""
    with reading(solution) as file:
        name = text(attribute(file, "mesh_file"))
        return next_to(solution.parent, name, [])


def _places(file: h5py.File, kind: str, count: int | None) -> Iterator[str]:
    """The datasets of a kind: as many as the file declares, or all that follow each other."""
    number = 1
    while (number <= count) if count is not None else (f"{kind}_{number}" in file):
        yield f"{kind}_{number}"
        number += 1


def _unused(name: str, taken: set[str]) -> str:
    """The name of a variable, with a number if another one has it."""
    number, own = 2, name or "unnamed"
    while own in taken:
        own, number = f"{name}_{number}", number + 1
    taken.add(own)
    return own
