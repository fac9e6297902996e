"""HOPR meshes and FLEXI or GALAEXI states: HDF5 files with elements as they stand.

A mesh holds the evenly spaced nodes of every element, a state the values at the tensor product of Gauss or
Gauss-Lobatto nodes, or in some elements the means of finite-volume sub-cells.  Each of these becomes an element with
a constant value.  The state names its mesh, which is sought beside it.  Layout: HOPR documentation, mesh format.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elvis.converters.hdf5 import attribute, attributes, floats, holds, ints, number, opened, require, text, texts
from elvis.converters.subcells import SubCells
from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion import Boundary, Converter, Elements, PyramidSpace, SourceField
from elvis.plugins.nodal import NodalBasis

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: last digit of an element's type: its number of corners
_SHAPES = {4: Shape.TETRAHEDRON, 5: Shape.PYRAMID, 6: Shape.PRISM, 8: Shape.HEXAHEDRON}

#: the file's corner at each local vertex, and the file's side at each local side; prisms are given as two triangles
_CORNERS = {6: (0, 2, 5, 3, 1, 4)}
_SIDES = {6: (4, 2, 0, 1, 3)}

#: of orders; of columns of ElemInfo
_HIGHEST, _COLUMNS = 30, 6

_NODES = {"GAUSS": gauss, "GAUSS-LOBATTO": lobatto}


class Hopr(Converter):
    """A mesh, with the state that goes with it."""

    format = "HOPR mesh and FLEXI/GALAEXI state (HDF5)"
    keeps = "curved elements of all shapes and orders, boundaries, all variables of DG_Solution, sub-cells, time"
    loses = "element data, extra fields"

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether every file is a HOPR mesh or a state that names one."""
        return all(holds(path, "ElemInfo", "NodeCoords") or holds(path, "DG_Solution") for path in paths)

    @classmethod
    def hint(cls, path: Path) -> str:
        """Other files of FLEXI's, such as wall distances."""
        return _other_kind(path)

    def __init__(self, paths: Sequence[Path]) -> None:
        mesh, state = _roles(paths)
        with opened(mesh) as file:
            self._read_mesh(file)
        if state is not None:
            with opened(state) as file:
                self._read_state(file)

    def positions(self, block: Elements, points: Floats) -> Floats:
        """Interpolation through the evenly spaced nodes."""
        if isinstance(block.key, SubCells):
            return block.key.positions(block.rows, points, self._geometry[block.shape], self._nodes[block.shape])
        rows = block.rows if block.key is None else block.key[block.rows]
        table = self._geometry[block.shape].at(points)
        return np.asarray(np.einsum("eni,pn->epi", self._nodes[block.shape][rows], table))

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """Interpolation through the nodes of the state; the mean of a sub-cell."""
        values = self._values[field.key]
        if isinstance(block.key, SubCells):
            return np.repeat(block.key.values(block.rows, values)[:, None], len(points), axis=1)
        rows = block.rows if block.key is None else block.key[block.rows]
        return np.asarray(values[rows] @ self._basis.at(points).T)

    def _read_mesh(self, file: h5py.File) -> None:
        order = int(number(file, "Ngeo"))
        if not 1 <= order <= _HIGHEST:
            raise FormatError(f"expected an order from 1 to {_HIGHEST}, found {order}", place="Ngeo")
        info, ids = ints(file, "ElemInfo", None, None), ints(file, "GlobalNodeIDs", None)
        coordinates = floats(file, "NodeCoords", len(ids), 3)
        if info.shape[1] < _COLUMNS:
            raise FormatError(f"expected {_COLUMNS} numbers an element, found {info.shape[1]}", place="ElemInfo")
        self._info, self._geometry, self._nodes = info, {}, {}
        self.blocks = []
        for corners in np.unique(info[:, 0] % 10).tolist():
            if corners not in _SHAPES:
                raise FormatError(f"expected elements of 4, 5, 6 or 8 corners, found {corners}", file=file.filename)
            rows = np.flatnonzero(info[:, 0] % 10 == corners)
            lattice, vertices = _lattice(corners, order)
            nodes = info[rows, 4:5] + np.arange(len(lattice))
            if (info[rows, 5] - info[rows, 4] != len(lattice)).any():
                expected = f"{len(lattice)} nodes for each element of {corners} corners"
                raise FormatError(f"expected {expected}, found another number", file=file.filename, place="ElemInfo")
            _check_rows(nodes, len(ids), "nodes", "ElemInfo")
            shape, space = _SHAPES[corners], PyramidSpace.RATIONAL
            self._geometry[shape] = NodalBasis(shape, order, _own(corners, lattice, order), space)
            self._nodes[shape] = coordinates[nodes]
            own = ids[nodes[:, vertices]]
            self.blocks.append(Elements(shape, len(rows), order, own, ids=rows, pyramid=space))
        self.boundaries = self._boundaries(file)

    def _boundaries(self, file: h5py.File) -> list[Boundary]:
        """Sides by the number of their boundary condition; 0 is inside."""
        sides, names = ints(file, "SideInfo", None, None), texts(file, "BCNames")
        if sides.shape[1] < _COLUMNS - 1:
            raise FormatError(f"expected {_COLUMNS - 1} numbers a side, found {sides.shape[1]}", place="SideInfo")
        result = []
        for condition, name in enumerate(names, 1):
            found = []
            for index, block in enumerate(self.blocks):
                corners = len(block.shape.vertices)
                first, count = self._info[block.ids, 2], len(block.shape.faces)
                numbers = first[:, None] + np.arange(count)
                _check_rows(numbers, len(sides), "sides", "ElemInfo")
                rows, local = np.nonzero(sides[numbers, 4] == condition)
                order = np.array(_SIDES.get(corners, range(count)))
                found.append((index, rows, order[local]))
            result.append(Boundary(name, sides=found))
        return result

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
            expected = f"as many nodes each way, up to {_HIGHEST + 1}"
            raise FormatError(f"expected {expected}, found an array of shape {values.shape}", place="DG_Solution")
        line = _NODES[kind](count)[0]
        self._basis = NodalBasis(Shape.HEXAHEDRON, count - 1, _tensor(line))
        filled = np.asarray(values, np.float64)
        if values.shape[1] == 1 < count:  # two-dimensional: constant along the third direction
            filled = np.repeat(filled, count, axis=1)
        flat = np.moveaxis(filled, 4, 0).reshape(len(names), len(filled), -1)
        self._values = dict(zip(names, flat, strict=True))
        self._part_subcells(file, count)
        orders = [0 if isinstance(block.key, SubCells) else count - 1 for block in self.blocks]
        self.fields = [SourceField(name, orders, key=name) for name in names]
        self.time = number(file, "Time")
        self.metadata = {key: text(attribute(file, key)) for key in ("Program", "Project_Name") if key in file.attrs}

    def _part_subcells(self, file: h5py.File, count: int) -> None:
        """Elements that hold ``count`` sub-cells each way make a block of these."""
        names = [text(name) for name in attributes(file, "VarNamesAdd")] if "VarNamesAdd" in file.attrs else []
        if "FV_Elems" not in names or "ElemData" not in file:
            return
        data, column = require(file, "ElemData"), names.index("FV_Elems")
        if data.ndim != 2 or data.shape[0] != len(self._info) or data.shape[1] <= column:
            expected = f"({len(self._info)}, {len(names)}) numbers"
            raise FormatError(f"expected {expected}, found {data.shape}", file=file.filename, place="ElemData")
        marks = np.asarray(data[:, column], np.float64) > 0.5
        if not marks.any():
            return
        (block,), cells = self.blocks, SubCells(np.flatnonzero(marks), _widths(file, count))
        rows = np.flatnonzero(~marks)
        assert block.vertices is not None
        whole = Elements(block.shape, len(rows), block.order, block.vertices[rows], ids=rows, key=rows)
        total = len(cells.elements) * count**3
        parts = Elements(block.shape, total, block.order, ids=len(marks) + np.arange(total), key=cells)
        self.blocks, self.is_conforming = [whole, parts], False
        self.boundaries = [cells.parted(boundary, rows) for boundary in self.boundaries]
        self.notes = [
            f"{len(cells.elements)} elements hold finite-volume sub-cells: "
            f"each became {count**3} elements, with the mean of each as a constant"
        ]


