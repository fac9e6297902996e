"""An upper bound of the difference of two fields on different meshes, over all pairs of elements that may meet.

Where the map of one element of a pair is affine, its field is a polynomial in the other one's coordinates eta, also
beyond the element: u2(M x1(eta) + c).  So the difference is a polynomial on boxes of eta, whose Bernstein net bounds
it.  Boxes that lie on the far side of a facet of the affine element are left out; those whose bound exceeds what was
found at points are halved.  Where no map is affine the ranges of both fields on their elements bound the difference.
Rounding is allowed for by an estimate, _ROUNDING parts of what a value is added up from, not by intervals.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.mapping.boxes import BoxTree, element_boxes
from elvis.core.mapping.margins import heights
from elvis.core.patch import Patch
from elvis.core.polynomials.bernstein import (
    BernsteinSpace,
    bernstein_coefficients,
    bernstein_space,
    bernstein_values,
    line_tables,
)
from elvis.core.polynomials.boxnets import all_halves, box_degrees, box_nets, corners, nets_through
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.shapes import Shape

#: coefficients of differences that may be taken in all, and together; halvings
_MOST, _BATCH, _ROUNDS = 1 << 26, 1 << 17, 20
#: part of the greatest difference at points by which the bound may be more
_CLOSE = 1e-3
#: greatest degree of differences on boxes
_MOST_DEGREE = 12
_EPS = float(np.finfo(np.float64).eps)
#: roundings of a value, in parts of what it is added up from
_ROUNDING = 8 * _EPS
#: what rounding may take an element away from a facet, in the unit of `margins.facets`
_MARGIN = 0.5e-9


@dataclass(frozen=True, eq=False)
class _Side:
    """Elements of a patch with its only field.

    space      of the field, and ``net`` (n, count) its Bernstein coefficients
    places     (n, d, D, …) nets of the coordinates on the box of eta
    boxes      (n, 6) that hold the elements
    matrix     (n, 1 + d, d) from (1, x) to xi where the map is affine
    is_affine  (n,)
    """

    patch: Patch
    space: BernsteinSpace
    net: Floats
    places: Floats
    boxes: Floats
    matrix: Floats
    is_affine: Bools

    @cached_property
    def tree(self) -> BoxTree:
        """Of ``boxes``."""
        return BoxTree.build(self.boxes.astype(np.float32))

    @property
    def degree(self) -> int:
        """The greatest of the field in a direction of eta."""
        return max(box_degrees(self.space))

    @property
    def total(self) -> int:
        """The total degree of the field in xi, in which the shape isn't a pyramid."""
        return sum(self.space.degrees)


def bound_of_difference(first: Sequence[Patch], second: Sequence[Patch], found: float) -> float | None:
    """What the magnitude of the difference doesn't exceed anywhere; None where that can't be told.

    first, second  elements of two datasets, each with the field to be compared as its only one
    found          the greatest magnitude at points
    """
    ours, theirs = ([_side(patch) for patch in own] for own in (first, second))
    known = [own for own in (*ours, *theirs) if own is not None]
    if len(known) < len(ours) + len(theirs) or len({own.patch.dimension for own in known}) != 1:
        return None
    budget = [_MOST]
    bounds = [_between(one, two, found, budget) for one in known[: len(ours)] for two in known[len(ours) :]]
    return max((found, *bounds))


def _side(patch: Patch) -> _Side | None:
    """A patch prepared; None on curves and surfaces in space, and with Fourier directions."""
    expansion, coefficients = patch.fields[0], patch.coefficients[0]
    if expansion is None or coefficients is None or patch.periods or not patch.is_flat:
        return None
    d, space, maps = patch.dimension, bernstein_space(expansion), bernstein_space(patch.geometry)
    net = bernstein_coefficients(expansion, coefficients)
    points = bernstein_coefficients(patch.geometry, patch.geometry_coefficients)[:, :d]
    nets = box_nets(maps, points.reshape(-1, points.shape[-1]))
    places = nets.reshape(len(patch), d, *nets.shape[1:])
    matrix, is_affine = _affine(patch.shape, places)
    return _Side(patch, space, net, places, element_boxes(patch).astype(np.float64), matrix, is_affine)


