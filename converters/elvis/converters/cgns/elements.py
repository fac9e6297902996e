"""Types of elements of CGNS: their nodes, in the order of the standard, and their functions.

Node numbering: SIDS, "Unstructured Grid Element Numbering Conventions": corners, then nodes along the edges, then those
inside the faces, then those inside the element in layers.  Inside a square they wind from its first corner inwards.
Nodes are spaced evenly.  Notes in the standard place some nodes of order 4 elsewhere, against its own figures of
triangles: inside triangles at the centroids of their quarters, inside pyramids on lines to the apex.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from elvis.converters.shared.incomplete import incomplete_functions, incomplete_pyramid
from elvis.converters.shared.unit import UNIT
from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import NodalBasis, ShapeFunctions
from elvis.plugins.conversion.plugin import PyramidSpace
from elvis.plugins.projection.naming import local_sides

#: numbers of types that are not elements of one shape
NODE, MIXED, NGON, NFACE = 2, 20, 22, 23

#: types whose inner nodes have other places according to notes in the standard, and the type with such nodes only on
#: edges
AMBIGUOUS = {46: 45, 47: 45, 49: 48, 50: 48, 52: 51, 53: 51}

#: places of nodes: everywhere, or only on edges, or only on edges and faces
_COMPLETE, _EDGES, _FACES = "complete", "edges", "faces"

#: name, shape, order and nodes of each type, by number (cgnslib.h, ElementType_t)
_TYPES: Mapping[int, tuple[str, Shape, int, str]] = {
    3: ("BAR_2", Shape.SEGMENT, 1, _COMPLETE),
    4: ("BAR_3", Shape.SEGMENT, 2, _COMPLETE),
    5: ("TRI_3", Shape.TRIANGLE, 1, _COMPLETE),
    6: ("TRI_6", Shape.TRIANGLE, 2, _COMPLETE),
    7: ("QUAD_4", Shape.QUADRILATERAL, 1, _COMPLETE),
    8: ("QUAD_8", Shape.QUADRILATERAL, 2, _EDGES),
    9: ("QUAD_9", Shape.QUADRILATERAL, 2, _COMPLETE),
    10: ("TETRA_4", Shape.TETRAHEDRON, 1, _COMPLETE),
    11: ("TETRA_10", Shape.TETRAHEDRON, 2, _COMPLETE),
    12: ("PYRA_5", Shape.PYRAMID, 1, _COMPLETE),
    13: ("PYRA_14", Shape.PYRAMID, 2, _COMPLETE),
    14: ("PENTA_6", Shape.PRISM, 1, _COMPLETE),
    15: ("PENTA_15", Shape.PRISM, 2, _EDGES),
    16: ("PENTA_18", Shape.PRISM, 2, _COMPLETE),
    17: ("HEXA_8", Shape.HEXAHEDRON, 1, _COMPLETE),
    18: ("HEXA_20", Shape.HEXAHEDRON, 2, _EDGES),
    19: ("HEXA_27", Shape.HEXAHEDRON, 2, _COMPLETE),
    21: ("PYRA_13", Shape.PYRAMID, 2, _EDGES),
    24: ("BAR_4", Shape.SEGMENT, 3, _COMPLETE),
    25: ("TRI_9", Shape.TRIANGLE, 3, _EDGES),
    26: ("TRI_10", Shape.TRIANGLE, 3, _COMPLETE),
    27: ("QUAD_12", Shape.QUADRILATERAL, 3, _EDGES),
    28: ("QUAD_16", Shape.QUADRILATERAL, 3, _COMPLETE),
    29: ("TETRA_16", Shape.TETRAHEDRON, 3, _EDGES),
    30: ("TETRA_20", Shape.TETRAHEDRON, 3, _COMPLETE),
    31: ("PYRA_21", Shape.PYRAMID, 3, _EDGES),
    32: ("PYRA_29", Shape.PYRAMID, 3, _FACES),
    33: ("PYRA_30", Shape.PYRAMID, 3, _COMPLETE),
    34: ("PENTA_24", Shape.PRISM, 3, _EDGES),
    35: ("PENTA_38", Shape.PRISM, 3, _FACES),
    36: ("PENTA_40", Shape.PRISM, 3, _COMPLETE),
    37: ("HEXA_32", Shape.HEXAHEDRON, 3, _EDGES),
    38: ("HEXA_56", Shape.HEXAHEDRON, 3, _FACES),
    39: ("HEXA_64", Shape.HEXAHEDRON, 3, _COMPLETE),
    40: ("BAR_5", Shape.SEGMENT, 4, _COMPLETE),
    41: ("TRI_12", Shape.TRIANGLE, 4, _EDGES),
    42: ("TRI_15", Shape.TRIANGLE, 4, _COMPLETE),
    43: ("QUAD_P4_16", Shape.QUADRILATERAL, 4, _EDGES),
    44: ("QUAD_25", Shape.QUADRILATERAL, 4, _COMPLETE),
    45: ("TETRA_22", Shape.TETRAHEDRON, 4, _EDGES),
    46: ("TETRA_34", Shape.TETRAHEDRON, 4, _FACES),
    47: ("TETRA_35", Shape.TETRAHEDRON, 4, _COMPLETE),
    48: ("PYRA_P4_29", Shape.PYRAMID, 4, _EDGES),
    49: ("PYRA_50", Shape.PYRAMID, 4, _FACES),
    50: ("PYRA_55", Shape.PYRAMID, 4, _COMPLETE),
    51: ("PENTA_33", Shape.PRISM, 4, _EDGES),
    52: ("PENTA_66", Shape.PRISM, 4, _FACES),
    53: ("PENTA_75", Shape.PRISM, 4, _COMPLETE),
    54: ("HEXA_44", Shape.HEXAHEDRON, 4, _EDGES),
    55: ("HEXA_98", Shape.HEXAHEDRON, 4, _FACES),
    56: ("HEXA_125", Shape.HEXAHEDRON, 4, _COMPLETE),
}

#: edges of each shape, as pairs of corners, in the order and direction in which their nodes come
_LINES: Mapping[Shape, list[tuple[int, int]]] = {
    Shape.SEGMENT: [],
    Shape.TRIANGLE: [(0, 1), (1, 2), (2, 0)],
    Shape.QUADRILATERAL: [(0, 1), (1, 2), (2, 3), (3, 0)],
    Shape.TETRAHEDRON: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    Shape.PYRAMID: [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)],
    Shape.PRISM: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 4), (2, 5), (3, 4), (4, 5), (5, 3)],
    Shape.HEXAHEDRON: [
        (0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4),
    ],
}  # fmt: skip

#: faces of each shape, as their corners, in the order and from the corner in which their nodes come
_SURFACES: Mapping[Shape, list[tuple[int, ...]]] = {
    Shape.SEGMENT: [],
    Shape.TRIANGLE: [],
    Shape.QUADRILATERAL: [],
    Shape.TETRAHEDRON: [(0, 1, 2), (0, 1, 3), (1, 2, 3), (2, 0, 3)],
    Shape.PYRAMID: [(0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)],
    Shape.PRISM: [(0, 1, 2), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5), (3, 4, 5)],
    Shape.HEXAHEDRON: [(0, 1, 2, 3), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7)],
}


@dataclass(frozen=True, eq=False)
class ElementType:
    """A type of elements.

    nodes      (k, d) reference coordinates, in ours, of its nodes
    functions  of the nodes
    corners    number of the node at each of our vertices, in our order
    """

    number: int
    name: str
    shape: Shape
    order: int
    nodes: Floats
    functions: ShapeFunctions
    corners: Ints

    @property
    def is_standard(self) -> bool:
        """Whether the standard says what the functions are between the nodes."""
        _, shape, order, where = _TYPES[self.number]
        is_tensor = shape in (Shape.QUADRILATERAL, Shape.HEXAHEDRON)
        return where == _COMPLETE or is_tensor or order == 2

    def side_corners(self) -> list[Ints]:
        """For each of our local sides, the columns of its vertices."""
        return [self.corners[list(side)] for side in local_sides(self.shape)]

    def side_nodes(self) -> list[Ints]:
        """For each of our local sides, the columns of all nodes that lie on it."""
        return [_on_side(self.shape, side, self.nodes) for side in local_sides(self.shape)]


def corners_of_shape(shape: Shape) -> Floats:
    """(n_vertices, d) reference coordinates, in ours, of the corners in the standard's order."""
    corners = np.empty_like(shape.vertices)
    corners[UNIT[shape].corners] = shape.vertices
    return corners


