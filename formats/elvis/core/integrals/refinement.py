"""Sums over pieces: one rule where that is exact, else rules whose differences are the error, on halved boxes.

Where an integrand is no polynomial each box of eta is integrated by three Gauss rules.  Errors of one may vanish by
chance, of poles and kinks nearby; twice the greater difference from the best rule bounds its error, as a rule by far.
Boxes with the largest differences get better rules, then are halved in every direction, until all differences together
are less than the error asked for, or as many points have been taken as may be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.integrals.along_curves import CurvePiece, along_curve
from elvis.core.integrals.degrees import DegreeRules
from elvis.core.integrals.level_boxes import LevelBoxes
from elvis.core.integrals.levels_of_elements import LevelPiece
from elvis.core.integrals.reference_cells import Piece, box_rule
from elvis.core.patch import Patch
from elvis.core.polynomials.boxnets import all_half_boxes
from elvis.core.quantities.element_points import ElementPoints, Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import other_of
from elvis.core.terminal import Progress
from elvis.core.threads import results

#: points at once, and how many may be taken to bring an error down
_BATCH, _MOST = 1 << 16, 1 << 22
#: Gauss points in a direction where rules are compared: at most at first, by which others have more, by which all are
#: raised before boxes are halved, and how much more than the differences the error is
_MOST_COUNTS, _FURTHER, _RAISED, _SAFETY = 12, (1, 2), 3, 2.0
_EPS = float(np.finfo(np.float64).eps)
#: rounding of a sum, in parts of its magnitude, and of measures for each unit of a map's condition
_ROUNDING, _LENGTHS = 8 * _EPS, _EPS
#: how much more values of another dataset, whose places are roots, are rounded
_LOCATED = 16.0
#: points each way on a box of a surface
_ON_SURFACES = 3


@dataclass
class Sums:
    """Integrals of k expressions, and what is known of them.

    value      (k,)
    error      (k,)  by which they may differ from the truth
    rounding   (k,)  the part of it that is rounding
    magnitude  (k,)  integrals of the absolute values
    measure    (k,)  length, area or volume of the elements that have all fields of the expression
    beyond     (k,)  that of where another dataset, which the expression names, has nothing: not part of ``measure``
    is_exact   (k,)  whether all rules are exact, so that the error is that of rounding alone
    places     where an expression has no value, or another dataset has nothing, by the expression's number
    """

    value: Floats
    error: Floats
    rounding: Floats
    magnitude: Floats
    measure: Floats
    beyond: Floats
    is_exact: Bools
    places: dict[int, Floats] = field(default_factory=dict)

    @staticmethod
    def none(count: int) -> Sums:
        """Of nothing."""
        value, error, rounding, magnitude, measure, beyond = np.zeros((6, count))
        return Sums(value, error, rounding, magnitude, measure, beyond, np.ones(count, bool))

    def __add__(self, other: Sums) -> Sums:
        return Sums(
            self.value + other.value,
            self.error + other.error,
            self.rounding + other.rounding,
            self.magnitude + other.magnitude,
            self.measure + other.measure,
            self.beyond + other.beyond,
            self.is_exact & other.is_exact,
            {**other.places, **self.places},
        )


class _Integrals(NamedTuple):
    """Of k expressions over n boxes, (n, k) each.

    magnitude  integrals of the absolute values
    measure    of where there are values
    beyond     of where another dataset has nothing
    """

    value: Floats
    magnitude: Floats
    measure: Floats
    beyond: Floats


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Boxes of eta in elements of a piece.

    rows       (n,)    of the patch
    rounding   (n, e)  of e expressions on the element
    low, high  (n, k)  corners
    """

    piece: Piece
    rows: Ints
    rounding: Floats
    low: Floats
    high: Floats

    def quadrature(self, counts: tuple[int, ...]) -> tuple[ElementPoints, Floats, Ints]:
        """Points in each box, their shares of its measure (n,), and the box of each (n,)."""
        nodes, weights = box_rule(counts)
        size = self.high - self.low
        eta = (self.low[:, None] + size[:, None] * (1 + nodes) / 2).reshape(-1, nodes.shape[1])
        box = np.repeat(np.arange(len(self)), len(nodes))
        if (size == 2).all():
            places: ElementPoints = Lattice(self.piece.patch, self.rows, self.piece.points(nodes))
        else:
            places = ElementPoints(self.piece.patch, self.rows[box], self.piece.points(eta))
        volumes = (size / 2).prod(axis=1)
        shares = self.piece.measures(places.jacobians, eta) * np.outer(volumes, weights).reshape(-1)
        return places, shares, box

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, chosen: Ints | Bools | slice) -> _Boxes:
        """Some of the boxes."""
        return _Boxes(self.piece, self.rows[chosen], self.rounding[chosen], self.low[chosen], self.high[chosen])

    def halves(self) -> _Boxes:
        """Both halves in every direction: 2^k boxes for each."""
        low, high = all_half_boxes(self.low, self.high)
        copies = len(low) // len(self)
        return _Boxes(self.piece, np.tile(self.rows, copies), np.tile(self.rounding, (copies, 1)), low, high)


