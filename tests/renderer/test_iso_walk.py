"""Walks along rays by bounds of the derivative alone: no root is passed, and the only one is enclosed."""

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of

COUNT, STEPS = 128, 12
WALK = dict.fromkeys(
    ["z", "least", "most", "sign", "start", "back", "value_back", "surely", "jump", "root", "width"], 1
)
FOUND = [{"low": 1, "high": 1, "close": 1, "noise": 1}, {**WALK, "monotone": 1}, {"steps": 7 * STEPS}]


class Walks:
    """Quantities along rays, c + r z + w sin 3 z, whose derivatives are within their bounds."""

    def __init__(self, rng):
        self.apart, self.slope, self.room = rng.uniform(1e-3, 1e-2, COUNT), *rng.uniform(-1, 1, (2, COUNT, 3))
        self.room = 0.3 * np.abs(self.room) * rng.choice([0.01, 1], (COUNT, 1))
        self.held = rng.uniform(0, 0.3, COUNT) * rng.choice([0, 1], COUNT)
        self.noise = rng.choice([0.0, 1e-3], COUNT)
        self.way, self.span = rng.uniform(-1, 1, (COUNT, 3)), np.array([0.0, 2.0]) + np.zeros((COUNT, 1))
        middle, room = (self.slope * self.way).sum(axis=1), self.rooms()
        # at one end of the bounds, or in between
        self.wave = np.where(np.arange(COUNT) % 3, 0.0, room / 4)
        self.rate = middle + rng.choice([-1, 0.3, 1], COUNT) * (room - 3 * self.wave) * (1 - 1e-6)
        self.value = rng.uniform(-1, 1, COUNT) * (np.abs(self.rate) + 0.1)

    def rooms(self):
        length = np.linalg.norm(self.way, axis=1)
        return (self.room * np.abs(self.way)).sum(axis=1) + length * self.held

    def rows(self):
        columns = [self.apart, self.slope, self.room, self.held, self.noise, self.way, self.span]
        columns += [self.value, self.rate, self.wave]
        return rows_of(COUNT, columns)

    def at(self, z):
        sine = np.sin((3 * z).astype(np.float32)).astype(float)
        return self.value[:, None] + self.rate[:, None] * z + self.wave[:, None] * sine


@pytest.fixture(scope="module")
def walks():
    return Walks(np.random.default_rng(17))


@pytest.fixture(scope="module")
def found(functions, walks):
    bounds, start, steps = parted(functions("iso_walk")(walks.rows(), width_of(FOUND)), FOUND)
    at, is_found, root, width, least, most, first = np.moveaxis(steps["steps"].reshape(COUNT, STEPS, 7), 2, 0)
    named = {
        "at": at,
        "found": is_found > 0,
        "root": root,
        "width": width,
        "least": least,
        "most": most,
        "first": first,
    }
    return bounds, start, named


def test_derivatives_along_rays_are_bounded_by_slopes_and_distances(walks, found):
    bounds, start, _ = found
    middle, room = (walks.slope * walks.way).sum(axis=1), walks.rooms()
    assert bounds["low"] == pytest.approx(middle - room, rel=1e-11, abs=1e-12)
    assert bounds["high"] == pytest.approx(middle + room, rel=1e-11, abs=1e-12)
    assert (bounds["high"] - bounds["low"] >= 2 * room).all()
    assert bounds["close"] == pytest.approx(walks.apart / np.linalg.norm(walks.way, axis=1), rel=1e-12, abs=0)
    assert np.array_equal(start["monotone"], (bounds["low"] > 0) | (bounds["high"] < 0))
    assert 20 < start["monotone"].sum() < COUNT - 20


def test_the_only_root_of_monotone_quantities_is_enclosed(walks, found):
    """By interval Newton steps: of lines, whose slope is one of the ends, by both ends at once."""
    bounds, start, steps = found
    # a side of the level counts from the noise on
    lines = (start["monotone"] > 0) & (walks.wave == 0)
    root = -walks.value / walks.rate
    off = walks.noise / np.abs(walks.rate)
    inside = lines & (root > 1e-9) & (root < 2 - 1e-9)
    assert (steps["least"] <= (root + off)[:, None] + 1e-9)[lines & (root > 0)].all()
    assert (steps["most"] >= (root - off)[:, None] - 1e-9)[lines & (root > 0)].all()
    hit = steps["found"].any(axis=1)
    assert inside.sum() > 10
    assert hit[inside].all()
    assert not hit[lines & ((root < -0.1) | (root > 2.1))].any()
    k = np.argmax(steps["found"], axis=1)
    at = np.arange(COUNT), k
    assert (np.abs(steps["root"][at] - root) <= 0.5 * steps["width"][at] + 1e-9)[inside].all()
    assert np.array_equal(steps["width"][at][inside], (steps["most"] - steps["least"])[at][inside])
    fast = np.maximum(np.abs(bounds["low"]), np.abs(bounds["high"]))
    slow = np.minimum(np.abs(bounds["low"]), np.abs(bounds["high"]))
    limit = np.maximum(0.05 * bounds["close"], 4 * walks.noise / slow)
    assert (steps["width"][at] <= limit)[inside].all()

    # the first value alone: the nearest and the farthest root that the slopes allow
    x = np.abs(walks.value)
    ahead = inside & (np.sign(walks.value) == -np.sign(walks.rate))
    low = (x - walks.noise) / np.where(x > walks.noise, fast, slow)
    high = (x + walks.noise) / slow
    assert steps["least"][ahead, 0] == pytest.approx(np.maximum(low, 0)[ahead], rel=1e-9, abs=0)
    assert steps["most"][ahead, 0] == pytest.approx(high[ahead], rel=1e-9, abs=0)


def test_steps_pass_no_root_unseen(walks, found):
    """Roots lie behind points where one was found, or one may have been passed and the walk says from where on."""
    _, start, steps = found
    line = np.linspace(0, 2, 4001)
    values = walks.at(np.tile(line, (COUNT, 1)))
    changes = values[:, 1:] * values[:, :-1] < 0
    first = np.where(changes.any(axis=1), line[np.argmax(changes, axis=1)], np.inf)
    free = (start["monotone"] == 0) & (np.abs(walks.value) > 2 * walks.noise + 0.05)
    hit = steps["found"].any(axis=1)
    k = np.argmax(steps["found"], axis=1)
    at = np.arange(COUNT), k
    found_first = free & hit
    assert found_first.sum() > 5
    assert (np.abs(steps["root"][at] - first) <= np.maximum(steps["width"][at], 1e-3))[found_first].all()
    # before it is found, no step ends behind the point from which on it may have been passed
    before = np.cumsum(steps["found"], axis=1) == 0
    passed = before & (steps["at"] < 2) & (steps["first"] > first[:, None] + 1e-3)
    assert not passed[free].any()