def sides_of_shape(shape: Shape) -> list[tuple[int, ...]]:
    """Corners of the sides of an element, in the order in which the standard numbers the sides."""
    sides: list[tuple[int, ...]] = list(_SURFACES[shape] or _LINES[shape])
    # those of prisms with four corners come first
    return sorted(sides, key=len, reverse=True) if shape is Shape.PRISM else sides


def node_count(number: int) -> int | None:
    """Number of nodes of a type of elements; None if it is unknown."""
    if number == NODE:
        return 1
    return len(nodes_of_type(number)) if number in _TYPES else None


def basic_shape(number: int) -> Shape | None:
    """The shape of a type of elements."""
    return _TYPES[number][1] if number in _TYPES else None


@lru_cache(maxsize=128)
def element_type(number: int, by_notes: bool = False) -> ElementType:
    """The type with a number.

    by_notes  whether its inner nodes lie where notes in the standard define them, not evenly
    """
    name, shape, order, where = _TYPES[number]
    nodes = nodes_of_type(number, by_notes)
    corners = np.array(UNIT[shape].corners, np.int64)
    return ElementType(number, name, shape, order, nodes, _functions(shape, order, where, nodes, by_notes), corners)


@bounded_cache
def nodes_of_type(number: int, by_notes: bool = False) -> Floats:
    """(k, d) reference coordinates of the nodes of a type."""
    _, shape, order, where = _TYPES[number]
    found = _outline(shape, order)
    if where != _EDGES:
        found += _on_faces(shape, order, by_notes)
    if where == _COMPLETE:
        found += _inside(shape, order, by_notes)
    return frozen_floats(np.array(found))


