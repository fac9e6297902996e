"""L2 projections on the elements of a mesh, of functions that are polynomials on the elements of another mesh.

On an element K of the target the projection u_h of u satisfies int_K u_h phi = int_K u phi for all functions phi of its
space; as these contain constants, integrals over K are preserved.  The moments on the right are sums of Gauss rules on
boxes of collapsed coordinates.  A box inside one affine element of the source has an exact rule; others are subdivided
while the halves disagree with the whole, which finds the borders of the source's elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.dataset import Dataset, Expansion
from elvis.core.integrals.reference_cells import Piece, box_rule
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.tangents import determinants
from elvis.core.polynomials.boxnets import all_half_boxes
from elvis.core.polynomials.collapse import collapse_jacobian, uncollapse
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.expansion import values as mode_values
from elvis.core.quantities.element_points import ElementPoints
from elvis.plugins.other_mesh import OtherMesh
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.choosing import ChosenOrders
from elvis.plugins.projection.fitting import FieldFit

#: disagreement of rules, as a share of values, that is rounding, and that ends the search for borders
_ROUNDING, _GOAL = 1e-13, 1e-9
#: points beyond which no box is bisected, at least and for each point of the first rules; points at a time
_LEAST_POINTS, _POINTS_PER_POINT, _AT_ONCE = 1 << 17, 32, 1 << 15
#: Gauss points in a direction at most
_MOST_GAUSS = 20
#: halvings of an element at most
_MOST_HALVINGS = 24
#: by how much of a box its corners are moved inwards, so that they lie in the elements that hold the box
_INWARDS = 1e-9


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Boxes of eta in elements (n,) of a block: ends (n, d)."""

    element: Ints
    low: Floats
    high: Floats

    def __len__(self) -> int:
        return len(self.element)

    def take(self, chosen: Ints | Bools | slice) -> _Boxes:
        return _Boxes(self.element[chosen], self.low[chosen], self.high[chosen])

    def halved(self) -> _Boxes:
        """The halves in all directions, far apart for one box: half k of box i is number k n + i."""
        low, high = all_half_boxes(self.low, self.high)
        return _Boxes(np.tile(self.element, 2 ** self.low.shape[1]), low, high)


