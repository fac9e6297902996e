"""The edges and faces of a mesh as Modified modes: the first two steps of the geometry mapping (format notes 2.4).

Coefficients of a face are stored by mode (p, q) in a square, flattened; zero if the face has no such mode.  Modes come
first, so that each is one stretch of memory for many faces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import Curves, Mesh
from elvis.core.mapping.orientation import chunks, first_face_row, label, polygon_vertices, require
from elvis.core.polynomials.bernstein import to_bernstein
from elvis.core.polynomials.interpolation import interpolation, modified, nodes_along
from elvis.core.polynomials.points import PointsType
from elvis.core.shapes import Shape

_FACES = (Shape.TRIANGLE, Shape.QUADRILATERAL)
#: curved faces that are transformed together
_AT_ONCE = 1 << 10

#: start of each edge of a face in its natural direction, and the mode (p, q) of its mode k >= 2; j is k - 1
_EDGES: Mapping[Shape, tuple[tuple[int, str, str], ...]] = {
    Shape.TRIANGLE: ((0, "k", "0"), (1, "1", "j"), (0, "0", "k")),
    Shape.QUADRILATERAL: ((0, "k", "0"), (1, "1", "k"), (3, "k", "1"), (0, "0", "k")),
}


class Skeleton:
    """Vertices, edges and faces of a mesh, ready to be put together to elements.

    vertices  (n, 3)  world coordinates; those beyond the mesh's space are zero
    faces             vertex rows of triangles (n, 3) and of quadrilaterals (n, 4), in local order
    curved            whether any edge or face is
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.vertices = _within(mesh, mesh.vertices)
        self.curved = len(mesh.edge_curves) + len(mesh.face_curves) > 0
        self._read_edges()
        self._read_faces()

    @cached_property
    def faces(self) -> Mapping[Shape, Ints]:
        """See the class."""
        shapes = _FACES if self.mesh.dimension > 1 else ()
        return {shape: polygon_vertices(self.mesh, shape) for shape in shapes}

    def _read_edges(self) -> None:
        """Modes (k, curves + 1, 3) of the edge curves; a last row of zeros serves straight edges."""
        mesh = self.mesh
        curves = mesh.edge_curves
        groups = list(_groups(mesh, Shape.SEGMENT, np.arange(len(curves))))
        most = max((n for _, n, _ in groups), default=2)
        self._edge_modes = np.zeros((most, len(curves) + 1, 3))
        orders = np.full(len(curves), 2)
        for family, n, which in groups:
            orders[which] = n
            own = _interpolate(mesh, Shape.SEGMENT, family, n, which)
            self._edge_modes[:n, which] = own.transpose(2, 0, 1)

        # if an edge has several curves, the last one counts
        edges = len(mesh.of(Shape.SEGMENT)) if self.curved else 0
        self._edge_orders = np.full(edges, 2)
        self._edge_slots = np.full(edges, -1)
        self._edge_orders[curves.rows] = orders
        self._edge_slots[curves.rows] = np.arange(len(curves))

    def _read_faces(self) -> None:
        """The curve of each face, -1 if it has none; curved faces need edges with as many nodes."""
        self._face_slots: dict[Shape, Ints] = {}
        if not self.curved:
            return
        mesh = self.mesh
        curves = mesh.face_curves
        is_triangle = curves.rows < len(mesh.of(Shape.TRIANGLE))
        for shape, vertices in self.faces.items():
            which = np.flatnonzero(is_triangle == (shape is Shape.TRIANGLE))
            first = first_face_row(mesh, shape)
            self._face_slots[shape] = np.full(len(vertices), -1)
            self._face_slots[shape][curves.rows[which] - first] = which
            for _, n, group in _groups(mesh, shape, which):
                rows = curves.rows[group] - first
                found = self._edge_orders[mesh.of(shape).members[rows]]
                expected = f"edges curved with {n} nodes each, as the face is"
                require(found == n, mesh, shape, rows, expected, "edges of {} nodes", found)

    def edge_orders(self) -> Ints:
        """(n, 1) numbers of modes of all edges."""
        return self._edge_orders[:, None]

    def face_orders(self, shape: Shape) -> Ints:
        """(n, 2) numbers of modes of all faces of a shape, one for both directions of a triangle."""
        edges: Ints = self._edge_orders[self.mesh.of(shape).members]
        if shape is Shape.TRIANGLE:
            return np.repeat(edges.max(axis=1)[:, None], 2, axis=1)
        return np.maximum(edges[:, :2], edges[:, 2:])

    def edge_modes(self, rows: Ints, modes: int) -> Floats:
        """(n, 3, modes) coefficients of edges along their own direction, ``modes`` at least their order."""
        result = np.zeros((len(rows), 3, modes))
        kept = min(modes, len(self._edge_modes))
        result[:, :, :kept] = self._edge_modes[:kept, self._edge_slots[rows]].transpose(1, 2, 0)

        # the first two modes belong to the ends
        ends = self.mesh.of(Shape.SEGMENT).members[rows]
        result[:, :, :2] = self.vertices[ends].transpose(0, 2, 1)
        return result

    def face_modes(self, shape: Shape, rows: Ints, modes: int) -> Floats:
        """(modes^2, n, 3) coefficients of faces in their own frame, ``modes`` at least their orders.

        The interpolated face first, then over it the edges, then the vertices.
        """
        result = np.zeros((modes, modes, len(rows), 3))
        slots = self._face_slots[shape][rows]
        curved = np.unique(slots[slots >= 0])
        for family, n, which in _groups(self.mesh, shape, curved):
            own = _interpolate(self.mesh, shape, family, n, which)
            own = own.reshape(-1, 3, n, n).transpose(2, 3, 0, 1)
            here = np.flatnonzero(np.isin(slots, which))
            result[:n, :n, here] = own[:, :, np.searchsorted(which, slots[here])]
        self._put_edges(result, shape, rows)
        return result.reshape(modes * modes, len(rows), 3)

    def edge_widths(self) -> Floats:
        """(n, 3) how far Bernstein coefficients of edges are from the straight lines between their ends, at most."""
        modes = np.abs(self._edge_modes[2:])
        widths = np.tensordot(_net_sizes(len(self._edge_modes)), modes, 1)
        return np.asarray(widths[self._edge_slots])

    def face_widths(self, shape: Shape) -> Floats:
        """(n, 3) how far Bernstein coefficients of quadrilaterals are from the blends of their edges, at most."""
        slots = self._face_slots[shape]
        widths = np.zeros((len(self.mesh.face_curves) + 1, 3))
        for family, n, which in _groups(self.mesh, shape, np.flatnonzero(np.bincount(slots[slots >= 0]))):
            sizes = np.outer(_net_sizes(n), _net_sizes(n))
            for part in chunks(len(which), _AT_ONCE):
                modes = _interpolate(self.mesh, shape, family, n, which[part]).reshape(-1, 3, n, n)
                widths[which[part]] = np.einsum("fipq,pq->fi", np.abs(modes[:, :, 2:, 2:]), sizes)
        return widths[slots]

    def _put_edges(self, faces: Floats, shape: Shape, rows: Ints) -> None:
        """Overwrite vertex and edge modes of ``faces`` (modes, modes, n, 3) by the modes of the edges."""
        modes = len(faces)
        places: dict[str, Callable[[int], int]] = {
            "0": lambda _: 0,
            "1": lambda _: 1,
            "k": lambda k: k,
            "j": lambda k: k - 1,
        }
        first_vertex = self.mesh.of(Shape.SEGMENT).members[:, 0]
        edges = self.mesh.of(shape).members[rows]
        vertices = self.faces[shape][rows]
        for edge, (start, p, q) in zip(edges.T, _EDGES[shape], strict=True):
            slots = self._edge_slots[edge]
            # an edge that runs the other way has the odd modes with the other sign
            is_backwards = first_vertex[edge] != vertices[:, start]
            sign = np.where(is_backwards, -1.0, 1.0)[:, None]
            for k in range(2, modes):
                inner = self._edge_modes[k][slots] if k < len(self._edge_modes) else np.zeros((len(rows), 3))
                faces[places[p](k), places[q](k)] = inner * sign if k % 2 else inner

        # vertex modes stand where the vertices do: 0 at -1, 1 at +1
        corners = (shape.vertices > 0).astype(int)
        for vertex, (p, q) in zip(vertices.T, corners, strict=True):
            faces[p, q] = self.vertices[vertex]


