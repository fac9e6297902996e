"""Squares of pixels on a plane cut, in the elements there: which values are taken in each, and which are not.

On a plane cut an element's field is u(r(q)) of places q in the picture, where r(q) is the inverse map of the plane.
With bounds of the first and second derivatives of u and of the map (Bernstein coefficients), u differs over a cell of a
lattice from what is linear in each direction by at most

    1/8 (|u_xx| + |u_yy|) <= (M + G m) rho^2 / s^2

rho  half the square's extent in reference coordinates, of which s cells make a side
G, M sums of the absolute first and second derivatives of u
m    the same of the map's second derivatives, in parts of its Jacobian there

so that values at the lattice's corners decide, but for a band that narrows as s grows.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.mapping.orientation import chunks

if TYPE_CHECKING:
    from elvis.renderer.passes.lines.contour_proof import ContourProof

#: cells of a square's side, one after the other
_CELLS = (1, 4, 16)
#: numbers sampled at once
AT_ONCE = 1 << 18
#: part of a polynomial's greatest value that rounding may change
ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Bounds for each of n elements, on a neighbourhood of the shape.

    bend, turn           b and m of the map (see elvis.plugins.native.bending)
    gradient, curvature  G and M of the field
    noise                how far computed values may be off
    centre               (n, 3) world position of the centre
    inverse              (n, 3, 3) inverse of the Jacobian there
    """

    bend: Floats
    turn: Floats
    gradient: Floats
    curvature: Floats
    noise: Floats
    centre: Floats
    inverse: Floats

    def part(self, chosen: Ints) -> Derivatives:
        """Those of some elements."""
        return Derivatives(*(array[chosen] for array in vars(self).values()))

    @staticmethod
    def concatenate(several: list[Derivatives]) -> Derivatives:
        """Several as one."""
        arrays = zip(*(vars(some).values() for some in several), strict=True)
        return Derivatives(*(np.concatenate(parts) for parts in arrays))


@dataclass(frozen=True, eq=False)
class Items:
    """Squares of pixels (n,), each with an element (index) and reference coordinates near its centre.

    start  (n, 3), NaN where none are known
    """

    pixel: Ints
    element: Ints
    start: Floats

    def part(self, chosen: Ints) -> Items:
        """Some of the items."""
        return Items(self.pixel[chosen], self.element[chosen], self.start[chosen])


