"""Series of boxes on sub-elements: against values of the series of the boxes, in NumPy."""

import numpy as np
import pytest
from kernel_functions import rows_of
from numpy.polynomial import chebyshev

#: sub-elements, boxes, and half sides of the boxes of series relative to those of boxes
COUNT, BOXES, ROOM = 16, 3, 1.25


def test_restricted_series_have_the_values_of_those_of_their_boxes(functions):
    rng = np.random.default_rng(8)
    kernel = functions("iso_restrict", "export static const bool in_boxes = true;")
    series = rng.uniform(-1, 1, (BOXES, 5, 27))
    boxes = kernel.records("box_models", BOXES)
    boxes["centre"], boxes["half"] = rng.uniform(-0.5, 0.5, (BOXES, 3)), rng.uniform(0.1, 0.5, BOXES)
    # none, one that is exact, and another
    boxes["condition_error"] = [-1.0, 0.0, 0.1]
    slot = rng.integers(BOXES, size=COUNT)
    box_centre, box_half = boxes["centre"][slot], boxes["half"][slot][:, None]
    centre = box_centre + box_half * rng.uniform(-0.5, 0.5, (COUNT, 3))
    half = box_half * rng.uniform(0.01, 0.5, (COUNT, 3))
    found = kernel(rows_of(COUNT, [slot, centre, half]), 30, box_models=boxes, leaf_series=series.reshape(-1))
    for number in range(COUNT):
        own, whole = (some.reshape(3, 3, 3).T for some in (found[number, 3:], series[slot[number], 3]))
        points = rng.uniform(-1, 1, (9, 3))
        inside = (centre[number] + half[number] * points - box_centre[number]) / (ROOM * box_half[number])
        true = chebyshev.chebval3d(*inside.T, whole)
        assert chebyshev.chebval3d(*points.T, own) == pytest.approx(true, rel=1e-13, abs=1e-13)
        assert found[number, 0] == found[number, 3]
        assert found[number, 1] == pytest.approx(np.abs(found[number, 4:]).sum(), rel=1e-14, abs=0)
    assert set(slot) == set(range(BOXES))
    assert np.array_equal(found[:, 2], slot > 0)
