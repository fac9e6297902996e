"""Steps of rays through sub-elements, and the roots found, in closed form: for the worst field within the bounds."""

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of

COUNT, UNIT = 64, 1.2e-16
POWERS = np.array([[k % 3, k // 3 % 3, k // 9] for k in range(27)])
ORDER = POWERS.sum(axis=1)
ROOT = {"reference": 3, "depth": 1, "uncertainty": 1, "tangent": 3}
MARCH = {"s": 3, "z": 1, "sign": 1, "last": 1, "turn": 1, "closing": 1, "modelled": 1, "lost": 1}
FOUND = [
    {
        "reference": 3,
        "correction": 3,
        "tangent": 3,
        "value": 1,
        "derivative": 1,
        "value_error": 1,
        "derivative_error": 1,
    },
    {"gradient": 3, "distance": 1, "exact": 1, "off": 1, "least": 1, "converges": 1, "next": 1},
    ROOT,
    {"shift": 1},
    *2 * [ROOT],
    *2 * [MARCH],
    {"sure": 1, "approach": 1},
    MARCH,
    {"closes": 1},
    MARCH,
    {"leave": 1},
    MARCH,
    {"doubtful": 1, "span": 2, "recorded": 1, "owner": 1, "status": 1, "hit": 1, "off": 1, "doubt": 1},
    {"reach": 2, "parallel": 6, "central": 6, "aside": 2, "steps": 3, "steps_within": 3, "meets": 1},
]
START, CHOSEN, APPROACHED, CLOSED, LEFT, HIT = 6, 7, 9, 11, 13, 14


class Rays:
    """Points next to rays in sub-elements, and what a test says of values and derivatives there."""

    def __init__(self, rng):
        def some(low, high, *shape):
            return rng.uniform(low, high, (COUNT, *shape))

        self.polynomials = some(-0.1, 0.1, 5, 27) * 3.0**-ORDER
        self.polynomials[:, [0, 1, 2], [1, 3, 9]] += 1.0
        self.fits = some(-1, 1, 27) * 3.0**-ORDER
        self.camera = some(-1, 1, 4, 4)
        self.level, self.misplaced, self.apart = some(0.0, 1), some(0.001, 0.1), np.full(COUNT, 0.5)
        self.certified = rng.integers(2, size=COUNT)
        self.centre, self.half, self.depth = some(-0.5, 0.5, 3), some(0.1, 0.5, 3), some(5, 6)
        self.curvature, self.noise, self.half_hessian = some(0.2, 1), some(0, 0.05), some(0.5, 1)
        self.derivative_bound, self.error, self.model_error = some(0.05, 0.1), some(0.001, 0.1), some(0.005, 0.05)
        self.s, self.z, self.at = some(-1, 1, 3), some(-1, 1), rng.integers(-3, 3, (COUNT, 2))
        self.exact, self.proved = rng.integers(2, size=(2, COUNT))
        self.distance = rng.choice([0.99e-7, 1.01e-7, 0.299, 0.301, 2.0], COUNT)
        self.value, self.slope = some(-1, 1) * rng.choice([0.1, 1.0], COUNT), some(-1.5, 1.5)
        self.value_error, self.slope_error = some(0, 0.1), some(0, 0.2) * rng.choice([1e-6, 1.0], COUNT)
        # some derivatives are nearly unknown, of fields that are nearly straight
        self.curvature[2::9], self.slope_error[2::9] = 1e-9, 0.45 * np.abs(self.slope[2::9])
        self.step = some(-1, 1, 3) * rng.choice([1e-10, 1e-7, 1e-2], (COUNT, 1))
        self.end, self.sign = some(0, 2), rng.choice([-1.0, 1.0], COUNT)
        self.before, self.slope_before = some(-2, 0.5), some(-1.5, 1.5)
        self.last = np.abs(self.step).max(axis=1) * rng.choice([0.5, 1.9, 2.1], COUNT)
        self.start, self.direction, self.deviation = some(-0.5, 0.5, 3), some(-1, 1, 3), some(0, 0.1, 3)
        self.span = np.stack([some(-8, -6), some(6, 8)], axis=1)
        self.place = some(-0.9, -0.45, 3)
        self.place[::3, 0] = -1 + np.resize([-3.0, -0.5, 0.5, 3.0], 22) * 1e-9
        self.place[::3, 1:] = -0.5
        self.root, self.root_error = some(1, 3), rng.choice([1e-9, 1e-2], COUNT)
        # hits must exceed previous ones by 0.5 and, if they are proved, by what they may be off
        self.nearer = np.resize(np.repeat([-0.1, 0.0, -5e-10, 1e-3], 5), COUNT)
        self.root_error[::5] = np.where(self.nearer[::5] == -5e-10, 1e-9, 1e-2)
        # some first hits are proved, and as near to the eye as they may be off
        self.apart[5::20], self.root_error[5::20] = self.root[5::20] - 5e-10, 1e-9
        self.steps, self.gradient, self.miss = some(-0.2, 0.2, 3, 3), some(-1, 1, 3), some(-3, 3, 2)
        self.mean, self.remainder, self.middle = some(-0.5, 0.5), some(0, 0.3), some(-9, 9, 2)
        self.pixels, self.place_of_pixel = rng.integers(-20, 20, (COUNT, 4)), some(-2, 2, 3)
        self.pixels[:, 2:] = self.pixels[:, :2] + np.abs(self.pixels[:, 2:])
        self.origin, self.forward = some(-1.3, 1.3, 3), some(-1, 1, 3)
        # pictures one of whose first or last columns or rows is the last or first one of the sub-element
        self.window = np.concatenate([rng.integers(-20, 20, (COUNT, 2)), rng.integers(1, 30, (COUNT, 2))], axis=1)
        for k in range(2):
            own, other = (np.arange(start + k, COUNT, 6) for start in (0, 2))
            self.window[own, k] = self.pixels[own, 2 + k] + np.resize([0, 1], len(own))
            last = self.pixels[other, k] - np.resize([0, 1], len(other))
            self.window[other, k] = last + 1 - self.window[other, 2 + k]
        # rays in which the linear part of the field is constant: at the level to what it may be off, or not quite
        self.gradient[::8] = self.forward[::8] = [1.0, 0.0, 0.0]
        self.forward[::8] = [0.0, 0.5, 1.0]
        most = np.resize([0.99, -0.99, 1.01, -1.01], COUNT) * (self.remainder + self.noise)
        self.mean[::8] = (np.repeat(most, 2)[:COUNT] - self.origin[:, 0])[::8]

    def rows(self):
        alone = [self.level, self.misplaced, self.apart, self.certified]
        bounds = [self.curvature, self.noise, self.half_hessian, self.derivative_bound, self.error, self.model_error]
        own = [self.value, self.slope, self.value_error, self.slope_error]
        columns = [
            *[self.camera.reshape(COUNT, 16), np.stack(alone, axis=1), self.centre, self.half, self.depth],
            *[np.stack(bounds, axis=1), self.s, self.z, self.at, self.exact, self.proved],
            *[self.distance, np.stack(own, axis=1), self.step, self.end, self.sign, self.before, self.slope_before],
            *[self.last, self.start, self.direction, self.deviation, self.span, self.place, self.root, self.root_error],
            *[self.steps, self.gradient, self.mean, self.remainder, self.middle, self.miss, self.pixels],
            *[self.origin, self.forward, self.place_of_pixel, self.window],
        ]
        return rows_of(COUNT, columns)


@pytest.fixture(scope="module")
def rays():
    return Rays(np.random.default_rng(9))


@pytest.fixture(scope="module")
def before(rays):
    """What pixels have before: nothing, a hit of the element itself or of another one, before or behind the root."""
    kind = np.arange(COUNT) % 4
    hit = rays.root + np.where(kind == 3, 0.5, -0.5) * np.random.default_rng(3).choice([1e-2, 1.0], COUNT)
    nobody = 0xFFFFFFFF
    owner = np.select([kind == 0, kind == 1], [nobody, 100 + np.arange(COUNT)], 7).astype(np.uint32)
    beyond = np.where(np.arange(COUNT) % 5, 0.0, rays.root - 0.5 + rays.nearer)
    lists = {"hit_owner": owner, "hit_depth": hit, "hit_uncertainty": np.full(COUNT, 1e-3), "beyond": beyond}
    return lists | {"hit_status": np.zeros(COUNT, np.uint32), "hit_doubt": np.full(COUNT, 9.0)}


@pytest.fixture(scope="module")
def found(functions, rays, before):
    kernel = functions("iso_draw", "export static const bool analytic = true;")
    given = {"polynomials": rays.polynomials, "fits": rays.fits, "hit_pixels": np.array([COUNT], np.uint32)}
    memory = {name: np.zeros(3 * COUNT) for name in ("hit_reference", "hit_normal")}

    def run():
        return list(parted(kernel(rays.rows(), width_of(FOUND), **given, **memory, **before), FOUND))

    # some roots are outside by just as much as they may be off, or by a little more
    shift = 2 * rays.root_error * np.abs(run()[2]["tangent"]).max(axis=1)
    rays.place[1::3, 1:] = -0.5
    rays.place[1::3, 0] = -1 - 1e-10 - (np.resize([0.99, 1.01], COUNT) * shift)[1::3]
    return run()


def values_of(coefficients, s, basis):
    """Values and derivatives (n, k, 4) of series (n, k, 27) at points (n, 3), of 1, x, x^2 or of T_0, T_1, T_2."""
    high = (lambda x: (x**2, 2 * x)) if basis == "powers" else (lambda x: (2 * x**2 - 1, 4 * x))
    lines = np.stack([np.ones_like(s), s, high(s)[0]], axis=-1), np.stack([0 * s, np.ones_like(s), high(s)[1]], axis=-1)
    jets = []
    for axis in (None, 0, 1, 2):
        terms = np.prod([lines[k == axis][:, k][:, POWERS[:, k]] for k in range(3)], axis=0)
        jets.append(np.einsum("nt,nkt->nk", terms, coefficients))
    return np.stack(jets, axis=-1)


def test_points_next_to_rays_have_steps_to_them_and_errors_of_these(rays, found):
    """Newton's steps to the ray and along it; the field there is that of its linear part, off by half its Hessian."""
    point, more = found[:2]
    at = rays.centre + rays.half * rays.s
    map_ = values_of(rays.polynomials, at, "powers")
    (fit,) = values_of(rays.fits[:, None], rays.s, "series").swapaxes(0, 1)
    column, row, weight, depth = rays.camera.swapaxes(0, 1)
    forms = np.stack([column - rays.at[:, :1] * weight, row - rays.at[:, 1:] * weight, depth], axis=1)
    position = np.einsum("nij,nj->ni", forms[..., :3], map_[:, :3, 0]) + forms[..., 3]
    jacobian = np.einsum("nij,njk->nik", forms[..., :3], map_[:, :3, 1:]) * rays.half[:, None]
    target = np.stack([0 * rays.z, 0 * rays.z, rays.z + rays.depth], axis=1)
    correction = np.linalg.solve(jacobian, (target - position)[..., None])[..., 0]
    tangent = np.linalg.solve(jacobian, np.tile([[0.0], [0.0], [1.0]], (COUNT, 1, 1)))[..., 0]
    value = np.where(rays.exact, map_[:, 3, 0] - rays.level, fit[:, 0])
    distance = np.abs(correction).max(axis=1)
    expected = {
        "reference": at,
        "correction": correction,
        "tangent": tangent,
        "value": value + (fit[:, 1:] * correction).sum(axis=1),
        "derivative": (fit[:, 1:] * tangent).sum(axis=1),
        "value_error": 2 * rays.half_hessian * distance**2,
        "derivative_error": 4 * rays.half_hessian * distance * np.abs(tangent).max(axis=1) + rays.derivative_bound,
    }
    for name, each in expected.items():
        assert point[name] == pytest.approx(each, rel=1e-8, abs=0), name
    gradient = np.linalg.solve(map_[:, :3, 1:].swapaxes(1, 2), (fit[:, 1:] / rays.half)[..., None])[..., 0]
    assert more["gradient"] == pytest.approx(gradient, rel=1e-9, abs=0)
    assert more["distance"] == pytest.approx(distance, rel=1e-8, abs=0)


def converges(rays, least):
    length = np.abs(rays.step).max(axis=1)
    rests = (length < 1e-6) & (length * rays.slope_error <= 1e-10 * least)
    return (length < 1e-9) | rests


def test_roots_are_off_by_values_over_slopes_and_by_last_steps(rays, found):
    point, more, root, shift, somewhere, likely = found[:6]
    least = np.maximum(np.abs(rays.slope) - rays.slope_error, 0)
    is_short = converges(rays, least)
    assert more["least"] == pytest.approx(least, rel=1e-12, abs=0)
    assert np.array_equal(more["off"], rays.distance > 1e-7)
    assert np.array_equal(more["converges"], is_short)
    assert np.array_equal(more["exact"], rays.exact)

    # a root has no other before -noise + d t - K t^2 returns to 0
    square = least**2 - 4 * rays.curvature * rays.noise
    next_root = np.where(square > 0, (least + np.sqrt(np.maximum(square, 0))) / 2 / rays.curvature, 0)
    assert more["next"] == pytest.approx(next_root, rel=1e-12, abs=0)

    length, tangent = np.abs(rays.step).max(axis=1), point["tangent"]
    error = rays.error + rays.misplaced * np.linalg.norm(more["gradient"], axis=1) + rays.value_error
    error += np.where(is_short, rays.curvature * (rays.value / rays.slope) ** 2, 0)
    is_steady = (rays.proved > 0) & (least**2 > 4 * rays.curvature * (rays.noise + error))
    left = np.where(is_short, length**2, length) + length * np.minimum(rays.slope_error / np.maximum(least, 1e-300), 1)
    with np.errstate(divide="ignore"):
        off = 2 * error / np.where(is_steady, least, 0) + 4 * UNIT * np.abs(rays.z)
    off += left / np.abs(tangent).max(axis=1)
    assert 0 < is_steady.sum() < COUNT
    assert root["uncertainty"] == pytest.approx(off, rel=1e-9, abs=0)
    at = rays.centre + rays.half * rays.s
    assert root["reference"] == pytest.approx(at + rays.half * rays.step, rel=1e-12, abs=0)
    assert root["tangent"] == pytest.approx(rays.half * tangent, rel=1e-12, abs=0)
    steps = np.abs(rays.half * tangent).max(axis=1)
    assert shift["shift"] == pytest.approx(2 * np.minimum(off, 1e300) * steps, rel=1e-9, abs=0)

    assert np.isinf(somewhere["uncertainty"]).all()
    assert somewhere["reference"] == pytest.approx(at + rays.half * point["correction"], rel=1e-9, abs=0)
    assert likely["depth"] == pytest.approx(rays.z + rays.step[:, 0], rel=1e-12, abs=0)
    ahead = point["correction"] + rays.step[:, :1] * tangent
    assert likely["reference"] == pytest.approx(at + rays.half * ahead, rel=1e-9, abs=0)


def test_steps_pass_no_root_of_the_worst_field(rays, found):
    """x - e - noise + (r - d) t - K t^2 is above 0 before the step, and 0 at its end."""
    start, chosen, march, approached = found[START], found[CHOSEN], found[APPROACHED - 1], found[APPROACHED]
    assert np.array_equal(start["s"], rays.s)
    assert (start["sign"] == 0).all()
    clear = (np.abs(rays.value) > rays.value_error + 4 * rays.noise) & (rays.distance < 0.3)
    on_ray = rays.distance <= 1e-7
    side = np.where(clear, np.sign(rays.value), np.where(on_ray, -np.sign(rays.slope), 0))
    assert np.array_equal(chosen["sign"], side)

    x, least = rays.sign * rays.value, np.maximum(rays.sign * rays.value - rays.value_error - rays.noise, 0)
    up, curvature = rays.sign * rays.slope - rays.slope_error, rays.curvature
    moves = (rays.distance < 0.3) & ((x > rays.value_error) | on_ray)
    roots = np.array([max(np.roots(row).real) for row in np.stack([-curvature, up, least], axis=1)])
    assert march["approach"] == pytest.approx(np.where(moves, roots, 0), rel=1e-9, abs=1e-12)
    flat = (up <= 0) | (up**2 <= 8 * curvature * rays.noise)
    lost = moves & on_ray & (x <= 2 * rays.noise) & flat
    assert np.array_equal(approached["lost"], lost)
    assert lost.any()
    assert approached["s"] == pytest.approx(rays.s + found[0]["correction"], rel=1e-12, abs=0)

    # the secant of derivatives meets 0 at the turn
    bend = rays.sign * (rays.slope - rays.slope_before) / (rays.z - rays.before)
    turn = np.where((rays.z > rays.before) & (bend > 0), np.maximum(-rays.sign * rays.slope / bend, 0), 0)
    assert approached["turn"] == pytest.approx(np.where(on_ray, turn, 0), rel=1e-9, abs=0)


def test_newtons_method_starts_only_where_one_root_lies_ahead(rays, found):
    """x + e - d t + K t^2 has a root, and the first lies before the end."""
    march, closed, left = found[APPROACHED - 1], found[CLOSED], found[LEFT]
    descent, most = -rays.sign * rays.slope - rays.slope_error, rays.sign * rays.value + rays.value_error
    alone = (descent > 0) & (descent**2 > 4 * rays.curvature * (most + rays.noise))
    with np.errstate(all="ignore"):
        ends = rays.z + 2 * most / descent <= rays.end + 1e-3 / np.abs(found[0]["tangent"]).max(axis=1)
    assert np.array_equal(march["sure"], alone & ends)
    assert 0 < march["sure"].sum() < alone.sum()

    length = np.abs(rays.step).max(axis=1)
    least = np.maximum(np.abs(rays.slope) - rays.slope_error, 0)
    ends = (rays.exact > 0) & (converges(rays, least) | (length < 1e-6) & (length > 0.5 * rays.last))
    assert np.array_equal(found[CLOSED - 1]["closes"], ends)
    assert closed["z"] == pytest.approx(rays.z - rays.value / rays.slope, rel=1e-12, abs=0)
    assert closed["s"] == pytest.approx(rays.s + rays.step, rel=1e-12, abs=0)
    assert closed["last"] == pytest.approx(length, rel=1e-12, abs=0)

    next_root = np.where(found[1]["next"] == 0, np.abs(rays.slope) / rays.curvature, found[1]["next"])
    assert found[LEFT - 1]["leave"] == pytest.approx(next_root, rel=1e-12, abs=0)
    assert np.array_equal(left["sign"], np.where(rays.slope < 0, -1, 1))
    assert np.array_equal(found[HIT]["doubtful"], np.abs(rays.value) <= 8 * rays.model_error)


def test_spans_hold_all_points_of_lines_that_may_lie_in_the_element(rays, found):
    """Lines may be off by the deviation: what remains of a span ends where the nearest of these points leaves."""
    t = np.linspace(0, 1, 4001)[None] * (rays.span[:, 1:] - rays.span[:, :1]) + rays.span[:, :1]
    s = rays.start[:, None] + t[..., None] * rays.direction[:, None]
    points = rays.centre[:, None] + rays.half[:, None] * s
    margin = np.minimum(1 + points.min(axis=2), -1 - points.sum(axis=2))
    room = (rays.half * (rays.deviation + 1e-7)).sum(axis=1)
    inside = margin + room[:, None] >= 0
    low, high = found[HIT]["span"].T
    some = inside.any(axis=1)
    first, last = np.where(inside, t, np.inf).min(axis=1), np.where(inside, t, -np.inf).max(axis=1)
    assert (low <= first + 1e-9)[some].all()
    assert (high >= last - 1e-9)[some].all()
    ends = [narrowed(rays, number, room[number]) for number in range(COUNT)]
    assert found[HIT]["span"] == pytest.approx(np.array(ends), rel=1e-11, abs=1e-11)
    assert (low > high)[~some].mean() > 0.5


def narrowed(rays, number, room):
    """Ends of a span after three chords from each, along which margins rise inwards."""
    start, direction = rays.centre + rays.half * rays.start, rays.half * rays.direction

    def margin(t):
        point = start[number] + t * direction[number]
        return min(1 + point.min(), -1 - point.sum()) + room

    ends = list(rays.span[number])
    for n in range(6):
        at, step = ends[n % 2], 1e-3 * (ends[1 - n % 2] - ends[n % 2])
        if margin(at) < 0 and ends[0] <= ends[1]:
            rise = margin(at + step) - margin(at)
            ends[n % 2] = at - margin(at) * step / rise if rise > 0 else [1e300, -1e300][n % 2]
    return ends


def test_rays_meet_levels_where_sub_elements_and_linear_parts_allow(rays, found):
    """At the ends of a span one of four conditions holds to rounding, and all hold between them."""
    normals = np.concatenate([np.tile(np.eye(3), (COUNT, 1, 1)), rays.gradient[:, None]], axis=1)
    constant = np.einsum("nij,nj->ni", normals, rays.origin)
    constant[:, 3] += rays.mean
    slope = np.einsum("nij,nj->ni", normals, rays.forward)
    is_flat = slope[:, 3] == 0
    field = rays.remainder + np.where(is_flat, 1, 2) * rays.noise
    most = np.concatenate([1 + 1e-7 + rays.deviation, field[:, None]], axis=1)

    def excess(z):
        return (np.abs(constant + slope * z[:, None]) - most).max(axis=1)

    low, high = found[-1]["reach"].T
    some = low <= high
    assert 0 < (some & is_flat).sum() < is_flat.sum()
    assert np.abs(excess(low))[some & ~is_flat].max() < 1e-12
    assert np.abs(excess(high))[some & ~is_flat].max() < 1e-12
    assert (excess(0.5 * (low + high))[some] < 0).all()
    assert min(excess(np.full(COUNT, z))[~some].min() for z in np.linspace(-9, 9, 2001)) > 0


def test_lines_of_pixels_are_where_linear_maps_have_their_distances(rays, found):
    """In perspective distances from the middle grow with depth."""
    u, v, _ = rays.place_of_pixel.T
    for name, weights in (("parallel", np.ones((2, COUNT))), ("central", rays.depth + np.array([[0.0], [1.0]]))):
        start, direction = found[-1][name].reshape(COUNT, 2, 3).swapaxes(0, 1)
        for further, weight in enumerate(weights):
            distances = np.stack([u * weight - rays.miss[:, 0], v * weight - rays.miss[:, 1], 0 * u + further], axis=1)
            s = np.einsum("ni,nij->nj", distances, rays.steps)
            assert start + further * direction == pytest.approx(s, rel=1e-12, abs=1e-12)
    corners = rays.pixels.reshape(COUNT, 2, 2)
    assert np.array_equal(found[-1]["aside"], np.abs(corners - rays.middle[:, None]).max(axis=1))
    first, last = corners.swapaxes(0, 1)
    start, size = rays.window.reshape(COUNT, 2, 2).swapaxes(0, 1)
    meets = ((first < start + size) & (last >= start)).all(axis=1)
    assert np.array_equal(found[-1]["meets"], meets)
    steps = rays.place_of_pixel[:, :, None] * rays.steps
    assert found[-1]["steps"] == pytest.approx(steps.sum(axis=1), rel=1e-12, abs=1e-12)
    assert found[-1]["steps_within"] == pytest.approx(np.abs(steps).sum(axis=1), rel=1e-12)


def test_only_the_nearest_root_of_one_element_is_certain(rays, before, found):
    hit, shift = found[HIT], 2 * rays.root_error * np.abs(found[2]["tangent"]).max(axis=1)
    place, owner, own = rays.place, before["hit_owner"], 100 + np.arange(COUNT)
    margin = np.minimum(1 + place.min(axis=1), -1 - place.sum(axis=1))
    least = np.maximum(before["beyond"] + rays.apart, 0)
    proved = rays.root_error <= 1e-8 * rays.root
    is_old = (rays.root <= least) | proved & (before["beyond"] > 0) & (rays.root - rays.root_error <= least)
    is_outside = margin < -1e-10
    is_near = is_outside & ~is_old & (margin >= -1e-10 - shift)
    there = owner != 0xFFFFFFFF
    shared = there & (owner != own) & (np.abs(before["hit_depth"] - rays.root) <= 1e-3 + rays.root_error)
    behind = there & (before["hit_depth"] <= rays.root)
    recorded = ~is_old & ~is_outside
    clear = proved & ~shared & (rays.certified > 0) & ~(margin <= 1e-10 + shift)
    is_new = recorded & ~behind
    assert np.array_equal(hit["recorded"], recorded)
    assert np.array_equal(hit["doubt"], np.where(is_near, rays.root, 9.0))
    assert np.array_equal(hit["owner"], np.where(is_new, own, owner))
    status = np.where(is_new, np.where(clear, 1, 2), np.where(recorded & shared, 2, 0))
    assert np.array_equal(hit["status"], status)
    assert np.array_equal(hit["hit"], np.where(is_new, rays.root, before["hit_depth"]))
    off = np.where(rays.certified > 0, rays.root_error, np.inf)
    assert np.array_equal(hit["off"], np.where(is_new, off, 1e-3))
    for some in (is_old, is_near, clear & is_new, shared & is_new, shared & behind & recorded):
        assert some.any()
