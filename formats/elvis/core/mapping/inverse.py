"""The inverse of the mapping: from world points to the reference coordinates of given elements.

Newton's method starts from a guess by the map's linear part.  Elements that cannot hold the point are excluded early:
their Bernstein net, and so the element, lies to one side of it.  If Newton's method finds no root inside and the map
isn't affine, `enclosure` searches the whole element with proofs.

Homogeneous directions are not treated here: points have coordinate 0 along them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats, grid_points
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.core.mapping.boxes import ROUNDINGS
from elvis.core.mapping.enclosure import excluded, search
from elvis.core.mapping.margins import heights, margins
from elvis.core.mapping.newton import ITERATIONS, Targets, heights_rounding, newton
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.bernstein import bernstein_coefficients, bernstein_space
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.expansion import values, values_and_gradients
from elvis.core.polynomials.row_products import row_products
from elvis.core.shapes import Shape

#: residual of a root, relative to the element's size; some units in the last place of the coordinates add to it
RESIDUAL = 1e-13

#: maximum ratio of an element's size to the size of its net
_NET = 0.25

#: maximum distance of points from an element that is a curve or surface, relative to its size
DISTANCE = 1e-6

#: tolerance for rounding when elements are excluded, in reference coordinates
_SIDE = 1e-9
#: the same tolerance for exclusion by proof, relative to a shape's height
_REACH = 1e-3
#: iterations in which most roots are found
_FEW = 8
#: numbers of maps, and of pairs, that are treated together
_BATCH, _PAIRS = 1 << 21, 1 << 15
_AFFINE = (Shape.SEGMENT, Shape.TRIANGLE, Shape.TETRAHEDRON)


class Status(IntEnum):
    """Relation of a point to an element; the numbers also appear in pictures."""

    OUTSIDE = 0
    INSIDE = 1
    UNCERTAIN = 2  # Newton's method found no root inside, which proves nothing
    FAILED = 3


@dataclass(frozen=True, eq=False)
class Roots(Rows):
    """Results for n pairs of a point and an element.

    reference  (n, d)  coordinates, NaN unless inside
    margin     (n,) smallest height over the element's facets, 0 on its boundary (`margins`); NaN unless inside
    status     (n,)    of `Status`
    """

    reference: Floats
    margin: Floats
    status: NDArray[np.uint8]

    @staticmethod
    def none(count: int, dimension: int) -> Roots:
        """Roots for pairs that are all outside."""
        reference, margin = np.full((count, dimension), np.nan), np.full(count, np.nan)
        return Roots(reference, margin, np.full(count, Status.OUTSIDE, np.uint8))

    def put(self, chosen: Ints, roots: Roots) -> None:
        """Write results in the places ``chosen``."""
        self.reference[chosen] = roots.reference
        self.margin[chosen] = roots.margin
        self.status[chosen] = roots.status


def invert(patch: Patch, rows: Ints, points: Floats, prove: bool = True, distance: float = DISTANCE) -> Roots:
    """Reference coordinates of the world points (n, 3) in the elements ``rows`` (n,) of a patch.

    A point is inside if it has reference coordinates with a margin of at least -1e-10 that map to it with a residual of
    1e-13 of the element's size (on a curve or surface: that lie within ``distance`` of it).  If the rounding of world
    coordinates is larger, it replaces this residual.  FAILED marks pairs that even the search cannot decide.  Pairs
    that need the search are UNCERTAIN unless ``prove`` is set.
    """
    roots = Roots.none(len(rows), patch.shape.dimension)
    for chosen in _batches(patch, rows):
        distinct = _Elements(patch, np.unique(rows[chosen]), distance)
        _first_pass(distinct, rows[chosen], points[chosen], chosen, roots, prove)
    if prove:
        decide(patch, rows, points, roots, distance)
    return roots


def _batches(patch: Patch, rows: Ints) -> Iterator[Ints]:
    """Pairs, by elements (n,), that are treated together: the maps of their elements, and they, are not too many."""
    # pairs of an element follow each other, so that few batches need its facts
    order = np.argsort(rows, kind="stable")
    number = np.cumsum(np.diff(rows[order], prepend=rows[order[:1]]) != 0)
    most = max(256, _BATCH // int(np.prod(patch.geometry_coefficients.shape[1:])))
    for some in np.split(order, np.flatnonzero(np.diff(number // most)) + 1):
        for part in chunks(len(some), _PAIRS):
            yield some[part]


def decide(patch: Patch, rows: Ints, points: Floats, roots: Roots, distance: float = DISTANCE) -> None:
    """Search the elements of all pairs that are UNCERTAIN, and write the results into ``roots``."""
    which = np.flatnonzero(roots.status == Status.UNCERTAIN)
    elements = _Elements(patch, np.unique(rows[which]), distance)
    reference, found, undecided = search(elements.targets(rows[which], points[which]))
    roots.status[which] = np.select([found, undecided], [Status.INSIDE, Status.FAILED], Status.OUTSIDE)
    roots.reference[which], roots.margin[which] = reference, margins(patch.shape, reference)


def _first_pass(elements: _Elements, rows: Ints, points: Floats, chosen: Ints, roots: Roots, prove: bool) -> None:
    """Exclude impossible elements, try Newton's method on the rest; results go to the rows ``chosen`` of ``roots``."""
    guess = elements.guess(rows, points)
    possible = elements.may_hold(rows, points, guess)
    chosen, guess, targets = chosen[possible], guess[possible], elements.targets(rows[possible], points[possible])
    if prove and not elements.is_affine:
        # a point not found in a few iterations is mostly outside, which is cheaper to prove than many iterations in
        # vain
        _try(targets, guess, chosen, roots, _FEW)
        reach = elements.reach(targets.rows)
        unsure = roots.status[chosen] == Status.UNCERTAIN
        again = np.flatnonzero(unsure & np.isfinite(reach))
        nowhere = again[excluded(targets.part(again), reach[again])]
        roots.status[chosen[nowhere]] = Status.OUTSIDE
        unsure[nowhere] = False
        chosen, guess, targets = chosen[unsure], guess[unsure], targets.part(unsure)
    outside = _try(targets, guess, chosen, roots) & elements.is_affine
    roots.status[chosen[outside]] = Status.OUTSIDE

    # a second try from nearby where the linear part misled the first
    again = roots.status[chosen] == Status.UNCERTAIN
    chosen, targets = chosen[again], targets.part(again)
    _try(targets, elements.nearest(targets.rows, targets.points), chosen, roots)


