"""The sides of a mesh rows_of by the numbers of their vertices: sorted once, then looked up for any boundary."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Ints
from elvis.core.mapping.orientation import first_face_row, polygon_vertices
from elvis.core.mesh import Mesh
from elvis.core.shapes import Shape


class Sides:
    """The faces of a mesh (edges in 2D, vertices in 1D).

    numbers  (n_vertices,) the source's number of each vertex
    """

    def __init__(self, mesh: Mesh, numbers: Ints) -> None:
        self._mesh, self._numbers = mesh, numbers
        self._indices: dict[int, _Index] = {}

    def matched(self, wanted: Ints) -> tuple[Ints, int]:
        """Rows of the sides whose vertices have the numbers ``wanted`` (n, k), and how many of these fit none."""
        if not wanted.size:
            return np.empty(0, np.int64), 0
        corners = wanted.shape[1]
        if corners not in self._indices:
            own, first = _sides_of(self._mesh, corners)
            self._indices[corners] = _Index(self._numbers[own], first)
        return self._indices[corners].rows_of(wanted)


class _Index:
    """Sides with vertices ``own`` (n, k), the first of them in row ``first``."""

    def __init__(self, own: Ints, first: int) -> None:
        self._known, ranks = np.unique(own, return_inverse=True)
        columns = np.sort(ranks.reshape(own.shape), axis=1).T
        # a side is one number: that of what comes before its last vertex, times the number of vertices, plus the last
        self._levels: list[Ints] = []
        codes = columns[0]
        for column in columns[1:]:
            level, codes = np.unique(codes * len(self._known) + column, return_inverse=True)
            self._levels.append(level)
            codes = codes.reshape(-1)
        self._rows = first + np.argsort(codes, kind="stable")
        self._codes = np.sort(codes)

    def rows_of(self, wanted: Ints) -> tuple[Ints, int]:
        """Rows of the sides that have the vertices ``wanted`` (n, k), and how many of these no side has."""
        ranks = _places(self._known, wanted)
        columns = np.sort(ranks, axis=1).T
        codes, is_known = columns[0], columns[0] >= 0
        for level, column in zip(self._levels, columns[1:], strict=True):
            codes = _places(level, codes * len(self._known) + column)
            is_known = is_known & (codes >= 0)
        asked = np.unique(codes[is_known])
        starts, ends = (np.searchsorted(self._codes, asked, side) for side in ("left", "right"))
        several = np.repeat(ends - np.cumsum(ends - starts), ends - starts) + np.arange(int((ends - starts).sum()))
        return np.sort(self._rows[several]), int((~is_known).sum())


def _places(ascending: Ints, values: Ints) -> Ints:
    """Where values are in an ascending array, in their shape; -1 for those that aren't there."""
    if not len(ascending):
        return np.full(values.shape, -1)
    places = np.minimum(np.searchsorted(ascending, values), len(ascending) - 1)
    return np.where(ascending[places] == values, places, -1)


def _sides_of(mesh: Mesh, corners: int) -> tuple[Ints, int]:
    """Vertex rows (n, corners) of the sides with this many corners, and the row of the first among all sides."""
    if mesh.dimension == 1:
        return np.arange(len(mesh.vertices))[:, None], 0
    if mesh.dimension == 2:
        return mesh.of(Shape.SEGMENT).members, 0
    kind = Shape.TRIANGLE if corners == 3 else Shape.QUADRILATERAL
    return polygon_vertices(mesh, kind), first_face_row(mesh, kind)
