"""The distance from points to a surface.

The function D(w) = |X(w) - p|^2 / 2 is minimal at the point w of a patch X nearest to p.  Patches, and parts of them,
are dropped if their linear part, minus their curvature, is farther than the best distance found; if D is convex on a
part, which bounds of its third derivatives prove, Newton's method finds its only minimum there; otherwise the part is
subdivided.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_ints, starts_of
from elvis.core.base.needing import require_module
from elvis.core.base.rows import Rows
from elvis.core.distances.parts import Model, Parts, dot, linear_distance
from elvis.core.distances.quadratic import least, multiply
from elvis.core.distances.surface import Surface
from elvis.core.distances.surface_patches import CORNERS, SurfacePatches
from elvis.core.mapping.boxes import Boxes
from elvis.core.mapping.orientation import chunks

#: parts of the surface's scale within which distances are equal
EQUAL = 1e-12
#: rounds of cutting, and steps of Newton's method
_ROUNDS = 26
_STEPS = 12
#: maximum number of parts of patches that are subdivided
_MOST = 1 << 17
#: number of points for which a tree is built, points examined together, and pairs of these and boxes
_BATCH = 1 << 15
_TOGETHER = 1 << 13
_PAIRS = 1 << 16
#: distance from a side up to which points lie on it
_ON = 1e-9
#: weight of points within a face, larger than any angles
_WITHIN = 100.0


@dataclass(frozen=True, eq=False)
class Near:
    """The nearest points of a surface to n points.

    distance    (n,) signed if the surface is closed, negative inside
    place       (n, 3) the nearest point
    patch       (n,) number of the patch that holds it, the groups one after the other; -1 if there is none
    coordinates (n, 2) of the nearest point in the patch
    """

    distance: Floats
    place: Floats
    patch: Ints
    coordinates: Floats


def nearest(surface: Surface, points: Floats) -> Near:
    """The distances of points (n, 3); NaN for points that are not finite."""
    distance = np.full(len(points), np.nan)
    place = np.full((len(points), 3), np.nan)
    patch = np.full(len(points), -1)
    coordinates = np.full((len(points), 2), np.nan)
    goals = np.array(points, np.float64)
    if surface.is_planar:
        goals[:, 2] = 0.0
    finite = np.flatnonzero(np.isfinite(goals).all(axis=1))
    for first in range(0, len(finite), _BATCH):
        rows = finite[first : first + _BATCH]
        closest = _closest_corners(surface, goals[rows])
        for part in chunks(len(rows), _TOGETHER):
            search = _Search(surface, goals[rows[part]], closest[part])
            distance[rows[part]] = search.signed_distances()
            place[rows[part]] = search.place
            patch[rows[part]] = search.patch
            coordinates[rows[part]] = search.coordinates
    return Near(distance, place, patch, coordinates)


def _closest_corners(surface: Surface, points: Floats) -> Ints:
    """(n,) for each point the patch whose corners' triangles are nearest: of flat patches, the nearest one."""
    igl = require_module("igl", "the distance to a surface", "distances")

    corners, patch = surface.corners
    triangles = np.arange(len(corners)).reshape(-1, 3)
    nearest_triangle = igl.point_mesh_squared_distance(points, corners, triangles)[1]
    return np.asarray(patch[np.asarray(nearest_triangle)])


@dataclass(frozen=True, eq=False)
class _Places(Rows):
    """Nearest places that were found on patches of a closed surface, for the sign of the distance.

    point     (n,) number of the point
    distance  (n,)
    side      (n,) see _side
    patch     (n,) number of the patch, the groups one after the other
    face      (n,)
    """

    point: Ints
    distance: Floats
    side: Floats
    patch: Ints
    face: Ints


