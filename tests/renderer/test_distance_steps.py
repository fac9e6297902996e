"""Lengths along rays in which no point of a surface comes closer than a level: exact for planes and spheres."""

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of

COUNT = 96
FOUND = {
    **dict.fromkeys(["limit", "clear", "curved", "leaves", "left", "box", "distance", "boxed", "touches"], 1),
    **dict.fromkeys(["opens", "step", "stage", "part", "spread", "steady", "top"], 1),
    "change": 3,
    "place": 2,
    "gap": 3,
    "bend": 3,
    "gradient": 2,
    "nearest": 1,
    "side": 1,
    "normal": 3,
    "signed": 1,
    "direction": 3,
    "finished": 1,
    "own_bend": 1,
}
#: numbers of patches: bounds of derivatives and of how far it is from linear; coefficients of 1, s, s^2, then of t
BOUNDS, COEFFICIENTS = 10, 9


class Searches:
    """Points and directions of rays, and surfaces next to them."""

    def __init__(self, rng):
        def some(low, high, *shape):
            return rng.uniform(low, high, (COUNT, *shape))

        self.point, self.direction, self.gap = some(-0.1, 0.1, 3), some(-1, 1, 3), some(-1, 1, 3)
        self.equal, self.level = some(0.01, 0.05), some(0, 1)
        self.ahead, self.step, self.distance = rng.integers(2, size=COUNT), some(0.1, 4), some(0.3, 4)
        self.side, self.signs = some(-1, 1), rng.integers(4, size=COUNT)
        self.bend, self.spread, self.nearest = some(0, 0.2), some(0.3, 0.95), some(0.3, 4)
        self.level[::7] = 0.0
        self.distance[::7] = 64 * self.equal[::7] * rng.choice([0.99, 1.01], len(self.equal[::7]))
        low = some(-1, 1, 3)
        self.boxes = np.concatenate([low, low + some(0.02, 0.3, 3) * rng.choice([0.1, 3], (COUNT, 1))], axis=1)
        self.boxes = self.boxes.astype(np.float32)
        # squares with parabolas in each direction, a little bent, at all distances
        self.patches = np.zeros((COUNT, BOUNDS + 3 * COEFFICIENTS))
        own = self.patches[:, BOUNDS:].reshape(COUNT, 3, 3, 3)
        own[:, 0, 0] = some(-0.3, 0.3, 3) + np.array([0, 0, 1.0]) * rng.choice([0.05, 0.5, 2], (COUNT, 1))
        own[:, 0, 1], own[:, 1, 0] = np.diag([0.5, 0.5, 0])[:2, None] + some(-0.1, 0.1, 2, 3).swapaxes(0, 1)
        own[1::3, 0, 0, 0] += 3.0
        curved = some(0, 0.05, 2)
        own[:, 0, 2, 2], own[:, 2, 0, 2] = curved.T
        first = np.abs(own[:, 0, 1]), np.abs(own[:, 1, 0])
        for k in range(2):
            longest = np.linalg.norm(first[k] + 2 * np.array([0, 0, 1]) * curved[:, k : k + 1], axis=1)
            self.patches[:, k] = longest
        self.patches[:, 2], self.patches[:, 4] = 2 * curved.T
        self.patches[:, 9] = curved.sum(axis=1)
        self.middle, self.s, self.t, self.curved = own[:, 0, 0], own[:, 0, 1], own[:, 1, 0], curved
        self.own_clear, self.own_steady = some(0, 0.5) * rng.choice([0, 1], COUNT), some(0, 3)
        self.own_spread = self.spread * rng.integers(2, size=COUNT)

    def rows(self):
        alone = [self.equal, self.level, self.ahead, self.step, self.distance, self.side, self.signs]
        columns = [self.point, self.direction, *alone, self.gap, self.bend, self.spread, self.nearest]
        part = [self.own_clear, self.own_spread, self.own_steady]
        return rows_of(COUNT, [*columns, *part])

    def buffers(self):
        first = np.arange(COUNT) * self.patches.shape[1]
        kind = np.full(COUNT, 4 | 3 << 8 | 3 << 16)
        pieces = np.stack([first, kind, np.full(COUNT, 0xF), self.signs], axis=1).astype(np.uint32)
        return {"surface_pieces": pieces, "surface_numbers": self.patches, "surface_nodes": self.boxes}