def _on_faces(shape: Shape, order: int, by_notes: bool) -> list[Floats]:
    """Nodes inside the faces."""
    faces = [corners_of_shape(shape)[list(face)] for face in _SURFACES[shape]]
    return [node for corners in faces for node in _inside_face(corners, order, by_notes)]


def _outline(shape: Shape, order: int) -> list[Floats]:
    """Corners, and nodes along the edges."""
    corners = corners_of_shape(shape)
    lines = _LINES[shape]
    return [*corners, *(node for a, b in lines for node in _between(corners[a], corners[b], order))]


def _between(start: Floats, end: Floats, order: int) -> list[Floats]:
    return [start + (end - start) * (k / order) for k in range(1, order)]


def _inside_face(corners: Floats, order: int, by_notes: bool = False) -> list[Floats]:
    """Nodes inside a triangle or a parallelogram."""
    a, b, c = corners[0], corners[1], corners[-1]
    steps: Sequence[tuple[float, float]] = _winding(order)
    if len(corners) == 3:
        steps = _triangular(order, by_notes)
    return [a + (b - a) * (i / order) + (c - a) * (j / order) for i, j in steps]


def _winding(order: int) -> list[tuple[int, int]]:
    """Steps along both sides of a square, ring by ring from the outside, each from its first corner around."""
    low, high, found = 1, order - 1, []
    while low < high:
        found += [(i, low) for i in range(low, high)]
        found += [(high, j) for j in range(low, high)]
        found += [(i, high) for i in range(high, low, -1)]
        found += [(low, j) for j in range(high, low, -1)]
        low, high = low + 1, high - 1
    return [*found, (low, low)] if low == high else found


