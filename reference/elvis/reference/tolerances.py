"""Tolerances: what two computations of one picture may differ by, each passed or failed at a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.base.relative import error_limit
from elvis.reference.metrics import Place, extent, not_narrow, value_errors, value_range, worst
from elvis.reference.record import Record
from elvis.scene.record.frame import Status

#: maximum error of a value relative to the range, and of a position relative to the diagonal
VALUE, POSITION = 1e-11, 1e-10


@dataclass(frozen=True)
class Check:
    """The result for one tolerance.

    name    the compared property
    limit   its maximum permitted value
    found   largest error, or number of pixels
    failed  number of pixels above the limit
    worst   the worst of these
    """

    name: str
    limit: float
    found: float
    failed: int
    worst: Place | None

    @property
    def passed(self) -> bool:
        """Whether no pixel is above the limit."""
        return self.failed == 0


def check_tolerances(
    exact: Record, other: Record, ends: tuple[float, float] | None = None, diagonal: float = 0.0
) -> list[Check]:
    """Check a picture against the reference.

    ends      of the field's range; by default of the visible values
    diagonal  of the data's box in world units; by default of the visible part
    Rounding of large numbers, as far from the origin, is not a failure: if it exceeds a tolerance, it is the limit.
    Pixels that are ambiguous in either picture may belong to a neighbouring element, and may be visible in only one;
    pixels that failed in either picture are failures.  Positions may differ along their rays by the uncertainty of
    depths in both pictures; if that is more than the tolerance for positions, values are not compared.
    """
    decided = (exact.status != Status.AMBIGUOUS) & (other.status != Status.AMBIGUOUS)
    same = decided & exact.seen & other.seen & (exact.element == other.element)
    size = diagonal or extent(exact)
    moved = np.linalg.norm(other.position - exact.position, axis=2) / size
    uncertain = uncertainty_of(exact) + uncertainty_of(other)
    with np.errstate(invalid="ignore"):
        deeper = np.abs(other.depth - exact.depth)
    moved[(deeper > 0.0) & (deeper <= uncertain)] = 0.0
    away = float(np.abs(exact.position[exact.seen]).max(initial=0.0))
    gone = (exact.status == Status.FAILED) | (other.status == Status.FAILED)
    low, high = not_narrow(ends) if ends else value_range(exact)
    known = same & (uncertain <= POSITION * size)
    values = np.where(known, value_errors(exact, other, (low, high)), 0.0)
    value_limit = error_limit(VALUE, high - low, max(abs(low), abs(high))) / (high - low)
    return [
        _measure("field value", value_limit, values, exact, other),
        _measure("position", error_limit(POSITION, size, away) / size, np.where(same, moved, 0.0), exact, other),
        _no_pixel("coverage", decided & (exact.seen != other.seen), exact, other),
        _no_pixel("element", decided & exact.seen & other.seen & (exact.element != other.element), exact, other),
        _no_pixel("failed pixels", gone, exact, other),
    ]


def uncertainty_of(record: Record) -> Floats:
    """(h, w) how far the true depths may be from the given ones: 0 if the picture doesn't say."""
    return np.zeros(record.shape) if record.uncertainty is None else np.nan_to_num(record.uncertainty, posinf=np.inf)


def _measure(name: str, limit: float, values: Floats, exact: Record, other: Record) -> Check:
    """The check of a measure (h, w), in parts."""
    above = values > limit
    place = worst(exact, other, values) if above.any() else None
    return Check(name, limit, float(values.max(initial=0.0)), int(above.sum()), place)


def _no_pixel(name: str, wrong: Bools, exact: Record, other: Record) -> Check:
    """The check of pixels (h, w) that must not occur."""
    place = worst(exact, other, wrong.astype(np.float64)) if wrong.any() else None
    return Check(name, 0, float(wrong.sum()), int(wrong.sum()), place)