@pytest.fixture(scope="module")
def searches():
    return Searches(np.random.default_rng(11))


@pytest.fixture(scope="module")
def answers(functions):
    kernel = functions("distances")
    return lambda searches: next(parted(kernel(searches.rows(), width_of([FOUND]), **searches.buffers()), [FOUND]))


@pytest.fixture(scope="module")
def found(answers, searches):
    return answers(searches)


def clearances(own, rate, searches, bend):
    """How far a point is from a half-space, up to ``bend`` nearer, or how far it may move until it is at the level."""
    near = own - bend <= searches.level + 0.1 * searches.equal
    with np.errstate(divide="ignore"):
        ahead = np.where(rate > 0, (own - bend - searches.level) * own / rate, 1e300)
    return np.where(searches.ahead, np.where(near, 0, ahead), own - bend)


def test_half_spaces_are_reached_after_the_stated_length(searches, found):
    own, rate = np.linalg.norm(searches.gap, axis=1), (searches.gap * searches.direction).sum(axis=1)
    assert found["limit"] == pytest.approx(np.where(searches.ahead, searches.step, searches.distance + searches.equal))
    clear = clearances(own, rate, searches, searches.bend)
    assert found["clear"] == pytest.approx(clear, rel=1e-12, abs=0)
    moving = (searches.ahead > 0) & (clear > 0) & (clear < 1e300)
    assert moving.sum() > 10
    end = own - clear * rate / own
    assert end[moving] == pytest.approx((searches.level + searches.bend)[moving], rel=1e-9, abs=0)

    # far ahead the bend is not looked at any more
    far = (searches.ahead > 0) & (searches.bend <= 0.25 * (own - searches.level))
    assert np.array_equal(found["leaves"], far)
    assert found["left"] == pytest.approx(
        np.where(far, np.minimum(searches.step, clear), searches.step), rel=1e-12, abs=0
    )


def convex_clearances(searches, gap):
    """The first t with min over w of D - t u . (X + w) + t^2 u^2 / 2 + w^2 / (2 spread) = level^2 / 2."""
    own, rate = np.linalg.norm(gap, axis=1), (gap * searches.direction).sum(axis=1)
    square = (searches.direction**2).sum(axis=1) * (1 - searches.spread)
    expected = np.full(COUNT, 1e300)
    for k in range(COUNT):
        roots = np.roots([square[k] / 2, -rate[k], (own[k] ** 2 - searches.level[k] ** 2) / 2])
        ahead = [root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0]
        expected[k] = min(ahead, default=1e300)
    near = own <= searches.level + 0.1 * searches.equal
    assert near.any()
    return np.where(near, 0, expected)


def test_parts_with_convex_distances_are_reached_after_the_stated_length(searches, found):
    """Other parts after the length in which distances are monotone, or at once if their end comes before."""
    assert found["curved"] == pytest.approx(convex_clearances(searches, searches.gap), rel=1e-9, abs=0)

    gap = searches.middle - searches.point
    own, rate = np.linalg.norm(gap, axis=1), (gap * searches.direction).sum(axis=1)
    straight = np.minimum(searches.own_steady, clearances(own, rate, searches, 0.0))
    length = np.where(searches.own_spread > 0, convex_clearances(searches, gap), straight)
    expected = np.minimum(searches.step, np.maximum(searches.own_clear, length))
    assert found["finished"] == pytest.approx(expected, rel=1e-9, abs=0)
    assert (expected == searches.own_steady).any()
    assert (expected == searches.own_clear).any()


