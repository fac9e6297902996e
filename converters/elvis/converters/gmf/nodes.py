"""Nodes of GMF elements: where ordering tables put them, and the functions that belong to them."""

from __future__ import annotations

import numpy as np

from elvis.converters.shared.unit import SIMPLEX_AXES, UNIT, unit_basis
from elvis.converters.shared.unit import lattice as unit_lattice
from elvis.core.base.arrays import Floats, Ints
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import (
    ShapeFunctions,
    affine_image,
    bernstein,
    native_points,
    nearest_nodes,
    space_size,
)

#: minimum number of elements from which the order of nodes without a table is determined
_COMPARED = 200

#: for a triangle, tetrahedron or the triangle of a prism: number of barycentric coordinates
_BARYCENTRIC = {shape: axes + 1 for shape, axes in SIMPLEX_AXES.items()}


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
    points = unit_lattice(shape, order)
    corners = nearest_nodes(points, order * UNIT[shape].own)
    points = points[[*corners, *np.setdiff1d(np.arange(len(points)), corners)]]
    if shape not in _BARYCENTRIC:
        return points
    first = order - points[:, : SIMPLEX_AXES[shape]].sum(axis=1)
    return np.column_stack([first, points])


def guessed(shape: Shape, order: int, places: Floats) -> Ints | None:
    """(n, k) entries of nodes that no table orders, vertices first: each is where it lies in straight elements.

    places  (elements, n, 3) of the nodes
    None if that isn't one order for all elements
    """
    entries, some = lattice(shape, order), places[:_COMPARED]
    count = len(UNIT[shape].own)
    linear = unit_basis(shape, 1, UNIT[shape].own)
    points = native_points(shape, UNIT[shape].frame, unit_points(shape, entries) / order)
    straight = np.matmul(linear.at(points), some[:, :count])
    size = np.ptp(some, axis=1).max(axis=1)[:, None]
    distance = np.empty((len(entries), len(entries)))
    for node in range(len(entries)):
        away = np.linalg.norm(straight - some[:, node : node + 1], axis=2) / np.where(size > 0, size, 1)
        distance[node] = away.mean(axis=0)
    order_of = distance.argmin(axis=1)
    return entries[order_of] if len(np.unique(order_of)) == len(entries) else None


class Bernstein(ShapeFunctions):
    """The Bernstein functions of an order: products of multinomials of barycentric coordinates."""

    def __init__(self, shape: Shape, order: int, entries: Ints) -> None:
        self.shape, self.order = shape, order
        count = _BARYCENTRIC.get(shape, 0)
        self._simplex = entries[:, :count]
        self._lines = entries[:, count:]

    def tabulate(self, points: Floats) -> Floats:
        """(n, m) values at our reference points (n, d)."""
        unit = affine_image(points, self.shape.vertices, UNIT[self.shape].frame)
        result = np.ones((len(unit), len(self._simplex)))
        axes = SIMPLEX_AXES.get(self.shape, 0)
        if axes:
            first = 1 - unit[:, :axes].sum(axis=1)
            result *= bernstein(np.column_stack([first, unit[:, :axes]]), self._simplex)
        for along, powers in zip(unit[:, axes:].T, self._lines.T, strict=True):
            both = np.column_stack([powers, self.order - powers])
            result *= bernstein(np.column_stack([along, 1 - along]), both)
        return result
