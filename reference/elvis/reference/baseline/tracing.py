"""Rays against triangles: Embree proposes in single precision, each hit is finished in double precision."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.extras import comparison_module
from elvis.reference.hits import Hits, face_eye
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Status

#: hits nearer to the last surface than this part of the mesh's size are the same surface, met again
_APART = 1e-5


class Tracer:
    """A triangular mesh, ready for rays."""

    def __init__(self, mesh: LinearMesh) -> None:
        """Build Embree's tree; MissingPackageError without embreex."""
        scenes, meshes = comparison_module("embreex.rtcore_scene"), comparison_module("embreex.mesh_construction")
        self.mesh = mesh
        self._middle = mesh.points.mean(axis=0) if len(mesh.points) else np.zeros(3)
        self._scene = scenes.EmbreeScene(robust=True)
        if len(mesh):
            points = self._single(mesh.points)
            meshes.TriangleMesh(self._scene, points, np.ascontiguousarray(mesh.simplices, np.int32))

    def first(self, view: View, beyond: Floats | None = None) -> Hits:
        """The nearest hit of each pixel's ray, of those deeper than ``beyond`` (n,)."""
        origins, directions = view.every_ray()
        near = np.zeros(view.count) if beyond is None else np.where(np.isfinite(beyond), beyond, np.inf)
        hits = Hits.none(view.count, tuple(self.mesh.values))
        asked = np.flatnonzero(np.isfinite(near))
        if not len(self.mesh) or not len(asked):
            return hits

        # rays start where the last surface was, or before the mesh where they come from far away
        lead = (self._middle - origins) @ view.camera.basis()[2] - self.mesh.size
        start = np.maximum(np.maximum(near + (_APART * self.mesh.size if beyond is not None else 0), lead), 0)
        shifted = origins + start[:, None] * directions
        found = self._scene.run(self._single(shifted[asked]), np.ascontiguousarray(directions[asked], np.float32))
        met = found >= 0
        self._finish(hits, asked[met], found[met].astype(np.int64), origins, directions)
        return hits

    def _single(self, points: Floats) -> np.ndarray:
        """Points about the middle of the mesh and of the size of a unit, in single precision."""
        return np.ascontiguousarray((points - self._middle) / (self.mesh.size or 1.0), np.float32)

    def _finish(self, hits: Hits, pixels: Ints, triangles: Ints, origins: Floats, directions: Floats) -> None:
        """Put the hits of rays with triangles at some pixels, all in double precision."""
        mesh, origin, direction = self.mesh, origins[pixels], directions[pixels]
        corners = mesh.simplices[triangles].astype(np.int64)
        a, b, c = (mesh.points[corners[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        rate = np.einsum("ni,ni->n", normal, direction)
        depth = np.einsum("ni,ni->n", normal, a - origin) / np.where(rate == 0, np.nan, rate)
        weights = _barycentric(origin + depth[:, None] * direction, a, b, c, normal)

        def interpolate(column: Floats) -> Floats:
            return np.asarray(np.einsum("nk,nk...->n...", weights, column[corners]))

        hits.element[pixels], hits.depth[pixels], hits.status[pixels] = mesh.element[triangles], depth, Status.CERTAIN
        hits.position[pixels], hits.normal[pixels] = origin + depth[:, None] * direction, face_eye(normal, direction)
        hits.reference[pixels] = interpolate(mesh.reference)
        for name, values in mesh.values.items():
            hits.values[name][pixels] = interpolate(values)


def _barycentric(points: Floats, a: Floats, b: Floats, c: Floats, normal: Floats) -> Floats:
    """(n, 3) weights of the corners at points of their triangles; within [0, 1] despite rounding."""
    area = np.einsum("ni,ni->n", normal, normal)
    second = np.einsum("ni,ni->n", np.cross(points - a, c - a), normal) / area
    third = np.einsum("ni,ni->n", np.cross(b - a, points - a), normal) / area
    weights = np.clip(np.column_stack([1 - second - third, second, third]), 0, 1)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
