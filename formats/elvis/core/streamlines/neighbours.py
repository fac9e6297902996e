"""The elements beyond the sides of elements: the faces of volumes, the edges of plane elements.

Reference coordinates on a side are affine in the coordinates of the element beyond, because both see the side's
vertices, and shared triangles collapse at the same vertex (format notes 2.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from elvis.core.base.arrays import Floats, Ints, starts_of
from elvis.core.base.rows import Rows
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import NON_CONFORMING
from elvis.core.distances.boundaries import boundaries
from elvis.core.mapping.margins import facets
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.patch import Patch
from elvis.core.shapes import Shape

_SHAPES = tuple(Shape)
#: sides and vertices of an element at most
_SIDES, _VERTICES = 6, 8
#: code instead of a boundary's number: a non-conforming side, with elements beyond it that don't share it
INTERFACE = -2


@dataclass(frozen=True, eq=False)
class Crossing(Rows):
    """Positions of points on sides of elements in the elements beyond.

    patch, row, side  (n,) -1 without an element beyond
    reference         (n, d)  coordinates there
    """

    patch: Ints
    row: Ints
    side: Ints
    reference: Floats


class Neighbours:
    """The sides of all elements of some patches, of two or three dimensions.

    names  of the boundaries that a side may belong to
    """

    @staticmethod
    def of(dataset: Dataset, patches: Sequence[Patch]) -> Neighbours:
        """The neighbours of elements of a dataset."""
        mesh = dataset.mesh
        vertices, sides = [], []
        for patch in patches:
            rows = mesh.of(patch.shape).rows_of(patch.element_ids)
            vertices.append(local_vertices(mesh, patch.shape)[rows])
            sides.append(mesh.of(patch.shape).members[rows])
        count = max((int(own.max(initial=-1)) for own in sides), default=-1) + 1
        return Neighbours(patches, vertices, sides, *_named(dataset, count))

    @staticmethod
    def of_faces(patches: Sequence[Patch], vertices: Sequence[Ints]) -> Neighbours:
        """The neighbours of faces with some vertices (n, k), which share edges."""
        edges = [own[:, np.array(patch.shape.edges)] for patch, own in zip(patches, vertices, strict=True)]
        pairs = np.concatenate([np.sort(own.reshape(-1, 2), axis=1) for own in edges])
        which = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)
        ends = np.cumsum([own.shape[0] * own.shape[1] for own in edges])
        parts = np.split(which, ends[:-1])
        sides = [part.reshape(own.shape[:2]) for part, own in zip(parts, edges, strict=True)]
        return Neighbours(patches, vertices, sides, (), np.full(len(pairs), -1))

    def __init__(
        self,
        patches: Sequence[Patch],
        vertices: Sequence[Ints],
        sides: Sequence[Ints],
        names: tuple[str, ...],
        boundary: Ints,
    ) -> None:
        """Patches with vertices (n, k) and sides (n, f) of their elements.

        boundary  by sides: numbers of their boundaries, -1 for none, or INTERFACE
        """
        self._patches, self.names, self._boundary = patches, names, boundary
        self._starts = starts_of(patches)
        self._shape = np.concatenate([np.full(len(p), _SHAPES.index(p.shape)) for p in patches])
        self._vertices = np.full((len(self._shape), _VERTICES), -1)
        self._side = np.full((len(self._shape), _SIDES), -1)
        for first, own, members in zip(self._starts, vertices, sides, strict=False):
            here = slice(first, first + len(own))
            self._vertices[here, : own.shape[1]] = own
            self._side[here, : members.shape[1]] = members
        self._beyond = _pairs(self._side)
        present = {patch.shape.dimension for patch in patches}
        self._tables = [Sides.of(shape) if shape.dimension in present else None for shape in _SHAPES]

    def facets(self, patch: int) -> tuple[Floats, Floats]:
        """Normals (k, d) and offsets (k,) of the sides of a patch's elements, in the order of the mesh's members."""
        table = self.sides(patch)
        return table.normals, table.offsets

    def sides(self, patch: int) -> Sides:
        """The sides of a patch's elements."""
        table = self._tables[_SHAPES.index(self._patches[patch].shape)]
        assert table is not None
        return table

    def doors(self, patch: int) -> tuple[Ints, Ints, Ints]:
        """The neighbours beyond the k sides of a patch's n elements, numbered through all patches' elements.

        The elements (n, k), -1 without a neighbour; their own sides (n, k); and which of their vertices the c corners
        of the sides are, (n, k, c).
        """
        table, first = self.sides(patch), self._starts[patch]
        own = np.arange(first, self._starts[patch + 1])
        beyond = self._beyond[own, : len(table.corners)]
        other, across = np.divmod(beyond, _SIDES)
        corners = self._vertices[own[:, None, None], table.corners]
        local = (self._vertices[other][:, :, None, :] == corners[..., None]).argmax(axis=3)
        return np.where(beyond < 0, -1, other), np.where(beyond < 0, -1, across), local

    def is_outer(self, patch: Ints, row: Ints, side: Ints) -> Ints:
        """(n,) whether nothing lies beyond sides of elements."""
        element = self._starts[patch] + row
        is_interface = self._boundary[self._side[element, side]] == INTERFACE
        return np.asarray((self._beyond[element, side] < 0) & ~is_interface)

    def boundary(self, patch: Ints, row: Ints, side: Ints) -> Ints:
        """(n,) numbers of the boundaries that sides belong to, among ``names``; negative for none."""
        return np.asarray(self._boundary[self._side[self._starts[patch] + row, side]])

    def cross(self, patch: Ints, row: Ints, side: Ints, points: Floats) -> Crossing:
        """Positions of points (n, d) on sides (n,) of elements in the elements beyond."""
        element = self._starts[patch] + row
        beyond = self._beyond[element, side]
        other, across = np.divmod(beyond, _SIDES)
        number = np.asarray(np.searchsorted(self._starts, other, side="right") - 1)
        reference = np.full(points.shape, np.nan)
        inner = np.flatnonzero(beyond >= 0)
        own = self._shape[element[inner]]
        for kind in np.unique(own):
            here = inner[own == kind]
            table = self._tables[kind]
            assert table is not None
            weights = table.weights(side[here], points[here])
            corners = self._vertices[element[here, None], table.corners[side[here]]]
            reference[here] = self._at_vertices(other[here], corners, weights)
        number, place, across = (
            np.where(beyond >= 0, found, -1) for found in (number, other - self._starts[number], across)
        )
        return Crossing(number, place, across, reference)

    def _at_vertices(self, element: Ints, corners: Ints, weights: Floats) -> Floats:
        """(n, d) reference coordinates in elements, from weights (n, k) of the mesh's vertices (n, k)."""
        local = (self._vertices[element][:, :, None] == corners[:, None, :]).argmax(axis=1)
        places = _PLACES[self._shape[element][:, None], local]
        found: Floats = np.einsum("nk,nkd->nd", weights, places)
        dimension = _SHAPES[self._shape[element[0]]].dimension
        return found[:, :dimension]