def test_boxes_are_as_far_as_their_nearest_points(searches, found):
    low, high = searches.boxes.astype(float)[:, :3], searches.boxes.astype(float)[:, 3:]
    gap = np.clip(searches.point, low, high) - searches.point
    own, rate = np.linalg.norm(gap, axis=1), (gap * searches.direction).sum(axis=1)
    clear = clearances(own, rate, searches, 0.0)
    room = 0.5 * (own - searches.level)
    small = (searches.ahead > 0) & (room > 0) & (np.linalg.norm(high - low, axis=1) <= np.maximum(room, 0))
    assert 0 < small.sum() < COUNT
    assert found["box"] == pytest.approx(np.where(small, 1e300, clear), rel=1e-12, abs=0)
    assert found["distance"][~small] == pytest.approx(own[~small], rel=1e-12, abs=0)
    assert found["boxed"] == pytest.approx(
        np.where(small, np.minimum(searches.step, clear), searches.step), rel=1e-12, abs=0
    )
    touches = (searches.level == 0) & (searches.signs == 2) & (searches.distance <= 64 * searches.equal)
    assert np.array_equal(found["touches"], touches)


def jets(searches, places):
    """Points (n, p, 3) and derivatives of patches at places (p, 2): along s, t; second ones are constant."""
    s, t = places.T
    first = searches.middle[:, None] + s[:, None] * searches.s[:, None] + t[:, None] * searches.t[:, None]
    first[..., 2] += searches.curved[:, :1] * s**2 + searches.curved[:, 1:] * t**2
    along, across = (np.tile(way[:, None], (1, len(places), 1)) for way in (searches.s, searches.t))
    along[..., 2] += 2 * searches.curved[:, :1] * s
    across[..., 2] += 2 * searches.curved[:, 1:] * t
    return first, along, across


def test_parts_are_searched_as_bounds_of_their_derivatives_allow(searches, found):
    """Half the squared distance is convex, or monotone, or the part is farther than what is known: at all points."""
    line = np.linspace(-1, 1, 21)
    places = np.array([[s, t] for s in line for t in line])
    point, along, across = jets(searches, places)
    gap = point - searches.point[:, None]
    half = np.zeros((COUNT, len(places), 2, 2))
    half[..., 0, 0] = (along**2).sum(axis=2) + gap[..., 2] * 2 * searches.curved[:, :1]
    half[..., 1, 1] = (across**2).sum(axis=2) + gap[..., 2] * 2 * searches.curved[:, 1:]
    half[..., 0, 1] = half[..., 1, 0] = (along * across).sum(axis=2)
    slope = np.stack([(gap * along).sum(axis=2), (gap * across).sum(axis=2)], axis=2)
    nearest = np.linalg.norm(gap, axis=2).min(axis=1)

    # second derivatives change by no more than is stated, from those at the middle
    change = np.abs(half - found["bend"][:, None, [[0, 1], [1, 2]]]).max(axis=1)
    stated = found["change"]
    assert (change[:, 0, 0] <= stated[:, 0]).all()
    assert (change[:, 0, 1] <= stated[:, 1]).all()
    assert (change[:, 1, 1] <= stated[:, 2]).all()

    # what is left out is farther
    straight = np.linalg.norm(found["gap"], axis=1)
    rate = (found["gap"] * searches.direction).sum(axis=1)
    bend = searches.patches[:, 9]
    clear = clearances(straight, rate, searches, bend)
    assert found["part"] == pytest.approx(clear, rel=1e-9, abs=0)
    limit = np.where(searches.ahead, searches.step, np.minimum(searches.distance, searches.nearest) + searches.equal)
    leaves = (searches.ahead > 0) & (bend <= 0.25 * (straight - searches.level))
    opens = found["opens"] > 0
    assert np.array_equal(opens, ~((clear > limit) | leaves))
    assert COUNT / 5 < opens.sum() < COUNT
    skipped = ~opens & (searches.ahead == 0)
    assert (nearest >= np.minimum(searches.distance, searches.nearest))[skipped].all()

    surely = found["bend"][:, [0, 2]] - stated[:, [0, 2]]
    most = np.abs(found["bend"]) + stated
    convex = (surely > 0).all(axis=1) & (surely.prod(axis=1) > most[:, 1] ** 2)
    is_convex = (np.linalg.eigvalsh(half)[..., 0] > 0).all(axis=1)
    assert is_convex[convex].all()
    assert np.array_equal(found["spread"][opens] > 0, convex[opens])
    assert 3 < convex[opens].sum() < opens.sum()
    assert (found["stage"][opens & convex] == 1).all()

    # distances decrease along one of the coordinates on all of the part, at this rate
    steep = np.abs(found["gradient"]) - most[:, :2] - most[:, 1:]
    steady = (steep > 0).any(axis=1)
    lowest = np.abs(slope).min(axis=1)
    assert (lowest >= steep).all()
    descent = np.maximum(steep / searches.patches[:, :2], 0).max(axis=1) / np.linalg.norm(searches.direction, axis=1)
    assert found["steady"][opens] == pytest.approx(np.where(steady, descent, 0)[opens], rel=1e-9, abs=0)
    assert steady[opens].any()

    # parts of which neither is known are divided, their sides are searched too
    pushed = np.where(convex, 0, 4) + np.where(convex | steady, 0, 4)
    assert np.array_equal(found["top"][opens], pushed[opens])
    # patches are as far from linear ones as is stored with them
    assert np.array_equal(found["own_bend"], searches.patches[:, 9])


