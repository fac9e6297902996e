"""Bounds of the errors of rules on level sets and on the parts that they cut out of boxes.

On each part between breaks, the integrand times the measure is an analytic function of three coordinates (two on
surfaces).  The theorem of `analytic_error` then applies: discs (`levels.discs`) bound the function on Bernstein
ellipses.  If analyticity isn't proved, the largest value on the box times the largest volume or area bounds the
integral and the result of a rule.

A line along direction k meets g = 0 at most as often as its degree D_k, unless it lies in it.  The integral of |n_k|
over the surface is therefore at most D_k in the unit cube, and the image is not larger than the sum of these times the
largest areas of faces.

Rounding determines the zeros of g.  The volume in doubt is at most band / |dg/dk| of a box.  A point of a surface moves
by this distance along k: an analytic G with |G - c| <= M for |t| <= r changes by at most 2 M |t| / r (Schwarz lemma).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.integrals.analytic_error import FURTHER, Bounds, gauss_factors
from elvis.core.integrals.degrees import DegreeRules
from elvis.core.integrals.graph_discs import MOVED, RHOS, GraphParts, PartDiscs, graph_parts
from elvis.core.integrals.graph_orders import greatest, turned
from elvis.core.integrals.levels.boxes import LevelBoxes
from elvis.core.integrals.levels.discs import CellNets, LevelDiscs, is_bounded
from elvis.core.integrals.tree_discs import integral_between
from elvis.core.quantities import discs
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.discs import Disc
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node, ordered, world_derivative

#: relative change by moving g, above which bounds on whole cells are too coarse
_COARSE = 1e-10


@dataclass(frozen=True, eq=False)
class LevelRules:
    """The sources of bounds of integrals over levels.

    rules       of the piece that the elements are in
    attributes  of elements
    cells       nets of leaves on the cells that contain the boxes
    exact       Gauss points along k that integrate all expressions exactly; None without an exact rule
    """

    rules: DegreeRules
    attributes: Attributes
    cells: CellNets
    exact: int | None = None

    def gradient(self, zero: Node | None) -> tuple[Node, ...]:
        """The gradient of a polynomial of coordinates; empty for others, whose own derivatives have smaller discs.

        The gradient of a plane is constant on curved elements.  The gradient of a field takes the derivatives of the
        map, and a quotient of two of its parts has a large disc: both vary, but they vary alike.
        """
        if zero is None or any(node.op == "field" for node in ordered(zero)):
            return ()
        try:
            found = tuple(world_derivative(zero, axis) for axis in range(3))
        except ElvisError:
            return ()
        return found if all(is_bounded(part, self.rules, False) for part in found) else ()

    def bounds(self, boxes: LevelBoxes, roots: Sequence[Node], counts: Sequence[int]) -> tuple[Bounds, Floats]:
        """Bounds of integrals over boxes by the rule with ``counts`` points between breaks, and guesses (n, e)."""
        with np.errstate(all="ignore"):
            return _Boxes(self, boxes, self.cells.index(boxes.rows, boxes.cell)).bounds(roots, counts)


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Boxes (n,), and numbers (n,) of their cells."""

    level: LevelRules
    boxes: LevelBoxes
    cell: Ints

    def bounds(self, roots: Sequence[Node], counts: Sequence[int]) -> tuple[Bounds, Floats]:
        """See `LevelRules`."""
        boxes, is_filled = self.boxes, self.boxes.is_filled
        nets = turned(boxes.nets, boxes.order)
        parts = self._parts(nets)
        directions = tuple(range(3 - boxes.patch.shape.dimension, 3))[: len(counts)]
        near = PartDiscs.of(nets[parts.box], parts, directions, is_filled)
        found = self._discs(parts.box, near)
        measure = _measure(found, near, parts)
        columns = [self._of_root(root, found, measure, parts, counts) for root in roots]
        errors, moved, about = (np.stack(column, axis=1) for column in zip(*columns, strict=True))
        known = Bounds(errors, np.full_like(moved, -np.inf), np.full_like(moved, np.inf), moved)
        changes = self._of_moves(known, roots, nets, about)
        is_known = np.isfinite(changes)
        known.moved[:] += np.where(is_known, changes, 0.0)
        errors[~is_known & boxes.is_proved[:, None]] = np.inf
        return known, about

    def _of_moves(self, known: Bounds, roots: Sequence[Node], nets: Floats, about: Floats) -> Floats:
        """(n, e) changes by moving g; boxes that need a closer look also get bounds of their integrals."""
        boxes, cells = self.boxes, self.level.cells
        largest = np.stack([_largest(cells.interval(root))[self.cell] for root in roots], axis=1)
        longest = cells.longest[self.cell] * (boxes.high - boxes.low)
        changes = _changes(boxes, nets, np.take_along_axis(longest, boxes.order, axis=1), largest)
        is_coarse = ~(changes <= _COARSE * np.abs(about)).all(axis=1)
        rest = np.flatnonzero(is_coarse | ~np.isfinite(known.errors).all(axis=(1, 2, 3)))
        changes[rest] = self._enclose(known, roots, rest, nets)
        return changes

    def _parts(self, nets: Floats) -> GraphParts:
        """The parts over which integrals go, of boxes whose ends are proved."""
        parts, boxes = graph_parts(nets), self.boxes
        is_there = (parts.has_root | parts.is_below) if boxes.is_filled else parts.has_root
        return parts.part(is_there & boxes.is_proved[parts.box])

    def _discs(self, box: Ints, parts: PartDiscs) -> LevelDiscs:
        """Discs on parts of boxes."""
        order, rows = self.boxes.order[box], self.boxes.rows[box]
        low, high = (np.take_along_axis(own[box], order, axis=1) for own in (self.boxes.low, self.boxes.high))
        known = self.level.cells, self.level.rules, self.level.attributes, self.cell[box]
        gradient = () if parts.tilts is None else self.level.gradient(self.boxes.zero)
        return LevelDiscs(*known, rows, low, high - low, order, parts, gradient)

    def _of_root(
        self, root: Node, found: LevelDiscs, measure: Disc, parts: GraphParts, counts: Sequence[int]
    ) -> tuple[Floats, Floats, Floats]:
        """Errors (n, d, s) of an expression, by how much rounding moves the integral, and about what that is (n,)."""
        boxes = self.boxes
        product = discs.times(found.density(root), measure)
        middle = np.broadcast_to(product[0], (len(parts), 1))[:, 0]
        radius = np.where(found.parts.is_proved & np.isfinite(middle)[:, None], product[1], np.inf)
        errors = _summed(_analytic(radius, counts, self.level.exact), parts.box, len(boxes))
        errors[~boxes.is_proved] = np.inf
        about = _summed(np.nan_to_num(middle, posinf=0.0, neginf=0.0) * 2.0 ** len(counts), parts.box, len(boxes))
        moved = np.zeros(len(boxes))
        if not boxes.is_filled:
            # the surface between its ends
            by_part = _changes_of_moved(boxes.shift[parts.box], found.parts.shifts, radius[:, -MOVED:])
            moved = _summed(by_part[:, None] * 2.0 ** len(counts), parts.box, len(boxes))[:, 0]
        errors[~np.isfinite(moved) & boxes.is_proved] = np.inf
        return errors, np.where(np.isfinite(moved), moved, 0.0), about

    def _enclose(self, known: Bounds, roots: Sequence[Node], rest: Ints, nets: Floats) -> Floats:
        """Set what integrals over some boxes lie between; (n, e) what moving g changes, from values on the boxes."""
        boxes = self.boxes.part(rest)
        largest = np.zeros((len(rest), len(roots)))
        if not len(rest):
            return largest
        whole = self._discs(rest, PartDiscs.whole(len(rest)))
        for column, root in enumerate(roots):
            ends = whole.interval(root)
            known.low[rest, column], known.high[rest, column] = _enclosure(whole, ends, boxes, nets[rest])
            largest[:, column] = _largest(ends)
        return _changes(boxes, nets[rest], whole.longest, largest)