@dataclass(frozen=True, eq=False)
class Sides:
    """The sides of a shape, in the order of the mesh's members.

    corners   (k, c)     local vertices: the first, the next one and, of faces, the last one
    origins   (k, d)     place of the first
    duals     (k, d, c-1)  of the steps to the others
    normals   (k, d), offsets (k,)  so that the height over a side is normal . xi + offset, 0 on it, 1 at the far end
    """

    corners: Ints
    origins: Floats
    duals: Floats
    normals: Floats
    offsets: Floats

    @staticmethod
    @cache
    def of(shape: Shape) -> Sides:
        """The sides of a shape of two or three dimensions."""
        sides = shape.edges if shape.dimension == 2 else shape.faces
        corners = np.array([side if len(side) == 2 else (side[0], side[1], side[-1]) for side in sides])
        places = shape.vertices[corners]
        steps = places[:, 1:] - places[:, :1]
        duals = np.linalg.pinv(steps)
        normals, offsets = facets(shape)
        heights = np.abs(places @ normals.T + offsets).sum(axis=1)
        which = heights.argmin(axis=1)
        return Sides(corners, places[:, 0], duals, normals[which], offsets[which])

    def weights(self, side: Ints, points: Floats) -> Floats:
        """(n, c) weights of the corners at points (n, d) of sides (n,)."""
        offsets = points[:, : self.origins.shape[1]] - self.origins[side]
        others = np.einsum("nd,ndc->nc", offsets, self.duals[side])
        return np.column_stack([1 - others.sum(axis=1), others])


def _places() -> Floats:
    """(7, 8, 3) reference coordinates of the vertices of all shapes."""
    table = np.zeros((len(_SHAPES), _VERTICES, 3))
    for number, shape in enumerate(_SHAPES):
        table[number, : len(shape.vertices), : shape.dimension] = shape.vertices
    return table


_PLACES = _places()


def _pairs(side: Ints) -> Ints:
    """(n, 6) for each side of each element, _SIDES times the element beyond plus its own side.

    -1 without an element beyond.

    A side of three or more elements is an outer one.
    """
    place = np.flatnonzero(side.reshape(-1) >= 0)
    entity = side.reshape(-1)[place]
    order = np.argsort(entity, kind="stable")
    place, entity = place[order], entity[order]
    owners = np.bincount(entity)
    first = np.flatnonzero(owners[entity[:-1]] == 2) if len(entity) else np.empty(0, np.int64)
    first = first[entity[first] == entity[first + 1]]
    found = np.full(side.size, -1)
    found[place[first]], found[place[first + 1]] = place[first + 1], place[first]
    return found.reshape(side.shape)


def _named(dataset: Dataset, count: int) -> tuple[tuple[str, ...], Ints]:
    """Names of boundaries, and for each of the mesh's sides (count,) the number of one that it belongs to."""
    known = boundaries(dataset.mesh)
    titles = {str(own.id): own.name or own.label for own in dataset.mesh.composites}
    distinct = (name for name in known if not titles.get(name) or titles[name] == name)
    names = tuple(name for name in distinct if name != NON_CONFORMING)
    found = np.full(count, -1)
    for number, name in enumerate(names):
        sides = known[name]
        found[sides[sides < count]] = number
    joined = known.get(NON_CONFORMING, np.empty(0, np.int64))
    found[joined[joined < count]] = INTERFACE
    return names, found
