"""Curves, strips and solids next to rays: what is proved of them holds for all that their bounds allow."""

# the kernel "ribbon" has functions of "tube", and its check calls those of "frustum"
import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of

COUNT = 1200
ASIDE, SINGLE, LEVEL = 0, 1, 2
FOUND = {
    **dict.fromkeys(["part", "bends"], 1),
    "room": 3,
    "turning": 1,
    "offset": 2,
    "stretch": 1,
    "interval": 2,
    **dict.fromkeys(["aside", "rounding"], 1),
    "outward": 3,
    "root": 1,
    "span": 2,
}


class Solids:
    """Curves and strips relative to a ray, and frusta with rays of their own."""

    def __init__(self, rng):
        def some(low, high, *shape):
            return rng.uniform(low, high, (COUNT, *shape))

        self.half, self.turn = rng.choice([0.1, 1.0], COUNT), some(0, 1) * rng.choice([0.0, 0.1, 1.0], COUNT)
        self.slack, self.width = some(0.01, 0.02) * rng.choice([0, 1], COUNT), some(0.3, 0.6)
        self.way, self.growth = rng.choice([-1.0, 1.0], COUNT), some(-1, 1, 3) * rng.choice([0, 0.1, 0.35], (COUNT, 1))
        self.at, self.speed = some(-1, 1, 3), some(-1, 1, 3) * rng.choice([0.3, 1.0], (COUNT, 1))
        self.curved = some(-1, 1, 3)
        self.curved *= (self.turn / np.linalg.norm(self.curved, axis=1))[:, None]
        self.radius = some(0.1, 0.8)
        # the ray's nearest end, turned towards it as far as allowed
        self.side, self.swing = some(-1, 1, 3), some(-0.3, 0.3, 3) * rng.choice([0, 1], (COUNT, 1))
        self.side /= np.linalg.norm(self.side, axis=1, keepdims=True)
        self.swings = some(0, 0.5) * rng.choice([0, 1], COUNT)
        self.at[::4] *= 0.02
        self.speed[::6, :2] *= 0.1
        self.base, self.axis = some(-1, 1, 3), some(-1, 1, 3)
        self.axis /= np.linalg.norm(self.axis, axis=1, keepdims=True)
        self.length, self.wide = some(0.2, 2), some(0.1, 1)
        self.slope = -some(0, 0.9) * rng.choice([0, 1], COUNT) + 0.0
        self._twist()
        # some tubes are about as wide as parts may get away from the ray
        limit = sum(self.widths_within()) + np.resize([-0.5, 0.2, 0.5], COUNT) * (self.slack + 0.002)
        self.radius = np.where((np.arange(COUNT) % 6 == 0) & (limit > 0.4), limit, self.radius)
        limit = self.radius_of_single_parts() * np.resize([0.998, 1.002], COUNT)
        self.radius = np.where((np.arange(COUNT) % 6 == 1) & (limit > 0.05) & (limit < 3.0), limit, self.radius)
        self.origin, self.along = some(-2, 2, 3), some(-1, 1, 3)
        self.along[::2] = (self.base - self.origin + some(-1, 1, 3))[::2]
        self.along[1::9] = self.axis[1::9]
        self.along /= np.linalg.norm(self.along, axis=1, keepdims=True)
        self.room = some(0, 0.1) * rng.choice([0, 1], COUNT)
        # of strips: g = rate (u - root) + (u - root)^7, rising or falling
        self.root, self.rises = some(-1.2, 1.2), rng.integers(2, size=COUNT)
        self.rate = rng.choice([1e-3, 0.1, 3.0], COUNT)
        # points whose balls just miss the ray, or just don't, if all within half a unit of the parameter may be wrong
        angle, height = some(0, 2 * np.pi), some(-1, 1)
        away = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        room = self.radius + self.growth[:, 2] * height + np.linalg.norm(self.growth, axis=1) * self.half
        distance = (room + self.slack + self.half) / (1 - (self.growth[:, :2] * away).sum(axis=1))
        self.is_missed = rng.integers(2, size=COUNT) > 0
        distance *= np.where(self.is_missed, 1.002, 0.998)
        self.apart = np.column_stack([distance[:, None] * away, height])

    def _twist(self):
        """Straight strips that turn about their line: g = s u (b + w u), whose derivative is zero at the end, or just
        beyond it."""
        own = np.arange(5, COUNT, 11)
        self.ends = own, np.resize([0.99, 1.01], len(own))
        s, w = 0.8, 0.3
        b = 2 * w * self.half[own] * self.ends[1]
        self.turn[own], self.swings[own], self.curved[own], self.at[own] = 0.0, 0.0, 0.0, [1e-6, 0.0, 0.0]
        self.speed[own], self.swing[own] = [s, 0.0, 0.0], [0.0, w, 0.0]
        self.side[own] = np.column_stack([0 * b, b, np.sqrt(1 - b**2)])

    def widths_within(self):
        """How far parts get away from the ray, by how much tubes may get narrower, and errors."""
        change, across = self.turn * self.half, np.linalg.norm(self.speed[:, :2], axis=1)
        farthest = np.linalg.norm(self.at[:, :2], axis=1) + (across + change / 2) * self.half
        narrower = np.linalg.norm(self.growth, axis=1) * (np.linalg.norm(self.speed, axis=1) + change) * self.half
        return farthest, narrower, self.slack

    def radius_of_single_parts(self):
        """Up to where the second derivative of h is negative, by an inequality that is linear in the radius."""
        change, rate = self.turn * self.half, np.linalg.norm(self.growth, axis=1)
        at, velocity = self.at[:, :2], self.speed[:, :2]
        across, speed = np.linalg.norm(velocity, axis=1), np.linalg.norm(self.speed, axis=1)
        slow, share = across - change, 1 - change / (across - change)
        beside = np.abs(at[:, 0] * velocity[:, 1] - at[:, 1] * velocity[:, 0]) / across + change * self.half / 2
        rest = slow**2 - beside / share * self.turn - rate**2 * (speed + change) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            greatest = rest / (rate * self.turn * (1 + speed / slow / share))
        return np.where(slow > 2 * change, greatest, 0.0) - self.widths_within()[1] - self.slack

    def surface_places(self):
        """Points of the first disc, the second one and the side of solids by turns, and the normals there."""
        rng, kind = np.random.default_rng(16), np.arange(COUNT) % 3
        away = np.cross(self.axis, rng.normal(size=(COUNT, 3)))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        height = np.choose(kind, [0.0, 1.0, rng.uniform(0.3, 0.7, COUNT)]) * self.length
        room = np.maximum(self.wide + self.slope * height, 0.0)
        place = self.base + height[:, None] * self.axis + (np.where(kind < 2, 0.3, 1.0) * room)[:, None] * away
        side = (away - self.slope[:, None] * self.axis) / np.hypot(1.0, self.slope)[:, None]
        return place, np.choose(kind[:, None], [-self.axis, self.axis, side]), room > 0.05

    def points(self):
        """Coefficients (n, 8, 3) whose first coordinate is the strips' g."""
        found = np.zeros((COUNT, 8, 3))
        for own, root, rate, sign in zip(found, self.root, self.rate, 2 * self.rises - 1, strict=True):
            shift = np.polynomial.Polynomial([-root, 1.0])
            own[:, 0] = sign * (rate * shift + shift**7).coef
        return found

    def rows(self):
        columns = [
            *[self.half, self.turn, self.slack, self.width, self.way, self.growth, self.at, self.speed, self.curved],
            *[self.radius, self.side, self.swing, self.origin, self.along, self.room],
            *[self.surface_places()[0], self.rises, self.apart],
        ]
        return rows_of(COUNT, columns)


