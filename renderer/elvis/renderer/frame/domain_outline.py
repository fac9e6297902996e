"""The boundary of the domain, or of the bodies in it, as triangles: sharp edges, and silhouettes for every view."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, pair_numbers
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import NON_CONFORMING
from elvis.core.distances.boundaries import ALL, Faces, bodies, faces_of, joined_sides
from elvis.core.mapping.geometry import kept
from elvis.core.shapes import Shape
from elvis.scene.cameras.view import View

#: cosine of the angle between the normals of two faces from which the edge between them is sharp
SHARP = float(np.cos(np.deg2rad(30.0)))
#: divisions of a curved face in each direction, at most
MAX_DIVISIONS = 8
#: points on all faces together, about at most: with more faces each has fewer points
MAX_POINTS = 200_000


@dataclass(frozen=True, eq=False)
class BoundarySurface:
    """Triangles on a boundary.

    points     (n, 3) on the faces; faces that meet have points of their own
    normals    (n, 3) in the same direction relative to the domain; without length for the edges of 2D data
    triangles  (m, 3) rows of points; none for the edges of 2D data
    edges      (k, 2) rows of points: parts of sharp edges and of borders
    """

    points: Floats
    normals: Floats
    triangles: Ints
    edges: Ints

    @property
    def sharp_edges(self) -> Floats:
        """(n, 2, 3) ends of short lines along sharp edges and borders."""
        return self.points[self.edges]

    def silhouettes(self, view: View) -> Floats:
        """(n, 2, 3) ends of short lines where the surface turns away from the eye.

        They are zeros of n · (eye - x), which is taken as linear in each triangle.
        """
        eye, forward = np.asarray(view.camera.eye), view.camera.basis()[2]
        towards = eye - self.points if view.perspective else -forward
        facing = (self.normals * towards).sum(axis=1)
        is_front = facing > 0.0
        fronts = is_front[self.triangles].sum(axis=1)
        corners = self.triangles[(fronts > 0) & (fronts < 3)]

        # the corner that differs from both others, and the two edges to them, which the zero crosses
        single = is_front[corners].sum(axis=1) == 1
        column = np.argmax(is_front[corners] == single[:, None], axis=1)
        rows = np.arange(len(corners))
        apex = corners[rows, column]
        ends = []
        for step in (1, 2):
            other = corners[rows, (column + step) % 3]
            part = facing[apex] / (facing[apex] - facing[other])
            ends.append(self.points[apex] + part[:, None] * (self.points[other] - self.points[apex]))
        return np.stack(ends, axis=1)


def boundary_surface(dataset: Dataset) -> BoundarySurface | None:
    """The bodies of a dataset, else its whole outer boundary; None for surfaces in space and lines.

    A part of data needs all elements at the boundary.
    """
    mesh = dataset.mesh
    if mesh.dimension < 2 or mesh.space > mesh.dimension:
        return None
    return kept(dataset, "domain outline", lambda: _surface(dataset))


def _surface(dataset: Dataset) -> BoundarySurface | None:
    """The triangles of all faces, joined where faces meet."""
    names = bodies(replace(dataset.mesh, excerpt=None)).names or (ALL,)
    try:
        faces = [own for name in names for own in faces_of(dataset, name)]
    except ElvisError:
        # a domain that is periodic in every direction has no boundary
        return None
    divisions = _divisions(faces)
    parts = [_Part.of(own, divisions) for own in faces]
    firsts = np.cumsum([0, *(len(part.points) for part in parts)])
    shifted = list(zip(parts, firsts, strict=False))
    points = np.concatenate([part.points for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    triangles = np.concatenate([part.triangles + first for part, first in shifted])
    sides = np.concatenate([part.sides + first for part, first in shifted])
    if dataset.mesh.dimension == 2:
        return BoundarySurface(points, normals, triangles, sides)
    ends = np.concatenate([part.ends for part in parts])
    is_sharp, normals = _joined(normals, sides, _numbered(ends, divisions), _is_hanging(dataset, ends))
    return BoundarySurface(points, normals, triangles, sides[is_sharp])


def _divisions(faces: list[Faces]) -> int:
    """In how many parts each side of each face is divided: all alike, as faces of any degree meet."""
    degree = max(max(own.patches.coefficients.shape[1:3]) - 1 for own in faces)
    if degree == 1 and all(own.patches.corners < 4 for own in faces):
        return 1
    count = sum(len(own.patches) for own in faces)
    most = max(1, int(np.sqrt(MAX_POINTS / count)) - 1)
    return int(min(most, MAX_DIVISIONS, 2 * degree))


@dataclass(frozen=True, eq=False)
class _Part:
    """Faces of one kind.

    sides  (k, 2) rows of points, next to one another around the faces
    ends   (k / divisions, 2) rows of the mesh's vertices at the ends of whole sides
    """

    points: Floats
    normals: Floats
    triangles: Ints
    sides: Ints
    ends: Ints

    @staticmethod
    def of(faces: Faces, divisions: int) -> _Part:
        """Points on a lattice that divides each side into ``divisions`` parts."""
        patches, corners = faces.patches, faces.patches.corners
        lattice, triangles, sides = _lattice(corners, divisions)
        count, size = len(patches), len(lattice)
        places, rows = np.tile(lattice, (count, 1)), np.repeat(np.arange(count), size)
        points, normals = patches.at(places, rows), np.zeros((count * size, 3))
        if corners > 2:
            normals = _unit(patches.normals(places, rows)) * np.repeat(faces.inward, size)[:, None]
        first = size * np.arange(count)[:, None, None]
        around = np.arange(corners if corners > 2 else 1)
        ends = faces.vertices[:, np.stack([around, (around + 1) % corners], axis=1)]
        triangles, sides = (first + triangles).reshape(-1, 3), (first + sides).reshape(-1, 2)
        return _Part(points, normals, triangles, sides, ends.reshape(-1, 2))


def _lattice(corners: int, divisions: int) -> tuple[Floats, Ints, Ints]:
    """Points (n, 2) on a face, its triangles (m, 3) and parts (k, 2) of its sides, side by side."""
    steps = np.linspace(-1.0, 1.0, divisions + 1)
    along = np.arange(divisions + 1)
    if corners == 2:
        return np.stack([steps, np.zeros_like(steps)], axis=1), np.zeros((0, 3), np.int64), _pairs(along)

    # rows of points at equal second coordinates: of a triangle each has one point fewer
    lengths = np.full(divisions + 1, divisions + 1) if corners == 4 else divisions + 1 - along
    firsts = np.cumsum([0, *lengths[:-1]])
    points = [np.stack([steps[:length], np.full(length, y)], axis=1) for length, y in zip(lengths, steps, strict=True)]
    ends = firsts + lengths - 1
    around = [_pairs(along), _pairs(ends), _pairs(firsts[::-1])]
    if corners == 4:
        around = [_pairs(along), _pairs(ends), _pairs(firsts[-1] + along[::-1]), _pairs(firsts[::-1])]
    return np.concatenate(points), _triangles(firsts, lengths), np.concatenate(around)


def _triangles(firsts: Ints, lengths: Ints) -> Ints:
    """(m, 3) triangles between rows of points, which start at ``firsts`` (n,) and have ``lengths`` (n,) points."""
    triangles = []
    for row in range(len(firsts) - 1):
        lower = firsts[row] + np.arange(lengths[row])
        upper = firsts[row + 1] + np.arange(lengths[row + 1])
        count = len(upper) - 1
        triangles.append(np.stack([lower[:-1], lower[1:], upper[: len(lower) - 1]], axis=1))
        triangles.append(np.stack([lower[1 : count + 1], upper[1:], upper[:-1]], axis=1))
    return np.concatenate(triangles)


def _pairs(rows: Ints) -> Ints:
    """(n - 1, 2) rows of points (n,) and the next ones."""
    return np.stack([rows[:-1], rows[1:]], axis=1)


def _numbered(ends: Ints, divisions: int) -> Ints:
    """(k, 2) numbers of the ends of parts of sides, the same for two sides between the same vertices (n, 2)."""
    _, side = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    place = np.arange(divisions + 1)
    is_turned = ends[:, 0] > ends[:, 1]
    places = np.where(is_turned[:, None], place[::-1], place) + (divisions + 1) * side.reshape(-1)[:, None]
    return np.stack([places[:, :-1].ravel(), places[:, 1:].ravel()], axis=1)


def _joined(normals: Floats, sides: Ints, numbers: Ints, hanging: Bools) -> tuple[Bools, Floats]:
    """Which parts of sides (k,) are sharp edges or borders, and normals (n, 3) that are equal on both sides of others.

    numbers  (k, 2) of the places at their ends
    hanging  (k / divisions,) whether a side lies on a non-conforming face, where a missing partner makes no border
    """
    _, group, count = np.unique(np.sort(numbers, axis=1), axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)

    # the two parts of each pair, one after another, with their ends in the same order
    order = np.argsort(group, kind="stable")
    one, other = order[count[group[order]] == 2].reshape(-1, 2).T
    is_turned = numbers[one, 0] != numbers[other, 0]
    partner = np.where(is_turned[:, None], sides[other][:, ::-1], sides[other])
    cosine = (normals[sides[one]] * normals[partner]).sum(axis=2).mean(axis=1)
    is_smooth = cosine > SHARP

    is_sharp = ~np.repeat(hanging, len(sides) // len(hanging)) | (count[group] > 2)
    is_sharp[one] = ~is_smooth
    is_sharp[other] = False

    # at both ends of smooth parts the sum of both normals, on both sides
    here, there = sides[one[is_smooth]], partner[is_smooth]
    total = (normals[here] + normals[there]).reshape(-1, 3)
    mean = normals.copy()
    mean[np.concatenate([here, there]).ravel()] = 0.0
    np.add.at(mean, here.ravel(), total)
    np.add.at(mean, there.ravel(), total)
    return is_sharp, _unit(mean)


def _is_hanging(dataset: Dataset, ends: Ints) -> Bools:
    """(n,) whether sides between vertices (n, 2) are edges of the mesh's non-conforming faces."""
    mesh = dataset.mesh
    rows = joined_sides(mesh).get(NON_CONFORMING)
    if rows is None:
        return np.zeros(len(ends), bool)
    edges = mesh.of(Shape.SEGMENT).members
    known = np.concatenate([edges[of_faces.ravel()] for of_faces in _edges_of_faces(dataset, rows)])
    size = len(mesh.vertices)
    return np.isin(_numbers(ends, size), _numbers(known, size))


def _edges_of_faces(dataset: Dataset, rows: Ints) -> Iterator[Ints]:
    """(n, corners) rows of the edges of faces, which are counted with triangles first."""
    triangles, quadrilaterals = (dataset.mesh.of(shape).members for shape in (Shape.TRIANGLE, Shape.QUADRILATERAL))
    count = len(triangles)
    yield triangles[rows[rows < count]]
    yield quadrilaterals[rows[rows >= count] - count]


def _numbers(pairs: Ints, size: int) -> Ints:
    """(n,) a number for each pair (n, 2) of vertices, in either order."""
    return pair_numbers(pairs.min(axis=1), pairs.max(axis=1), size)


def _unit(vectors: Floats) -> Floats:
    """(n, 3) vectors at length 1; those without length stay."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))
