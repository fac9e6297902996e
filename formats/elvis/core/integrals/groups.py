"""Boxes with what rules say of the integrals of some expressions on them, and by how much these may be off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from elvis.core.base.arrays import EPS, Bools, Floats, Ints, joined_columns
from elvis.core.integrals.analytic_error import FURTHER, Bounds
from elvis.core.integrals.degrees import DegreeRules
from elvis.core.integrals.eta_boxes import EtaBoxes
from elvis.core.integrals.levels.boxes import LevelBoxes
from elvis.core.integrals.levels.error import LevelRules

#: Gauss points in a direction by which further rules have more that are compared
COMPARED = (1, 2)
#: boxes are bisected in directions that have this part of the largest share of the error
_ALIKE = 0.25
#: or, where only intervals bound it, that reduce it by this part of the largest reduction
_AS_GOOD = 0.5
#: cost of a point and its bounds in new boxes, relative to a point in known boxes
_NEW = 2.0
#: points in boxes that are known which cost as much as bounds on a box that a surface cuts
_BOUNDS_ON_LEVELS = 64
#: points on elements that take as long as halving such a box, its halves and their bounds
_NEW_LEVEL_BOX = 512
#: further points that take as long as one call of a rule, on elements and on boxes that a surface cuts
CALL, CALL_ON_LEVELS = 4096, 1500
#: rounding of values away from the middles of elements, relative to the integral of the absolute value: x^n has that of
#: n factors
_ROUNDING = 32 * EPS
#: the largest score of a box; sums of such scores stay finite
_HOPELESS = 1e200

Counts = tuple[int, ...]
#: domains of integration
Boxes = EtaBoxes | LevelBoxes


@dataclass
class Sums:
    """Integrals of k expressions, with their errors.

    value      (k,)
    error      (k,) error bounds or estimates
    rounding   (k,) contribution of rounding to the error
    magnitude  (k,)  integrals of the absolute values
    measure    (k,)  length, area or volume of the elements that have all fields of the expression
    beyond     (k,) measure of the region where another dataset used by the expression is undefined: not part of
               ``measure``
    is_exact   (k,) whether all rules are exact, so that the error consists only of rounding
    is_bound   (k,) whether the error is a bound, derived over whole boxes; otherwise it is an estimate
    places     a point where an expression, or another dataset, is undefined, by the expression's number
    converted  (k,) estimated deviation from the source of converted data, not part of ``error``
    """

    value: Floats
    error: Floats
    rounding: Floats
    magnitude: Floats
    measure: Floats
    beyond: Floats
    is_exact: Bools
    is_bound: Bools
    places: dict[int, Floats] = field(default_factory=dict)
    converted: Floats = field(default_factory=lambda: np.zeros(1))

    @staticmethod
    def none(count: int) -> Sums:
        """Integrals over nothing."""
        value, error, rounding, magnitude, measure, beyond = np.zeros((6, count))
        every = np.ones(count, bool)
        converted = np.zeros(count)
        return Sums(value, error, rounding, magnitude, measure, beyond, every, every.copy(), converted=converted)

    def __add__(self, other: Sums) -> Sums:
        return Sums(
            self.value + other.value,
            self.error + other.error,
            self.rounding + other.rounding,
            self.magnitude + other.magnitude,
            self.measure + other.measure,
            self.beyond + other.beyond,
            self.is_exact & other.is_exact,
            self.is_bound & other.is_bound,
            {**other.places, **self.places},
            self.converted + other.converted,
        )


def gathered(sums: Sums, owners: Ints) -> Sums:
    """Integrals of expressions from the integrals of their parts, each with the number of its owner."""
    columns = {each.name: getattr(sums, each.name) for each in fields(sums) if each.name not in ("places", "converted")}
    first = np.flatnonzero(owners == np.arange(len(owners)))
    found = {}
    for name, column in columns.items():
        if column.dtype == bool:
            found[name] = np.array([column[owners == owner].all() for owner in first], bool)
        else:
            found[name] = by_owner(column, owners)
    return Sums(**found, places=sums.places, converted=np.zeros(len(first)))


def by_owner(column: Floats, owners: Ints) -> Floats:
    """Sums of a column over the parts of each owner."""
    return np.asarray(np.bincount(owners, column, int(owners.max()) + 1 if len(owners) else 0))


class BoxIntegrals(NamedTuple):
    """Integrals of k expressions over n boxes, (n, k) each.

    magnitude  integrals of the absolute values
    measure    of where there are values
    beyond     of where another dataset has nothing
    """

    value: Floats
    magnitude: Floats
    measure: Floats
    beyond: Floats

    def part(self, chosen: Bools) -> BoxIntegrals:
        """The integrals over some boxes."""
        return BoxIntegrals(*(column[chosen] for column in self))

    @staticmethod
    def joined(several: Sequence[BoxIntegrals]) -> BoxIntegrals:
        """The integrals over several sets of boxes, concatenated."""
        return BoxIntegrals(*joined_columns(several))


@dataclass(frozen=True, eq=False)
class Group:
    """Boxes with integrals by one rule.

    numbers    of the expressions
    counts     of points in each direction; the smallest, where several rules are compared
    integrals  by the best rule
    error      (n, k) by which these may be off, rounding left aside
    is_bound   (n, k) whether the error is a bound
    moved      (n, k) by how much rounding may move them because it moves surfaces
    """

    boxes: Boxes
    numbers: list[int]
    counts: Counts
    integrals: BoxIntegrals
    error: Floats
    is_bound: Bools
    moved: Floats

    def __len__(self) -> int:
        return len(self.boxes)

    @property
    def cost(self) -> int:
        """Points that it takes to improve a box."""
        return 0

    def part(self, chosen: Bools) -> Group:
        """Some of the boxes."""
        return replace(
            self,
            boxes=self.boxes.part(chosen),
            integrals=self.integrals.part(chosen),
            error=self.error[chosen],
            is_bound=self.is_bound[chosen],
            moved=self.moved[chosen],
        )

    def sums(self, count: int) -> Sums:
        """All boxes together, for ``count`` expressions."""
        total = Sums.none(count)
        for name, column in self.integrals._asdict().items():
            getattr(total, name)[self.numbers] = column.sum(axis=0)
        total.rounding[self.numbers] = self._rounding.sum(axis=0)
        total.error[self.numbers] = self.error.sum(axis=0) + total.rounding[self.numbers]
        total.is_exact[self.numbers] = False
        total.is_bound[self.numbers] = self.is_bound.all(axis=0)
        return total

    @property
    def _rounding(self) -> Floats:
        """(n, k) by which rounding moves integrals."""
        found = self.integrals
        return np.asarray(found.measure * self.boxes.rounding + _ROUNDING * found.magnitude + self.moved)

    def scores(self, goals: Floats) -> Floats:
        """(n,) errors of boxes relative to the permitted total, the maximum over the expressions.

        An error below rounding can't be improved and counts as zero.
        """
        error = np.where(self.error > self._rounding, self.error, 0.0)
        with np.errstate(all="ignore"):
            parts = np.nan_to_num(error / goals[self.numbers], nan=0.0, posinf=_HOPELESS)
        return np.asarray(np.minimum(parts, _HOPELESS).max(axis=1))


@dataclass(frozen=True, eq=False)
class Compared(Group):
    """Boxes on which several rules are compared: their differences make an estimate of the error.

    is_raised  whether rules have more points than at first
    """

    is_raised: bool

    @property
    def cost(self) -> int:
        """Points that it takes to improve a box."""
        points = sum(map(np.prod, compared_counts(self.counts)))
        return int(points * (2 ** len(self.counts) if self.is_raised else 3))


def compared_counts(counts: Counts) -> list[Counts]:
    """Points per direction of the rules to be compared; the smallest rule has ``counts``."""
    return [tuple(count + further for count in counts) for further in (0, *COMPARED)]


@dataclass(frozen=True, eq=False)
class Bounded(Group):
    """Boxes on which the error is a bound.

    rules      source of the bounds
    steps      index into FURTHER for each direction: additional points of ``counts`` compared with the smallest rule
    bounds     of all rules that are considered
    gains      (n, d) reduction of the uncertainty of intervals by halving in each direction, estimated from points
    is_final   whether boxes are too small to be bisected
    is_guess   whether integrals are guesses, since no rule has been applied yet
    """

    rules: DegreeRules | LevelRules
    steps: tuple[int, ...]
    bounds: Bounds
    gains: Floats
    is_final: bool = False
    is_guess: bool = False

    def part(self, chosen: Bools) -> Bounded:
        """Some of the boxes."""
        own = super().part(chosen)
        assert isinstance(own, Bounded)
        return replace(own, bounds=self.bounds.part(chosen), gains=self.gains[chosen])

    @property
    def least(self) -> Counts:
        """Points in each direction of the smallest rule."""
        return tuple(count - FURTHER[step] for count, step in zip(self.counts, self.steps, strict=True))

    @property
    def cost(self) -> int:
        """Points that it takes to improve a box, about; bounds on levels take as long as many."""
        return _NEW_LEVEL_BOX if isinstance(self.boxes, LevelBoxes) else int(2 * self._cost_of_new)

    @property
    def _cost_of_new(self) -> float:
        """Points that a new box costs, with its bounds."""
        points = float(np.prod(self.least))
        return points + _BOUNDS_ON_LEVELS if isinstance(self.boxes, LevelBoxes) else _NEW * points

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for groups that can be joined."""
        return id(self.rules), *self.numbers, self.steps, self.is_final, self.is_guess

    def scores(self, goals: Floats) -> Floats:
        """As in `Group`; none of boxes that can't be bisected."""
        return np.zeros(len(self)) if self.is_final else super().scores(goals)

    @staticmethod
    def joined(several: Sequence[Bounded]) -> Bounded:
        """Groups with equal keys together."""
        if len(several) == 1:
            return several[0]
        return replace(
            several[0],
            boxes=_together([own.boxes for own in several]),
            integrals=BoxIntegrals.joined([own.integrals for own in several]),
            error=np.concatenate([own.error for own in several]),
            is_bound=np.concatenate([own.is_bound for own in several]),
            moved=np.concatenate([own.moved for own in several]),
            bounds=Bounds.joined([own.bounds for own in several]),
            gains=np.concatenate([own.gains for own in several]),
        )

    def wanted_steps(self, allowed: Floats) -> tuple[Ints, Bools]:
        """Steps (n, d) of rules whose errors are less than allowed (k,), and whether (n,) they are worth their points.

        Halving a direction divides its bound by about 2^(2 n), and takes new boxes.
        """
        d, least = len(self.counts), np.array(self.least)
        is_enough = (self.bounds.errors <= (allowed / d)[:, None, None]).all(axis=1)
        steps = is_enough.argmax(axis=2)
        points = (least + np.array(FURTHER)[steps]).prod(axis=1)
        with np.errstate(all="ignore"):
            excess = np.log2(self.bounds.errors[..., 0] * d / allowed[:, None]).max(axis=1)
        halvings = np.ceil(np.maximum(excess, 0.0) / (2 * least)).sum(axis=1)
        is_worth = points <= self._cost_of_new * 2.0 ** np.maximum(halvings, 1.0)
        is_new = (steps != np.array(self.steps)).any(axis=1) | self.is_guess
        return steps, is_enough.any(axis=2).all(axis=1) & is_worth & is_new

    def halving(self, allowed: Floats) -> Bools:
        """(n, d) the directions in which boxes are best bisected, none of them too small ones."""
        with np.errstate(all="ignore"):
            shares = (self.bounds.errors[..., 1] / allowed[:, None]).max(axis=1)
        is_known = np.isfinite(shares).all(axis=1) & (shares > 0).any(axis=1)
        shares = np.where(is_known[:, None], np.log2(np.maximum(shares, 1e-300)), 0.0)
        behind = shares >= shares.max(axis=1, keepdims=True) + np.log2(_ALIKE)
        varied = self.gains >= _AS_GOOD * self.gains.max(axis=1, keepdims=True)
        return np.asarray(np.where(is_known[:, None], behind, varied) & self.boxes.can_be_halved)