class Squares:
    """Squares of pixels in elements: their extent, whether they lie inside, and which decisions are proved.

    is_outside, is_inside  (n,) whether no, or every, point of the square is proved to be in the element
    taken                  (n,) after `decide`: whether a level is proved to be taken
    """

    def __init__(self, proof: ContourProof, number: int, items: Items, bounds: Derivatives) -> None:
        self._proof = proof
        self._number = number
        self._element = items.element
        self._bounds = bounds
        self._facets = proof.facets(number)
        width = proof.width
        self._column = (items.pixel % width).astype(float)
        self._line = (items.pixel // width).astype(float)

        # places of the plane at the middles and the corners, and how unlike the corners see it
        self._middle, slant = proof.points(self._column, self._line)
        self._corners = []
        slants = [slant]
        for x, y in product((-0.5, 0.5), repeat=2):
            corner, slant = proof.points(self._column + x, self._line + y)
            self._corners.append(corner)
            slants.append(slant)
        self._warp = np.max(slants, axis=0) / np.min(slants, axis=0) - 1

        # the centre's reference coordinates were the map linear
        parts = np.einsum("nij,nj->ni", bounds.inverse, self._middle - bounds.centre)
        straight = proof.center(number) + parts
        self.is_outside = self._prove_outside(straight)
        self._locate_centres(np.where(np.isnan(items.start), straight, items.start))
        self._bound_extent()

    def _prove_outside(self, straight: Floats) -> Bools:
        """(n,) whether squares are proved to lie outside; places (n, 3) of their centres by the Jacobian J(c) alone.

        An element with x(r) has |y - (r - c)| <= b |r - c| for y = J(c)^-1 (x - x(c)): where its points can't be.
        """
        steps = self._steps(self._bounds.inverse)
        greatest = np.max([facet_distances(self._facets, straight + step) for step in steps], axis=0)
        slack = steepest(self._facets) * 2 * self._bounds.bend
        return np.asarray(greatest.min(axis=1) + slack < -1e-9)

    def _locate_centres(self, start: Floats) -> None:
        """The centres' reference coordinates, by Newton's method, and the samples there."""
        centre = start
        for _ in range(4):
            found = self._proof.sample(self._number, self._element, centre)
            self._inverse = np.asarray(np.linalg.inv(found.jacobian), np.float64)
            step = np.einsum("nij,nj->ni", self._inverse, self._middle - found.position)
            centre = centre + step
        found = self._proof.sample(self._number, self._element, centre)
        residual = np.einsum("nij,nj->ni", self._inverse, self._middle - found.position)
        self._centre = centre
        self._value = found.value
        self._missed = 2 * np.abs(residual).max(axis=1)

    def _bound_extent(self) -> None:
        """How far squares extend in reference coordinates, for which of them bounds hold, and which lie inside."""
        # half the extent, were the map linear, and what its bend adds
        bend = self._bounds.bend
        steps = self._steps(self._inverse)
        rho = np.abs(steps).max(axis=(0, 2))
        self._turn = self._bounds.turn / (1 - bend)
        growth = self._turn * rho
        self._rho = rho * (1 + growth)
        curved = self._turn * self._rho**2

        is_good = (growth < 0.1) & (bend < 0.9) & (self._warp < 0.1) & (self._missed < 1e-9)
        is_good &= self._proof.reaches(self._number, self._centre + steps, curved)
        is_good &= np.isfinite(self._bounds.gradient) & np.isfinite(self._bounds.curvature)
        self._is_good = is_good & np.isfinite(self._value)

        # a square lies inside where its corners do, by more than its sides bulge
        margins = [facet_distances(self._facets, self._centre + step).min(axis=1) for step in steps]
        self._bulge = steepest(self._facets) * self._turn * self._rho**2 + 1e-9
        self.is_inside = self._is_good & (np.min(margins, axis=0) > self._bulge)

    def _steps(self, inverse: Floats) -> Floats:
        """(4, n, 3) reference coordinates of the corners less those of the middle, by inverse Jacobians (n, 3, 3)."""
        return np.stack([np.einsum("nij,nj->ni", inverse, corner - self._middle) for corner in self._corners])

    def _curvature(self, some: Ints) -> Floats:
        """(n,) M + G m of some squares, see the head of this module."""
        bounds = self._bounds
        return np.asarray(bounds.curvature[some] + bounds.gradient[some] * self._turn[some])

    def decide(self, levels: Floats) -> Bools:
        """(n,) squares in each of which every level is proved to be taken, or proved not to be."""
        # what the gradient alone decides
        noise = self._bounds.noise
        with np.errstate(invalid="ignore"):
            spread = self._bounds.gradient * (self._rho + self._missed) + noise
        is_near = _any_between(levels, self._value - spread, self._value + spread)
        is_decided = self._is_good & ~is_near
        self.taken = np.zeros(len(spread), bool)

        # finer and finer lattices for the rest
        for cells in _CELLS:
            left = np.flatnonzero(self._is_good & ~is_decided)
            for part in chunks(len(left), max(1, AT_ONCE // (cells + 1) ** 2)):
                some = left[part]
                is_decided[some] = self._decide_by_lattice(cells, some, levels)
        return np.asarray(is_decided)

    def _decide_by_lattice(self, cells: int, some: Ints, levels: Floats) -> Bools:
        """The same of some squares, by a lattice of n cells a side."""
        values, places, noise = self._lattice(cells, some)
        low = values.min(axis=(1, 2))
        high = values.max(axis=(1, 2))

        # what the field may go beyond its values at the corners (see the head of this module), on a plane seen aslant
        rho = self._rho[some]
        warp = self._warp[some]
        rest = self._curvature(some) * rho**2 + warp * self._bounds.gradient[some] * rho
        rest = rest * (1 + 3 * warp) ** 2 * 1.1 / cells**2

        # of a square that is not all inside, only what the element certainly has there counts as taken
        is_inside = self.is_inside[some]
        certain_low, certain_high = self._certain_range(some, values, places)
        taken_low = np.where(is_inside, low + noise, certain_low + noise)
        taken_high = np.where(is_inside, high - noise, certain_high - noise)
        is_empty = ~(taken_low < taken_high)
        taken_low = np.where(is_empty, high, taken_low)
        taken_high = np.where(is_empty, high, taken_high)
        self.taken[some] |= ~is_empty & _any_between(levels, taken_low, taken_high)

        # a level is in doubt between what is taken and what may be
        may_be_low = _any_between(levels, low - rest - noise, taken_low)
        may_be_high = _any_between(levels, taken_high, high + rest + noise)
        is_known = np.isfinite(low) & np.isfinite(high)
        return np.asarray(is_known & ~(may_be_low | may_be_high))

    def _lattice(self, cells: int, some: Ints) -> tuple[Floats, Floats, Floats]:
        """Values (n, s + 1, s + 1) and places (…, 3) of the lattices, and bounds (n,) of how far values may be off."""
        count = len(some)
        steps = np.arange(cells + 1) / cells - 0.5
        x = np.tile(steps, cells + 1)
        y = np.repeat(steps, cells + 1)
        columns = (self._column[some, None] + x).reshape(-1)
        lines = (self._line[some, None] + y).reshape(-1)
        target, _ = self._proof.points(columns, lines)
        away = target.reshape(count, -1, 3) - self._middle[some, None]
        places = self._centre[some, None] + np.einsum("nij,nkj->nki", self._inverse[some], away)

        # a Newton step from there, which is left out of the place but not of the value
        elements = np.repeat(self._element[some], len(x))
        found = self._proof.sample(self._number, elements, places.reshape(-1, 3))
        gap = target - found.position
        step = np.linalg.solve(found.jacobian, gap[..., None])[..., 0]
        values = found.value + np.einsum("ni,ni->n", found.gradient, step)
        length = np.abs(step).max(axis=1).reshape(count, -1).max(axis=1)
        noise = self._bounds.noise[some] + self._curvature(some) * length**2
        shape = (count, cells + 1, cells + 1)
        return values.reshape(shape), places.reshape(*shape, 3), noise

    def _certain_range(self, some: Ints, values: Floats, places: Floats) -> tuple[Floats, Floats]:
        """Least and greatest value (n,) at corners in the element that hang together in it; infinite where none do."""
        inside = facet_distances(self._facets, places).min(axis=3) > self._bulge[some, None, None]

        # one run in every row at most, rows one after another that share a column, and one run of rows
        has_one_run = _has_one_run(inside).all(axis=1)
        rows = inside.any(axis=2)
        shares_column = (inside[:, 1:] & inside[:, :-1]).any(axis=2)
        is_pair = rows[:, 1:] & rows[:, :-1]
        is_joined = (shares_column | ~is_pair).all(axis=1)
        is_whole = has_one_run & is_joined & _has_one_run(rows)

        inside &= is_whole[:, None, None]
        low = np.where(inside, values, np.inf).min(axis=(1, 2))
        high = np.where(inside, values, -np.inf).max(axis=(1, 2))
        return low, high


def _has_one_run(mask: Bools) -> Bools:
    """(...,) whether a mask (..., k) is true in one run at most: where it begins and ends, its value changes."""
    return np.asarray(np.diff(mask, axis=-1, prepend=False).sum(axis=-1) <= 2)


def facet_distances(facets: Floats, places: Floats) -> Floats:
    """(..., k) signed distances of places (..., 3) to facets (k, 4)."""
    return np.asarray(places @ facets[:, :3].T + facets[:, 3])


def steepest(facets: Floats) -> float:
    """By how much a distance to a facet changes at most where no coordinate changes by more than 1."""
    return float(np.abs(facets[:, :3]).sum(axis=1).max())


def _any_between(levels: Floats, low: Floats, high: Floats) -> Bools:
    """(n,) whether one of the ascending levels lies in [low, high]."""
    return np.asarray(np.searchsorted(levels, low) < np.searchsorted(levels, high, "right"))
