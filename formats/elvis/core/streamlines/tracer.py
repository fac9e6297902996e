"""Streamlines through curved elements of high order, integrated in the elements' own coordinates.

In an element with the map x(xi), a line follows dxi/dt = J^-1 v, with J = dx/dxi: no point has to be located.  Steps
use DOP853, with the error measured in the world, by the embedded methods and by the defect of the dense output.
Heights over the sides of an element are linear in xi, so along the dense output they are polynomials of time; the line
leaves at their first root.  The step is repeated up to there, put on the side, and handed over to the element beyond:
no step integrates across a border, where fields are not smooth.  The length is integrated with the coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, rows_by_number
from elvis.core.mapping import tangents
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Locator
from elvis.core.streamlines.dop853 import DEGREE, Step, step
from elvis.core.streamlines.endings import End
from elvis.core.streamlines.entries import ALONG, taking_up
from elvis.core.streamlines.first_roots import bernstein_at, first_roots
from elvis.core.streamlines.first_steps import first_widths
from elvis.core.streamlines.lines.steps import Limits, Piece
from elvis.core.streamlines.neighbours import Crossing, Neighbours
from elvis.core.streamlines.velocity import Motion, Velocity

#: maximum distance of a line from a side that it runs along, on its outside: inner sides, where it is handed over, and
#: outer ones
BESIDE, BESIDE_OUTER = 1e-13, 1e-10
#: a step's length in reference coordinates at most: elements are 2 wide, and fields hold little beyond
REACH = 1.0
#: places in a step where the dense output is compared with the velocity
CHECKS = (0.15, 0.4, 0.65, 0.9)
#: defect of the dense output, in tolerances: ordinary steps with an estimated error of 0.4 have defects of 10, for the
#: dense output is an order below the step; more than that shows an estimate that is small by chance
DEFECT = 24.0
#: changes of a step's width: smallest, largest, and part of what the error allows
SHRINK, GROW, SAFETY = 0.2, 5.0, 0.9
#: sides that a line may cross in succession without coming farther, as it does around a vertex
_TURNS = 64
#: the shortest step, in reference coordinates
SHORTEST = 1e-14
#: a last step up to a side shorter than this share of the step's width is rounding
ROUNDED = 1e-6
#: gaps between elements at a side that count as rounding, relative to the box
GAP = 1e-12


class Tracer:
    """Lines under way; arrays are by line.

    patch, row  (n,)    the element, -1 outside
    state       (n, s)  reference coordinates in it, the clock where the velocity has one, then the length so far
    time        (n,)    since the seed
    end         (n,)    numbers of ends (`endings`)
    """

    def __init__(
        self, velocity: Velocity, neighbours: Neighbours, locator: Locator, limits: Limits, sign: int = 1
    ) -> None:
        self.velocity, self.neighbours, self.locator = velocity, neighbours, locator
        self.limits, self.sign = limits, sign
        box = np.asarray(locator.tree.nodes[0], np.float64)
        self._size = float(np.linalg.norm(box[3:] - box[:3]))

    def place(self, patch: Ints, row: Ints, reference: Floats) -> None:
        """Begin lines at reference coordinates (n, D) of elements (n,); -1 outside all elements."""
        count = len(patch)
        self.patch, self.row = patch.copy(), row.copy()
        self.state = np.column_stack([reference, np.zeros(count)])
        self.time, self._width = np.zeros(count), np.zeros(count)
        self.end = np.where(patch < 0, End.OUTSIDE, End.GOING).astype(np.int64)
        self._slope = np.zeros_like(self.state)
        self._steps, self._turns = np.zeros((2, count), np.int64)
        self._orientation = np.zeros(count)
        self._jacobians = np.zeros((count, 3, reference.shape[1] - self.velocity.clocks))
        inside = np.flatnonzero(patch >= 0)
        motion = self._enter(inside)
        self._width[inside] = first_widths(self.velocity, patch[inside], row[inside], motion, self.limits.tolerance)

    def resume(self, lines: Ints, velocity: Velocity, clock: Floats, duration: float) -> None:
        """Go on with lines (k,) that have come to their duration, in another velocity on the same elements.

        clock     (k,) where its coordinate of time begins
        duration  at most, from the beginning on
        """
        self.velocity, self.limits = velocity, replace(self.limits, duration=duration)
        self.state[lines, -2] = clock
        self.end[lines] = End.GOING
        self._enter(lines)

    def run(self) -> Iterator[Piece]:
        """The steps of all lines until each has ended, many lines at a time."""
        while True:
            active = np.flatnonzero(self.end == End.GOING)
            if not len(active):
                return
            # stages far beyond an element may be no numbers: such steps are not accepted
            with np.errstate(all="ignore"):
                piece = self._advance(active)
            if piece is not None:
                yield piece

    def _derivative(self, active: Ints, states: Floats) -> Floats:
        """(k, s) derivatives in time of states (k, s) of some lines, wherever in their elements."""
        motion = self.velocity.motion(self.patch[active], self.row[active], states[:, :-1])
        return self._slopes(motion)

    def _slopes(self, motion: Motion) -> Floats:
        return np.column_stack([self.sign * motion.reference, motion.speed])

    def _enter(self, lines: Ints) -> Motion:
        """The motion at the current points of lines; lines that meet NaN, rest or an inverted element end."""
        motion = self.velocity.motion(self.patch[lines], self.row[lines], self.state[lines, :-1])
        self._slope[lines], self._jacobians[lines] = self._slopes(motion), motion.jacobians
        self._end_slow(lines, motion)
        self._orientation[lines] = self._orientations(motion.jacobians)
        return motion

    def _end_slow(self, lines: Ints, motion: Motion) -> None:
        """End the lines that no longer move."""
        limits, speed = self.limits, motion.speed
        is_number = np.isfinite(motion.velocity).all(axis=1)
        sound = np.isfinite(motion.reference).all(axis=1)
        cases = [~is_number, speed <= limits.rest, speed < limits.speed, ~sound]
        self._finish(lines, np.select(cases, [End.NAN, End.STAGNATION, End.SPEED, End.INVERTED], End.GOING))

    def _finish(self, lines: Ints, ends: Ints) -> None:
        """Note ends of lines that are still going."""
        still = self.end[lines] == End.GOING
        self.end[lines[still]] = ends[still]

    def _advance(self, active: Ints) -> Piece | None:
        """A step of each line, accepted if its error is within the tolerance."""
        width = self._next_width(active)
        taken = step(lambda states: self._derivative(active, states), self.state[active], self._slope[active], width)
        error = self._error(active, taken)
        promising = np.flatnonzero(error <= 1)
        lines, steps = active[promising], taken.part(promising)
        nets = steps.dense(lambda states: self._derivative(lines, states))
        error[promising] = np.maximum(error[promising], self._defect(lines, steps, nets))
        with np.errstate(divide="ignore", over="ignore"):
            factor = np.clip(SAFETY * error**-0.125, SHRINK, GROW)
        accepted = error <= 1
        self._width[active] = width * np.where(accepted, factor, np.minimum(factor, 1.0))

        # lines that can't be followed with any step size: the derivative has a pole where a map folds
        stuck = active[~accepted & (width * np.abs(self._slope[active, :-1]).max(axis=1) < SHORTEST)]
        self._finish(stuck, np.where(_is_folding(self._jacobians[stuck]), End.INVERTED, End.FAILED))
        kept = np.flatnonzero(accepted)
        if not len(kept):
            return None
        return self._keep(active[kept], taken.part(kept), nets[accepted[promising]])

    def _next_width(self, active: Ints) -> Floats:
        """(k,) widths to be tried: what bounds or the last step suggest, within an element's reach and the duration."""
        speed = np.abs(self._slope[active, :-1]).max(axis=1)
        with np.errstate(divide="ignore"):
            reach = REACH / speed
        width = np.minimum(self._width[active], reach)
        left = self.limits.duration - self.time[active]
        return np.asarray(np.minimum(width, left))

    def _error(self, active: Ints, taken: Step) -> Floats:
        """(k,) error of steps relative to the tolerance, with reference coordinates mapped to the world.

        The combination of both embedded methods is taken from DOP853.
        """
        fifth, third = (self._squares(active, error) for error in taken.errors())
        found = fifth / np.sqrt(fifth + 0.01 * third) / self.limits.tolerance
        found[(fifth == 0) & (third == 0)] = 0.0
        return np.where(np.isfinite(found), found, np.inf)

    def _defect(self, lines: Ints, taken: Step, nets: Floats) -> Floats:
        """(k,) defect of the dense output of steps (k, 8, s), relative to the value that the tolerance permits.

        The embedded methods sample the velocity through a few combinations of the stages, which wide steps can make
        small by chance.  The defect p' - f(p) at additional points is independent of these.  Its integral bounds the
        distance of the dense output p from the line up to a factor of exp(L h) (Enright, Numerical Algorithms 25,
        2000).
        """
        found = np.zeros(len(lines))
        rates = DEGREE * np.diff(nets, axis=1)
        for place in CHECKS:
            places = np.full(len(lines), place)
            slopes = self._derivative(lines, bernstein_at(nets, places))
            defect = bernstein_at(rates, places) - taken.width[:, None] * slopes
            found = np.maximum(found, self._squares(lines, defect))
        found = np.sqrt(found) / (DEFECT * self.limits.tolerance)
        return np.where(np.isfinite(found), found, np.inf)

    def _squares(self, lines: Ints, differences: Floats) -> Floats:
        """(k,) squares of differences (k, s) of states, reference coordinates mapped to the world, and the length."""
        own = differences[:, : self._jacobians.shape[2]]
        world = np.einsum("nci,ni->nc", self._jacobians[lines], own)
        return np.asarray((world**2).sum(axis=1) + differences[:, -1] ** 2)

    def _keep(self, lines: Ints, taken: Step, nets: Floats) -> Piece:
        """Go to the end of steps, or to where their dense outputs leave the elements or reach the length."""
        place, event = self._first_event(lines, nets)
        stopped = np.flatnonzero(np.isfinite(place))
        ends, slopes, widths = taken.end.copy(), taken.slopes[:, -1].copy(), taken.width.copy()
        if len(stopped):
            widths[stopped] *= place[stopped]
            self._restep(lines[stopped], taken, stopped, event[stopped], ends, slopes, widths)
        # the last step towards a side moves the end along the line, and so along the dense output
        part = np.ones(len(lines))
        part[stopped] = widths[stopped] / taken.width[stopped]
        piece = Piece(lines, self.patch[lines], self.row[lines], self.time[lines], widths, nets, part, ends)

        # lines that continue in their elements already have their derivative
        progress = ends[:, -1] - self.state[lines, -1]
        idle = progress <= GAP * self._size
        self._turns[lines] = np.where(idle, self._turns[lines] + (event >= 0), 0)
        self.state[lines], self._slope[lines] = ends, slopes
        self.time[lines] += widths
        self._steps[lines] += 1
        self._end_by_limits(lines, event)
        is_through = self._is_crossing(lines, event)
        through = np.flatnonzero(is_through)
        through = through[self.end[lines[through]] == End.GOING]
        self._leave(lines[through], event[through])
        on = lines[~is_through]
        self._inspect(on[self.end[on] == End.GOING])
        return piece

    def _first_event(self, lines: Ints, nets: Floats) -> tuple[Floats, Ints]:
        """First event in steps (k,): lines leave or reach their length.  Returns its place, inf for none, and its kind.

        Sides count from 0; -1 is nothing, -2 the length.
        """
        place, event = np.full(len(lines), np.inf), np.full(len(lines), -1)
        patch = self.patch[lines]
        for number, here in rows_by_number(patch):
            normals, offsets = self.neighbours.facets(number)
            d = normals.shape[1]
            heights = np.moveaxis(nets[here][:, :, :d] @ normals.T + offsets, 2, 1)
            heights = heights + self._room(lines[here], heights[:, :, 0], normals)[:, :, None]
            roots = first_roots(heights.reshape(-1, heights.shape[2])).reshape(heights.shape[:2])
            event[here] = np.where(np.isfinite(roots.min(axis=1)), roots.argmin(axis=1), -1)
            place[here] = roots.min(axis=1)
        if np.isfinite(self.limits.length):
            root = first_roots(self.limits.length - nets[:, :, -1])
            event[root < place] = -2
            place = np.minimum(place, root)
        return place, event

    def _room(self, lines: Ints, heights: Floats, normals: Floats) -> Floats:
        """(k, sides) how far beyond sides lines may go: nothing, unless they begin on them.

        Only a line that runs along an outer side may wander off it by more than rounding of one step.
        """
        sides = np.arange(heights.shape[1])
        outer = self.neighbours.is_outer(self.patch[lines, None], self.row[lines, None], sides[None])
        slope = self._slope[lines, : normals.shape[1]]
        along = slope @ normals.T >= -ALONG * np.abs(slope).max(axis=1, keepdims=True)
        beside = np.where(outer & along, BESIDE_OUTER, BESIDE)
        return np.where(heights <= beside, beside, 0.0)

    def _restep(
        self, lines: Ints, taken: Step, rows: Ints, event: Ints, ends: Floats, slopes: Floats, widths: Floats
    ) -> None:
        """Repeat the step up to the event, with the full order, and one Newton step towards it.

        The dense output gives the place with one order less.  The results go to ``rows`` of ``ends``, ``slopes``,
        ``widths``.
        """
        again = step(
            lambda states: self._derivative(lines, states), taken.start[rows], taken.slopes[rows, 0], widths[rows]
        )
        state, slope = again.end.copy(), again.slopes[:, -1].copy()
        gradient = np.zeros_like(state)
        missing = np.zeros(len(rows))
        for number in np.unique(self.patch[lines]):
            normals, offsets = self.neighbours.facets(int(number))
            here = np.flatnonzero((self.patch[lines] == number) & (event >= 0))
            d = normals.shape[1]
            gradient[here, :d] = normals[event[here]]
            missing[here] = -(np.einsum("ni,ni->n", gradient[here], state[here]) + offsets[event[here]])
        by_length = event == -2
        gradient[by_length, -1] = 1.0
        missing[by_length] = self.limits.length - state[by_length, -1]

        # along the line, as far as that is a matter of rounding; then straight onto the side
        rate = np.einsum("ni,ni->n", gradient, slope)
        with np.errstate(all="ignore"):
            shift = missing / rate
        shift[~(np.abs(shift) <= ROUNDED * widths[rows])] = 0.0
        state += shift[:, None] * slope
        left = missing - shift * rate
        state += (left / np.einsum("ni,ni->n", gradient, gradient))[:, None] * gradient
        ends[rows], slopes[rows] = state, slope
        widths[rows] += shift

    def _end_by_limits(self, lines: Ints, event: Ints) -> None:
        """End lines by length, duration and number of steps."""
        limits = self.limits
        done = self.time[lines] >= limits.duration * (1 - 1e-15)
        cases = [event == -2, done, self._steps[lines] >= limits.steps]
        self._finish(lines, np.select(cases, [End.LENGTH, End.DURATION, End.STEPS], End.GOING))

    def _inspect(self, lines: Ints) -> None:
        """End lines inside their elements that are at rest, or where the element is folded."""
        if not len(lines):
            return
        motion = self.velocity.motion(self.patch[lines], self.row[lines], self.state[lines, :-1])
        self._jacobians[lines] = motion.jacobians
        self._end_slow(lines, motion)
        folded = self._orientations(motion.jacobians) != self._orientation[lines]
        self._finish(lines, np.where(folded, End.INVERTED, End.GOING))

    def _leave(self, lines: Ints, side: Ints) -> None:
        """Hand lines over to the elements beyond the sides that they are on."""
        if not len(lines):
            return
        patch, row, reference = self.patch[lines], self.row[lines], self.state[lines, :-1]
        own = reference[:, : self._plane(patch[0])]
        beyond = self.neighbours.cross(patch, row, side, own)
        points = self.velocity.positions(patch, row, reference)
        turned = self._turns[lines] > _TURNS
        self._finish(lines, np.where(turned, End.JUMP, End.GOING))

        # a line that ends here keeps its place in the last element
        outer = beyond.patch < 0
        self._go_out(lines[outer], side[outer], points[outer])
        inner = np.flatnonzero(~outer & ~turned)
        if len(inner):
            self._go_in(lines[inner], beyond.part(inner), points[inner])

    def _is_crossing(self, lines: Ints, event: Ints) -> Bools:
        """(k,) whether lines that have come to a side leave by it: one that only touches it already moves inwards."""
        found = event >= 0
        for number in np.unique(self.patch[lines[found]]):
            here = np.flatnonzero(found & (self.patch[lines] == number))
            normals, _ = self.neighbours.facets(int(number))
            slope = self._slope[lines[here], : normals.shape[1]]
            found[here] = np.einsum("ni,ni->n", slope, normals[event[here]]) < 0
        return found

    def _plane(self, patch: int) -> int:
        """Number of reference coordinates of the shape, without Fourier directions."""
        return self.velocity.patches[patch].shape.dimension

    def _go_in(self, lines: Ints, to: Crossing, points: Floats) -> None:
        """Put lines, which are at world points (k, 3), into elements."""
        before = self.patch[lines].copy(), self.row[lines].copy(), self.state[lines].copy()
        orientation = self._orientation[lines].copy()
        self.patch[lines], self.row[lines] = to.patch, to.row
        self.state[lines, : to.reference.shape[1]] = to.reference
        self._mend(lines, points)
        self._enter(lines)
        turned = self._orientation[lines] != orientation
        self._finish(lines, np.where(turned, End.INVERTED, End.GOING))
        back = self._is_sent_back(lines, to.side)
        self._finish(lines, np.where(back, End.JUMP, End.GOING))

        # a line that ends at the side belongs to the element that it came from
        ended = np.isin(self.end[lines], (End.JUMP, End.INVERTED, End.NAN))
        which = lines[ended]
        self.patch[which], self.row[which] = before[0][ended], before[1][ended]
        self.state[which] = before[2][ended]

    def _mend(self, lines: Ints, points: Floats) -> None:
        """Locate world points again if an element's side deviates from the side of the element before."""
        found = self.velocity.positions(self.patch[lines], self.row[lines], self.state[lines, :-1])
        apart = np.linalg.norm(found - points, axis=1) > GAP * self._size
        for number in np.unique(self.patch[lines[apart]]):
            here = np.flatnonzero(apart & (self.patch[lines] == number))
            patch = self.velocity.patches[int(number)]
            own = points[here].copy()
            for axis, _ in patch.periods:
                own[:, axis] = 0.0
            roots = self.locator.invert(int(number), self.row[lines[here]], own)
            inside = roots.status == Status.INSIDE
            self.state[lines[here[inside]], : roots.reference.shape[1]] = roots.reference[inside]

    def _is_sent_back(self, lines: Ints, side: Ints) -> Bools:
        """(k,) whether the velocity points out again through the sides (k,) by which lines came in, -1 for none."""
        found = np.zeros(len(lines), bool)
        for number in np.unique(self.patch[lines]):
            here = np.flatnonzero((self.patch[lines] == number) & (side >= 0))
            normals, _ = self.neighbours.facets(int(number))
            slope = self._slope[lines[here], : normals.shape[1]]
            across = np.einsum("ni,ni->n", slope, normals[side[here]])
            found[here] = across < -ALONG * np.abs(slope).max(axis=1)
        return found

    def _go_out(self, lines: Ints, side: Ints, points: Floats) -> None:
        """End lines at outer sides, but for those behind which another element lies that doesn't share the side."""
        if not len(lines):
            return
        boundary = self.neighbours.boundary(self.patch[lines], self.row[lines], side)
        ends = np.where(boundary >= 0, len(End) + boundary, End.LEFT)
        unnamed = np.flatnonzero((boundary < 0) & (self.end[lines] == End.GOING))
        going_on = self._find(lines[unnamed], points[unnamed])
        ends[unnamed[going_on]] = End.GOING
        self._finish(lines, ends)

    def _orientations(self, jacobians: Floats) -> Floats:
        """(n,) sign of the map's determinant, 0 for NaN; 1 on surfaces in space."""
        if jacobians.shape[2] == 2 and self.velocity.is_oriented and not jacobians[:, 2].any():
            found = np.linalg.det(jacobians[:, :2])
        else:
            found = tangents.determinants(jacobians)
        return np.asarray(np.nan_to_num(np.sign(found)))

    def _find(self, lines: Ints, points: Floats) -> Bools:
        """(k,) whether lines go on in elements found at their points, which they then are in."""
        found = np.zeros(len(lines), bool)
        if not len(lines):
            return found
        location = self.locator.locate(points, all=True)
        line = lines[location.point]
        same = (location.patch == self.patch[line]) & (location.row == self.row[line])
        candidates = np.flatnonzero((location.status == Status.INSIDE) & ~same)
        plane = self._plane(0)
        states = self._with_waves(line, location.reference[:, :plane])
        goes_on = taking_up(self.velocity, self.neighbours, location, states, candidates, self.sign)

        # the first element that takes up a line
        chosen = candidates[goes_on]
        number, first = np.unique(location.point[chosen], return_index=True)
        chosen = chosen[first]
        found[number] = True
        if len(chosen):
            none = np.full(len(chosen), -1)
            to = Crossing(location.patch[chosen], location.row[chosen], none, states[chosen, :plane])
            self._go_in(lines[number], to, points[number])
        return found

    def _with_waves(self, lines: Ints, reference: Floats) -> Floats:
        """(k, D) reference coordinates, completed by the lines' coordinates of Fourier directions."""
        return np.concatenate([reference, self.state[lines, reference.shape[1] : -1]], axis=1)


def _is_folding(jacobians: Floats) -> Bools:
    """(n,) whether maps are so close to flat that an element folds nearby."""
    sizes = np.linalg.svd(jacobians, compute_uv=False)
    return np.asarray(sizes[:, -1] < 1e-3 * sizes[:, 0])
