"""Surfaces in space as they are for data of which a copy is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.deformed.isometries import Isometry
from elvis.scene.model.errors import SceneError
from elvis.scene.model.surfaces import Cone, Cylinder, Plane, Sphere, Surface, TriangleMesh, Vector


def moved_back(surface: Surface, isometry: Isometry) -> Surface:
    """The surface whose image by an isometry is the given one.

    Raises SceneError for triangles of a file.
    """
    if isometry.is_identity:
        return surface
    match surface:
        case Plane():
            return replace(surface, point=_point(surface.point, isometry), normal=_way(surface.normal, isometry))
        case Sphere():
            return replace(surface, center=_point(surface.center, isometry))
        case Cylinder():
            return replace(surface, point=_point(surface.point, isometry), axis=_way(surface.axis, isometry))
        case Cone():
            return replace(surface, apex=_point(surface.apex, isometry), axis=_way(surface.axis, isometry))
        case TriangleMesh():
            raise SceneError(
                "copies: cuts and clips by triangles of a file are not drawn in copies: remove one of both"
            )
        case _:
            return surface


def _point(point: Vector, isometry: Isometry) -> Vector:
    return _vector(isometry.points_before(np.asarray(point, np.float64)))


def _way(direction: Vector, isometry: Isometry) -> Vector:
    return _vector(isometry.directions_before(np.asarray(direction, np.float64)))


def _vector(array: Floats) -> Vector:
    # no negative zeros
    x, y, z = (array + 0.0).tolist()
    return x, y, z
