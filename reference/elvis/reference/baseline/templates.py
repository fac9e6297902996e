"""Cells pulled to simplices, when world positions are known; `elvis.core.mapping.cutting` cuts shapes into cells."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.cutting import Template
from elvis.core.shapes import Shape

#: simplices that a cell of each shape gives
SIMPLICES: Mapping[Shape, int] = {
    Shape.TRIANGLE: 1,
    Shape.QUADRILATERAL: 2,
    Shape.TETRAHEDRON: 1,
    Shape.PYRAMID: 2,
    Shape.PRISM: 3,
    Shape.HEXAHEDRON: 6,
}


def simplices_of(cut: Template) -> int:
    """Number of simplices that the cells of a template give."""
    return sum(len(rows) * SIMPLICES[shape] for shape, rows in cut.cells.items())


def pulling(shape: Shape, cells: Ints, keys: Floats) -> Ints:
    """(n, d + 1) corners of the simplices of cells (c, v) of a shape.

    keys  (c, v) any order of the corners; a face of two cells is cut in the same way if both order it in the same way

    A cell is the cone from its first corner over the facets without it, which are cut alike (Dompierre et al., How to
    subdivide pyramids, prisms and hexahedra into tetrahedra, 1999).
    """
    if shape.dimension == 2:
        return _polygons(cells, keys)
    first, parts = keys.argmin(axis=1), []
    for corner in range(cells.shape[1]):
        here = np.flatnonzero(first == corner)
        for face in (np.array(face) for face in shape.faces if corner not in face):
            bases = _polygons(cells[np.ix_(here, face)], keys[np.ix_(here, face)])
            tips = np.tile(cells[here, corner], len(bases) // max(1, len(here)))
            parts.append(np.column_stack([tips, bases]))
    return np.concatenate(parts) if parts else cells


def _polygons(cells: Ints, keys: Floats) -> Ints:
    """(n, 3) triangles of triangles or quadrilaterals, all first ones before all second ones."""
    if cells.shape[1] == 3:
        return cells
    first = keys.argmin(axis=1)
    a, b, c, d = (np.take_along_axis(cells, ((first + i) % 4)[:, None], axis=1)[:, 0] for i in range(4))
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
