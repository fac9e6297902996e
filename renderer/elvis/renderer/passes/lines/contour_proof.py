"""What is proved of the contours in each pixel's square: that a value is taken there, or that it is not.

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
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.shapes import Shape
from elvis.plugins.native.bending import changes, derivative_sums, derived, net_of_xi
from elvis.plugins.volume_checks import Samples
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.element_samples import sample_elements
from elvis.renderer.gaps import beside, pairs
from elvis.renderer.hit_buffer import HitBuffer
from elvis.renderer.pixels import NOBODY
from elvis.scene.frame import Status
from elvis.scene.view import View

if TYPE_CHECKING:
    from elvis.renderer.passes.lines.lines import Lines

#: cells of a square's side, one after the other
_CELLS = (1, 4, 16)
#: numbers sampled at once, squares looked at and elements whose derivatives are bounded at once
_AT_ONCE = 1 << 18
_SQUARES = _AT_ONCE // 16
_ELEMENTS = 64
#: how many times as large as a shape its neighbourhood is in which derivatives are bounded
_BEYOND = {Shape.HEXAHEDRON: 1.25, Shape.PRISM: 1.5, Shape.TETRAHEDRON: 1.5}
#: part of a field's greatest value that rounding may change
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class _Derivatives:
    """Bounds for each of n elements, on a shape that is _BEYOND times as large.

    bend, turn           b and m of the map (see elvis.plugins.native.bending)
    gradient, curvature  G and M of the field
    size                 greatest absolute value
    centre               (n, 3) world position of the centre
    inverse              (n, 3, 3) inverse of the Jacobian there
    """

    bend: Floats
    turn: Floats
    gradient: Floats
    curvature: Floats
    size: Floats
    centre: Floats
    inverse: Floats

    def part(self, chosen: Ints) -> _Derivatives:
        return _Derivatives(*(array[chosen] for array in vars(self).values()))

    @staticmethod
    def concatenate(several: list[_Derivatives]) -> _Derivatives:
        arrays = zip(*(vars(some).values() for some in several), strict=True)
        return _Derivatives(*(np.concatenate(parts) for parts in arrays))


@dataclass(frozen=True, eq=False)
class _Items:
    """Squares of pixels (n,), each with an element (index) and reference coordinates near its centre.

    start  (n, 3), NaN where none are known
    """

    pixel: Ints
    element: Ints
    start: Floats

    def part(self, chosen: Ints | Bools | slice) -> _Items:
        return _Items(self.pixel[chosen], self.element[chosen], self.start[chosen])


class ContourProof:
    """The proofs of one hit buffer's contours.

    status  (n,) of frame.Status by pixel: CERTAIN where every level is proved to be taken in the square or not to be,
            else AMBIGUOUS; MISS where nothing is hit
    taken   (n,) whether one of the levels is proved to be taken there
    """

    def __init__(
        self,
        loaded: DeviceVolume,
        lines: Lines,
        view: View,
        hits: HitBuffer,
        levels: Floats,
        quantity: str | None = None,
    ) -> None:
        self._loaded = loaded
        self._lines = lines
        self._view = view
        self._hits = hits
        self._levels = levels
        self._quantity = quantity
        self._centers: dict[int, Floats] = {}
        is_hit = hits.owner != NOBODY
        self.taken = np.zeros(view.count, bool)
        self.status = np.where(is_hit, np.uint8(Status.CERTAIN), np.uint8(Status.MISS))

        # by element, whether it may have one of the values
        low, high = loaded.every(quantity)[0].astype(np.float64).T
        self._holds = ~(np.searchsorted(levels, low) >= np.searchsorted(levels, high, "right"))
        self._holds |= np.isnan(low) | np.isnan(high)
        self._decide()
        self.status[~is_hit] = Status.MISS

    def _decide(self) -> None:
        """Set the statuses of all pixels in whose squares an element that may have one of the values may be."""
        hits = self._hits
        shape = (self._view.height, self._view.width)
        is_hit = hits.owner != NOBODY
        if hits.sections is None or hits.flat is None:
            owner = np.minimum(hits.owner, len(self._holds))
            holds = np.append(self._holds, False)[owner]
            near = beside(holds.reshape(shape)).reshape(-1)
            self.status[near & is_hit] = Status.AMBIGUOUS
            return

        # the owners of pixels first, then the other elements in squares that these don't fill
        pixel = np.flatnonzero(is_hit)
        owners = _Items(pixel, hits.owner[pixel].astype(np.int64), hits.reference[pixel])
        is_alone = self._decide_items(owners)
        is_shared = np.zeros(self._view.count, bool)
        is_shared[pixel[~is_alone]] = True
        self._decide_items(self._others(is_shared.reshape(shape)))

    def _others(self, mask: Bools) -> _Items:
        """The elements, other than the own ones, that may be in the squares of the pixels of a mask (h, w)."""
        assert self._hits.sections is not None
        holds = self._holds[self._hits.sections["element"]]
        sections = self._hits.sections[holds].copy()

        # squares reach half a pixel beyond the centres that sections bound
        sections["least"] -= 1
        sections["most"] += 1
        last = [self._view.width - 1, self._view.height - 1]
        sections["least"][:, :2] = np.maximum(sections["least"][:, :2], 0)
        sections["most"][:, :2] = np.minimum(sections["most"][:, :2], last)

        pixel, element = pairs(sections, mask)
        is_other = self._hits.owner[pixel] != element
        pixel = pixel[is_other]
        element = element[is_other].astype(np.int64)
        return _Items(pixel, element, np.full((len(pixel), 3), np.nan))

    def _decide_items(self, items: _Items) -> Bools:
        """Statuses of the pixels of some items; (n,) whether each square lies in its element all over."""
        is_alone = np.zeros(len(items.pixel), bool)
        number = np.searchsorted(self._loaded.first, items.element, side="right") - 1
        for part in np.unique(number).tolist():
            rows = np.flatnonzero(number == part)
            if not self._is_known(part):
                holds = self._holds[items.element[rows]]
                self.status[items.pixel[rows[holds]]] = Status.AMBIGUOUS
                continue

            elements = np.unique(items.element[rows])
            bounds = self._bounds(part, elements)
            for some in chunks(len(rows), _SQUARES):
                chosen = items.part(rows[some])
                own_bounds = bounds.part(np.searchsorted(elements, chosen.element))
                squares = _Squares(self, part, chosen, own_bounds)
                is_alone[rows[some]] = squares.is_inside
                self._decide_squares(squares, chosen)
        return is_alone

    def _decide_squares(self, squares: _Squares, items: _Items) -> None:
        """Statuses of the pixels of some items with their squares."""
        is_due = self._holds[items.element] & ~squares.is_outside
        is_decided = squares.decide(self._levels)
        self.taken[items.pixel[is_due & squares.taken]] = True
        self.status[items.pixel[is_due & ~is_decided]] = Status.AMBIGUOUS

    def _is_known(self, number: int) -> bool:
        """Whether map and field of a part are polynomials in its reference coordinates, from -1 to 1."""
        part = self._loaded.parts[number]
        degree = self._loaded.quantity(number, self._quantity).degree
        return degree > 0 and not part.collapsed and not part.unit

    def _bounds(self, number: int, elements: Ints) -> _Derivatives:
        """The derivatives of some elements of a part."""
        space = self._space(number)
        nodes, fit = _nodes(space)
        local = nodes - self.center(number)
        found = []
        for some in chunks(len(elements), _ELEMENTS):
            own = elements[some] - self._loaded.first[number]
            count = len(own)
            every_element = np.repeat(own, len(nodes))
            every_node = np.tile(local, (count, 1))
            samples = sample_elements(self._loaded, number, every_element, every_node, self._quantity)
            middle = sample_elements(self._loaded, number, own, np.zeros((count, 3)), self._quantity)

            # Bernstein nets of the field, and of the map less its value at the centre
            values = samples.value.reshape(count, -1) @ fit
            away = samples.position.reshape(count, -1, 3) - middle.position[:, None]
            places = np.einsum("nki,km->nim", away, fit)
            found.append(_derivatives(space, places, middle, values))
        return _Derivatives.concatenate(found)

    def _space(self, number: int) -> BernsteinSpace:
        """The polynomials of a part's map and field: on the cube, where they are not on the shape itself."""
        part = self._loaded.parts[number]
        degree = self._loaded.quantity(number, self._quantity).degree
        facets = np.zeros((0, 4)) if part.affine else self._lines.facets(number)
        for shape, degrees in ((Shape.TETRAHEDRON, (degree,)), (Shape.PRISM, (degree, degree))):
            margins = _margins(facets, shape.vertices)
            if len(facets) == len(shape.faces) and np.abs(margins.min(axis=1)).max() < 1e-9:
                return BernsteinSpace(shape, degrees)
        return BernsteinSpace(Shape.HEXAHEDRON, (degree,) * 3)

    def reaches(self, number: int, places: Floats, slack: Floats) -> Bools:
        """(n,) whether derivatives are bounded within ``slack`` (n,) of all k reference points (k, n, 3)."""
        space = self._space(number)
        if space.shape is Shape.HEXAHEDRON:
            return np.asarray(np.abs(places).max(axis=(0, 2)) + slack < _BEYOND[space.shape])
        # in the shape, drawn together around its centre as much as its neighbourhood is larger
        facets = self.facets(number)
        centre = space.shape.vertices.mean(axis=0)
        drawn_together = centre + (places - centre) / _BEYOND[space.shape]
        margins = _margins(facets, drawn_together)
        return np.asarray(margins.min(axis=(0, 2)) > _steepest(facets) * slack)

    def center(self, number: int) -> Floats:
        """(3,) the centre of a part's type, from which places are counted."""
        if number not in self._centers:
            one = sample_elements(self._loaded, number, np.zeros(1, np.int64), np.zeros((1, 3)), self._quantity)
            self._centers[number] = one.center[0]
        return self._centers[number]

    def sample(self, number: int, elements: Ints, places: Floats) -> Samples:
        """What elements (n,) of a part, by index, have at reference points (n, 3)."""
        own = elements - self._loaded.first[number]
        local = places - self.center(number)
        return sample_elements(self._loaded, number, own, local, self._quantity)

    def facets(self, number: int) -> Floats:
        """(k, 4) facets of a part's shape that are not parallel to the plane z = 0 of 2D data."""
        facets = self._lines.facets(number)
        if self._loaded.dimension != 2:
            return facets
        is_upright = np.abs(facets[:, :2]).max(axis=1) > 0.0
        return facets[is_upright]

    def points(self, columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
        """(n, 3) places of the plane under points of the picture, and how much nearer they make the plane seem."""
        assert self._hits.flat is not None
        origins, directions = self._view.rays(columns, rows)
        normal = self._hits.flat
        slant = directions @ normal
        depth = (self._hits.offset - origins @ normal) / slant
        return origins + depth[:, None] * directions, np.abs(slant)


class _Squares:
    """Squares of pixels in elements: their extent, whether they lie inside, and which decisions are proved.

    is_outside, is_inside  (n,) whether no, or every, point of the square is proved to be in the element
    taken                  (n,) after `decide`: whether a level is proved to be taken
    """

    def __init__(self, proof: ContourProof, number: int, items: _Items, bounds: _Derivatives) -> None:
        self._proof = proof
        self._number = number
        self._element = items.element
        self._bounds = bounds
        self._facets = proof.facets(number)
        width = proof._view.width
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
        greatest = np.max([_margins(self._facets, straight + step) for step in steps], axis=0)
        slack = _steepest(self._facets) * 2 * self._bounds.bend
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
        self._is_good = is_good & np.isfinite(self._value)

        # a square lies inside where its corners do, by more than its sides bulge
        margins = [_margins(self._facets, self._centre + step).min(axis=1) for step in steps]
        self._bulge = _steepest(self._facets) * self._turn * self._rho**2 + 1e-9
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
        noise = _ROUNDING * self._bounds.size
        spread = self._bounds.gradient * (self._rho + self._missed) + noise
        is_near = _any_between(levels, self._value - spread, self._value + spread)
        is_decided = self._is_good & ~is_near
        self.taken = np.zeros(len(spread), bool)

        # finer and finer lattices for the rest
        for cells in _CELLS:
            left = np.flatnonzero(self._is_good & ~is_decided)
            for part in chunks(len(left), max(1, _AT_ONCE // (cells + 1) ** 2)):
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
        return np.asarray(~(may_be_low | may_be_high))

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
        noise = _ROUNDING * self._bounds.size[some] + self._curvature(some) * length**2
        shape = (count, cells + 1, cells + 1)
        return values.reshape(shape), places.reshape(*shape, 3), noise

    def _certain_range(self, some: Ints, values: Floats, places: Floats) -> tuple[Floats, Floats]:
        """Least and greatest value (n,) at corners in the element that hang together in it; infinite where none do."""
        inside = _margins(self._facets, places).min(axis=3) > self._bulge[some, None, None]

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


def _margins(facets: Floats, places: Floats) -> Floats:
    """(..., k) signed distances of places (..., 3) to facets (k, 4)."""
    return np.asarray(places @ facets[:, :3].T + facets[:, 3])


def _steepest(facets: Floats) -> float:
    """By how much a distance to a facet changes at most where no coordinate changes by more than 1."""
    return float(np.abs(facets[:, :3]).sum(axis=1).max())


def _any_between(levels: Floats, low: Floats, high: Floats) -> Bools:
    """(n,) whether one of the ascending levels lies in [low, high]."""
    return np.asarray(np.searchsorted(levels, low) < np.searchsorted(levels, high, "right"))


def _derivatives(space: BernsteinSpace, places: Floats, middle: Samples, values: Floats) -> _Derivatives:
    """Bounds from nets of places less the centre (n, 3, count) and of values (n, count), and samples at the centres."""
    inverse = np.swapaxes(duals(middle.jacobian), 1, 2)
    beyond = _BEYOND[space.shape]
    bend, turn = changes(space, inverse @ places, beyond)
    gradient, curvature = derivative_sums(space, values, beyond)
    size = np.abs(derived(space, values, (), beyond)).max(axis=1)
    return _Derivatives(bend, turn, gradient.max(axis=1), curvature.max(axis=1), size, middle.position, inverse)


@lru_cache(maxsize=16)
def _nodes(space: BernsteinSpace) -> tuple[Floats, Floats]:
    """(count, 3) points of a shape, and the matrix (count, count) from values there to Bernstein coefficients."""
    nodes = net_of_xi(space)
    if space.shape is not Shape.HEXAHEDRON:
        return nodes, frozen_floats(np.linalg.inv(bernstein_values(space, nodes)).T)
    lines = []
    for degree in space.degrees[::-1]:
        line = BernsteinSpace(Shape.SEGMENT, (degree,))
        lines.append(np.linalg.inv(bernstein_values(line, net_of_xi(line))))
    return nodes, frozen_floats(np.kron(np.kron(lines[0], lines[1]), lines[2]).T)
