"""Sides of elements as polynomials, with normals that point into the element."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import (
    Bools,
    Floats,
    Ints,
    frozen_floats,
    frozen_ints,
    narrow_ints,
    rows_by_number,
    starts_of,
)
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.distances.boundaries import side_coefficients, side_degree, sides_of
from elvis.core.distances.surface_patches import CORNERS, WHOLE, SurfacePatches
from elvis.core.mapping.geometry import Assembly, GeometryBlock, Part, geometry, is_shared, parts
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.expansion import mode_count, values_and_gradients
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape

#: a side whose area, or length, is less than this part of what its size allows is collapsed
COLLAPSED = 1e-12
#: part of a side towards its corners where it is probed, in addition to its centre
TOWARDS_CORNERS = 0.7
#: reference coordinates by which a point beyond a side still counts as on it
BORDER = 1e-8
#: values of modes whose gradients are evaluated together
GRADIENTS = 1 << 18
#: sides whose boxes are found together
SIDES = 1 << 12


@dataclass(frozen=True, eq=False)
class SideGroup:
    """The corresponding side of elements that share an expansion.

    block    the maps of elements
    rows     (n,) the row in the block of each side's element
    local    the element's vertices around the side

    Sides of straight elements are derived from the vertices when they are needed; those of others are stored.
    """

    block: Part
    rows: Ints
    local: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def expansion(self) -> Expansion:
        """Of the map."""
        return self.block.expansion

    @property
    def corners(self) -> int:
        """Number of corners: 2, 3 or 4."""
        return len(self.local)

    @property
    def degree(self) -> int:
        """Degree of the map along the side, in each direction."""
        return side_degree(self.expansion)

    def patches(self, rows: Ints) -> SurfacePatches:
        """The sides ``rows`` (k,) as polynomials on the domains of `surface_patches`."""
        coefficients = self._coefficients(rows) if self._is_straight else self._stored[rows]
        return SurfacePatches(self.corners, coefficients, np.arange(len(rows)), np.full(len(rows), WHOLE[self.corners]))

    def distinct_patches(self, rows: Ints) -> tuple[SurfacePatches, Ints]:
        """`patches` of the distinct ones among ``rows`` (k,), and which of these each is (k,)."""
        chosen, places = np.unique(rows, return_inverse=True)
        return self.patches(chosen), places.reshape(-1)

    def _coefficients(self, rows: Ints) -> Floats:
        return side_coefficients(self.expansion, self.block.take(self.rows[rows]), self.local)

    @property
    def _is_straight(self) -> bool:
        return max(self.expansion.modes) == 2

    @cached_property
    def _stored(self) -> Floats:
        return self._coefficients(np.arange(len(self)))

    def normals(self, points: Floats, rows: Ints) -> tuple[Floats, Floats]:
        """(k, 3) unit normals into the element at points (k, 2) of the sides ``rows`` (k,), and (k,) area factors.

        The normal is the part of an inward derivative of the map that is orthogonal to the side, which also holds for
        mirrored elements.  Zero where the side is singular.
        """
        direction = self._directions(points, rows)
        inward = self._inward(points, rows)
        unit = _units(direction)
        along = np.einsum("ni,ni->n", inward, unit)[:, None]
        normal = _units(inward - along * unit) if self.corners == 2 else np.sign(along) * unit
        return normal, np.linalg.norm(direction, axis=1)

    def factors(self, points: Floats, rows: Ints) -> Floats:
        """(k,) length or area for each unit of the coordinates at points (k, 2) of the sides ``rows`` (k,)."""
        return np.linalg.norm(self._directions(points, rows), axis=1)

    def _directions(self, points: Floats, rows: Ints) -> Floats:
        """(k, 3) tangents of curves, cross products of the tangents of faces."""
        patches, places = self.distinct_patches(rows)
        slopes = patches.derivatives(points, places, 1)
        along, across = slopes[:, 0, 1], slopes[:, 1, 0]
        return np.asarray(along if self.corners == 2 else np.cross(along, across))

    def _inward(self, points: Floats, rows: Ints) -> Floats:
        """(k, 3) derivatives of the map from the side towards the middle of the element."""
        vertices = self.expansion.shape.vertices
        origin, next_corner, last_corner = (vertices[self.local[k]] for k in (0, 1, -1))
        images = origin + (1 + points[:, :1]) / 2 * (next_corner - origin)
        if self.corners > 2:
            images = images + (1 + points[:, 1:]) / 2 * (last_corner - origin)
        direction = vertices.mean(axis=0) - vertices[list(self.local)].mean(axis=0)
        gradients = values_and_gradients(self.expansion, images)[1]
        maps = self.block.take(self.rows[rows])
        found = np.einsum("ncm,ndm,d->nc", maps, gradients, direction, optimize=True)
        return np.asarray(found)


class SideSet:
    """Sides of several groups, numbered group after group.

    entity   (n,) rows of the sides in the mesh
    element  (n,) a number for the element of each side
    degree   the largest of the map along a side
    """

    def __init__(self, groups: Sequence[SideGroup], entities: Sequence[Ints]) -> None:
        """Groups, and rows of their sides in the mesh."""
        self.groups = tuple(groups)
        self._starts = starts_of(groups)
        self.entity = np.concatenate([np.empty(0, np.int32), *entities])
        self.element = np.concatenate([np.empty(0, np.int32), *map(_elements, groups)])
        self.degree = max((group.degree for group in groups), default=1)

    def __len__(self) -> int:
        return len(self.entity)

    def parted(self, sides: Ints) -> Iterator[tuple[SideGroup, Ints, Ints]]:
        """Each group with the places of its own among ``sides`` (k,), and their rows in the group."""
        group = np.searchsorted(self._starts, sides, side="right") - 1
        for number, here in rows_by_number(group):
            yield self.groups[number], here, sides[here] - self._starts[number]

    def at(self, points: Floats, sides: Ints) -> Floats:
        """(k, 3) positions at points (k, 2) of ``sides`` (k,)."""
        found = np.empty((len(sides), 3))
        for group, here, rows in self.parted(sides):
            patches, places = group.distinct_patches(rows)
            found[here] = patches.at(points[here], places)
        return found

    def normals(self, points: Floats, sides: Ints) -> tuple[Floats, Floats]:
        """(k, 3) normals into the element at points (k, 2) of ``sides`` (k,), and (k,) area factors."""
        found, factors = np.empty((len(sides), 3)), np.empty(len(sides))
        for group, here, rows in self.parted(sides):
            for part in chunks(len(here), max(1, GRADIENTS // mode_count(group.expansion))):
                own = here[part]
                found[own], factors[own] = group.normals(points[own], rows[part])
        return found, factors

    def factors(self, points: Floats, sides: Ints) -> Floats:
        """(k,) length or area for each unit of the coordinates at points (k, 2) of ``sides`` (k,)."""
        found = np.empty(len(sides))
        for group, here, rows in self.parted(sides):
            found[here] = group.factors(points[here], rows)
        return found

    def boxes(self, sides: Ints) -> Floats:
        """(k, 6) low and high corners of boxes that hold ``sides`` (k,)."""
        found = np.empty((len(sides), 6))
        for group, here, rows in self.parted(sides):
            for part in chunks(len(here), SIDES):
                found[here[part]] = group.patches(rows[part]).boxes
        return found

    def corners(self, sides: Ints) -> Floats:
        """(k, 4, 3) corners of ``sides`` (k,); the last one is repeated where a side has fewer."""
        found = np.empty((len(sides), 4, 3))
        for group, here, rows in self.parted(sides):
            own = group.patches(rows).vertices
            found[here] = own[:, np.minimum(np.arange(4), group.corners - 1)]
        return found

    def samples(self, sides: Ints, count: int) -> tuple[Ints, Floats]:
        """Points on sides: for each (p,) its place among ``sides`` (k,), and its coordinates (p, 2).

        count  how many along each direction; 0 for the centre and a point towards each corner
        """
        places: list[Ints] = [np.empty(0, np.int64)]
        points: list[Floats] = [np.empty((0, 2))]
        for group, here, _ in self.parted(sides):
            own = _probes(group.corners) if count == 0 else lattice(group.corners, count)
            places.append(np.repeat(here, len(own)))
            points.append(np.tile(own, (len(here), 1)))
        return np.concatenate(places), np.concatenate(points)


def side_set(dataset: Dataset, wanted: Bools) -> SideSet:
    """The requested sides of a dataset's elements, each as seen by its first element.

    wanted  (n,) by rows of faces of volumes, of edges of plane elements
    """
    wanted = wanted.copy()
    groups: list[SideGroup] = []
    entities: list[Ints] = []
    for part in geometry(dataset) if is_shared(dataset.mesh) else parts(dataset):
        for group, own in _groups_of(dataset, _with_sides(dataset, part, wanted), wanted):
            groups.append(group)
            entities.append(own)
    return SideSet(groups, entities)


def _with_sides(dataset: Dataset, part: Part, wanted: Bools) -> Part:
    """A part of the map that is quickly put together, or only its elements that have requested sides."""
    if not isinstance(part, Assembly) or part.is_straight:
        return part
    ids = part.element_ids
    rows = np.flatnonzero(wanted[sides_of(dataset.mesh, part.expansion.shape, ids)].any(axis=1))
    return GeometryBlock(part.expansion, frozen_ints(ids[rows]), frozen_floats(part.take(rows)))


def _groups_of(dataset: Dataset, block: Part, wanted: Bools) -> Iterator[tuple[SideGroup, Ints]]:
    """The requested sides of a block's elements, removed from the request, and their rows in the mesh."""
    shape = block.expansion.shape
    members = sides_of(dataset.mesh, shape, block.element_ids)
    for number, local in enumerate(shape.edges if shape.dimension == 2 else shape.faces):
        rows = np.flatnonzero(wanted[members[:, number]])
        if not len(rows):
            continue
        entity = members[rows, number]
        wanted[entity] = False
        yield SideGroup(block, narrow_ints(rows, len(block)), local), entity


