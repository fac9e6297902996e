"""Bounds of the errors of rules on level sets and on the parts that they cut out of boxes.

On each part between breaks the integrand times the measure is an analytic function of three coordinates, of two on
surfaces, so that `analytic_error` holds: discs (`level_discs`) bound it on Bernstein ellipses.  If that isn't proved,
the greatest value on the box times the greatest volume or area bounds the integral and what a rule says of it.

A line along direction k meets g = 0 at most as often as its degree D_k, unless it lies in it.  So the integral of |n_k|
over the surface is at most D_k in the unit cube, and its image no larger than the sum of these times the greatest areas
of faces.

Rounding decides where g is zero.  The volume between is at most band / |dg/dk| of a box.  A point of a surface moves so
far along k: an analytic G with |G - c| <= M for |t| <= r changes by 2 M |t| / r at most (lemma of Schwarz).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.errors import ElvisError
from elvis.core.integrals.analytic_error import FURTHER, Bounds, gauss_factors
from elvis.core.integrals.degrees import DegreeRules
from elvis.core.integrals.graph_discs import RHOS, SHIFT, GraphParts, PartDiscs, graph_parts
from elvis.core.integrals.graph_orders import greatest
from elvis.core.integrals.level_boxes import LevelBoxes
from elvis.core.integrals.level_discs import CellNets, LevelDiscs, is_bounded
from elvis.core.quantities import discs
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.discs import Disc
from elvis.core.quantities.tree import Node, world_derivative


@dataclass(frozen=True, eq=False)
class LevelRules:
    """What bounds of integrals over levels are made from.

    rules       of the piece that the elements are in
    attributes  of elements
    exact       Gauss points along k that integrate all expressions exactly; None where there is no such rule
    """

    rules: DegreeRules
    attributes: Attributes
    exact: int | None = None

    def gradient(self, zero: Node, is_filled: bool) -> tuple[Node, ...]:
        """The gradient of a polynomial, empty where it isn't needed or no discs are known of it."""
        if is_filled:
            return ()
        try:
            found = tuple(world_derivative(zero, axis) for axis in range(3))
        except ElvisError:
            return ()
        return found if all(is_bounded(part, self.rules, is_filled) for part in found) else ()

    def bounds(self, boxes: LevelBoxes, roots: Sequence[Node], counts: Sequence[int]) -> Bounds:
        """Bounds of integrals over boxes by the rule with ``counts`` points between breaks each way."""
        d, e = len(counts), len(roots)
        errors = np.full((len(boxes), e, d, len(FURTHER)), np.inf)
        low, high, moved = np.zeros((3, len(boxes), e))
        cells = CellNets(boxes.patch, boxes.rows, boxes.cell, self.rules.names)
        with np.errstate(all="ignore"):
            for order in sorted(set(map(tuple, boxes.order.tolist()))):
                here = np.flatnonzero((boxes.order == order).all(axis=1))
                own = _Boxes(self, boxes, here, order, cells)
                known = own.bounds(roots, counts)
                errors[here], low[here], high[here], moved[here] = known.errors, known.low, known.high, known.moved
        return Bounds(errors, low, high, moved)


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Boxes ``index`` (n,) whose axes i, j, k have one order."""

    level: LevelRules
    boxes: LevelBoxes
    index: Ints
    order: tuple[int, ...]
    cells: CellNets

    def bounds(self, roots: Sequence[Node], counts: Sequence[int]) -> Bounds:
        """See `LevelRules`."""
        boxes, is_filled = self.boxes.part(self.index), self.boxes.is_filled
        nets = boxes.nets.transpose(0, *(1 + axis for axis in self.order))
        whole = self._discs(np.arange(len(boxes)), nets, PartDiscs.whole(len(boxes)), False)
        parts = self._parts(nets, boxes)
        directions = tuple(range(3 - boxes.patch.shape.dimension, 3))[: len(counts)]
        near = PartDiscs.of(nets[parts.box], parts, directions, is_filled)
        found = self._discs(parts.box, nets[parts.box], near, True)
        measure = _measure(found, near, parts, is_filled)
        columns = [self._of_root(root, found, measure, whole, parts, counts, boxes) for root in roots]
        return Bounds(*(np.stack(column, axis=1) for column in zip(*columns, strict=True)))

    def _parts(self, nets: Floats, boxes: LevelBoxes) -> GraphParts:
        """The parts over which integrals go, of boxes whose ends are proved."""
        parts = graph_parts(nets)
        is_there = (parts.has_root | parts.is_below) if boxes.is_filled else parts.has_root
        return parts.part(is_there & boxes.is_proved[parts.box])

    def _discs(self, box: Ints, nets: Floats, parts: PartDiscs, are_normals_known: bool) -> LevelDiscs:
        """Discs on parts of boxes."""
        own, order = self.index[box], list(self.order)
        low, size = self.boxes.low[own][:, order], (self.boxes.high - self.boxes.low)[own][:, order]
        rows, zero = self.boxes.rows[own], self.boxes.zero
        known = self.cells, self.level.rules, self.level.attributes
        gradient = () if zero is None else self.level.gradient(zero, self.boxes.is_filled)
        return LevelDiscs(*known, own, rows, low, size, self.order, nets, gradient, parts, are_normals_known)

    def _of_root(
        self,
        root: Node,
        found: LevelDiscs,
        measure: Disc,
        whole: LevelDiscs,
        parts: GraphParts,
        counts: Sequence[int],
        boxes: LevelBoxes,
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Errors (n, d, s), least and greatest integral (n,) and what moving g changes (n,), of an expression."""
        product = discs.times(found.disc(root), measure)
        middle = np.abs(np.broadcast_to(product[0], (len(parts), 1)))[:, 0]
        radius = np.where(found.parts.is_proved & np.isfinite(middle)[:, None], product[1], np.inf)
        by_part = _analytic(radius, counts, self.level.exact)
        errors = _summed(by_part, parts.box, len(boxes))
        errors[~boxes.is_proved] = np.inf
        low, high, most = _enclosure(whole, root, boxes)
        moved = _moved(boxes, whole, most)
        if not boxes.is_filled:
            # the surface between its ends
            by_part = 2 * radius[:, -1] / SHIFT * 2.0 ** len(counts)
            own = boxes.shift * _summed(by_part[:, None], parts.box, len(boxes))[:, 0]
            is_met = np.bincount(parts.box, minlength=len(boxes)) > 0
            moved = moved + np.where((boxes.shift <= SHIFT) | ~is_met, own, np.inf)
        errors[~np.isfinite(moved) & boxes.is_proved] = np.inf
        return errors, low, high, np.where(np.isfinite(moved), moved, 0.0)


