"""L2 projections on the elements of a mesh, of functions that are polynomials on the elements of another mesh.

On an element K of the target the projection u_h of u satisfies int_K u_h phi = int_K u phi for all functions phi of its
space; as these contain constants, integrals over K are preserved.  The moments on the right are sums of Gauss rules on
boxes of collapsed coordinates.

- A box inside one affine element of the source has an exact rule.
- A box inside one curved element has two rules, which must agree.
- Others are bisected while the halves disagree with the whole, which finds the borders of the source's elements.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, grid_points
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.integrals.reference_cells import Piece, box_rule
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.tangents import determinants
from elvis.core.polynomials.collapse import collapse_jacobian, uncollapse
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.shapes import Shape
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.choosing import ChosenOrders
from elvis.plugins.projection.fitting import FieldFit
from elvis.plugins.transfers.box_moments import BlockBoxes, Moments, Totals, moments_of, orthonormal_spaces
from elvis.plugins.transfers.other_mesh import OtherMesh

#: disagreement of rules, as a share of values, that ends the search for borders
_GOAL = 1e-11
#: points beyond which no box is bisected, at least, and by dimension for each point of the first rules
_LEAST_POINTS = 1 << 17
_POINTS_PER_POINT = {1: 32, 2: 32, 3: 8}
#: points at a time
_AT_ONCE = 1 << 15
#: Gauss points in a direction at most, if fewer are exact on affine elements
_MOST_GAUSS = 20
#: halvings of an element at most
_MOST_HALVINGS = 24
#: by how much of a box its corners are moved inwards, so that they lie in the elements that hold the box
_INWARDS = 1e-9
#: by how much of the diagonal of its corners' box a curved box may reach beyond it
_BULGE = 0.25

#: holders of boxes: several elements, or none
_SEVERAL, _NONE = -1, -2
#: which world points (k, 3) of some of the boxes the source misses, and the values (fields, k) there
_Values = Callable[[slice, Floats], tuple[Bools, Floats]]


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
        self._left = 0
        self._first = sum(len(block) * len(self._rules(block).coarse[0]) for block in self.blocks)

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
            every = orthonormal_spaces(spaces)
            totals = Totals.none(len(block), len(modes), every)
            self._integrate(block, every, totals)
            for i, own in enumerate(spaces):
                solved = np.linalg.solve(totals.functions[own], totals.fields[own][:, i, :, None])[:, :, 0]
                found[i].append(solved @ every[own].T)
        return [
            FieldFit(field, (count,) * len(self.blocks), tuple(own))
            for field, count, own in zip(self._source.fields, modes, found, strict=True)
        ]

    def _integrate(self, block: NativeBlock, spaces: dict[Expansion, Floats], totals: Totals) -> None:
        """Add up the moments of fields and of functions."""
        d, count = block.shape.dimension, len(block)
        self._left += self._allowance(block)
        boxes = BlockBoxes(np.arange(count), np.full((count, d), -1.0), np.ones((count, d)))
        work = _BlockMoments.on(self._source, block, self._rules(block), spaces)
        whole, is_final = work.of(boxes, 0)
        measure, size, residual = whole.measure, whole.size, np.zeros(count)
        for depth in range(_MOST_HALVINGS):
            totals.add(whole, boxes.element, is_final)
            boxes, whole = boxes.part(~is_final), whole.part(~is_final)
            if not len(boxes):
                break
            parts = boxes.halved()
            finer, is_fine = work.of(parts, depth + 1)
            self._left -= len(parts) * len(work.rules.coarse[0])
            together = finer.summed(len(boxes))
            off = together.distance(whole, measure[boxes.element], size[boxes.element])
            is_open = self._are_open(block, off) & (depth + 1 < _MOST_HALVINGS)
            self.halvings = max(self.halvings, depth + 1)
            np.add.at(residual, boxes.element[~is_open], off[~is_open])
            totals.add(together, boxes.element, ~is_open)
            again = np.tile(is_open, 2**d)
            boxes, whole, is_final = parts.part(again), finer.part(again), is_fine[again]
        self._measure += float(measure.sum())
        self._missed += totals.missed
        self.residual = max(self.residual, float(residual.max()))

    def _rules(self, block: NativeBlock) -> _Rules:
        """The rules on boxes of a block."""
        order = max((field.order_on(0) or 0) for field in self._source.fields)
        return _Rules(block.shape, max(2, order), self._source.degree, block.source.order)

    def _allowance(self, block: NativeBlock) -> int:
        """Number of points for a block, besides what earlier blocks have not used."""
        first = len(block) * len(self._rules(block).coarse[0])
        return max(_LEAST_POINTS * first // self._first, _POINTS_PER_POINT[block.shape.dimension] * first)

    def _are_open(self, block: NativeBlock, off: Floats) -> Bools:
        """(n,) whether boxes are bisected further: those with the largest disagreement, as far as points are left.

        Disagreement within the goal becomes zero.
        """
        off[off <= _GOAL] = 0.0
        each = 4**block.shape.dimension * len(self._rules(block).coarse[0])
        found = np.zeros(len(off), bool)
        found[np.argsort(-off, kind="stable")[: max(0, self._left) // each]] = True
        return found & (off > 0)


@dataclass(frozen=True)
class _Rules:
    """Rules on boxes of elements of a shape: points (q, d) of [-1, 1]^d and weights (q,).

    order   of the projections
    degree  of the fields of the source
    bend    of the map of the elements
    """

    shape: Shape
    order: int
    degree: int
    bend: int

    @property
    def coarse(self) -> tuple[Floats, Floats]:
        """A rule that distinguishes all functions of the projections' spaces."""
        return box_rule(tuple((2 * self.order + power) // 2 + 1 for power in COLLAPSE[self.shape]))

    def fine(self, is_affine: bool, fewer: int = 0) -> tuple[Floats, Floats]:
        """A rule that is exact for products of the projections' functions, with each other and with fields.

        fewer  points in each direction than that, but not than on affine elements
        """
        degree = max(self.degree, self.order) + self.order + 1
        extra = 0 if is_affine else self.shape.dimension * (self.bend - 1)
        powers = COLLAPSE[self.shape]
        least = [(degree + power) // 2 + 2 for power in powers]
        full = [(degree + extra + power) // 2 + 2 - fewer for power in powers]
        return box_rule(tuple(max(low, min(high, _MOST_GAUSS)) for low, high in zip(least, full, strict=True)))


@dataclass(frozen=True, eq=False)
class _BlockMoments:
    """Moments on boxes of the elements of a block, by rules that fit the boxes.

    is_affine  (n,) which of the elements have affine maps
    """

    source: OtherMesh
    block: NativeBlock
    rules: _Rules
    spaces: dict[Expansion, Floats]
    is_affine: Bools

    @staticmethod
    def on(source: OtherMesh, block: NativeBlock, rules: _Rules, spaces: dict[Expansion, Floats]) -> _BlockMoments:
        """The moments on a block of the target."""
        patch = source.own[block.source.key]
        return _BlockMoments(source, block, rules, spaces, Piece(patch, block.rows, patch.shape).is_affine)

    def of(self, boxes: BlockBoxes, depth: int) -> tuple[Moments, Bools]:
        """The moments on boxes that were halved ``depth`` times, and which (n,) need no further halving."""
        found = Moments.none(len(boxes), len(self.source.fields), self.spaces)
        is_final = np.zeros(len(boxes), bool)
        part, row = self._holders(boxes)
        rest = [np.flatnonzero(part < 0)]
        for number, source_is_affine in enumerate(self.source.is_affine):
            held = np.flatnonzero(part == number)
            straight = source_is_affine[row[held]] & self.is_affine[boxes.element[held]]
            for is_affine, rows in ((True, held[straight]), (False, held[~straight])):
                if not len(rows):
                    continue
                moments, is_inside, is_sure = self._in_one(boxes.part(rows), number, row[rows], depth, is_affine)
                found.put(rows[is_inside], moments.part(is_inside))
                is_final[rows[is_inside]] = is_sure[is_inside]
                rest.append(rows[~is_inside])

        # boxes in several elements, or outside all of them
        others = np.concatenate(rest)
        if not len(others):
            return found, is_final
        moments = self._anywhere(boxes.part(others))
        found.put(others, moments)
        is_final[others] = (part[others] == _NONE) & (moments.missed == moments.measure)
        return found, is_final

    def _holders(self, boxes: BlockBoxes) -> tuple[Ints, Ints]:
        """(n,) the patch of the source whose element, of row (n,), holds all corners of a box.

        The patch is _SEVERAL if there is no such element, _NONE if no element is near.
        """
        d = self.block.shape.dimension
        corners = (1 - _INWARDS) * grid_points(*[[-1.0, 1.0]] * d)
        parts, rows = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for some in chunks(len(boxes), max(1, _AT_ONCE // len(corners))):
            places = self._points(boxes.part(some), corners)[0].positions
            location = self.source.locate(places)
            part, row = (each.reshape(-1, len(corners)) for each in (location.patch, location.row))
            is_one = (part == part[:, :1]).all(axis=1) & (row == row[:, :1]).all(axis=1)
            is_none = is_one & (part[:, 0] < 0)
            is_none[is_none] = ~self.source.is_near(places.reshape(-1, len(corners), 3)[is_none], _BULGE)
            parts.append(np.select([is_none, is_one & (part[:, 0] >= 0)], [_NONE, part[:, 0]], _SEVERAL))
            rows.append(row[:, 0])
        return np.concatenate(parts), np.concatenate(rows)

    def _points(self, boxes: BlockBoxes, places: Floats) -> tuple[ElementPoints, Floats]:
        """The points of places (q, d) of [-1, 1]^d in boxes, and their eta (n q, d)."""
        middle, half = (boxes.low + boxes.high) / 2, (boxes.high - boxes.low) / 2
        eta = (middle[:, None] + half[:, None] * places).reshape(-1, places.shape[1])
        patch = self.source.own[self.block.source.key]
        rows = np.repeat(self.block.rows[boxes.element], len(places))
        return ElementPoints(patch, rows, uncollapse(self.block.shape, eta)), eta

    def _in_one(
        self, boxes: BlockBoxes, number: int, rows: Ints, depth: int, is_affine: bool
    ) -> tuple[Moments, Bools, Bools]:
        """Moments on boxes in elements ``rows`` (n,) of patch ``number``.

        Also which boxes (n,) are inside these elements, and for which of them the rule is sure: it is exact where all
        maps are affine, and must agree with a smaller rule elsewhere.
        """

        def values(some: slice, places: Floats) -> tuple[Bools, Floats]:
            own = np.repeat(rows[some], len(places) // len(rows[some]))
            return self.source.in_elements(number, own, places)

        fine = self._moments(boxes, self.rules.fine(is_affine, depth), values)
        is_inside = fine.missed == 0
        if is_affine or not is_inside.any():
            return fine, is_inside, is_inside
        inside = np.flatnonzero(is_inside)
        own = rows[inside]
        rows, is_sure = own, np.zeros(len(boxes), bool)
        coarse = self._moments(boxes.part(inside), self.rules.fine(False, depth + 1), values)
        part = fine.part(inside)
        is_sure[inside] = coarse.distance(part, part.measure, part.size) <= _GOAL
        return fine, is_inside, is_sure

    def _anywhere(self, boxes: BlockBoxes) -> Moments:
        """The moments on boxes of any place, by a coarse rule."""

        def values(some: slice, places: Floats) -> tuple[Bools, Floats]:
            location, found = self.source.at(places)
            return location.status != Status.INSIDE, found

        return self._moments(boxes, self.rules.coarse, values)

    def _moments(self, boxes: BlockBoxes, rule: tuple[Floats, Floats], values: _Values) -> Moments:
        """The moments on boxes by one rule each."""
        places, weights = rule
        parts = []
        for some in chunks(len(boxes), max(1, _AT_ONCE // len(places))):
            own = boxes.part(some)
            points, eta = self._points(own, places)
            scale = np.prod((own.high - own.low) / 2, axis=1)
            measure = determinants(points.jacobians) * collapse_jacobian(self.block.shape, eta)
            measure = measure.reshape(len(own), -1) * weights * scale[:, None]
            is_missed, found = values(some, points.positions)
            by_box = found.reshape(len(found), len(own), -1)
            parts.append(moments_of(self.spaces, points.points, measure, by_box, is_missed.reshape(measure.shape)))
        return Moments.joined(parts)