def _largest(interval: Interval) -> Floats:
    """The largest magnitude in an interval."""
    return np.asarray(np.maximum(-interval[0], interval[1]))


def _measure(found: LevelDiscs, near: PartDiscs, parts: GraphParts) -> Disc:
    """The factor from volume or area per unit of i, j and k to volume or area per unit of [-1, 1]^d."""
    d = found.rules.piece.patch.shape.dimension
    along_i = (parts.high - parts.low)[:, None] / 2 if d == 3 else np.ones((len(parts), 1))
    across = discs.times((along_i, np.float64(0.0)), near.stretches[0])
    return across if near.tilts is not None else discs.times(across, near.stretches[1])


def _changes_of_moved(shift: Floats, shifts: Floats, radii: Floats) -> Floats:
    """(n,) changes of integrands of moved surfaces by the Schwarz lemma; inf if unknown.

    shift          (n,) by how much rounding moves surfaces
    shifts, radii  (n, MOVED) larger movements, and the radii of integrands then
    """
    changes = 2 * shift[:, None] / shifts * radii
    is_known = (shift[:, None] <= shifts) & ~np.isnan(changes)
    return np.asarray(np.where(is_known, changes, np.inf).min(axis=1))


def _analytic(radius: Floats, counts: Sequence[int], exact: int | None) -> Floats:
    """(n, d, s) the part of each direction in the errors of rules, from the radii (n, columns) of an integrand.

    On real points the integral and the rule differ by the diameter at most.
    """
    d = len(counts)
    factors = np.stack([gauss_factors([count + more for more in FURTHER], RHOS) for count in counts])
    on_ellipses = radius[:, 1:-MOVED].reshape(len(radius), d, 1, len(RHOS))
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


