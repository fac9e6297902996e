"""Reference shapes cut uniformly: each cut halves every edge.

Segments, triangles, quadrilaterals, tetrahedra, prisms and hexahedra fall into parts of their own shape; a pyramid
into six pyramids and four tetrahedra.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.shapes import Shape

#: a vertex of a child: the midpoint of two vertices of its parent, which may be the same
_Midpoints = tuple[tuple[int, int], ...]


def _corners(shape: Shape) -> list[tuple[Shape, _Midpoints]]:
    """The children at the vertices: half as large, of the same shape."""
    vertices = range(len(shape.vertices))
    return [(shape, tuple((corner, vertex) for vertex in vertices)) for corner in vertices]


def _midpoints(text: str) -> _Midpoints:
    return tuple((int(pair[0]), int(pair[1])) for pair in text.split())


def _tetrahedra(text: str) -> list[tuple[Shape, _Midpoints]]:
    return [(Shape.TETRAHEDRON, _midpoints(ends)) for ends in text.split(", ")]


#: children of a shape after one cut
_CHILDREN: Mapping[Shape, list[tuple[Shape, _Midpoints]]] = {
    Shape.SEGMENT: _corners(Shape.SEGMENT),
    Shape.TRIANGLE: [*_corners(Shape.TRIANGLE), (Shape.TRIANGLE, _midpoints("01 12 02"))],
    Shape.QUADRILATERAL: _corners(Shape.QUADRILATERAL),
    Shape.HEXAHEDRON: _corners(Shape.HEXAHEDRON),
    Shape.TETRAHEDRON: [
        *_corners(Shape.TETRAHEDRON),
        # in this order of corners further cuts give at most three kinds of tetrahedra up to scale; of others they
        # flatten (Bey, Tetrahedral grid refinement, 1995)
        *_tetrahedra("01 02 03 13, 01 02 12 13, 02 03 13 23, 02 12 13 23"),
    ],
    Shape.PRISM: [
        *_corners(Shape.PRISM),
        (Shape.PRISM, _midpoints("01 14 15 02 04 05")),
        (Shape.PRISM, _midpoints("02 15 25 23 05 35")),
    ],
    Shape.PYRAMID: [
        *_corners(Shape.PYRAMID),
        (Shape.PYRAMID, _midpoints("04 34 24 14 02")),
        *_tetrahedra("01 02 04 14, 12 02 14 24, 23 02 24 34, 03 02 34 04"),
    ],
}


@dataclass(frozen=True, eq=False)
class Template:
    """A reference shape after some cuts.

    points  (k, d)  reference coordinates, each point once
    cells           (c, v) points of the cells by shape, in the order of the shape's vertices
    """

    points: Floats
    cells: Mapping[Shape, Ints]


@bounded_cache
def template(shape: Shape, level: int) -> Template:
    """The shape after ``level`` cuts."""
    corners = {shape: (shape.vertices.astype(np.int64) << level)[None]}
    for _ in range(level):
        corners = _cut(corners)

    # corners of cells coincide exactly if their integer coordinates agree
    d = shape.dimension
    flat = np.concatenate([cells.reshape(-1, d) for cells in corners.values()])
    points, index = np.unique(flat, axis=0, return_inverse=True)
    ends = np.cumsum([cells.shape[0] * cells.shape[1] for cells in corners.values()])[:-1]
    parts = zip(corners.items(), np.split(index.reshape(-1), ends), strict=True)
    cells = {kind: own.reshape(rows.shape[:2]) for (kind, rows), own in parts}
    if Shape.TETRAHEDRON in cells:
        cells[Shape.TETRAHEDRON] = _upright(cells[Shape.TETRAHEDRON], points)
    return Template(frozen_floats(points / 2.0**level), {kind: frozen_ints(own) for kind, own in cells.items()})


def _upright(cells: Ints, points: Ints) -> Ints:
    """Tetrahedra (c, 4), two corners exchanged where their volume is negative."""
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    turned = np.linalg.det(edges) < 0
    return np.where(turned[:, None], cells[:, [0, 1, 3, 2]], cells)


def drawn_out(cut: Template, layers: int) -> Template:
    """Cells of a plane shape along a third coordinate from -1 to 1, in this many layers: prisms and hexahedra."""
    count, heights = len(cut.points), np.linspace(-1.0, 1.0, layers + 1)
    points = np.column_stack([np.tile(cut.points, (layers + 1, 1)), np.repeat(heights, count)])
    starts = (np.arange(layers) * count)[:, None, None]
    cells: dict[Shape, Ints] = {}
    for kind, own in cut.cells.items():
        low, high = ((own + starts + step).reshape(-1, own.shape[1]) for step in (0, count))
        if kind is Shape.TRIANGLE:
            cells[Shape.PRISM] = np.column_stack([low[:, :2], high[:, 1::-1], low[:, 2], high[:, 2]])
        else:
            cells[Shape.HEXAHEDRON] = np.column_stack([low, high])
    return Template(frozen_floats(points), {kind: frozen_ints(own) for kind, own in cells.items()})


def _cut(corners: Mapping[Shape, Ints]) -> dict[Shape, Ints]:
    """Cells (c, v, d) by shape after one more cut."""
    found: dict[Shape, list[Ints]] = {}
    for shape, cells in corners.items():
        for kind, ends in _CHILDREN[shape]:
            pairs = np.array(ends)
            found.setdefault(kind, []).append((cells[:, pairs[:, 0]] + cells[:, pairs[:, 1]]) // 2)
    return {kind: np.concatenate(parts) for kind, parts in found.items()}
