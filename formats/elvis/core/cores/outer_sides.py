"""Outer sides of volume elements, including elements that touch one only at an edge or a vertex."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.patch import Patch
from elvis.core.streamlines.neighbours import Neighbours

#: tolerance for lying on a side
_ON_SIDE = 2e-6


class OuterSides:
    """Outer sides of elements of patches, given the elements' vertices (n, k) of the mesh."""

    def __init__(self, patches: Sequence[Patch], vertices: Sequence[Ints], neighbours: Neighbours) -> None:
        self._patches, self._vertices, self._neighbours = patches, vertices, neighbours
        self._at_vertex: dict[int, set[tuple[int, int, int]]] = defaultdict(set)
        for number, (patch, own) in enumerate(zip(patches, vertices, strict=True)):
            rows = np.arange(len(patch))
            for side, local in enumerate(patch.shape.faces):
                there = np.full(len(rows), number), rows, np.full(len(rows), side)
                for row in rows[neighbours.is_outer(*there)].tolist():
                    for vertex in own[row, list(local)].tolist():
                        self._at_vertex[vertex].add((number, row, side))

    def boundary(self, patch: int, row: int, xi: Floats) -> str | None:
        """The name of the boundary on which a place of an element is, ``left`` without one; None if it is inside."""
        shape = self._patches[patch].shape
        normals, offsets = self._neighbours.facets(patch)
        near = normals @ xi + offsets < _ON_SIDE
        touched = (np.abs(shape.vertices @ normals[near].T + offsets[near]) < _ON_SIDE).all(axis=1)
        own = self._vertices[patch][row, touched].tolist()
        sides = set.intersection(*(self._at_vertex.get(vertex, set()) for vertex in own)) if own else set()
        if not sides:
            return None
        place = np.array([min(sides)])
        number = int(self._neighbours.boundary(place[:, 0], place[:, 1], place[:, 2])[0])
        return "left" if number < 0 else self._neighbours.names[number]
