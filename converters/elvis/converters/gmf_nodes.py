"""Nodes of GMF elements: where ordering tables put them, and the functions that belong to them."""

from __future__ import annotations

from math import comb, factorial, prod

import numpy as np

from elvis.converters.unit import UNIT
from elvis.core.arrays import Floats, Ints
from elvis.core.shapes import Shape
from elvis.plugins.conversion import PyramidSpace
from elvis.plugins.nodal import NodalBasis, native_points, space_size

#: at least so many elements tell where nodes lie that no table orders
_JUDGED = 200

#: of a triangle, tetrahedron or the triangle of a prism: numbers of barycentric coordinates
_BARYCENTRIC = {Shape.TRIANGLE: 3, Shape.TETRAHEDRON: 4, Shape.PRISM: 3}


def unit_points(shape: Shape, entries: Floats | Ints) -> Floats:
    """(n, d) coordinates in the unit element of entries (n, k): barycentric ones of triangles and tetrahedra first."""
    return np.asarray(entries[:, 1:] if shape in _BARYCENTRIC else entries, np.float64)


def is_lattice(shape: Shape, order: int, entries: Ints) -> bool:
    """Whether entries (n, k) of an ordering table are every node of a lattice once."""
    count = _BARYCENTRIC.get(shape, 0)
    if len(entries) != space_size(shape, order) or entries.min() < 0 or entries.max() > order:
        return False
    if count and (entries[:, :count].sum(axis=1) != order).any():
        return False
    if shape is Shape.PYRAMID and (entries[:, :2].max(axis=1) + entries[:, 2] > order).any():
        return False
    return len(np.unique(entries, axis=0)) == len(entries)


def lattice(shape: Shape, order: int) -> Ints:
    """(n, k) entries of all nodes of an order, in some order; the vertices first, in the format's."""
    cube = np.stack([axis.reshape(-1) for axis in np.indices((order + 1,) * shape.dimension)], axis=1)
    if shape in _BARYCENTRIC:
        kept = cube[:, : _BARYCENTRIC[shape] - 1].sum(axis=1) <= order
        cube = cube[kept]
        first = order - cube[:, : _BARYCENTRIC[shape] - 1].sum(axis=1)
        cube = np.column_stack([first, cube])
    elif shape is Shape.PYRAMID:
        cube = cube[cube[:, :2].max(axis=1) + cube[:, 2] <= order]
    points = unit_points(shape, cube)
    corners = [int(np.flatnonzero((points == order * own).all(axis=1))[0]) for own in UNIT[shape].own]
    return cube[[*corners, *np.setdiff1d(np.arange(len(cube)), corners)]]


def guessed(shape: Shape, order: int, places: Floats) -> Ints | None:
    """(n, k) entries of nodes that no table orders, vertices first: each is where it lies in straight elements.

    places  (elements, n, 3) of the nodes
    None where that isn't one order for all elements
    """
    entries, some = lattice(shape, order), places[:_JUDGED]
    count = len(UNIT[shape].own)
    linear = NodalBasis(shape, 1, native_points(shape, UNIT[shape].frame, UNIT[shape].own), PyramidSpace.RATIONAL)
    points = native_points(shape, UNIT[shape].frame, unit_points(shape, entries) / order)
    straight = np.matmul(linear.at(points), some[:, :count])
    size = np.ptp(some, axis=1).max(axis=1)[:, None]
    distance = np.empty((len(entries), len(entries)))
    for node in range(len(entries)):
        away = np.linalg.norm(straight - some[:, node : node + 1], axis=2) / np.where(size > 0, size, 1)
        distance[node] = away.mean(axis=0)
    order_of = distance.argmin(axis=1)
    return entries[order_of] if len(np.unique(order_of)) == len(entries) else None


class Bernstein:
    """The Bernstein functions of an order: products of multinomials of barycentric coordinates."""

    def __init__(self, shape: Shape, order: int, entries: Ints) -> None:
        self.shape, self.order = shape, order
        count = _BARYCENTRIC.get(shape, 0)
        self._simplex = entries[:, :count]
        self._lines = entries[:, count:]

    def at(self, points: Floats) -> Floats:
        """(n, m) values at our reference points (n, d)."""
        from elvis.plugins.projection.frames import affine_between

        matrix, offset = affine_between(self.shape.vertices, UNIT[self.shape].frame)
        unit = np.asarray(points @ matrix.T + offset)
        result = np.ones((len(unit), len(self._simplex)))
        count = self._simplex.shape[1]
        if count:
            barycentric = np.column_stack([1 - unit[:, : count - 1].sum(axis=1), unit[:, : count - 1]])
            weights = [factorial(self.order) / prod(map(factorial, row)) for row in self._simplex.tolist()]
            result *= np.array(weights) * np.prod(barycentric[:, None, :] ** self._simplex, axis=2)
        for axis in range(self._lines.shape[1]):
            t, i = unit[:, [max(count - 1, 0) + axis]], self._lines[:, axis]
            binomials = np.array([comb(self.order, k) for k in i.tolist()], np.float64)
            result *= binomials * t**i * (1 - t) ** (self.order - i)
        return result