def _widths(file: h5py.File, count: int) -> Floats:
    """(count,) widths of sub-cells in the reference element: those of the file, else all the same."""
    if "FV_w" not in file.attrs:
        return np.full(count, 2 / count)
    widths = np.asarray(attributes(file, "FV_w"), np.float64)
    widths = np.repeat(widths, count) if len(widths) == 1 else widths
    if len(widths) != count or not (widths > 0).all() or not np.isclose(widths.sum(), 2):
        raise FormatError(f"expected {count} widths with sum 2, found {widths}", file=file.filename, place="FV_w")
    return widths


def _other_kind(path: Path) -> str:
    """What an HDF5 file of FLEXI's tools holds that is neither mesh nor state, and what to do; empty for others."""
    import h5py

    if not path.is_file() or not h5py.is_hdf5(path):
        return ""
    try:
        with opened(path) as file:
            kind = text(attribute(file, "File_Type")) if "File_Type" in file.attrs else ""
            distances = [name for name in file if "walldist" in name.lower()]
    except FormatError:
        return ""
    if distances or "walldist" in kind.lower():
        return "distances to walls of FLEXI, without a solution: give a state file, with its mesh beside it"
    return f"a FLEXI file of the kind {kind}, without DG_Solution: give a state file" if kind else ""


