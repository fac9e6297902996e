"""Quantities along parts of rays in curved elements: values at complex depths lie within what is stated."""

import numpy as np
import pytest
from jets import POWERS, jets_of
from kernel_functions import parted, width_of

from elvis.core.polynomials.chebyshev_nodes import series
from elvis.renderer.passes.volume.bends import CUBE_AXES, ELLIPSES, LINE_AXES, _grown, line_tails

COUNT, LEAVES, UNIT = 24, 5, 1.2e-16
ORDER = POWERS.sum(axis=1)
NODES, TO_CHEBYSHEV = series(2)
DISC = 7
FOUND = {
    "speed": 3,
    "fast": 1,
    "placed": 1,
    "steep": 1,
    "skewness": 1,
    "inverse": 9,
    "turn": 1,
    "room": 1,
    "ellipse": 1,
    "reach": 1,
    "known": 1,
    "fields": 2 * DISC,
    "coordinates": 3 * DISC,
    "gradient": 3 * DISC,
    "turned": 9 * DISC,
    "narrowed": 1,
    "parts": 4 * len(LINE_AXES),
    "off": 1,
    "fixed": 1,
}


class Rays:
    """Points of rays in elements whose map and fields are polynomials, and sums of their derivatives on ellipses."""

    def __init__(self, rng):
        self.coefficients = rng.uniform(0.01, 0.02, (COUNT, LEAVES, 27)) * 3.0**-ORDER
        self.coefficients[:, :3] *= rng.choice([0.05, 1.0], (COUNT, 1, 1))
        for axis in range(3):
            self.coefficients[:, axis, 3**axis] += 1.0
        self.coefficients[:, 3:] *= 50
        self.coefficients[:4, :, ORDER > 1] *= 1e-6
        self.r = rng.uniform(-0.7, 0.7, (COUNT, 3))
        self.direction, self.time = rng.uniform(0.3, 1, (COUNT, 3)), rng.uniform(0.05, 0.4, COUNT)
        self.direction[1::3] *= -1
        self.e, self.errors = rng.integers(9, size=COUNT), rng.uniform(1e-3, 1e-2, (COUNT, LEAVES))
        self.errors[1::2] *= 1e-8
        self.back, self.forward = rng.uniform(0.02, 0.2, (2, COUNT))
        self.chord = np.resize([1e-5, 0.0, 1e-3, 0.0], COUNT)
        self.measured, self.net = rng.uniform(0, 1e-3, COUNT), rng.uniform(0, 1, (COUNT, 4))
        # some fits are worse than what is known of all values
        self.measured[1::5] = 1e3
        self.far = np.where(np.arange(COUNT) % 5, 0.01, 10.0)
        # points of the ray, found from guesses by one step of Newton's method
        self.on_ray = self.r
        self.guess = self.r + rng.uniform(-1, 1, (COUNT, 3)) * 10.0 ** rng.uniform(-8, 0, (COUNT, 1))
        self.r = self.guess + self.newton_step()[:, 0]

    def newton_step(self):
        """Steps (n, 1, 3) from guesses towards points of the ray."""
        target = jets_of(self.coefficients, self.on_ray[:, None])[:, :, :3, 0]
        jets = jets_of(self.coefficients, self.guess[:, None])[:, :, :3]
        return np.linalg.solve(jets[..., 1:], (target - jets[..., 0])[..., None])[..., 0]

    def rows(self):
        first = [self.r, self.direction, np.stack([self.time, self.e], axis=1), self.guess, self.chord[:, None]]
        last = np.stack([self.back, self.forward, self.measured, self.far, np.zeros(COUNT)], axis=1)
        return np.concatenate([*first, last, self.net], axis=1)


