"""HOPR meshes and FLEXI or GALAEXI states: HDF5 files with elements as they stand.

A mesh holds the evenly spaced nodes of every element, a state the values at the tensor product of Gauss or
Gauss-Lobatto nodes, or in some elements the means of finite-volume sub-cells.  Each of these becomes an element with
a constant value.  The state names its mesh, which is sought next to it.  Layout: HOPR documentation, mesh format.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os.path import isfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elvis.converters.shared.hdf5 import (
    attribute,
    attributes,
    floats,
    holds,
    ints,
    number,
    reading,
    require,
    text,
    texts,
)
from elvis.converters.shared.inputs import check_roles, check_rows
from elvis.converters.shared.unit import UNIT, lattice, unit_basis
from elvis.core.base.arrays import Bools, Floats, Ints, joined_columns, rows_by_number
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import PERIODIC
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import (
    NodalBasis,
    NodalBlock,
    NodalConverter,
    NodalValues,
    nearest_nodes,
    tensor_nodes,
)
from elvis.plugins.conversion.plugin import Boundary, Elements, PyramidSpace, Reads

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: last digit of an element's type: its number of corners
_SHAPES = {4: Shape.TETRAHEDRON, 5: Shape.PYRAMID, 6: Shape.PRISM, 8: Shape.HEXAHEDRON}

#: our local side for each of the file's, by number of corners
_SIDES = {6: (4, 2, 0, 1, 3)}

_MOST_SMALL_SIDES = 4
#: the type of boundary conditions that identify sides
_PERIODIC = 1

#: maximum order; number of columns of ElemInfo
_HIGHEST, _COLUMNS = 30, 6

_NODES = {"GAUSS": gauss, "GAUSS-LOBATTO": lobatto}


class Hopr(NodalConverter):
    """A mesh, with the state that goes with it."""

    format = "HOPR mesh and FLEXI/GALAEXI state (HDF5)"
    keeps = "curved elements of all shapes and orders, boundaries, all variables of DG_Solution, sub-cells, time"
    loses = "element data, extra fields"
    reads = Reads(
        "volumes",
        "any",
        "Gauss, Gauss-Lobatto, sub-cells",
        "by name",
        "numbered files",
        "none",
        "mortars",
        "no",
    )

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether every file is a HOPR mesh or a state that names one."""
        return all(holds(path, "ElemInfo", "NodeCoords") or holds(path, "DG_Solution") for path in paths)

    @classmethod
    def hint(cls, path: Path) -> str:
        """Other files of FLEXI's, such as wall distances."""
        return _other_kind(path)

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The time of the state."""
        _, state = _roles(paths)
        if state is None:
            return ()
        with reading(state) as file:
            return [number(file, "Time")]

    def __init__(self, paths: Sequence[Path]) -> None:
        mesh, state = _roles(paths)
        self.further_files = [mesh]
        with reading(mesh) as file:
            self._read_mesh(file)
            self.declared = _declared(file)
        if state is not None:
            with reading(state) as file:
                self._read_state(file)

    def _read_mesh(self, file: h5py.File) -> None:
        order = int(number(file, "Ngeo"))
        if not 1 <= order <= _HIGHEST:
            raise FormatError(f"expected an order from 1 to {_HIGHEST}, found {order}", place="Ngeo")
        info, ids = ints(file, "ElemInfo", None, None), ints(file, "GlobalNodeIDs", None)
        coordinates = floats(file, "NodeCoords", len(ids), 3)
        if info.shape[1] < _COLUMNS:
            raise FormatError(f"expected {_COLUMNS} numbers an element, found {info.shape[1]}", place="ElemInfo")
        self._info = info
        self.blocks = []
        for corners in np.unique(info[:, 0] % 10).tolist():
            if corners not in _SHAPES:
                raise FormatError(f"expected elements of 4, 5, 6 or 8 corners, found {corners}", file=file.filename)
            shape, rows = _SHAPES[corners], np.flatnonzero(info[:, 0] % 10 == corners)
            places = lattice(shape, order)
            nodes = info[rows, 4:5] + np.arange(len(places))
            if (info[rows, 5] - info[rows, 4] != len(places)).any():
                expected = f"{len(places)} nodes for each element of {corners} corners"
                raise FormatError(f"expected {expected}, found another number", file=file.filename, place="ElemInfo")
            check_rows(nodes, len(ids), "nodes", place="ElemInfo")
            local = nearest_nodes(places, order * UNIT[shape].frame)
            vertices = ids[nodes[:, local]]
            own = NodalBlock(NodalValues(coordinates, unit_basis(shape, order, places / order), nodes))
            space = PyramidSpace.RATIONAL
            self.blocks.append(Elements(shape, len(rows), order, vertices, ids=rows, pyramid=space, key=own))
        self.boundaries = self._boundaries(file)

    def _boundaries(self, file: h5py.File) -> list[Boundary]:
        """Sides by the number of their boundary condition; 0 is inside."""
        sides, names = ints(file, "SideInfo", None, None), texts(file, "BCNames")
        if sides.shape[1] < _COLUMNS - 1:
            raise FormatError(f"expected {_COLUMNS - 1} numbers a side, found {sides.shape[1]}", place="SideInfo")
        found: list[list[tuple[int, Ints, Ints]]] = [[] for _ in names]
        mortars, periodic = [], []
        is_identified = _are_identified(sides, _periodic_conditions(file, len(names)))
        for index, block in enumerate(self.blocks):
            count = len(block.shape.faces)
            numbers = self._sides_of(block, sides, file)
            order = np.array(_SIDES.get(len(block.shape.vertices), range(count)))
            for condition, own in enumerate(found, 1):
                rows, local = np.nonzero(sides[numbers, 4] == condition)
                own.append((index, rows, order[local]))
            is_mortar = (_small_sides(sides[numbers, 2]) > 0) | (sides[numbers, 0] < 0)
            rows, local = np.nonzero(is_mortar & ~is_identified[numbers])
            mortars.append((index, rows, order[local]))
            rows, local = np.nonzero(is_identified[numbers])
            periodic.append((index, rows, order[local]))
        self.mortars = [own for own in mortars if len(own[1])]
        self.is_conforming = not self.mortars
        named = zip([*names, PERIODIC], [*found, periodic], strict=True)
        return [Boundary(name, sides=own) for name, own in named]

    def _sides_of(self, block: Elements, sides: Ints, file: h5py.File) -> Ints:
        """(n, faces) rows of SideInfo of the elements of a block.

        The small sides of a mortar follow the big one, so entries of an element may be more than its faces.
        """
        ids = np.arange(len(self._info)) if block.ids is None else block.ids
        first, last = self._info[ids, 2], self._info[ids, 3]
        count = len(block.shape.faces)
        check_rows(np.stack([first, last - 1]), len(sides), "sides", place="ElemInfo")
        numbers = np.empty((len(first), count), np.int64)
        place = first.copy()
        for face in range(count):
            numbers[:, face] = np.minimum(place, len(sides) - 1)
            place = numbers[:, face] + 1 + _small_sides(sides[numbers[:, face], 2])
        wrong = np.flatnonzero(place != last)
        if len(wrong):
            expected = f"{count} sides of element {ids[wrong[0]] + 1} with the small sides of its mortars"
            found = f"{last[wrong[0]] - first[wrong[0]]} entries"
            raise FormatError(f"expected {expected}, found {found}", file=file.filename, place="SideInfo")
        return numbers

    def _read_state(self, file: h5py.File) -> None:
        values = require(file, "DG_Solution")
        if any(block.shape is not Shape.HEXAHEDRON for block in self.blocks):
            raise FormatError("expected a mesh of hexahedra for a state, found other elements", file=file.filename)
        if values.ndim != 5 or len(values) != len(self._info) or values.dtype.kind != "f":
            found = f"an array of shape {values.shape}"
            expected = f"values on the {len(self._info)} elements of the mesh"
            raise FormatError(f"expected {expected}, found {found}", file=file.filename, place="DG_Solution")
        names = [text(name) for name in attributes(file, "VarNames")]
        kind = text(attribute(file, "NodeType")).upper()
        if kind not in _NODES or len(names) != values.shape[4]:
            expected = f"GAUSS or GAUSS-LOBATTO nodes and {values.shape[4]} names"
            raise FormatError(f"expected {expected}, found {kind} nodes and {len(names)}", file=file.filename)
        count = values.shape[3]
        if values.shape[1] not in (1, count) or values.shape[2] != count or not 1 <= count <= _HIGHEST + 1:
            expected = f"the same number of nodes in each direction, up to {_HIGHEST + 1}"
            raise FormatError(f"expected {expected}, found an array of shape {values.shape}", place="DG_Solution")
        nodes = tensor_nodes(Shape.HEXAHEDRON, tuple(_NODES[kind](count)[0].tolist()))
        basis = NodalBasis(Shape.HEXAHEDRON, count - 1, nodes)
        filled = np.asarray(values, np.float64)
        if values.shape[1] == 1 < count:  # two-dimensional: constant along the third direction
            filled = np.repeat(filled, count, axis=1)
        own = filled.reshape(len(filled), -1, len(names))
        marks = self._marks(file)
        if marks.any():
            self._part_subcells(file, count, marks)
            means = own[marks].reshape(-1, 1, len(names))
            self.add_field("solution", names, [NodalValues(own[~marks], basis), NodalValues(means, None)])
        else:
            self.add_field("solution", names, [NodalValues(own, basis)])
        self.time = number(file, "Time")
        self.metadata = {key: text(attribute(file, key)) for key in ("Program", "Project_Name") if key in file.attrs}

    def _marks(self, file: h5py.File) -> Bools:
        """(n,) whether elements hold sub-cells."""
        none = np.zeros(len(self._info), bool)
        names = [text(name) for name in attributes(file, "VarNamesAdd")] if "VarNamesAdd" in file.attrs else []
        if "FV_Elems" not in names or "ElemData" not in file:
            return none
        data, column = require(file, "ElemData"), names.index("FV_Elems")
        if data.ndim != 2 or data.shape[0] != len(self._info) or data.shape[1] <= column:
            expected = f"({len(self._info)}, {len(names)}) numbers"
            raise FormatError(f"expected {expected}, found {data.shape}", file=file.filename, place="ElemData")
        return np.asarray(data[:, column], np.float64) > 0.5

    def _part_subcells(self, file: h5py.File, count: int, marks: Bools) -> None:
        """Elements that hold ``count`` sub-cells in each direction make a block of these."""
        (block,) = self.blocks
        rows = np.flatnonzero(~marks)
        geometry = self.nodal(block).geometry
        assert geometry.nodes is not None
        places = replace(geometry, nodes=geometry.nodes[rows])
        whole = replace(block.take(rows), key=NodalBlock(places), rows=slice(None))
        cells = SubCells(**vars(geometry), elements=np.flatnonzero(marks), widths=_widths(file, count))
        total = len(cells.elements) * count**3
        ids = len(marks) + np.arange(total)
        parts = Elements(block.shape, total, block.order, ids=ids, key=NodalBlock(cells))
        self.blocks, self.is_conforming, self.mortars = [whole, parts], False, []
        self.boundaries = [cells.parted(boundary, rows) for boundary in self.boundaries]
        self.declared = Declared(len(rows) + total)
        self.notes = [
            f"{len(cells.elements)} elements contain finite-volume sub-cells: "
            f"each was split into {count**3} elements with constant mean values"
        ]


@dataclass(frozen=True, eq=False, kw_only=True)
class SubCells(NodalValues):
    """Places in boxes of some hexahedra, all of one element together, the first direction fastest.

    elements  (k,) rows of the hexahedra
    widths    (n,) of the boxes along each direction; their sum is 2
    """

    elements: Ints
    widths: Floats

    @property
    def count(self) -> int:
        """Number of boxes in each direction."""
        return len(self.widths)

    def at(self, rows: slice | Ints, points: Floats) -> Floats:
        """(r, n, 3) where points (n, 3) of boxes ``rows`` lie, by the map of the hexahedra."""
        chosen = np.arange(len(self.elements) * self.count**3)[rows]
        own, box = np.divmod(chosen, self.count**3)
        ends = np.concatenate([[-1.0], np.cumsum(self.widths) - 1])
        result = np.empty((len(own), len(points), 3))
        for each, here in rows_by_number(box):
            place = np.array([each, each // self.count, each // self.count**2]) % self.count
            inside = ends[place] + self.widths[place] * (1 + points) / 2
            result[here] = super().at(self.elements[own[here]], inside)
        return result

    def parted(self, boundary: Boundary, others: Ints) -> Boundary:
        """A boundary of one block of hexahedra, with its sides on ``others`` and on boxes as blocks 0 and 1."""
        ((_, rows, faces),) = boundary.sides
        is_other = np.isin(rows, others)
        place = np.searchsorted(others, rows[is_other])
        own, sides = np.searchsorted(self.elements, rows[~is_other]), faces[~is_other]
        grid = np.arange(self.count**3)
        found: list[tuple[Ints, Ints]] = [(np.empty(0, np.int64), np.empty(0, np.int64))]
        for face, local in enumerate(Shape.HEXAHEDRON.faces):
            corners = Shape.HEXAHEDRON.vertices[list(local)]
            axis = int(np.flatnonzero(np.ptp(corners, axis=0) == 0)[0])
            last = 0 if corners[0, axis] < 0 else self.count - 1
            outer = np.flatnonzero(grid // self.count**axis % self.count == last)
            boxes = (own[sides == face][:, None] * self.count**3 + outer).reshape(-1)
            found.append((boxes, np.full(len(boxes), face)))
        boxes, local_faces = joined_columns(found)
        return Boundary(boundary.name, sides=[(0, place, faces[is_other]), (1, boxes, local_faces)])


def _periodic_conditions(file: h5py.File, count: int) -> Ints:
    """Numbers of the periodic boundary conditions: the conditions of type 1, or all if the file has no types."""
    numbers = np.arange(1, count + 1)
    if "BCType" not in file:
        return numbers
    types = ints(file, "BCType", None, None)
    return numbers[types[:count, 0] == _PERIODIC] if len(types) == count and types.shape[1] else numbers[:0]


def _are_identified(sides: Ints, conditions: Ints) -> Bools:
    """(n,) which sides with one of some boundary conditions are identified with sides of other elements."""
    return np.asarray(np.isin(sides[:, 4], conditions) & (sides[:, 2] != 0))


def _declared(file: h5py.File) -> Declared:
    """The number of elements, and of their sides that have each boundary condition."""
    sides, names = ints(file, "SideInfo", None, None), texts(file, "BCNames")
    conditions = sides[~_are_parts(sides), 4]
    counts: dict[str, int] = {}
    for condition, count in zip(*(own.tolist() for own in np.unique(conditions, return_counts=True)), strict=True):
        if condition > 0:
            name = names[condition - 1] if condition <= len(names) else f"condition {condition} (without a name)"
            counts[name] = counts.get(name, 0) + count
    return Declared(int(number(file, "nElems")) if "nElems" in file.attrs else None, counts)


def _small_sides(neighbours: Ints) -> Ints:
    """Number of small sides after each side, from its neighbour's number, which is -1, -2 or -3 for mortars."""
    return np.where(neighbours == -1, 4, np.where((neighbours == -2) | (neighbours == -3), 2, 0))