@pytest.mark.parametrize(("part", "opens"), [(0.9, True), (1.1, False)])
def test_parts_are_left_out_beyond_the_tolerance_of_the_nearest(answers, part, opens):
    searches = Searches(np.random.default_rng(11))
    searches.ahead[:], searches.distance[:] = 0, 9.0
    searches.nearest = answers(searches)["part"] - part * searches.equal
    assert (answers(searches)["opens"] == opens).all()


def test_nearest_points_at_equal_distance_decide_the_side_together(searches, found):
    """A point counts within the tolerance of the nearest; the nearest one's normal and gap are kept."""
    own, before = searches.nearest, searches.distance
    counts, nearer, replaces = own <= before + searches.equal, own < before, own < before - searches.equal
    assert found["nearest"] == pytest.approx(np.where(counts & nearer, own, before), rel=1e-12, abs=0)
    assert np.array_equal(found["side"] == searches.side, ~counts)
    front = np.cross(searches.s, searches.t) * np.where(searches.signs == 1, -1, 1)[:, None]
    size = np.linalg.norm(front, axis=1)
    kept = (counts & nearer)[:, None]
    assert found["normal"] == pytest.approx(np.where(kept, front / size[:, None], 0), rel=1e-9, abs=0)

    # inside of the patch its angle counts as all of its surroundings, of its sides as half of them
    places, inner = found["place"], (np.abs(found["place"]) < 1 - 1e-9).all(axis=1)
    gap = searches.middle + places[:, :1] * searches.s + places[:, 1:] * searches.t - searches.point
    turn = -(front * gap).sum(axis=1) / size / own
    some = counts & inner
    assert some.any()
    side = np.where(replaces, 0, searches.side) + 100 * turn
    assert found["side"][some] == pytest.approx(side[some], rel=1e-9, abs=0)
    behind = (searches.signs == 3) | (searches.signs < 2) & (found["side"] < 0)
    assert found["signed"] == pytest.approx(np.where(behind, -1, 1) * found["nearest"], rel=1e-12, abs=0)
    far = (counts & nearer) & (own > searches.equal)
    # perpendicular to the patch, away from it
    expected = np.where(behind, 1, -1)[:, None] * np.sign((gap * front).sum(axis=1))[:, None] * front / size[:, None]
    assert found["direction"][far & inner] == pytest.approx(expected[far & inner], rel=1e-9, abs=0)
