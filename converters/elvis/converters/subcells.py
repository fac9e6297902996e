"""Sub-cells: hexahedra cut into boxes of their reference element, one value each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.shapes import Shape
from elvis.plugins.conversion import Boundary
from elvis.plugins.nodal import NodalBasis


@dataclass(frozen=True, eq=False)
class SubCells:
    """Boxes of some hexahedra, all of one element together, the first direction fastest.

    elements  (k,) rows of the hexahedra
    widths    (n,) of the boxes along each direction; their sum is 2
    """

    elements: Ints
    widths: Floats

    @property
    def count(self) -> int:
        """Number of boxes each way."""
        return len(self.widths)

    def positions(self, rows: slice | Ints, points: Floats, basis: NodalBasis, nodes: Floats) -> Floats:
        """(r, n, 3) where points (n, 3) of boxes ``rows`` lie, by the map of the hexahedra: ``basis`` and ``nodes``."""
        own, box = np.divmod(self._rows(rows), self.count**3)
        ends = np.concatenate([[-1.0], np.cumsum(self.widths) - 1])
        result = np.empty((len(own), len(points), 3))
        for number in np.unique(box).tolist():
            here = np.flatnonzero(box == number)
            place = np.array([number, number // self.count, number // self.count**2]) % self.count
            inside = ends[place] + self.widths[place] * (1 + points) / 2
            result[here] = np.einsum("eni,pn->epi", nodes[self.elements[own[here]]], basis.at(inside))
        return result

    def values(self, rows: slice | Ints, means: Floats) -> Floats:
        """(r,) of boxes ``rows`` from the means (m, n^3) of all hexahedra."""
        own, box = np.divmod(self._rows(rows), self.count**3)
        return np.asarray(means[self.elements[own], box])

    def parted(self, boundary: Boundary, others: Ints) -> Boundary:
        """A boundary of one block of hexahedra, with its sides on ``others`` and on boxes as blocks 0 and 1."""
        ((_, rows, faces),) = boundary.sides
        is_other = np.isin(rows, others)
        place = np.searchsorted(others, rows[is_other])
        own, sides = np.searchsorted(self.elements, rows[~is_other]), faces[~is_other]
        grid = np.arange(self.count**3)
        found: list[tuple[Ints, Ints]] = [(np.empty(0, np.int64), np.empty(0, np.int64))]
        for face, local in enumerate(Shape.HEXAHEDRON.faces):
            corners = Shape.HEXAHEDRON.vertices[list(local)]
            axis = int(np.flatnonzero(np.ptp(corners, axis=0) == 0)[0])
            last = 0 if corners[0, axis] < 0 else self.count - 1
            outer = np.flatnonzero(grid // self.count**axis % self.count == last)
            boxes = (own[sides == face][:, None] * self.count**3 + outer).reshape(-1)
            found.append((boxes, np.full(len(boxes), face)))
        boxes, local_faces = (np.concatenate(each) for each in zip(*found, strict=True))
        return Boundary(boundary.name, sides=[(0, place, faces[is_other]), (1, boxes, local_faces)])

    def _rows(self, rows: slice | Ints) -> Ints:
        return np.arange(len(self.elements) * self.count**3)[rows] if isinstance(rows, slice) else rows