def _are_parts(sides: Ints) -> Bools:
    """(n,) which entries repeat small sides of other elements, after the big side of a mortar that they belong to."""
    small = _small_sides(sides[:, 2])
    found = np.zeros(len(sides), bool)
    for distance in range(1, _MOST_SMALL_SIDES + 1):
        found[distance:] |= small[:-distance] >= distance
    return found


def _widths(file: h5py.File, count: int) -> Floats:
    """(count,) widths of sub-cells in the reference element: from the file, or else equal."""
    if "FV_w" not in file.attrs:
        return np.full(count, 2 / count)
    widths = np.asarray(attributes(file, "FV_w"), np.float64)
    widths = np.repeat(widths, count) if len(widths) == 1 else widths
    if len(widths) != count or not (widths > 0).all() or not np.isclose(widths.sum(), 2):
        raise FormatError(f"expected {count} widths with sum 2, found {widths}", file=file.filename, place="FV_w")
    return widths


def _other_kind(path: Path) -> str:
    """A description of an HDF5 file of FLEXI's tools that is neither mesh nor state, with advice; empty for others."""
    import h5py

    if not path.is_file() or not h5py.is_hdf5(path):
        return ""
    try:
        with reading(path) as file:
            kind = text(attribute(file, "File_Type")) if "File_Type" in file.attrs else ""
            distances = [name for name in file if "walldist" in name.lower()]
    except FormatError:
        return ""
    if distances or "walldist" in kind.lower():
        return "distances to walls of FLEXI, without a solution: give a state file, with its mesh next to it"
    return f"a FLEXI file of the kind {kind}, without DG_Solution: give a state file" if kind else ""


def _roles(paths: Sequence[Path]) -> tuple[Path, Path | None]:
    """The mesh, and the state where there is one; the mesh that a state names is sought next to it."""
    meshes = [path for path in paths if holds(path, "ElemInfo", "NodeCoords")]
    states = [path for path in paths if path not in meshes]
    if meshes or len(states) > 1:
        check_roles(len(meshes), len(states), "state")
        return meshes[0], states[0] if states else None
    with reading(states[0]) as file:
        name = text(attribute(file, "MeshFile"))
    mesh = states[0].parent / Path(name).name
    if not isfile(mesh):
        raise FormatError(f"expected its mesh {name} next to it, found none; also give the mesh file", file=states[0])
    return mesh, states[0]
