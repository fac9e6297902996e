"""Sums that are rounded once, so that neither order nor who adds which numbers changes them.

`math.fsum` adds exactly and rounds the sum (Shewchuk, Adaptive Precision Floating-Point Arithmetic, 1997).  What it
leaves is a sum of the same numbers and one more: so a few numbers stand for many, to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import copysign, fsum, inf, isfinite

from elvis.core.arrays import Floats


def rounded_sum(numbers: Iterable[float]) -> float:
    """The sum, rounded once; infinite where it is greater than any number, NaN where one of them is."""
    every = list(numbers)
    try:
        return fsum(every)
    except OverflowError:
        return copysign(inf, sum(every))


def parts_of_sum(numbers: Floats) -> list[float]:
    """Few numbers with the exact sum of all (n,), which are of one sign: the rounded sum, then what it lacks."""
    every, parts = numbers.tolist(), list[float]()
    while rest := rounded_sum(every):
        parts.append(rest)
        if not isfinite(rest):
            break
        every.append(-rest)
    return parts
