"""Differences u1(eta) - u2(xi(x1(eta))) on boxes of eta in elements, as nets, with a bound of every rounding.

Let a box have nets of the coordinates x1 and of u1 in floating point, and the other element an affine map xi = (x - a)
M with coefficients c of u2, also in floating point.  These are polynomials, and so is p = u1 - u2(xi(x1)), of degree n
each way.

Values of p at a lattice have an error e: sums and products of u1 and x1 have positive terms; values of u2 have an error
of some roundings of the sum of |b_m(xi)| |c_m|, which is at most growth = (sum of |barycentric coordinates|)^degree
times the largest |c_m|; and xi has an error of some roundings of |x - a| |M|, which the gradients of u2 magnify.

Nets built from these values are not trusted.  Let N be any net, r = p - N. On the box |r| <= L max |r at the lattice|,
where L is the Lebesgue constant of n + 1 Chebyshev points, at most 1 + 2 log(n + 1) / pi per direction (Trefethen 2013,
Approximation Theory and Approximation Practice, theorem 15.2).  This gives |p| <= max |N| + L (max |values - N| + e),
and with N = 0 just |p| <= L (max |values| + e).

The difference p and the true difference at a common point x deviate by errors of u1 and c, and by errors of x1 and of
the inverse map.  The latter are applied where xi is in the element: there the gradients of u2 are bounded, and there is
no growth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.differences.prepared import Side
from elvis.core.mapping.margins import heights
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.polynomials.boxnets import EXACT, GRID, all_halves, nets_through, on_lattice, parts_of_boxes
from elvis.core.polynomials.rounding import POWER, UNIT, gamma, halving_roundings, value_roundings
from elvis.core.shapes import Shape

#: maximum movement of an element off a facet by rounding, in the unit of `margins.facets`
_MARGIN = 0.5e-9
#: degrees tried for nets that replace nets of higher degree
_MIDDLE, _HIGH = 10, 14
#: limit for the error of xi times the degree up to which gradients and growth change by at most the factor `_MORE`
_FAR, _MORE = 1e-3, 1.01
#: factor for the rounding of the lattice, of logarithms and of magnitudes in bounds
_SAFE = 1 + 1e-9


@dataclass(frozen=True, eq=False)
class PairBoxes(Rows):
    """Boxes of eta in elements ``rows`` of one side, each with an element ``others`` of the other.

    places  (n, d, D, …) nets of coordinates from the other element's origin, off by ``place_error`` (n, d)
    own     (n, D, …) nets of the first field, off by ``own_error`` (n,)
    """

    rows: Ints
    others: Ints
    places: Floats
    place_error: Floats
    own: Floats
    own_error: Floats

    def without_fields(self) -> PairBoxes:
        """The boxes with nets of the first field set to zero, once they are no longer needed."""
        return replace(self, own=np.zeros((len(self), *(1,) * self.places.shape[1])))

    def halved(self) -> PairBoxes:
        """Both halves in every direction."""
        d = self.places.shape[1]
        place_error = self.place_error + gamma(halving_roundings(self.places.shape[2:])) * _size(self.places, 2)
        own_error = self.own_error + gamma(halving_roundings(self.own.shape[1:])) * _size(self.own, 1)
        places = [all_halves(np.ascontiguousarray(self.places[:, axis])) for axis in range(d)]
        rows, others = np.tile(self.rows, 2**d), np.tile(self.others, 2**d)
        place_error, own_error = np.tile(place_error, (2**d, 1)), np.tile(own_error, 2**d)
        return PairBoxes(rows, others, np.stack(places, axis=1), place_error, all_halves(self.own), own_error)

    def cut(self, axis: int, low: Ints, high: Ints) -> PairBoxes:
        """Parts from low / GRID to high / GRID (n,) of them in a direction of eta."""
        place_error = self.place_error + gamma(self.places.shape[2 + axis]) * _size(self.places, 2)
        own_error = self.own_error + gamma(self.own.shape[1 + axis]) * _size(self.own, 1)
        places = parts_of_boxes(self.places, 1 + axis, low, high)
        own = parts_of_boxes(self.own, axis, low, high)
        return PairBoxes(self.rows, self.others, places, place_error, own, own_error)


@dataclass(frozen=True, eq=False)
class Composed:
    """Nets (n, D, …) of differences on boxes.

    limit  (n,) upper bound of their magnitude at common points of both elements
    slack  (n,) maximum deviation of the difference from a net
    """

    nets: Floats
    limit: Floats
    slack: Floats


class Composition:
    """Differences on pairs of elements: of ``outer`` on boxes of their eta, of ``inner`` where maps are affine.

    degree    of the differences in each direction of eta
    line      (degree + 1,) Chebyshev points in [0, 1], and ``lebesgue``, a bound of the constant of their lattice
    """

    def __init__(self, outer: Side, inner: Side) -> None:
        self._outer, self._inner = outer, inner
        self.degree = degree_on(outer, inner)
        self.line = (1 - np.cos(np.linspace(0, np.pi, self.degree + 1))) / 2
        self.lebesgue = _SAFE * (1 + 2 / np.pi * np.log(self.degree + 1)) ** outer.patch.dimension

    @property
    def count(self) -> int:
        """Coefficients of a net."""
        return int((self.degree + 1) ** self._outer.patch.dimension)

    def whole(self, rows: Ints, others: Ints) -> PairBoxes:
        """The boxes of whole elements ``rows``, each with one of ``others``."""
        outer, d = self._outer, self._outer.patch.dimension
        origin = self._inner.affine.origin[others].reshape(len(rows), d, *(1,) * d)
        places = outer.places[rows] - origin
        place_error = outer.place_error[rows] + UNIT * _size(places, 2)
        return PairBoxes(rows, others, places, place_error, outer.box[rows], outer.box_error[rows])

    def meet(self, boxes: PairBoxes) -> Bools:
        """(n,) whether boxes may meet elements: no facet is between them."""
        is_within = self._heights(boxes) >= 0
        meets_facets = is_within.any(axis=tuple(range(1, is_within.ndim - 1)))
        return np.asarray(meets_facets.all(axis=1))

    def clipped(self, boxes: PairBoxes) -> PairBoxes:
        """Boxes cut down to what may meet the elements, after Sederberg and Nishita (1990), Bezier clipping.

        A height over a facet lies in the hull of its net's coefficients over their places, seen along each direction.
        """
        if max(*boxes.own.shape[1:], *boxes.places.shape[2:]) > EXACT + 1:
            return boxes
        for axis in range(boxes.places.shape[1]):
            over = self._heights(boxes)
            others = tuple(1 + other for other in range(boxes.places.shape[1]) if other != axis)
            upper = over.max(axis=others)
            low, high = _crossing(upper), 1 - _crossing(upper[:, ::-1])
            first = np.clip(np.floor(GRID * low.max(axis=1) - 1e-6), 0, GRID).astype(np.int64)
            last = np.clip(np.ceil(GRID * high.min(axis=1) + 1e-6), 0, GRID).astype(np.int64)
            held = first < last
            boxes = boxes.part(held).cut(axis, first[held], last[held])
        return boxes

    def growth(self, boxes: PairBoxes) -> Floats:
        """(n,) what the sum of the magnitudes of the other field's Bernstein functions doesn't exceed."""
        return growth(self._inner.space, self._reference(boxes))

    def rounding_of_values(self, boxes: PairBoxes) -> Floats:
        """(n,) how far `values` may be from the true ones of the boxes' nets."""
        inner, grown = self._inner, _MORE * self.growth(boxes)
        shift = self._shift(boxes)
        size = np.abs(inner.net[boxes.others]).max(axis=1)
        own = _size(boxes.own, 1)
        error = gamma(value_roundings(boxes.own.shape[1:])) * own + UNIT * _MORE * (own + grown * size)
        error += gamma(_field_roundings(inner.space)) * grown * size
        error += _MORE * grown * (shift * inner.slopes[boxes.others]).sum(axis=1)
        is_far = inner.total * shift.max(axis=1) > _FAR
        return np.where(is_far, np.inf, error)

    def values(self, boxes: PairBoxes) -> Floats:
        """(n, q) differences at the lattice of Chebyshev points of each box."""
        d, inner = self._outer.patch.dimension, self._inner
        world = on_lattice(boxes.places.reshape(-1, *boxes.places.shape[2:]), self.line)
        xi = np.einsum("ndq,ndk->nqk", world.reshape(len(boxes), d, -1), inner.affine.matrix[boxes.others])
        modes = bernstein_values(inner.space, xi.reshape(-1, d)).reshape(*xi.shape[:2], -1)
        theirs = (modes @ inner.net[boxes.others][:, :, None])[:, :, 0]
        return np.asarray(on_lattice(boxes.own, self.line).reshape(theirs.shape) - theirs)

    def compose(self, boxes: PairBoxes, allowed: float = 0.0) -> Iterator[tuple[PairBoxes, Composed]]:
        """The boxes in groups, with the nets of their differences.

        allowed  permitted error of nets of a lower degree, in addition to rounding
        Elements with parallel sides have nets of the fields' own degree, which have fewer coefficients.  Elements with
        slightly curved maps come close to that, while nets of a high degree are less informative.
        """
        values = self.values(boxes)
        slack = self.lebesgue * self.rounding_of_values(boxes) + self._slack_of_places(boxes)
        limit = self.lebesgue * np.abs(values).max(axis=1) + slack
        low = min(self.degree, max(self._outer.degree, *self._inner.space.degrees))
        degrees = (low, min(self.degree, _MIDDLE), min(self.degree, _HIGH))
        is_left = np.ones(len(boxes), bool)
        for degree in sorted(set(degrees)):
            nets, apart = self._fitted(values, degree)
            is_near = is_left & ((self.lebesgue * apart <= np.maximum(slack, allowed)) | (degree == max(degrees)))
            is_left &= ~is_near
            if is_near.any():
                trusted = (slack + self.lebesgue * apart)[is_near]
                own = nets[is_near]
                yield boxes.part(is_near), Composed(own, np.minimum(limit[is_near], _size(own, 1) + trusted), trusted)
            if not is_left.any():
                return

    def _fitted(self, values: Floats, degree: int) -> tuple[Floats, Floats]:
        """Nets (n, D, …) of a degree near values (n, q) at the lattice, and (n,) how far they may be from these."""
        d = self._outer.patch.dimension
        nets = nets_through(values, self.line, d, degree)
        apart = np.abs(on_lattice(nets, self.line).reshape(values.shape) - values).max(axis=1)
        return nets, apart + gamma(value_roundings(nets.shape[1:]) + 1) * _MORE * _size(nets, 1)

    def _slack_of_places(self, boxes: PairBoxes) -> Floats:
        """(n,) maximum deviation of the true difference from the boxes' nets, at common points of both elements."""
        inner, off = self._inner, self._off(boxes)
        moved = _MORE * (off * inner.slopes[boxes.others]).sum(axis=1)
        is_far = inner.total * off.max(axis=1) > _FAR
        return np.where(is_far, np.inf, boxes.own_error + inner.error[boxes.others] + moved)

    def _reference(self, boxes: PairBoxes) -> Floats:
        """(n, D, …, d) nets of xi."""
        return np.asarray(np.einsum("nd...,ndk->n...k", boxes.places, self._inner.affine.matrix[boxes.others]))

    def _shift(self, boxes: PairBoxes) -> Floats:
        """(n, d) maximum deviation of computed xi from the boxes' nets; includes the rounding of 1 + xi."""
        matrix = np.abs(self._inner.affine.matrix[boxes.others])
        reach = np.einsum("nd,ndk->nk", _size(boxes.places, 2), matrix)
        count = value_roundings(boxes.places.shape[2:]) + boxes.places.shape[1] + 3
        return np.asarray(gamma(count) * (1 + reach))

    def _off(self, boxes: PairBoxes) -> Floats:
        """(n, d) how far xi of the boxes' nets may be from the true ones, in the element."""
        affine = self._inner.affine
        moved = np.einsum("nd,ndk->nk", boxes.place_error, np.abs(affine.matrix[boxes.others]))
        return np.asarray(moved + affine.error[boxes.others])

    def _heights(self, boxes: PairBoxes) -> Floats:
        """(n, D, …, f) nets of what heights over facets don't exceed."""
        away = _MARGIN + (self._shift(boxes) + self._off(boxes)).sum(axis=1)
        found = heights(self._inner.patch.shape, self._reference(boxes))
        return np.asarray(found + away.reshape(-1, *(1,) * (found.ndim - 1)))