def _affine(shape: Shape, places: Floats) -> tuple[Floats, Bools]:
    """(n, 1 + d, d) the maps from (1, x) to xi of elements with nets of coordinates; whether they are those."""
    count, d = places.shape[:2]
    matrix, is_affine = np.zeros((count, 1 + d, d)), np.zeros(count, bool)
    if shape is Shape.PYRAMID or max(places.shape[2:]) > 2:
        return matrix, is_affine

    # x = a + B xi through the corners, and xi = B^-1 (x - a)
    ends = np.where(shape.vertices > 0, 1, 0)
    vertices = np.stack([places[(slice(None), slice(None), *end)] for end in ends], axis=2)
    own = np.hstack([np.ones((len(ends), 1)), shape.vertices])
    fit = vertices @ np.linalg.pinv(own).T
    apart = np.abs(fit @ own.T - vertices).max(axis=(1, 2))
    determinants = np.linalg.det(fit[:, :, 1:])
    is_affine = (apart <= 8 * _EPS * np.abs(vertices).max(axis=(1, 2))) & (np.abs(determinants) > 0)
    inverse = np.linalg.inv(fit[is_affine][:, :, 1:])
    matrix[is_affine, 1:] = inverse.swapaxes(1, 2)
    matrix[is_affine, 0] = -np.einsum("nij,nj->ni", inverse, fit[is_affine][:, :, 0])
    return matrix, is_affine


def _between(one: _Side, two: _Side, found: float, budget: list[int]) -> float:
    """The bound over the elements of two patches that meet."""
    rows, others = two.tree.overlaps(one.boxes[:, :3], one.boxes[:, 3:])
    upper = _apart(one.net, two.net, rows, others)
    if not len(rows) or upper.max() <= found:
        return found
    bound = found
    for outer, inner, a, b, which in _roles(one, two, rows, others):
        bound = max(bound, _Pairs(outer, inner, found, budget).bound(a, b, upper[which]))
    return bound


def _roles(one: _Side, two: _Side, rows: Ints, others: Ints) -> Iterator[tuple[_Side, _Side, Ints, Ints, Bools]]:
    """Pairs of elements, the one with an affine map last where there is one."""
    is_last = two.is_affine[others]
    if _degree(two, one) < _degree(one, two):
        is_last = is_last & ~one.is_affine[rows]
    yield one, two, rows[is_last], others[is_last], is_last
    yield two, one, others[~is_last], rows[~is_last], ~is_last


def _degree(outer: _Side, inner: _Side) -> int:
    """The degree of differences in a direction of eta on elements of ``outer``."""
    of_map = int(max(outer.places.shape[2:])) - 1
    return max(outer.degree, inner.total * of_map)


def _apart(one: Floats, two: Floats, rows: Ints, others: Ints) -> Floats:
    """(n,) greatest difference of values in the ranges of nets (…, m), of rows (n,) of either."""
    low, high = ([end(own, axis=1) for own in (one, two)] for end in (np.min, np.max))
    slack = _ROUNDING * (np.abs(one).max() + np.abs(two).max())
    above, below = high[0][rows] - low[1][others], high[1][others] - low[0][rows]
    return np.asarray(np.maximum(above, below) + slack)


