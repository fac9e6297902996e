"""Unit vectors that the nearest points of a surface give.

Away from a surface the vector from the nearest point to the given one is normal to the surface if that point lies
within a smooth face.  The face's normal is then the more accurate direction, since the distance has lost digits near
the surface; on the surface it is the only one.
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.distances.parts import dot
from elvis.core.distances.search import EQUAL, Near
from elvis.core.distances.surface import Surface


def vectors_away(surface: Surface, points: Floats, near: Near) -> Floats:
    """(n, 3) from the nearest point of a surface towards points (n, 3); on it the normal that points into the data.

    On the triangles of a file the normal points to the side where distances are positive.
    """
    return _directions(surface, points, near)[1]


def gradients(surface: Surface, points: Floats, near: Near) -> Floats:
    """(n, 3) gradients of the distance at points (n, 3); on the surface those on the side of the data."""
    return _directions(surface, points, near)[0]


def _directions(surface: Surface, points: Floats, near: Near) -> tuple[Floats, Floats]:
    """The gradients and the vectors away, NaN for points without a distance."""
    is_known = near.patch >= 0
    face, normal = surface.faces_and_normals(np.where(is_known, near.patch, 0), near.coordinates)
    before, behind = surface.sides[face].T
    inward = surface.inward[face]

    # the part of the way that is not along the normal vanishes, to rounding, at the foot of a perpendicular
    way = points - near.place
    if surface.is_planar:
        way[:, 2] = 0.0
    height = dot(way, normal)
    across = np.linalg.norm(way - height[:, None] * normal, axis=1)
    equal = EQUAL * surface.scale
    with np.errstate(invalid="ignore", divide="ignore"):
        slanted = way / np.linalg.norm(way, axis=1, keepdims=True)
    away = np.where((across <= equal)[:, None], np.sign(height)[:, None] * normal, slanted)

    # on the surface: into the data, or to the positive side
    positive = np.where(before != behind, before, 1)
    into = np.where(inward == 0, positive, inward)
    is_on = np.abs(near.distance) <= equal
    away = np.where(is_on[:, None], into[:, None] * normal, away)
    sign = np.where(is_on, np.where(into > 0, before, behind), np.sign(near.distance))
    away = np.where(is_known[:, None], away, np.nan)
    return sign[:, None] * away, away
