"""Texts of stated errors: the digits that are printed never claim less than the number."""

from __future__ import annotations

from decimal import ROUND_UP, Context, Decimal
from math import isfinite

#: part of a number that is its own rounding
_CLOSE = 1e-12


def rounded_up(error: float, digits: int = 2) -> str:
    """The text of a bound or a measured error: its first ``digits`` significant digits, rounded up.

    Examples
    --------
    >>> rounded_up(1.41e-15, 1), rounded_up(0.1), rounded_up(0.0234001), rounded_up(99.2)
    ('2e-15', '0.1', '0.024', '1e+02')
    """
    nearest = f"{error:.{digits}g}"
    if not isfinite(error) or float(nearest) >= error * (1.0 - _CLOSE):
        return nearest
    return f"{float(Context(prec=digits, rounding=ROUND_UP).create_decimal(Decimal(error))):.{digits}g}"
