"""The Jacobian of a map as tangent vectors: how much it stretches, and how gradients go through it.

A Jacobian is (n, 3, d): column i holds the derivative of the world coordinates in the reference coordinate i.  Formulas
by cross products treat columns alike whatever their length, so elements of extreme aspect ratio lose no digits.
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats


def determinants(jacobians: Floats) -> Floats:
    """(n,) the determinant of a volume; length or area, never negative, where the image is a curve or a surface."""
    columns = np.moveaxis(jacobians, 2, 0)
    if len(columns) == 1:
        return _length(columns[0])
    normal = _cross(columns[0], columns[1])
    return _length(normal) if len(columns) == 2 else _dot(normal, columns[2])


def duals(jacobians: Floats) -> Floats:
    """(n, 3, d) dual tangents: the transposed (pseudo-)inverse of each Jacobian; not finite where that is singular.

    A gradient in reference coordinates g (n, d) is sum_i g_i dual_i in the world, tangential to a curve or surface.
    """
    columns = np.moveaxis(jacobians, 2, 0)
    if len(columns) == 1:
        result = [columns[0]]
        scale = _dot(columns[0], columns[0])
    elif len(columns) == 2:
        normal = _cross(columns[0], columns[1])
        result = [_cross(columns[1], normal), _cross(normal, columns[0])]
        scale = _dot(normal, normal)
    else:
        result = [_cross(columns[(i + 1) % 3], columns[(i + 2) % 3]) for i in range(3)]
        scale = _dot(result[0], columns[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack(result, axis=2) / scale[:, None, None]


def _cross(a: Floats, b: Floats) -> Floats:
    """(n, 3) vector products; `numpy.cross` takes several times as long for few vectors."""
    (a0, a1, a2), (b0, b1, b2) = a.T, b.T
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0]).T


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("ni,ni->n", a, b))


def _length(a: Floats) -> Floats:
    return np.sqrt(_dot(a, a))
