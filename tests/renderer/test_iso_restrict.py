"""Series of boxes on sub-elements: against values of the series of the boxes, in NumPy."""

import numpy as np
import pytest
from kernel_functions import rows_of
from numpy.polynomial import chebyshev

#: sub-elements, boxes, and half sides of the boxes of series relative to those of boxes
COUNT, BOXES, ROOM = 16, 3, 1.25


def test_restricted_series_have_the_values_of_those_of_their_boxes(functions):
    """Those of the quantity on its own boxes, those of the map on larger ones."""
    rng = np.random.default_rng(8)
    kernel = functions("iso_restrict", "export static const bool in_boxes = true;")
    series, maps = rng.uniform(-1, 1, (BOXES, 27)), rng.uniform(-1, 1, (2, 3, 27))
    boxes = kernel.records("box_models", BOXES)
    boxes["centre"], boxes["half"] = rng.uniform(-0.2, 0.2, (BOXES, 3)), rng.uniform(0.1, 0.4, BOXES)
    # none, one that is exact, and another
    boxes["condition_error"] = [-1.0, 0.0, 0.1]
    boxes["map"], boxes["map_half"] = [1, 0, 1], rng.uniform(0.8, 1.0, BOXES)
    boxes["map_centre"] = rng.uniform(-0.1, 0.1, (BOXES, 3))
    slot = rng.integers(BOXES, size=COUNT)
    box_centre, box_half = boxes["centre"][slot], boxes["half"][slot][:, None]
    centre = box_centre + box_half * rng.uniform(-0.5, 0.5, (COUNT, 3))
    half = box_half * rng.uniform(0.01, 0.5, (COUNT, 3))
    given = {"box_models": boxes, "leaf_series": series.reshape(-1), "map_series": maps.reshape(-1)}
    found = kernel(rows_of(COUNT, [slot, centre, half]), 30 + 4 * 27, **given)
    for number in range(COUNT):
        box = boxes[slot[number]]
        points = rng.uniform(-1, 1, (9, 3))
        places = centre[number] + half[number] * points
        of_map = found[number, 30:].reshape(27, 4)
        pairs = [(found[number, 3:30], series[slot[number]], (places - box["centre"]) / (ROOM * box["half"]))]
        for axis in range(3):
            whole = maps[int(box["map"]), axis]
            pairs.append((of_map[:, axis], whole, (places - box["map_centre"]) / (ROOM * box["map_half"])))
        for own, whole, inside in pairs:
            true = chebyshev.chebval3d(*inside.T, whole.reshape(3, 3, 3).T)
            assert chebyshev.chebval3d(*points.T, own.reshape(3, 3, 3).T) == pytest.approx(true, rel=1e-13, abs=1e-13)
        assert found[number, 0] == found[number, 3]
        assert found[number, 1] == pytest.approx(np.abs(found[number, 4:30]).sum(), rel=1e-14, abs=0)
    assert set(slot) == set(range(BOXES))
    assert np.array_equal(found[:, 2], slot > 0)
