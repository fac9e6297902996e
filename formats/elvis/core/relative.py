"""Errors as shares of the range of values, with rounding told apart.

The range of a constant is rounding, or nothing: it measures no error.  There errors are shares of the magnitude.  And
an error that is rounding of the magnitude is within any bound, however small the range is.
"""

from __future__ import annotations

from math import isfinite

#: a range below this share of the largest magnitude is that of a constant, computed in 64 bits
_CONSTANT = 1e-13

#: an error below this share of the largest magnitude is rounding: a few sums of numbers of 64 bits
_ROUNDING = 64 * 2.0**-52


def scale(spread: float, magnitude: float, precision: float = 0.0) -> float:
    """What an error is a share of: the range, or the magnitude where the range is rounding; 1 where both vanish.

    spread     greatest minus least value
    magnitude  the largest absolute value
    precision  relative rounding of the values, where it is coarser than that of 64 bits
    """
    if isfinite(spread) and spread > (_CONSTANT + 4 * precision) * magnitude:
        return spread
    return magnitude if isfinite(magnitude) and magnitude > 0 else 1.0


def error_limit(bound: float, spread: float, magnitude: float, precision: float = 0.0) -> float:
    """The largest error that counts as within ``bound``: that share of `scale`, or rounding of the magnitude."""
    share = bound * scale(spread, magnitude, precision)
    return max(share, _ROUNDING * magnitude) if isfinite(magnitude) else share
