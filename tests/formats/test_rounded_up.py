"""Printed errors are never less than the errors, and by less than a unit of their last digit greater."""

import numpy as np
import pytest

from elvis.core.base.rounded_up import rounded_up


@pytest.mark.parametrize("digits", [1, 2, 3])
def test_printed_errors_are_not_less_than_errors(digits):
    errors = 10.0 ** np.random.default_rng(1).uniform(-18, 3, 500)
    for error in errors.tolist():
        told = float(rounded_up(error, digits))
        assert error <= told < error + 10.0 ** (np.floor(np.log10(error)) + 1 - digits) * (1 + 1e-9)


def test_round_and_special_numbers_stay():
    assert [rounded_up(error) for error in (0.0, 0.1, 1e-10, np.inf)] == ["0", "0.1", "1e-10", "inf"]
    assert rounded_up(np.nan) == "nan"