def bends_of(rays, errors=0.0):
    """(n, leaves, ellipses, 2) sums of first and second derivatives at the ends of long half axes, also of errors.

    Rows of the matrix from values to coefficients have magnitudes that sum to 2 at most, in each direction.
    """
    nodes = NODES[POWERS]
    values = jets_of(rays.coefficients, np.tile(nodes, (COUNT, 1, 1)))[..., 0]
    matrix = np.prod([TO_CHEBYSHEV[POWERS[:, None, k], POWERS[None, :, k]] for k in range(3)], axis=0)
    size = np.abs(np.einsum("ij,njl->nil", matrix, values))
    # a corner of the cube has the margin -4
    off = 8 * (5.0**2 * errors + 3 * 5 * UNIT * np.abs(values).max(axis=1)) if np.ndim(errors) else 0.0
    size = size + np.broadcast_to(off, (COUNT, LEAVES))[:, None]
    grown = _grown(2)[:, POWERS]
    first, pure = np.eye(3, dtype=int), 2 * np.eye(3, dtype=int)
    orders = [first, [*pure, *(1 - first), *(1 - first)]]
    sums = [sum(np.prod([grown[:, :, k, m] for k, m in enumerate(order)], axis=0) for order in each) for each in orders]
    return np.stack([np.einsum("ntl,et->nle", size, each) for each in sums], axis=-1)


@pytest.fixture(scope="module")
def rays():
    return Rays(np.random.default_rng(8))


@pytest.fixture(scope="module")
def enclosed(functions, rays):
    return enclosures(functions("volume_enclose"), rays)


def enclosures(kernel, rays):
    """The results of a kernel for rays, by name."""
    given = {
        "polynomials": rays.coefficients,
        "bent": bends_of(rays),
        "cube_axes": ELLIPSES,
        "leaf_errors": rays.errors,
        "line_axes": np.array(LINE_AXES),
        "line_tails": line_tails(3),
    }
    (found,) = parted(kernel(rays.rows(), width_of([FOUND]), **given), [FOUND])
    found["inverse"] = found["inverse"].reshape(COUNT, 3, 3)
    for name in ("fields", "coordinates", "gradient", "turned"):
        found[name] = found[name].reshape(COUNT, -1, DISC)
    return found


def test_bends_are_the_sums_of_derivatives_on_ellipses(functions, rays):
    """Of all terms with the errors of values; and not less than those of the polynomials themselves."""
    kernel = functions("volume_bends")
    wanted = np.array([0, COUNT, len(CUBE_AXES)], np.uint32)
    given = {"leaf_nodes": NODES, "leaf_chebyshev": TO_CHEBYSHEV, "grown": _grown(2), "leaf_errors": rays.errors}
    size = COUNT * LEAVES * len(CUBE_AXES) * 2
    memory = {"values": np.zeros(COUNT * 6 * 27), "bent": np.zeros(size), "polynomials": rays.coefficients}
    found = kernel.run(COUNT, "bent", size, wanted=wanted, **given, **memory).reshape(COUNT, LEAVES, -1, 2)
    assert found == pytest.approx(bends_of(rays, rays.errors), rel=1e-6, abs=0)

    # second derivatives of polynomials with positive coefficients, at the end of each half axis
    ends = np.tile(np.array(CUBE_AXES)[None, :, None], (COUNT, 1, 3))
    first = np.abs(jets_of(rays.coefficients, ends)[..., 1:]).sum(axis=-1).swapaxes(1, 2)
    assert (first <= found[..., 0]).all()
    assert (first / found[..., 0])[1::2].max() > 0.99


def points_of(rays, time):
    """Points (n, p, 3) of rays at complex depths within a time (n,), by Newton's method; depths (n, p)."""
    angle = np.linspace(0, 2 * np.pi, 17)
    depth = time[:, None] * np.exp(1j * angle)
    start = jets_of(rays.coefficients, rays.r[:, None])[:, :, :3, 0]
    target = start + depth[..., None] * rays.direction[:, None]
    s = np.repeat(rays.r[:, None], len(angle), axis=1) + 0j
    for _ in range(30):
        jets = jets_of(rays.coefficients, s)[:, :, :3]
        s = s - np.linalg.solve(jets[..., 1:], (jets[..., 0] - target)[..., None])[..., 0]
    return s, depth


