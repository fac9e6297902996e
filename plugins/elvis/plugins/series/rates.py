"""Derivatives in time of the interpolation between steps, as sums of the steps' coefficients.

With two steps this is the difference quotient; with four the derivative of the cubic.  Both have a kink at a step,
where it is the derivative of the following interval; at the last step, of the preceding one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Field, rate_name
from elvis.core.data.moments import BETWEEN
from elvis.plugins.series.between import STEPS_OF, is_one_mesh, polynomial_name, sum_of

if TYPE_CHECKING:
    from elvis.core.streamlines.moving import Interval
    from elvis.plugins.series.series import Series


def weights_of_rates(times: Floats, time: float) -> Floats:
    """(n,) derivatives at a time of the Lagrange polynomials of ``times`` (n,).

    The polynomial of i is a product of (t - t_k) / (t_i - t_k), so its derivative a sum of products that lack one.
    """
    found = np.zeros(len(times))
    for i, at in enumerate(times):
        for j in range(len(times)):
            others = [k for k in range(len(times)) if k not in (i, j)]
            if i != j:
                found[i] += np.prod((time - times[others]) / (at - times[others])) / (at - times[j])
    return found


@dataclass(eq=False)
class StepRates:
    """Derivatives in time of a series at a time, found when requested (see `elvis.core.data.dataset.Rates`)."""

    series: Series
    time: float
    between: str
    _found: dict[str, Field] = field(default_factory=dict)
    _numbers: list[int] = field(default_factory=list)

    @property
    def times(self) -> Floats:
        """(n,) of the steps of the series."""
        return self.series.times

    @property
    def remark(self) -> str:
        """Description of the derivatives; empty as long as none is requested."""
        if not self._found:
            return ""
        numbers = self._numbers
        name = polynomial_name(self.between, len(numbers))
        what = "difference quotients" if len(numbers) == 2 else f"those of the {name} in time"
        ends = f"steps {numbers[0]} to {numbers[-1]}"
        times = f"times {self.series.times[numbers[0]]:.10g} to {self.series.times[numbers[-1]]:.10g}"
        return f"derivatives in time are {what} of coefficients of {ends}, {times}"

    def field(self, name: str) -> Field:
        """The derivative of a field, named as `rate_name` says; ElvisError where there is none."""
        if name not in self._found:
            numbers = self._steps()
            steps = [self.series[number] for number in numbers]
            if not self.series.all_agree(all(is_one_mesh(steps[0], step) for step in steps[1:])):
                raise ElvisError(f"the mesh changes between steps {numbers[0]} and {numbers[-1]}: {_none(name)}")
            own = [step.field(name) for step in steps if name in step]
            factors, all_agree = weights_of_rates(self.series.times[numbers], self.time), self.series.all_agree
            rate = sum_of(own, factors, all_agree) if len(own) == len(steps) else None
            if rate is None:
                raise ElvisError(f"steps {numbers[0]} to {numbers[-1]} don't have the same {name}: {_none(name)}")
            self._found[name] = Field(rate_name(name), rate.blocks)
        return self._found[name]

    def intervals(self, start: float, stop: float) -> Iterator[Interval]:
        """The parts of time between steps, along which particles are followed (`paths`)."""
        from elvis.plugins.series.paths import intervals

        return intervals(self.series, self.between, start, stop)

    def _steps(self) -> list[int]:
        """The steps that are taken; ElvisError where there are no two."""
        if self.between == "nearest":
            others = " or ".join(each for each in BETWEEN if each != "nearest")
            raise ElvisError(f"the nearest step has no derivative in time: expected {others} between steps")
        self._numbers = self._numbers or self.series.readable_around(self.time, STEPS_OF[self.between])
        if len(self._numbers) < 2:
            raise ElvisError("one step has no derivative in time: expected two that can be read")
        return self._numbers


def _none(name: str) -> str:
    return f"there is no {rate_name(name)}"
