"""Sides without a partner that lie on sides of other elements: hanging nodes, mortars, sides of other shapes.

A side is an inner one if every point of a lattice on it lies on sides of elements beyond it, within rounding.  The
lattice has 2 d + 3 points along each direction, where d is the highest degree of the map along a side.  If a side is a
part of another, as in refined meshes, it is the other's polynomial under an affine change of coordinates.  Agreement at
d + 1 points along each direction then proves that both are equal.  The sides of both elements must also enclose
nothing: the integrals of n and of x . n over all sides that touch one another are zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import (
    Bools,
    Floats,
    Ints,
    joined_floats,
    joined_ints,
    narrow_ints,
    pair_numbers,
)
from elvis.core.interfaces.collapsed import NOWHERE, are_collapsed, widened
from elvis.core.interfaces.crowded_sides import HOPELESS, NEAR, POINTS_AT_ONCE, hopeless_sides, shares, surplus
from elvis.core.interfaces.feet import feet
from elvis.core.interfaces.side_groups import SideGroup, SideSet
from elvis.core.mapping.boxes import Boxes, BoxTree, meet, outward
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.quadrature import gauss

#: distance, relative to the box of all sides, up to which a point lies on a side
ROUNDING = 1e-11
#: the same distance relative to the largest coordinate, in roundings of the source's numbers
SOURCE_ROUNDINGS = 64
#: cosines of the angle between normals into both elements: for coincident sides, and the maximum for sides that may
#: coincide
OPPOSITE = -0.9
FACING = 0.5
#: sides with whose boxes a point of a side is compared at most, in the mean
MOST_OTHERS = 16
#: sides in a leaf of the tree, at least
LEAF = 4
#: pairs of a point and a node of the tree that are compared together
NODES_AT_ONCE = 1 << 14
#: pairs of a point and a side whose distance is determined together
PAIRS_AT_ONCE = 1 << 14
#: sides whose integrals are taken together
SIDES_AT_ONCE = 1 << 12
#: part of the area that sides which touch one another may enclose, or leave open
OPEN = 1e-9


@dataclass(frozen=True, eq=False)
class Hanging:
    """Sides without a partner, classified.

    inner      (n,) rows of sides in the mesh that lie on sides of other elements, or are collapsed
    undecided  (m,) rows of sides that could not be classified
    gap        the largest distance of an undecided side from the sides that it is near
    """

    inner: Ints
    undecided: Ints
    gap: float = 0.0


@dataclass(frozen=True, eq=False)
class _Contacts:
    """Pairs of sides, the first of which has points that lie on or near the second.

    side      (n,)
    other     (n,) the side that it touches
    distance  (n,) the largest one of these points
    """

    side: Ints
    other: Ints
    distance: Floats

    @staticmethod
    def joined(parts: list[_Contacts]) -> _Contacts:
        """All of them, one after another."""
        side, other = (joined_ints(getattr(e, n) for e in parts) for n in _PAIR)
        return _Contacts(side, other, joined_floats(each.distance for each in parts))


_PAIR = ("side", "other")


def hanging(sides: SideSet, named: Bools, is_oriented: bool, precision: float) -> Hanging:
    """Find the inner ones among sides without a partner.

    named        (n,) whether a boundary that the source names holds the side.  Two named sides of equal corners are the
                 faces of a slit.
    is_oriented  whether elements fill the space, so that those on both sides of a face lie opposite
    precision    relative rounding of the source's numbers
    """
    collapsed = are_collapsed(sides)
    regular = narrow_ints(np.flatnonzero(~collapsed), len(sides))
    search = _Search(sides, regular, named, is_oriented, precision)

    # a first look at few points of each side
    hopeless = search.hopeless()
    possible = search.possible(hopeless)
    probes, touched, covered = search.contacts(possible, 0)
    touched |= hopeless
    likely = np.flatnonzero(covered & ~search.is_crowded)
    if not touched.any():
        return Hanging(sides.entity[collapsed], np.empty(0, np.int64))

    # then at as many as decide: on the sides that were met, and where these leave something open, on all
    count = 2 * sides.degree + 3
    found, _, sure = search.contacts(likely, count, probes)
    rest = likely[~sure[likely]]
    further, _, are_covered = search.contacts(rest, count)
    found, sure = _Contacts.joined([found, further]), sure | are_covered
    undecided = touched & ~sure
    undecided |= search.are_open(found, sure, undecided)
    gap = probes.distance[undecided[probes.side]].max(initial=0.0)
    return Hanging(sides.entity[sure | collapsed], sides.entity[undecided], float(gap))


class _Search:
    """Sides among which partners are sought.

    candidates  (n,) the sides that may be partners
    is_crowded  (n,) whether `contacts` has found a side among so many others that it stays undecided: the boxes of
                broken meshes all overlap
    Sides are compared some at a time, so that memory doesn't grow with the pairs of sides whose boxes overlap.
    """

    def __init__(self, sides: SideSet, candidates: Ints, named: Bools, is_oriented: bool, precision: float) -> None:
        self.sides, self.named, self.is_oriented = sides, named, is_oriented
        self._candidates = candidates
        extent = NOWHERE
        for part in chunks(len(candidates), POINTS_AT_ONCE):
            extent = widened(extent, sides.boxes(candidates[part]))
        magnitude = float(np.abs(extent).max()) if len(candidates) else 0.0
        scale = float(np.linalg.norm(extent[1] - extent[0])) if len(candidates) else 0.0
        self._rounding = max(ROUNDING * scale, SOURCE_ROUNDINGS * precision * magnitude)
        # sizes and normals decide what is near, and what may face one another: single precision does
        self._size = np.zeros(len(sides), np.float32)
        boxes = np.empty((len(candidates), 6), np.float32)
        for part in chunks(len(candidates), POINTS_AT_ONCE):
            low, high = self._enlarged(part)
            boxes[part] = outward(low, high, 0.0)
        # leaves of a power of two that are nearly full: half of them could be empty otherwise
        leaves = 1 << max(0, (len(boxes) // LEAF).bit_length() - 1)
        self._tree = BoxTree.build(boxes, max(LEAF, -(-len(boxes) // leaves)))
        self._normals = np.empty((len(sides), 3), np.float32)
        for part in chunks(len(sides), POINTS_AT_ONCE):
            own = np.arange(part.start, part.stop)
            self._normals[part] = sides.normals(np.zeros((len(own), 2)), own)[0]
        self.is_crowded = np.zeros(len(sides), bool)

    def _enlarged(self, part: slice) -> tuple[Floats, Floats]:
        """(k, 3) low and high corners of the boxes of the candidates of a part, with room for sides that are near."""
        own = self._candidates[part]
        box = self.sides.boxes(own)
        low, high = box[:, :3], box[:, 3:]
        self._size[own] = np.linalg.norm(high - low, axis=1)
        extra = NEAR * self._size[own, None] + self._rounding
        return low - extra, high + extra

    def hopeless(self) -> Bools:
        """(n,) some of the sides that `contacts` would find to be hopeless."""
        facing = FACING if self.is_oriented else None
        return hopeless_sides(self.sides, self._candidates, self._tree, self._normals, self._size, facing)

    def possible(self, known: Bools) -> Ints:
        """Ascending sides whose boxes meet the box of another side that faces them, without those ``known`` (n,)."""
        found = np.zeros(len(self.sides), bool)
        for part in chunks(len(self._candidates), POINTS_AT_ONCE):
            found[self._candidates[part]] = self._are_met(part, known)
        return np.flatnonzero(found & ~known)

    def _are_met(self, part: slice, known: Bools) -> Bools:
        """(k,) which of the candidates of a part are possible; one that is met is compared with no further sides."""
        own = self._candidates[part]
        low, high = self._enlarged(part)
        is_met = known[own]

        def meets(boxes: Boxes, rows: Ints, which: Ints) -> Bools:
            return _meet_unless(is_met[which], low, high, boxes, rows, which)

        for which, place in self._tree.batches(len(own), meets, NODES_AT_ONCE, by_node=True):
            side, other = own[which], self._candidates[place]
            is_met[which[(side != other) & self._may_face(side, other)]] = True
        return is_met

    def _may_face(self, side: Ints, other: Ints) -> Bools:
        """(n,) whether elements may lie on opposite sides of two sides, judged at the centres of these."""
        if not self.is_oriented:
            return np.ones(len(side), bool)
        return np.asarray(np.einsum("ni,ni->n", self._normals[side], self._normals[other]) < FACING)

    def contacts(self, chosen: Ints, count: int, known: _Contacts | None = None) -> tuple[_Contacts, Bools, Bools]:
        """Contacts of the sides ``chosen`` (k,), ascending; which sides (n,) touch others, or are hopeless; and which
        have all points on others.

        count  as in `SideSet.samples`
        known  pairs of sides that may touch; None for all
        """
        touched, covered = np.zeros((2, len(self.sides)), bool)
        codes = None if known is None else np.unique(self._code(known.side, known.other))
        found = []
        for own in shares(chosen, count):
            part, touched[own], covered[own] = self._contacts(own, count, codes)
            found.append(part)
        return _Contacts.joined(found), touched, covered

    def _contacts(self, chosen: Ints, count: int, codes: Ints | None) -> tuple[_Contacts, Bools, Bools]:
        """`contacts` of some sides; the other results are (k,)."""
        which, points = self.sides.samples(chosen, count)
        side = chosen[which]
        world = self.sides.at(points, side)
        point, other, is_hopeless = self._candidate_pairs(which, chosen, world, codes, is_limited=count > 0)

        touched = is_hopeless
        is_hit = np.zeros(len(world), bool)
        found = []
        for part in chunks(len(point), PAIRS_AT_ONCE):
            here = point[part]
            kept, distance, is_on = self._touching(side[here], points[here], world[here], other[part])
            # a side touches others if one of its points does, and is covered if all do
            touched[which[here[kept]]] = True
            is_hit[here[kept[is_on]]] = True
            found.append(self._pairs(side[here[kept]], other[part][kept], distance))
        misses = np.bincount(which[~is_hit], minlength=len(chosen))
        return _Contacts.joined(found), touched, misses == 0

    def _touching(self, side: Ints, points: Floats, world: Floats, other: Ints) -> tuple[Ints, Floats, Bools]:
        """Which (k,) points ``world`` (n, 3) touch the sides ``other`` (n,); distances; whether they are on them.

        points  (n, 2) the coordinates of the points on their ``side`` (n,)
        """
        nearest = feet(self.sides, other, world)
        size = np.minimum(self._size[side], self._size[other])
        is_on = nearest.inside & (nearest.distance <= self._rounding)
        near = nearest.inside & (nearest.distance <= NEAR * size)
        near &= ~self.named[side] & ~self.named[other]
        # at a sharp corner two sides of one element are near each other
        near &= self.sides.element[side] != self.sides.element[other]
        kept = np.flatnonzero(is_on | near)
        kept = kept[self._are_facing(points[kept], side[kept], nearest.points[kept], other[kept])]
        kept = kept[self._joined(side[kept], other[kept], is_on[kept])]
        return kept, nearest.distance[kept], is_on[kept]

    def _pairs(self, side: Ints, other: Ints, distance: Floats) -> _Contacts:
        """Distinct pairs of sides, with the largest of their distances."""
        _, first, which = np.unique(self._code(side, other), return_index=True, return_inverse=True)
        largest = np.zeros(len(first))
        np.maximum.at(largest, which, distance)
        return _Contacts(side[first], other[first], largest)

    def _candidate_pairs(
        self, which: Ints, chosen: Ints, world: Floats, codes: Ints | None, is_limited: bool
    ) -> tuple[Ints, Ints, Bools]:
        """Numbers of points ``world`` (p, 3), the other sides in whose boxes they are; and the hopeless sides (k,).

        which       (p,) the place of each point's side among ``chosen`` (k,)
        codes       of the pairs of sides that may touch, ascending; None for all
        is_limited  whether sides with very many others are skipped
        """
        samples = np.bincount(which, minlength=len(chosen))
        counts = np.zeros(len(chosen), np.int64)
        is_hopeless = np.zeros(len(chosen), bool)

        def meets(boxes: Boxes, rows: Ints, point: Ints) -> Bools:
            return _meet_unless(is_hopeless[which[point]], world, world, boxes, rows, point)

        points, others = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for point, place in self._tree.batches(len(world), meets, NODES_AT_ONCE, by_node=True):
            side, other = chosen[which[point]], self._candidates[place]
            possible = (side != other) & self._may_face(side, other)
            possible &= self._is_near(world[point], side, other, self._tree.boxes[place])
            if codes is not None:
                possible &= _are_among(codes, self._code(side, other))
            points.append(point[possible])
            others.append(other[possible])
            counts += np.bincount(which[point[possible]], minlength=len(chosen))
            is_hopeless[:] = counts > HOPELESS * samples
        point, other = np.concatenate(points), np.concatenate(others)
        is_crowded = counts > MOST_OTHERS * samples
        self.is_crowded[chosen] |= is_crowded
        examined = ~(is_crowded if is_limited else is_hopeless)[which[point]]
        return point[examined], other[examined], is_hopeless

    def _is_near(self, world: Floats, side: Ints, other: Ints, boxes: Boxes) -> Bools:
        """(n,) whether points (n, 3) of sides lie so near the boxes of others that they may touch these."""
        excess = surplus(self._size[side], self._size[other])
        low, high = boxes[:, :3] + excess[:, None], boxes[:, 3:] - excess[:, None]
        return np.asarray(((low <= world) & (world <= high)).all(axis=1))

    def _code(self, side: Ints, other: Ints) -> Ints:
        """(n,) a number for each pair of sides."""
        return pair_numbers(side, other, len(self.sides))

    def _are_facing(self, points: Floats, side: Ints, others: Floats, other: Ints) -> Bools:
        """(n,) whether elements lie on opposite sides of two sides at points (n, 2) of both."""
        if not self.is_oriented:
            return np.ones(len(side), bool)
        here, there = self.sides.normals(points, side)[0], self.sides.normals(others, other)[0]
        return np.asarray(np.einsum("ni,ni->n", here, there) < OPPOSITE)

    def _joined(self, side: Ints, other: Ints, is_on: Bools) -> Bools:
        """(n,) whether pairs of sides count: faces of a slit don't, and near ones only if corners are also near."""
        _, first, which = np.unique(self._code(side, other), return_index=True, return_inverse=True)
        pairs = np.stack([side[first], other[first]], axis=1)
        one, two = self.sides.corners(pairs[:, 0]), self.sides.corners(pairs[:, 1])
        apart = np.linalg.norm(one[:, :, None] - two[:, None], axis=3)
        is_equal = (apart.min(axis=2).max(axis=1) <= self._rounding) & (apart.min(axis=1).max(axis=1) <= self._rounding)
        is_slit = is_equal & self.named[pairs].all(axis=1)
        is_near = apart.min(axis=(1, 2)) <= self._rounding
        return ~is_slit[which] & (is_on | is_near[which])

    def are_open(self, found: _Contacts, sure: Bools, undecided: Bools) -> Bools:
        """(n,) inner sides that enclose something, or leave a gap, together with the sides which they touch.

        The integrals of n and x . n over a closed surface without volume are zero (divergence theorem).
        """
        nothing = np.zeros(len(self.sides), bool)
        if not self.is_oriented or not sure.any():
            return nothing
        label = _components(found.side, found.other, len(self.sides))
        spoilt = np.zeros(len(self.sides), bool)
        spoilt[label[undecided | ~sure]] = True
        whole = np.flatnonzero(sure & ~spoilt[label])
        area, flux = fluxes(self.sides, whole)
        totals = np.zeros((len(self.sides), 4))
        np.add.at(totals, label[whole], flux)
        areas, sizes = np.zeros(len(self.sides)), np.zeros(len(self.sides))
        np.add.at(areas, label[whole], area)
        np.maximum.at(sizes, label[whole], self._size[whole])
        allowed = OPEN * areas + self._rounding * areas / np.where(sizes > 0, sizes, 1.0)
        is_open = np.abs(totals[:, :3]).max(axis=1) > allowed
        nothing[whole] = is_open[label[whole]]
        return nothing


