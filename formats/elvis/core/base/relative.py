"""Errors relative to the range of values, distinguished from rounding.

The range of a constant is rounding, or zero: errors cannot be measured by it.  For a constant, errors are relative to
its magnitude.  An error that is rounding of the magnitude is within any bound, even if the range is small.
"""

from __future__ import annotations

from math import isfinite

#: a range below this share of the largest magnitude belongs to a constant, computed in 64 bits
_CONSTANT = 1e-13

#: an error below this share of the largest magnitude is rounding: a few sums of numbers of 64 bits
_ROUNDING = 64 * 2.0**-52


def scale(spread: float, magnitude: float, precision: float = 0.0) -> float:
    """The divisor of an error: the range, or the magnitude if the range is rounding; 1 if both vanish.

    spread     maximum minus minimum
    magnitude  the largest absolute value
    precision  relative rounding of the values, if coarser than 64-bit rounding
    """
    if isfinite(spread) and spread > (_CONSTANT + 4 * precision) * magnitude:
        return spread
    return magnitude if isfinite(magnitude) and magnitude > 0 else 1.0


def error_limit(bound: float, spread: float, magnitude: float, precision: float = 0.0) -> float:
    """The largest error that counts as within ``bound``: that share of `scale`, or rounding of the magnitude."""
    share = bound * scale(spread, magnitude, precision)
    return max(share, _ROUNDING * magnitude) if isfinite(magnitude) else share
