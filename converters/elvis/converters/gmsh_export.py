"""Export to Gmsh: a mesh (MSH 4.1) with shared corners, and the fields as values at the nodes of each element."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np

from elvis.converters.apart import ignore_closed_pipes
from elvis.converters.exporting import Cell, Export, Piece, Target, exported
from elvis.converters.unit import UNIT
from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.files.output import replacing
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mesh import Mesh
from elvis.core.shapes import Shape
from elvis.plugins.exporting import Loss, require
from elvis.plugins.nodal import affine_image, nearest_nodes

_FAMILIES = {
    Shape.SEGMENT: "Line",
    Shape.TRIANGLE: "Triangle",
    Shape.QUADRILATERAL: "Quadrangle",
    Shape.TETRAHEDRON: "Tetrahedron",
    Shape.PYRAMID: "Pyramid",
    Shape.PRISM: "Prism",
    Shape.HEXAHEDRON: "Hexahedron",
}


class GmshTarget(Target):
    """The library's complete elements; a context, for the library has a beginning and an end."""

    highest, highest_pyramid = 9, 2

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
        """As the library evaluates them."""
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
) -> None:
    """The exporter of .msh files (see `elvis.plugins.exporting.Exporter`)."""
    require("gmsh", "gmsh")
    with GmshTarget() as target:
        found = exported(dataset, names, order, target)
        report(found.losses)
        write_msh(path, found, dataset.mesh, target, dataset.time)


def write_msh(path: Path, export: Export, mesh: Mesh, target: GmshTarget, time: float | None) -> None:
    """A binary .msh file: each shape an entity and a physical group, then a section of data for each field."""
    gmsh = target.gmsh
    gmsh.model.add("export")
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    first, tags = len(mesh.vertex_ids) + 1, []
    for number, piece in enumerate(export.pieces, 1):
        first = _add(gmsh, number, piece, mesh, first)
        tags.append(_tags(piece))
    with replacing(path) as temporary:
        gmsh.write(str(temporary))
        _check_whole(temporary)
        with temporary.open("ab") as file:
            for i, name in enumerate(export.names):
                _write_field(file, name, 0.0 if time is None else time, export, i, tags)


def _check_whole(path: Path) -> None:
    """OSError where the library has not come to the end of the file: it says nothing of a disk that is full."""
    end = b"$EndElements"
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 2 * len(end)))
        if not file.read().rstrip().endswith(end):
            raise OSError("Gmsh could not write all of it, is the disk full?")


def _tags(piece: Piece) -> Ints:
    """Numbers of the elements: the ids, counted from 1."""
    return piece.patch.element_ids + 1


def _add(gmsh: Any, entity: int, piece: Piece, mesh: Mesh, first: int) -> int:
    """Add the elements of a piece; the number of the next node."""
    shape, cell = piece.patch.shape, piece.cell
    corners = nearest_nodes(cell.nodes, cell.shape.vertices)
    rows = mesh.of(shape).rows_of(piece.patch.element_ids)
    own = local_vertices(mesh, shape)[rows]
    if piece.is_collapsed:
        own = own[:, [0, 1, 2, 3, 4, 4, 4, 4]]
    nodes = np.empty((len(rows), len(cell.nodes)), np.int64)
    inner = np.setdiff1d(np.arange(len(cell.nodes)), corners)
    nodes[:, inner] = first + np.arange(len(rows) * len(inner)).reshape(len(rows), -1)
    nodes[:, corners] = own + 1

    dimension = shape.dimension
    gmsh.model.addDiscreteEntity(dimension, entity)
    new = np.unique(own.reshape(-1)) if entity == 1 else np.setdiff1d(own, _present(gmsh, len(mesh.vertex_ids)) - 1)
    places = np.empty((mesh.vertices.shape[0], 3))
    places[own.reshape(-1)] = piece.places[:, corners].reshape(-1, 3)
    inside = piece.places[:, inner].reshape(-1, 3)
    gmsh.model.mesh.addNodes(
        dimension,
        entity,
        np.concatenate([new + 1, nodes[:, inner].reshape(-1)]),
        np.concatenate([places[new], inside]).reshape(-1),
    )
    gmsh.model.mesh.addElementsByType(entity, cell.number, _tags(piece), nodes.reshape(-1))
    gmsh.model.addPhysicalGroup(dimension, [entity], entity, f"{shape.label.lower()} {entity}")
    return first + len(rows) * len(inner)


def _present(gmsh: Any, count: int) -> Ints:
    """Numbers of the vertices that the library has already."""
    tags = np.asarray(gmsh.model.mesh.getNodes()[0], np.int64)
    return tags[tags <= count]


def _write_field(file: BinaryIO, name: str, time: float, export: Export, number: int, tags: list[Ints]) -> None:
    """A binary section $ElementNodeData of one component."""
    held = [(own, piece.values[number]) for own, piece in zip(tags, export.pieces, strict=True)]
    count = sum(len(own) for own, values in held if values is not None)
    head = f'$ElementNodeData\n1\n"{name}"\n1\n{time!r}\n3\n0\n1\n{count}\n'
    file.write(head.encode())
    for own, values in held:
        if values is not None:
            width = values.shape[1]
            lines = np.empty(len(own), [("head", "<i4", (2,)), ("values", "<f8", (width,))])
            lines["head"][:, 0], lines["head"][:, 1], lines["values"] = own, width, values
            file.write(lines.tobytes())
    file.write(b"\n$EndElementNodeData\n")