def _triangular(order: int, by_notes: bool) -> list[tuple[float, float]]:
    """Steps along the first two sides of a triangle: its middle, or from corner to corner."""
    if order == 4 and by_notes:
        near, far = 2 / 3, 8 / 3  # the centroid of a corner and the middles of its sides
        return [(near, near), (far, near), (near, far)]
    return {3: [(1.0, 1.0)], 4: [(1.0, 1.0), (2.0, 1.0), (1.0, 2.0)]}.get(order, [])


def _inside(shape: Shape, order: int, by_notes: bool = False) -> list[Floats]:
    """Nodes inside an element, layer by layer."""
    corners = corners_of_shape(shape)
    if shape is Shape.SEGMENT:
        return _between(corners[0], corners[1], order)
    if shape in (Shape.TRIANGLE, Shape.QUADRILATERAL):
        return _inside_face(corners, order)
    if shape is Shape.TETRAHEDRON:
        return [corners.mean(axis=0)] if order == 4 else []
    if shape is Shape.PYRAMID:
        return _inside_pyramid(corners, order, by_notes)
    half = len(corners) // 2
    low, up = corners[:half], corners[half:] - corners[:half]
    return [node for k in range(1, order) for node in _inside_face(low + up * (k / order), order, by_notes)]


def _inside_pyramid(corners: Floats, order: int, by_notes: bool) -> list[Floats]:
    """Nodes inside a pyramid: the order of a layer decreases by one per layer towards the apex.

    According to the notes, the four of PYRA_55 lie on the lines from the apex to the nodes inside the base.
    """
    base, apex = corners[:4], corners[4]
    found = []
    for k in range(1, order - 1):
        layer = base + (apex - base) * (k / order)
        is_straight = order == 4 and k == 1 and by_notes
        if is_straight:
            inside = _inside_face(base, order)
            found += [node + (apex - node) * (k / order) for node in inside[:8:2]]
        else:
            found += _inside_face(layer, order - k)
    return found


def _functions(shape: Shape, order: int, where: str, nodes: Floats, by_notes: bool) -> ShapeFunctions:
    if where == _COMPLETE:
        return NodalBasis(shape, order, nodes, PyramidSpace.RATIONAL)
    if shape is not Shape.PYRAMID:
        return incomplete_functions(shape, order, where == _FACES, nodes)
    inner = [*_on_faces(shape, order, by_notes), *_inside(shape, order, by_notes)]
    complete = np.array([*_outline(shape, order), *inner])
    faces = [_face(face, order) for face in _SURFACES[shape]] if where == _EDGES else []
    return incomplete_pyramid(order, nodes, complete, [face for face in faces if len(face[1])])


def _face(face: tuple[int, ...], order: int) -> tuple[Floats, Floats, Floats]:
    """Nodes on the edges of a pyramid's face, nodes inside it, and the functions of the first at the second."""
    shape = Shape.TRIANGLE if len(face) == 3 else Shape.QUADRILATERAL
    flat = np.array(_outline(shape, order))
    inside = np.array(_inside(shape, order)).reshape(-1, 2)
    table = incomplete_functions(shape, order, False, flat).at(inside)
    corners = corners_of_shape(Shape.PYRAMID)[list(face)]
    a, b, c = corners[0], corners[1], corners[-1]

    def placed(points: Floats) -> Floats:
        u, v = (1 + points.T[:, :, None]) / 2
        return np.asarray(a + (b - a) * u + (c - a) * v)

    return placed(flat), placed(inside), table


def _on_side(shape: Shape, side: tuple[int, ...], nodes: Floats) -> Ints:
    """The nodes on a side: on the end, the line or the plane through its vertices."""
    vertices = shape.vertices[list(side)]
    edges = vertices[1:] - vertices[0]
    # directions across the side, orthogonal to all of its edges
    _, sizes, directions = np.linalg.svd(np.vstack([edges, np.zeros((1, shape.dimension))]))
    across = directions[int((sizes > 1e-9).sum()) :]
    return np.flatnonzero(np.abs((nodes - vertices[0]) @ across.T).max(axis=1) < 1e-9)