def _enclosure(whole: LevelDiscs, ends: Interval, boxes: LevelBoxes, nets: Floats) -> Interval:
    """Smallest and largest integral (n,) over boxes, from smallest and largest values of the integrand."""
    if not boxes.is_filled:
        most = _largest(ends) * _extent(whole, boxes, nets)
        return -most, most
    middle, radius = (part[:, 0] for part in np.broadcast_arrays(*whole.volume))
    largest = np.abs(middle) + radius
    least = np.where(boxes.is_whole & ~boxes.is_lost, np.maximum(np.abs(middle) - radius, 0.0), 0.0)
    return integral_between(ends, least, largest)


def _extent(whole: LevelDiscs, boxes: LevelBoxes, nets: Floats) -> Floats:
    """(n,) how large the surface in each box may be."""
    d = boxes.patch.shape.dimension
    degrees = np.array(nets.shape[4 - d :]) - 1
    own = np.asarray(sum(degree * face for degree, face in zip(degrees, _faces(whole.longest), strict=True)))
    own = np.where(boxes.is_lost, own, np.fmin(own, _graph_area(nets, whole.longest)))
    return np.where(boxes.several > 0, own * boxes.several, 0.0) + boxes.further


def _graph_area(nets: Floats, lengths: Floats) -> Floats:
    """(n,) how large a graph k(i, j) in boxes with sides up to lengths (n, d) may be.

    The area per unit of i and j is |cof(X) grad g| / |g_k|.
    """
    d = lengths.shape[1]
    slopes = [np.diff(nets, axis=axis) * (nets.shape[axis] - 1) for axis in range(4 - d, 4)]
    last = slopes[-1]
    steep = np.maximum(last.min(axis=(1, 2, 3)), -last.max(axis=(1, 2, 3)))
    most = sum(face * greatest(own) for face, own in zip(_faces(lengths), slopes, strict=True))
    return np.where(steep > 0, most / np.where(steep > 0, steep, 1.0), np.inf)


def _faces(longest: Floats) -> list[Floats]:
    """Areas (n,) of faces across each axis at most, for lengths (n, d) of boxes along these."""
    return [np.delete(longest, axis, axis=1).prod(axis=1) for axis in range(longest.shape[1])]


def _changes(boxes: LevelBoxes, nets: Floats, longest: Floats, largest: Floats) -> Floats:
    """(n, e) changes of integrals of integrands up to (n, e) by moving g; for surfaces, only at their ends.

    nets     (n, Di, Dj, Dk) of g
    longest  (n, 3) or (n, d) maximum lengths of dx/di, dx/dj and dx/dk
    """
    d = boxes.patch.shape.dimension
    lengths = longest[:, -d:]
    if boxes.is_filled:
        share = np.minimum(boxes.shift, 1.0)
        most = lengths.prod(axis=1)
    else:
        share = boxes.share
        most = _graph_area(nets, lengths)
    return np.where((share > 0)[:, None], (share * most)[:, None] * largest, 0.0)
