"""Tolerances: what two computations of one picture may differ by, each passed or failed at a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Bools, Floats
from elvis.core.relative import error_limit
from elvis.reference.metrics import Place, extent, not_narrow, value_errors, value_range, worst
from elvis.reference.record import Record
from elvis.scene.frame import Status

#: greatest error of a value in parts of the range, and of a position in parts of the diagonal
VALUE, POSITION = 1e-11, 1e-10


@dataclass(frozen=True)
class Check:
    """What was found for one tolerance.

    name    what is compared
    limit   what it may be at most
    found   greatest error, or number of pixels
    failed  pixels above the limit
    worst   the worst of them
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

    ends      of the field's range; by default what is seen
    diagonal  of the data's box in world units; by default of what is seen
    Rounding of large numbers is no failure: where it is more than a tolerance, as far from the origin, it is the limit.
    Pixels that either calls ambiguous may belong to a neighbouring element, and may be seen in one alone; those that
    either calls failed are failures.  Places may differ along their rays by what both pictures say of the uncertainty
    of depths; where that is more than the tolerance for places, values are not compared.
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
    """(h, w) how far the true depths may be from the given ones: 0 where the picture doesn't say."""
    return np.zeros(record.shape) if record.uncertainty is None else np.nan_to_num(record.uncertainty, posinf=np.inf)


def _measure(name: str, limit: float, values: Floats, exact: Record, other: Record) -> Check:
    """The check of a measure (h, w), in parts."""
    above = values > limit
    place = worst(exact, other, values) if above.any() else None
    return Check(name, limit, float(values.max(initial=0.0)), int(above.sum()), place)


def _no_pixel(name: str, wrong: Bools, exact: Record, other: Record) -> Check:
    """The check of pixels (h, w) of which there may be none."""
    place = worst(exact, other, wrong.astype(np.float64)) if wrong.any() else None
    return Check(name, 0, float(wrong.sum()), int(wrong.sum()), place)