class _Pairs:
    """Elements of ``outer``, each with one of ``inner``, whose map is affine, that it may meet."""

    def __init__(self, outer: _Side, inner: _Side, found: float, budget: list[int]) -> None:
        self._outer, self._inner, self._found, self._budget = outer, inner, found, budget
        d = outer.patch.dimension
        self._degree = _degree(outer, inner)
        self._line = (1 - np.cos(np.linspace(0, np.pi, self._degree + 1))) / 2
        self._eta = 2 * np.stack(np.meshgrid(*[self._line] * d, indexing="ij"), axis=-1).reshape(-1, d) - 1
        self._growth = float(np.abs(np.linalg.inv(line_tables(self._degree, self._line)[0])).sum(axis=1).max()) ** d
        self._modes = box_values(outer.places.shape[2:], self._eta)

    def bound(self, rows: Ints, others: Ints, upper: Floats) -> float:
        """What differences on pairs don't exceed, of which the ranges of the fields say ``upper`` (n,)."""
        is_told = self._inner.is_affine[others] & (self._degree <= _MOST_DEGREE)
        bound = float(upper[~is_told].max(initial=0.0))
        open_pairs = np.flatnonzero(is_told & (upper > self._found))
        open_pairs = open_pairs[np.argsort(-upper[open_pairs], kind="stable")]
        step = max(1, _BATCH // len(self._eta))
        for first in range(0, len(open_pairs), step):
            pairs = open_pairs[first : first + step]
            if self._budget[0] <= 0:
                return max(bound, float(upper[pairs[0]]))
            bound = max(bound, self._halved(rows[pairs], others[pairs]))
        return bound

    def _halved(self, rows: Ints, others: Ints) -> float:
        """The same, from nets of differences on boxes, which are halved."""
        held = self._meet(self._outer.places[rows], others)
        rows, others = rows[held], others[held]
        if not len(rows):
            return 0.0
        nets, slack = self._nets(rows, others)
        places, bound = self._outer.places[rows], 0.0
        for _ in range(_ROUNDS):
            meets = self._meet(places, others)
            self._found = max(self._found, self._at_corners(nets[meets], slack[meets], places[meets], others[meets]))
            size = np.abs(nets).max(axis=tuple(range(1, nets.ndim)))
            is_open = meets & (size > self._found * (1 + _CLOSE) + 4 * slack)
            bound = max(bound, float((size + slack)[meets & ~is_open].max(initial=0.0)))
            if not is_open.any():
                return bound
            if self._budget[0] <= 0:
                break
            count = 2 ** (nets.ndim - 1)
            others, slack = np.tile(others[is_open], count), np.tile(slack[is_open], count)
            nets, places = all_halves(nets[is_open]), _halves_of_places(places[is_open])
            self._budget[0] -= nets.size
        return max(bound, float((np.abs(nets).max(axis=tuple(range(1, nets.ndim))) + slack).max()))

    def _nets(self, rows: Ints, others: Ints) -> tuple[Floats, Floats]:
        """Nets (n, D, …) of the difference on the box of eta, and by how much they may be rounded (n,)."""
        outer, inner, d = self._outer, self._inner, self._eta.shape[1]
        matrix = inner.matrix[others]
        world = outer.places[rows].reshape(len(rows), d, -1) @ self._modes.T
        xi = matrix[:, :1] + np.einsum("ndq,ndk->nqk", world, matrix[:, 1:])
        modes = bernstein_values(inner.space, xi.reshape(-1, d)).reshape(*xi.shape[:2], -1)
        values = np.einsum("nqm,nm->nq", modes, inner.net[others])
        own = outer.net[rows] @ bernstein_values(outer.space, uncollapse(outer.patch.shape, self._eta)).T
        self._budget[0] -= values.size

        # values are rounded as sums, and in places, which the inverse map magnifies
        size = np.abs(values).max(axis=1) + np.abs(own).max(axis=1)
        moved = np.abs(world).max(axis=(1, 2)) * np.abs(matrix[:, 1:]).sum(axis=1).max(axis=1)
        slack = _ROUNDING * size * (self._growth + (1 + moved) * inner.total**2)
        return nets_through(own - values, self._line, d), slack

    def _at_corners(self, nets: Floats, slack: Floats, places: Floats, others: Ints) -> float:
        """The greatest difference at corners of boxes that lie in the other element."""
        ends = np.stack([corners(np.ascontiguousarray(places[:, axis])) for axis in range(places.shape[1])], axis=1)
        is_inside = self._heights(ends, others).min(axis=2) >= 0
        return float(np.where(is_inside, np.abs(corners(nets)) - slack[:, None], 0.0).max(initial=0.0))

    def _meet(self, places: Floats, others: Ints) -> Bools:
        """(n,) whether boxes with nets of coordinates (n, d, D, …) may meet elements: no facet is between them."""
        is_within = self._heights(places.reshape(*places.shape[:2], -1), others) >= -_MARGIN
        meets_facets = np.asarray(is_within.any(axis=1))
        return np.asarray(meets_facets.all(axis=1))

    def _heights(self, places: Floats, others: Ints) -> Floats:
        """(n, m, f) heights over the facets of elements at places (n, d, m)."""
        matrix = self._inner.matrix[others]
        xi = matrix[:, None, 0] + np.einsum("ndm,ndk->nmk", places, matrix[:, 1:])
        return heights(self._inner.patch.shape, xi)


def box_values(sizes: Sequence[int], eta: Floats) -> Floats:
    """(q, m) tensor Bernstein functions of D1, … coefficients at points eta (q, d), the last direction fastest."""
    found = np.ones((len(eta), 1))
    for axis, size in enumerate(sizes):
        line = line_tables(size - 1, (1 + eta[:, axis]) / 2)[0]
        found = (found[:, :, None] * line[:, None]).reshape(len(eta), -1)
    return found


def _halves_of_places(places: Floats) -> Floats:
    """Nets (n, d, D, …) of coordinates on the halves of boxes, in the order of `all_halves`."""
    d = places.shape[1]
    return np.stack([all_halves(np.ascontiguousarray(places[:, axis])) for axis in range(d)], axis=1)
