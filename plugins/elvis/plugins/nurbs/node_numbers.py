"""Numbers of the nodes of hexahedra that share vertices, edges and faces, in MFEM's order.

Vertices come first, then the insides of edges, of faces and of elements.  An edge runs from its lower to its higher
vertex; a face runs as in the first element that has it (MFEM, mesh/mesh.cpp and mesh/nurbs.cpp).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elvis.core.base.arrays import Ints

#: corners of the hexahedron in the order of its vertices, in {0, 1}^3
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
EDGES = ((0, 1), (1, 2), (3, 2), (0, 3), (4, 5), (5, 6), (7, 6), (4, 7), (0, 4), (1, 5), (2, 6), (3, 7))
FACES = ((3, 2, 1, 0), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7))

Key = tuple[int, ...]


def numbered(
    elements: Ints, counts: Sequence[Sequence[int]], edges: Sequence[Sequence[int]] = ()
) -> tuple[list[Ints], int]:
    """For each hexahedron an array (n_x, n_y, n_z) of node numbers, and how many nodes there are.

    elements  (n, 8) vertices, numbered from 0
    counts    nodes of each element in its three directions, both ends included
    edges     pairs of vertices in the order of the file; by default edges are numbered as elements meet them
    """
    grids = [np.zeros(tuple(some), np.int64) for some in counts]
    entities = [list(some) for some in _entities(elements.tolist())]

    # nodes inside every entity, entities by dimension in the order in which they are met
    inside: list[dict[Key, int]] = [{}, {tuple(sorted(edge)): 0 for edge in edges}, {}, {}]
    for grid, own in zip(grids, entities, strict=True):
        for dimension, key, frame in own:
            inside[dimension][key] = len(_nodes(grid.shape, frame))
    starts, total = {}, int(elements.max(initial=-1)) + 1
    for of_dimension in inside[1:]:
        for key, count in of_dimension.items():
            starts[key] = total
            total += count

    # every entity numbers its nodes in each element that has it
    for grid, own in zip(grids, entities, strict=True):
        for dimension, key, frame in own:
            nodes = _nodes(grid.shape, frame)
            start = starts[key] if dimension else key[0]
            grid[tuple(nodes.T)] = start + np.arange(len(nodes))
    return grids, total


def _entities(elements: list[list[int]]) -> Iterator[Iterator[tuple[int, Key, Key]]]:
    """For each element its vertices, edges, faces and itself: dimension, a key, and the frame: local corners at the
    origin and at the ends of the directions."""
    bases: dict[Key, list[int]] = {}
    for number, vertices in enumerate(elements):
        yield iter([*_frames(vertices, bases), (3, (-1, number), (0, 1, 3, 4))])


def _frames(vertices: list[int], bases: dict[Key, list[int]]) -> Iterator[tuple[int, Key, Key]]:
    """Vertices, edges and faces of one element; ``bases`` remembers how the first element ran round each face."""
    for corner, vertex in enumerate(vertices):
        yield 0, (vertex,), (corner,)
    for a, b in EDGES:
        low, high = sorted((a, b), key=vertices.__getitem__)
        yield 1, (vertices[low], vertices[high]), (low, high)
    for corners in FACES:
        round_ = [vertices[corner] for corner in corners]
        base = bases.setdefault(tuple(sorted(round_)), round_)
        first, second, _, last = (vertices.index(vertex) for vertex in base)
        yield 2, tuple(sorted(round_)), (first, second, last)


def _nodes(shape: tuple[int, ...], frame: Key) -> Ints:
    """(n, 3) indices of the nodes inside the entity with this frame, its first direction fastest."""
    last = np.array(shape) - 1
    nodes = (CORNERS[frame[0]] * last)[None]
    for end in frame[1:]:
        direction = CORNERS[end] - CORNERS[frame[0]]
        steps = np.arange(1, last[np.flatnonzero(direction)[0]])
        nodes = (steps[:, None, None] * direction + nodes[None]).reshape(-1, 3)
    return np.asarray(nodes)