def degree_on(outer: Side, inner: Side) -> int:
    """The degree of differences in a direction of eta on elements of ``outer``."""
    of_map = int(max(outer.places.shape[2:])) - 1
    return max(outer.degree, inner.total * of_map)


def growth(space: BernsteinSpace, xi: Floats) -> Floats:
    """(n,) the sum of the magnitudes of all functions of a space, none a pyramid's, at most, in hulls of xi (n, …, d).

    (sum of the |barycentric coordinates|)^degree on simplices; products of such of the directions on other shapes.
    """
    t = (1 + xi) / 2
    factors = [[axis] for axis in range(space.shape.dimension)]
    if space.shape in (Shape.TRIANGLE, Shape.TETRAHEDRON):
        factors = [list(range(space.shape.dimension))]
    elif space.shape is Shape.PRISM:
        factors = [[0, 2], [1]]
    sizes = (np.abs(t[..., own]).sum(axis=-1) + np.abs(1 - t[..., own].sum(axis=-1)) for own in factors)
    terms = (
        size.max(axis=tuple(range(1, size.ndim))) ** degree for size, degree in zip(sizes, space.degrees, strict=True)
    )
    return np.asarray(_SAFE * reduce(np.multiply, terms))


def _field_roundings(space: BernsteinSpace) -> int:
    """Roundings of a value of a field, relative to the sum of |b_m| |c_m|, at any point.

    For a simplex, or a line, of degree p in d barycentric coordinates and one more, 1 - sum t, the latter has an error
    of d + 1 roundings, p times in powers; each has a power, a product and a multinomial coefficient.  Functions of
    other shapes are products of these.
    """
    d, shape = space.shape.dimension, space.shape
    if shape in (Shape.TRIANGLE, Shape.TETRAHEDRON):
        parts = [(d, space.degrees[0])]
    elif shape is Shape.PRISM:
        parts = [(2, space.degrees[0]), (1, space.degrees[1])]
    else:
        parts = [(1, degree) for degree in space.degrees]
    return space.count + sum(degree * (own + 2) + (own + 1) * (POWER + 2) + 1 for own, degree in parts)


def _crossing(upper: Floats) -> Floats:
    """(n, f) places in [0, 1] before which polynomials with coefficients below ``upper`` (n, D, f) are negative.

    2 if they are everywhere.  The hull of the coefficients over their places k / (D - 1) is entered on a line from a
    negative one to a later one that isn't.
    """
    count = upper.shape[1]
    found = np.where((upper >= 0).any(axis=1), 1.0, 2.0)
    for j in range(count):
        for k in range(j + 1, count):
            low, high = upper[:, j], upper[:, k]
            crosses = (low < 0) & (high >= 0)
            part = low / np.where(crosses, low - high, 1.0)
            found = np.where(crosses, np.minimum(found, (j + part * (k - j)) / (count - 1)), found)
    return np.where(upper[:, 0] >= 0, 0.0, found)


def _size(nets: Floats, first: int) -> Floats:
    """Largest magnitudes over the axes from ``first`` on."""
    return np.asarray(np.abs(nets).max(axis=tuple(range(first, nets.ndim))))
