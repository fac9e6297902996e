"""Sides without a partner that lie on sides of other elements: hanging nodes, mortars, sides of other shapes.

A side is an inner one if every point of a lattice on it lies on sides of elements beyond it, within rounding.  The
lattice has 2 d + 3 points along each direction, where d is the highest degree of the map along a side.  If a side is a
part of another, as in refined meshes, it is the other's polynomial under an affine change of coordinates.  Agreement at
d + 1 points along each direction then proves that both are equal.  The sides of both elements must also enclose
nothing: the integrals of n and of x . n over all sides that touch one another are zero.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.interfaces.feet import feet
from elvis.core.interfaces.side_groups import COLLAPSED, SideSet
from elvis.core.mapping.boxes import BoxTree, outward
from elvis.core.polynomials.quadrature import gauss

#: distance, relative to the box of all sides, up to which a point lies on a side
ROUNDING = 1e-11
#: the same distance relative to the largest coordinate, in roundings of the source's numbers
SOURCE_ROUNDINGS = 64
#: distance, relative to a side's size, up to which it is unclear whether a side lies on another
NEAR = 0.06
#: cosines of the angle between normals into both elements: for coincident sides, and the maximum for sides that may
#: coincide
OPPOSITE = -0.9
FACING = 0.5
#: sides with whose boxes a point of a side is compared at most, in the mean
MOST_OTHERS = 16
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
    """Points of sides that lie on or near other sides.

    side, point  (n,) the side, and the number of its point
    other        (n,) the side that it lies on
    distance     (n,)
    is_on        (n,) whether it lies on the other side; else near it
    """

    side: Ints
    point: Ints
    other: Ints
    distance: Floats
    is_on: Bools

    def joined(self, other: _Contacts) -> _Contacts:
        """Both together."""
        return _Contacts(*(np.concatenate([getattr(each, own.name) for each in (self, other)]) for own in fields(self)))


def hanging(sides: SideSet, named: Bools, is_oriented: bool, precision: float) -> Hanging:
    """Find the inner ones among sides without a partner.

    named        (n,) whether a boundary that the source names holds the side.  Two named sides of equal corners are the
                 faces of a slit.
    is_oriented  whether elements fill the space, so that those on both sides of a face lie opposite
    precision    relative rounding of the source's numbers
    """
    every = np.arange(len(sides))
    collapsed = _are_collapsed(sides)
    search = _Search(sides, every[~collapsed], named, is_oriented, precision)

    # a first look at few points of each side
    possible = search.possible()
    probes, touched, covered = search.contacts(possible, 0)
    likely = np.flatnonzero(covered & ~search.is_crowded)
    if not touched.any():
        return Hanging(sides.entity[collapsed], np.empty(0, np.int64))

    # then at as many as decide: on the sides that were met, and where these leave something open, on all
    count = 2 * sides.degree + 3
    found, _, sure = search.contacts(likely, count, np.stack([probes.side, probes.other], axis=1))
    rest = likely[~sure[likely]]
    further, _, are_covered = search.contacts(rest, count)
    found, sure = found.joined(further), sure | are_covered
    undecided = touched & ~sure
    undecided |= search.are_open(found, sure, undecided)
    gap = probes.distance[undecided[probes.side]].max(initial=0.0)
    return Hanging(sides.entity[sure | collapsed], sides.entity[undecided], float(gap))


def _tally(found: _Contacts, sampled: Ints, count: int, sides: Ints) -> tuple[Bools, Bools]:
    """(count,) whether any point of a side touches another, and whether all points lie on others.

    sampled  (p,) the place of each point's side among ``sides`` (k,)
    """
    touched = np.zeros(count, bool)
    touched[found.side] = True
    hits = np.zeros(len(sampled), bool)
    hits[found.point[found.is_on]] = True
    misses = np.bincount(sides[sampled[~hits]], minlength=count)
    covered = np.zeros(count, bool)
    covered[sides] = misses[sides] == 0
    return touched, covered


def _are_collapsed(sides: SideSet) -> Bools:
    """(n,) whether sides have no area, or no length."""
    every = np.arange(len(sides))
    which, points = sides.samples(every, 0)
    factors = sides.factors(points, which)
    greatest = np.zeros(len(sides))
    np.maximum.at(greatest, which, factors)
    box = sides.boxes()
    scale = float(np.ptp(np.concatenate([box[:, :3], box[:, 3:]]), axis=0).max(initial=0.0)) if len(sides) else 0.0
    sizes = np.linalg.norm(box[:, 3:] - box[:, :3], axis=1)
    flat = np.array([group.corners > 2 for group in sides.groups], bool)[sides.group]
    return np.asarray((greatest <= COLLAPSED * np.where(flat, sizes**2, scale)) | (sizes <= COLLAPSED * scale))


class _Search:
    """Sides among which partners are sought.

    candidates  (n,) the sides that may be partners
    is_crowded  (n,) whether `contacts` has found a side among so many others that it stays undecided: the boxes of
                broken meshes all overlap
    """

    def __init__(self, sides: SideSet, candidates: Ints, named: Bools, is_oriented: bool, precision: float) -> None:
        self.sides, self.named, self.is_oriented = sides, named, is_oriented
        self._candidates = candidates
        box = sides.boxes()[candidates]
        low, high = box[:, :3], box[:, 3:]
        magnitude = float(np.abs(box).max(initial=0.0))
        scale = float(np.linalg.norm(np.ptp(box.reshape(-1, 3), axis=0))) if len(box) else 0.0
        self._rounding = max(ROUNDING * scale, SOURCE_ROUNDINGS * precision * magnitude)
        self._size = np.zeros(len(sides))
        self._size[candidates] = np.linalg.norm(high - low, axis=1)
        extra = NEAR * self._size[candidates, None] + self._rounding
        self._low, self._high = low - extra, high + extra
        self._tree = BoxTree.build(outward(self._low, self._high, 0.0))
        centres = np.zeros((len(sides), 2))
        self._normals = sides.normals(centres, np.arange(len(sides)))[0]
        self.is_crowded = np.zeros(len(sides), bool)

    def possible(self) -> Ints:
        """Ascending sides whose boxes meet the box of another side that faces them."""
        side, other = (self._candidates[own] for own in self._tree.overlaps(self._low, self._high))
        return np.unique(side[(side != other) & self._may_face(side, other)])

    def _may_face(self, side: Ints, other: Ints) -> Bools:
        """(n,) whether elements may lie on opposite sides of two sides, judged at the centres of these."""
        if not self.is_oriented:
            return np.ones(len(side), bool)
        return np.asarray(np.einsum("ni,ni->n", self._normals[side], self._normals[other]) < FACING)

    def contacts(self, chosen: Ints, count: int, pairs: Ints | None = None) -> tuple[_Contacts, Bools, Bools]:
        """Contacts of points of the sides ``chosen`` (k,) that lie on or near others.

        The other results are as in `_tally`.

        count  as in `SideSet.samples`
        pairs  (m, 2) sides and others that may be touched; None for all
        """
        which, points = self.sides.samples(chosen, count)
        side = chosen[which]
        world = self.sides.at(points, side)
        point, other = self._candidate_pairs(which, chosen, world, pairs, is_limited=count > 0)

        nearest = feet(self.sides, other, world[point])
        size = np.minimum(self._size[side[point]], self._size[other])
        is_on = nearest.inside & (nearest.distance <= self._rounding)
        near = nearest.inside & (nearest.distance <= NEAR * size)
        near &= ~self.named[side[point]] & ~self.named[other]
        # at a sharp corner two sides of one element are near each other
        near &= self.sides.element[side[point]] != self.sides.element[other]
        kept = np.flatnonzero(is_on | near)
        kept = kept[self._are_facing(points[point[kept]], side[point[kept]], nearest.points[kept], other[kept])]
        kept = kept[self._joined(side[point[kept]], other[kept], is_on[kept])]
        found = _Contacts(side[point[kept]], point[kept], other[kept], nearest.distance[kept], is_on[kept])
        return found, *_tally(found, which, len(self.sides), chosen)

    def _candidate_pairs(
        self, which: Ints, chosen: Ints, world: Floats, pairs: Ints | None, is_limited: bool
    ) -> tuple[Ints, Ints]:
        """Numbers of points ``world`` (p, 3), and the other sides in whose boxes they are.

        which       (p,) the place of each point's side among ``chosen`` (k,)
        pairs       as in `contacts`
        is_limited  whether sides with very many others are skipped
        """
        side = chosen[which]
        point, other = self._tree.candidates(world)
        other = self._candidates[other]
        possible = (side[point] != other) & self._may_face(side[point], other)
        if pairs is not None:
            possible &= np.isin(self._code(side[point], other), self._code(*pairs.T))
        pairs_of_sides = np.bincount(which[point[possible]], minlength=len(chosen))
        is_crowded = pairs_of_sides > MOST_OTHERS * np.bincount(which, minlength=len(chosen))
        self.is_crowded[chosen] |= is_crowded
        if is_limited:
            possible &= ~is_crowded[which[point]]
        return point[possible], other[possible]

    def _code(self, side: Ints, other: Ints) -> Ints:
        """(n,) a number for each pair of sides."""
        return side * len(self.sides) + other

    def _are_facing(self, points: Floats, side: Ints, others: Floats, other: Ints) -> Bools:
        """(n,) whether elements lie on opposite sides of two sides at points (n, 2) of both."""
        if not self.is_oriented:
            return np.ones(len(side), bool)
        here, there = self.sides.normals(points, side)[0], self.sides.normals(others, other)[0]
        return np.asarray(np.einsum("ni,ni->n", here, there) < OPPOSITE)

    def _joined(self, side: Ints, other: Ints, is_on: Bools) -> Bools:
        """(n,) whether pairs of sides count: faces of a slit don't, and near ones only if corners are also near."""
        pairs, which = np.unique(np.stack([side, other], axis=1), axis=0, return_inverse=True)
        both_named = self.named[pairs].all(axis=1)
        one, two = self.sides.corners(pairs[:, 0]), self.sides.corners(pairs[:, 1])
        apart = np.linalg.norm(one[:, :, None] - two[:, None], axis=3)
        is_equal = (apart.min(axis=2).max(axis=1) <= self._rounding) & (apart.min(axis=1).max(axis=1) <= self._rounding)
        is_slit = both_named & is_equal
        touches = apart.min(axis=(1, 2)) <= self._rounding
        which = which.reshape(-1)
        return np.asarray(~is_slit[which] & (is_on | touches[which]))

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