def _meet_unless(is_done: Bools, low: Floats, high: Floats, boxes: Boxes, rows: Ints, which: Ints) -> Bools:
    """`meet` of those (k,) that aren't done; the others meet nothing."""
    if not is_done.any():
        return meet(low, high, boxes, rows, which)
    is_met = np.zeros(len(which), bool)
    left = np.flatnonzero(~is_done)
    is_met[left] = meet(low, high, boxes, rows[left], which[left])
    return is_met


def fluxes(sides: SideSet, chosen: Ints) -> tuple[Floats, Floats]:
    """(k,) areas of the sides ``chosen`` (k,), and (k, 4) the integrals of the normal n over them, and of x . n."""
    area, flux = np.zeros(len(chosen)), np.zeros((len(chosen), 4))
    for group, here, rows in sides.parted(chosen):
        for part in chunks(len(here), SIDES_AT_ONCE):
            sums = _integrals(group, rows[part])
            flux[here[part]], area[here[part]] = sums[:, :4], sums[:, 4]
    return area, flux


def _integrals(group: SideGroup, sides: Ints) -> Floats:
    """(k, 5) the integrals of the normal, of x . n and of 1 over the sides (k,) of a group."""
    points, weights = _rule(group.corners, 2 * group.degree + 1)
    rows = np.repeat(sides, len(points))
    many = np.tile(points, (len(sides), 1))
    normals, factors = group.normals(many, rows)
    patches, own = group.distinct_patches(rows)
    places = patches.at(many, own)
    parts = np.column_stack([normals, np.einsum("ni,ni->n", places, normals), np.ones(len(rows))])
    parts *= (factors * np.tile(weights, len(sides)))[:, None]
    return np.asarray(parts.reshape(len(sides), len(points), 5).sum(axis=1))


