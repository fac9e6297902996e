"""Distances of linear surfaces from the exact ones, which are sampled exactly: by open3d's raycasting scenes.

Zhou, Park and Koltun 2018, Open3D: a modern library for 3D data processing.  It finds nearest triangles in single
precision, so distances are accurate to about 1e-7 of the size of the data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, grid_points
from elvis.core.base.needing import MissingPackageError
from elvis.core.data.dataset import Dataset
from elvis.core.deformed.isometries import Isometry
from elvis.core.distances import nearest, surface_of
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.pointwise import positions
from elvis.plugins.faces import native_faces
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.extras import comparison_module
from elvis.scene import Faces, Isosurface

#: points of an exact surface at most, each way on a face at most, and points of a linear one
_POINTS, _EACH, _BACK = 200_000, 16, 20_000
#: bins of a histogram
_BINS = 40


@dataclass(frozen=True)
class Spread:
    """Mean, 95th percentile and largest of some distances, in world units."""

    mean: float
    most: float
    maximum: float

    @staticmethod
    def of(distances: Floats) -> Spread:
        """The spread of distances (n,), n > 0."""
        return Spread(float(distances.mean()), float(np.percentile(distances, 95)), float(distances.max()))


@dataclass(frozen=True)
class Deviation:
    """Distances of an exact surface and a linear one from each other.

    away     of points of the exact surface from the linear one
    back     of points of the linear surface from the exact one; None if unknown
    points   number of points of the exact surface
    density  of these on the surface, in points for a unit of area
    shares   (n,) of the exact points at distances between `edges` (n + 1,)
    """

    away: Spread
    back: Spread | None
    points: int
    density: float
    shares: tuple[float, ...]
    edges: tuple[float, ...]

    @property
    def hausdorff(self) -> float:
        """The largest distance, both ways where both are known."""
        return self.away.maximum if self.back is None else max(self.away.maximum, self.back.maximum)


def why_not() -> str:
    """A message why there are no such distances; empty if open3d can be loaded."""
    try:
        comparison_module("open3d", "open3d")
    except MissingPackageError as error:
        # it may be there, and a library of the system not
        is_missing = isinstance(error.__cause__, ModuleNotFoundError)
        reason = str(error) if is_missing else f"open3d can't be loaded: {error.__cause__}"
        return f"Distances of surfaces are skipped: {reason}."
    return ""


def triangle_distances(points: Floats, mesh: LinearMesh) -> Floats:
    """(n,) distances of points (n, 3) from the triangles of a mesh; coordinates count from its middle."""
    open3d = comparison_module("open3d", "open3d")
    middle = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
    scene = open3d.t.geometry.RaycastingScene()
    corners = np.ascontiguousarray(mesh.points - middle, np.float32)
    scene.add_triangles(corners, np.ascontiguousarray(mesh.simplices, np.uint32))
    asked = np.ascontiguousarray(points - middle, np.float32)
    return np.asarray(scene.compute_distance(asked).numpy(), np.float64)


def face_points(dataset: Dataset, patches: Sequence[Patch], words: tuple[str, ...]) -> Floats:
    """(n, 3) points of the faces that words name, at even steps of each face's coordinates, on the exact maps."""
    faces = native_faces(dataset, [patch.element_ids for patch in patches])
    chosen = faces.select(words)
    count = max(sum(map(len, chosen)), 1)
    each = int(np.clip(np.sqrt(_POINTS / count), 2, _EACH))
    steps = (2 * np.arange(each) + 1) / each - 1
    square = grid_points(steps, steps)
    found = []
    for block, rows in zip(faces.blocks, chosen, strict=True):
        patch = patches[block.part]
        lattice = square[square.sum(axis=1) <= 0] if block.space.shape.label == "Triangle" else square
        frames = block.frames[block.local[rows]]
        reference = frames[:, None, 0] + np.einsum("qk,nkd->nqd", lattice, frames[:, 1:])
        elements = np.repeat(block.element[rows], len(lattice))
        found.append(positions(patch, elements, reference.reshape(-1, 3)[:, : patch.dimension]))
    return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class Sampled:
    """An exact surface.

    shown   its description in a scene
    points  (n, 3) of it, exact
    back    distances (n,) of points (n, 3) from it; None if it is neither a border of the data nor an isosurface
    """

    shown: Faces | Isosurface
    points: Floats
    back: Callable[[Floats], Floats] | None = None


def border_distances(
    dataset: Dataset, border: str, isometries: Sequence[Isometry] = (Isometry(),)
) -> Callable[[Floats], Floats]:
    """Distances of points from a boundary of copies of the data, or all of them, on the curved faces themselves.

    isometries  of the copies
    """
    surface = surface_of(dataset, border)

    def distances(points: Floats) -> Floats:
        every = [np.abs(nearest(surface, own.points_before(points)).distance) for own in isometries]
        return np.asarray(np.min(every, axis=0))

    return distances


def deviation(exact: Sampled, other: LinearMesh) -> Deviation | None:
    """Distances of a linear surface from the exact one; None if either is empty."""
    if not len(exact.points) or not len(other):
        return None
    away = triangle_distances(exact.points, other)
    triangles = other.points[other.simplices]
    area = 0.5 * np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    shares, edges = _histogram(away)
    back = None
    if exact.back is not None:
        chosen = np.linspace(0, len(triangles) - 1, min(len(triangles), _BACK)).astype(int)
        back = Spread.of(exact.back(triangles[chosen].mean(axis=1)))
    density = float(len(exact.points) / area.sum())
    return Deviation(Spread.of(away), back, len(exact.points), density, shares, edges)


def _histogram(distances: Floats) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Shares of distances in bins of even width, and the ends of these."""
    counts, edges = np.histogram(distances, _BINS, (0.0, float(distances.max()) or 1.0))
    return tuple((counts / len(distances)).tolist()), tuple(edges.tolist())


def picture_distances(position: Floats, meshes: Sequence[LinearMesh]) -> NDArray[np.float64]:
    """(h, w) distances of what a picture shows (h, w, 3) from some surfaces together; NaN if that is nothing."""
    seen = np.isfinite(position).all(axis=2)
    found = np.full(position.shape[:2], np.nan)
    every = [triangle_distances(position[seen], mesh) for mesh in meshes if len(mesh)]
    if every and seen.any():
        found[seen] = np.minimum.reduce(every)
    return found
