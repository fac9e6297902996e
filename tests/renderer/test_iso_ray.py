"""Levels that count where a condition is negative: what its sign may be at roots that are off."""

import numpy as np
from kernel_functions import rows_of

COUNT = 64


def test_levels_count_by_a_condition_and_are_doubtful_where_its_sign_is(functions):
    """It changes by its slope, relative to the box, times how far the root is from the point where it is known."""
    rng = np.random.default_rng(6)
    kernel = functions("iso_ray", "export static const bool analytic = true;")
    boxes = kernel.records("box_models", COUNT)
    error, slope, half = rng.uniform(0, 0.1, COUNT), rng.uniform(0.5, 2, COUNT), rng.uniform(0.1, 1, COUNT)
    # in some boxes the whole level counts
    error[::8] = -1.0
    boxes["condition_error"], boxes["condition_slope"], boxes["half"] = error, slope, half
    depth, tangent = rng.uniform(1, 2, COUNT), rng.uniform(-1, 1, (COUNT, 3))
    uncertainty, moved = 10.0 ** rng.uniform(-3, -1, (2, COUNT))
    off = error + slope * (2 * uncertainty * np.abs(tangent).max(axis=1) + moved) / half
    condition = np.resize([1.01, -1.01, 0.99, -0.99], COUNT) * off
    condition[::8] = 1e3
    # a root about whose place nothing is known
    uncertainty[-1] = np.inf
    rows = rows_of(COUNT, [condition, depth, uncertainty, moved, tangent])
    counts, doubt = kernel(rows, 2, box_models=boxes, hit_doubt=np.full(COUNT, 9.0)).T
    is_whole = error < 0
    assert np.array_equal(counts > 0, is_whole | (condition < 0))
    is_doubtful = ~is_whole & (np.resize([False, False, True, True], COUNT) | np.isinf(uncertainty))
    assert np.array_equal(doubt, np.where(is_doubtful, depth, 9.0))