def _are_among(ascending: Ints, numbers: Ints) -> Bools:
    """(n,) which of numbers are among ascending ones."""
    if not len(ascending):
        return np.zeros(len(numbers), bool)
    place = np.minimum(np.searchsorted(ascending, numbers), len(ascending) - 1)
    return np.asarray(ascending[place] == numbers)


def _rule(corners: int, count: int) -> tuple[Floats, Floats]:
    """Points (n, 2) and weights (n,) of a Gauss rule on a domain with this many corners."""
    nodes, weights = gauss(count)
    if corners == 2:
        return np.stack([nodes, np.zeros(count)], axis=1), weights
    s, t = (part.reshape(-1) for part in np.meshgrid(nodes, nodes))
    product = np.multiply.outer(weights, weights).reshape(-1)
    if corners == 3:
        # Duffy's map of the square onto the triangle
        return np.stack([(1 + s) * (1 - t) / 2 - 1, t], axis=1), product * (1 - t) / 2
    return np.stack([s, t], axis=1), product


def _components(first: Ints, second: Ints, count: int) -> Ints:
    """(count,) the smallest number of each set that pairs connect."""
    label = np.arange(count)
    while True:
        least = np.minimum(label[first], label[second])
        before = label.copy()
        np.minimum.at(label, first, least)
        np.minimum.at(label, second, least)
        label = label[label]
        if np.array_equal(before, label):
            return label