def _measure(found: LevelDiscs, near: PartDiscs, parts: GraphParts, is_filled: bool) -> Disc:
    """Volume or area for each unit of [-1, 1]^d."""
    d = found.rules.piece.patch.shape.dimension
    along_i = (parts.high - parts.low)[:, None] / 2 if d == 3 else np.ones((len(parts), 1))
    across = discs.times((along_i, np.float64(0.0)), near.stretches[0])
    if is_filled:
        return discs.times(discs.times(across, near.stretches[1]), found.volume)
    return discs.times(across, found.area)


def _analytic(radius: Floats, counts: Sequence[int], exact: int | None) -> Floats:
    """(n, d, s) the part of each direction in the errors of rules, from the radii (n, columns) of an integrand.

    On real points the integral and the rule differ by the diameter at most.
    """
    d = len(counts)
    factors = np.stack([gauss_factors([count + more for more in FURTHER], RHOS) for count in counts])
    on_ellipses = radius[:, 1:-1].reshape(len(radius), d, 1, len(RHOS))
    errors = np.where(np.isfinite(on_ellipses), on_ellipses * factors, np.inf).min(axis=3)
    errors = np.minimum(errors, 4 * radius[:, :1, None]) * 2.0 ** (d - 1)
    if exact is not None:
        errors[:, -1] = 0.0
    return np.asarray(errors)


def _summed(values: Floats, box: Ints, count: int) -> Floats:
    """(count, ...) sums over parts of boxes."""
    found = np.zeros((count, *values.shape[1:]))
    np.add.at(found, box, values)
    return found


def _enclosure(whole: LevelDiscs, root: Node, boxes: LevelBoxes) -> tuple[Floats, Floats, Floats]:
    """Least and greatest integral (n,) over boxes, and the greatest magnitude of the integrand."""
    low, high = whole.interval(root)
    most = np.maximum(-low, high)
    if not boxes.is_filled:
        extent = _extent(whole, boxes)
        return -most * extent, most * extent, most
    middle, radius = (part[:, 0] for part in np.broadcast_arrays(*whole.volume))
    largest = np.abs(middle) + radius
    least = np.where(boxes.is_whole & ~boxes.is_lost, np.maximum(np.abs(middle) - radius, 0.0), 0.0)
    ends = low * np.where(low < 0, largest, least), high * np.where(high > 0, largest, least)
    return np.where(np.isnan(ends[0]), -np.inf, ends[0]), np.where(np.isnan(ends[1]), np.inf, ends[1]), most


def _extent(whole: LevelDiscs, boxes: LevelBoxes) -> Floats:
    """(n,) how large the surface in each box may be."""
    longest, d = whole.longest, boxes.patch.shape.dimension
    degrees = np.array(whole.levels.shape[4 - d :]) - 1
    faces = [np.delete(longest, axis, axis=1).prod(axis=1) for axis in range(d)]
    own = np.asarray(sum(degree * face for degree, face in zip(degrees, faces, strict=True)))
    return np.where(boxes.several > 0, own * boxes.several, 0.0) + boxes.further


def _moved(boxes: LevelBoxes, whole: LevelDiscs, most: Floats) -> Floats:
    """(n,) what moving g changes of integrals, for surfaces at their ends alone.

    The area for each unit of i and j is |cof(X) grad g| / |g_k|.
    """
    if boxes.is_filled:
        middle, radius = (part[:, 0] for part in np.broadcast_arrays(*whole.volume))
        share = np.minimum(boxes.shift, 1.0)
        return np.where(share > 0, share * (np.abs(middle) + radius) * most, 0.0)
    d = boxes.patch.shape.dimension
    faces = [np.delete(whole.longest, axis, axis=1).prod(axis=1) for axis in range(d)]
    slopes = [np.diff(whole.levels, axis=axis) * (whole.levels.shape[axis] - 1) for axis in range(4 - d, 4)]
    last = slopes[-1]
    steep = np.maximum(last.min(axis=(1, 2, 3)), -last.max(axis=(1, 2, 3)))
    area = sum(face * greatest(own) for face, own in zip(faces, slopes, strict=True)) / steep
    return np.where(boxes.share > 0, boxes.share * area * most, 0.0)
