"""The distance from points to a surface.

Where a point w of a patch X is nearest to p, D(w) = |X(w) - p|^2 / 2 is least.  Patches, and parts of them, are
left out where their linear part, less what they bend by, is farther than what has been found; where D is convex all
over a part, which bounds of its third derivatives prove, Newton's method finds the one least value on it; else
the part is cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.distances.parts import Model, Parts, linear_distance
from elvis.core.distances.quadratic import least
from elvis.core.distances.surface import LEAF, Surface
from elvis.core.distances.surface_patches import CORNERS, SurfacePatches
from elvis.core.needing import require_module

#: parts of the surface's scale within which distances are equal
EQUAL = 1e-12
#: rounds of cutting, and parts that are looked at together
_ROUNDS, _MOST = 26, 1 << 17
_STEPS = 12
#: points at once
_BATCH = 1 << 15


@dataclass(frozen=True, eq=False)
class Near:
    """What is nearest to n points.

    distance  (n,) signed where the surface is closed, negative inside
    place     (n, 3) the nearest point
    """

    distance: Floats
    place: Floats


def nearest(surface: Surface, points: Floats) -> Near:
    """The distances of points (n, 3); NaN for points that are not finite."""
    distance, place = np.full(len(points), np.nan), np.full((len(points), 3), np.nan)
    own = np.array(points, np.float64)
    if surface.is_planar:
        own[:, 2] = 0.0
    finite = np.flatnonzero(np.isfinite(own).all(axis=1))
    for first in range(0, len(finite), _BATCH):
        rows = finite[first : first + _BATCH]
        search = _Search(surface, own[rows])
        distance[rows], place[rows] = search.signed_distances(), search.place
    return Near(distance, place)


class _Search:
    """Some points, the least distance of each that is known, and what takes part in its sign."""

    def __init__(self, surface: Surface, points: Floats) -> None:
        self.surface, self.points = surface, points
        self.distance, self.place = np.full(len(points), np.inf), np.full(points.shape, np.nan)
        self.equal = EQUAL * surface.scale
        self._first = np.cumsum([0, *map(len, surface.groups)])
        self._bounds = [group.bounds for group in surface.groups]
        self._found: list[tuple[Ints, Floats, Floats, Ints, Ints]] = []
        first = self._closest_corners()
        self._search_pairs(np.arange(len(points)), first)
        for point, patch in self._candidates(self._undecided()):
            others = np.flatnonzero(first[point] != patch)
            self._search_pairs(point[others], patch[others])

    def signed_distances(self) -> Floats:
        """(n,) the distances; of equally near places the signs are weighed together (Baerentzen and Aanaes 2005)."""
        if not self.surface.is_closed:
            return self.distance
        point, distance, side, patch, face = (np.concatenate(parts) for parts in zip(*self._found, strict=True))
        equal = np.flatnonzero(distance <= self.distance[point] + self.equal)
        equal = equal[np.unique(np.stack([point[equal], patch[equal]]), axis=1, return_index=True)[1]]
        sides = self.surface.sides[face[equal]]
        total = np.bincount(point[equal], side[equal] * (sides[:, 0] - sides[:, 1]), len(self.points))
        sign = np.where(total >= 0, 1.0, -1.0)
        same = sides[:, 0] == sides[:, 1]
        sign[point[equal[same]]] = sides[same, 0]
        return np.asarray(self.distance * sign)

    def _closest_corners(self) -> Ints:
        """(n,) for each point the patch whose corners' triangles are nearest: of flat patches, the nearest one."""
        igl = require_module("igl", "the distance to a surface", "distances")

        corners, patch = self.surface.corners
        ends = np.arange(len(corners)).reshape(-1, 3)
        found = np.asarray(igl.point_mesh_squared_distance(self.points, corners, ends)[1])
        return np.asarray(patch[found])

    def _undecided(self) -> Ints:
        """Points that other patches have to be looked at for: not those within the flat patch that is nearest."""
        if not all(group.is_flat for group in self.surface.groups):
            return np.arange(len(self.points))
        border = [point[np.abs(side) < _WITHIN / 2] for point, _, side, _, _ in self._found]
        return np.concatenate([np.empty(0, np.int64), *border])

    def _candidates(self, point: Ints) -> list[tuple[Ints, Ints]]:
        """Pairs of a point and a patch whose box is as near as what has been found."""
        tree, node = self.surface.tree, np.zeros_like(point)
        while node[0] < tree.leaves - 1 if len(node) else False:
            near = self._may_be_nearer(point, tree.nodes[node])
            point, node = np.repeat(point[near], 2), (2 * node[near, None] + np.array([1, 2])).reshape(-1)
        slots = (node[:, None] - (tree.leaves - 1)) * LEAF + np.arange(LEAF)
        point, slots = np.repeat(point, LEAF), slots.reshape(-1)
        point, slots = point[slots < len(tree.order)], slots[slots < len(tree.order)]
        patch = tree.order[slots].astype(np.int64)
        near = self._may_be_nearer(point, tree.boxes[patch])
        point, patch = point[near], patch[near]
        return [(point[k : k + _MOST], patch[k : k + _MOST]) for k in range(0, len(point), _MOST)]

    def _may_be_nearer(self, point: Ints, boxes: np.ndarray[tuple[int, ...], np.dtype[np.float32]]) -> Bools:
        """(n,) whether boxes (n, 6) are as near to points as what has been found."""
        own, corners = self.points[point], boxes.astype(np.float64)
        gap = np.maximum(np.maximum(corners[:, :3] - own, own - corners[:, 3:]), 0.0)
        return np.asarray(np.sqrt((gap**2).sum(axis=1)) <= self.distance[point] + self.equal)

    def _search_pairs(self, point: Ints, patch: Ints) -> None:
        """Find the least distances between pairs of points and patches."""
        group = np.searchsorted(self._first, patch, side="right") - 1
        for number in np.unique(group):
            here = group == number
            self._search(number, point[here], patch[here] - self._first[number])

    def _search(self, number: int, point: Ints, row: Ints) -> None:
        """The same with patches of one group: all parts that are not decided are cut, round by round."""
        patches, bounds = self.surface.groups[number], self._bounds[number]
        linear = linear_distance(patches, row, self.points[point])
        near = np.flatnonzero(linear - bounds[row, 9] <= self.distance[point] + self.equal)
        point, row = point[near], row[near]
        waiting = [(point, Parts.whole(patches.corners, row))]
        while waiting:
            point, parts = waiting.pop()
            model = Model.of(patches, parts, self.points[point])
            start, lower = model.nearest_linear(bounds)
            worth = np.flatnonzero(lower <= self.distance[point] + self.equal)
            point, model, start = point[worth], model.take(worth), start[worth]
            parts, convex = model.parts, model.is_convex(bounds)
            start[convex] = self._polish(patches, model.take(np.flatnonzero(convex)), start[convex])
            self._keep(number, point, parts.row, parts.places(start))

            # where D has no stationary point it is least on the sides; those within the face are other patches', too
            cut = np.flatnonzero(~convex & ~model.is_steady(bounds))
            whole = np.flatnonzero(~convex) if parts.depth == 0 and parts.corners > 2 else cut[:0]
            if len(cut) and parts.depth < _ROUNDS and len(cut) <= _MOST:
                made = parts.take(cut).divide()
                waiting.append((np.tile(point[cut], len(made) // len(cut)), made))
            if len(whole):
                sides, owner = parts.take(whole).sides(patches)
                waiting.append((point[whole[owner]], sides))

    def _polish(self, patches: SurfacePatches, model: Model, start: Floats) -> Floats:
        """(n, 2) where the distance is least in parts where it is convex."""
        result, moving = start.copy(), np.arange(len(start))
        for _ in range(0 if patches.is_flat else _STEPS):
            if not len(moving):
                break
            parts, here = model.parts.take(moving), result[moving]
            there = Model.of(patches, parts.around(here), model.goal[moving])
            result[moving] = least(parts.corners, there.bend, there.gradient - _times(there.bend, here))
            moving = moving[np.abs(result[moving] - here).max(axis=1) > 1e-10]
        return result

    def _keep(self, number: int, point: Ints, row: Ints, where: Floats) -> None:
        """Note the distances to points ``where`` (n, 2) of patches of a group."""
        patches, first = self.surface.groups[number], self._first[number]
        place = patches.at(where, row)
        away = self.points[point] - place
        distance = np.sqrt((away**2).sum(axis=1))
        np.minimum.at(self.distance, point, distance)
        best = np.flatnonzero(distance <= self.distance[point])
        self.place[point[best]] = place[best]
        near = np.flatnonzero(distance <= self.distance[point] + self.equal)
        if self.surface.is_closed and len(near):
            side = _side(patches, row[near], where[near], away[near], distance[near])
            self._found.append((point[near], distance[near], side, first + row[near], patches.face[row[near]]))


def _side(patches: SurfacePatches, row: Ints, where: Floats, away: Floats, distance: Floats) -> Floats:
    """(n,) positive before the patch, negative behind; weighed by the angle that the face has at its border."""
    s, t = patches.at(where, row, 1, 0), patches.at(where, row, 0, 1)
    normal = np.cross(s, t) if patches.corners > 2 else s[:, [1, 0, 2]] * (1, -1, 0)
    size = np.linalg.norm(normal, axis=1) * distance
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(size > 0, _dot(normal, away) / size, 1.0) * _angle(patches, row, where, s, t))


#: how near to a side points lie on it, and what points within a face weigh, more than any angles
_ON, _WITHIN = 1e-9, 100.0


def _angle(patches: SurfacePatches, row: Ints, where: Floats, s: Floats, t: Floats) -> Floats:
    """(n,) the angle at which a face leaves a point of its border, or the patch's part of it; `_WITHIN` elsewhere."""
    angle, corners = np.full(len(row), _WITHIN), CORNERS[patches.corners]
    on = np.stack([_lies_on_side(patches.corners, k, where) for k in range(patches.corners)], axis=1)
    sides, ends = ((patches.outer[row, None] >> (shift + np.arange(patches.corners))) & 1 == 1 for shift in (0, 4))
    angle[(on & sides).any(axis=1)] = np.pi
    if patches.corners == 2:
        return angle
    for k, corner in enumerate(corners):
        here = np.flatnonzero(on[:, k] & on[:, k - 1] & ends[:, k])
        ahead, back = corners[(k + 1) % patches.corners] - corner, corners[k - 1] - corner
        a, b = (way[:1] * s[here] + way[1:] * t[here] for way in (ahead, back))
        angle[here] = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), _dot(a, b))
    return angle


def _lies_on_side(corners: int, k: int, where: Floats) -> Bools:
    """(n,) whether points lie on side k."""
    s, t = where.T
    if corners == 2:
        return np.asarray(np.abs(s - (1 if k else -1)) < _ON)
    lines = (1 + t, -s - t, 1 + s) if corners == 3 else (1 + t, 1 - s, 1 - t, 1 + s)
    return np.asarray(lines[k] < _ON)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray((a * b).sum(axis=1))


def _times(bend: Floats, points: Floats) -> Floats:
    """(n, 2) symmetric matrices times points."""
    (ss, st, tt), (s, t) = bend.T, points.T
    return np.stack([ss * s + st * t, st * s + tt * t], axis=1)