#: what integrals are compared on
Boxes = _Boxes | LevelBoxes


@dataclass(frozen=True, eq=False)
class _Compared:
    """Boxes with what several rules say of the same expressions.

    numbers    of the expressions
    counts     of points in each direction, of the least rule
    is_raised  whether these are more than at first
    integrals  by the best rule
    error      (n, k)  from the differences of the others, 0 where that is rounding
    """

    boxes: Boxes
    numbers: list[int]
    counts: tuple[int, ...]
    is_raised: bool
    integrals: _Integrals
    error: Floats

    def part(self, chosen: Bools) -> _Compared:
        """Some of the boxes."""
        own = _Integrals(*(column[chosen] for column in self.integrals))
        boxes = self.boxes.part(chosen)
        return _Compared(boxes, self.numbers, self.counts, self.is_raised, own, self.error[chosen])

    @property
    def cost(self) -> int:
        """Points that are taken for a box to get better."""
        points = sum(map(np.prod, _compared_counts(self.counts)))
        return int(points * (2 ** len(self.counts) if self.is_raised else 3))

    def sums(self, count: int) -> Sums:
        """All boxes together, of ``count`` expressions."""
        total = Sums.none(count)
        for name, column in self.integrals._asdict().items():
            getattr(total, name)[self.numbers] = column.sum(axis=0)
        total.rounding[self.numbers] = (self.integrals.measure * self.boxes.rounding).sum(axis=0)
        total.error[self.numbers] = self.error.sum(axis=0) + total.rounding[self.numbers]
        total.is_exact[self.numbers] = False
        return total

    def scores(self, goals: Floats) -> Floats:
        """(n,) the errors of boxes in parts of what all together may have, the greatest of the expressions."""
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = self.error / goals[self.numbers]
        return np.asarray(np.where(np.isfinite(parts), parts, 0.0).max(axis=1))