class _Search:
    """Some points, the smallest distance of each that is known, and what takes part in its sign."""

    def __init__(self, surface: Surface, points: Floats, first: Ints) -> None:
        self.surface = surface
        self.points = points
        self.distance = np.full(len(points), np.inf)
        self.place = np.full(points.shape, np.nan)
        self.patch = np.full(len(points), -1)
        self.coordinates = np.full((len(points), 2), np.nan)
        self.equal = EQUAL * surface.scale
        self._first_patch = starts_of(surface.groups)
        self._found: list[_Places] = []

        # a near patch for each point first: it rules out most others
        self._search_pairs(np.arange(len(points)), first)
        rest = self._undecided()
        for number, patch in surface.tree.batches(len(rest), partial(self._may_be_nearer, rest), _PAIRS):
            point = rest[number]
            others = np.flatnonzero(first[point] != patch)
            self._search_pairs(point[others], patch[others])

    def signed_distances(self) -> Floats:
        """(n,) the distances; the signs of equally near places are weighted together (Baerentzen and Aanaes 2005)."""
        if not self.surface.is_closed:
            return self.distance
        found = _Places.joined(self._found)

        # the nearest places of each point, one a patch
        is_nearest = found.distance <= self.distance[found.point] + self.equal
        rows = np.flatnonzero(is_nearest)
        pairs = np.stack([found.point[rows], found.patch[rows]])
        _, distinct = np.unique(pairs, axis=1, return_index=True)
        rows = rows[distinct]
        point = found.point[rows]

        # signs belong to the region before and behind the face
        before, behind = self.surface.sides[found.face[rows]].T
        total = np.bincount(point, found.side[rows] * (before - behind), len(self.points))
        sign = np.where(total >= 0, 1.0, -1.0)
        is_inner = before == behind
        sign[point[is_inner]] = before[is_inner]
        return np.asarray(self.distance * sign)

    def _undecided(self) -> Ints:
        """Points for which other patches must be examined, without points within the nearest flat patch."""
        if not all(group.is_flat for group in self.surface.groups):
            return np.arange(len(self.points))
        on_border = [places.point[np.abs(places.side) < _WITHIN / 2] for places in self._found]
        return joined_ints(on_border)

    def _may_be_nearer(self, points: Ints, boxes: Boxes, rows: Ints, which: Ints) -> Bools:
        """(k,) whether box ``rows`` (k,) is as near as the best distance to number ``which`` (k,) of points (n,)."""
        point = points[which]
        goal = self.points[point]
        corners = boxes[rows].astype(np.float64)
        below = corners[:, :3] - goal
        above = goal - corners[:, 3:]
        gap = np.maximum(np.maximum(below, above), 0.0)
        distance = np.sqrt((gap**2).sum(axis=1))
        return np.asarray(distance <= self.distance[point] + self.equal)

    def _search_pairs(self, point: Ints, patch: Ints) -> None:
        """Find the smallest distances between pairs of points and patches."""
        group = np.searchsorted(self._first_patch, patch, side="right") - 1
        for number in np.unique(group):
            here = group == number
            self._search_group(number, point[here], patch[here] - self._first_patch[number])

    def _search_group(self, number: int, point: Ints, row: Ints) -> None:
        """Search the patches of one group: all undecided parts are subdivided, round by round."""
        patches = self.surface.groups[number]
        bounds = self.surface.bounds[number]
        deviation = bounds[row, 9]
        linear = linear_distance(patches, row, self.points[point])
        near = np.flatnonzero(linear - deviation <= self.distance[point] + self.equal)
        waiting = [(point[near], Parts.whole(patches.corners, row[near]))]
        while waiting:
            point, parts = waiting.pop()
            model = Model.of(patches, parts, self.points[point])
            start, lower = model.nearest_linear(bounds)
            worth = np.flatnonzero(lower <= self.distance[point] + self.equal)
            point = point[worth]
            model = model.take(worth)
            start = start[worth]

            # where D is convex it is smallest where Newton's method ends; other places bound the distance at least
            parts = model.parts
            change = model.change(bounds)
            is_convex = model.is_convex(change)
            convex_rows = np.flatnonzero(is_convex)
            start[is_convex] = self._minimize(patches, model.take(convex_rows), start[is_convex])
            self._keep(number, point, parts.row, parts.places(start))

            # without a stationary point, D is minimal on the sides; sides within the face also belong to other patches
            to_cut = np.flatnonzero(~is_convex & ~model.is_steady(change))
            if len(to_cut) and parts.depth < _ROUNDS and len(to_cut) <= _MOST:
                smaller = parts.part(to_cut).divide()
                kinds = len(smaller) // len(to_cut)
                waiting.append((np.tile(point[to_cut], kinds), smaller))
            is_face = parts.depth == 0 and parts.corners > 2
            if is_face and not is_convex.all():
                whole = np.flatnonzero(~is_convex)
                sides, owner = parts.part(whole).sides(patches)
                waiting.append((point[whole[owner]], sides))

    def _minimize(self, patches: SurfacePatches, model: Model, start: Floats) -> Floats:
        """(n, 2) where the distance is smallest in parts where it is convex, by Newton's method."""
        result = start.copy()
        if patches.is_flat:
            return result
        moving = np.arange(len(start))
        for _ in range(_STEPS):
            if not len(moving):
                break
            # the minimum of the quadratic model around each point, in coordinates of the part
            here = result[moving]
            parts = model.parts.part(moving)
            local = Model.of(patches, parts.around(here), model.goal[moving])
            gradient = local.gradient - multiply(local.bend, here)
            result[moving] = least(parts.corners, local.bend, gradient)
            step = np.abs(result[moving] - here).max(axis=1)
            moving = moving[step > 1e-10]
        return result

    def _keep(self, number: int, point: Ints, row: Ints, where: Floats) -> None:
        """Note the distances to points ``where`` (n, 2) of patches of a group."""
        patches = self.surface.groups[number]
        place = patches.at(where, row)
        away = self.points[point] - place
        distance = np.sqrt((away**2).sum(axis=1))
        np.minimum.at(self.distance, point, distance)
        best = np.flatnonzero(distance <= self.distance[point])
        self.place[point[best]] = place[best]
        self.patch[point[best]] = self._first_patch[number] + row[best]
        self.coordinates[point[best]] = where[best]

        near = np.flatnonzero(distance <= self.distance[point] + self.equal)
        if self.surface.is_closed and len(near):
            row = row[near]
            side = _side(patches, row, where[near], away[near], distance[near])
            patch = self._first_patch[number] + row
            self._found.append(_Places(point[near], distance[near], side, patch, patches.face[row]))


