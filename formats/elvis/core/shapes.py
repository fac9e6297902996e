"""The seven reference shapes: vertices, edges, faces and their numbering (format notes 2.1).

All live in [-1, 1]^d.  Faces are listed F0, F1, F2(, F3): axis A of a face runs F0 -> F1, axis B runs F0 -> F3 on a
quadrilateral and F0 -> F2 on a triangle; edges are listed in their natural direction.

      triangle          quadrilateral        tetrahedron (v3 on top)     pyramid (apex v4)    prism (edge 45 on top)
      2                 3----2               3
      |\\                |    |               |\\ 2                        4 over 0 1 2 3       4---5  over  0 3
      | \\               |    |               | /\\                                                          1 2
      0--1              0----1               0----1                      hexahedron: 0 1 2 3 below, 4 5 6 7 above
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats


@dataclass(frozen=True, eq=False)
class ShapeFacts:
    """Constants of a shape; the entries of ``edges`` and ``faces`` are rows of ``vertices``."""

    label: str  # the SHAPE attribute of field files
    tag: str  # the letter of element entries and composites
    dimension: int
    vertices: Floats  # (n_vertices, dimension)
    edges: tuple[tuple[int, int], ...]
    faces: tuple[tuple[int, ...], ...]


def _facts(
    label: str,
    tag: str,
    vertices: list[tuple[int, ...]],
    edges: list[tuple[int, int]],
    faces: list[tuple[int, ...]],
) -> ShapeFacts:
    points = frozen_floats(vertices)
    return ShapeFacts(label, tag, points.shape[1], points, tuple(edges), tuple(faces))


_SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
_BASE = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)]
_CYCLE = [(0, 1), (1, 2), (2, 3), (3, 0)]


class Shape(Enum):
    """A reference shape; ``shape.value`` holds its data, and the properties below repeat them."""

    SEGMENT = _facts("Segment", "S", [(-1,), (1,)], [(0, 1)], [])
    TRIANGLE = _facts("Triangle", "T", [(-1, -1), (1, -1), (-1, 1)], [(0, 1), (1, 2), (2, 0)], [(0, 1, 2)])
    QUADRILATERAL = _facts("Quadrilateral", "Q", [*_SQUARE], _CYCLE, [(0, 1, 2, 3)])
    TETRAHEDRON = _facts(
        "Tetrahedron",
        "A",
        [(-1, -1, -1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)],
        [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)],
        [(0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)],
    )
    PYRAMID = _facts(
        "Pyramid",
        "P",
        [*_BASE, (-1, -1, 1)],
        [(0, 1), (1, 2), (3, 2), (0, 3), (0, 4), (1, 4), (2, 4), (3, 4)],
        [(0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (3, 2, 4), (0, 3, 4)],
    )
    PRISM = _facts(
        "Prism",
        "R",
        [*_BASE, (-1, -1, 1), (-1, 1, 1)],
        [(0, 1), (1, 2), (3, 2), (0, 3), (0, 4), (1, 4), (2, 5), (3, 5), (4, 5)],
        [(0, 1, 2, 3), (0, 1, 4), (1, 2, 5, 4), (3, 2, 5), (0, 3, 5, 4)],
    )
    HEXAHEDRON = _facts(
        "Hexahedron",
        "H",
        [*_BASE, (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)],
        [*_CYCLE, (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)],
        [(0, 1, 2, 3), (0, 1, 5, 4), (1, 2, 6, 5), (3, 2, 6, 7), (0, 3, 7, 4), (4, 5, 6, 7)],
    )

    def __repr__(self) -> str:
        return f"Shape.{self.name}"

    def __reduce_ex__(self, protocol: object) -> tuple[object, ...]:
        """Pickled by name, as facts hold arrays, which aren't found again by their values."""
        return getattr, (Shape, self.name)

    @property
    def label(self) -> str:
        """The name in field files, e.g. ``Tetrahedron``."""
        return self.value.label

    @property
    def tag(self) -> str:
        """The letter of element entries and composites, e.g. ``A`` for a tetrahedron."""
        return self.value.tag

    @property
    def dimension(self) -> int:
        """1, 2 or 3."""
        return self.value.dimension

    @property
    def vertices(self) -> Floats:
        """(n_vertices, dimension) reference coordinates, each -1 or 1."""
        return self.value.vertices

    @property
    def centre(self) -> Floats:
        """(dimension,) the mean of the vertices."""
        return np.asarray(self.vertices.mean(axis=0))

    @property
    def edges(self) -> tuple[tuple[int, int], ...]:
        """Pairs of local vertices."""
        return self.value.edges

    @property
    def faces(self) -> tuple[tuple[int, ...], ...]:
        """Local vertices of each face; a 2D shape is its own only face."""
        return self.value.faces

    @classmethod
    def of_dimension(cls, dimension: int) -> tuple[Shape, ...]:
        """The shapes of one dimension, in the order of the format."""
        return tuple(shape for shape in cls if shape.dimension == dimension)

    @classmethod
    def from_label(cls, label: str) -> Shape:
        """The shape that field files call ``label``; raises KeyError if there is none."""
        return {shape.label: shape for shape in cls}[label]


#: shapes whose expansions are products of one in each direction
TENSOR = (Shape.SEGMENT, Shape.QUADRILATERAL, Shape.HEXAHEDRON)
