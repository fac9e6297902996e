"""Values on the sides of elements, at points that both elements of a side see in the same order.

The points are given by weights of the side's vertices, counted from the vertex with the lowest row in the mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.orientation import local_vertices
from elvis.core.shapes import Shape

#: positions on a side are multiples of 1 over this number
_PLACES = 1 << 20
#: values (n, q, …) of elements in rows (n,) at reference points (q, d)
ValuesAt = Callable[[Ints, Floats], Floats]


@dataclass(frozen=True, eq=False)
class SideTraces:
    """Values on sides with the same number of corners.

    corners  number of corners
    side     (n,) rows of the sides in the mesh
    element  (n,) rows of the elements
    values   (n, q, …) at the points of `lattice`
    """

    corners: int
    side: Ints
    element: Ints
    values: Floats


def side_traces(mesh: Mesh, shape: Shape, element_ids: Ints, along: int, values_at: ValuesAt) -> Iterator[SideTraces]:
    """The values on all sides of elements of a shape, at ``along`` points along each edge."""
    entities = mesh.of(shape)
    rows = entities.rows_of(element_ids)
    vertices, members = local_vertices(mesh, shape)[rows], entities.members[rows]
    for number, local in enumerate(_local_sides(shape)):
        turns = _turns(vertices[:, local])
        for turn in np.unique(turns, axis=0):
            here = np.flatnonzero((turns == turn).all(axis=1))
            points = lattice(len(local), along) @ shape.vertices[np.array(local)[turn]]
            yield SideTraces(len(local), members[here, number], here, values_at(here, points))


def shared_pairs(side: Ints) -> tuple[Ints, Ints]:
    """Places of neighbouring pairs of equal numbers in (n,), in a stable order."""
    order = np.argsort(side, kind="stable")
    first, second = order[:-1], order[1:]
    shared = side[first] == side[second]
    return first[shared], second[shared]


@bounded_cache
def lattice(corners: int, along: int) -> Floats:
    """(n, corners) weights of a side's vertices at the points of a lattice."""
    if corners == 1:
        return frozen_floats([[1.0]])
    # products of such places are exact, so that points on quadrilaterals form a lattice to the last digit (`lattices`)
    t = np.round(np.linspace(0.0, 1.0, along) * _PLACES) / _PLACES
    if corners == 2:
        return frozen_floats(np.stack([1 - t, t], axis=1))
    a, b = (part.reshape(-1) for part in np.meshgrid(t, t))
    if corners == 3:
        inside = a + b <= 1 + 1e-12
        return frozen_floats(np.stack([1 - a - b, a, b], axis=1)[inside])
    return frozen_floats(np.stack([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b], axis=1))


def _local_sides(shape: Shape) -> Sequence[tuple[int, ...]]:
    """Local vertices of each side, in the order of the mesh's members."""
    return {1: ((0,), (1,)), 2: shape.edges, 3: shape.faces}[shape.dimension]


def _turns(vertices: Ints) -> Ints:
    """(n, k) the order in which vertices (n, k) of sides are taken: from the lowest on, towards its lower neighbour."""
    if vertices.shape[1] < 4:
        return np.argsort(vertices, axis=1)
    first = vertices.argmin(axis=1)[:, None]
    around = np.take_along_axis(vertices, (first + np.array([1, 3])) % 4, axis=1)
    way = np.where(around[:, :1] < around[:, 1:], 1, -1)
    return np.asarray((first + way * np.arange(4)) % 4)