def _side(patches: SurfacePatches, row: Ints, where: Floats, away: Floats, distance: Floats) -> Floats:
    """(n,) positive before the patch, negative behind; weighed by the angle that the face has at its border."""
    derivatives = patches.derivatives(where, row, 1)
    s, t = derivatives[:, 0, 1], derivatives[:, 1, 0]
    is_face = patches.corners > 2
    normal = np.cross(s, t) if is_face else s[:, [1, 0, 2]] * (1, -1, 0)
    size = np.linalg.norm(normal, axis=1) * distance
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.where(size > 0, dot(normal, away) / size, 1.0)
    return np.asarray(cosine * _angle(patches, row, where, s, t))


def _angle(patches: SurfacePatches, row: Ints, where: Floats, s: Floats, t: Floats) -> Floats:
    """(n,) the angle at which a face leaves a point of its border, or the patch's part of it; `_WITHIN` elsewhere."""
    count = patches.corners
    on = np.stack([_lies_on_side(count, k, where) for k in range(count)], axis=1)
    outer_sides = _bits(patches.outer[row], 0, count)
    outer_corners = _bits(patches.outer[row], 4, count)
    angle = np.full(len(row), _WITHIN)
    angle[(on & outer_sides).any(axis=1)] = np.pi
    if count == 2:
        return angle

    # at a corner the angle between the tangents of both sides; side k leaves corner k and side k - 1 ends there
    corners = CORNERS[count]
    for k, corner in enumerate(corners):
        here = np.flatnonzero(on[:, k] & on[:, k - 1] & outer_corners[:, k])
        ahead = corners[(k + 1) % count] - corner
        back = corners[k - 1] - corner
        a = ahead[:1] * s[here] + ahead[1:] * t[here]
        b = back[:1] * s[here] + back[1:] * t[here]
        angle[here] = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), dot(a, b))
    return angle


def _bits(numbers: Ints, first: int, count: int) -> Bools:
    """(n, count) whether bits of numbers (n,) are set."""
    places = first + np.arange(count)
    return np.asarray((numbers[:, None] >> places) & 1 == 1)


def _lies_on_side(corners: int, k: int, where: Floats) -> Bools:
    """(n,) whether points lie on side k."""
    s, t = where.T
    if corners == 2:
        end = 1 if k else -1
        return np.asarray(np.abs(s - end) < _ON)
    distances = (1 + t, -s - t, 1 + s) if corners == 3 else (1 + t, 1 - s, 1 - t, 1 + s)
    return np.asarray(distances[k] < _ON)
