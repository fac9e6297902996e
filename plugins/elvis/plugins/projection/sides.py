"""The sides of a mesh found by the numbers of their vertices: sorted once, then looked up for any boundary."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Bools, Ints, distinct_rows
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.orientation import first_face_row, polygon_vertices
from elvis.core.shapes import Shape

#: part of a side's size within which two sides are at one place
SAME_PLACE = 1e-3


class Sides:
    """The faces of a mesh (edges in 2D, vertices in 1D).

    numbers  (n_vertices,) the source's number of each vertex
    """

    def __init__(self, mesh: Mesh, numbers: Ints) -> None:
        self._mesh, self._numbers = mesh, numbers
        self._indices: dict[int, _Index] = {}
        self._tables: dict[int, Ints] = {}

    def matched(self, wanted: Ints) -> tuple[Ints, int]:
        """Rows of the sides whose vertices have the numbers ``wanted`` (n, k), and how many of these fit none."""
        if not wanted.size:
            return np.empty(0, np.int64), 0
        corners = wanted.shape[1]
        rows, is_known = self._index(corners).rows_of(wanted)
        if corners == 3 and not is_known.all():
            collapsed, is_collapsed = self._collapsed(wanted[~is_known])
            rows = np.union1d(rows, collapsed)
            is_known[~is_known] = is_collapsed
        return rows, int((~is_known).sum())

    def repeated(self, rows: Ints) -> Ints:
        """Sides whose vertices have the same numbers as another side at another position, ascending.

        A periodic mesh identifies these sides.
        """
        found = [np.empty(0, np.int64)]
        for corners in {1: (1,), 2: (2,), 3: (3, 4)}[self._mesh.dimension]:
            first, count = _rows_of(self._mesh, corners)
            chosen = np.unique(rows[(rows >= first) & (rows < first + count)]) - first
            if not len(chosen):
                continue
            own = self._vertices(corners)[chosen]
            is_numbered = (self._numbers[own] >= 0).all(axis=1)
            chosen, own = chosen[is_numbered], own[is_numbered]
            _, which = distinct_rows(self._numbers[own])
            several = np.flatnonzero(np.bincount(which)[which] > 1)
            found.append(first + chosen[several[self._are_apart(own[several], which[several])]])
        return np.unique(np.concatenate(found))

    def _are_apart(self, vertices: Ints, which: Ints) -> Bools:
        """(n,) whether not all sides of the same set ``which`` (n,) lie at one place."""
        count = int(which.max(initial=-1)) + 1
        middle = self._mesh.vertices[vertices].mean(axis=1)
        first = np.zeros(count, np.int64)
        first[which[::-1]] = np.arange(len(which))[::-1]
        size = np.ptp(self._mesh.vertices[vertices], axis=1).max(axis=1)
        is_off = np.abs(middle - middle[first[which]]).max(axis=1) > SAME_PLACE * size
        any_off = np.zeros(count, bool)
        any_off[which[is_off]] = True
        return any_off[which]

    def _index(self, corners: int) -> _Index:
        if corners not in self._indices:
            own, (first, _) = self._vertices(corners), _rows_of(self._mesh, corners)
            self._indices[corners] = _Index(self._numbers[own], first)
        return self._indices[corners]

    def _vertices(self, corners: int) -> Ints:
        """(n, corners) vertex rows of the sides with this many corners."""
        if corners not in self._tables:
            self._tables[corners] = _vertices_of_sides(self._mesh, corners)
        return self._tables[corners]

    def _collapsed(self, wanted: Ints) -> tuple[Ints, Bools]:
        """Rows of quadrilaterals that are triangles ``wanted`` (n, 3) with one corner twice, and which (n,) are found.

        Such are the sides of hexahedra that stand for pyramids.
        """
        found, is_found = np.empty(0, np.int64), np.zeros(len(wanted), bool)
        if not len(self._mesh.of(Shape.QUADRILATERAL)):
            return found, is_found
        for corner in range(3):
            rows, is_known = self._index(4).rows_of(np.column_stack([wanted, wanted[:, corner]]))
            found = np.union1d(found, rows)
            is_found |= is_known
        return found, is_found


class _Index:
    """Sides with vertices ``own`` (n, k), the first of them in row ``first``."""

    def __init__(self, own: Ints, first: int) -> None:
        self._known, ranks = np.unique(own, return_inverse=True)
        columns = np.sort(ranks.reshape(own.shape), axis=1).T
        # a side is one number: the number of the vertices before its last one, times the number of vertices, plus the
        # last
        self._levels: list[Ints] = []
        codes = columns[0]
        for column in columns[1:]:
            level, codes = np.unique(codes * len(self._known) + column, return_inverse=True)
            self._levels.append(level)
            codes = codes.reshape(-1)
        self._rows = first + np.argsort(codes, kind="stable")
        self._codes = np.sort(codes)

    def rows_of(self, wanted: Ints) -> tuple[Ints, Bools]:
        """Rows of the sides that have the vertices ``wanted`` (n, k), and for which (n,) of these there is a side."""
        ranks = _places(self._known, wanted)
        columns = np.sort(ranks, axis=1).T
        codes, is_known = columns[0], columns[0] >= 0
        for level, column in zip(self._levels, columns[1:], strict=True):
            codes = _places(level, codes * len(self._known) + column)
            is_known = is_known & (codes >= 0)
        asked = np.unique(codes[is_known])
        starts, ends = (np.searchsorted(self._codes, asked, side) for side in ("left", "right"))
        several = np.repeat(ends - np.cumsum(ends - starts), ends - starts) + np.arange(int((ends - starts).sum()))
        return np.sort(self._rows[several]), np.asarray(is_known)


def _places(ascending: Ints, values: Ints) -> Ints:
    """Positions of values in an ascending array, in their shape; -1 for absent values."""
    if not len(ascending):
        return np.full(values.shape, -1)
    places = np.minimum(np.searchsorted(ascending, values), len(ascending) - 1)
    return np.where(ascending[places] == values, places, -1)


def _rows_of(mesh: Mesh, corners: int) -> tuple[int, int]:
    """The row, among all sides, of the first one with this many corners, and how many there are."""
    if mesh.dimension == 1:
        return 0, len(mesh.vertices)
    if mesh.dimension == 2:
        return 0, len(mesh.of(Shape.SEGMENT))
    kind = Shape.TRIANGLE if corners == 3 else Shape.QUADRILATERAL
    return first_face_row(mesh, kind), len(mesh.of(kind))


def _vertices_of_sides(mesh: Mesh, corners: int) -> Ints:
    """(n, corners) vertex rows of the sides with this many corners."""
    if mesh.dimension == 1:
        return np.arange(len(mesh.vertices))[:, None]
    if mesh.dimension == 2:
        return mesh.of(Shape.SEGMENT).members
    return polygon_vertices(mesh, Shape.TRIANGLE if corners == 3 else Shape.QUADRILATERAL)
