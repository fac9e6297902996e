"""Surfaces of a scene as functions that are zero on them and positive outside; in NumPy, for reference and baseline."""

from __future__ import annotations

import numpy as np

from elvis.formats.arrays import Floats
from elvis.renderer.scene import Cone, Cylinder, Plane, Sphere, Surface, Vector, unit


def levels(surface: Surface, points: Floats) -> Floats:
    """(n,) the function of a plane, sphere, cylinder or cone at world points (n, 3): a signed distance.

    Planes: positive on the side of the normal.  Raises TypeError for the surfaces that have no such function.
    """
    match surface:
        case Plane():
            return np.asarray((points - surface.point) @ unit(surface.normal, "the normal of the plane"))
        case Sphere():
            return np.asarray(np.linalg.norm(points - surface.center, axis=1) - surface.radius)
        case Cylinder():
            return np.asarray(_beside(points, surface.point, surface.axis)[0] - surface.radius)
        case Cone():
            aside, along = _beside(points, surface.apex, surface.axis)
            half = np.deg2rad(surface.angle)
            return np.asarray(aside * np.cos(half) - along * np.sin(half))
    raise TypeError(type(surface).__name__)


def slopes(surface: Surface, points: Floats) -> Floats:
    """(n, 3) gradients of `levels`; on the axis of a cylinder or cone, where there is none, not finite."""
    with np.errstate(invalid="ignore", divide="ignore"):
        match surface:
            case Plane():
                return np.zeros_like(points) + unit(surface.normal, "the normal of the plane")
            case Sphere():
                away = points - surface.center
                return np.asarray(away / np.linalg.norm(away, axis=1, keepdims=True))
            case Cylinder():
                return _outwards(points, surface.point, surface.axis)
            case Cone():
                half, axis = np.deg2rad(surface.angle), unit(surface.axis, "the axis of the cone")
                return np.asarray(_outwards(points, surface.apex, surface.axis) * np.cos(half) - axis * np.sin(half))
    raise TypeError(type(surface).__name__)


def _beside(points: Floats, origin: Vector, axis: Vector) -> tuple[Floats, Floats]:
    """Distances (n,) of points from a line, and their places along it."""
    direction = unit(axis, "the axis")
    away = points - np.asarray(origin)
    along = away @ direction
    return np.linalg.norm(away - along[:, None] * direction, axis=1), along


def _outwards(points: Floats, origin: Vector, axis: Vector) -> Floats:
    """(n, 3) unit vectors away from a line."""
    direction = unit(axis, "the axis")
    away = points - np.asarray(origin)
    away = away - (away @ direction)[:, None] * direction
    return np.asarray(away / np.linalg.norm(away, axis=1, keepdims=True))