def _net_sizes(count: int) -> Floats:
    """(count - 2,) the largest Bernstein coefficients of the modes of a line from 2 on, but for their signs."""
    return np.asarray(np.abs(to_bernstein(modified(Shape.SEGMENT, (count,)))).max(axis=1)[2:])


def _within(mesh: Mesh, points: Floats) -> Floats:
    """The points, with coordinates beyond the mesh's space zero."""
    if not points[:, mesh.space :].any():
        return points
    result: Floats = np.where(np.arange(3) < mesh.space, points, 0.0)
    return result


def _curves(mesh: Mesh, shape: Shape) -> Curves:
    return mesh.edge_curves if shape is Shape.SEGMENT else mesh.face_curves


def _groups(mesh: Mesh, shape: Shape, which: Ints) -> Iterator[tuple[PointsType, int, Ints]]:
    """Curves ``which`` of a shape with like nodes together: their family, nodes along an edge, and which they are."""
    curves = _curves(mesh, shape)
    counts = np.diff(curves.offsets)
    keys = np.stack([curves.kinds[which], counts[which]], axis=1)
    if len(which) and (keys == keys[0]).all():
        kind, count = keys[0].tolist()
        yield *_describe(mesh, shape, kind, count, which), which
        return
    distinct, index = np.unique(keys, axis=0, return_inverse=True)
    for number, (kind, count) in enumerate(distinct.tolist()):
        group = which[index.reshape(-1) == number]
        family, n = _describe(mesh, shape, kind, count, group)
        yield family, n, group


def _describe(mesh: Mesh, shape: Shape, kind: int, count: int, group: Ints) -> tuple[PointsType, int]:
    """Family and nodes along an edge of a group of curves.

    Raises FormatError for the first curve if the family is invalid.
    """
    try:
        if kind not in PointsType.__members__.values():
            raise FormatError(f"expected the number of a family of nodes, found {kind}")
        family = PointsType(kind)
        n = nodes_along(shape, family, count)
        interpolation(shape, family, n)
    except FormatError as error:
        first = 0 if shape is Shape.SEGMENT else first_face_row(mesh, shape)
        row = _curves(mesh, shape).rows[group[0]] - first
        raise error.within(place=f"curve of {label(mesh, shape, row)}") from None
    return family, n


def _interpolate(mesh: Mesh, shape: Shape, family: PointsType, n: int, which: Ints) -> Floats:
    """(k, 3, n or n^2) modes of the interpolants of the curves ``which``, all of one family and order."""
    curves = _curves(mesh, shape)
    matrix = interpolation(shape, family, n)
    rows = curves.offsets[which][:, None] + np.arange(len(matrix))
    points = _within(mesh, curves.points[rows])
    return np.asarray(points.transpose(0, 2, 1) @ matrix)
