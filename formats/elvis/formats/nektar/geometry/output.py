"""Writing meshes as XML, text or compressed (format notes 1.3 to 1.7)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Floats, Ints, distinct_bits
from elvis.core.data.mesh import Curves, Entities, Mesh
from elvis.core.polynomials.points import PointsType
from elvis.core.shapes import Shape
from elvis.formats.nektar.composites import format_tokens, written_composites
from elvis.formats.nektar.numbers import format_ids
from elvis.formats.nektar.xml import COMPRESSED, Writer

_ROWS_AT_ONCE = 1 << 16

#: the order in which the format's own tools write shapes
_ORDER = (Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.HEXAHEDRON, Shape.PRISM, Shape.PYRAMID, Shape.TETRAHEDRON)


def write_geometry(writer: Writer, mesh: Mesh, is_compressed: bool) -> None:
    """The section GEOMETRY of a mesh that has a domain."""
    form = _CompressedPayloads(writer, mesh) if is_compressed else _Text(writer, mesh)
    with writer.element("GEOMETRY", {"DIM": mesh.dimension, "SPACE": mesh.space}):
        form.vertices()
        if mesh.dimension > 1:
            form.edges(mesh.of(Shape.SEGMENT))
        if mesh.dimension == 3:
            form.tables("FACE", Shape.of_dimension(2))
        form.tables("ELEMENT", Shape.of_dimension(mesh.dimension))
        if len(mesh.edge_curves) or len(mesh.face_curves):
            form.curves()
        _composites(writer, mesh)


def member_ids(mesh: Mesh, shape: Shape) -> Ints:
    """(n, k) ids of the vertices, edges or faces that bound the entities of a shape."""
    return lower_ids(mesh, shape)[mesh.of(shape).members]


def lower_ids(mesh: Mesh, shape: Shape) -> Ints:
    """(n,) ids of all vertices, edges or faces of one dimension less than a shape."""
    return mesh.vertex_ids if shape.dimension == 1 else entity_ids(mesh, shape.dimension - 1)


def entity_ids(mesh: Mesh, dimension: int) -> Ints:
    """(n,) ids of the edges, or of the faces: triangles, then quadrilaterals."""
    return np.concatenate([mesh.of(shape).ids for shape in Shape.of_dimension(dimension)])


def unique_points(points: Floats) -> tuple[Floats, Ints]:
    """Distinct points, compared bit by bit, and the index of each point among them.

    They are sorted by their bytes, or equally by their bits read as whole numbers with the most significant byte first.
    """
    first, which = distinct_bits(points)
    distinct = np.ascontiguousarray(points[first], "<f8")
    order = np.argsort(distinct.view("S24")[:, 0])
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return distinct[order], place[which]


def _composites(writer: Writer, mesh: Mesh) -> None:
    with writer.element("COMPOSITE"):
        for composite in written_composites(mesh):
            name = {} if composite.name is None else {"NAME": composite.name}
            writer.leaf("C", {"ID": composite.id, **name}, format_tokens(composite.parts))
    if list(mesh.domains) == [0]:
        writer.leaf("DOMAIN", None, f" C[{format_ids(np.array(mesh.domains[0]))}] ")
        return
    with writer.element("DOMAIN"):
        for id, composites in mesh.domains.items():
            writer.leaf("D", {"ID": id}, f" C[{format_ids(np.array(composites, np.int64))}] ")


class _CompressedPayloads:
    """Payloads of 8-byte records."""

    def __init__(self, writer: Writer, mesh: Mesh) -> None:
        self._writer, self._mesh = writer, mesh

    def vertices(self) -> None:
        records = _point_records(self._mesh.vertex_ids, self._mesh.vertices)
        self._writer.payload("VERTEX", COMPRESSED, [records])

    def edges(self, edges: Entities) -> None:
        self._writer.payload("EDGE", COMPRESSED, [_records(edges.ids, member_ids(self._mesh, Shape.SEGMENT))])

    def tables(self, section: str, shapes: tuple[Shape, ...]) -> None:
        with self._writer.element(section):
            for shape in sorted(shapes, key=place):
                entities = self._mesh.of(shape)
                if len(entities):
                    records = _records(entities.ids, member_ids(self._mesh, shape))
                    self._writer.payload(shape.tag, COMPRESSED, [records])

    def curves(self) -> None:
        """Edges, faces, and the points that both share."""
        mesh = self._mesh
        points, places = unique_points(np.concatenate([mesh.edge_curves.points, mesh.face_curves.points]))
        with self._writer.element("CURVED", COMPRESSED):
            if len(mesh.edge_curves):
                self._curves("E", mesh.edge_curves, entity_ids(mesh, 1), 0)
            if len(mesh.face_curves):
                self._curves("F", mesh.face_curves, entity_ids(mesh, 2), len(mesh.edge_curves.points))
            with self._writer.element("DATAPOINTS", {"ID": 0}):
                self._writer.payload("INDEX", {}, [places.astype("<i8")])
                self._writer.payload("POINTS", {}, [_point_records(np.arange(len(points)), points)])

    def _curves(self, tag: str, curves: Curves, ids: Ints, offset: int) -> None:
        counts, starts = np.diff(curves.offsets), curves.offsets[:-1] + offset
        columns = [np.arange(len(curves)), ids[curves.rows], counts, np.zeros_like(counts), starts, curves.kinds]
        self._writer.payload(tag, {}, [np.stack(columns, axis=1).astype("<i8")])


class _Text:
    """An entry each, 17 digits."""

    def __init__(self, writer: Writer, mesh: Mesh) -> None:
        self._writer, self._mesh = writer, mesh

    def vertices(self) -> None:
        with self._writer.element("VERTEX"):
            ids, points = self._mesh.vertex_ids, self._mesh.vertices
            for rows in _steps(len(ids)):
                numbers = [
                    value
                    for id, xyz in zip(ids[rows].tolist(), points[rows].tolist(), strict=True)
                    for value in (id, *xyz)
                ]
                entry = '<V ID="%d">%.17g %.17g %.17g</V>'
                self._writer.lines(("\n".join([entry] * (len(numbers) // 4)) % tuple(numbers)).split("\n"))

    def edges(self, edges: Entities) -> None:
        with self._writer.element("EDGE"):
            self._entries("E", edges.ids, member_ids(self._mesh, Shape.SEGMENT))

    def tables(self, section: str, shapes: tuple[Shape, ...]) -> None:
        with self._writer.element(section):
            for shape in shapes:
                self._entries(shape.tag, self._mesh.of(shape).ids, member_ids(self._mesh, shape))

    def curves(self) -> None:
        """Edges, then faces, counted on."""
        mesh = self._mesh
        with self._writer.element("CURVED"):
            self._curves("E", "EDGEID", mesh.edge_curves, entity_ids(mesh, 1), 0)
            self._curves("F", "FACEID", mesh.face_curves, entity_ids(mesh, 2), len(mesh.edge_curves))

    def _entries(self, tag: str, ids: Ints, members: Ints) -> None:
        entry = f'<{tag} ID="%d">{" ".join(["%d"] * members.shape[1])}</{tag}>'
        for rows in _steps(len(ids)):
            numbers = np.column_stack([ids[rows], members[rows]])
            self._writer.lines(("\n".join([entry] * len(numbers)) % tuple(numbers.ravel().tolist())).split("\n"))

    def _curves(self, tag: str, entity: str, curves: Curves, ids: Ints, first: int) -> None:
        entities, offsets, kinds = ids[curves.rows].tolist(), curves.offsets.tolist(), curves.kinds.tolist()
        texts = [f"{x:.17g} {y:.17g} {z:.17g}" for x, y, z in curves.points.tolist()]
        self._writer.lines(
            f'<{tag} ID="{first + row}" {entity}="{entities[row]}" NUMPOINTS="{offsets[row + 1] - offsets[row]}" '
            f'TYPE="{PointsType(kinds[row]).label}">{"   ".join(texts[offsets[row] : offsets[row + 1]])}</{tag}>'
            for row in range(len(curves))
        )


def place(shape: Shape) -> int:
    """Position of a shape's tables among the tables of its dimension in XML."""
    return _ORDER.index(shape) if shape in _ORDER else -1


def _steps(count: int) -> Iterator[slice]:
    return (slice(start, start + _ROWS_AT_ONCE) for start in range(0, count, _ROWS_AT_ONCE))


def _records(ids: Ints, members: Ints) -> Ints:
    return np.column_stack([ids, members]).astype("<i8", copy=False)


def _point_records(ids: Ints, points: Floats) -> Ints:
    """(n, 4) 8-byte records of id and coordinates."""
    records = np.empty((len(ids), 4), "<i8")
    records[:, 0] = ids
    records.view("<f8")[:, 1:] = points
    return records
