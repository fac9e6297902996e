"""Knot vectors, and the Bézier pieces of splines over them.

Every span of a B-spline is a polynomial whose Bernstein coefficients are values of its polar form (L. Ramshaw,
Blossoms are polar forms, 1989): coefficient i of degree p on [a, b] is the blossom at p - i times a and i times b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints

#: degree up to which kernels are made
HIGHEST = 12


@dataclass(frozen=True, eq=False)
class KnotVector:
    """A knot vector of some degree; knots (n + degree + 1,) ascending for n control points."""

    degree: int
    knots: Floats

    @property
    def count(self) -> int:
        """Number of control points."""
        return len(self.knots) - self.degree - 1

    @property
    def spans(self) -> Ints:
        """(k,) numbers i of the knot intervals [t_i, t_i+1] that are not empty."""
        inner = np.arange(self.degree, self.count)
        return inner[self.knots[inner] < self.knots[inner + 1]]

    def reversed(self) -> KnotVector:
        """The vector run through from its other end."""
        return KnotVector(self.degree, (self.knots[0] + self.knots[-1]) - self.knots[::-1])

    def pieces(self) -> Floats:
        """(k, p + 1, n) matrices from control values to the Bernstein coefficients of each span."""
        return np.array([self._piece(int(span)) for span in self.spans])

    def _piece(self, span: int) -> Floats:
        """(p + 1, n) matrix of one span."""
        p, ends = self.degree, (self.knots[span], self.knots[span + 1])
        rows = [self._blossom(span, [ends[0]] * (p - i) + [ends[1]] * i) for i in range(p + 1)]
        return np.array(rows)

    def _blossom(self, span: int, arguments: list[float]) -> Floats:
        """(n,) weights of the control values in the polar form of a span (de Boor's algorithm, an argument a step)."""
        p, t = self.degree, self.knots
        weights = np.eye(self.count)[span - p : span + 1]
        for step, u in enumerate(arguments, 1):
            first = np.arange(span - p + step, span + 1)
            share = ((u - t[first]) / (t[first + p + 1 - step] - t[first]))[:, None]
            weights = (1 - share) * weights[:-1] + share * weights[1:]
        return np.asarray(weights[0])