@pytest.fixture(scope="module")
def solids():
    return Solids(np.random.default_rng(14))


@pytest.fixture(scope="module")
def found(functions, solids):
    kernel = functions("ribbon")
    strips, frusta = kernel.records("strips", COUNT), kernel.records("solids", COUNT)
    strips["turn"], strips["swing"] = solids.turn, solids.swings
    strips["points"], strips["across"][:, 1] = solids.points().reshape(COUNT, -1), 1.0
    for name in ("base", "axis", "length", "slope"):
        frusta[name] = getattr(solids, name)
    frusta["radius"] = solids.wide
    (found,) = parted(kernel(solids.rows(), width_of([FOUND]), strips=strips, solids=frusta), [FOUND])
    return found


def curves_of(solids, rng, count=4):
    """Points, first and second derivatives (curves, n, u, 3) of parabolas that turn as much as they may."""
    u = np.linspace(-1, 1, 41) * solids.half[:, None]
    ways = rng.normal(size=(count, COUNT, 3))
    # the first ones turn towards the ray, or away from it, across it
    ways[:2] = [solids.at * [1, 1, 0], -solids.at * [1, 1, 0]]
    second = ways / np.linalg.norm(ways, axis=2, keepdims=True) * solids.turn[:, None]
    place = solids.at[:, None] + u[..., None] * solids.speed[:, None]
    places = place + u[..., None] ** 2 / 2 * second[:, :, None]
    speeds = solids.speed[:, None] + u[..., None] * second[:, :, None]
    return u, places, speeds, np.broadcast_to(second[:, :, None], speeds.shape)


