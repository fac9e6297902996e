"""The reference's inverse map: the reference point of an element at a world point, or a proof that none exists.

The core solves once from a guess and proves by Bernstein nets.  The reference uses another method, so that an error is
not in both.  Newton's method starts from the place of a lattice whose image is nearest and, if that fails, from the
centres of small boxes.  Absence is proved by bisecting these: in a box B of collapsed coordinates with centre c, the
map is Phi(c) + J (r - c) + R(r); the linear part is extreme at the corners of B, and R is bounded by its values at
Chebyshev points (`chebyshev`).  A point beyond these bounds, in the directions of the axes or of the dual tangents at
c, is not the image of a point of B.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import EPS, Bools, Floats, Ints, every_pair, frozen_floats
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.margins import TOLERANCE, drawn_in, margins
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate_at_with_gradients
from elvis.core.polynomials.expansion import line_values
from elvis.core.shapes import Shape
from elvis.reference.chebyshev import bounds_of, lattice, lattice_lines, map_degrees
from elvis.scene.model.time_limit import check_time

#: residual of a root, relative to the element's size, and roundings of coordinates that add to it
_RESIDUAL, _ROUNDINGS = 2.5e-14, 16
#: places along each collapsed coordinate that Newton's method may start from
_PLACES = 3
#: steps of Newton's method, the shortest one that changes anything, and how far it may go beyond an element
_STEPS, _SHORT, _SLACK = 40, 1e-15, 0.25
#: bisections of a direction, number of all bisections after which Newton's method is tried in the rest, and excessive
#: number of pairs of a point and a box
_HALVINGS, _TRIED, _PAIRS = 48, 9, 1 << 20
#: numbers in an intermediate array
_AT_ONCE = 1 << 22
#: numbers at a point of a lattice: offsets and places, coordinates, and these along the directions of bounds
_AT_A_POINT = 18


class Inverter:
    """The elements of a patch, Fourier directions left aside: points have coordinate 0 along them.

    sizes       (n,) diagonals of boxes around the elements
    magnitudes  (n,) largest coordinates
    low, high   (n, 3) the boxes
    """

    def __init__(self, patch: Patch) -> None:
        self.patch, self.shape = patch, patch.shape
        self._degrees = map_degrees(patch)[: self.shape.dimension]
        is_simplex = self.shape in (Shape.SEGMENT, Shape.TRIANGLE, Shape.TETRAHEDRON)
        self._is_affine = is_simplex and set(self._degrees) == {1}
        rows = np.arange(len(patch))
        whole = _boxes(np.zeros((len(rows), 2 * self.shape.dimension), np.int64))
        self._bounds = _Bounds(self, rows, whole)
        self.low, self.high = self._bounds.box()
        self.sizes = np.linalg.norm(self.high - self.low, axis=1)
        self.magnitudes = np.maximum(np.abs(self.low), np.abs(self.high)).max(axis=1, initial=0.0)

    def precision(self, rows: Ints) -> Floats:
        """(n,) world distance within which a point counts as a root's image."""
        return np.asarray(np.maximum(_RESIDUAL * self.sizes[rows], _ROUNDINGS * EPS * self.magnitudes[rows]))

    def map_points(self, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """World coordinates (n, 3) and their derivatives (n, 3, d) at reference points (n, d)."""
        return evaluate_at_with_gradients(self.patch.geometry, self.patch.geometry_coefficients, rows, points)

    def map_lattice(self, rows: Ints, boxes: Floats, lines: Sequence[Floats]) -> Floats:
        """(n, k, 3) world coordinates on lattices in boxes (n, 2, d) of collapsed coordinates, the last one fastest.

        lines  for each direction the lattice's coordinates (k_i,) in [-1, 1]
        The last direction uses sum factorisation (Orszag 1980): modes are products of factors along each direction.
        The factors of the other directions are shared by the three coordinates and by equal boxes.
        """
        distinct, own = np.unique(boxes.reshape(len(boxes), -1), axis=0, return_inverse=True)
        low, high = np.split(distinct, 2, axis=1)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        eta = [middle[:, i, None] + half[:, i, None] * line for i, line in enumerate(lines)]
        tables = line_values(self.patch.geometry, [line.reshape(-1) for line in eta])
        *others, last = (table.reshape(*line.shape, -1) for table, line in zip(tables, eta, strict=True))

        first = np.ones((len(distinct), 1, last.shape[2]))
        for table in others:
            first = (first[:, :, None] * table[:, None]).reshape(len(distinct), -1, last.shape[2])
        own = own.reshape(-1)
        weighted = last[own][:, :, None] * self.patch.geometry_coefficients[rows][:, None]
        world = first[own] @ weighted.reshape(len(rows), -1, last.shape[2]).transpose(0, 2, 1)
        return np.asarray(world.reshape(len(rows), -1, 3))

    def invert(self, rows: Ints, points: Floats) -> tuple[Floats, NDArray[np.uint8]]:
        """Reference points (n, d) and `Status` (n,) of world points (n, 3): UNCERTAIN where absence is not proved."""
        reference = np.full((len(rows), self.shape.dimension), np.nan)
        status = np.full(len(rows), Status.OUTSIDE, np.uint8)
        active = np.flatnonzero(self._bounds.may_hold(rows, points))
        status[active] = Status.UNCERTAIN
        start = self._nearest(rows[active], points[active])
        found, root, inside = self._newton(rows[active], start, points[active])
        reference[active[inside]] = found[inside]
        status[active[inside]] = Status.INSIDE
        # an affine map has only one root
        if self._is_affine:
            status[active[root & ~inside]] = Status.OUTSIDE
        return reference, status

    def search(self, rows: Ints, points: Floats) -> tuple[Floats, NDArray[np.uint8]]:
        """`invert` for points that are UNCERTAIN: INSIDE, proved to be OUTSIDE, or FAILED."""
        reference = np.full((len(rows), self.shape.dimension), np.nan)
        status = np.full(len(rows), Status.OUTSIDE, np.uint8)
        dimension = self.shape.dimension
        pair, place = np.arange(len(rows)), np.zeros((len(rows), 2 * dimension), np.int64)
        for number in range(dimension * _HALVINGS):
            check_time()
            # many points need the same boxes
            distinct, own = np.unique(np.column_stack([rows[pair], place]), axis=0, return_inverse=True)
            boxes = _boxes(distinct[:, 1:])
            left = _Bounds(self, distinct[:, 0], boxes).may_hold(own.reshape(-1), points[pair])
            pair, place, own = pair[left], place[left], own.reshape(-1)[left]
            if number % _TRIED == _TRIED - 1:
                start = uncollapse(self.shape, boxes.mean(axis=1))[own]
                found, _, inside = self._newton(rows[pair], start, points[pair])
                reference[pair[inside]] = found[inside]
                status[pair[inside]] = Status.INSIDE
                is_open = status[pair] != Status.INSIDE
                pair, place, own = pair[is_open], place[is_open], own[is_open]
            if not len(pair) or 2 * len(pair) > _PAIRS:
                break
            place = _halve(place, _widest(self.shape, boxes)[own])
            pair = np.tile(pair, 2)
        status[pair] = Status.FAILED
        return reference, status

    def _nearest(self, rows: Ints, points: Floats) -> Floats:
        """(n, d) reference points to start from: the lattice points with the nearest images."""
        places = _places(self.shape)
        elements, own = np.unique(rows, return_inverse=True)
        count = len(elements) * len(places)
        images, _ = self.map_points(*every_pair(elements, places))
        images = images.reshape(len(elements), len(places), 3) if count else np.empty((0, len(places), 3))
        best = np.empty(len(rows), np.int64)
        step = max(1, _AT_ONCE // (3 * len(places)))
        for first in range(0, len(rows), step):
            part = slice(first, first + step)
            away = np.linalg.norm(images[own[part]] - points[part, None], axis=2)
            best[part] = np.argmin(away, axis=1)
        return places[best]

    def _newton(self, rows: Ints, start: Floats, points: Floats) -> tuple[Floats, Bools, Bools]:
        """End points of damped steps (n, d), whether they are roots (n,), and whether they are roots inside (n,)."""
        found, nearest = start.copy(), np.full(len(rows), np.inf)
        best, active = start.copy(), np.arange(len(rows))
        for _ in range(_STEPS):
            check_time()
            own, place = rows[active], found[active]
            world, jacobians = self.map_points(own, place)
            gap = points[active] - world
            distance = np.linalg.norm(gap, axis=1)
            nearer = distance < nearest[active]
            best[active[nearer]], nearest[active[nearer]] = place[nearer], distance[nearer]
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                step = np.einsum("nci,nc->ni", duals(jacobians), gap)
            length = np.abs(step).max(axis=1)
            moved = place + step / np.maximum(2.0 * length, 1.0)[:, None]
            good = np.isfinite(length)
            moved[~good] = place[~good]
            found[active] = drawn_in(self.shape, moved, _SLACK)
            # at the last digit steps no longer bring the image nearer
            is_last = (length < _SHORT) | (~nearer & (nearest[active] <= self.precision(own)))
            is_stuck = (np.abs(found[active] - place).max(axis=1) < _SHORT) & (length > _SHORT)
            active = active[good & ~is_last & ~is_stuck]
            if not len(active):
                break
        root = nearest <= self.precision(rows)
        margin = margins(self.shape, best) + self._blur(rows, best)
        return best, root, root & (margin >= -TOLERANCE)

    def _blur(self, rows: Ints, places: Floats) -> Floats:
        """(n,) maximum change of margins by rounding of coordinates at reference points (n, d), up to a quarter.

        A margin changes by at most half the sum of the changes of the reference coordinates.
        """
        _, jacobians = self.map_points(rows, places)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            lengths = np.linalg.norm(duals(jacobians), axis=1).sum(axis=1)
            blur = 0.5 * _ROUNDINGS * EPS * self.magnitudes[rows] * lengths
        return np.asarray(np.where(np.isfinite(blur), np.minimum(blur, _SLACK), 0.0))


class _Bounds:
    """Bounds of the map over boxes (k, 2, d) of collapsed coordinates of elements ``rows`` (k,).

    In the directions of the axes and of the dual tangents at the middle; if these are undefined, there is no bound.
    """

    def __init__(self, inverter: Inverter, rows: Ints, boxes: Floats) -> None:
        dimension = inverter.shape.dimension
        self._origin = np.empty((len(rows), 3))
        self._ways = np.empty((len(rows), 3, 3 + dimension))
        self._low, self._high = np.empty((2, len(rows), 3 + dimension))
        unit, divisor = lattice(inverter._degrees)
        corners = np.array(list(product((-1.0, 1.0), repeat=dimension)))
        step = max(1, _AT_ONCE // (len(unit) * _AT_A_POINT))
        for first in range(0, len(rows), step):
            part = slice(first, first + step)
            self._fill(inverter, rows[part], boxes[part], part, unit, divisor, corners)

    def _fill(
        self, inverter: Inverter, rows: Ints, boxes: Floats, part: slice, unit: Floats, divisor: float, corners: Floats
    ) -> None:
        shape, dimension = inverter.shape, inverter.shape.dimension
        middle, half = boxes.mean(axis=1), 0.5 * (boxes[:, 1] - boxes[:, 0])
        centre = uncollapse(shape, middle)
        origin, jacobians = inverter.map_points(rows, centre)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            tangents = np.nan_to_num(duals(jacobians), nan=0.0, posinf=0.0, neginf=0.0)
        axes = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
        ways = np.concatenate([axes, tangents], axis=2)

        # places of the lattice and of the corners, in reference coordinates about the middle
        every = np.concatenate([unit, corners])
        eta = middle[:, None] + half[:, None] * every
        places = uncollapse(shape, eta.reshape(-1, dimension)).reshape(len(rows), len(every), dimension)
        offsets = places - centre[:, None]
        world = inverter.map_lattice(rows, boxes, lattice_lines(inverter._degrees)) - origin[:, None]

        # coordinates xi are multilinear in eta, so that the linear part is extreme at the corners
        linear = np.einsum("ncw,nci->nwi", ways, jacobians)
        straight = linear @ offsets.transpose(0, 2, 1)
        rest = ways.transpose(0, 2, 1) @ world.transpose(0, 2, 1) - straight[:, :, : len(unit)]
        low, high = bounds_of(rest, divisor)
        low += straight[:, :, len(unit) :].min(axis=2)
        high += straight[:, :, len(unit) :].max(axis=2)
        rounding = _ROUNDINGS * EPS * np.abs(ways).sum(axis=1)
        rounding *= (np.abs(origin) + np.abs(world).max(axis=1)).max(axis=1, keepdims=True)
        self._origin[part], self._ways[part] = origin, ways
        self._low[part], self._high[part] = low - rounding, high + rounding

    def box(self) -> tuple[Floats, Floats]:
        """Lower and upper corners (k, 3) of the images."""
        return self._origin + self._low[:, :3], self._origin + self._high[:, :3]

    def may_hold(self, own: Ints, points: Floats) -> Bools:
        """(n,) whether the points (n, 3) may be images of boxes ``own`` (n,)."""
        result = np.empty(len(own), bool)
        for first in range(0, len(own), _AT_ONCE // 32):
            part = slice(first, first + _AT_ONCE // 32)
            which = own[part]
            away = np.einsum("ncw,nc->nw", self._ways[which], points[part] - self._origin[which])
            result[part] = ((away >= self._low[which]) & (away <= self._high[which])).all(axis=1)
        return result


def _boxes(places: Ints) -> Floats:
    """(k, 2, d) boxes of collapsed coordinates: number n (k, d) of 2^m (k, d) along each, the tolerance included.

    places  (k, 2 d) n, then m
    """
    number, level = np.split(places, 2, axis=1)
    width = 2.0 ** (1 - level)
    ends = np.stack([number * width - 1, (number + 1) * width - 1], axis=1)
    return np.asarray(ends * (1 + 2 * TOLERANCE))


def _widest(shape: Shape, boxes: Floats) -> Ints:
    """(k,) the direction in which boxes are widest in reference coordinates: next to a collapsed edge, not along it."""
    middle, half = boxes.mean(axis=1), 0.5 * (boxes[:, 1] - boxes[:, 0])
    widths = []
    for axis in np.eye(shape.dimension):
        ends = [uncollapse(shape, middle + sign * axis * half) for sign in (-1.0, 1.0)]
        widths.append(np.linalg.norm(ends[1] - ends[0], axis=1))
    return np.asarray(np.argmax(widths, axis=0))


def _halve(places: Ints, along: Ints) -> Ints:
    """(2 k, 2 d) the lower halves of boxes along a direction (k,) each, then the upper ones."""
    dimension, rows = places.shape[1] // 2, np.arange(len(places))
    lower = places.copy()
    lower[rows, along] *= 2
    lower[rows, dimension + along] += 1
    upper = lower.copy()
    upper[rows, along] += 1
    return np.concatenate([lower, upper])


@cache
def _places(shape: Shape) -> Floats:
    """(k, d) reference points all over a shape."""
    line = -1 + (2 * np.arange(_PLACES) + 1) / _PLACES
    eta = np.stack(np.meshgrid(*[line] * shape.dimension, indexing="ij"), axis=-1)
    return frozen_floats(uncollapse(shape, eta.reshape(-1, shape.dimension)))