class Summation:
    """Integrals of expressions, which an evaluator knows, over pieces of its dataset.

    error      asked for, in parts of the integral of the absolute value
    precision  by how much less than the terms that they are added up from expressions are rounded, 1 where not given
    most       points that may be taken to bring errors down
    progress   is told how many points have been taken, and how many are planned
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
    ) -> None:
        self._progress, self._done, self._planned = progress, 0, 0
        self._most = _MOST if most is None else most
        self._dataset, self._evaluator, self._error = dataset, evaluator, error
        self._expressions = tuple(expressions)
        self._names_others = [any(map(other_of, each.attributes)) for each in self._expressions]
        further = np.where(self._names_others, _LOCATED, 1.0)
        self._roundings = further * np.array(precision or np.ones(len(expressions)))
        self._places: dict[int, Floats] = {}
        self._lost = np.zeros(len(self._expressions))

    def over(self, pieces: Sequence[Piece | LevelPiece | CurvePiece]) -> Sums:
        """The integrals over some pieces together."""
        self._places, self._lost = {}, np.zeros(len(self._expressions))
        total = Sums.none(len(self._expressions))
        rough: list[_Compared] = []
        for whole in pieces:
            if isinstance(whole, CurvePiece):
                total += self._along(whole)
                continue
            held = self._held(whole.patch)
            if isinstance(whole, LevelPiece):
                found, below = self._on_level(whole, held) if held else ([], None)
                rough += found
                if below is None or not whole.is_filled:
                    continue
                whole = whole.piece.part(below)
            for piece, rules in self._alike(whole) if held else ():
                counts = [rules.counts(self._expressions[number]) for number in held]
                for own in dict.fromkeys(counts):
                    numbers = [number for number, other in zip(held, counts, strict=True) if other == own]
                    if own is None:
                        rough.append(self._compared(self._whole(piece, numbers), numbers, _rough_counts(piece), False))
                    else:
                        total += self._exact(piece, numbers, own)
        total += self._refined(rough, total.magnitude)
        return replace(total, error=total.error + self._lost, places=self._places)

    def _along(self, whole: CurvePiece) -> Sums:
        """The integrals along a curve."""
        found, count = along_curve(whole, self._evaluator, self._expressions, self._error), len(self._expressions)
        if found.place is not None:
            self._places.update({number: found.place for number in range(count) if found.beyond[number] > 0})
        columns = (found.value, found.error, found.rounding, found.magnitude, found.measure, found.beyond)
        return Sums(*columns, is_exact=np.zeros(count, bool))

    def _on_level(self, whole: LevelPiece, numbers: list[int]) -> tuple[list[_Compared], Ints]:
        """What rules say of expressions on a surface in elements, or below; elements of the piece that are below."""
        sizes, parts = self._sizes(whole.piece, numbers)
        every, below = whole.level.boxes(whole.piece, self._evaluator, sizes, parts, whole.is_filled)
        counts = (_ON_SURFACES,) * whole.dimension
        enough = self._enough(whole.piece, numbers) if whole.is_filled else None
        if enough is None:
            return [self._compared(boxes, numbers, counts, False) for boxes in every], below

        # what is a polynomial on elements is one on boxes that are whole, and along lines that end at a root
        found = []
        for boxes in every:
            cut = replace(boxes.part(~boxes.is_whole), lost=boxes.lost, enough=enough)
            inner = replace(boxes.part(boxes.is_whole), enough=enough)
            found += [self._known(inner, numbers, (enough,) * whole.dimension)]
            found += [self._compared(cut, numbers, counts, False)]
        return found, below

    def _enough(self, piece: Piece, numbers: list[int]) -> int | None:
        """Gauss points in each direction, of cells or of eta, that integrate all expressions exactly; None: no rule."""
        every = [rules.counts(self._expressions[own]) for _, rules in self._alike(piece) for own in numbers]
        known = [max(counts) for counts in every if counts is not None]
        return max(known, default=1) if len(known) == len(every) else None

    def _held(self, patch: Patch) -> list[int]:
        """The numbers of expressions all of whose fields a patch has."""
        known = {name for name, own in zip(self._evaluator.names, patch.fields, strict=True) if own is not None}
        return [number for number, each in enumerate(self._expressions) if known.issuperset(each.fields)]

    def _alike(self, piece: Piece) -> Iterator[tuple[Piece, DegreeRules]]:
        """Parts of a piece whose elements are all affine, or all flat, or all neither, or may be folded."""
        names, affine = self._evaluator.names, piece.is_affine
        bent = piece.part(~affine)
        valid = bent.is_valid(self._dataset) if len(bent) else np.empty(0, bool)
        has_normals = piece.is_side or not piece.patch.is_flat
        flat = bent.is_flat if len(bent) and has_normals else np.zeros(len(bent), bool)
        kinds = [(piece.part(affine), True, True, True)]
        kinds += [(bent.part(valid & (flat == own)), False, own, True) for own in (True, False)]
        kinds += [(bent.part(~valid), False, False, False)]
        for part, is_affine, is_flat, is_valid in kinds:
            if len(part):
                yield part, DegreeRules(part, names, is_affine, is_flat, is_valid)

    def _whole(self, piece: Piece, numbers: list[int]) -> _Boxes:
        """All of a piece, for some expressions."""
        low = np.full((len(piece), piece.dimension), -1.0)
        sizes, parts = self._sizes(piece, numbers)
        return _Boxes(piece, piece.rows, sizes * parts[:, None], low, -low)

    def _sizes(self, piece: Piece, numbers: list[int]) -> tuple[Floats, Floats]:
        """Magnitudes (n, e) of expressions in the middles of a piece's elements, and in what parts they are rounded."""
        middle = ElementPoints(piece.patch, piece.rows, piece.points(np.zeros((len(piece), piece.dimension))))
        found = self._evaluator.sizes_at([self._expressions[number] for number in numbers], middle)
        sizes = [np.nan_to_num(np.broadcast_to(size, len(piece))) for size in found]
        return np.stack(sizes, axis=1) * self._roundings[numbers], _ROUNDING + _LENGTHS * piece.conditions(
            middle.jacobians
        )

    def _exact(self, piece: Piece, numbers: list[int], counts: tuple[int, ...]) -> Sums:
        """The integrals by a rule that is exact."""
        boxes = self._whole(piece, numbers)
        total = self._known(boxes, numbers, counts).sums(len(self._expressions))
        total.is_exact[:] = True
        return total

    def _known(self, boxes: Boxes, numbers: list[int], counts: tuple[int, ...]) -> _Compared:
        """What a rule says that is exact."""
        self._planned += _points(boxes, [counts])
        found = self._integrate(boxes, numbers, counts)
        return _Compared(boxes, numbers, counts, False, found, np.zeros_like(found.value))

    def _compared(self, boxes: Boxes, numbers: list[int], counts: tuple[int, ...], is_raised: bool) -> _Compared:
        """What several rules say of expressions on boxes."""
        if isinstance(boxes, LevelBoxes):
            self._lost[numbers] += boxes.lost
        every = _compared_counts(counts)
        self._planned += _points(boxes, every)
        *lesser, best = (self._integrate(boxes, numbers, own) for own in every)
        error = np.asarray(_SAFETY * np.max([np.abs(best.value - own.value) for own in lesser], axis=0), np.float64)
        error[~(error > boxes.rounding * best.measure)] = 0.0
        return _Compared(boxes, numbers, counts, is_raised, best, error)

    def _improved(self, old: _Compared) -> _Compared:
        """The same by better rules, or on smaller boxes."""
        if old.is_raised:
            return self._compared(old.boxes.halves(), old.numbers, old.counts, True)
        return self._compared(old.boxes, old.numbers, tuple(count + _RAISED for count in old.counts), True)

    def _refined(self, groups: list[_Compared], magnitude: Floats) -> Sums:
        """The integrals over boxes where expressions are no polynomials, of which some are halved again and again.

        magnitude  (k,) of what is integrated besides
        """
        count, taken = len(self._expressions), 0
        total = sum((group.sums(count) for group in groups), Sums.none(count))
        while groups:
            goals = self._error * (magnitude + total.magnitude)
            scores = [group.scores(goals) for group in groups]
            costs = np.repeat([group.cost for group in groups], list(map(len, scores)))
            every = np.concatenate(scores)
            least = max(_threshold(every), _affordable(every, costs, self._most - taken))
            if not (every >= least).any():
                break
            taken += int(costs[every >= least].sum())
            chosen = [own >= least for own in scores]
            parted = [(group.part(~own), group.part(own)) for own, group in zip(chosen, groups, strict=True)]
            groups = [rest for rest, _ in parted if len(rest.boxes)]
            groups += [self._improved(old) for _, old in parted if len(old.boxes)]
            total = sum((group.sums(count) for group in groups), Sums.none(count))
        return total

    def _integrate(self, boxes: Boxes, numbers: Sequence[int], counts: tuple[int, ...]) -> _Integrals:
        """Integrals over each box by one rule."""
        step = max(1, _BATCH // int(np.prod(counts)))
        parts = [boxes.part(slice(first, first + step)) for first in range(0, max(len(boxes), 1), step)]
        found = []
        jobs = (partial(self._batch, part, numbers, counts) for part in parts)
        for part, (own, missing) in zip(parts, results(jobs), strict=True):
            self._places = {**missing, **self._places}
            self._done += _points(part, [counts])
            if self._progress is not None:
                self._progress(self._done, self._planned)
            found.append(own)
        return _Integrals(*(np.concatenate(columns) for columns in zip(*found, strict=True)))

    def _batch(
        self, boxes: Boxes, numbers: Sequence[int], counts: tuple[int, ...]
    ) -> tuple[_Integrals, dict[int, Floats]]:
        """Integrals over some boxes, and a place for each expression that has no value somewhere."""
        found, missing = _Integrals(*np.zeros((4, len(boxes), len(numbers)))), dict[int, Floats]()
        if not len(boxes):
            return found, missing
        places, shares, box = boxes.quadrature(counts)
        for column, values in enumerate(self._values(numbers, places, missing)):
            is_beyond = np.isnan(values) & self._names_others[numbers[column]]
            terms = np.where(is_beyond, 0.0, values * shares)
            parts = (terms, np.abs(terms), np.where(is_beyond, 0.0, shares), np.where(is_beyond, shares, 0.0))
            for part, sums in zip(parts, found, strict=True):
                sums[:, column] = np.bincount(box, part, len(boxes))
        return found, missing

    def _values(self, numbers: Sequence[int], places: ElementPoints, noted: dict[int, Floats]) -> Iterator[Floats]:
        """(n,) some expressions at points; NaN where they have no value, of which a place is noted."""
        expressions = [self._expressions[number] for number in numbers]
        for number, found in zip(numbers, self._evaluator.values_at(expressions, places), strict=True):
            values = np.broadcast_to(found, len(places))
            missing = np.flatnonzero(~np.isfinite(values))
            if len(missing):
                noted[number] = places.positions[missing[0]]
                values = np.where(np.isfinite(values), values, np.nan)
            yield values


def _compared_counts(counts: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Points in each direction of the rules that are compared, the least of which has ``counts``."""
    return [tuple(count + further for count in counts) for further in (0, *_FURTHER)]


def _points(boxes: Boxes, rules: Sequence[tuple[int, ...]]) -> int:
    """How many points rules with such counts take, where boxes have no breaks."""
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
    """The least score of boxes that may not stay, so that those that do sum up to a half at most; inf for none."""
    if scores.sum() <= 1:
        return np.inf
    ascending = np.sort(scores)
    kept = int(np.searchsorted(np.cumsum(ascending), 0.5, side="right"))
    return float(ascending[kept])


def _affordable(scores: Floats, costs: Ints, budget: int) -> float:
    """The least score of boxes, such that all that have it or more cost no more than the budget."""
    descending = np.argsort(-scores, kind="stable")
    first_left = int(np.searchsorted(np.cumsum(costs[descending]), budget, side="right"))
    if first_left == len(scores):
        return -np.inf
    return float(np.nextafter(scores[descending[first_left]], np.inf))