def part_of(solids):
    """What is known of tubes, and whether they may bend too much, as the kernel's comments derive it."""
    half, turn, rate = solids.half, solids.turn, np.linalg.norm(solids.growth, axis=1)
    change = turn * half
    at, velocity = solids.at[:, :2], solids.speed[:, :2]
    across, speed = np.linalg.norm(velocity, axis=1), np.linalg.norm(solids.speed, axis=1)
    farthest, narrower, slack = solids.widths_within()
    greatest = solids.radius + narrower + slack
    nearest = np.linalg.norm(at + clamped(solids)[:, None] * velocity, axis=1) - change * half / 2
    slow = across - change
    with np.errstate(divide="ignore", invalid="ignore"):
        beside = np.abs(at[:, 0] * velocity[:, 1] - at[:, 1] * velocity[:, 0]) / across + change * half / 2
        away = (beside + greatest * rate * speed / slow) / (1 - change / slow)
        against = away * turn + rate**2 * (speed + change) ** 2 + greatest * rate * turn
        is_single = (farthest < solids.radius - narrower - slack) | (slow > 2 * change) & (slow**2 > against)
    bends = np.maximum(speed - change, 0) ** 2 * (1 - rate**2) <= greatest * (1 + rate) * turn
    is_aside = nearest > greatest
    return np.where(is_aside, ASIDE, np.where(is_single, SINGLE, SINGLE + 1)), bends & ~is_aside


def test_parts_of_tubes_are_missed_or_met_once(solids, found):
    kind, may_bend = part_of(solids)
    assert np.array_equal(found["part"], kind)
    assert np.array_equal(found["bends"] > 0, may_bend)
    _, places, speeds, turns = curves_of(solids, np.random.default_rng(1))
    growth = solids.growth[:, None]
    radius = solids.radius[:, None] + ((places - solids.at[:, None]) * growth).sum(axis=-1)
    grows = (speeds * growth).sum(axis=-1)
    h = radius**2 - (places[..., :2] ** 2).sum(axis=-1)
    aside, single = found["part"] == ASIDE, found["part"] == SINGLE
    assert (h < 0).all(axis=(0, 2))[aside].all()

    # closely for straight tubes of one width
    plain = (solids.turn == 0) & (solids.growth == 0).all(axis=1)
    distance = np.linalg.norm(places[0, ..., :2], axis=-1)
    nearest = np.linalg.norm((solids.at + clamped(solids)[:, None] * solids.speed)[:, :2], axis=1)
    assert np.array_equal(aside[plain], (nearest > solids.radius + solids.slack)[plain])
    inside = distance.max(axis=1) < solids.radius - solids.slack
    assert single[plain & inside].all()

    # h has maxima only, where it is not positive all over the part
    first = radius * grows - (places[..., :2] * speeds[..., :2]).sum(axis=-1)
    rises_again = ((first[..., :-1] < 0) & (first[..., 1:] > 0)).any(axis=(0, 2))
    assert not (rises_again & (h.min(axis=(0, 2)) < 0))[single].any()
    moving = np.linalg.norm(solids.speed[:, :2], axis=1) > 0.1
    assert single[plain & ~aside & moving].all()
    assert 20 < single.sum() < COUNT - aside.sum()

    # where the direction across the ray may turn, one meeting is only known of parts within the narrowest tube
    may_turn = ~aside & (np.linalg.norm(solids.speed[:, :2], axis=1) < 2.99 * solids.turn * solids.half)
    held = sum(solids.widths_within()) < solids.radius
    assert np.array_equal(single[may_turn], held[may_turn])
    assert min((may_turn & held).sum(), (may_turn & ~held).sum()) > 20

    # |P'|^2 - (x - P) P'' stays positive at the tube's points unless it may bend too much
    size = np.abs(radius) * (1 + np.linalg.norm(growth, axis=-1)) + solids.slack[:, None]
    slowest = (speeds**2).sum(axis=-1) * (1 - (growth**2).sum(axis=-1))
    straight = (slowest > size * np.linalg.norm(turns, axis=-1)).all(axis=(0, 2))
    known = ~aside & (found["bends"] == 0)
    assert straight[known].all()
    assert known.sum() > 0.5 * (straight & ~aside).sum()
    steady = ~aside & (solids.turn == 0) & (np.linalg.norm(solids.speed, axis=1) > 0)
    assert not found["bends"][steady].any()