class ElementProjection:
    """The projections of all fields on the elements of a target.

    covered   the share of its measure that the source covers
    halvings  of boxes at most
    residual  disagreement of rules in the end, as a share of an element's integral
    """

    def __init__(self, source: OtherMesh, target: Dataset) -> None:
        self._source = source
        self.blocks = [own for own in ChosenOrders.of(source, source.fields, True).plan.blocks if len(own)]
        self.halvings, self.residual = 0, 0.0
        self._measure = self._missed = 0.0
        first = sum(len(block) * len(self._rule(block)[0]) for block in self.blocks)
        self._left = max(_LEAST_POINTS, _POINTS_PER_POINT * first)

    @property
    def measure(self) -> float:
        """The target's area or volume."""
        return self._measure

    @property
    def covered(self) -> float:
        """See the class."""
        return 1 - self._missed / self._measure if self._measure else 0.0

    def fitted(self) -> list[FieldFit]:
        """The projections; fields of lower order use only the functions of their order."""
        orders = [field.order_on(0) or 0 for field in self._source.fields]
        modes = [max(2, order + 1) for order in orders]
        found: list[list[Floats]] = [[] for _ in modes]
        for block in self.blocks:
            spaces = [block.expansion(count) for count in modes]
            every = _spaces(spaces)
            totals = _Totals.none(len(block), len(modes), every)
            self._integrate(block, every, totals)
            for i, own in enumerate(spaces):
                solved = np.linalg.solve(totals.functions[own], totals.fields[own][:, i, :, None])[:, :, 0]
                found[i].append(solved @ every[own].T)
        return [
            FieldFit(field, (count,) * len(self.blocks), tuple(own))
            for field, count, own in zip(self._source.fields, modes, found, strict=True)
        ]

    def _integrate(self, block: NativeBlock, spaces: dict[Expansion, Floats], totals: _Totals) -> None:
        """Add up the moments of fields and of functions."""
        d, count = block.shape.dimension, len(block)
        boxes = _Boxes(np.arange(count), np.full((count, d), -1.0), np.ones((count, d)))
        whole = self._moments(block, spaces, boxes)
        measure, size, residual = whole.measure, whole.size, np.zeros(count)
        for depth in range(_MOST_HALVINGS):
            inside = self._are_inside(block, boxes)
            totals.add(whole, boxes.element, inside)
            boxes, whole = boxes.take(~inside), whole.take(~inside)
            if not len(boxes):
                break
            parts = boxes.halved()
            self._left -= len(parts) * len(self._rule(block)[0])
            finer = self._moments(block, spaces, parts)
            together = finer.summed(len(boxes))
            off = together.distance(whole, measure[boxes.element], size[boxes.element])
            is_open = (off > (_GOAL if depth else _ROUNDING)) & (self._left > 0) & (depth + 1 < _MOST_HALVINGS)
            self.halvings = max(self.halvings, depth + 1)
            np.add.at(residual, boxes.element[~is_open], off[~is_open])
            totals.add(together, boxes.element, ~is_open)
            again = np.tile(is_open, 2**d)
            boxes, whole = parts.take(again), finer.take(again)
        self._measure += float(measure.sum())
        self._missed += totals.missed
        self.residual = max(self.residual, float(residual[residual > 64 * _ROUNDING].max(initial=0.0)))

    def _rule(self, block: NativeBlock) -> tuple[Floats, Floats]:
        """Points (q, d) and weights (q,) on [-1, 1]^d, exact on affine elements for polynomials."""
        own = max((field.order_on(0) or 0) for field in self._source.fields)
        bend = block.shape.dimension * (block.source.order - 1)
        degree = self._source.degree + max(2, own + 1) + bend
        counts = tuple(min((degree + power) // 2 + 2, _MOST_GAUSS) for power in COLLAPSE[block.shape])
        return box_rule(counts)

    def _points(self, block: NativeBlock, boxes: _Boxes, places: Floats) -> tuple[ElementPoints, Floats]:
        """The points of places (q, d) of [-1, 1]^d in boxes, and their eta (n q, d)."""
        middle, half = (boxes.low + boxes.high) / 2, (boxes.high - boxes.low) / 2
        eta = (middle[:, None] + half[:, None] * places).reshape(-1, places.shape[1])
        patch = self._source.own[block.source.key]
        rows = np.repeat(block.rows[boxes.element], len(places))
        return ElementPoints(patch, rows, uncollapse(block.shape, eta)), eta

    def _are_inside(self, block: NativeBlock, boxes: _Boxes) -> Bools:
        """(n,) boxes of affine elements that lie in one affine element of the source, convex as that is."""
        d = block.shape.dimension
        corners = (1 - _INWARDS) * np.stack(np.meshgrid(*[[-1.0, 1.0]] * d, indexing="ij"), axis=-1).reshape(-1, d)
        patch = self._source.own[block.source.key]
        is_affine = Piece(patch, np.arange(len(patch)), patch.shape).is_affine[block.rows[boxes.element]]
        found = np.zeros(len(boxes), bool)
        for some in chunks(len(boxes), max(1, _AT_ONCE // len(corners))):
            own = boxes.take(some)
            location = self._source.locate(self._points(block, own, corners)[0].positions)
            part, row = (each.reshape(len(own), -1) for each in (location.patch, location.row))
            is_one = (part == part[:, :1]).all(axis=1) & (row == row[:, :1]).all(axis=1) & (part[:, 0] >= 0)
            holder = [k >= 0 and self._source.is_affine[k][r] for k, r in zip(part[:, 0], row[:, 0], strict=True)]
            found[some] = is_one & np.array(holder, bool)
        return found & is_affine

    def _moments(self, block: NativeBlock, spaces: dict[Expansion, Floats], boxes: _Boxes) -> _Moments:
        """The moments on boxes by one rule each."""
        places, weights = self._rule(block)
        parts = []
        for some in chunks(len(boxes), max(1, _AT_ONCE // len(places))):
            own = boxes.take(some)
            points, eta = self._points(block, own, places)
            scale = np.prod((own.high - own.low) / 2, axis=1)
            measure = determinants(points.jacobians) * collapse_jacobian(block.shape, eta)
            measure = measure.reshape(len(own), -1) * weights * scale[:, None]
            location, values = self._source.at(points.positions)
            is_missed = (location.status != Status.INSIDE).reshape(measure.shape)
            values = values.reshape(len(values), len(own), -1)
            parts.append(_moments_of(spaces, points.points, measure, values, is_missed))
        return _Moments.concatenated(parts, spaces)


def _spaces(spaces: Sequence[Expansion]) -> dict[Expansion, Floats]:
    """Distinct expansions, each with the matrix (m, m) that makes its functions orthonormal on the reference shape."""
    found: dict[Expansion, Floats] = {}
    for own in spaces:
        if own in found:
            continue
        counts = tuple(max(own.modes) + power for power in COLLAPSE[own.shape])
        eta, weights = box_rule(counts)
        table = mode_values(own, uncollapse(own.shape, eta))
        root = np.sqrt(weights * collapse_jacobian(own.shape, eta))
        found[own] = np.linalg.inv(np.linalg.qr(root[:, None] * table, mode="r"))
    return found


@dataclass(frozen=True, eq=False)
class _Moments:
    """Moments on n boxes.

    fields     (n, fields, m) by space
    functions  (n, m, m) of the space's own functions
    measure    (n,) of the boxes
    missed     (n,) the part of it that the source doesn't cover
    size       (n, fields) integrals of magnitudes
    """

    fields: dict[Expansion, Floats]
    functions: dict[Expansion, Floats]
    measure: Floats
    missed: Floats
    size: Floats

    @staticmethod
    def concatenated(parts: Sequence[_Moments], spaces: dict[Expansion, Floats]) -> _Moments:
        fields = {own: np.concatenate([part.fields[own] for part in parts]) for own in spaces}
        functions = {own: np.concatenate([part.functions[own] for part in parts]) for own in spaces}
        columns = (np.concatenate([getattr(part, name) for part in parts]) for name in ("measure", "missed", "size"))
        return _Moments(fields, functions, *columns)

    def take(self, chosen: Ints | Bools) -> _Moments:
        fields = {own: value[chosen] for own, value in self.fields.items()}
        functions = {own: value[chosen] for own, value in self.functions.items()}
        return _Moments(fields, functions, self.measure[chosen], self.missed[chosen], self.size[chosen])

    def summed(self, count: int) -> _Moments:
        """The sums over the halves of each of ``count`` boxes."""

        def total(own: Floats) -> Floats:
            return np.asarray(own.reshape(-1, count, *own.shape[1:]).sum(axis=0))

        fields = {own: total(value) for own, value in self.fields.items()}
        functions = {own: total(value) for own, value in self.functions.items()}
        return _Moments(fields, functions, total(self.measure), total(self.missed), total(self.size))

    def distance(self, other: _Moments, measure: Floats, size: Floats) -> Floats:
        """(n,) the largest difference, as a share of the measure (n,) and the size (n, fields) of elements."""
        scale = np.maximum(size, 1e-300)[:, :, None]
        found = [np.abs(value - other.fields[own]) / scale for own, value in self.fields.items()]
        found += [
            np.abs(value - other.functions[own]) / measure[:, None, None] for own, value in self.functions.items()
        ]
        # in a box that the source covers in part, this share of the missed part is in doubt
        found.append(np.minimum(self.missed, self.measure - self.missed) / measure)
        # values that are not numbers stay so, however often boxes are bisected
        every = [np.nan_to_num(own.reshape(len(own), -1), nan=0.0).max(axis=1, initial=0.0) for own in found]
        return np.asarray(np.max(every, axis=0))


@dataclass(eq=False)
class _Totals:
    """Moments of fields (n, fields, m) and of functions (n, m, m) on n elements, by space, and the measure missed."""

    fields: dict[Expansion, Floats]
    functions: dict[Expansion, Floats]
    missed: float = 0.0

    @staticmethod
    def none(count: int, many: int, spaces: dict[Expansion, Floats]) -> _Totals:
        sizes = {own: mode_count(own) for own in spaces}
        fields = {own: np.zeros((count, many, size)) for own, size in sizes.items()}
        return _Totals(fields, {own: np.zeros((count, size, size)) for own, size in sizes.items()})

    def add(self, found: _Moments, element: Ints, chosen: Bools) -> None:
        """Add the moments of chosen boxes to the moments of their elements (boxes,)."""
        rows = np.flatnonzero(chosen)
        self.missed += float(found.missed[rows].sum())
        for own in self.fields:
            np.add.at(self.fields[own], element[rows], found.fields[own][rows])
            np.add.at(self.functions[own], element[rows], found.functions[own][rows])


def _moments_of(
    spaces: dict[Expansion, Floats], points: Floats, measure: Floats, values: Floats, is_missed: Bools
) -> _Moments:
    """Moments from weights (n, q) and values (fields, n, q) at reference points (n q, d), some of which are outside."""
    fields, functions = dict[Expansion, Floats](), dict[Expansion, Floats]()
    for own, matrix in spaces.items():
        table = (mode_values(own, points) @ matrix).reshape(*measure.shape, -1)
        weighted = table * measure[:, :, None]
        fields[own] = np.einsum("fnq,nqm->nfm", values, weighted)
        functions[own] = np.einsum("nqk,nqm->nkm", table, weighted, optimize=True)
    size = np.einsum("fnq,nq->nf", np.abs(values), measure)
    missed = np.where(is_missed, measure, 0.0).sum(axis=1)
    return _Moments(fields, functions, measure.sum(axis=1), missed, size)
