"""The inside of a surface, known if it is closed: two faces meet at each of their sides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, distinct_bits, distinct_sides, uses_of
from elvis.core.base.needing import require_module
from elvis.core.base.ranks import Ranks
from elvis.core.distances.crossings import EQUAL, by_solid_angle, crossings_in_plane, windings
from elvis.core.distances.surface_patches import SurfacePatches

#: part of a triangle's size by which a point lies before it
_BEFORE = 1e-6


def is_closed(loops: Sequence[Ints]) -> bool:
    """Whether each side of faces, whose vertices are given in order (n, k), belongs to two faces."""
    first, which = distinct_sides([view for loop in loops for view in _views_of_sides(loop)])
    return bool((uses_of(which, len(first)) == 2).all())


def _views_of_sides(loop: Ints) -> list[tuple[Ints, tuple[int, ...]]]:
    """The columns of each side of faces, whose vertices are given in order (n, k); sides of a line are its two ends."""
    count = loop.shape[1]
    return [(loop, (k,) if count == 2 else (k, (k + 1) % count)) for k in range(count)]


def _sides_around(loop: Ints) -> Ints:
    """(n k, 2) both ends of each side of faces, whose vertices are given in order (n, k)."""
    following = np.roll(loop, -1, axis=1)
    return np.stack([loop, following], axis=2).reshape(-1, 2)


def sides_of_triangles(points: Floats, triangles: Ints) -> Ints:
    """(m, 2) the sign of distances before and behind triangles (m, 3) of a closed surface: -1 inside, 1 outside.

    A point is inside where the surface winds around it.  The triangles turn as the file says, if they agree with their
    neighbours; otherwise they are reoriented.
    """
    own = triangles
    if not _agree(triangles):
        igl = require_module("igl", "the distance to a surface", "distances")
        own = np.asarray(igl.bfs_orient(triangles)[0], np.int64)
    turned = (own != triangles).any(axis=1)

    # the winding number rises by one through a triangle, from before it to behind it
    corners = points[own]
    before = corners.mean(axis=1) + _ahead(corners)
    winding, rest = windings(corners, np.zeros((len(own), 3)), before)
    winding[rest] = by_solid_angle(corners, before[rest])
    inside = np.stack([winding != 0, winding != -1], axis=1)
    signs = np.where(inside, -1, 1)
    signs[turned] = signs[turned, ::-1]
    return np.asarray(signs)


def _agree(triangles: Ints) -> bool:
    """Whether neighbours run along their common side in opposite ways."""
    directed = _sides_around(triangles)
    return len(distinct_bits(directed)[0]) == len(directed)


def sides_of_faces(loops: Sequence[Ints], patches: Sequence[SurfacePatches], ranks: Ranks) -> Ints:
    """(faces, 2) the sign of distances before and behind the faces of a closed surface: -1 inside, 1 outside.

    loops   for each kind of face the vertices (n, k) around them
    patches  for each kind of face their patches, nearly flat; faces are numbered through all kinds
    ranks   all have the surface, and share its faces
    A point is inside if the surface winds around it an odd number of times, for any orientation of its parts.
    """
    odd = _is_inside_curves(patches) if patches[0].corners == 2 else _is_inside_faces(loops, patches, ranks)
    return np.where(np.stack([odd, ~odd], axis=1), -1, 1)


def _is_inside_curves(patches: Sequence[SurfacePatches]) -> Bools:
    """(faces,) whether a place before each curve in the plane is inside: a ray from there crosses an odd number."""
    ends = np.concatenate([each.vertices for each in patches])
    face = np.concatenate([each.face for each in patches])
    _, first = np.unique(face, return_index=True)

    # a short step to the right of the first patch of each face
    own = ends[first]
    along = own[:, 1] - own[:, 0]
    places = own.mean(axis=1) + _BEFORE * along[:, [1, 0, 2]] * (1, -1, 0)
    return np.asarray(crossings_in_plane(ends, places) % 2 == 1)


def _is_inside_faces(loops: Sequence[Ints], patches: Sequence[SurfacePatches], ranks: Ranks) -> Bools:
    """(faces,) whether a place before each face is inside: an odd number of windings."""
    fans = [_fans(each) for each in patches]
    corners = np.concatenate([triangles for triangles, _ in fans])
    face = np.concatenate([own for _, own in fans])

    # points before the first triangle of each face, in its given orientation
    _, first = np.unique(face, return_index=True)
    own = corners[first]
    every = own.mean(axis=1) + _ahead(own)

    # each rank has its share of these
    places = np.array_split(every, ranks.size)[ranks.rank]
    bend = np.concatenate([np.tile(each.bounds[:, 9], each.corners - 2) for each in patches])
    found, rest = windings(corners, _gaps(corners, bend), places)
    if len(rest):
        # solid angles add up only where neighbours agree
        turned = _flips(loops)[face]
        corners[turned] = corners[turned][:, ::-1]
        found[rest] = by_solid_angle(corners, places[rest])
    return np.concatenate(ranks.exchange(found % 2 == 1, "sides of faces"))


def _gaps(corners: Floats, bend: Floats) -> Floats:
    """(n, 3) maximum distance of the border of a surface from the sides of triangles (n, 3, 3) that are not shared.

    bend  (n,) maximum deviation of their patches from the linear parts
    If a neighbour is cut more finely, its sides are chords of a curve, and this side is a longer chord of it.  Corners
    of patches deviate from their linear part by at most the deviation ``bend``, so the curve deviates from the chord by
    at most twice that.
    """
    if not bend.any():
        return np.zeros((len(corners), 3))

    # ends that are equal but for rounding have one number; a side that an even number of triangles have leaves no gap
    rounding = EQUAL * np.abs(corners).max()
    places = np.rint(corners.reshape(-1, 3) / rounding)
    numbers = np.unique(places, axis=0, return_inverse=True)[1].reshape(-1, 3)
    sides = np.sort(_sides_around(numbers), axis=1)
    keys = sides[:, 0] * len(places) + sides[:, 1]
    _, row, counts = np.unique(keys, return_inverse=True, return_counts=True)
    is_shared = (counts[row] % 2 == 0).reshape(-1, 3)
    return np.where(is_shared, 0.0, 2 * bend[:, None])


def _flips(loops: Sequence[Ints]) -> Bools:
    """(faces,) which of the faces would have to run the other way round, so that neighbours agree."""
    igl = require_module("igl", "the distance to a surface", "distances")

    # fans of triangles around the first vertex of each face
    fans = []
    for loop in loops:
        corners = [loop[:, [0, k, k + 1]] for k in range(1, loop.shape[1] - 1)]
        fans.append(np.stack(corners, axis=1))
    triangles = np.concatenate([fan.reshape(-1, 3) for fan in fans])
    sizes = np.concatenate([np.full(len(fan), fan.shape[1]) for fan in fans])
    face = np.repeat(np.arange(len(sizes)), sizes)

    agreeing = np.asarray(igl.bfs_orient(triangles)[0])
    turned = (agreeing != triangles).any(axis=1)
    found = np.zeros(len(sizes), bool)
    found[face[turned]] = True
    return found


def _fans(patches: SurfacePatches) -> tuple[Floats, Ints]:
    """Triangles (n, 3, 3) between the corners of patches, and the face (n,) that each belongs to."""
    vertices = patches.vertices
    fans = [vertices[:, [0, k, k + 1]] for k in range(1, patches.corners - 1)]
    return np.concatenate(fans), np.tile(patches.face, len(fans))


def _ahead(corners: Floats) -> Floats:
    """(n, 3) short steps off triangles (n, 3, 3), to the side from which they appear counterclockwise."""
    one = corners[:, 1] - corners[:, 0]
    other = corners[:, 2] - corners[:, 0]
    normal = np.cross(one, other)

    # the normal's length is an area, so its root is a length
    size = np.sqrt(np.linalg.norm(normal, axis=1, keepdims=True))
    divisor = np.where(size > 0, size, 1.0)
    return np.asarray(_BEFORE * normal / divisor)