def clamped(solids):
    square = (solids.speed[:, :2] ** 2).sum(axis=1)
    return np.clip(-(solids.at[:, :2] * solids.speed[:, :2]).sum(axis=1) / square, -solids.half, solids.half)


def test_rooms_have_their_derivatives_and_straight_tubes_their_turns(solids, found):
    radius, at, speed = solids.radius, solids.at[:, :2], solids.speed[:, :2]
    grows, bends = (solids.growth * solids.speed).sum(axis=1), (solids.growth * solids.curved).sum(axis=1)
    h = radius**2 - (at**2).sum(axis=1)
    first = radius * grows - (at * speed).sum(axis=1)
    second = grows**2 + radius * bends - (speed**2).sum(axis=1) - (at * solids.curved[:, :2]).sum(axis=1)
    assert found["room"] == pytest.approx(np.stack([h, first, second], axis=1), rel=1e-9, abs=1e-12)

    # f = way s' w - h' / 2 is 0 there, for tubes of one width
    u = found["turning"]
    place = solids.at + u[:, None] * solids.speed
    w = np.sqrt(np.maximum(radius**2 - (place[:, :2] ** 2).sum(axis=1), 0))
    f = solids.way * solids.speed[:, 2] * w + (place[:, :2] * speed).sum(axis=1)
    met = w > 1e-6
    assert np.abs(f[met]).max() < 1e-9
    assert met.sum() > 50


def test_parts_of_strips_are_missed_met_once_or_seen_edge_on(solids, found):
    u, places, speeds, _ = curves_of(solids, np.random.default_rng(2))
    ways = np.random.default_rng(3).normal(size=(4, COUNT, 3))
    second = ways / np.linalg.norm(ways, axis=2, keepdims=True) * solids.swings[:, None]
    across = solids.side[:, None] + u[..., None] * solids.swing[:, None] + u[..., None] ** 2 / 2 * second[:, :, None]
    swings = solids.swing[:, None] + u[..., None] * second[:, :, None]
    g = places[..., 0] * across[..., 1] - places[..., 1] * across[..., 0]
    rise = speeds[..., 0] * across[..., 1] - speeds[..., 1] * across[..., 0]
    rise = rise + places[..., 0] * swings[..., 1] - places[..., 1] * swings[..., 0]
    assert found["offset"] == pytest.approx(np.stack([g[0, :, 20], rise[0, :, 20]], axis=1), abs=1e-12)

    gap = np.linalg.norm(places[..., :2], axis=-1)
    far = (gap > (solids.width + solids.slack)[:, None]).all(axis=(0, 2))
    lies_apart = (g > 0).all(axis=(0, 2)) | (g < 0).all(axis=(0, 2))
    apart = lies_apart & (np.abs(g).min(axis=(0, 2)) > solids.slack * (1 + gap.max(axis=(0, 2))))
    aside, single, level = (found["stretch"] == kind for kind in (ASIDE, SINGLE, LEVEL))
    assert (far | lies_apart)[aside].all()
    assert ((rise > 0).all(axis=(0, 2)) | (rise < 0).all(axis=(0, 2)))[single].all()
    assert (np.abs(g).max(axis=(0, 2)) <= 1.01 * solids.slack * (1 + gap.max(axis=(0, 2)) + 2))[level].all()

    # straight strips that turn: as far as the derivative of g keeps its sign
    twisted, part = solids.ends
    assert np.array_equal(single[twisted], part > 1)

    # nothing bends: decided by g and its derivative alone
    plain = (solids.turn == 0) & (solids.swings == 0) & (solids.swing == 0).all(axis=1)
    steady = plain & ~aside & (np.abs(rise[0]).min(axis=1) > 0)
    assert single[steady].all()
    assert aside[plain & apart].all()
    assert min(aside.sum(), single.sum()) > 20


