"""A surface that distances are measured to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints, starts_of
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.data.dataset import Dataset
from elvis.core.distances.boundaries import ALL, Faces, boundaries, faces_of
from elvis.core.distances.sides import is_closed, sides_of_faces, sides_of_triangles
from elvis.core.distances.surface_patches import AT_ONCE, WHOLE, SurfacePatches
from elvis.core.distances.triangle_files import SUFFIXES, triangles_of
from elvis.core.mapping.boxes import BoxTree, outward
from elvis.core.mapping.orientation import chunks

#: patches in a leaf of the tree
LEAF = 2


@dataclass(frozen=True, eq=False)
class Surface:
    """Surface patches of faces.

    groups     by kind and degree; faces are numbered through all groups
    sides      (faces, 2) the signs of distances before and behind each face: both 1 if the surface is not closed
    inward     (faces,) 1 if the face's normal points into its element, -1 if out of it, 0 without an element
    is_closed  whether distances have a sign
    encloses   whether all points of the data are inside or on it
    is_planar  whether it consists of curves in the plane z = 0; the third coordinate of points is then ignored
    """

    groups: Sequence[SurfacePatches]
    sides: Ints
    inward: Ints
    is_closed: bool
    encloses: bool = False
    is_planar: bool = False

    @property
    def faces(self) -> int:
        """Number of faces."""
        return len(self.sides)

    def boxes(self) -> Iterator[Floats]:
        """(k, 6) low and high corners of boxes that hold some of the patches, one part after another."""
        for group in self.groups:
            for part in chunks(len(group), AT_ONCE):
                yield group.part(part).boxes

    @cached_property
    def bounds(self) -> Sequence[Floats]:
        """(n, 10) `SurfacePatches.bounds` of each group."""
        return [frozen_floats(group.bounds) for group in self.groups]

    def faces_and_normals(self, patch: Ints, coordinates: Floats) -> tuple[Ints, Floats]:
        """The face (n,) of patches (n,), and its unit normal (n, 3) at coordinates (n, 2); zero for edges in space."""
        face = np.zeros(len(patch), np.int64)
        normals = np.zeros((len(patch), 3))
        first = starts_of(self.groups)
        for number, group in enumerate(self.groups):
            here = np.flatnonzero((patch >= first[number]) & (patch < first[number + 1]))
            rows = patch[here] - first[number]
            face[here] = group.face[rows]
            if group.corners > 2 or self.is_planar:
                normals[here] = group.normals(coordinates[here], rows)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return face, normals / np.where(length > 0, length, 1.0)

    @cached_property
    def corners(self) -> tuple[Floats, Ints]:
        """Triangles (3 n, 3) between the corners of all patches, and the patch (n,) that each belongs to."""
        # from corner 0 of each patch, a fan
        fans = [range(1, max(group.corners - 1, 2)) for group in self.groups]
        triangles = np.empty((sum(len(group) * len(fan) for group, fan in zip(self.groups, fans, strict=True)), 3, 3))
        patches, first, start = [np.empty(0, np.int64)], 0, 0
        for group, fan in zip(self.groups, fans, strict=True):
            for k in fan:
                own = triangles[start : start + len(group)]
                for part in chunks(len(group), AT_ONCE):
                    own[part] = group.part(part).vertices[:, [0, k, min(k + 1, group.corners - 1)]]
                patches.append(first + np.arange(len(group)))
                start += len(group)
            first += len(group)
        return frozen_floats(triangles.reshape(-1, 3)), frozen_ints(np.concatenate(patches))

    @cached_property
    def scale(self) -> float:
        """The largest coordinate or extent, which rounding errors are parts of."""
        ends = [(own[:, :3].min(axis=0), own[:, 3:].max(axis=0)) for own in self.boxes()]
        low, high = np.min([low for low, _ in ends], axis=0), np.max([high for _, high in ends], axis=0)
        return float(max(np.abs(low).max(), np.abs(high).max(), np.linalg.norm(high - low)))

    @cached_property
    def tree(self) -> BoxTree:
        """The hierarchy over `boxes`."""
        return BoxTree.build(np.concatenate([outward(own[:, :3], own[:, 3:], 1e-9) for own in self.boxes()]), LEAF)


def surface_of(dataset: Dataset | None, target: str) -> Surface:
    """The surface that a name means: a boundary of the dataset, ``all`` of its outer faces, or a file of triangles.

    A part of a dataset uses the surface of the whole if it has borrowed it.

    Raises ElvisError for an unknown name, and lists the known ones.
    """
    if dataset is None or is_file(dataset, target):
        return _from_file(target)
    return dataset.surfaces.get(target) or surface_of_faces(dataset, target, faces_of(dataset, target))


def is_file(dataset: Dataset, target: str) -> bool:
    """Whether a name means a file of triangles, and no boundary."""
    return target.lower().endswith(SUFFIXES) and target not in boundaries(dataset.mesh)


def _from_file(name: str) -> Surface:
    points, triangles = triangles_of(name)
    coefficients = np.zeros((len(triangles), 2, 2, 3))
    for part in chunks(len(triangles), AT_ONCE):
        first, second, third = (points[rows] for rows in triangles[part].T)
        coefficients[part, 0, 0] = (second + third) / 2
        coefficients[part, 0, 1] = (second - first) / 2
        coefficients[part, 1, 0] = (third - first) / 2
    patches = SurfacePatches(3, coefficients, np.arange(len(triangles)), np.full(len(triangles), WHOLE[3]))
    closed = is_closed([triangles])
    sides = sides_of_triangles(points, triangles) if closed else np.ones((len(triangles), 2), np.int64)
    return Surface((patches,), frozen_ints(sides), np.zeros(len(triangles), np.int64), closed)


def _is_outline(dataset: Dataset, name: str) -> bool:
    """Whether faces are all outer ones of non-conforming elements, and closed though their edges don't match."""
    from elvis.core.interfaces.interface_composites import has_closed_outline

    return name == ALL and has_closed_outline(dataset)


def surface_of_faces(dataset: Dataset, name: str, found: Sequence[Faces], ranks: Ranks = ALONE) -> Surface:
    """The surface that consists of the faces of a boundary, or of all faces.

    ranks  all have these faces, and share the work for each; every rank must call this
    """
    first = np.cumsum([0, *(len(faces.vertices) for faces in found)])
    patches = [faces.patches.flatten(start) for faces, start in zip(found, first, strict=False)]
    loops = [faces.vertices for faces in found]
    planar = dataset.mesh.space == 2
    closed = (planar or dataset.mesh.dimension == 3) and (is_closed(loops) or _is_outline(dataset, name))
    sides = sides_of_faces(loops, patches, ranks) if closed else np.ones((first[-1], 2), np.int64)
    inward = np.concatenate([faces.inward for faces in found])
    return Surface(tuple(patches), frozen_ints(sides), inward, closed, closed and name == ALL, planar)