def check_discs(discs, values, t):
    """Discs (n, k, 7) hold values (n, p, k), and what is linear in t (n, p); returns parts of radii."""
    middle, radius, slope = discs[:, None, :, 0], discs[:, None, :, 1], discs[..., 4]
    away = np.abs(values - middle)
    room = 1e-12 * (1 + np.abs(values))
    assert (away <= radius + room).all()
    assert (np.abs(values - middle - slope[:, None] * t[..., None]) <= discs[:, None, :, 2] + room).all()
    return (away / radius).max(axis=1)


def test_points_of_rays_stay_within_reach_and_fields_within_discs(rays, enclosed):
    s, depth = points_of(rays, rays.time)
    known = enclosed["known"] > 0
    assert known.sum() > 10
    away = np.abs(s - rays.r[:, None]).max(axis=(1, 2))
    assert (away <= enclosed["reach"])[known].all()
    assert (away / enclosed["reach"])[known].max() > 0.9
    jets = jets_of(rays.coefficients, s)
    t = depth / rays.time[:, None]
    inverse = enclosed["inverse"]
    turned = np.einsum("nij,npjk->npik", inverse, jets[:, :, :3, 1:]).reshape(COUNT, -1, 9)
    of_map = {"coordinates": jets[:, :, :3, 0], "turned": turned}
    found = {"fields": jets[:, :, 3:, 0], "gradient": jets[:, :, 4, 1:], **of_map}
    for name, values in found.items():
        part = check_discs(enclosed[name][known], values[known], t[known])
        assert part.max() > (0.9 if name in ("fields", "coordinates") else 0.1), name


def regions(way, turns, room, placed):
    """The first ellipse (n,) that contains Kantorovich's ball, -1 if none does, and its radius (n,)."""
    part = 2 * turns * way[:, None]
    with np.errstate(invalid="ignore"):
        reach = 2 * way[:, None] / (1 + np.sqrt(1 - part)) + placed[:, None]
    holds = (part < 0.98) & (reach <= room)
    holds &= np.logical_and.accumulate(part < 0.98, axis=1)
    first = np.where(holds.any(axis=1), np.argmax(holds, axis=1), -1)
    return first, reach[np.arange(len(way)), first]