def _together(several: Sequence[Boxes]) -> Boxes:
    """Boxes of one kind together."""
    of_elements = [own for own in several if isinstance(own, EtaBoxes)]
    of_levels = [own for own in several if isinstance(own, LevelBoxes)]
    return EtaBoxes.joined(of_elements) if of_elements else LevelBoxes.joined(of_levels)


def with_fewer_rules(steps: Ints, least: Counts, call: int = CALL) -> Ints:
    """Steps (n, d) of rules, where rules with few boxes are replaced by rules with at least the same steps.

    Each rule costs a call, for any number of boxes: rules are merged if the additional points cost less.
    """
    rules, number, boxes = np.unique(steps, axis=0, return_inverse=True, return_counts=True)
    joined: list[tuple[Ints, int, list[int]]] = []
    for own in np.argsort(-_points_of(rules, least), kind="stable").tolist():
        every = [np.maximum(rule, rules[own]) for rule, _, _ in joined]
        added = [
            (_points_of(both, least) - _points_of(rule, least)) * count
            + (_points_of(both, least) - _points_of(rules[own], least)) * boxes[own]
            for both, (rule, count, _) in zip(every, joined, strict=True)
        ]
        best = int(np.argmin(added)) if added else -1
        if best < 0 or added[best] > call:
            joined.append((rules[own], int(boxes[own]), [own]))
        else:
            _, count, members = joined[best]
            joined[best] = every[best], count + int(boxes[own]), [*members, own]
    for rule, _, members in joined:
        rules[members] = rule
    return np.asarray(rules[number.reshape(-1)])


def _points_of(steps: Ints, least: Counts) -> Ints:
    """Points of rules (..., d) in a box."""
    return np.asarray((np.array(least) + np.array(FURTHER)[steps]).prod(axis=-1))
