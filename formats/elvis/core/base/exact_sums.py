"""Sums that are rounded once, so the order of the numbers and their distribution to processes do not matter.

`math.fsum` adds exactly and rounds the sum (Shewchuk, Adaptive Precision Floating-Point Arithmetic, 1997).  The
remainder is the sum of the same numbers and one more, so a few numbers represent many to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import copysign, fsum, inf, isfinite

from elvis.core.base.arrays import Floats


def rounded_sum(numbers: Iterable[float]) -> float:
    """The sum, rounded once; infinite if it is greater than any number, NaN if one of them is."""
    every = list(numbers)
    try:
        return fsum(every)
    except OverflowError:
        return copysign(inf, sum(every))


def parts_of_sum(numbers: Floats) -> list[float]:
    """A few numbers with the same exact sum as all (n,), which have one sign: the rounded sum, then the remainders."""
    every, parts = numbers.tolist(), list[float]()
    while rest := rounded_sum(every):
        parts.append(rest)
        if not isfinite(rest):
            break
        every.append(-rest)
    return parts