def test_parts_of_enclosures_follow_from_derivatives(rays, enclosed):
    """Kantorovich's reach on the first ellipse that holds it, and errors of places times derivatives."""
    bends, placed, rows = bends_of(rays), enclosed["placed"], np.arange(COUNT)
    inverse = np.abs(enclosed["inverse"])
    turns = np.einsum("nij,nje->nie", inverse, bends[:, :3, :, 1]).max(axis=1)
    assert enclosed["turn"] == pytest.approx(turns[rows, rays.e], rel=1e-12, abs=0)
    moved = np.einsum("nij,nj->ni", inverse, rays.errors[:, :3]).max(axis=1)
    step = np.abs(rays.r - rays.guess).max(axis=1)
    newton = np.where(64 * turns[:, 0] * step <= 1, 5 * turns[:, 0] * step**2, np.inf)
    assert placed == pytest.approx(1e-14 + newton + 8 * (moved + 2 * rays.chord), rel=1e-9, abs=0)
    jets = jets_of(rays.coefficients, rays.r[:, None])[:, 0]
    jacobians = jets[:, :3, 1:]
    assert enclosed["inverse"] @ jacobians == pytest.approx(np.tile(np.eye(3), (COUNT, 1, 1)), abs=1e-12)
    speed = np.linalg.solve(jacobians, rays.direction[..., None])[..., 0]
    assert enclosed["speed"] == pytest.approx(speed, rel=1e-12, abs=0)
    assert enclosed["steep"] == pytest.approx(np.abs(jacobians).sum(axis=2).max(axis=1), rel=1e-12, abs=0)
    lengths = np.linalg.norm(jacobians, axis=1).prod(axis=1) / np.abs(np.linalg.det(jacobians))
    assert enclosed["skewness"] == pytest.approx(lengths, rel=1e-12, abs=0)

    # the distance from an ellipse with the half axis a: of a circle that touches it inside, or at the end of the axis
    c, axis = np.abs(rays.r), np.array(CUBE_AXES)[:, None, None]
    with np.errstate(invalid="ignore"):
        room = np.where(axis * c <= 1, np.sqrt((1 - c**2) * (axis**2 - 1)), axis - c).min(axis=2).T
    assert enclosed["room"] == pytest.approx(room[rows, rays.e], rel=1e-12, abs=0)

    ways = np.abs(speed).max(axis=1)
    first, reach = regions(ways * rays.time, turns, room, placed)
    known = enclosed["known"] > 0
    assert np.array_equal(known, first >= 0)
    assert np.array_equal(enclosed["ellipse"][known], first[known])
    assert enclosed["reach"][known] == pytest.approx(reach[known], rel=1e-12, abs=0)

    # points of a part, from the Jacobians on the ball that contains them
    inside, radius = regions(ways * np.maximum(rays.back, rays.forward), turns, room, placed)
    change = turns[rows, inside] * radius
    with np.errstate(divide="ignore", invalid="ignore"):
        narrowed = 1e-14 + newton + (moved + 2 * change * rays.chord) / (1 - change)
    narrowed = np.where((inside >= 0) & (change < 1), np.minimum(narrowed, placed), placed)
    assert enclosed["narrowed"] == pytest.approx(narrowed, rel=1e-9, abs=0)
    assert (enclosed["narrowed"] < placed).any()

    # errors of fields, positions and derivatives
    size, degree = np.abs(jets[:, 3:, 1:]).sum(axis=2), 2
    near = bends[rows, :, np.maximum(first, 0), 1]
    change, placed = near * enclosed["reach"][:, None], placed[:, None]
    of_fields = (size + change[:, 3:]) * placed + rays.errors[:, 3:]
    assert enclosed["fields"][known][:, :, 3] == pytest.approx(of_fields[known], rel=1e-9, abs=0)
    # what is not linear in the depth: points beside the ray, and second derivatives
    reach = enclosed["reach"]
    beside = np.maximum(reach - ways * rays.time, 0)
    rest = size * beside[:, None] + 0.5 * change[:, 3:] * reach[:, None]
    assert enclosed["fields"][known][:, :, 2] == pytest.approx(rest[known], rel=1e-9, abs=1e-13)
    of_places = (enclosed["steep"][:, None] + change[:, :3]) * placed + rays.errors[:, :3]
    assert enclosed["coordinates"][known][:, :, 3] == pytest.approx(of_places[known], rel=1e-9, abs=0)
    placed = placed[:, 0]
    of_field = 2 * degree * rays.errors[:, 4] + near[:, 4] * placed
    assert enclosed["gradient"][known][..., 3] == pytest.approx(np.tile(of_field[known, None], (1, 3)), rel=1e-4, abs=0)
    map_errors = np.einsum("nij,nj->ni", inverse, rays.errors[:, :3])
    map_bends = np.einsum("nij,nj->ni", inverse, near[:, :3])
    width = (near[:, 4] * reach)[known, None]
    assert enclosed["gradient"][known][..., 1] == pytest.approx(np.tile(width, (1, 3)), rel=1e-9, abs=0)
    widths = np.repeat((map_bends * reach[:, None])[known], 3, axis=1)
    assert enclosed["turned"][known][..., 1] == pytest.approx(widths, rel=1e-9, abs=0)
    of_map = 2 * degree * map_errors + 32 * enclosed["skewness"][:, None] * UNIT + map_bends * placed[:, None]
    assert enclosed["turned"][known][..., 3] == pytest.approx(np.repeat(of_map[known], 3, axis=1), rel=1e-3, abs=0)


