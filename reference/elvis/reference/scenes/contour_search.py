"""Contours on a plane, each segment with a radius that contains the true line, by bisection of boxes of elements.

In a box, t in [-1, 1]^d, equations f (the quantity minus its value; for solids also the height above the plane) and the
position q in the picture are

    f(t) = f0 + A t + r(t), |r| <= rho        q(t) = q0 + B t + e(t), |e| <= sigma

Let G be the pseudoinverse of A and k the direction in its kernel.  All zeros then lie at t = s k - G (f0 + r): their
distance from the line q0 - B G f0 + s B k is at most |B G| rho + sigma.  For each s with |s k - G f0| + |G| rho <= 1
there is a zero: the map y -> -f0 - r(G y + s k) takes a box of y into itself (Brouwer).  Boxes are bisected until the
radius is small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate
from elvis.reference.scenes.boxes import OVER, Boxes, nodes
from elvis.reference.scenes.equations import Equation, Linear
from elvis.reference.solids import map_lattice
from elvis.scene import Plane
from elvis.scene.cameras.view import View
from elvis.scene.model.time_limit import check_time

#: radius of a segment in pixels; radius of a segment without a proved zero, and number of bisections, at which it is
#: given up
_RADIUS, _THIN, _HALVINGS = 0.003, 2.0**-16, 64
#: elements whose boxes are bisected together; boxes at once beyond which small ones, and all, aren't bisected any more
_CHUNK, _FEW, _MOST = 32, 1 << 9, 1 << 16


@dataclass(frozen=True, eq=False)
class LineSegments(Rows):
    """Line segments of contours in a picture, in columns and rows.

    ends    (k, 2, 2)  every zero of a box is within the radius of the line between these
    sure    (k, 2, 2) within the radius of each point between these there is one; NaN if none is proved
    radius  (k,)
    """

    ends: Floats
    sure: Floats
    radius: Floats

    @classmethod
    def joined(cls, several: Sequence[LineSegments]) -> LineSegments:
        """Several as one; there may be none."""
        return super().joined([LineSegments(np.empty((0, 2, 2)), np.empty((0, 2, 2)), np.empty(0)), *several])


@dataclass(frozen=True, eq=False)
class Search:
    """A quantity's value on the elements of a patch, in one view.

    degrees  of fields and map in each collapsed coordinate
    fields   fields of the patch in the equation, by name
    plane    plane of the cut for solids; None for plane data
    half_width    pixels around the picture that are included
    """

    patch: Patch
    equation: Equation
    degrees: tuple[int, ...]
    fields: dict[str, int]
    view: View
    plane: Plane | None
    half_width: float

    def segments(self) -> LineSegments:
        """All segments of the contour."""
        count = len(self.patch) if self.equation.leaves else 0
        rows = [np.arange(first, min(first + _CHUNK, count)) for first in range(0, count, _CHUNK)]
        return LineSegments.joined([segment for some in rows for segment in self._halve(self._boxes(some))])

    def _boxes(self, rows: Ints) -> Boxes:
        """Whole elements: their fields, then x, y and z."""
        points = uncollapse(self.patch.shape, nodes(self.degrees))
        values = []
        for number in self.fields.values():
            expansion, coefficients = self.patch.fields[number], self.patch.coefficients[number]
            if expansion is None or coefficients is None:
                values.append(np.full((len(rows), len(points)), np.nan))
                continue
            values.append(evaluate(expansion, coefficients[rows], points))
        world = map_lattice(self.patch, rows, points)
        return Boxes.through(np.stack([*values, *np.moveaxis(world, 2, 0)], axis=1), self.degrees)

    def _halve(self, boxes: Boxes) -> list[LineSegments]:
        """The segments in some boxes, which are bisected as often as needed."""
        found = []
        for depth in range(_HALVINGS + 1):
            boxes, segment, done, halves = self._looked_at(boxes)
            done |= (depth == _HALVINGS) | (len(boxes) > _MOST)
            found.append(segment.part(done))
            left = [(axis, np.flatnonzero(~done & (halves == axis))) for axis in range(len(self.degrees))]
            parts = [boxes.part(which).halves(axis) for axis, which in left if len(which)]
            if not parts:
                break
            boxes = Boxes.joined(parts)
        return found

    def _looked_at(self, boxes: Boxes) -> tuple[Boxes, LineSegments, Bools, Ints]:
        """The boxes that may hold a zero, their segments, whether these suffice, and directions for bisection."""
        check_time()
        equations, possible = self._equations(boxes)
        place = self._place(boxes)
        possible &= self._is_near(*place.around)
        for own in equations:
            possible &= ~(np.abs(own.value) > np.abs(own.gradient).sum(axis=1) + own.rest)
        kept = np.flatnonzero(possible)
        boxes = boxes.part(kept)
        equations = [_part(own, kept) for own in equations]
        place = place.part(kept)
        segment, solved, there = _solve(equations, place)
        segment, whole = _whole_where_unsolved(segment, solved, place)
        done = segment.radius <= np.where(whole, _THIN, _RADIUS)

        # boxes of this size show where a line may be; a large number of them proves its existence no better than a few
        small = there & whole & (segment.radius <= _RADIUS)
        done |= small & (small.sum() > _FEW)
        chosen = np.flatnonzero(there)
        return boxes.part(chosen), segment.part(there), done[there], self._directions(boxes, place)[there]

    def _equations(self, boxes: Boxes) -> tuple[list[Linear], Bools]:
        """The equations on boxes, and where they may hold together."""
        unit = np.eye(boxes.series.shape[1])
        names = list(self.fields)
        numbers = [
            names.index(leaf.name) if leaf.op == "field" else len(names) + leaf.axes[0] for leaf in self.equation.leaves
        ]
        first, possible = self.equation.on([boxes.combined(unit[number]) for number in numbers])
        if self.plane is None:
            return [first], possible.copy()
        normal = self.plane.basis()[2]
        weights = np.concatenate([np.zeros(len(names)), normal])
        return [first, boxes.combined(weights, -float(normal @ np.asarray(self.plane.point)))], possible.copy()

    def _place(self, boxes: Boxes) -> Place:
        """The position of the boxes in the picture."""
        lead = np.zeros((3, len(self.fields)))
        rows = np.concatenate([lead, self.view.to_pixel[:, :3]], axis=1)
        constants = self.view.to_pixel[:, 3]
        over = boxes.combined(rows[2], constants[2])
        before = over.value > np.abs(over.gradient).sum(axis=1) + over.rest
        middle, lifted = np.zeros((len(boxes), 2)), []
        for k in range(2):
            above = boxes.combined(rows[k], constants[k]).value
            middle[:, k] = np.divide(above, over.value, out=middle[:, k], where=before)
            weights = rows[k] - middle[:, k, None] * rows[2]
            lifted.append(boxes.combined(weights, constants[k] - middle[:, k] * constants[2]))
        return Place(middle, (lifted[0], lifted[1]), over, before)

    def _is_near(self, middle: Floats, steps: Floats, rest: Floats) -> Bools:
        """(k,) boxes that may be in the picture or near it."""
        span = np.abs(steps).sum(axis=2) + rest
        last = np.array([self.view.width, self.view.height]) - 1
        return np.asarray(~((middle + span < -self.half_width) | (middle - span > last + self.half_width)).any(axis=1))

    def _directions(self, boxes: Boxes, place: Place) -> Ints:
        """(k,) direction in which bisection helps: the least bisected one of those in which the series are not linear.

        Otherwise the longest.

        Bisection towards a collapsed edge only would repeat the same situation.
        """
        powers, length = boxes.powers, np.abs(place.around[1]).sum(axis=1)
        bent = np.zeros_like(length)
        for number in range(boxes.series.shape[1]):
            terms = np.abs(boxes.series[:, number])
            total = terms[:, 1:].sum(axis=1) + 1e-300
            exact = number >= len(self.fields) or self._is_plain
            counted = boxes.beyond_linear(terms) if exact else terms
            for axis in range(powers.shape[1]):
                bent[:, axis] += counted[:, powers[:, axis] > 0].sum(axis=1) / total
        most = bent.max(axis=1)
        least_halved = np.where(bent > 0.1 * most[:, None], boxes.halved, 1 << 30).argmin(axis=1)
        return np.asarray(np.where(most * length.max(axis=1) < 0.1 * _THIN, length.argmax(axis=1), least_halved))

    @property
    def _is_plain(self) -> bool:
        """Whether the equation is linear in its fields, so that its series are."""
        root = self.equation.root
        return "field" in (root.op, root.operands[0].op if root.op == "-" else "")


@dataclass(frozen=True, eq=False)
class Place:
    """Position of boxes in the picture: q = q0 + (N - q0 W) / W.

    middle  (k, 2)  q0
    lifted  N - q0 W, for columns and for rows
    over    W
    before  (k,) whether all of a box is in front of the eye; otherwise nothing is known
    """

    middle: Floats
    lifted: tuple[Linear, Linear]
    over: Linear
    before: Bools

    def part(self, which: Ints) -> Place:
        """Some of the boxes."""
        lifted = _part(self.lifted[0], which), _part(self.lifted[1], which)
        return Place(self.middle[which], lifted, _part(self.over, which), self.before[which])

    @cached_property
    def around(self) -> tuple[Floats, Floats, Floats]:
        """q0 (k, 2), steps (k, 2, d) and a bound (k, 2) of all else, on whole boxes."""
        weight = np.where(self.before, self.over.value, 1.0)
        room = np.abs(self.over.gradient).sum(axis=1) + self.over.rest
        least = np.where(self.before, self.over.value - room, 1.0)
        gradient = np.stack([own.gradient for own in self.lifted], axis=1)
        rest = np.stack([own.rest for own in self.lifted], axis=1)
        variation = np.abs(gradient).sum(axis=2) + rest
        rest = (rest + variation * (room / least)[:, None]) / weight[:, None]
        rest = np.where(self.before[:, None], rest, np.inf)
        return self.middle, np.where(self.before[:, None, None], gradient / weight[:, None, None], 0.0), rest

    def along(self, base: Floats, way: Floats, half: Floats, aside: Floats) -> tuple[Floats, Floats, Floats]:
        """q (k, 2) at base (k, d), its step (k, 2) for one along a way (k, d), and a bound (k, 2) of all else.

        half   (k,) largest share of the way that is gone
        aside  (k, d, m) columns whose combinations with numbers in [-1, 1] are added to the way
        """
        forms = (*self.lifted, self.over)
        value, step, rest = (np.empty((len(base), 3)) for _ in range(3))
        for k, own in enumerate(forms):
            value[:, k] = own.value + np.einsum("ki,ki->k", own.gradient, base)
            step[:, k] = np.einsum("ki,ki->k", own.gradient, way)
            rest[:, k] = np.abs(np.einsum("ki,kim->km", own.gradient, aside)).sum(axis=1) + own.rest
        room = np.abs(step[:, 2]) * half + rest[:, 2]
        known = self.before & (value[:, 2] > room)
        weight, least = np.where(known, value[:, 2], 1.0)[:, None], np.where(known, value[:, 2] - room, 1.0)[:, None]

        # the numerator again, now without the part that vanishes at the base
        shift = value[:, :2] / weight
        step, rest = step[:, :2] - shift * step[:, 2:], rest[:, :2] + np.abs(shift) * rest[:, 2:]
        deviation = rest / least + np.abs(step) * half[:, None] * room[:, None] / (weight * least)
        return self.middle + shift, step / weight, np.where(known[:, None], deviation, np.inf)


def _part(own: Linear, which: Ints) -> Linear:
    return Linear(own.value[which], own.gradient[which], own.rest[which])


def _solve(equations: list[Linear], place: Place) -> tuple[LineSegments, Bools, Bools]:
    """Line segments of boxes; whether the equations determine their directions; and whether a box may hold a zero."""
    size = [np.abs(own.gradient).sum(axis=1) + 1e-300 for own in equations]
    value, rest = (
        np.stack([getattr(own, name) / weight for own, weight in zip(equations, size, strict=True)], axis=1)
        for name in ("value", "rest")
    )
    gradient = np.stack([own.gradient / weight[:, None] for own, weight in zip(equations, size, strict=True)], axis=1)
    unseen = np.cross(gradient[:, 0], gradient[:, 1]) if len(equations) == 2 else gradient[:, 0, ::-1] * [-1.0, 1.0]
    greatest = np.abs(unseen).max(axis=1, keepdims=True)
    solved = (greatest[:, 0] > 1e-9) & np.isfinite(rest).all(axis=1)
    solved &= place.before
    gradient, rest = np.where(solved[:, None, None], gradient, 0.0), np.where(solved[:, None], rest, 0.0)
    unseen = np.where(solved[:, None], unseen / np.maximum(greatest, 1e-300), 0.0)
    inverse = np.linalg.pinv(gradient, rcond=1e-12)
    base = np.einsum("kim,km->ki", inverse, value)
    around = np.einsum("kim,km->ki", np.abs(inverse), rest)
    # a zero that is so near to a box's end that it isn't proved is farther inside of the next box
    told = (around < 0.5 * OVER).all(axis=1)
    first, last = _shares(base, unseen, 1.0 + around)
    inner = _shares(base, unseen, 1.0 - around)

    # in the picture, from the middle of the line
    start, half = 0.5 * (first + last), 0.5 * (last - first)
    middle, along, deviation = place.along(start[:, None] * unseen - base, unseen, half, inverse * rest[:, None])
    ends, sure = (
        np.stack([middle + (share - start)[:, None] * along for share in shares], axis=1)
        for shares in ((first, last), inner)
    )
    sure[~(solved & (inner[0] <= inner[1]))] = np.nan
    return LineSegments(ends, sure, np.linalg.norm(deviation, axis=1)), solved & told, ~solved | (first <= last)


def _shares(base: Floats, unseen: Floats, room: Floats) -> tuple[Floats, Floats]:
    """(k,) smallest and largest s with |s unseen - base| <= room in all coordinates; low > high where none is."""
    with np.errstate(all="ignore"):
        one, other = (base - room) / unseen, (base + room) / unseen
    flat = np.abs(unseen) < 1e-300
    out = np.where(np.abs(base) > room, np.inf, -np.inf)
    low = np.where(flat, out, np.minimum(one, other)).max(axis=1)
    high = np.where(flat, -out, np.maximum(one, other)).min(axis=1)
    none = (room < 0).any(axis=1)
    return np.where(none, 1.0, np.clip(low, -4.0, 4.0)), np.where(none, -1.0, np.clip(high, -4.0, 4.0))


def _whole_where_unsolved(segment: LineSegments, solved: Bools, place: Place) -> tuple[LineSegments, Bools]:
    """The segments.

    Unsolved ones and ones larger than their boxes are replaced by the whole boxes; (k,) marks these.
    """
    middle, step, rest = place.around
    lengths = np.linalg.norm(step, axis=1)
    longest = lengths.argmax(axis=1)
    along = np.take_along_axis(step, longest[:, None, None], axis=2)[..., 0]
    deviation = lengths.sum(axis=1) - lengths.max(axis=1) + np.linalg.norm(rest, axis=1)
    whole = np.stack([middle - along, middle + along], axis=1)
    worse = ~solved | ~(segment.radius < deviation + lengths.max(axis=1))
    ends = np.where(worse[:, None, None], whole, segment.ends)
    radius = np.where(worse, deviation, segment.radius)
    sure = np.where(worse[:, None, None], np.nan, segment.sure)
    return LineSegments(ends, sure, radius), worse
