"""Sums over pieces: one exact rule, or rules with bounded errors on bisected boxes.

If an integrand is not a polynomial, each box of eta has one Gauss rule.  Its error is bounded by the integrand's range
on complex neighbourhoods of the box (`analytic_error`).  If that fails, as at a pole, the minimum and maximum on the
box bound it.  Elements are cut along kinks and jumps that are level sets (`kinks`).  Boxes with the largest bounds get
better rules, or are bisected in the directions with the largest share.  This ends when the sum of all bounds is below
the requested error, or the points are used up.

Some integrands have no bounds, such as distances and fields with Fourier directions.  For these, three rules are
compared, and their differences give an estimate of the error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from elvis.core.base.arrays import EPS, Bools, Floats, Ints
from elvis.core.base.terminal import Progress
from elvis.core.base.threads import results
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.along_curves import CurvePiece, along_curve
from elvis.core.integrals.analytic_error import FURTHER, Bounds, bounds
from elvis.core.integrals.box_discs import BoxDiscs, is_bounded
from elvis.core.integrals.degrees import DegreeRules
from elvis.core.integrals.eta_boxes import EtaBoxes, lattice_counts
from elvis.core.integrals.groups import (
    CALL,
    CALL_ON_LEVELS,
    Bounded,
    Boxes,
    BoxIntegrals,
    Compared,
    Counts,
    Group,
    Sums,
    by_owner,
    compared_counts,
    gathered,
    with_fewer_rules,
)
from elvis.core.integrals.kinks import Cut, branches
from elvis.core.integrals.levels.boxes import LevelBoxes
from elvis.core.integrals.levels.discs import CellNets
from elvis.core.integrals.levels.discs import is_bounded as is_bounded_on_level
from elvis.core.integrals.levels.error import LevelRules
from elvis.core.integrals.levels.of_elements import LevelPiece
from elvis.core.integrals.reference_cells import Piece
from elvis.core.mapping.patch import Patch
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import LEAVES, Node, ordered, other_of

#: points evaluated at once, and boxes whose bounds are computed at once
_BATCH = 1 << 16
_BOUNDED_AT_ONCE = 1 << 11
#: points that may be taken to bring errors down
_MOST = 1 << 22
#: Gauss points in a direction where rules are compared: at most at first, and by how many all are raised once
_MOST_COUNTS = 12
_RAISED = 3
#: factor from the differences of rules to an estimate
_SAFETY = 8.0
#: estimated error on boxes without bounds, relative to the integral of the absolute value there
_UNBOUNDED = 8.0
#: rounding of a sum, relative to its magnitude, and of measures per unit of a map's condition
_ROUNDING, _LENGTHS = 8 * EPS, EPS
#: factor for the larger rounding of values of another dataset, whose places are roots
_LOCATED = 16.0
#: points each way on a box of a surface
_ON_SURFACES = 3


class _Batch(NamedTuple):
    """Integrals over some boxes, places where expressions have no value, and, where they are requested, bounds."""

    integrals: BoxIntegrals
    missing: dict[int, Floats]
    bounds: Bounds | None = None
    gains: Floats | None = None


class Summation:
    """Integrals of expressions, which an evaluator knows, over pieces of its dataset.

    error      requested error, relative to the integral of the absolute value
    precision  factor by which the rounding of expressions is below the rounding of their terms, 1 if not given
    most       maximum number of points for reducing errors
    progress   receives the number of points evaluated, and the number planned
    reached    receives the largest error reached, relative to the integral of the absolute value
    best_effort  whether an interrupt ends the refinement with the current result
    is_signed  whether elements count with the sign of their Jacobian
    """

    def __init__(
        self,
        dataset: Dataset,
        evaluator: Evaluator,
        expressions: Sequence[Expression],
        error: float,
        precision: Sequence[float] = (),
        most: int | None = None,
        progress: Progress | None = None,
        reached: Callable[[float], object] | None = None,
        best_effort: bool = False,
        is_signed: bool = False,
    ) -> None:
        self._is_signed = is_signed and dataset.mesh.space == dataset.mesh.dimension
        self._progress, self._done, self._planned = progress, 0, 0
        self._reached, self._best_effort = reached, best_effort
        #: whether refinement was interrupted
        self.is_unfinished = False
        self._most = _MOST if most is None else most
        self._dataset, self._evaluator, self._error = dataset, evaluator, error
        self._cuts: dict[int, Cut] = {}
        self._expressions = tuple(self._with_branches(expressions))
        #: number of the expression of which each expression is a branch
        self._owners = self._owners_of(len(expressions))
        self._names_others = [any(map(other_of, each.attributes)) for each in self._expressions]
        further = np.where(self._names_others, _LOCATED, 1.0)
        self._roundings = further * np.array(precision or np.ones(len(expressions)))[self._owners]
        self._places: dict[int, Floats] = {}

    def over(self, pieces: Sequence[Piece | LevelPiece | CurvePiece]) -> Sums:
        """The integrals over some pieces together."""
        self._places = {}
        total = Sums.none(len(self._expressions))
        rough: list[Group] = []
        for whole in pieces:
            if isinstance(whole, CurvePiece):
                total += self._along(whole)
                continue
            held = self._held(whole.patch)
            level = whole if isinstance(whole, LevelPiece) else None
            for piece, rules in self._alike(whole.piece if isinstance(whole, LevelPiece) else whole) if held else ():
                part = piece
                if level is not None:
                    found, below = self._on_level(replace(level, piece=piece), rules, held)
                    rough += found
                    part = piece.part(below if level.is_filled else below[:0])
                own, known = self._on_piece(part, rules, held)
                rough += own
                total += known
        total += self._refined(rough, total.magnitude)
        return replace(gathered(total, self._owners), places=self._places)

    def _with_branches(self, expressions: Sequence[Expression]) -> Iterator[Expression]:
        """Expressions, and behind them the branches of those with kinks."""
        yield from expressions
        first = len(expressions)
        for number, expression in enumerate(expressions):
            found = branches(expression.root)
            if len(found) > 1:
                self._cuts[number] = Cut.of(expression, number, first, found)
                first += len(found)
                yield from (Expression(expression.text, branch.root) for branch in found)

    def _owners_of(self, count: int) -> Ints:
        return np.array([*range(count), *(cut.whole for cut in self._cuts.values() for _ in cut.numbers)], np.int64)

    def _on_piece(self, piece: Piece, rules: DegreeRules, numbers: list[int]) -> tuple[list[Group], Sums]:
        """Groups with the results of rules for expressions on a piece, and sums by exact rules.

        Expressions with kinks are cut along these.
        """
        rough, total = list[Group](), Sums.none(len(self._expressions))
        if not len(piece):
            return rough, total
        is_cut = {own: own in self._cuts and self._cuts[own].is_known(rules, self._evaluator) for own in numbers}
        for some, counts in self._by_counts([own for own in numbers if not is_cut[own]], rules):
            if counts is None:
                rough += self._rough(piece, rules, some)
            else:
                total += self._exact(piece, some, counts)
        for own in (own for own in numbers if is_cut[own]):
            boxes, whole = self._cuts[own].parts(piece, self._evaluator, *self._sizes(piece, [own]))
            for number, each in boxes:
                rough += self._on_boxes(each, rules, [number])
            for number, rows in whole:
                further, known = self._on_piece(piece.part(rows), rules, [number])
                rough += further
                total += known
        return rough, total

    def _by_counts(self, held: list[int], rules: DegreeRules) -> Iterator[tuple[list[int], Counts | None]]:
        """Numbers of expressions that have the same exact rule, or none, and its points in each direction."""
        counts = [rules.counts(self._expressions[number]) for number in held]
        for own in dict.fromkeys(counts):
            yield [number for number, other in zip(held, counts, strict=True) if other == own], own

    def _along(self, whole: CurvePiece) -> Sums:
        """The integrals along a curve."""
        count = len(self._owners) - sum(len(cut.numbers) for cut in self._cuts.values())
        found = along_curve(whole, self._evaluator, self._expressions[:count], self._error)
        if found.place is not None:
            self._places.update({number: found.place for number in range(count) if found.beyond[number] > 0})
        total = Sums.none(len(self._owners))
        for name in ("value", "error", "rounding", "magnitude", "measure", "beyond"):
            getattr(total, name)[:count] = getattr(found, name)
        total.is_exact[:count] = total.is_bound[:count] = False
        return total

    def _on_level(self, whole: LevelPiece, rules: DegreeRules, numbers: list[int]) -> tuple[list[Group], Ints]:
        """Groups with the results of rules for expressions on a surface in elements, or below it.

        And the elements of the piece that are below.
        """
        sizes, parts = self._sizes(whole.piece, numbers)
        own = whole.piece, self._evaluator, sizes, parts, whole.is_filled, rules.is_valid
        every, below = whole.level.boxes(*own)
        found: list[Group] = []
        for boxes in every:
            found += self._on_boxes(boxes, rules, numbers)
        return found, below

    def _on_boxes(self, boxes: LevelBoxes, rules: DegreeRules, numbers: list[int]) -> Iterator[Group]:
        """Groups with the results of rules for expressions on boxes.

        Exact rules for polynomials on elements also apply to whole boxes.
        """
        counts = (_ON_SURFACES,) * boxes.dimension
        roots = [self._expressions[number].root for number in numbers]
        enough = self._enough(rules, numbers) if boxes.is_filled else None
        is_inner = boxes.is_whole & ~boxes.is_lost
        if enough is not None and is_inner.any():
            yield self._known(boxes.part(is_inner), numbers, (enough,) * len(counts))
            boxes = boxes.part(~is_inner)
        boxes = replace(boxes, enough=enough)
        columns = [is_bounded_on_level(root, rules, boxes.is_filled) for root in roots] if len(boxes) else []
        for own in dict.fromkeys(columns):
            index = [column for column, other in enumerate(columns) if other == own]
            some = replace(boxes, sizes=boxes.sizes[:, index], rounding=boxes.rounding[:, index])
            chosen = [numbers[column] for column in index]
            if own:
                nets = CellNets(some.patch, some.rows, some.cell, rules)
                yield from self._enclosed(some, LevelRules(rules, self._evaluator.attributes, nets, enough), chosen)
            else:
                yield self._compared(some.finished(), chosen, counts, False)

    def _enough(self, rules: DegreeRules, numbers: list[int]) -> int | None:
        """Gauss points in each direction, of cells or of eta, that integrate all expressions exactly; None: no rule."""
        every = [rules.counts(self._expressions[own]) for own in numbers]
        known = [max(counts) for counts in every if counts is not None]
        return max(known, default=1) if len(known) == len(every) else None

    def _held(self, patch: Patch) -> list[int]:
        """The numbers of expressions all of whose fields a patch has."""
        known = {name for name, own in zip(self._evaluator.names, patch.fields, strict=True) if own is not None}
        wanted = np.flatnonzero(self._owners == np.arange(len(self._owners))).tolist()
        return [number for number in wanted if known.issuperset(self._expressions[number].fields)]

    def _alike(self, piece: Piece) -> Iterator[tuple[Piece, DegreeRules]]:
        """Parts of a piece whose elements are all affine, or all flat, or all neither, or may be folded."""
        if self._is_signed and not piece.is_side:
            piece = replace(piece, is_signed=True)
        names, affine = self._evaluator.names, piece.is_affine
        bent = piece.part(~affine)
        valid = np.ones(len(bent), bool) if piece.is_signed or not len(bent) else bent.is_valid(self._dataset)
        has_normals = piece.is_side or not piece.patch.is_flat
        flat = bent.is_flat if len(bent) and has_normals else np.zeros(len(bent), bool)
        kinds = [(piece.part(affine), True, True, True)]
        kinds += [(bent.part(valid & (flat == own)), False, own, True) for own in (True, False)]
        kinds += [(bent.part(~valid), False, False, False)]
        for part, is_affine, is_flat, is_valid in kinds:
            if len(part):
                yield part, DegreeRules(part, names, is_affine, is_flat, is_valid)

    def _whole(self, piece: Piece, numbers: list[int]) -> EtaBoxes:
        """All of a piece, for some expressions."""
        sizes, parts = self._sizes(piece, numbers)
        return EtaBoxes.whole(piece, sizes * parts[:, None])

    def _sizes(self, piece: Piece, numbers: list[int]) -> tuple[Floats, Floats]:
        """Magnitudes (n, e) of expressions in the middles of a piece's elements, and in what parts they are rounded."""
        middle = ElementPoints(piece.patch, piece.rows, piece.points(np.zeros((len(piece), piece.dimension))))
        found = self._evaluator.sizes_at([self._expressions[number] for number in numbers], middle)
        sizes = [np.nan_to_num(np.broadcast_to(size, len(piece))) for size in found]
        return np.stack(sizes, axis=1) * self._roundings[numbers], _ROUNDING + _LENGTHS * piece.conditions(
            middle.jacobians
        )

    def _exact(self, piece: Piece, numbers: list[int], counts: Counts) -> Sums:
        """The integrals by a rule that is exact."""
        boxes = self._whole(piece, numbers)
        total = self._known(boxes, numbers, counts).sums(len(self._expressions))
        total.is_exact[:] = True
        return total

    def _known(self, boxes: Boxes, numbers: list[int], counts: Counts) -> Group:
        """The result of an exact rule."""
        self._planned += _points(boxes, [counts])
        found = self._integrate(boxes, numbers, counts)
        nothing = np.zeros_like(found.value)
        return Group(boxes, numbers, counts, found, nothing, nothing == 0, nothing)

    def _rough(self, piece: Piece, rules: DegreeRules, numbers: list[int]) -> Iterator[Group]:
        """Groups for expressions without an exact rule on a piece, with bounded errors and others separate."""
        roots = [self._expressions[number].root for number in numbers]
        # bounds take the measure for positive
        are_bounded = [not piece.is_signed and is_bounded(root, rules) for root in roots]
        for own in dict.fromkeys(are_bounded):
            some = [number for number, other in zip(numbers, are_bounded, strict=True) if other == own]
            boxes = self._whole(piece, some)
            yield (
                self._bounded(boxes, rules, some) if own else self._compared(boxes, some, _rough_counts(piece), False)
            )

    def _enclosed(self, boxes: LevelBoxes, rules: LevelRules, numbers: list[int]) -> Iterator[Bounded]:
        """Boxes that a surface cuts, with bounds of the errors of rules; where these are known none is applied yet."""
        counts, steps = (_ON_SURFACES,) * boxes.dimension, (0,) * boxes.dimension
        roots = [self._expressions[number].root for number in numbers]
        parts = [boxes.part(slice(first, first + _BOUNDED_AT_ONCE)) for first in range(0, len(boxes), _BOUNDED_AT_ONCE)]
        found = list(results(partial(rules.bounds, part, roots, counts) for part in parts))
        if not found:
            return
        known = Bounds.joined([own for own, _ in found])
        about = np.concatenate([own for _, own in found])
        nothing = np.zeros_like(about)
        guess = BoxIntegrals(about, np.abs(about), nothing, nothing)
        error, is_bound = _error(known, guess, steps)
        gains = np.ones((len(boxes), len(counts)))
        every = Bounded(
            boxes, numbers, counts, guess, error, is_bound, known.moved, rules, steps, known, gains, is_guess=True
        )
        # without bounds, points show whether there are values at all
        is_known = np.isfinite(known.errors).all(axis=(1, 2, 3)) | all(map(_has_values, roots))
        if is_known.any():
            yield every.part(is_known)
        if not is_known.all():
            yield self._raised(every.part(~is_known), steps)

    def _bounded(self, boxes: EtaBoxes, rules: DegreeRules, numbers: list[int]) -> Bounded:
        """The result of one rule for expressions on boxes, with bounds of its error and of better rules' errors."""
        counts = lattice_counts(boxes.piece)
        self._planned += _points(boxes, [counts])
        size = min(_BOUNDED_AT_ONCE, max(1, _BATCH // int(np.prod(counts))))
        found = list(self._batches(boxes, size, numbers, counts, rules))
        integrals = BoxIntegrals.joined([own.integrals for own in found])
        known = Bounds.joined([own.bounds for own in found if own.bounds is not None])
        gains = np.concatenate([own.gains for own in found if own.gains is not None])
        steps = (0,) * len(counts)
        error, is_bound = _error(known, integrals, steps)
        return Bounded(boxes, numbers, counts, integrals, error, is_bound, known.moved, rules, steps, known, gains)

    def _raised(self, old: Bounded, steps: tuple[int, ...]) -> Bounded:
        """The boxes evaluated by rules with more points."""
        counts = tuple(count + FURTHER[step] for count, step in zip(old.least, steps, strict=True))
        self._planned += _points(old.boxes, [counts])
        integrals = self._integrate(old.boxes, old.numbers, counts)
        error, is_bound = _error(old.bounds, integrals, steps)
        return replace(
            old, counts=counts, steps=steps, integrals=integrals, error=error, is_bound=is_bound, is_guess=False
        )

    def _compared(self, boxes: Boxes, numbers: list[int], counts: Counts, is_raised: bool) -> Compared:
        """The results of several rules for expressions on boxes."""
        every = compared_counts(counts)
        self._planned += _points(boxes, every)
        *lesser, best = (self._integrate(boxes, numbers, own) for own in every)
        error = np.asarray(_SAFETY * np.max([np.abs(best.value - own.value) for own in lesser], axis=0), np.float64)
        error[~(error > boxes.rounding * best.measure)] = 0.0
        moved = np.zeros_like(error)
        if isinstance(boxes, LevelBoxes):
            error, moved = error + boxes.lost, boxes.moved
        return Compared(boxes, numbers, counts, best, error, np.zeros(error.shape, bool), moved, is_raised)

    def _improved(self, old: Group, allowed: Floats) -> list[Group]:
        """Groups with better rules or smaller boxes, so that errors become less than allowed (k,) where possible."""
        if isinstance(old, Bounded):
            return [*self._improved_bounds(old, allowed[old.numbers])]
        assert isinstance(old, Compared)
        if old.is_raised:
            return [self._compared(old.boxes.halves(), old.numbers, old.counts, True)]
        return [self._compared(old.boxes, old.numbers, tuple(count + _RAISED for count in old.counts), True)]

    def _improved_bounds(self, old: Bounded, allowed: Floats) -> Iterator[Bounded]:
        steps, is_raised = old.wanted_steps(allowed)
        call = CALL_ON_LEVELS if isinstance(old.boxes, LevelBoxes) else CALL
        steps[is_raised] = with_fewer_rules(steps[is_raised], old.least, call)
        for own in np.unique(steps[is_raised], axis=0):
            yield self._raised(old.part(is_raised & (steps == own).all(axis=1)), tuple(own.tolist()))
        rest = old.part(~is_raised)
        directions = rest.halving(allowed)
        is_halved = directions.any(axis=1)
        if is_halved.any():
            yield from self._of_halves(rest.boxes.part(is_halved).halved(directions[is_halved]), rest)
        if not is_halved.all():
            stuck = rest.part(~is_halved)
            yield replace(stuck, is_final=True)

    def _of_halves(self, halves: Boxes, old: Bounded) -> Iterator[Bounded]:
        """The groups of halves of the boxes of a group."""
        if isinstance(halves, LevelBoxes):
            assert isinstance(old.rules, LevelRules)
            yield from self._enclosed(halves, old.rules, old.numbers)
        elif len(halves):
            assert isinstance(old.rules, DegreeRules)
            yield self._bounded(halves, old.rules, old.numbers)

    def _refined(self, groups: list[Group], magnitude: Floats) -> Sums:
        """The integrals over boxes of expressions without an exact rule; some boxes are bisected repeatedly.

        magnitude  (k,) magnitude of the remaining integrals
        """
        count, taken = len(self._expressions), 0
        total = sum((group.sums(count) for group in groups), Sums.none(count))
        while groups and not self.is_unfinished:
            wanted = gathered(total, self._owners)
            sizes = by_owner(magnitude, self._owners) + wanted.magnitude

            # nothing is gained by errors less than rounding, which is all there is of sides that are collapsed
            goals = np.maximum(self._error * sizes, wanted.rounding)[self._owners]
            self._tell(wanted, sizes)
            scores = [group.scores(goals) for group in groups]
            costs = np.repeat([group.cost for group in groups], list(map(len, scores)))
            every = np.concatenate(scores)
            least = max(_threshold(every), _affordable(every, costs, self._most - taken))
            count_of_best = int((every >= least).sum())
            if not count_of_best:
                break
            taken += int(costs[every >= least].sum())
            try:
                groups = self._round(groups, [own >= least for own in scores], goals / (2 * count_of_best))
            except KeyboardInterrupt:
                if not self._best_effort:
                    raise
                self.is_unfinished = True
            total = sum((group.sums(count) for group in groups), Sums.none(count))
        return sum((self._integrated(group).sums(count) for group in groups), Sums.none(count))

    def _integrated(self, group: Group) -> Group:
        """A group with the integrals of a rule."""
        if isinstance(group, Bounded) and group.is_guess:
            return self._raised(group, group.steps)
        return group

    def _round(self, groups: list[Group], chosen: list[Bools], allowed: Floats) -> list[Group]:
        """The groups with chosen boxes improved; ``allowed`` (k,) is the permitted error of each."""
        parted = [(group.part(~own), group.part(own)) for own, group in zip(chosen, groups, strict=True)]
        found = [rest for rest, _ in parted if len(rest)]
        for _, old in parted:
            found += self._improved(old, allowed) if len(old) else []
        return [*(own for own in found if not isinstance(own, Bounded)), *_joined(found)]

    def _tell(self, total: Sums, sizes: Floats) -> None:
        """Report the largest error reached, relative to the sizes of integrals."""
        if self._reached is None:
            return
        with np.errstate(all="ignore"):
            parts = (total.error - total.rounding) / sizes
        self._reached(float(np.nanmax(np.append(parts, 0.0))))

    def _integrate(self, boxes: Boxes, numbers: Sequence[int], counts: Counts) -> BoxIntegrals:
        """Integrals over each box by one rule."""
        size = max(1, _BATCH // int(np.prod(counts)))
        return BoxIntegrals.joined([own.integrals for own in self._batches(boxes, size, numbers, counts)])

    def _batches(
        self,
        boxes: Boxes,
        size: int,
        numbers: Sequence[int],
        counts: Counts,
        rules: DegreeRules | None = None,
    ) -> Iterator[_Batch]:
        """The results of a rule, batch by batch; with bounds if the rules of a piece are given."""
        parts = [boxes.part(slice(first, first + size)) for first in range(0, max(len(boxes), 1), size)]
        jobs = (partial(self._batch, part, numbers, counts, rules) for part in parts)
        for part, own in zip(parts, results(jobs), strict=True):
            missing = {int(self._owners[number]): place for number, place in own.missing.items()}
            self._places = {**missing, **self._places}
            self._done += _points(part, [counts])
            if self._progress is not None:
                self._progress(self._done, self._planned)
            yield own

    def _batch(self, boxes: Boxes, numbers: Sequence[int], counts: Counts, rules: DegreeRules | None) -> _Batch:
        """The results of a rule on boxes that are evaluated together."""
        found, missing = BoxIntegrals(*np.zeros((4, len(boxes), len(numbers)))), dict[int, Floats]()
        if not len(boxes):
            return _Batch(found, missing)
        places, shares, box = boxes.quadrature(counts)
        sizes, gains = np.abs(shares), []
        measure = _by_box(sizes, boxes, box)
        for column, values in enumerate(self._values(numbers, places, missing)):
            terms, within = values * shares, measure
            if self._names_others[numbers[column]]:
                is_beyond = np.isnan(values)
                terms = np.where(is_beyond, 0.0, terms)
                within = _by_box(np.where(is_beyond, 0.0, sizes), boxes, box)
                found.beyond[:, column] = _by_box(np.where(is_beyond, sizes, 0.0), boxes, box)
            found.value[:, column] = _by_box(terms, boxes, box)
            found.magnitude[:, column] = _by_box(np.abs(terms), boxes, box)
            found.measure[:, column] = within
            gains.append(np.empty(0) if rules is None else _gains(values, counts))
        if rules is None:
            return _Batch(found, missing)
        assert isinstance(boxes, EtaBoxes)
        roots = [self._expressions[number].root for number in numbers]
        discs = BoxDiscs(boxes, rules, self._evaluator.names, self._evaluator.attributes, places, counts)
        return _Batch(found, missing, bounds(discs, roots, found.measure[:, 0]), np.sum(gains, axis=0))

    def _values(self, numbers: Sequence[int], places: ElementPoints, noted: dict[int, Floats]) -> Iterator[Floats]:
        """(n,) some expressions at points; NaN if undefined, with one such point noted."""
        expressions = [self._expressions[number] for number in numbers]
        for number, found in zip(numbers, self._evaluator.values_at(expressions, places), strict=True):
            values = np.broadcast_to(found, len(places))
            missing = np.flatnonzero(~np.isfinite(values))
            if len(missing):
                noted[number] = places.positions[missing[0]]
                values = np.where(np.isfinite(values), values, np.nan)
            yield values


def _by_box(terms: Floats, boxes: Boxes, box: Ints) -> Floats:
    """Sums of terms at points over the boxes that these are in; boxes of eta have equally many points each."""
    if isinstance(boxes, EtaBoxes):
        return np.asarray(terms.reshape(len(boxes), -1).sum(axis=1))
    return np.asarray(np.bincount(box, terms, len(boxes)))


def _error(known: Bounds, integrals: BoxIntegrals, steps: tuple[int, ...]) -> tuple[Floats, Bools]:
    """(n, k) by how much integrals may be off, and whether that is a bound; values that are none have no error."""
    error = known.error(integrals.value, steps)
    is_bound = np.isfinite(error) | np.isnan(integrals.value)
    error = np.where(np.isfinite(error), error, _UNBOUNDED * integrals.magnitude)
    return np.where(np.isnan(integrals.value), 0.0, error), is_bound


def _has_values(root: Node) -> bool:
    """Whether an expression has a value everywhere, since its parts are sums and products."""
    return all(node.op in LEAVES or node.op in ("+", "-", "*") for node in ordered(root))


def _gains(values: Floats, counts: Counts) -> Floats:
    """(n, d) how much values (n q,) at points of boxes vary along each direction, on average over lines of points.

    Halving a direction halves this variation, and with it the uncertainty of intervals; this also holds if both halves
    have the range of the whole, as for a parabola.
    """
    lattice = values.reshape(-1, *counts)
    found = [np.ptp(lattice, axis=1 + axis).reshape(len(lattice), -1).mean(axis=1) for axis in range(len(counts))]
    return np.nan_to_num(np.stack(found, axis=1))


def _joined(groups: Sequence[Group]) -> Iterator[Bounded]:
    """Groups that have bounds, those with the same rules together."""
    known: dict[tuple[object, ...], list[Bounded]] = {}
    for group in groups:
        if isinstance(group, Bounded):
            known.setdefault(group.key, []).append(group)
    yield from map(Bounded.joined, known.values())


def _points(boxes: Boxes, rules: Sequence[Counts]) -> int:
    """Number of points of rules with these counts, for boxes without breaks."""
    return len(boxes) * int(sum(map(np.prod, rules)))


def _rough_counts(piece: Piece) -> tuple[int, ...]:
    """Gauss points in each direction of the lesser rule: as many as modes, and as planes."""
    expansions = [own for own in (piece.patch.geometry, *piece.patch.fields) if own is not None]
    modes = max(max(own.modes) for own in expansions)
    planes = [0] if piece.patch.homogeneous is None else [max(piece.patch.homogeneous.z_ids, default=0)]
    along = [max(planes) + 2] * len(piece.patch.periods)
    counts = (*[modes] * piece.shape.dimension, *along)
    return tuple(min(count, _MOST_COUNTS) for count in counts)


def _threshold(scores: Floats) -> float:
    """The lowest score of boxes to be refined, such that the remaining scores sum up to at most a half.

    Inf if no box must be refined.
    """
    if scores.sum() <= 1:
        return np.inf
    ascending = np.sort(scores)
    kept = int(np.searchsorted(np.cumsum(ascending), 0.5, side="right"))
    return float(ascending[kept])


def _affordable(scores: Floats, costs: Ints, budget: int) -> float:
    """The lowest score of boxes such that all boxes with this score or more fit the budget."""
    descending = np.argsort(-scores, kind="stable")
    first_left = int(np.searchsorted(np.cumsum(costs[descending]), budget, side="right"))
    if first_left == len(scores):
        return -np.inf
    return float(np.nextafter(scores[descending[first_left]], np.inf))
