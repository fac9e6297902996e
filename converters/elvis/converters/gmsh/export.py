"""Export to Gmsh: a mesh (MSH 4.1) with shared corners, and the fields as values at the nodes of each element.

Boundaries and regions become physical groups of their names.  The library opens no prisms of order 3 or more, so these
are written as collapsed hexahedra.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import compress
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np

from elvis.converters.shared.apart import ignore_closed_pipes
from elvis.converters.shared.exporting import Cell, Export, Piece, Target, exported, left_out, title
from elvis.converters.shared.unit import UNIT
from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Mesh
from elvis.core.distances.boundaries import boundaries
from elvis.core.files.output import replacing
from elvis.core.mapping.orientation import local_vertices
from elvis.core.shapes import Shape
from elvis.plugins.conversion.exporting import Loss, require
from elvis.plugins.conversion.nodal import affine_image, nearest_nodes
from elvis.plugins.projection.naming import local_sides

_FAMILIES = {
    Shape.SEGMENT: "Line",
    Shape.TRIANGLE: "Triangle",
    Shape.QUADRILATERAL: "Quadrangle",
    Shape.TETRAHEDRON: "Tetrahedron",
    Shape.PYRAMID: "Pyramid",
    Shape.PRISM: "Prism",
    Shape.HEXAHEDRON: "Hexahedron",
}


#: dimensions of elements, and further tags by which composites may hold them
_ANY = {(1, "E"), (2, "F")}


class GmshTarget(Target):
    """The library's complete elements; a context, for the library has a beginning and an end."""

    highest, highest_pyramid, highest_prism = 9, 2, 2

    def __enter__(self) -> GmshTarget:
        self._session = _session()
        self.gmsh: Any = self._session.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.__exit__(kind, error, trace)

    def cell(self, shape: Shape, order: int) -> Cell:
        """The library's own nodes."""
        number = self.gmsh.model.mesh.getElementType(_FAMILIES[shape], order)
        nodes, frame = self._frame(number, shape)
        return Cell(shape, order, number, affine_image(nodes, frame, shape.vertices))

    def table(self, cell: Cell, points: Floats) -> Floats:
        """The functions as the library evaluates them."""
        _, frame = self._frame(cell.number, cell.shape)
        padded = np.zeros((len(points), 3))
        padded[:, : cell.shape.dimension] = affine_image(points, cell.shape.vertices, frame)
        found = self.gmsh.model.mesh.getBasisFunctions(cell.number, padded.reshape(-1), "Lagrange")[1]
        return np.asarray(found, np.float64).reshape(len(points), -1)

    def _frame(self, number: int, shape: Shape) -> tuple[Floats, Floats]:
        """The library's nodes of a type, and those at our vertices."""
        _, dimension, _, count, local, _ = self.gmsh.model.mesh.getElementProperties(number)
        nodes = np.asarray(local, np.float64).reshape(count, -1)[:, :dimension]
        return nodes, nodes[UNIT[shape].corners]


@contextmanager
def _session() -> Iterator[Any]:
    """The library, begun and ended here, or a model of its own in one that is at work."""
    import gmsh

    is_ours = not gmsh.isInitialized()
    if is_ours:
        gmsh.initialize(["elvis"], readConfigFiles=False, interruptible=False)
        ignore_closed_pipes()
    options = ("General.Terminal", "General.AbortOnError")
    before = {name: gmsh.option.getNumber(name) for name in options}
    current = None if is_ours else gmsh.model.getCurrent()
    for name in options:
        gmsh.option.setNumber(name, 0)
    try:
        yield gmsh
    finally:
        if is_ours:
            gmsh.finalize()
        else:
            gmsh.model.remove()
            gmsh.model.setCurrent(current)
            for name, value in before.items():
                gmsh.option.setNumber(name, value)


def export_msh(
    dataset: Dataset,
    names: Sequence[str] | None,
    order: int | None,
    path: Path,
    report: Callable[[Sequence[Loss]], object],
) -> list[str]:
    """The exporter of .msh files (see `elvis.plugins.conversion.exporting.Exporter`)."""
    require("gmsh", "gmsh")
    with GmshTarget() as target:
        found = exported(dataset, names, order, target)
        report(found.losses)
        written = write_msh(path, found, dataset.mesh, target, dataset.time)
    # the time stands with the fields
    return left_out(dataset, written, has_time=bool(found.names))


