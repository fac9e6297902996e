"""Surfaces of a scene as functions that are zero on them and positive outside; in NumPy, for reference and baseline."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.needing import MissingPackageError
from elvis.core.files.plain import check_plain
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.extras import comparison_module
from elvis.scene import Cone, Cylinder, Plane, Sphere, Surface, TriangleMesh, Vector, unit
from elvis.scene.model.errors import SceneError


def levels(surface: Surface, points: Floats) -> Floats:
    """(n,) the function of a surface at world points (n, 3): a signed distance.

    Planes: positive on the side of the normal.  Triangles: negative where closed ones wind around the point.
    Raises TypeError for expressions, which need data.
    """
    match surface:
        case Plane():
            return np.asarray((points - surface.point) @ unit(surface.normal, "the normal of the plane"))
        case Sphere():
            return np.asarray(np.linalg.norm(points - surface.center, axis=1) - surface.radius)
        case Cylinder():
            return np.asarray(_across_and_along(points, surface.point, surface.axis)[0] - surface.radius)
        case Cone():
            aside, along = _across_and_along(points, surface.apex, surface.axis)
            half = np.deg2rad(surface.angle)
            return np.asarray(aside * np.cos(half) - along * np.sin(half))
        case TriangleMesh():
            return _away(surface, points)
    raise TypeError(type(surface).__name__)


def _away(surface: TriangleMesh, points: Floats) -> Floats:
    """(n,) distances from triangles, negative where the winding number is above a half; NaN for NaN points."""
    igl, mesh = comparison_module("igl"), triangles(surface.file)
    corners, faces = mesh.points, mesh.simplices.astype(np.int64)
    found, known = np.full(len(points), np.nan), np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(known):
        asked = np.ascontiguousarray(points[known])
        distance = np.sqrt(igl.point_mesh_squared_distance(asked, corners, faces)[0])
        found[known] = np.where(igl.winding_number(corners, faces, asked) > 0.5, -distance, distance)
    return found


@lru_cache(maxsize=4)
def triangles(file: str) -> LinearMesh:
    """The triangles of an STL, PLY, OBJ or GLB file; raises ElvisError if there are none."""
    check_plain(file)
    try:
        mesh = comparison_module("trimesh").load_mesh(file, process=False)
        points, corners = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32)
    except MissingPackageError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SceneError(f"{file}: cannot be read as STL, PLY, OBJ or GLB: {reason}") from error
    if not len(corners) or points.shape[1:] != (3,) or not np.isfinite(points).all():
        raise SceneError(
            f"{file}: expected triangles with finite corners, found {'others' if len(corners) else 'none'}"
        )
    return LinearMesh(points, {}, np.zeros_like(points), corners, np.zeros(len(corners), np.int64))


def gradients(surface: Surface, points: Floats) -> Floats:
    """(n, 3) gradients of `levels`; not finite on the axis of a cylinder or cone, where none exists."""
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


def _across_and_along(points: Floats, origin: Vector, axis: Vector) -> tuple[Floats, Floats]:
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
