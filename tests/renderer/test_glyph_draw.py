"""Hits on solids next to one another, and what makes them doubtful, from intervals of rays within these."""

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of

COUNT, SOLIDS = 256, 3
FOUND = {
    "intervals": 7 * SOLIDS,
    **dict.fromkeys(["solid", "at", "low", "high", "missed", "inside", "doubt"], 1),
    **dict.fromkeys(["status", "depth", "uncertainty", "kept"], 1),
}
CERTAIN, AMBIGUOUS = 1, 2


class Rays:
    """Rays that begin before or within solids; surfaces of some are as far apart as they may be wrong."""

    def __init__(self, rng):
        def some(low, high, *shape):
            return rng.uniform(low, high, (COUNT, *shape))

        self.origin, self.along = some([-1, -1, -4], [1, 1, -2], 3), some([-0.2, -0.2, 0.8], [0.2, 0.2, 1.2], 3)
        self.along /= np.linalg.norm(self.along, axis=1, keepdims=True)
        self.first, self.slack = some(1.5, 4) * rng.choice([0, 1], COUNT), some(0.01, 0.05)
        self.scale, self.most = some(0.5, 2), some(0.005, 0.05)
        self.base, self.axis = some(-0.5, 0.5, SOLIDS, 3), some(-1, 1, SOLIDS, 3)
        self.length, self.radius = some(0.3, 2, SOLIDS), some(0.2, 1, SOLIDS)
        self.slope = some(-0.5, 0, SOLIDS) * rng.choice([0, 1], (COUNT, SOLIDS))
        # the last is the first one, moved along the ray by about the sum of both errors
        moved = np.resize([0.5, 1.9, 2.1, 3.0], COUNT) * self.slack
        self.base[:, 2] = self.base[:, 0] + (rng.choice([-1, 1], COUNT) * moved)[:, None] * self.along
        for own in (self.axis, self.length, self.radius, self.slope):
            own[:, 2] = own[:, 0]
        self.axis /= np.linalg.norm(self.axis, axis=2, keepdims=True)
        # the rounding of the last solids of all is as large as others' errors
        self.length[-1] = 3e6

    def rows(self):
        return rows_of(COUNT, [self.origin, self.along, self.first, self.slack, self.scale, self.most])


@pytest.fixture(scope="module")
def rays():
    return Rays(np.random.default_rng(5))


@pytest.fixture(scope="module")
def found(functions, rays):
    kernel = functions("glyph_draw")
    solids = kernel.records("solids", COUNT * SOLIDS)
    for name in ("base", "axis", "length", "radius", "slope"):
        own = getattr(rays, name)
        solids[name] = own.reshape(-1, 3) if own.ndim == 3 else own.ravel()
    hits = {name: np.zeros(3 * COUNT) for name in ("hit_reference", "hit_normal")}
    hits |= {name: np.zeros(COUNT, np.uint32) for name in ("hit_owner", "hit_status")}
    hits |= {name: np.zeros(COUNT) for name in ("hit_depth", "hit_uncertainty", "hit_doubt")}
    pixels = np.array([COUNT], np.uint32)
    (found,) = parted(kernel(rays.rows(), width_of([FOUND]), solids=solids, hit_pixels=pixels, **hits), [FOUND])
    return found


def hit_of(intervals, start):
    """The solid that a ray enters first or, from within some, the last one that it leaves; bounds of the place."""
    reach, chosen = start, None
    for _ in range(SOLIDS):
        for k, (grown, own, shrunk) in enumerate(intervals):
            if own[0] <= own[1] and own[0] <= reach < own[1]:
                least = shrunk[1] if shrunk[0] <= shrunk[1] else grown[0]
                reach, chosen = own[1], (k, own[1], *sorted([grown[1], least]), True)
    if chosen is not None:
        return chosen
    ahead = [(own[0], k) for k, (_, own, _) in enumerate(intervals) if own[0] <= own[1] and own[0] > start]
    if not ahead:
        return -1, np.inf, np.inf, np.inf, False
    at, k = min(ahead)
    grown, _, shrunk = intervals[k]
    most = shrunk[0] if shrunk[0] <= shrunk[1] else grown[1]
    return k, at, *sorted([grown[0], most]), False


def missed_of(intervals, start):
    """From where on a surface may have been missed: of solids only grazed, or whose surface is at the start."""
    found = [np.inf]
    for grown, _, shrunk in intervals:
        is_sure = shrunk[0] <= shrunk[1]
        begins_near = grown[0] <= start <= (shrunk[0] if is_sure else grown[1])
        ends_before = (shrunk[1] if is_sure else grown[0]) <= start
        if grown[0] <= grown[1] and grown[1] >= start and (not is_sure or begins_near or ends_before):
            found.append(max(grown[0], start))
    return min(found)


def test_hits_are_entries_or_ends_of_solids_in_one_another(rays, found):
    for number in range(COUNT):
        own = found["intervals"][number].reshape(SOLIDS, 7)
        start, slack = rays.first[number], rays.slack[number]
        intervals = [each[:6].reshape(3, 2) for each in own]
        near = [each for each, is_aside in zip(intervals, own[:, 6], strict=True) if not is_aside]
        k, at, low, high, is_inside = hit_of(intervals, start)
        bounds = [found[name][number] for name in ("solid", "at", "low", "high", "inside")]
        assert bounds == [k, at, low, high, is_inside]
        missed = missed_of(near, start)
        assert found["missed"][number] == missed

        # other solids that begin or end within the bounds
        doubt = missed
        for other, (grown, *_) in enumerate(intervals):
            touches = grown[0] <= grown[1] and grown[0] <= high + slack and grown[1] >= low - slack
            if k not in (-1, other) and not own[other, 6] and touches:
                doubt = min(doubt, max(low, start))
        assert found["doubt"][number] == doubt
        scale = rays.scale[number]
        assert found["kept"][number] == doubt / scale
        assert found["depth"][number] == at / scale
        if k >= 0:
            off = max(high - at, at - low) + slack
            assert found["uncertainty"][number] == pytest.approx(off / scale, rel=1e-14)
            is_certain = off <= rays.most[number] * at and doubt > at
            assert found["status"][number] == (CERTAIN if is_certain else AMBIGUOUS)
    assert min(np.bincount((found["solid"] + 1).astype(int))) > 10
    assert 10 < (found["status"] == CERTAIN).sum() < COUNT - 10
    assert 20 < (found["inside"] > 0).sum() < COUNT - 20