def write_msh(path: Path, export: Export, mesh: Mesh, target: GmshTarget, time: float | None) -> set[str]:
    """A binary .msh file: elements and sides by physical group, then a section of data for each field.

    Returns the names of the groups.
    """
    gmsh = target.gmsh
    gmsh.model.add("export")
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    model = _Model(target, mesh)
    tags = []
    for piece in export.pieces:
        model.add(piece)
        tags.append(_tags(piece))
    model.add_sides()
    model.name_groups()
    with replacing(path) as temporary:
        gmsh.write(str(temporary))
        _check_whole(temporary)
        with temporary.open("ab") as file:
            for i, name in enumerate(export.names):
                _write_field(file, name, time, export, i, tags)
    return {name for _, name in model.groups}


def _check_whole(path: Path) -> None:
    """Raise OSError if the library has not come to the end of the file: it says nothing of a disk that is full."""
    end = b"$EndElements"
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 2 * len(end)))
        if not file.read().rstrip().endswith(end):
            raise OSError("Gmsh could not write all of it, is the disk full?")


def _tags(piece: Piece) -> Ints:
    """Numbers of the elements: the ids, counted from 1."""
    return piece.patch.element_ids + 1


class _Model:
    """The library's model of a mesh, built step by step: an entity for each part of a piece with one name."""

    def __init__(self, target: GmshTarget, mesh: Mesh) -> None:
        self._target, self._gmsh, self._mesh = target, target.gmsh, mesh
        self._next_node, self._is_there = len(mesh.vertex_ids) + 1, np.zeros(len(mesh.vertex_ids), bool)
        self.groups: dict[tuple[int, str], list[int]] = {}
        self._entities = 0
        self._pieces: list[tuple[Piece, Ints]] = []
        self._next_element = 1

    def add(self, piece: Piece) -> None:
        """Add the elements of a piece, by region."""
        shape, cell = piece.patch.shape, piece.cell
        corners = nearest_nodes(cell.nodes, cell.shape.vertices)
        rows = self._mesh.of(shape).rows_of(piece.patch.element_ids)
        own = local_vertices(self._mesh, shape)[rows][:, piece.corners]
        inner = np.setdiff1d(np.arange(len(cell.nodes)), corners)
        nodes = np.empty((len(rows), len(cell.nodes)), np.int64)
        nodes[:, inner] = self._next_node + np.arange(len(rows) * len(inner)).reshape(len(rows), -1)
        nodes[:, corners] = own + 1
        self._next_node += len(rows) * len(inner)
        self._next_element = max(self._next_element, int(_tags(piece).max(initial=0)) + 1)
        self._pieces.append((piece, nodes))
        for names, part in self._regions(piece):
            entity = self._entity(shape.dimension, *names)
            self._add_nodes(shape.dimension, entity, piece, part, (corners, inner, own[part], nodes[part]))
            self._gmsh.model.mesh.addElementsByType(entity, cell.number, _tags(piece)[part], nodes[part].reshape(-1))

    def _add_nodes(
        self, dimension: int, entity: int, piece: Piece, part: Ints, numbers: tuple[Ints, Ints, Ints, Ints]
    ) -> None:
        """Add the nodes inside of some elements, and those corners that are not there yet."""
        corners, inner, own, nodes = numbers
        new = np.unique(own.reshape(-1))
        new = new[~self._is_there[new]]
        self._is_there[new] = True
        places = np.empty((len(self._mesh.vertices), 3))
        places[own.reshape(-1)] = piece.places[part][:, corners].reshape(-1, 3)
        inside = piece.places[part][:, inner].reshape(-1, 3)
        self._gmsh.model.mesh.addNodes(
            dimension,
            entity,
            np.concatenate([new + 1, nodes[:, inner].reshape(-1)]),
            np.concatenate([places[new], inside]).reshape(-1),
        )

    def _regions(self, piece: Piece) -> Iterator[tuple[list[str], Ints]]:
        """Names of the regions, which may overlap, and the rows of the elements of a piece that are only in these."""
        ids, shape = piece.patch.element_ids, piece.patch.shape
        titles, is_in = [], [np.empty((0, len(ids)), bool)]
        for composite in self._mesh.composites:
            held = [own for tag, own in composite.parts if tag == shape.tag or (shape.dimension, tag) in _ANY]
            if held:
                titles.append(title(composite, self._mesh))
                is_in.append(np.isin(ids, np.concatenate(held))[None])
        patterns, which = np.unique(np.concatenate(is_in), axis=1, return_inverse=True)
        for number, pattern in enumerate(patterns.T):
            names = list(compress(titles, pattern)) or [shape.label.lower()]
            yield list(dict.fromkeys(names)), np.flatnonzero(which.reshape(-1) == number)

    def add_sides(self) -> None:
        """Add the sides that boundaries name, each as a cell on the nodes of one element."""
        if self._mesh.dimension < 2:
            return
        for composite in self._mesh.composites:
            wanted = boundaries(replace(self._mesh, composites=(composite,))).get(str(composite.id))
            if wanted is None or not len(wanted):
                continue
            name, left = title(composite, self._mesh), set(wanted.tolist())
            for piece, nodes in self._pieces:
                for kind, sides in self._sides(piece, nodes, left):
                    entity = self._entity(self._mesh.dimension - 1, name)
                    tags = self._next_element + np.arange(len(sides))
                    self._next_element += len(sides)
                    self._gmsh.model.mesh.addElementsByType(entity, kind, tags, sides.reshape(-1))

    def _sides(self, piece: Piece, nodes: Ints, left: set[int]) -> Iterator[tuple[int, Ints]]:
        """Types of cells, and nodes (n, k) of the sides of a piece that are in ``left``, from where they go."""
        shape, cell = piece.patch.shape, piece.cell
        rows = self._mesh.of(shape).rows_of(piece.patch.element_ids)
        members = self._mesh.of(shape).members[rows]
        for number, local in enumerate(local_sides(shape)):
            here = [row for row, side in enumerate(members[:, number].tolist()) if side in left]
            left.difference_update(members[here, number].tolist())
            if here:
                side = next(each for each in local_sides(cell.shape) if set(piece.corners[list(each)]) == set(local))
                kind, places = self._side_cell(cell, side)
                yield kind, nodes[here][:, nearest_nodes(cell.nodes, places)]

    def _side_cell(self, cell: Cell, side: tuple[int, ...]) -> tuple[int, Floats]:
        """The type of the cells of a side, and where their nodes lie in the cell that it is a side of."""
        kind = {2: Shape.SEGMENT, 3: Shape.TRIANGLE, 4: Shape.QUADRILATERAL}[len(side)]
        own, corners = self._target.cell(kind, cell.order), cell.shape.vertices[list(side)]
        axes = corners[[1, 3]] if kind is Shape.QUADRILATERAL else corners[1:]
        return own.number, corners[0] + (1 + own.nodes) / 2 @ (axes - corners[0])

    def _entity(self, dimension: int, *names: str) -> int:
        """A new entity, in the physical groups of these names."""
        self._entities += 1
        self._gmsh.model.addDiscreteEntity(dimension, self._entities)
        for name in names:
            # the format ends names at quotation marks
            self.groups.setdefault((dimension, name.replace(chr(34), chr(39))), []).append(self._entities)
        return self._entities

    def name_groups(self) -> None:
        """Make physical groups of the entities of one name."""
        for number, ((dimension, name), entities) in enumerate(self.groups.items(), 1):
            self._gmsh.model.addPhysicalGroup(dimension, entities, number, name)


def _write_field(file: BinaryIO, name: str, time: float | None, export: Export, number: int, tags: list[Ints]) -> None:
    """A binary section $ElementNodeData of one component."""
    held = [(own, piece.values[number]) for own, piece in zip(tags, export.pieces, strict=True)]
    count = sum(len(own) for own, values in held if values is not None)
    stamp = "0" if time is None else f"1\n{time!r}"
    head = f'$ElementNodeData\n1\n"{name}"\n{stamp}\n3\n0\n1\n{count}\n'
    file.write(head.encode())
    for own, values in held:
        if values is not None:
            width = values.shape[1]
            lines = np.empty(len(own), [("head", "<i4", (2,)), ("values", "<f8", (width,))])
            lines["head"][:, 0], lines["head"][:, 1], lines["values"] = own, width, values
            file.write(lines.tobytes())
    file.write(b"\n$EndElementNodeData\n")
