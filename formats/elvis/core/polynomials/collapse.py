"""Collapsed coordinates: the square or cube that folds onto a simplex, prism or pyramid (format notes 2.2).

Both the reference coordinates xi and the collapsed coordinates eta live in [-1, 1]^d; on segments, quadrilaterals and
hexahedra they coincide.  Points are (n, d).
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.shapes import Shape

#: denominators of smaller magnitude, as at a collapsed vertex, where any eta is valid, are replaced by this; at the
#: level of rounding, so that functions and their gradients do not jump on the way there (Nektar++ itself: 1e-12)
GUARD = 1e-15
#: Points near a collapsed vertex, outside the element, are moved this far off the line or plane that folds onto it.
#: The value is larger than the guard, and a power of two, so that 1 - (1 - step) is exact.
_STEP = 2.0**-49


def collapse(shape: Shape, points: Floats) -> Floats:
    """(n, d) collapsed coordinates eta of the reference points xi (n, d).

    On triangles and prisms, polynomials in xi also hold outside the element, and Newton's method goes there.  Points on
    the line or plane that folds onto the collapsed vertex or edge have no eta; they are moved off it by 2^-49.
    """
    xi = np.asarray(points, np.float64)
    eta = xi.copy()
    if shape in (Shape.TRIANGLE, Shape.PRISM):
        eta[:, -1] = _off_the_fold(xi[:, 0], xi[:, -1])
        eta[:, 0] = _fold(xi[:, 0], 1 - eta[:, -1])
    elif shape is Shape.PYRAMID:
        eta[:, 0] = _fold(xi[:, 0], 1 - xi[:, 2])
        eta[:, 1] = _fold(xi[:, 1], 1 - xi[:, 2])
    elif shape is Shape.TETRAHEDRON:
        eta[:, 0] = _fold(xi[:, 0], -xi[:, 1] - xi[:, 2])
        eta[:, 1] = _fold(xi[:, 1], 1 - xi[:, 2])
    return eta


def _off_the_fold(first: Floats, last: Floats) -> Floats:
    """(n,) the last coordinate, reduced below 1 if it is 1 up to rounding and the first is not the vertex's."""
    near = (np.abs(1 - last) < _STEP) & (np.abs(1 + first) > GUARD)
    return np.where(near, 1 - _STEP, last)


def _fold(numerator: Floats, denominator: Floats) -> Floats:
    guarded = np.where(np.abs(denominator) < GUARD, GUARD, denominator)
    return 2 * (1 + numerator) / guarded - 1


def uncollapse(shape: Shape, points: Floats) -> Floats:
    """(n, d) reference coordinates xi of the collapsed points eta (n, d)."""
    eta = np.asarray(points, np.float64)
    xi = eta.copy()
    if shape is Shape.TRIANGLE:
        xi[:, 0] = _unfold(eta[:, 0], eta[:, 1])
    elif shape is Shape.PRISM:
        xi[:, 0] = _unfold(eta[:, 0], eta[:, 2])
    elif shape is Shape.PYRAMID:
        xi[:, 0] = _unfold(eta[:, 0], eta[:, 2])
        xi[:, 1] = _unfold(eta[:, 1], eta[:, 2])
    elif shape is Shape.TETRAHEDRON:
        xi[:, 1] = _unfold(eta[:, 1], eta[:, 2])
        xi[:, 0] = (1 + eta[:, 0]) * (1 - eta[:, 1]) * (1 - eta[:, 2]) / 4 - 1
    return xi


def _unfold(first: Floats, last: Floats) -> Floats:
    return (1 + first) * (1 - last) / 2 - 1


def collapse_jacobian(shape: Shape, points: Floats) -> Floats:
    """(n,) determinant |dxi/deta| at the collapsed points eta (n, d)."""
    eta = np.asarray(points, np.float64)
    last = (1 - eta[:, -1]) / 2
    if shape in (Shape.TRIANGLE, Shape.PRISM):
        return last
    if shape is Shape.PYRAMID:
        return last**2
    if shape is Shape.TETRAHEDRON:
        return (1 - eta[:, 1]) / 2 * last**2
    return np.ones(len(eta))
