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
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.shapes import Shape
from elvis.plugins.native.bending import changes, derived, net_of_xi
from elvis.plugins.volume_checks import Samples
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.element_samples import sample_elements
from elvis.renderer.gaps import pairs
from elvis.renderer.hit_buffer import HitBuffer
from elvis.renderer.pixels import NOBODY
from elvis.scene.frame import Status
from elvis.scene.view import View

if TYPE_CHECKING:
    from elvis.renderer.passes.lines.lines import Lines

#: cells of a square's side, one after the other
_CELLS = (1, 4, 16)
#: numbers sampled at once, and elements whose derivatives are bounded at once
_AT_ONCE, _CHUNK = 1 << 18, 64
#: how many times as large as a shape its neighbourhood is in which derivatives are bounded
_BEYOND = {Shape.HEXAHEDRON: 1.25, Shape.PRISM: 1.5, Shape.TETRAHEDRON: 1.5}
#: part of a field's greatest value that rounding may change
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class _Derivatives:
    """Bounds for each of n elements, on a shape that is _BEYOND times as large.

    bend, turn   b and m of the map (see elvis.plugins.native.bending)
    rise, curve  G and M of the field
    size         greatest absolute value
    centre       (n, 3) world position of the centre
    inverse      (n, 3, 3) inverse of the Jacobian there
    """

    bend: Floats
    turn: Floats
    rise: Floats
    curve: Floats
    size: Floats
    centre: Floats
    inverse: Floats


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
        self._loaded, self._lines, self._view, self._hits = loaded, lines, view, hits
        self._levels, self._quantity = levels, quantity
        self._centers: dict[int, Floats] = {}
        self.taken = np.zeros(view.count, bool)
        hit = hits.owner != NOBODY
        self.status = np.where(hit, np.uint8(Status.CERTAIN), np.uint8(Status.MISS))
        ends = loaded.every(quantity)[0].astype(np.float64)
        self._holds = ~(np.searchsorted(levels, ends[:, 0]) >= np.searchsorted(levels, ends[:, 1], "right"))
        self._holds |= np.isnan(ends).any(axis=1)
        self._held = np.append(self._holds, False)[np.minimum(hits.owner, len(ends))].reshape(view.height, view.width)
        self._decide()
        self.status[~hit] = Status.MISS

    def _decide(self) -> None:
        """Set the statuses of all pixels in whose squares an element that may have one of the values may be."""
        hits, view = self._hits, self._view
        near = _grow(self._held).reshape(-1) & (hits.owner != NOBODY)
        if hits.sections is None or hits.flat is None:
            self.status[near] = Status.AMBIGUOUS
            return
        every = np.flatnonzero(hits.owner != NOBODY)
        alone = self._decide_items(_Items(every, hits.owner[every].astype(np.int64), hits.reference[every]))
        shared = np.zeros(view.count, bool)
        shared[every[~alone]] = True
        self._decide_items(self._others(shared.reshape(view.height, view.width)))

    def _others(self, mask: Bools) -> _Items:
        """The elements, other than the own ones, that may be in the squares of the pixels of a mask (h, w)."""
        view = self._view
        assert self._hits.sections is not None
        sections = self._hits.sections[self._holds[self._hits.sections["element"]]].copy()
        sections["least"], sections["most"] = sections["least"] - 1, sections["most"] + 1
        sections["least"][:, :2] = np.maximum(sections["least"][:, :2], 0)
        sections["most"][:, :2] = np.minimum(sections["most"][:, :2], [view.width - 1, view.height - 1])
        pixel, element = pairs(sections, mask)
        others = self._hits.owner[pixel] != element
        pixel, element = pixel[others], element[others].astype(np.int64)
        return _Items(pixel, element, np.full((len(pixel), 3), np.nan))

    def _decide_items(self, items: _Items) -> Bools:
        """Statuses of the pixels of some items; (n,) whether each square lies in its element all over."""
        alone = np.zeros(len(items.pixel), bool)
        number = np.searchsorted(self._loaded.first, items.element, side="right") - 1
        for part in np.unique(number):
            rows = np.flatnonzero(number == part)
            elements = np.unique(items.element[rows])
            bounds = self._bounds(int(part), elements) if self._is_known(int(part)) else None
            for first in range(0, len(rows), _AT_ONCE // 16):
                some = rows[first : first + _AT_ONCE // 16]
                held = self._holds[items.element[some]]
                if bounds is None:
                    self.status[items.pixel[some[held]]] = Status.AMBIGUOUS
                    continue
                chosen = items.part(some)
                squares = _Squares(self, int(part), chosen, bounds, np.searchsorted(elements, chosen.element))
                alone[some] = squares.inside
                doubt = held & ~squares.outside
                doubt[doubt] = ~squares.decide(self._levels)[doubt]
                self.taken[chosen.pixel[held & ~squares.outside & squares.taken]] = True
                self.status[chosen.pixel[doubt]] = Status.AMBIGUOUS
        return alone

    def _is_known(self, number: int) -> bool:
        """Whether map and field of a part are polynomials in its reference coordinates, from -1 to 1."""
        part = self._loaded.parts[number]
        degree = self._loaded.quantity(number, self._quantity).degree
        return degree > 0 and not part.collapsed and not part.unit

    def _bounds(self, number: int, elements: Ints) -> _Derivatives:
        """The derivatives of some elements of a part."""
        space, quantity = self._space(number), self._quantity
        nodes, fit = _nodes(space)
        own, found = elements - self._loaded.first[number], []
        for first in range(0, len(own), _CHUNK):
            some = own[first : first + _CHUNK]
            center = self.center(number)
            asked = np.repeat(some, len(nodes)), np.tile(nodes - center, (len(some), 1))
            samples = sample_elements(self._loaded, number, *asked, quantity)
            middle = sample_elements(self._loaded, number, some, np.zeros((len(some), 3)), quantity)
            values = samples.value.reshape(len(some), -1) @ fit
            away = samples.position.reshape(len(some), -1, 3) - middle.position[:, None]
            found.append(_derivatives(space, np.einsum("nki,km->nim", away, fit), middle, values))
        return _Derivatives(*(np.concatenate([getattr(some, name) for some in found]) for name in vars(found[0])))

    def _space(self, number: int) -> BernsteinSpace:
        """The polynomials of a part's map and field: on the cube, where they are not on the shape itself."""
        part = self._loaded.parts[number]
        degree = self._loaded.quantity(number, self._quantity).degree
        facets = np.zeros((0, 4)) if part.affine else self._lines.facets(number)
        for shape, degrees in ((Shape.TETRAHEDRON, (degree,)), (Shape.PRISM, (degree, degree))):
            margins = shape.vertices @ facets[:, :3].T + facets[:, 3]
            if len(facets) == len(shape.faces) and np.abs(margins.min(axis=1)).max() < 1e-9:
                return BernsteinSpace(shape, degrees)
        return BernsteinSpace(Shape.HEXAHEDRON, (degree,) * 3)

    def reaches(self, number: int, places: Floats, slack: Floats) -> Bools:
        """(n,) whether derivatives are bounded within ``slack`` (n,) of all k reference points (k, n, 3)."""
        space = self._space(number)
        if space.shape is Shape.HEXAHEDRON:
            return np.asarray(np.abs(places).max(axis=(0, 2)) + slack < _BEYOND[space.shape])
        facets, centre = self.facets(number), space.shape.vertices.mean(axis=0)
        margins = (centre + (places - centre) / _BEYOND[space.shape]) @ facets[:, :3].T + facets[:, 3]
        return np.asarray(margins.min(axis=(0, 2)) > np.abs(facets[:, :3]).sum(axis=1).max() * slack)

    def center(self, number: int) -> Floats:
        """(3,) the centre of a part's type, from which places are counted."""
        if number not in self._centers:
            one = sample_elements(self._loaded, number, np.zeros(1, np.int64), np.zeros((1, 3)), self._quantity)
            self._centers[number] = one.center[0]
        return self._centers[number]

    def sample(self, number: int, elements: Ints, places: Floats) -> Samples:
        """What elements (n,) of a part, by index, have at reference points (n, 3)."""
        center = self.center(number)
        return sample_elements(
            self._loaded, number, elements - self._loaded.first[number], places - center, self._quantity
        )

    def facets(self, number: int) -> Floats:
        """(k, 4) facets of a part's shape that are not parallel to the plane z = 0 of 2D data."""
        facets = self._lines.facets(number)
        return facets[np.abs(facets[:, :2]).max(axis=1) > 0.0] if self._loaded.dimension == 2 else facets

    def points(self, columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
        """(n, 3) places of the plane under points of the picture, and how much nearer they make the plane seem."""
        assert self._hits.flat is not None
        origins, directions = self._view.rays(columns, rows)
        normal, slant = self._hits.flat, directions @ self._hits.flat
        depth = (self._hits.offset - origins @ normal) / slant
        return origins + depth[:, None] * directions, np.abs(slant)


class _Squares:
    """Squares of pixels in elements: their extent, whether they lie inside, and which decisions are proved."""

    def __init__(self, proof: ContourProof, number: int, items: _Items, bounds: _Derivatives, row: Ints) -> None:
        self._proof, self._number, self._items = proof, number, items
        self._bounds, self._row, width = bounds, row, proof._view.width
        self._column, self._line = (items.pixel % width).astype(float), (items.pixel // width).astype(float)
        middle, slant = proof.points(self._column, self._line)
        self._middle = middle
        ends = product((-0.5, 0.5), repeat=2)
        self._corners = [proof.points(self._column + x, self._line + y) for x, y in ends]

        # an element with x(r) has |y - (r - c)| <= b |r - c| for y = J(c)^-1 (x - x(c)): where its points can't be
        parts = np.einsum("nij,nj->ni", bounds.inverse[row], middle - bounds.centre[row])
        straight = proof.center(number) + parts
        facets = proof.facets(number)
        self._steep = np.abs(facets[:, :3]).sum(axis=1).max()
        most = np.max([self._margins(straight + step) for step in self._steps(bounds.inverse[row])], axis=0)
        self.outside = most.min(axis=1) + self._steep * 2 * bounds.bend[row] < -1e-9

        # the centre's reference coordinates, by Newton's method
        self._centre = np.where(np.isnan(items.start), straight, items.start)
        for _ in range(4):
            found = proof.sample(number, items.element, self._centre)
            self._inverse = np.asarray(np.linalg.inv(found.jacobian), np.float64)
            step = np.einsum("nij,nj->ni", self._inverse, middle - found.position)
            self._centre = self._centre + step
        found = proof.sample(number, items.element, self._centre)
        self._value = found.value
        self._missed = 2 * np.abs(np.einsum("nij,nj->ni", self._inverse, middle - found.position)).max(axis=1)

        # half the extent, were the map linear, and what its bend adds
        steps, turn = self._steps(self._inverse), bounds.turn[row] / (1 - bounds.bend[row])
        rho = np.abs(steps).max(axis=(0, 2))
        slants = [slant, *(there for _, there in self._corners)]
        self._warp = np.max(slants, axis=0) / np.min(slants, axis=0) - 1
        grown = turn * rho
        self._rho, self._turn = rho * (1 + grown), turn
        good = (grown < 0.1) & (bounds.bend[row] < 0.9) & (self._warp < 0.1) & (self._missed < 1e-9)
        good &= proof.reaches(number, self._centre + steps, turn * self._rho**2)
        self._good = good & np.isfinite(found.value)
        least = np.min([self._margins(self._centre + step).min(axis=1) for step in steps], axis=0)
        self._bulge = self._steep * turn * self._rho**2 + 1e-9
        self.inside = self._good & (least > self._bulge)

    def _steps(self, inverse: Floats) -> Floats:
        """(4, n, 3) reference coordinates of the corners less those of the middle, by inverse Jacobians (n, 3, 3)."""
        return np.stack([np.einsum("nij,nj->ni", inverse, place - self._middle) for place, _ in self._corners])

    def _margins(self, places: Floats) -> Floats:
        """(..., k) signed distances of places (..., 3) to the facets of the shape."""
        facets = self._proof.facets(self._number)
        return np.asarray(places @ facets[:, :3].T + facets[:, 3])

    def decide(self, levels: Floats) -> Bools:
        """(n,) squares in each of which every level is proved to be taken, or proved not to be."""
        bounds, row = self._bounds, self._row
        noise = _ROUNDING * bounds.size[row]
        spread = bounds.rise[row] * (self._rho + self._missed) + noise
        self.taken = np.zeros(len(row), bool)
        done = self._good & ~_any_between(levels, self._value - spread, self._value + spread)
        for cells in _CELLS:
            left = np.flatnonzero(self._good & ~done)
            for first in range(0, len(left), max(1, _AT_ONCE // (cells + 1) ** 2)):
                some = left[first : first + max(1, _AT_ONCE // (cells + 1) ** 2)]
                done[some] = self._decided_by(cells, some, levels)
        return np.asarray(done)

    def _decided_by(self, cells: int, some: Ints, levels: Floats) -> Bools:
        """The same of some squares, by a lattice of n cells a side."""
        values, places, noise = self._lattice(cells, some)
        bounds, row = self._bounds, self._row[some]
        rho, warp = self._rho[some], self._warp[some]
        curve = bounds.curve[row] + bounds.rise[row] * self._turn[some]
        rest = (curve * rho**2 + warp * bounds.rise[row] * rho) * (1 + 3 * warp) ** 2 * 1.1 / cells**2
        low, high = values.min(axis=(1, 2)), values.max(axis=(1, 2))

        # of a square that is not all inside, only what the element certainly has there counts as taken
        certain = self._surely_taken(some, values, places)
        taken_low = np.where(self.inside[some], low + noise, certain[0] + noise)
        taken_high = np.where(self.inside[some], high - noise, certain[1] - noise)
        empty = ~(taken_low < taken_high)
        taken_low, taken_high = np.where(empty, high, taken_low), np.where(empty, high, taken_high)
        self.taken[some] |= ~empty & _any_between(levels, taken_low, taken_high)
        below = _any_between(levels, low - rest - noise, taken_low)
        return np.asarray(~(below | _any_between(levels, taken_high, high + rest + noise)))

    def _lattice(self, cells: int, some: Ints) -> tuple[Floats, Floats, Floats]:
        """Values (n, s + 1, s + 1) and places (…, 3) of the lattices, and bounds (n,) of how far values may be off."""
        steps = np.arange(cells + 1) / cells - 0.5
        x, y = np.tile(steps, cells + 1), np.repeat(steps, cells + 1)
        columns = (self._column[some, None] + x).reshape(-1)
        target = self._proof.points(columns, (self._line[some, None] + y).reshape(-1))[0]
        away = target.reshape(len(some), -1, 3) - self._middle[some, None]
        places = self._centre[some, None] + np.einsum("nij,nkj->nki", self._inverse[some], away)

        # a Newton step from there, which is left out of the place but not of the value
        elements = np.repeat(self._items.element[some], len(x))
        found = self._proof.sample(self._number, elements, places.reshape(-1, 3))
        step = np.linalg.solve(found.jacobian, (target - found.position)[..., None])[..., 0]
        values = found.value + np.einsum("ni,ni->n", found.gradient, step)
        length = np.abs(step).max(axis=1).reshape(len(some), -1).max(axis=1)
        row = self._row[some]
        curve = self._bounds.curve[row] + self._bounds.rise[row] * self._turn[some]
        noise = _ROUNDING * self._bounds.size[row] + curve * length**2
        shape = (len(some), cells + 1, cells + 1)
        return values.reshape(shape), places.reshape(*shape, 3), noise

    def _surely_taken(self, some: Ints, values: Floats, places: Floats) -> tuple[Floats, Floats]:
        """Least and greatest value (n,) at corners in the element that hang together in it; infinite where none do."""
        inside = self._margins(places).min(axis=3) > self._bulge[some, None, None]

        # one run in every row at most, and rows one after another that share a column
        runs = np.diff(inside, axis=2, prepend=False).sum(axis=2) <= 2
        rows = inside.any(axis=2)
        joined = (inside[:, 1:] & inside[:, :-1]).any(axis=2) | ~(rows[:, 1:] & rows[:, :-1])
        whole = runs.all(axis=1) & joined.all(axis=1) & (np.diff(rows, axis=1, prepend=False).sum(axis=1) <= 2)
        inside &= whole[:, None, None]
        low = np.where(inside, values, np.inf).min(axis=(1, 2))
        return low, np.where(inside, values, -np.inf).max(axis=(1, 2))


def _any_between(levels: Floats, low: Floats, high: Floats) -> Bools:
    """(n,) whether one of the ascending levels lies in [low, high]."""
    return np.asarray(np.searchsorted(levels, low) < np.searchsorted(levels, high, "right"))


def _grow(mask: Bools) -> Bools:
    """(h, w) pixels of a mask and those beside them."""
    padded = np.pad(mask, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return np.asarray(rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:])


def _derivatives(space: BernsteinSpace, places: Floats, middle: Samples, values: Floats) -> _Derivatives:
    """Bounds from nets of places less the centre (n, 3, count) and of values (n, count), and samples at the centres."""
    inverse = np.swapaxes(duals(middle.jacobian), 1, 2)
    parts = inverse @ places
    beyond = _BEYOND[space.shape]
    bend, turn = changes(space, parts, beyond)
    rise = sum(np.abs(derived(space, values, (j,), beyond)) for j in range(3))
    curve = sum(np.abs(derived(space, values, pair, beyond)) for pair in product(range(3), repeat=2))
    size = np.abs(derived(space, values, (), beyond)).max(axis=1)
    return _Derivatives(bend, turn, np.max(rise, axis=1), np.max(curve, axis=1), size, middle.position, inverse)


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
