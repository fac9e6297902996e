"""Unit reference elements: coordinates from 0 to 1, as many solvers number them."""

from __future__ import annotations

from typing import NamedTuple

from elvis.core.arrays import Floats, frozen_floats
from elvis.core.shapes import Shape

_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
_BASE = tuple((*corner, 0) for corner in _SQUARE)


class Unit(NamedTuple):
    """A reference element whose triangles have their right angle at the origin; a prism is two triangles, one above.

    frame    (n_vertices, d) coordinates of the vertices in the local order of our shape
    corners  which of its own vertices each of ours is
    """

    frame: Floats
    corners: list[int]

    @property
    def own(self) -> Floats:
        """(n_vertices, d) coordinates of the vertices in the element's own order."""
        order = sorted(range(len(self.corners)), key=self.corners.__getitem__)
        return frozen_floats(self.frame[order])


def _unit(frame: tuple[tuple[int, ...], ...], corners: tuple[int, ...] | None = None) -> Unit:
    return Unit(frozen_floats(frame), list(corners or range(len(frame))))


UNIT = {
    Shape.SEGMENT: _unit(((0,), (1,))),
    Shape.TRIANGLE: _unit(((0, 0), (1, 0), (0, 1))),
    Shape.QUADRILATERAL: _unit(_SQUARE),
    Shape.TETRAHEDRON: _unit(((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))),
    Shape.PYRAMID: _unit((*_BASE, (0, 0, 1))),
    Shape.PRISM: _unit(((0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 0), (1, 0, 1)), (0, 2, 5, 3, 1, 4)),
    Shape.HEXAHEDRON: _unit((*_BASE, *((*corner, 1) for corner in _SQUARE))),
}