def _try(targets: Targets, starts: Floats, chosen: Ints, roots: Roots, iterations: int = ITERATIONS) -> Bools:
    """Newton's method; roots inside go to the rows ``chosen`` of ``roots``.

    Returns (n,) whether it converged elsewhere.
    """
    feet = newton(targets, starts, iterations)
    inside = feet.inside
    roots.status[chosen] = np.where(inside, Status.INSIDE, Status.UNCERTAIN)
    roots.reference[chosen[inside]], roots.margin[chosen[inside]] = feet.reference[inside], feet.margin[inside]
    return feet.converged & ~inside


class _Elements:
    """Facts about distinct elements ``rows`` (u,), sorted, of a patch.

    size    (u,) diagonal of the box round the Bernstein net; rounding (u,) of the largest coordinate
    low, high (u, 3) corners of that box, a little larger
    centre        of the reference shape, its image (u, 3) and dual tangents (u, 3, d) there
    lowest  (u, k) smallest height of the net over each facet, seen through the linear part of the map, less its
            rounding
    """

    def __init__(self, patch: Patch, rows: Ints, distance: float) -> None:
        self.patch, self.rows, self._distance = patch, rows, distance
        self._side = _SIDE if patch.shape.dimension == 3 else _SIDE + 2 * distance
        self.is_affine = patch.shape in _AFFINE and bernstein_space(patch.geometry).degrees == (1,)
        coefficients = patch.geometry_coefficients[rows]
        net = bernstein_coefficients(patch.geometry, coefficients)
        self.size = np.linalg.norm(np.ptp(net, axis=2), axis=1)
        self.rounding = ROUNDINGS * np.finfo(float).eps * np.abs(net).max(axis=(1, 2), initial=0)
        extra = (self._side * self.size + self.rounding)[:, None]
        self.low, self.high = net.min(axis=2) - extra, net.max(axis=2) + extra

        # the linear part of the map at the centre, and the net seen through it
        self.centre = patch.shape.centre
        modes, gradients = values_and_gradients(patch.geometry, self.centre[None])
        self.image = coefficients @ modes[0]
        self.duals = duals(coefficients @ gradients[0].T)
        seen = self._linear_guess(net - self.image[:, :, None])
        above = heights(patch.shape, seen.reshape(-1, patch.shape.dimension))
        self._room = heights_rounding(patch.shape, self.duals, self.rounding)
        self.lowest = above.reshape(*seen.shape[:2], above.shape[1]).min(axis=1) - self._room

    def _linear_guess(self, offsets: Floats) -> Floats:
        """(u, k, d) reference coordinates, by the linear part, of points at ``offsets`` (u, 3, k) from the image."""
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray(self.centre + np.einsum("uci,uck->uki", self.duals, offsets))

    def targets(self, rows: Ints, points: Floats) -> Targets:
        """The points (n, 3) as targets in the elements ``rows`` (n,), which are among these."""
        place = np.searchsorted(self.rows, rows)
        rounding = self.rounding[place]
        precision = np.maximum(_NET * RESIDUAL * self.size[place], rounding)
        distance = self._distance * self.size[place] if self.patch.shape.dimension < 3 else precision
        return Targets(self.patch, rows, points, precision, np.maximum(distance, precision), rounding)

    def reach(self, rows: Ints) -> Floats:
        """(n,) bound of the distance at which a root beyond the facets of elements ``rows`` (n,) may count as inside.

        Infinite if rounding is as large as the element: no element is then excluded.
        """
        room = self._room[np.searchsorted(self.rows, rows)].max(axis=1)
        return np.asarray(np.where(room < _REACH, _REACH + 10 * room, np.inf))

    def guess(self, rows: Ints, points: Floats) -> Floats:
        """(n, d) reference coordinates of the points by the linear part of the map."""
        place = np.searchsorted(self.rows, rows)
        offsets = points - self.image[place]
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray(self.centre + np.einsum("nci,nc->ni", self.duals[place], offsets))

    def nearest(self, rows: Ints, points: Floats) -> Floats:
        """(n, d) for each point the one of some reference points that is mapped nearest to it."""
        lattice = _lattice(self.patch.shape)
        modes, best = values(self.patch.geometry, lattice).T, np.empty(len(rows), np.int64)
        for part in chunks(len(rows), max(1, _BATCH // (3 * len(lattice)))):
            images = row_products(self.patch.geometry_coefficients[rows[part]], modes)
            best[part] = ((images - points[part, :, None]) ** 2).sum(axis=1).argmin(axis=1)
        return lattice[best]

    def may_hold(self, rows: Ints, points: Floats, guess: Floats) -> Bools:
        """(n,) whether the points, and their guesses, don't lie beyond all of the net of their element on some side."""
        place = np.searchsorted(self.rows, rows)
        outside = (points < self.low[place]) | (points > self.high[place])
        with np.errstate(invalid="ignore"):
            beyond = heights(self.patch.shape, guess) < self.lowest[place] - self._side
        return np.asarray(~(outside.any(axis=1) | beyond.any(axis=1)))


@bounded_cache
def _lattice(shape: Shape) -> Floats:
    """(k, d) reference points all over a shape, its vertices among them."""
    line = np.array([-1.0, -0.8, 0.0, 0.8, 1.0])
    eta = grid_points(*[line] * shape.dimension)
    return frozen_floats(np.unique(uncollapse(shape, eta), axis=0))
