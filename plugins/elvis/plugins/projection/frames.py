"""Reference frames: from points in the frame of a native element to points of the source's element.

A native element is the source's element with its vertices in another order, so that shared triangles collapse alike
(format notes 2.3), or a hexahedron whose upper vertices coincide in the apex of a pyramid.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.shapes import Shape


def _is_even(order: tuple[int, ...]) -> bool:
    return sum(a > b for i, a in enumerate(order) for b in order[i + 1 :]) % 2 == 0


#: vertex orders in which an element may be written; native local vertex j is vertex order[j] of the source's element.
#: The first is the source's own, orders in `PROPER` keep right-handed elements right-handed
PROPER: Mapping[Shape, tuple[tuple[int, ...], ...]] = {
    Shape.SEGMENT: ((0, 1),),
    Shape.TRIANGLE: ((0, 1, 2),),
    Shape.QUADRILATERAL: ((0, 1, 2, 3),),
    Shape.TETRAHEDRON: tuple(order for order in permutations(range(4)) if _is_even(order)),
    Shape.PYRAMID: ((0, 1, 2, 3, 4),),
    Shape.PRISM: ((0, 1, 2, 3, 4, 5), (1, 4, 5, 2, 0, 3), (4, 0, 3, 5, 1, 2)),
    Shape.HEXAHEDRON: (tuple(range(8)),),
}

#: one order that turns left-handed elements into right-handed ones
MIRRORED: Mapping[Shape, tuple[int, ...]] = {
    Shape.SEGMENT: (1, 0),
    Shape.TRIANGLE: (1, 0, 2),
    Shape.QUADRILATERAL: (1, 0, 3, 2),
    Shape.TETRAHEDRON: (1, 0, 2, 3),
    Shape.PYRAMID: (1, 0, 3, 2, 4),
    Shape.PRISM: (3, 2, 1, 0, 5, 4),
    Shape.HEXAHEDRON: (4, 5, 6, 7, 0, 1, 2, 3),
}


def orders(shape: Shape, is_mirrored: bool) -> tuple[tuple[int, ...], ...]:
    """The vertex orders that native elements of a shape may take."""
    if not is_mirrored:
        return PROPER[shape]
    mirror = MIRRORED[shape]
    return tuple(tuple(mirror[j] for j in order) for order in PROPER[shape])


@bounded_cache
def affine(shape: Shape, order: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Matrix (d, d) and offset (d,) that map native reference points to points of the source's element."""
    return affine_between(shape.vertices, shape.vertices[list(order)])


def affine_between(vertices: Floats, targets: Floats) -> tuple[Floats, Floats]:
    """Matrix and offset of the affine map that takes points (n, d) to others (n, d); ElvisError where none does."""
    padded = np.column_stack([vertices, np.ones(len(vertices))])
    solution = np.linalg.lstsq(padded, targets, rcond=None)[0]
    if not np.allclose(padded @ solution, targets, rtol=0, atol=1e-12 * (1 + np.abs(targets).max())):
        raise ElvisError("expected reference vertices that are an affine image of the shape's own")
    return frozen_floats(solution[:-1].T), frozen_floats(solution[-1])


def source_points(shape: Shape, order: tuple[int, ...], points: Floats, is_collapsed: bool = False) -> Floats:
    """(n, d) points in the coordinates of ``shape`` that native reference points (n, d) stand for.

    is_collapsed  the native element is a hexahedron that stands for a pyramid
    """
    own = uncollapse(Shape.PYRAMID, points) if is_collapsed else points
    if order == PROPER[shape][0]:
        return own
    matrix, offset = affine(shape, order)
    return np.asarray(own @ matrix.T + offset)
