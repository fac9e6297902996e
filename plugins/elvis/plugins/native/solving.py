"""The last resort for points that the kernels could not decide: a proof or a root by subdivision on the host."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, rows_by_number, starts_of
from elvis.core.mapping.inverse import Status, invert
from elvis.core.mapping.patch import Patch
from elvis.plugins.native.bending import bends
from elvis.plugins.runtime.volume import Solution

UNDECIDED = 2


@dataclass(frozen=True, eq=False)
class Solver:
    """Solves in the elements of some patches, numbered one patch after the other.

    value  of the field: a patch, rows (n,) of it and reference points (n, d) to (n,)
    """

    patches: Sequence[Patch]
    value: Callable[[Patch, Ints, Floats], Floats]

    def __call__(self, elements: Ints, points: Floats) -> Solution:
        """Status, reference coordinates and field of pairs of an element (n,) and a world point (n, 3)."""
        n = len(elements)
        solution = Solution(np.full(n, UNDECIDED), np.zeros(n), np.zeros((n, 3)), np.full(n, np.nan))
        bounds = starts_of(self.patches)
        owner = np.searchsorted(bounds, elements, side="right") - 1
        for number, chosen in rows_by_number(owner):
            self._solve(self.patches[number], chosen, elements[chosen] - bounds[number], points[chosen], solution)
        return solution

    def bends(self, elements: Ints) -> Bools:
        """(n,) whether elements bend so strongly that Newton's method may miss a root."""
        bounds = starts_of(self.patches)
        owner = np.searchsorted(bounds, elements, side="right") - 1
        strong = np.zeros(len(elements), bool)
        for number, chosen in rows_by_number(owner):
            strong[chosen] = bends(self.patches[number], elements[chosen] - bounds[number])
        return strong

    def _solve(self, patch: Patch, chosen: Ints, rows: Ints, points: Floats, solution: Solution) -> None:
        """Write the solutions of one patch to the rows ``chosen``."""
        roots = invert(patch, rows, points)
        solution.status[chosen[roots.status == Status.OUTSIDE]] = 0
        inside = np.flatnonzero(roots.status == Status.INSIDE)
        there, reference = chosen[inside], roots.reference[inside]
        solution.status[there] = 1
        solution.margin[there] = roots.margin[inside]
        solution.reference[there, : patch.shape.dimension] = reference
        if len(there):
            solution.field[there] = self.value(patch, rows[inside], reference)
