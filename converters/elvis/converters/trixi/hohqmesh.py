"""Meshes of quadrilaterals that HOHQMesh writes in its form ISM-V2: curved edges on straight corners.

Layout: Trixi.jl's documentation, "Unstructured quadrilateral mesh".  A curve is a polynomial through Chebyshev-Gauss-
Lobatto nodes.  Inside, elements are the transfinite interpolation of their four edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.converters.shared.inputs import check_rows
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import content, leading

#: beginning of such files
_MAGIC = b"ISM-V2"

#: name for an inner side
_NO_NAME = "---"

#: the highest order of a curve
_HIGHEST = 30

#: the distance of the end of a curve from its corner, as a share of the element's size
_APART = 1e-6

#: corners at the ends of each edge, in the direction of its curve: below, right, above, left
_EDGES = ((0, 1), (1, 2), (3, 2), (0, 3))


@dataclass(frozen=True, eq=False)
class PlaneMesh:
    """Quadrilaterals of an order, with their edges in the order below, right, above, left.

    line      (m,) Chebyshev-Gauss-Lobatto nodes along an edge
    places    (n, m^2, 2) of the nodes of each element, the first direction fastest
    names     (n, 4) of the boundaries on which edges lie, empty inside
    links     (k, 4) element and edge of each pair of edges that belong together
    """

    line: Floats
    places: Floats
    names: NDArray[Any]
    links: Ints


def is_plane_mesh(path: Path) -> bool:
    """Whether a file is such a mesh."""
    return leading(path, len(_MAGIC)) == _MAGIC


def read_plane_mesh(path: Path) -> PlaneMesh:
    """The mesh of a file; raises FormatError if it is damaged."""
    try:
        return _Lines(content(path).decode("utf-8", "replace").split("\n")).mesh()
    except FormatError as error:
        raise error.within(path) from error


class _Lines:
    """The lines of a file, one after another."""

    def __init__(self, lines: list[str]) -> None:
        self._lines, self._next = lines, 1

    def words(self, count: int, what: str) -> list[str]:
        """The words of the next line that has some."""
        while self._next < len(self._lines):
            words = self._lines[self._next].split()
            self._next += 1
            if words:
                if len(words) != count:
                    raise self._error(f"{count} words: {what}", f"{len(words)}")
                return words
        raise self._error(what, "the end of the file")

    def integers(self, count: int, what: str) -> list[int]:
        """Whole numbers."""
        words = self.words(count, what)
        try:
            return [int(word) for word in words]
        except ValueError:
            raise self._error(f"whole numbers: {what}", " ".join(words)[:40]) from None

    def point(self, what: str) -> Floats:
        """The first two of the numbers of a line."""
        words = self._lines[self._next].split() if self._next < len(self._lines) else []
        count = len(words) if len(words) in (2, 3) else 2
        words = self.words(count, what)
        try:
            return np.array([float(word) for word in words[:2]])
        except ValueError:
            raise self._error(f"numbers: {what}", " ".join(words)[:40]) from None

    def mesh(self) -> PlaneMesh:
        """All of the mesh."""
        corners, edges, elements, order = self.integers(4, "numbers of corners, edges and elements, and the order")
        limit = len(self._lines)
        if min(corners, edges, elements) < 1 or max(corners, edges, elements) > limit or not 1 <= order <= _HIGHEST:
            raise self._error(f"up to {limit} of each and an order from 1 to {_HIGHEST}", "other numbers")
        points = np.array([self.point("a corner") for _ in range(corners)])
        table = np.array([self.integers(6, "an edge: two corners, two elements, their sides") for _ in range(edges)])
        line = -np.cos(np.pi * np.arange(order + 1) / order)
        places = np.empty((elements, (order + 1) ** 2, 2))
        names = np.full((elements, 4), "", object)
        for element in range(elements):
            places[element] = _transfinite(line, self._curves(points, line))
            words = self.words(4, "the names of the sides of an element")
            names[element] = [word if word != _NO_NAME else "" for word in words]
        return PlaneMesh(line, places, names, _links(table, elements))

    def _curves(self, points: Floats, line: Floats) -> Floats:
        """(4, m, 2) the curves of the next element."""
        own = np.array(self.integers(4, "the corners of an element"))
        check_rows(own - 1, len(points), "corners", 1, place=f"line {self._next}")
        corners = points[own - 1]
        is_curved = self.integers(4, "whether the sides of an element are curved, each 0 or 1")
        size = float(np.ptp(corners, axis=0).max())
        curves = np.empty((4, len(line), 2))
        for side, (first, last) in enumerate(_EDGES):
            ends = corners[[first, last]]
            if is_curved[side]:
                curves[side] = [self.point("a node of a curve") for _ in line]
                if np.abs(curves[side, [0, -1]] - ends).max() > _APART * size:
                    raise self._error("a curve between the corners of its side", "another")
            else:
                curves[side] = ends[0] + (line[:, None] + 1) / 2 * (ends[1] - ends[0])
        return curves

    def _error(self, expected: str, found: str) -> FormatError:
        return FormatError(f"expected {expected}, found {found}", place=f"line {self._next}")


def _transfinite(line: Floats, curves: Floats) -> Floats:
    """(m^2, 2) the nodes of an element: ruled between opposite edges, minus the bilinear part between corners.

    Kopriva, Implementing Spectral Methods for Partial Differential Equations, 2009, algorithm 98.
    """
    low, high = (1 - line) / 2, (1 + line) / 2
    below, right, above, left = curves
    ruled = low[:, None, None] * below + high[:, None, None] * above
    ruled = ruled + low[:, None] * left[:, None] + high[:, None] * right[:, None]
    corners = np.array([[below[0], below[-1]], [above[0], above[-1]]])
    weights = np.stack([low, high], axis=1)
    bilinear = np.einsum("ja,ib,abc->jic", weights, weights, corners)
    return np.asarray(ruled - bilinear).reshape(-1, 2)


def _links(table: Ints, elements: int) -> Ints:
    """(k, 4) element and side (-x, x, -y, y) of pairs of sides; ``table`` has the rows of the file."""
    inner = table[table[:, 3] > 0]
    check_rows(inner[:, 2:4] - 1, elements, "elements", 1, place="edges")
    sides = np.abs(inner[:, 4:6])
    check_rows(sides - 1, 4, "sides", 1, place="edges")
    return np.column_stack([inner[:, 2] - 1, DIRECTED[sides[:, 0] - 1], inner[:, 3] - 1, DIRECTED[sides[:, 1] - 1]])


#: the direction (-x, x, -y, y) of each side of the file: below, right, above, left
DIRECTED = np.array([2, 1, 3, 0])