def _elements(group: SideGroup) -> Ints:
    """(n,) a number that identifies the element of each side, also among elements of other shapes."""
    ids = group.block.element_ids
    kind = tuple(Shape).index(group.expansion.shape)
    found = narrow_ints(ids, (1 + int(ids.max(initial=0))) * len(Shape))[group.rows]
    found *= len(Shape)
    found += kind
    return found


def lattice(corners: int, count: int) -> Floats:
    """(n, 2) points inside a domain with this many corners: Gauss points, ``count`` along each direction."""
    nodes = gauss(count)[0]
    if corners == 2:
        return np.stack([nodes, np.zeros(count)], axis=1)
    s, t = (part.reshape(-1) for part in np.meshgrid(nodes, nodes))
    if corners == 3:
        # the square collapsed onto the triangle; the points determine polynomials of degree count - 1
        s = (1 + s) * (1 - t) / 2 - 1
    return np.stack([s, t], axis=1)


def is_within(corners: int, points: Floats) -> Bools:
    """(n,) whether points (n, 2) are in a domain with this many corners, up to rounding."""
    if corners == 2:
        return np.asarray(np.abs(points[:, 0]) <= 1 + BORDER)
    if corners == 4:
        return np.asarray((np.abs(points) <= 1 + BORDER).all(axis=1))
    return np.asarray((points >= -1 - BORDER).all(axis=1) & (points.sum(axis=1) <= BORDER))


def _probes(corners: int) -> Floats:
    """(n, 2) the centre of a domain and a point towards each of its corners."""
    own = CORNERS[corners]
    centre = own.mean(axis=0, keepdims=True)
    return np.concatenate([centre, centre + TOWARDS_CORNERS * (own - centre)])


def _units(vectors: Floats) -> Floats:
    """(n, 3) vectors of length 1, zero if they are zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.where(length > 0, vectors / np.where(length > 0, length, 1.0), 0.0))
