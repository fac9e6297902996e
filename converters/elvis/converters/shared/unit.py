"""Unit reference elements: coordinates from 0 to 1, as many solvers number them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import NodalBasis, native_points
from elvis.plugins.conversion.plugin import PyramidSpace
from elvis.plugins.projection.naming import local_sides

#: number of first axes of a shape that span a triangle or tetrahedron
SIMPLEX_AXES = {Shape.TRIANGLE: 2, Shape.TETRAHEDRON: 3, Shape.PRISM: 2}

_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
_BASE = tuple((*corner, 0) for corner in _SQUARE)


class Unit(NamedTuple):
    """A reference element whose triangles have their right angle at the origin; a prism is two triangles, one above.

    frame    (n_vertices, d) coordinates of the vertices in the local order of our shape
    corners  for each of our vertices, its own vertex
    """

    frame: Floats
    corners: list[int]

    @property
    def own(self) -> Floats:
        """(n_vertices, d) coordinates of the vertices in the element's own order."""
        order = sorted(range(len(self.corners)), key=self.corners.__getitem__)
        return frozen_floats(self.frame[order])


def _unit(frame: tuple[tuple[int, ...], ...], corners: tuple[int, ...] | None = None) -> Unit:
    return Unit(frozen_floats(frame), list(corners or range(len(frame))))


UNIT = {
    Shape.SEGMENT: _unit(((0,), (1,))),
    Shape.TRIANGLE: _unit(((0, 0), (1, 0), (0, 1))),
    Shape.QUADRILATERAL: _unit(_SQUARE),
    Shape.TETRAHEDRON: _unit(((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))),
    Shape.PYRAMID: _unit((*_BASE, (0, 0, 1))),
    Shape.PRISM: _unit(((0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 0), (1, 0, 1)), (0, 2, 5, 3, 1, 4)),
    Shape.HEXAHEDRON: _unit((*_BASE, *((*corner, 1) for corner in _SQUARE))),
}


def side_numbers(shape: Shape, sides: Sequence[tuple[int, ...]]) -> Ints:
    """Our local sides of a shape in the order of sides that are given by the element's own corners."""
    own = UNIT[shape].corners
    known = [{int(own[corner]) for corner in side} for side in local_sides(shape)]
    return np.array([known.index(set(corners)) for corners in sides])


def directed_sides(shape: Shape) -> Ints:
    """(2 d,) local sides of a segment, quadrilateral or hexahedron towards -x, x, -y, y, -z, z."""
    sides = [shape.vertices[list(side)] for side in local_sides(shape)]
    found = []
    for axis in range(shape.dimension):
        for end in (-1.0, 1.0):
            found += [number for number, corners in enumerate(sides) if (corners[:, axis] == end).all()]
    return np.array(found)


def lattice(shape: Shape, order: int) -> Ints:
    """(n, d) coordinates, times the order, of the evenly spaced nodes of a unit element; the first is the fastest."""
    grid = np.indices((order + 1,) * shape.dimension).reshape(shape.dimension, -1)[::-1].T
    if shape is Shape.PYRAMID:
        return np.asarray(grid[grid[:, :2].max(axis=1) + grid[:, 2] <= order])
    axes = SIMPLEX_AXES.get(shape, 0)
    return np.asarray(grid[grid[:, :axes].sum(axis=1) <= order])


def unit_basis(shape: Shape, order: int, nodes: Floats | Ints) -> NodalBasis:
    """The functions of nodes (n, d) of a unit element, rational for pyramids; raises ElvisError as `NodalBasis`."""
    own = native_points(shape, UNIT[shape].frame, np.asarray(nodes, np.float64))
    return NodalBasis(shape, order, own, PyramidSpace.RATIONAL)