def fluxes(sides: SideSet, chosen: Ints) -> tuple[Floats, Floats]:
    """(k,) areas of the sides ``chosen`` (k,), and (k, 4) the integrals of the normal n over them, and of x . n."""
    area, flux = np.zeros(len(chosen)), np.zeros((len(chosen), 4))
    for group, here in sides.parted(chosen):
        points, weights = _rule(group.corners, 2 * group.degree + 1)
        rows = np.repeat(sides.row[chosen[here]], len(points))
        many = np.tile(points, (len(here), 1))
        normals, factors = group.normals(many, rows)
        places = group.patches.at(many, rows)
        parts = np.column_stack([normals, np.einsum("ni,ni->n", places, normals), np.ones(len(rows))])
        parts *= (factors * np.tile(weights, len(here)))[:, None]
        sums = parts.reshape(len(here), len(points), 5).sum(axis=1)
        flux[here], area[here] = sums[:, :4], sums[:, 4]
    return area, flux


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
    pairs = np.unique(np.stack([first, second], axis=1), axis=0)
    while True:
        least = np.minimum(label[pairs[:, 0]], label[pairs[:, 1]])
        before = label.copy()
        np.minimum.at(label, pairs[:, 0], least)
        np.minimum.at(label, pairs[:, 1], least)
        label = label[label]
        if np.array_equal(before, label):
            return label