def test_roots_of_strips_are_found_or_the_nearest_end(solids, found):
    """Also where the derivative at the root is a thousandth of that at an end, which leads Newton's method astray."""
    assert found["root"] == pytest.approx(np.clip(solids.root, -1, 1), abs=1e-7)


def test_balls_around_points_miss_rays_beyond_their_radius_and_all_errors(solids, found):
    first, last = found["span"].T
    assert np.array_equal(first > last, solids.is_missed)


def test_rays_meet_balls_around_points_within_their_span(solids, found):
    """Balls with the largest errors, around points as far away as possible towards the eye or away from it."""
    first, last = found["span"].T[:, ~solids.is_missed]
    apart, growth = solids.apart[~solids.is_missed], solids.growth[~solids.is_missed]
    reach, slack = solids.half[~solids.is_missed], solids.slack[~solids.is_missed]
    inner = first + 0.5 * (last - first)
    for way, end in ((-1.0, first), (1.0, last)):
        # the point in the direction from which the span's end is seen
        towards = np.column_stack([-apart[:, :2], end - inner])
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        point = apart + reach[:, None] * towards
        radius = solids.radius[~solids.is_missed] + (growth * point).sum(axis=1) + slack
        inside = radius**2 - (point[:, :2] ** 2).sum(axis=1)
        met = inside > 0.0
        at = point[:, 2] + way * np.sqrt(np.maximum(inside, 0.0))
        assert (way * (at - end) <= 1e-9)[met].all()
        assert (way * (end - at))[met].min() < 0.02


def test_rays_are_within_solids_between_the_ends_of_their_interval(solids, found):
    """With the surface moved outwards: where the height is between both discs, and q is at most the room."""
    enters, leaves = found["interval"].T
    middle = solids.base + (solids.length / 2)[:, None] * solids.axis
    nearest = ((middle - solids.origin) * solids.along).sum(axis=1)
    # 1201 places along the ray, and two on either side of each end
    ends = np.where(enters < leaves, [enters, leaves], nearest)[..., None] + [-1e-7, 1e-7]
    z = np.concatenate([nearest[:, None] + np.linspace(-6, 6, 1201), *ends], axis=1)
    away = solids.origin[:, None] + z[..., None] * solids.along[:, None] - solids.base[:, None]
    height = np.einsum("nzc,nc->nz", away, solids.axis)
    square = (away**2).sum(axis=2) - height**2
    wide = solids.wide + solids.slack * np.sqrt(1 + solids.slope**2)
    radius = wide[:, None] + solids.slope[:, None] * height
    inside = (height >= -solids.slack[:, None]) & (height <= (solids.length + solids.slack)[:, None]) & (radius >= 0)
    inside &= square - radius**2 <= solids.room[:, None]
    expected = (z >= enters[:, None]) & (z <= leaves[:, None])
    border = np.minimum(np.abs(z - enters[:, None]), np.abs(z - leaves[:, None])) < 1e-9
    assert (expected | border | ~inside).all()
    assert ((inside == expected) | border).mean() > 0.999
    assert (inside == expected)[:, 1201:].mean() > 0.98
    assert (inside.any(axis=1) == expected.any(axis=1)).mean() > 0.99
    assert COUNT / 8 < expected.any(axis=1).sum() < COUNT

    # spheres around them are missed only by rays that miss them, and by most of these
    reach = solids.length / 2 + solids.wide + 2 * solids.slack
    distance = np.linalg.norm(np.cross(middle - solids.origin, solids.along), axis=1)
    assert np.array_equal(found["aside"], distance**2 > 1.0001 * reach**2)
    plain = (solids.room == 0) & (found["aside"] > 0)
    assert not inside[plain].any()
    size = solids.length + 2 * solids.wide
    assert found["rounding"] == pytest.approx(2e-14 * size**2 * (1 + solids.slope**2), rel=1e-12, abs=0)


def test_normals_of_solids_point_out_of_the_nearest_side(solids, found):
    _, normals, is_wide = solids.surface_places()
    assert found["outward"][is_wide] == pytest.approx(normals[is_wide], abs=1e-9)
    assert is_wide.sum() > COUNT / 2
