"""Conditions on a state of a running solver: whether its picture is wanted."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from numbers import Integral

from elvis.core.bounds.bounding import quantity_range
from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Expression
from elvis.scene.model.errors import SceneError

_PATTERN = re.compile(r"(min|max)\(([^<>]+)\)\s*([<>])=?\s*(\S+)")
#: what stands between conditions that must all hold
_AND = re.compile(r"\s+and\s+")


@dataclass(frozen=True)
class Condition:
    """The condition that the minimum or maximum of a quantity is beyond a number, such as ``max(mach) > 1``.

    end    ``min`` or ``max``
    above  whether it must be greater than the number, else less
    """

    end: str
    quantity: str
    above: bool
    number: float

    @staticmethod
    def parse(text: str) -> Condition:
        """The condition of a text; SceneError for an invalid one."""
        match = _PATTERN.fullmatch(text.strip())
        if match is not None:
            end, quantity, sign, number = match.groups()
            with suppress(ValueError):
                if isfinite(value := float(number)):
                    return Condition(end, quantity.strip(), sign == ">", value)
        raise SceneError(f"when: expected a condition as max(mach) > 1 or min(rho) < 0.1, found {text!r}")

    def may_hold(self, dataset: Dataset) -> bool:
        """False where certified bounds prove that the condition doesn't hold; ElvisError for an unknown quantity."""
        known = quantity_range(dataset, Expression.of(dataset, self.quantity))
        if known is None:
            return False
        # an extreme lies between the certified bound and the best value that is attained
        low, high = (known.maximum, known.upper) if self.end == "max" else (known.lower, known.minimum)
        return high >= self.number if self.above else low <= self.number


@dataclass(frozen=True)
class Trigger:
    """Steps with a picture: steps of a period in which all conditions hold, or may hold.

    every  number of steps from one to the next; steps are counted from 0
    """

    every: int = 1
    conditions: tuple[Condition, ...] = ()

    @staticmethod
    def of(every: int, when: str) -> Trigger:
        """``when`` may join conditions by ``and``; SceneError for an invalid period or condition."""
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise SceneError(f"every: expected a number of steps, 1 or more, found {every!r:.60}")
        if not isinstance(when, str):
            raise SceneError(f"when: expected a condition as max(mach) > 1, found {when!r:.60}")
        return Trigger(every, tuple(map(Condition.parse, _AND.split(when.strip()))) if when.strip() else ())

    @property
    def quantities(self) -> tuple[str, ...]:
        """Quantities of the conditions."""
        return tuple(condition.quantity for condition in self.conditions)

    def is_due(self, step: int) -> bool:
        """Whether a step belongs to the period; SceneError for an invalid step."""
        if not isinstance(step, Integral):
            raise SceneError(f"step: expected a whole number, found {step!r:.60}")
        return step % self.every == 0

    def holds(self, dataset: Dataset) -> bool:
        """Whether no condition is proved not to hold."""
        return all(condition.may_hold(dataset) for condition in self.conditions)
