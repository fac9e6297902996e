"""Values that a library finds element by element, which are not sums over nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.plugins.conversion.nodal import NodalValues

#: (k, n, c) values on elements (k,) at reference points (n, d)
Evaluate = Callable[[Ints, Floats], Floats]


@dataclass(frozen=True, eq=False, kw_only=True)
class EvaluatedValues(NodalValues):
    """Places of elements, or values of a function, requested from a library.

    evaluate  function that requests them from the library
    elements  (m,) their numbers in the library
    degree    of the function
    """

    evaluate: Evaluate
    elements: Ints
    degree: int
    last: list[tuple[slice | Ints, Floats, Floats]] = field(default_factory=list)

    @classmethod
    def of(cls, evaluate: Evaluate, elements: Ints, degree: int, count: int) -> EvaluatedValues:
        """Values of ``count`` components on elements."""
        return cls(np.empty((0, count)), None, evaluate=evaluate, elements=elements, degree=degree)

    @property
    def order(self) -> int:
        """The degree that the library reports."""
        return self.degree

    def component(self, number: int, rows: slice | Ints, points: Floats) -> Floats:
        """(r, n) values of a component of a function."""
        return np.asarray(self.at(rows, points)[:, :, number])

    def at(self, rows: slice | Ints, points: Floats) -> Floats:
        """(r, n, c) values; the last result is cached, since components are requested one after another."""
        if self.last and self.last[0][0] is rows and self.last[0][1] is points:
            return self.last[0][2]
        found = self.evaluate(self.elements[rows], points)
        self.last[:] = [(rows, points, found)]
        return found