def _roles(paths: Sequence[Path]) -> tuple[Path, Path | None]:
    """The mesh, and the state where there is one; the mesh that a state names is sought beside it."""
    meshes = [path for path in paths if holds(path, "ElemInfo", "NodeCoords")]
    states = [path for path in paths if path not in meshes]
    if len(meshes) > 1 or len(states) > 1:
        raise FormatError(f"expected one mesh and at most one state, found {len(meshes)} and {len(states)}")
    if meshes:
        return meshes[0], states[0] if states else None
    with opened(states[0]) as file:
        name = text(attribute(file, "MeshFile"))
    mesh = states[0].parent / Path(name).name
    if not mesh.is_file():
        raise FormatError(f"expected its mesh {name} beside it, found none; give the mesh file too", file=states[0])
    return mesh, states[0]


def _check_rows(rows: Ints, count: int, what: str, place: str) -> None:
    """FormatError unless all rows are those of a table of ``count``."""
    if rows.size and not 0 <= rows.min() <= rows.max() < count:
        raise FormatError(f"expected {what} 0 to {count - 1}, found {rows.min()} to {rows.max()}", place=place)


def _lattice(corners: int, order: int) -> tuple[Ints, Ints]:
    """(n, 3) indices of the nodes of an element in the file's order, and the node at each local vertex of ours."""
    k, j, i = np.indices((order + 1,) * 3).reshape(3, -1)
    inside = {4: i + j + k <= order, 5: (i + k <= order) & (j + k <= order), 6: i + j <= order, 8: i >= 0}[corners]
    lattice = np.stack([i, j, k], axis=1)[inside]
    ends = {
        4: [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
        5: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)],
        6: [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
        8: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    }[corners]
    places = [int(np.flatnonzero((lattice == order * np.array(end)).all(axis=1))[0]) for end in ends]
    return lattice, np.array(places)[list(_CORNERS.get(corners, range(corners)))]


def _own(corners: int, lattice: Ints, order: int) -> Floats:
    """(n, 3) reference coordinates, in ours, of the nodes of a lattice; the triangle of a prism lies in (z, x)."""
    points = 2.0 * lattice / order - 1.0
    return points[:, [1, 2, 0]] if corners == 6 else points


def _tensor(line: Floats) -> Floats:
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return np.stack([axis.reshape(-1) for axis in (x, y, z)], axis=1)