def test_polynomials_have_discs_of_their_first_derivatives(functions, rays):
    """Errors of places count with the derivatives on the smallest ellipse, unless they exceed its room."""
    found = enclosures(functions("volume_enclose", "export static const bool plain = true;"), rays)
    known, rows, placed = found["known"] > 0, np.arange(COUNT), found["placed"]
    steep = bends_of(rays)[:, 3, :, 0]
    around = steep[rows, found["ellipse"].astype(int)]
    inside = np.where(placed < 5e-3, steep[:, 0], around)
    middle, radius, _, error = found["fields"][known, 0, :4].T
    assert middle == pytest.approx(jets_of(rays.coefficients, rays.r[:, None])[known, 0, 3, 0], rel=1e-12, abs=0)
    assert radius == pytest.approx((around * found["reach"])[known], rel=1e-12, abs=0)
    assert error == pytest.approx((inside * placed + rays.errors[:, 3])[known], rel=1e-9, abs=0)
    assert {*(placed < 5e-3)[known]} == {True, False}


def test_points_that_newtons_method_finds_are_as_close_to_the_ray_as_their_last_step_says(rays, enclosed):
    """The map's polynomials and the steps are computed here; steps that are too long prove nothing."""
    away = np.abs(rays.r - rays.on_ray).max(axis=1)
    error = enclosed["narrowed"]
    assert (away <= error).all()
    assert np.isinf(error).any()
    assert (away / error).max() > 0.02


def test_steps_with_the_jacobian_of_another_point_end_as_close_to_the_ray_as_stated(rays, enclosed):
    """The bound of `Place.narrow`, for points and guesses in balls around s where the largest turn is known."""
    rng = np.random.default_rng(3)
    inverse, share = enclosed["inverse"], []
    turns = np.einsum("nij,nje->nie", np.abs(inverse), bends_of(rays)[:, :3, :, 1]).max(axis=1)
    for radius in (0.02, 0.1, 0.2):
        there, guess, true = rays.r + radius * rng.uniform(-1, 1, (3, COUNT, 3))
        target = jets_of(rays.coefficients, true[:, None])[:, 0, :3, 0]
        jets = jets_of(rays.coefficients, np.stack([there, guess], axis=1))[:, :, :3]
        step = np.linalg.solve(jets[:, 0, :, 1:], (target - jets[:, 1, :, 0])[..., None])[..., 0]
        end = guess + step
        ball = np.maximum(radius, np.abs(end - rays.r).max(axis=1))
        k = turns[:, 2] * ball
        inside = (k < 1) & (np.abs(rays.r).max(axis=1) + ball < 1)
        error, length = np.abs(end - true).max(axis=1), np.abs(step).max(axis=1)
        share.extend((error / (2 * k * length / (1 - k)))[inside])
    assert len(share) > COUNT
    assert max(share) <= 1
    assert max(share) > 0.05


def test_differences_from_polynomials_along_rays_take_the_best_proof(rays, enclosed):
    """On the part itself by its range, on ellipses by their tails; unknown if points lie beyond the reach."""
    low, high, error, known = np.moveaxis(enclosed["parts"].reshape(COUNT, -1, 4), 2, 0)
    tails = line_tails(3)
    with np.errstate(invalid="ignore"):
        fixed = rays.measured[:, None] + 8 * error
        around = tails * ((high - low) / 2 + error) + fixed
    around[:, 0] = np.maximum(rays.net.max(axis=1) - low[:, 0], high[:, 0] - rays.net.min(axis=1)) + error[:, 0]
    fixed[:, 0] = error[:, 0]
    around = np.where(known > 0, around, np.inf)
    best, which = around.min(axis=1), around.argmin(axis=1)
    found = enclosed["off"]
    some = np.isfinite(found)
    assert 0 < some.sum() < COUNT
    assert 0 < (which[some] == 0).sum() < some.sum()
    assert found[some] == pytest.approx(best[some], rel=1e-9, abs=0)
    of_best = fixed[np.arange(COUNT), which]
    assert enclosed["fixed"][some] == pytest.approx(of_best[some], rel=1e-9, abs=0)
