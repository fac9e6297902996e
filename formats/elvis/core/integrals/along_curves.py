"""Integrals along curves through elements, which are located at every point of Gauss rules.

Borders of elements make kinks and jumps at unknown places; intervals on which rules differ are bisected until
all differences together are less than the requested error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import EPS, Floats
from elvis.core.integrals.curves import Curve
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression

#: Gauss points of the rules that are compared, and halvings of intervals
_COUNTS, _DEPTH = (7, 8, 10), 40
#: factor from differences of rules to the error, and rounding relative to the sum of magnitudes
_SAFETY, _ROUNDING = 8.0, 64 * EPS


#: values (n, k) at parameters (n,), NaN if there are none
Values: TypeAlias = Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class CurvePiece:
    """A curve through the elements of some patches."""

    curve: Curve
    patches: tuple[Patch, ...]

    def __len__(self) -> int:
        return 1

    @property
    def patch(self) -> Patch:
        """One of the patches that it may cross."""
        return self.patches[0]

    @property
    def has_normals(self) -> bool:
        """Never."""
        return False

    @property
    def dimension(self) -> int:
        """1."""
        return 1

    @property
    def intervals(self) -> int:
        """Intervals in each part of the curve at first: borders of elements may be anywhere."""
        return 16

    def values(self, evaluator: Evaluator, expressions: Sequence[Expression]) -> Values:
        """Values of expressions along the curve."""
        locator = Locator(self.patches)

        def at(t: Floats) -> Floats:
            points = self.curve.at(t)[0]
            location, found = locator.locate(points), np.full((len(points), len(expressions)), np.nan)
            for number, patch in enumerate(self.patches):
                here = np.flatnonzero((location.status == Status.INSIDE) & (location.patch == number))
                rows, reference = location.row[here], location.reference[here, : patch.dimension]
                for column, each in enumerate(expressions):
                    found[here, column] = evaluator.values(each, patch, rows, reference)
            return found

        return at


@dataclass(frozen=True, eq=False)
class AlongCurve:
    """Integrals of k expressions along a curve.

    value, error, rounding, magnitude  (k,)
    measure                            (k,) length where there are values
    beyond                             (k,) length where there are none: outside of elements, or at poles
    place                              (3,) such a place, None if there is none
    """

    value: Floats
    error: Floats
    rounding: Floats
    magnitude: Floats
    measure: Floats
    beyond: Floats
    place: Floats | None


class _Rules:
    """Gauss rules for expressions along a curve.

    place  (3,) where one has no value, None if none was met
    """

    def __init__(self, curve: Curve, values: Values) -> None:
        self._curve, self._values = curve, values
        self.place: Floats | None = None

    def integrals(self, low: Floats, high: Floats, count: int) -> Floats:
        """(4, n, k) over intervals (n,): values, magnitudes, lengths with and without values."""
        nodes, weights = gauss(count)
        t = low[:, None] + (high - low)[:, None] * (1 + nodes) / 2
        points, tangents = self._curve.at(t.reshape(-1))
        lengths = np.linalg.norm(tangents, axis=1).reshape(t.shape) * weights * (high - low)[:, None] / 2
        values = self._values(t.reshape(-1)).reshape(*t.shape, -1)
        is_known = np.isfinite(values)
        if not is_known.all() and self.place is None:
            self.place = points[np.flatnonzero(~is_known.all(axis=2).reshape(-1))[0]]
        terms = np.where(is_known, values, 0.0) * lengths[..., None]
        parts = (terms, np.abs(terms), is_known * lengths[..., None], ~is_known * lengths[..., None])
        return np.stack([part.sum(axis=1) for part in parts])


def along_curve(piece: CurvePiece, evaluator: Evaluator, expressions: Sequence[Expression], error: float) -> AlongCurve:
    """The integrals of expressions; ``error`` is the requested error, relative to the integrals of magnitudes."""
    rules = _Rules(piece.curve, piece.values(evaluator, expressions))
    ends = np.linspace(0.0, piece.curve.parts, piece.curve.parts * piece.intervals + 1)
    low, high = ends[:-1], ends[1:]
    total, (left, ending) = np.zeros((4, len(expressions))), np.zeros((2, len(expressions)))
    for depth in range(_DEPTH):
        *lesser, best = (rules.integrals(low, high, points) for points in _COUNTS)
        off = _SAFETY * np.max([np.abs(best - own) for own in lesser], axis=0)
        off = np.maximum(off[0], off[2] * _slope(best))
        goals = error * (total[1] + best[1].sum(axis=0)) / (4 * piece.intervals)
        is_done = (off <= np.maximum(goals, _ROUNDING * (best[1] + _slope(best) * best[2]))).all(axis=1)
        is_done |= depth == _DEPTH - 1
        total += best[:, is_done].sum(axis=1)
        left += off[is_done].sum(axis=0)
        is_end = (best[2] > 0) & (best[3] > 0)
        ending += (_slope(best) * is_end)[is_done].sum(axis=0)
        low, high = low[~is_done], high[~is_done]
        if not len(low):
            break
        middle = (low + high) / 2
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    value, magnitude, measure, beyond = total
    rounding = _ROUNDING * magnitude

    # points count for elements from which they are as far as their places are known
    left += ending * 2 * TOLERANCE * measure
    return AlongCurve(value, left + rounding, rounding, magnitude, measure, beyond, rules.place)


def _slope(best: Floats) -> Floats:
    """(n, k) mean magnitudes, in proportion to which lengths count."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(best[1] / best[2]))
