"""Cells whose nodes two versions of VTK, or other programs, number differently, recognised by the nodes' positions.

Lagrange hexahedra have the nodes of two edges exchanged; Lagrange wedges have the nodes of the third quadrilateral in
the opposite direction along the triangle.  The library recognises the first by versions of files; it does not know the
second.  Firedrake puts the nodes of Lagrange curves in a row (paraview_reordering.py, vtk_interval_local_coord).
"""

from __future__ import annotations

import numpy as np

from elvis.converters.vtk.cells import Cell
from elvis.core.base.arrays import Floats, Ints
from elvis.plugins.conversion.nodal import nearest_nodes

#: nodes are near their places where they are that much nearer than they would be otherwise
_NEARER = 0.5


def upright(cell: Cell) -> tuple[Ints, Ints]:
    """The nodes inside the edges of a hexahedron over the corners (1, 1) and (0, 1)."""
    inside = (cell.nodes[:, 2] > 0) & (cell.nodes[:, 2] < 1) & (cell.nodes[:, 1] == 1)
    return np.flatnonzero(inside & (cell.nodes[:, 0] == 1)), np.flatnonzero(inside & (cell.nodes[:, 0] == 0))


def exchanged(places: Floats, cell: Cell, pair: tuple[Ints, Ints]) -> tuple[int, int]:
    """In how many cells, nodes at (n, nodes, 3), the nodes of two edges lie near their own, and in how many exchanged.

    Cells in which neither is much nearer don't count.
    """
    if not len(pair[0]):
        return 0, 0
    corners = places[:, cell.vertex_nodes()]
    middles = [(corners[:, low] + corners[:, high]) / 2 for low, high in ((2, 6), (3, 7))]
    found = [places[:, own].mean(axis=1) for own in pair]
    own, other = (
        sum(np.linalg.norm(found[i] - middles[j], axis=1) for i, j in pairs)
        for pairs in (((0, 0), (1, 1)), ((0, 1), (1, 0)))
    )
    return int(np.sum(own < _NEARER * other)), int(np.sum(other < _NEARER * own))


def third_face(cell: Cell) -> tuple[Ints, Ints]:
    """The nodes inside the face r = 0 of a wedge, and for each of them the node at the mirrored place, 1 - s for s."""
    r, s, t = cell.nodes.T
    inside = np.flatnonzero((r == 0) & (s > 0) & (s < 1) & (t > 0) & (t < 1))
    opposite = cell.nodes[inside] * [1, -1, 1] + [0, 1, 0]
    return inside, nearest_nodes(cell.nodes, opposite)


def reversed_faces(places: Floats, cell: Cell) -> tuple[int, int]:
    """In how many wedges, nodes at (n, nodes, 3), the nodes of the third face lie as read, and in how many mirrored.

    Compared are the places inside the face that its edges suggest; wedges in which neither is much nearer don't count.
    """
    inside, mirrored = third_face(cell)
    if np.array_equal(inside, mirrored):
        return 0, 0
    suggested = np.matmul(_blend(cell, inside), places)
    own, other = (np.linalg.norm(places[:, nodes] - suggested, axis=2).sum(axis=1) for nodes in (inside, mirrored))
    return int(np.sum(own < _NEARER * other)), int(np.sum(other < _NEARER * own))


def row_of_nodes(cell: Cell) -> Ints:
    """(n,) where the nodes of a curve stand among nodes that follow one another."""
    return np.rint(cell.nodes[:, 0] * cell.order).astype(np.int64)


def running(places: Floats, cell: Cell) -> tuple[int, int]:
    """In how many curves, nodes at (n, nodes, 3), the nodes run towards the last: by VTK's numbers, and as read.

    Curves of order 1 count in both.
    """
    as_read = _count_running(places)
    by_number = np.empty_like(places)
    by_number[:, row_of_nodes(cell)] = places
    return _count_running(by_number), as_read


def _count_running(places: Floats) -> int:
    """In how many rows of places (n, nodes, 3) each step goes in the direction of the chord."""
    steps = np.diff(places, axis=1)
    chords = places[:, -1] - places[:, 0]
    return int(np.all(np.einsum("nkc,nc->nk", steps, chords) > 0, axis=1).sum())


def _blend(cell: Cell, inside: Ints) -> Floats:
    """(inside, nodes) weights of the edge nodes around the face r = 0 in the positions that they imply inside.

    A bilinear Coons patch: the sum of the ruled surfaces between opposite edges, minus the bilinear part between the
    corners (Coons, Surfaces for Computer-Aided Design of Space Forms, 1967).
    """
    result = np.zeros((len(inside), len(cell.nodes)))
    for row, (_, s, t) in enumerate(cell.nodes[inside]):
        for end, weight in ((0, 1 - s), (1, s)):
            result[row, _node(cell, end, t)] += weight
        for end, weight in ((0, 1 - t), (1, t)):
            result[row, _node(cell, s, end)] += weight
            result[row, _node(cell, 0, end)] -= weight * (1 - s)
            result[row, _node(cell, 1, end)] -= weight * s
    return result


def _node(cell: Cell, s: float, t: float) -> int:
    """The node at (0, s, t)."""
    return int(nearest_nodes(cell.nodes, np.array([[0, s, t]]))[0])
