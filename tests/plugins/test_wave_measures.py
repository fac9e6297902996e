"""The error of a field along a Fourier direction, from those of its planes."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.plugins.conversion.report import Measure
from elvis.plugins.fourier.quantities import WAVE_ROUNDING, joined_measure

PLANES = [
    Measure("u@0", 3, 1e-3, 2e-4, 1.0, 2.0, 1e-16, 5, False, True, 7.0),
    Measure("u@1", 4, 4e-3, 3e-4, 1.5, 1.0, 1e-16, 6, True, True, 8.0),
]


@pytest.mark.parametrize("ends", [(-4.0, 1.0), (-1.0, 4.0), (2.0, 4.0)])
@pytest.mark.parametrize("part", [0.5, 2.0])
def test_errors_of_planes_and_of_waves_that_are_left_out_add_up(ends, part):
    """Waves are at most 1 and orthogonal: maxima add up, squares too.  What is left counts beyond rounding."""
    left = part * WAVE_ROUNDING * 4.0
    found = joined_measure("u", PLANES, left, ends)
    assert (found.name, found.order, found.element, found.slope) == ("u", 4, 6, 8.0)
    assert found.max == (5e-3 if part < 1 else 5e-3 + left)
    assert found.l2 == pytest.approx(np.sqrt(13) * 1e-4)
    assert (found.range, found.magnitude) == (ends[1] - ends[0], 4.0)
    assert found.is_continuous is False


@pytest.mark.parametrize(
    ("first", "left", "exact"), [(0.9, 0.0, True), (1.1, 0.0, False), (0.9, 0.9, True), (0.9, 1.1, False)]
)
def test_fields_are_exact_if_their_planes_are_to_rounding(first, left, exact):
    rounding = WAVE_ROUNDING * 4.0
    planes = [replace(PLANES[0], max=first * rounding), PLANES[1]]
    assert joined_measure("u", planes, left * rounding, (-4.0, 1.0)).is_exact is exact
