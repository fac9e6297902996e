"""Steps of lines on a device: errors, dense output, sides that are met, and positions beyond them, in NumPy."""

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of

COUNT, STAGES, RESULT, DEGREE = 48, 16, 12, 7
FOUND = {
    **dict.fromkeys(["error", "adapted", "defect"], 1),
    "spread": 32,
    "state": 4,
    "slope": 4,
    "place": 1,
    "side": 1,
    "long": 1,
    "shift": 1,
    "end": 4,
    **dict.fromkeys(["enters", "crosses"], 1),
    "beyond": 3,
    "element": 1,
    "entered": 1,
    "rate": 3,
    "speed": 1,
    "moved": 3,
    "orientation": 1,
    "dropped": 1,
    "holds": 2,
}
VERTICES = np.array([[-1.0, -1, -1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
#: 0 on a side and 1 at the vertex that it lacks: gradients and offsets
HEIGHTS = np.array([[-0.5, -0.5, -0.5, -0.5], [0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5]])
#: vertices of the sides, and where those lie in the neighbour
CORNERS = np.array([[k for k in range(4) if k != side] for side in range(4)])
NEIGHBOURS = np.array([[2, 0, 3], [1, 3, 0], [3, 2, 1], [0, 1, 2]])
NOBODY = 0xFFFFFFFF


class Lines:
    """Lines in tetrahedra with trial steps, of random derivatives at their stages."""

    def __init__(self, rng):
        def some(low, high, *shape):
            return rng.uniform(low, high, (COUNT, *shape))

        self.state, self.rate, self.jacobian = some(-1, 1, 4), some(-1, 1, 4), some(-1, 1, 3, 3)
        self.tolerance, self.defect, self.width = some(0.1, 1), some(1, 5), some(0.1, 1)
        self.along, self.beside, self.beside_outer = some(0.01, 0.3), some(0.01, 0.02), some(0.03, 0.04)
        self.rounded, self.length, self.gap = some(0.1, 1), some(0.5, 1.5), some(0.1, 0.2)
        ends = [[0.8], [0.6], [1.5]], [[0.9], [0.9], [3.0]]
        self.safety, self.shrink, self.grow = np.random.default_rng(14).uniform(*ends, (3, COUNT))
        self.tolerance *= np.resize([0.1, 1.0, 10.0, 1e6], COUNT)
        self.rates, self.end = some(-1, 1, STAGES, 4), some(-1, 1, 4)
        # the error of the rule, or that of the dense output, is the larger one
        self.slope, self.velocity = some(-1, 1, 4), some(-1, 1, 4)
        self.slope *= rng.choice([1, 100], (COUNT, 1))
        start = rng.dirichlet(np.ones(4), COUNT) @ VERTICES
        ends = start + some(-2, 2, 3)
        t = np.arange(8)[:, None] / 7
        self.nets = np.zeros((COUNT, 8, 4))
        self.nets[..., :3] = start[:, None] + t * (ends - start)[:, None] + some(-0.2, 0.2, 8, 3) * t * (1 - t) * 4
        self.nets[..., 3] = np.cumsum(some(0, 0.3, 8), axis=1)
        # some begin on a side, or a little beyond it
        which = np.arange(COUNT) % 4
        height = (start * HEIGHTS[which, :3]).sum(axis=1) + HEIGHTS[which, 3] + rng.choice([0.015, 0.035, 0.0], COUNT)
        way = HEIGHTS[which, :3] / (HEIGHTS[which, :3] ** 2).sum(axis=1, keepdims=True)
        self.nets[::3, :, :3] -= (height[:, None] * way)[::3, None]
        self.place, self.last = some(0, 1), some(-1, 1, 4)
        self.at, self.checked, self.side = some(-0.5, 0.5, 3), rng.integers(2, size=COUNT), np.arange(COUNT) % 4
        self.apart = some(-0.1, 0.1, 3) * rng.choice([1, 2], (COUNT, 1))
        weights = rng.dirichlet(np.ones(3), COUNT)
        self.weights, self.on_side = weights, np.einsum("nk,nkc->nc", weights, VERTICES[CORNERS[self.side]])
        self.errors, self.dense = rng.uniform(-1, 1, (2, STAGES)), rng.uniform(-1, 1, (4, STAGES))
        self.powers = rng.uniform(-1, 1, (7, 8))
        polynomials = rng.uniform(-0.1, 0.1, (5, 27))
        polynomials[[0, 1, 2], [1, 3, 9]] += 1.0
        self.polynomials = polynomials

    def rows(self):
        limits = [self.tolerance, self.defect, self.along, self.beside, self.beside_outer, self.rounded]
        limits += [self.length, self.gap, self.safety, self.shrink, self.grow]
        columns = [
            *[self.state, self.rate, self.jacobian, *limits, self.width, self.rates, self.end],
            *[self.slope, self.velocity, self.nets, self.place, self.last, self.at, self.checked, self.side],
            *[self.apart, self.on_side, *self.motions()],
        ]
        return rows_of(COUNT, columns)

    def motions(self):
        """Velocities in elements, and models of them on boxes with points just within a part of them, or not."""
        rng = np.random.default_rng(9)
        self.frames, self.velocities = rng.uniform(-1, 1, (COUNT, 3, 3)), rng.uniform(-1, 1, (COUNT, 3))
        self.sign, self.moved = rng.choice([-1, 1], COUNT), rng.uniform(-1, 1, (COUNT, 3))
        middle, self.half = rng.uniform(-0.5, 0.5, (COUNT, 3)), rng.uniform(0.1, 0.5, COUNT)
        self.of_map, self.of_field = rng.uniform(0, 1e-3, (COUNT, 3)), rng.uniform(0, 0.1, (COUNT, 3))
        part, self.share = rng.choice([0.5, 1.0], COUNT), rng.choice([0.99, 1.01], COUNT)
        away = rng.uniform(-1, 1, (COUNT, 3))
        away *= (part * self.half * self.share / np.abs(away).max(axis=1))[:, None]
        model = [middle, self.half, self.of_map, self.of_field]
        return [self.frames, self.velocities, self.sign, self.moved, *model, middle + away, part]

    def world(self, change):
        """Squares (n,) of changes of reference coordinates, in the world, and of the length."""
        return (np.einsum("nij,ni->nj", self.jacobian, change[:, :3]) ** 2).sum(axis=1) + change[:, 3] ** 2


@pytest.fixture(scope="module")
def lines():
    return Lines(np.random.default_rng(12))


@pytest.fixture(scope="module")
def found(functions, lines):
    kernel = functions("trace_follow")
    sides, doors = kernel.records("sides", 4), kernel.records("doors", 4)
    sides["height"] = HEIGHTS
    corners = VERTICES[CORNERS]
    sides["origin"] = corners[:, 0]
    duals = np.linalg.pinv((corners[:, 1:] - corners[:, :1]).swapaxes(1, 2))
    sides["first"], sides["second"] = duals[:, 0], duals[:, 1]
    shifts = np.array([0, 4, 8])
    doors["corners"] = (NEIGHBOURS << shifts).sum(axis=1) | np.array([3, 1, 0, 2]) << 12
    doors["element"] = [7, NOBODY, 8, NOBODY - 1]
    given = {"errors": lines.errors, "dense": lines.dense, "powers": lines.powers, "vertices": VERTICES}
    rows, width = lines.rows(), width_of([FOUND])
    (found,) = parted(kernel(rows, width, sides=sides, doors=doors, polynomials=lines.polynomials, **given), [FOUND])
    return found


def test_errors_of_steps_are_those_of_the_embedded_rules_and_of_the_dense_output(lines, found):
    fifth, third = (lines.world(lines.width[:, None] * (row @ lines.rates)) for row in lines.errors)
    error = fifth / np.sqrt(fifth + 0.01 * third) / lines.tolerance
    assert found["error"] == pytest.approx(error, rel=1e-12, abs=0)
    defect = np.sqrt(lines.world(lines.slope - lines.width[:, None] * lines.velocity)) / lines.defect / lines.tolerance
    assert found["defect"] == pytest.approx(np.maximum(error, defect), rel=1e-12, abs=0)
    assert 0 < (defect > error).sum() < COUNT


def test_steps_become_longer_as_errors_of_eighth_order_allow(lines, found):
    """By no more than a limit either way, and no longer after an error that isn't allowed."""
    change = np.clip(lines.safety / found["error"] ** (1 / 8), lines.shrink, lines.grow)
    is_allowed = found["error"] <= 1
    assert found["adapted"] == pytest.approx(
        lines.width * np.where(is_allowed, change, np.minimum(change, 1)), rel=1e-12
    )
    for limit in (lines.shrink, lines.grow):
        assert 0 < (change == limit).sum() < COUNT / 2
    assert COUNT / 4 < is_allowed.sum() < COUNT


def test_dense_outputs_are_the_polynomials_of_their_terms(lines, found):
    change = lines.end - lines.state
    first, last = (lines.width[:, None] * lines.rates[:, stage] for stage in (0, RESULT))
    terms = [change, first - change, 2 * change - first - last]
    terms += [lines.width[:, None] * (row @ lines.rates) for row in lines.dense]
    spread = lines.state[:, None] + np.einsum("tb,tnc->nbc", lines.powers, np.array(terms))
    assert found["spread"].reshape(COUNT, 8, 4) == pytest.approx(spread, rel=1e-12, abs=0)

    choose = np.array([1, 7, 21, 35, 35, 21, 7, 1])
    t, k = lines.place[:, None], np.arange(8)
    basis = choose * t**k * (1 - t) ** (7 - k)
    assert found["state"] == pytest.approx(np.einsum("nk,nkc->nc", basis, lines.nets), rel=1e-12, abs=0)
    choose = np.array([1, 6, 15, 20, 15, 6, 1])
    basis = 7 * choose * t ** k[:7] * (1 - t) ** (6 - k[:7])
    assert found["slope"] == pytest.approx(
        np.einsum("nk,nkc->nc", basis, np.diff(lines.nets, axis=1)), rel=1e-12, abs=0
    )


def test_lines_leave_by_the_first_side_that_they_cross(lines, found):
    """From a side itself, or a little beyond: farther if they run along an outer one."""
    t = np.linspace(0, 1, 20001)
    choose = np.array([1, 7, 21, 35, 35, 21, 7, 1])
    basis = choose * t[:, None] ** np.arange(8) * (1 - t[:, None]) ** (7 - np.arange(8))
    rate = lines.rate[:, :3]
    steep = rate @ HEIGHTS[:, :3].T >= -lines.along[:, None] * np.abs(rate).max(axis=1, keepdims=True)
    is_outer = np.array([False, True, False, False])
    beside = np.where(is_outer & steep, lines.beside_outer[:, None], lines.beside[:, None])
    nets = np.einsum("nbc,sc->nsb", lines.nets[..., :3], HEIGHTS[:, :3]) + HEIGHTS[:, 3, None]
    nets = nets + np.where(nets[..., 0] <= beside, beside, 0)[..., None]
    heights = nets @ basis.T
    below = heights < 0
    first = np.where(below.any(axis=2), t[np.argmax(below, axis=2)], 2.0)
    assert found["place"] == pytest.approx(first.min(axis=1), abs=1e-4)
    leaves = first.min(axis=1) <= 1
    assert 5 < leaves.sum() < COUNT
    assert np.array_equal(found["side"][leaves], first.argmin(axis=1)[leaves])
    assert len(np.unique(found["side"][leaves])) == 4
    assert np.array_equal(found["long"], ~(lines.nets[..., 3].max(axis=1) < lines.length))


def test_ends_at_sides_move_along_the_line_as_far_as_rounding(lines, found):
    side = np.where(found["place"] <= 1, found["side"], 0).astype(int)
    height, missing = HEIGHTS[side], -((lines.last[:, :3] * HEIGHTS[side, :3]).sum(axis=1) + HEIGHTS[side, 3])
    speed = (height[:, :3] * lines.velocity[:, :3]).sum(axis=1)
    shift = np.where(np.abs(missing / speed) <= lines.rounded * lines.width, missing / speed, 0)
    assert found["shift"] == pytest.approx(shift, rel=1e-12, abs=0)
    assert 0 < (shift != 0).sum() < COUNT
    ends = found["end"]
    assert np.abs((ends[:, :3] * height[:, :3]).sum(axis=1) + height[:, 3]).max() < 1e-14
    moved = ends - lines.last - shift[:, None] * lines.velocity
    assert np.abs(moved[:, 3]).max() < 1e-15
    assert np.abs(np.cross(moved[:, :3], height[:, :3])).max() < 1e-14


def test_lines_enter_elements_only_at_the_place_and_with_the_direction(lines, found):
    near = np.linalg.norm(lines.apart, axis=1) <= lines.gap
    across = (HEIGHTS[lines.side, :3] * lines.velocity[:, :3]).sum(axis=1)
    inwards = across >= -lines.along * np.abs(lines.velocity[:, :3]).max(axis=1)
    moves = lines.velocity[:, 3] > 0
    assert np.array_equal(found["enters"], ((lines.checked == 0) | near & inwards) & moves)
    assert 0 < (near & inwards & moves & (lines.checked > 0)).sum() < (inwards & moves & (lines.checked > 0)).sum()


def test_positions_on_sides_have_the_same_weights_beyond_them(lines, found):
    element = np.array([7, 0, 8, 0])[lines.side]
    inner = element > 0
    assert np.array_equal(found["crosses"], inner)
    assert np.array_equal(found["element"], element)
    beyond = np.einsum("nk,nkc->nc", lines.weights, VERTICES[NEIGHBOURS[lines.side]])
    assert found["beyond"][inner] == pytest.approx(beyond[inner], abs=1e-14)
    assert found["beyond"][~inner] == pytest.approx(lines.on_side[~inner], abs=1e-15)
    assert np.array_equal(found["entered"][inner], np.array([3, 1, 0, 2])[lines.side][inner])


def test_rates_solve_for_the_velocity_and_models_state_what_they_drop(lines, found):
    """A term of degree n + 1 that the map lacks changes its derivatives by (n + 1)^2 / half (Markov)."""
    rate = np.linalg.solve(lines.frames.swapaxes(1, 2), lines.velocities[..., None])[..., 0]
    rate = lines.sign[:, None] * rate
    assert found["rate"] == pytest.approx(rate, rel=1e-9, abs=0)
    assert found["speed"] == pytest.approx(np.linalg.norm(lines.velocities, axis=1), rel=1e-12, abs=0)
    moved = np.einsum("ni,nij->nj", lines.moved, lines.frames)
    assert found["moved"] == pytest.approx(moved, rel=1e-12, abs=1e-14)
    assert np.array_equal(found["orientation"], np.sign(np.linalg.det(lines.frames)))
    steepest = (DEGREE + 1) ** 2 / lines.half * np.abs(rate).sum(axis=1)
    dropped = np.linalg.norm(lines.of_field + steepest[:, None] * lines.of_map, axis=1)
    assert found["dropped"] == pytest.approx(dropped, rel=1e-9, abs=0)
    assert np.array_equal(found["holds"][:, 0], lines.share < 1)
    assert not found["holds"][:, 1].any()
