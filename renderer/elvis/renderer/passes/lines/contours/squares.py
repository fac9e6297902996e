"""Squares of pixels on a plane cut, in the elements there: values that are taken in each, and values that are not.

On a plane cut an element's field is u(r(q)) of positions q in the picture, with the inverse map r(q) of the plane.
With bounds of the first and second derivatives of u and of the map (Bernstein coefficients), u differs over a cell of a
lattice from a function that is linear in each direction by at most

    1/8 (|u_xx| + |u_yy|) <= (M + G m) rho^2 / s^2

rho  half the square's extent in reference coordinates, of which s cells make a side
G, M sums of the absolute first and second derivatives of u
m    the same of the map's second derivatives, relative to its Jacobian there

so that values at the lattice's corners decide, except for a band that narrows as s grows.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Protocol

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.mapping.orientation import chunks
from elvis.core.shapes import Shape

#: cells of a square's side, one after the other
_CELLS = (1, 4, 16)
#: numbers sampled at once
AT_ONCE = 1 << 18
#: part of a polynomial's largest value that rounding may change
ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Derivatives(Rows):
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


@dataclass(frozen=True, eq=False)
class Items(Rows):
    """Squares of pixels (n,), each with an element (index) and reference coordinates near its centre.

    start  (n, 3), NaN where none are known
    """

    pixel: Ints
    element: Ints
    start: Floats


class Chart(Protocol):
    """Requirements of squares on a surface in the elements of a part: positions (n, d), in coordinates of d dimensions.

    facets  (k, d + 1) of the shape of elements in these coordinates, see `facet_distances`
    center  (d,) point about which the shape's map is expanded
    """

    facets: Floats
    center: Floats

    def targets(self, columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
        """Positions (n, d) of the surface under points of the picture, and by how much it appears nearer there (n,)."""

    def sample(self, elements: Ints, places: Floats) -> ChartSamples:
        """Samples of elements (n,) at positions (n, d)."""

    def reaches(self, elements: Ints, centre: Floats, steps: Floats, slack: Floats) -> Bools:
        """(n,) whether derivatives are bounded within ``slack`` (n,) of places (n, d) with all steps (k, n, d)."""

    def localised(self, bounds: Derivatives, elements: Ints, centre: Floats) -> Derivatives:
        """Bounds that hold of elements (n,), or in a neighbourhood of places (n, d) in them where these are known."""


class ChartSamples(Protocol):
    """Samples of elements at n positions: images (n, d), Jacobians (n, d, d), values (n,) and gradients (n, d)."""

    @property
    def position(self) -> Floats:
        """(n, d) images."""

    @property
    def jacobian(self) -> Floats:
        """(n, d, d) their derivatives: of image i in column j."""

    @property
    def value(self) -> Floats:
        """(n,) values."""

    @property
    def gradient(self) -> Floats:
        """(n, d) their derivatives."""


class Squares:
    """Squares of pixels in elements: their extent, whether they lie inside, and which decisions are proved.

    is_outside, is_inside  (n,) whether no, or every, point of the square is proved to be in the element
    is_good                (n,) for which the bounds of derivatives hold; second ones may be infinite, at kinks
    is_monotone            (n,) in which values grow along one of the sides: they have one line of a level at most
    at_centre              what the elements have at the centres
    radius                 (n,) how far squares reach from their centres in coordinates of the element
    bulge                  (n,) by how much distances from facets differ from linear ones in the square
    may_be                 (2, n) after `decide`: minimum and maximum value that the element may have in the square
    certain                (2, n) values that are taken there, and all between; infinite and the wrong way round: none
    """

    def __init__(self, chart: Chart, column: Floats, line: Floats, items: Items, bounds: Derivatives) -> None:
        """Squares of pixels (n,) by column and line, each with an element and its bounds."""
        self._chart = chart
        self._element = items.element
        self._bounds = bounds
        self._facets = chart.facets
        self._column = column
        self._line = line

        # places of the surface at the middles and the corners, and how unlike the corners see it
        self._middle, slant = chart.targets(column, line)
        self._corners = []
        slants = [slant]
        for x, y in product((-0.5, 0.5), repeat=2):
            corner, slant = chart.targets(column + x, line + y)
            self._corners.append(corner)
            slants.append(slant)
        self._warp = np.max(slants, axis=0) / np.min(slants, axis=0) - 1

        # the centre's reference coordinates were the map linear
        parts = np.einsum("nij,nj->ni", bounds.inverse, self._middle - bounds.centre)
        straight = chart.center + parts
        self.is_outside = self._prove_outside(straight)
        self._locate_centres(np.where(np.isnan(items.start), straight, items.start))
        self._bounds = chart.localised(bounds, items.element, self._centre)
        self._bound_extent()

    def _prove_outside(self, straight: Floats) -> Bools:
        """Proofs (n,) that squares lie outside; positions (n, 3) of their centres by the Jacobian J(c) only.

        An element with x(r) satisfies |y - (r - c)| <= b |r - c| for y = J(c)^-1 (x - x(c)), which excludes points.
        """
        steps = self._steps(self._bounds.inverse)
        greatest = np.max([facet_distances(self._facets, straight + step) for step in steps], axis=0)
        slack = steepest(self._facets) * 2 * self._bounds.bend
        return np.asarray(greatest.min(axis=1) + slack < -1e-9)

    def _locate_centres(self, start: Floats) -> None:
        """The centres' reference coordinates, by Newton's method, and the samples there."""
        centre = start
        for _ in range(4):
            found = self._chart.sample(self._element, centre)
            self._inverse = np.asarray(np.linalg.inv(regular(found.jacobian)), np.float64)
            step = np.einsum("nij,nj->ni", self._inverse, self._middle - found.position)
            centre = centre + step
        found = self._chart.sample(self._element, centre)
        residual = np.einsum("nij,nj->ni", self._inverse, self._middle - found.position)
        self._centre = centre
        self.at_centre = found
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
        self.radius = self._rho + self._missed

        is_good = (growth < 0.1) & (bend < 0.9) & (self._warp < 0.1) & (self._missed < 1e-9)
        is_good &= self._chart.reaches(self._element, self._centre, steps, curved)
        is_good &= np.isfinite(self._bounds.gradient)
        self.is_good = is_good & np.isfinite(self._value)

        # derivatives along the sides change by less than they are, so that one of them vanishes nowhere
        gradient = self.at_centre.gradient
        across = np.einsum("ni,ni->n", gradient, 0.5 * (steps[2] + steps[3]))
        down = np.einsum("ni,ni->n", gradient, 0.5 * (steps[1] + steps[3]))
        with np.errstate(invalid="ignore"):
            change = 2 * self._curvature(np.arange(len(rho))) * self._rho**2
            change = change + self._warp * self._bounds.gradient * self._rho
        self.is_monotone = self.is_good & (np.maximum(np.abs(across), np.abs(down)) > 1.1 * change)

        # a square lies inside where its corners do, by more than its sides bulge
        margins = [facet_distances(self._facets, self._centre + step).min(axis=1) for step in steps]
        self.bulge = steepest(self._facets) * self._turn * self._rho**2 + 1e-9
        self.is_inside = self.is_good & (np.min(margins, axis=0) > self.bulge)

    def _steps(self, inverse: Floats) -> Floats:
        """Reference coordinates (4, n, 3) of the corners relative to the middle, by inverse Jacobians (n, 3, 3)."""
        return np.stack([np.einsum("nij,nj->ni", inverse, corner - self._middle) for corner in self._corners])

    def _curvature(self, some: Ints) -> Floats:
        """(n,) M + G m of some squares, see the head of this module."""
        bounds = self._bounds
        with np.errstate(invalid="ignore"):
            return np.asarray(bounds.curvature[some] + bounds.gradient[some] * self._turn[some])

    @property
    def margins(self) -> Floats:
        """(n, k, 3): a point (x, y), in targets from the centre, is about a x + b y + c from facets."""
        normals = self._facets[:, :-1]
        along = np.einsum("kj,njd->nkd", normals, self._inverse)
        return np.concatenate([along, facet_distances(self._facets, self._centre)[..., None]], axis=2)

    def decide(self, levels: Floats, walls: Floats | None = None, limits: Floats | None = None) -> None:
        """Enclose the values in each square, closer and closer until no level is in doubt, as far as that goes.

        walls   (n, m, 3): only places (x, y) from the square's centre, in pixels, where a x + b y + c < 0 for all m are
                known to show the element; None: all are
        limits  (2, n) values that the element has nowhere else than between; None where none are known
        """
        # decisions by the gradient
        with np.errstate(invalid="ignore"):
            spread = self._bounds.gradient * (self._rho + self._missed) + self._bounds.noise
            self.may_be = np.stack([self._value - spread, self._value + spread])
        endless = np.array([[-np.inf], [np.inf]])
        self.may_be = np.where(self.is_good, self.may_be, endless)
        if limits is not None:
            self.may_be[0] = np.maximum(self.may_be[0], limits[0])
            self.may_be[1] = np.minimum(self.may_be[1], limits[1])
        self.certain = np.repeat([[np.inf], [-np.inf]], len(spread), axis=1)

        # finer and finer lattices for the rest
        for cells in _CELLS:
            left = np.flatnonzero(self.is_good & self.in_doubt(levels))
            for part in chunks(len(left), max(1, AT_ONCE // (cells + 1) ** 2)):
                self._refine(cells, left[part], walls)

    def in_doubt(self, levels: Floats) -> Bools:
        """(n,) squares in which a level may be taken, but is not proved to be."""
        below, above = self.doubtful
        return np.asarray(any_between(levels, *below) | any_between(levels, *above))

    @property
    def doubtful(self) -> tuple[Floats, Floats]:
        """Two ranges (2, n) of values that may be taken, below and above the certain ones."""
        is_empty = ~(self.certain[0] < self.certain[1])
        first, last = np.where(is_empty, self.may_be[1], self.certain)
        return np.stack([self.may_be[0], first]), np.stack([last, self.may_be[1]])

    def takes(self, levels: Floats) -> Bools:
        """(n,) squares in which a level is proved to be taken."""
        is_any = self.certain[0] < self.certain[1]
        return np.asarray(is_any & any_between(levels, *self.certain))

    def _refine(self, cells: int, some: Ints, walls: Floats | None) -> None:
        """Closer ranges for some squares, by a lattice of n cells a side."""
        values, places, noise = self._lattice(cells, some)
        margins = facet_distances(self._facets, places)
        bulge = self.bulge[some]

        # what the field may go beyond its values at the corners (see the head of this module), on a surface seen aslant
        rho = self._rho[some]
        warp = self._warp[some]
        rest = self._curvature(some) * rho**2 + warp * self._bounds.gradient[some] * rho
        rest = rest * (1 + 3 * warp) ** 2 * 1.1 / cells**2 + noise

        # corners of cells that are not all on the outer side of a facet
        may_hold = _beside_element(margins > -bulge[:, None, None, None])
        low = np.where(may_hold, values, np.inf).min(axis=(1, 2)) - rest
        high = np.where(may_hold, values, -np.inf).max(axis=(1, 2)) + rest
        is_known = np.isfinite(values).all(axis=(1, 2)) & np.isfinite(rest)
        self.may_be[0, some[is_known]] = np.maximum(self.may_be[0, some], low)[is_known]
        self.may_be[1, some[is_known]] = np.minimum(self.may_be[1, some], high)[is_known]

        # of a square that is not all inside, only what the element certainly has there counts as taken
        is_seen = (margins.min(axis=3) > bulge[:, None, None]) | self.is_inside[some][:, None, None]
        if walls is not None:
            is_seen &= _is_before(walls[some], cells)
        certain_low, certain_high = _certain_range(is_seen, values)
        own = np.stack([certain_low + noise, certain_high - noise])
        is_wider = is_known & (own[1] - own[0] > self.certain[1, some] - self.certain[0, some])
        self.certain[:, some[is_wider]] = own[:, is_wider]

    def _lattice(self, cells: int, some: Ints) -> tuple[Floats, Floats, Floats]:
        """Values (n, s + 1, s + 1) and places (…, 3) of the lattices, and bounds (n,) of how far values may be off."""
        count = len(some)
        steps = np.arange(cells + 1) / cells - 0.5
        x = np.tile(steps, cells + 1)
        y = np.repeat(steps, cells + 1)
        columns = (self._column[some, None] + x).reshape(-1)
        lines = (self._line[some, None] + y).reshape(-1)
        target, _ = self._chart.targets(columns, lines)
        away = target.reshape(count, len(x), -1) - self._middle[some, None]
        places = self._centre[some, None] + np.einsum("nij,nkj->nki", self._inverse[some], away)

        # a Newton step from there, applied to the value but not to the position
        elements = np.repeat(self._element[some], len(x))
        found = self._chart.sample(elements, places.reshape(-1, places.shape[-1]))
        gap = target - found.position
        step = np.linalg.solve(regular(found.jacobian), gap[..., None])[..., 0]
        values = found.value + np.einsum("ni,ni->n", found.gradient, step)
        length = np.abs(step).max(axis=1).reshape(count, -1).max(axis=1)
        with np.errstate(invalid="ignore"):
            noise = self._bounds.noise[some] + self._curvature(some) * length**2
        shape = (count, cells + 1, cells + 1)
        return values.reshape(shape), places.reshape(*shape, -1), noise


def regular(jacobians: Floats) -> Floats:
    """Jacobians (n, d, d) in which singular ones are NaN, so that nothing is proved by them."""
    is_regular = np.abs(np.linalg.det(jacobians)) > 0.0
    return np.where(is_regular[:, None, None], jacobians, np.nan)


def _certain_range(inside: Bools, values: Floats) -> tuple[Floats, Floats]:
    """Minimum and maximum value (n,) at connected corners of a mask (n, s, s); infinite if there are none."""
    # one run in every row at most, rows one after another that share a column, and one run of rows
    has_one_run = _has_one_run(inside).all(axis=1)
    rows = np.asarray(inside.any(axis=2))
    shares_column = (inside[:, 1:] & inside[:, :-1]).any(axis=2)
    is_pair = rows[:, 1:] & rows[:, :-1]
    is_joined = (shares_column | ~is_pair).all(axis=1)
    is_whole = has_one_run & is_joined & _has_one_run(rows)

    chosen = inside & is_whole[:, None, None]
    low = np.where(chosen, values, np.inf).min(axis=(1, 2))
    high = np.where(chosen, values, -np.inf).max(axis=(1, 2))
    return low, high


def _beside_element(within: Bools) -> Bools:
    """(n, s, s) corners of cells that may hold points of an element, by whether corners are within its k facets

    (n, s, s, k): a cell all of whose corners are on the outer side of one facet holds none.
    """
    cells = within[:, 1:, 1:] | within[:, 1:, :-1] | within[:, :-1, 1:] | within[:, :-1, :-1]
    held = np.pad(cells.all(axis=3), ((0, 0), (1, 1), (1, 1)))
    return np.asarray(held[:, 1:, 1:] | held[:, 1:, :-1] | held[:, :-1, 1:] | held[:, :-1, :-1])


def _is_before(walls: Floats, cells: int) -> Bools:
    """(n, s, s) corners of lattices that are before all walls (n, m, 3), see `Squares.decide`."""
    steps = np.arange(cells + 1) / cells - 0.5
    a, b, c = np.moveaxis(walls, 2, 0)[..., None, None]
    before = a * steps + b * steps[:, None] + c < 0.0
    return np.asarray(before.all(axis=1))


def _has_one_run(mask: Bools) -> Bools:
    """(...,) whether a mask (..., k) is true in one run at most: where it begins and ends, its value changes."""
    return np.asarray(np.diff(mask, axis=-1, prepend=False).sum(axis=-1) <= 2)


def is_nearby(shape: Shape, facets: Floats, beyond: Floats | float, places: Floats, slack: Floats) -> Bools:
    """Flags (n,) whether k points (k, n, d), and points within ``slack`` (n,), are in a shape's neighbourhood.

    facets  of the shape
    beyond  size of the neighbourhoods relative to the shape, one or (n,)
    """
    if shape in (Shape.HEXAHEDRON, Shape.QUADRILATERAL):
        return np.asarray(np.abs(places).max(axis=(0, 2)) + slack < beyond)
    # in the shape, drawn together around its centre as much as its neighbourhood is larger
    centre = shape.centre
    drawn_together = centre + (places - centre) / np.reshape(beyond, (-1, 1))
    margins = facet_distances(facets, drawn_together)
    return np.asarray(margins.min(axis=(0, 2)) > steepest(facets) * slack)


def facet_distances(facets: Floats, places: Floats) -> Floats:
    """(..., k) signed distances of places (..., d) to facets (k, d + 1)."""
    return np.asarray(places @ facets[:, :-1].T + facets[:, -1])


def steepest(facets: Floats) -> float:
    """Maximum change of a distance to a facet if no coordinate changes by more than 1."""
    return float(np.abs(facets[:, :-1]).sum(axis=1).max())


def any_between(levels: Floats, low: Floats, high: Floats) -> Bools:
    """(n,) whether one of the ascending levels lies in [low, high]."""
    return np.asarray(np.searchsorted(levels, low) < np.searchsorted(levels, high, "right"))
