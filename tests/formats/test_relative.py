"""Relative errors: of ranges, of the magnitude of constants, and what rounding is."""

import math

import pytest

from elvis.core.base.relative import error_limit, scale

EPS = 2.0**-52


@pytest.mark.parametrize("magnitude", [1e-300, 1e-9, 1.0, 101325.0, 1e300])
def test_the_range_of_a_constant_is_not_a_scale(magnitude):
    for spread in (0.0, EPS * magnitude, 100 * EPS * magnitude):
        assert scale(spread, magnitude) == magnitude
    for spread in (1e-12 * magnitude, magnitude, 2 * magnitude):
        assert scale(spread, magnitude) == spread


def test_missing_digits_of_a_source_count_as_rounding():
    assert scale(1e-7, 1.0) == 1e-7
    assert scale(1e-7, 1.0, precision=2.0**-23) == 1.0


def test_rounding_of_large_numbers_is_within_any_bound():
    assert error_limit(1e-10, 2.0, 1.0) == 2e-10
    assert error_limit(1e-10, 1e-9, 1.0) == 64 * EPS
    assert error_limit(0.0, 1.0, 1e6) == 64 * EPS * 1e6


def test_zero_and_empty_arrays():
    assert scale(0.0, 0.0) == 1.0
    assert error_limit(1e-3, 0.0, 0.0) == 1e-3
    assert scale(-math.inf, math.inf) == 1.0
    assert error_limit(1e-3, math.nan, math.nan) == 1e-3
