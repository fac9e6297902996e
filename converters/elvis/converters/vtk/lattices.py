"""Positions and order of VTK's nodes in [0, 1]^3.

Corners come first, then nodes inside edges, faces and the cell.  Layout: VTK documentation, vtkCellType.h; Lagrange
cells: vtkHigherOrderTetra.cxx, vtkHigherOrderWedge.cxx and vtkHigherOrderHexahedron.cxx of VTK 9.  Triangles inside
triangles and tetrahedra inside tetrahedra are numbered like whole ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.shapes import Shape

_Node = tuple[float, ...]
_Pairs = Sequence[tuple[int, int]]

_TRIANGLE: _Pairs = ((0, 1), (1, 2), (2, 0))
_SQUARE: _Pairs = ((0, 1), (1, 2), (3, 2), (0, 3))
_TETRAHEDRON: _Pairs = (*_TRIANGLE, (0, 3), (1, 3), (2, 3))
_PRISM: _Pairs = (*_TRIANGLE, (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
_CUBE: _Pairs = (*_SQUARE, *((a + 4, b + 4) for a, b in _SQUARE), (0, 4), (1, 5), (2, 6), (3, 7))

_EDGES: dict[Shape, _Pairs] = {
    Shape.SEGMENT: ((0, 1),),
    Shape.TRIANGLE: _TRIANGLE,
    Shape.QUADRILATERAL: _SQUARE,
    Shape.TETRAHEDRON: _TETRAHEDRON,
    Shape.PRISM: _PRISM,
    Shape.HEXAHEDRON: _CUBE,
}

_CORNERS_OF_SQUARE: Sequence[_Node] = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))
_CORNERS_OF_TRIANGLE: Sequence[_Node] = ((0, 0, 0), (1, 0, 0), (0, 1, 0))

_CORNERS: dict[Shape, Sequence[_Node]] = {
    Shape.SEGMENT: _CORNERS_OF_SQUARE[:2],
    Shape.TRIANGLE: _CORNERS_OF_TRIANGLE,
    Shape.QUADRILATERAL: _CORNERS_OF_SQUARE,
    Shape.TETRAHEDRON: (*_CORNERS_OF_TRIANGLE, (0, 0, 1)),
    Shape.PRISM: (*_CORNERS_OF_TRIANGLE, *((x, y, 1) for x, y, _ in _CORNERS_OF_TRIANGLE)),
    Shape.PYRAMID: (*_CORNERS_OF_SQUARE, (0, 0, 1)),
    Shape.HEXAHEDRON: (*_CORNERS_OF_SQUARE, *((x, y, 1) for x, y, _ in _CORNERS_OF_SQUARE)),
}

#: corners of the faces of a tetrahedron, in the order of the nodes inside
_FACES = ((0, 1, 3), (2, 3, 1), (0, 3, 2), (0, 2, 1))

#: types of cells with a fixed number of nodes by the sets of nodes that follow the corners
_CORNERS_ONLY = {3, 5, 9, 10, 12, 13, 14}
_ON_EDGES = {21, 22, 23, 24, 25, 26, 28, 29, 32}
_ON_QUADRILATERALS = {28, 29, 32}
_IN_THE_MIDDLE = {29}
#: cells whose corners stand in rows
_ROWS = {8: 2, 11: 3}

#: middles of the quadrilaterals of these types
_MIDDLES: dict[Shape, Sequence[_Node]] = {
    Shape.QUADRILATERAL: ((0.5, 0.5, 0),),
    Shape.PRISM: ((0.5, 0, 0.5), (0.5, 0.5, 0.5), (0, 0.5, 0.5)),
    Shape.HEXAHEDRON: (
        (0, 0.5, 0.5), (1, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 1, 0.5), (0.5, 0.5, 0), (0.5, 0.5, 1),
    ),
}  # fmt: skip


def fixed_nodes(kind: int, shape: Shape) -> Floats | None:
    """(n, 3) the nodes of a type of cells with a fixed number of them; None for types that only the library knows."""
    if kind in _ROWS:
        axes = _ROWS[kind]
        return np.array([[*row[::-1], *(0,) * (3 - axes)] for row in product((0, 1), repeat=axes)], np.float64)
    if kind not in _CORNERS_ONLY | _ON_EDGES:
        return None
    corners = np.array(_CORNERS[shape], np.float64)
    nodes = [*corners]
    if kind in _ON_EDGES:
        nodes += [(corners[a] + corners[b]) / 2 for a, b in _EDGES[shape]]
    if kind in _ON_QUADRILATERALS:
        nodes += [np.array(middle) for middle in _MIDDLES[shape]]
    if kind in _IN_THE_MIDDLE:
        nodes.append(np.full(3, 0.5))
    return np.array(nodes)


def lagrange_nodes(shape: Shape, degrees: Sequence[int]) -> Floats:
    """(n, 3) the evenly spaced nodes of a Lagrange cell of degrees (i, j, k)."""
    i, j, k = degrees
    sizes = np.array([i, j, k]) if shape is not Shape.PRISM else np.array([i, i, k])
    corners = np.array(_CORNERS[shape], np.int64) * sizes
    nodes = [*corners]
    for a, b in _EDGES[shape]:
        nodes += _inside_edge(corners[a], corners[b])
    nodes += _inside(shape, corners, (int(sizes[0]), int(sizes[1]), int(sizes[2])))
    return np.asarray(np.array(nodes) / np.maximum(sizes, 1), np.float64)


def _inside_edge(start: Ints, end: Ints) -> list[Ints]:
    """The nodes between two, from the first on."""
    steps = int(abs(end - start).max())
    return [start + (end - start) // steps * step for step in range(1, steps)]


def _inside(shape: Shape, corners: Ints, sizes: tuple[int, int, int]) -> list[Ints]:
    """The nodes that lie on no edge."""
    i, j, k = sizes
    if shape is Shape.SEGMENT:
        return []
    if shape is Shape.TRIANGLE:
        return _inside_triangle(*corners)
    if shape is Shape.TETRAHEDRON:
        return _inside_tetrahedron(corners)
    if shape is Shape.QUADRILATERAL:
        return _rows([(x, y, 0) for y, x in product(range(1, j), range(1, i))])
    if shape is Shape.PRISM:
        return _inside_prism(i, k)
    across, along, up = range(1, i), range(1, j), range(1, k)
    faces = [(x, y, z) for x in (0, i) for z, y in product(up, along)]
    faces += [(x, y, z) for y in (0, j) for z, x in product(up, across)]
    faces += [(x, y, z) for z in (0, k) for y, x in product(along, across)]
    return _rows(faces + [(x, y, z) for z, y, x in product(up, along, across)])


def _rows(nodes: Sequence[tuple[int, int, int]]) -> list[Ints]:
    return [np.array(node) for node in nodes]


def _whole_triangle(a: Ints, b: Ints, c: Ints) -> list[Ints]:
    """The nodes of a triangle by its corners, which may coincide."""
    if (a == b).all():
        return [a]
    edges = [node for start, end in ((a, b), (b, c), (c, a)) for node in _inside_edge(start, end)]
    return [a, b, c, *edges, *_inside_triangle(a, b, c)]


def _inside_triangle(a: Ints, b: Ints, c: Ints) -> list[Ints]:
    """The nodes inside a triangle, which form a triangle three degrees lower."""
    order = int(abs(b - a).max())
    if order < 3:
        return []
    along, up = (b - a) // order, (c - a) // order
    return _whole_triangle(a + along + up, b - 2 * along + up, c + along - 2 * up)


def _inside_tetrahedron(corners: Ints) -> list[Ints]:
    """The nodes inside the faces, and inside the tetrahedron, which form a tetrahedron four degrees lower."""
    order = int(abs(corners[1] - corners[0]).max())
    nodes = [node for face in _FACES for node in _inside_triangle(*corners[list(face)])]
    if order < 4:
        return nodes
    middle = corners.sum(axis=0) // order
    smaller = corners + middle - 4 * ((corners - corners[0]) // order) - 4 * corners[0] // order
    if order == 4:
        return [*nodes, smaller[0]]
    edges = [node for a, b in _TETRAHEDRON for node in _inside_edge(smaller[a], smaller[b])]
    return [*nodes, *smaller, *edges, *_inside_tetrahedron(smaller)]


def _inside_prism(order: int, height: int) -> list[Ints]:
    """The nodes inside the triangles, the quadrilaterals and the prism."""
    triangle = [(x, y) for y in range(1, order) for x in range(1, order - y)]
    upright = range(1, height)
    nodes = [(x, y, z) for z in (0, height) for x, y in triangle]
    nodes += [(x, 0, z) for z, x in product(upright, range(1, order))]
    nodes += [(order - y, y, z) for z, y in product(upright, range(1, order))]
    nodes += [(0, y, z) for z, y in product(upright, range(order - 1, 0, -1))]
    return _rows(nodes + [(x, y, z) for z in upright for x, y in triangle])
