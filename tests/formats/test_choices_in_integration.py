"""How boxes of an integral are improved: arrays decide like loops over boxes, expressions, directions and rules."""

from math import ceil, log2
from types import SimpleNamespace

import numpy as np
import pytest

from elvis.core.integrals.analytic_error import FURTHER
from elvis.core.integrals.groups import _ALIKE, _AS_GOOD, _NEW, Bounded

COUNT, ALLOWED = 300, np.array([1.0, 0.01])


def boxes_with(errors, gains, can_be_halved, steps=(0, 0), is_guess=False):
    """Boxes (n,) of squares whose rules have errors (n, expressions, directions, rules)."""
    known, counts = SimpleNamespace(errors=errors), tuple(3 + FURTHER[step] for step in steps)
    boxes = SimpleNamespace(can_be_halved=can_be_halved)
    return Bounded(boxes, [0, 1], counts, None, None, None, None, None, steps, known, gains, is_guess=is_guess)


@pytest.fixture
def errors():
    """Errors that decrease from rule to rule, a third of them without a known bound of the first rules."""
    rng = np.random.default_rng(7)
    found = 10.0 ** (
        rng.uniform(-2, 4, (COUNT, 2, 2, 1)) - np.cumsum(rng.uniform(0, 3, (COUNT, 2, 2, len(FURTHER))), 3)
    )
    # of every five boxes one needs many bisections, and one rules with many points
    found[::5] *= 1e9
    slow = rng.uniform(0.5, 6, (COUNT, 2, 2, 1)) * rng.uniform(0.5, 0.9, (COUNT, 2, 2, 1)) ** np.arange(len(FURTHER))
    found[4::5] = slow[4::5]
    # some bounds are unknown or zero in one direction
    found[rng.uniform(size=(COUNT, 2, 2)) < 0.1, :2] = np.inf
    found[rng.uniform(size=(COUNT, 2, 2)) < 0.1, 1] = 0.0
    # exactly the points of four parts, with what is permitted in both directions together
    rule = np.arange(len(FURTHER))
    found[0] = np.where(rule < [[3], [6]], 0.75, 0.5)
    # fewer points than those of eight parts: two bisections in one direction
    found[3] = np.where(rule < 5, [[128.0], [1.0]], 0.5)
    # a quarter of the share of the other direction
    found[1] = np.array([4.0, 1.0])[:, None]
    found *= ALLOWED[:, None, None]
    return found


@pytest.mark.parametrize("is_guess", [False, True])
@pytest.mark.parametrize("steps", [(0, 0), (1, 2)])
def test_rules_are_the_smallest_that_suffice_for_all_expressions_unless_bisection_is_cheaper(errors, steps, is_guess):
    own = boxes_with(errors, np.ones((COUNT, 2)), np.ones((COUNT, 2), bool), steps, is_guess)
    found, is_raised = own.wanted_steps(ALLOWED)
    worth = 0
    for box in range(COUNT):
        first, halvings = [], 0
        for direction in (0, 1):
            enough = [
                step
                for step in range(len(FURTHER))
                if all(errors[box, k, direction, step] <= ALLOWED[k] / 2 for k in (0, 1))
            ]
            first.append(min(enough, default=None))
            ratio = max(errors[box, k, direction, 0] * 2 / ALLOWED[k] for k in (0, 1))
            halvings += ceil(max(log2(ratio), 0.0) / (2 * 3)) if ratio < np.inf else np.inf
        expected = None not in first and (tuple(first) != steps or is_guess)
        if expected:
            points = (3 + FURTHER[first[0]]) * (3 + FURTHER[first[1]])
            expected = points <= _NEW * 9 * 2.0 ** max(halvings, 1.0)
            worth += not expected
            assert found[box].tolist() == first
        assert is_raised[box] == expected
    assert 0 < is_raised.sum() < COUNT
    assert worth


def test_boxes_are_bisected_where_most_of_the_error_of_the_second_rule_is(errors):
    """Without a bound of it where points gain most by halves, and never where boxes are too small."""
    rng = np.random.default_rng(8)
    gains, can_be_halved = rng.uniform(0.1, 1.0, (COUNT, 2)), rng.uniform(size=(COUNT, 2)) < 0.8
    errors[2], gains[2], can_be_halved[:6] = np.inf, [0.5, 1.0], True
    errors[5, ..., 1], gains[5] = 0.0, [0.1, 1.0]
    found = boxes_with(errors, gains, can_be_halved).halving(ALLOWED)
    for box in range(COUNT):
        shares = (errors[box, :, :, 1] / ALLOWED[:, None]).max(axis=0)
        if np.isfinite(shares).all() and shares.max() > 0:
            expected = shares >= _ALIKE * shares.max()
        else:
            expected = gains[box] >= _AS_GOOD * gains[box].max()
        assert found[box].tolist() == (expected & can_be_halved[box]).tolist()
