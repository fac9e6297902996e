"""A velocity between the steps of a series, whose coefficients are polynomials in time.

Time is an additional coordinate of a point, after the coordinates of its element: the clock, from 0 at the beginning of
the interval to 1 at its end.  Code that traces lines in a steady velocity thus traces paths in this one.  The velocity,
its derivatives and all other quantities are evaluated at the time of each point, as in pictures of that time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Floats, Ints, rows_by_number
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.interpolation import lagrange_values
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.streamlines.velocity import Motion, Velocity

#: points at once
_BATCH = 1 << 15


@dataclass(frozen=True, eq=False)
class Interval:
    """A part of time between two steps, and the steps that the interpolation there rests on.

    low, high  its ends
    times      (k,) of the steps
    steps      their datasets, on one mesh
    """

    low: float
    high: float
    times: Floats
    steps: tuple[Dataset, ...]

    def time(self, clock: Floats) -> Floats:
        """(n,) times at places (n,) from 0 to 1 in the interval."""
        return self.low + clock * (self.high - self.low)

    def weights(self, clock: Floats) -> Floats:
        """(n, k) shares of the steps there: values of the Lagrange polynomials of their times."""
        return lagrange_values(self.times, self.time(clock))


def moving_names(dataset: Dataset) -> Names:
    """Names for expressions along paths: t is a variable, and there are no derivatives in time."""
    return replace(Names.of(dataset), is_moving=True)


class InstantPoints(ElementPoints):
    """Points in elements, each at a time of its own (n,): the fields of each have the coefficients of that time."""

    def __init__(self, patch: Patch, points: Floats, time: Floats) -> None:
        super().__init__(patch, np.arange(len(points)), points)
        self._time = time

    @cached_property
    def positions(self) -> Floats:
        """(n, 4) world coordinates and time."""
        return np.column_stack([super().positions, self._time])


class MovingVelocity(Velocity):
    """A velocity in an interval of time: as `Velocity`, with points (n, D + 1) whose last coordinate is the clock.

    interval  the part of time

    Raises ElvisError if fields have other bases in another step.
    """

    clocks = 1

    def __init__(
        self, interval: Interval, expressions: Sequence[Expression], others: Sequence[Expression] = ()
    ) -> None:
        super().__init__(interval.steps[0], expressions, others)
        self.interval = interval
        own = [self.patches, *(patches(step, self.evaluator.names) for step in interval.steps[1:])]
        if not all(_is_alike(self.patches, other) for other in own[1:]):
            times = f"{interval.times[0]:.10g} to {interval.times[-1]:.10g}"
            raise ElvisError(
                f"expected fields in the same bases in steps at times {times}, found others: no path continues"
            )
        self._steps = tuple(zip(*own, strict=True))

    def component_fields(self, number: int) -> None:
        """None: the coefficients change in time."""
        return

    def motion(self, patch: Ints, row: Ints, points: Floats) -> Motion:
        """The motion at points (n, D + 1), as in `Velocity`, with the rate of the clock."""
        still = super().motion(patch, row, points)
        rate = np.full(len(points), 1.0 / (self.interval.high - self.interval.low))
        return replace(still, reference=np.column_stack([still.reference, rate]))

    def positions(self, patch: Ints, row: Ints, points: Floats) -> Floats:
        """(n, 3) world coordinates."""
        return super().positions(patch, row, points[:, :-1])

    def in_elements(self, number: int, points: Floats) -> Floats:
        """(…, D) reference coordinates of points (…, D + 1)."""
        return points[..., :-1]

    def values(self, expression: Expression, patch: Ints, row: Ints, points: Floats) -> Floats:
        """(n,) values of one of the evaluator's expressions."""
        found = np.empty(len(points))
        for number, everywhere in rows_by_number(patch):
            for first in range(0, len(everywhere), _BATCH):
                here = everywhere[first : first + _BATCH]
                places = self.places(number, row[here], points[here])
                (value,) = self.evaluator.values_at([expression], places)
                found[here] = value
        return found

    def places(self, number: int, rows: Ints, points: Floats) -> InstantPoints:
        """Points (n, D + 1) in elements (n,) of a patch, for the evaluator, which sees an element for each point."""
        patch = self.patches[number]
        fields = range(len(patch.fields))
        own = tuple(None if patch.fields[k] is None else self._coefficients(number, k, rows, points) for k in fields)
        ids, maps = patch.element_ids[rows], patch.geometry_coefficients[rows]
        momentary = replace(patch, element_ids=ids, geometry_coefficients=maps, coefficients=own, corners=None)
        return InstantPoints(momentary, points[:, :-1], self.interval.time(points[:, -1]))

    def _coefficients(self, number: int, field: int, rows: Ints, points: Floats) -> Floats:
        """(n, m) coefficients of a field at the points' times: linear in the coefficients of the steps."""
        weights = self.interval.weights(points[:, -1])
        total: Floats | float = 0.0
        for step, weight in zip(self._steps[number], weights.T, strict=True):
            own = step.coefficients[field]
            assert own is not None
            total = total + weight[:, None] * own[rows]
        return np.asarray(total)


def _is_alike(one: Sequence[Patch], other: Sequence[Patch]) -> bool:
    """Whether patches have the same elements and bases in the same order."""
    return len(one) == len(other) and all(
        a.fields == b.fields and np.array_equal(a.element_ids, b.element_ids) for a, b in zip(one, other, strict=True)
    )
