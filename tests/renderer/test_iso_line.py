"""Rays in straight tetrahedra: polynomials along them with their errors, conditions near roots, and hits recorded."""

import numpy as np
import pytest
from jets import POWERS, jets_of
from kernel_functions import parted, rows_of, width_of

COUNT, UNIT = 64, 1.2e-16
#: points of a line, and the matrix to Bernstein coefficients of degree 3
NODES = np.array([0.0, 0.25, 0.75, 1.0])
BERNSTEIN = np.stack([[1, 3, 3, 1][k] * NODES**k * (1 - NODES) ** (3 - k) for k in range(4)], axis=1)
NET = np.linalg.inv(BERNSTEIN)
NET_SIZE = np.abs(NET).sum(axis=1).max()
FOUND = {
    "start": 3,
    "direction": 3,
    "span": 2,
    "shift": 1,
    "wrong": 1,
    "skewed": 1,
    "net": 4,
    "accuracy": 3,
    "room": 1,
    **dict.fromkeys(["spurious", "known", "owner", "status", "depth", "off", "doubt"], 1),
    "reference": 3,
    "normal": 3,
}


class Rays:
    """Rays of one pixel in tetrahedra with fields of degree 3, and conditions as large as they may be off."""

    def __init__(self, rng):
        def some(low, high, *shape):
            return rng.uniform(low, high, (COUNT, *shape))

        self.polynomials = some(-1, 1, 5, 27) * (POWERS.sum(axis=1) <= 3)
        linear = POWERS.sum(axis=1) == 1
        self.polynomials[:, :3] = 0.0
        self.jacobian = np.eye(3) + some(-0.3, 0.3, 3, 3)
        self.polynomials[:, :3, linear] = self.jacobian
        self.polynomials[:, :3, 0] = some(-0.1, 0.1, 3)
        self.camera = some(-1, 1, 5, 3)
        self.camera[:, 0] = np.array([-0.4, -0.4, -3.0]) + some(-0.3, 0.3, 3)
        self.camera[:, 1], self.camera[:, 2:] = some(-0.1, 0.1, 3), some(-0.05, 0.05, 3, 3)
        self.camera[:, 1, 2] += 1.0
        self.perspective = rng.integers(2, size=COUNT)
        self.level, self.misplaced = some(-0.5, 0.5), some(1e-9, 1e-8) * rng.choice([1e-3, 1], COUNT)
        self.span, self.wider = np.stack([some(2, 2.2), some(2.5, 3)], axis=1), some(0, 0.1)
        self.error, self.depth = some(1e-3, 1e-2), some(2.3, 2.6)
        self.off, self.before = some(1e-3, 0.3) * rng.choice([1e-6, 1], COUNT), some(2, 2.2)
        self.slope, self.wrong = some(0.5, 2), some(1e-10, 2e-10) * rng.choice([0.1, 1e3], COUNT)
        self.slope[::8] = 0.0
        self.condition_error, self.condition_steepest = some(1e-3, 1e-1), some(0.1, 1)
        # most roots are so close to their depths that a step along the ray leads to them
        origin, direction = in_world(self)
        self.move_to_border(origin, direction)
        places = (origin + self.depth[:, None] * direction - self.polynomials[:, :3, 0])[..., None]
        values = self.jets(3, np.linalg.solve(self.jacobian, places)[..., 0])[:, 0]
        aside = some(-1e-7, 1e-7)
        aside[3::8] = 0.0
        self.level[1:] = (values + aside)[1:]
        self.balance_conditions(np.linalg.solve(self.jacobian, places)[..., 0], origin, direction)

    def move_to_border(self, origin, direction):
        """Let roots of some rays be as near to the border as they may be off, or almost."""
        own, depth = np.arange(3, COUNT, 8), self.depth[3::8]
        self.slope[own], self.wrong[own], self.misplaced[own] = 1.0, 2e-9, 1e-9
        jacobian, goal = self.jacobian[own], np.full((COUNT, 3), [-1.0, -0.5, -0.4])
        slopes = self.jets(3, goal)[own, 1:, None]
        steep = np.linalg.norm(np.linalg.solve(jacobian.swapaxes(1, 2), slopes)[..., 0], axis=1)
        off = 2e-9 + 1e-9 * steep + 4 * UNIT * depth
        shift = off * np.abs(np.linalg.solve(jacobian, direction[own][..., None])).max(axis=(1, 2))
        goal[own, 0] += 1e-10 + 2 * shift * np.resize([0.9, 1.1], len(own))
        point = origin[own] + depth[:, None] * direction[own]
        self.polynomials[own, :3, 0] = point - np.einsum("nij,nj->ni", jacobian, goal[own])

    def balance_conditions(self, r, origin, direction):
        """Let conditions be just as large as they may be off at points r (n, 3), or just not."""
        start = np.linalg.solve(self.jacobian, (origin - self.polynomials[:, :3, 0])[..., None])[..., 0]
        direction = np.abs(np.linalg.solve(self.jacobian, direction[..., None])[..., 0])
        lengths = np.linalg.norm(self.jacobian, axis=1).prod(axis=1)
        farthest = (np.abs(start) + np.abs(self.span).max(axis=1, keepdims=True) * direction).max(axis=1)
        shift = 2e-15 * lengths / np.abs(np.linalg.det(self.jacobian)) * farthest
        moved = self.off * direction.max(axis=1) + shift
        value, *gradient = self.jets(4, r).T
        error = 2 * self.condition_error + np.abs(gradient).sum(axis=0) * moved
        error += 4.5 * self.condition_steepest * moved**2
        rows = np.arange(COUNT)
        self.polynomials[:, 4, 0] += np.where(rows % 4 < 2, 1, -1) * np.where(rows % 2, 1.01, 0.99) * error - value

    def rows(self):
        alone = [self.perspective, self.level, self.misplaced, self.span, self.wider, self.error, self.depth]
        columns = [self.camera, *alone[:-1], *self.roots(), self.depth, self.off, self.before, self.slope, self.wrong]
        return rows_of(COUNT, columns)

    def roots(self):
        """How far fields are off in values and by rounding; places of roots, their slopes and their intervals."""
        rng = np.random.default_rng(16)
        self.of_field = rng.uniform(1e-3, 1e-2, (2, COUNT)) * rng.choice([0, 1], (2, COUNT))
        self.place, self.steep = rng.uniform(0.2, 0.8, COUNT), rng.choice([0.0, 0.01, 5.0], COUNT)
        self.interval = self.place + rng.uniform([[-0.2], [0.0]], [[0.0], [0.2]], (2, COUNT))
        return [*self.of_field, self.place, self.steep, *self.interval]

    def jets(self, function, r):
        """Values and derivatives (n, 4) of a function at points (n, 3)."""
        return jets_of(self.polynomials[:, [function]], r[:, None])[:, 0, 0]


@pytest.fixture(scope="module")
def rays():
    return Rays(np.random.default_rng(15))


@pytest.fixture(scope="module")
def found(functions, rays):
    condition = "export struct TheCondition : IVolume = SecondVolume; export static const bool conditional = true;"
    kernel = functions("iso_line", condition)
    given = {
        "polynomials": rays.polynomials,
        "nodes": NODES,
        "net": NET,
        "net_size": np.array([NET_SIZE]),
        # as large as what lines are off by
        "errors": rays.error,
        "steepest": 1e13 * rays.condition_steepest,
        "condition_errors": rays.condition_error,
        "condition_steepest": rays.condition_steepest,
        "hit_pixels": np.array([COUNT], np.uint32),
    }
    hits = {name: np.zeros(3 * COUNT) for name in ("hit_reference", "hit_normal")}
    hits |= {name: np.zeros(COUNT, np.uint32) for name in ("hit_owner", "hit_status")}
    hits |= {name: np.full(COUNT, 9.0) for name in ("hit_depth", "hit_uncertainty", "hit_doubt")}
    (found,) = parted(kernel(rays.rows(), width_of([FOUND]), **given, **hits), [FOUND])
    return found


def in_world(rays):
    """Origins and directions (n, 3) of the rays of pixel (2, 3)."""
    eye, forward, corner, column, row = rays.camera.swapaxes(0, 1)
    aside = corner + 2 * column + 3 * row
    is_from_eye = rays.perspective[:, None] > 0
    return np.where(is_from_eye, eye, eye + aside), np.where(is_from_eye, forward + aside, forward)


def test_rays_are_straight_lines_of_reference_coordinates(rays, found):
    origin, direction = in_world(rays)
    inverse = np.linalg.inv(rays.jacobian)
    start = np.einsum("nij,nj->ni", inverse, origin - rays.polynomials[:, :3, 0])
    assert found["start"] == pytest.approx(start, rel=1e-11, abs=0)
    assert found["direction"] == pytest.approx(np.einsum("nij,nj->ni", inverse, direction), rel=1e-11, abs=0)
    lengths = np.linalg.norm(rays.jacobian, axis=1).prod(axis=1)
    skewed = lengths / np.abs(np.linalg.det(rays.jacobian))
    assert found["skewed"] == pytest.approx(skewed, rel=1e-12, abs=0)
    farthest = np.abs(rays.span).max(axis=1, keepdims=True) * np.abs(found["direction"])
    shift = 2e-15 * skewed * (np.abs(found["start"]) + farthest).max(axis=1)
    assert found["shift"] == pytest.approx(shift, rel=1e-12, abs=0)
    assert found["wrong"] == pytest.approx(rays.error + 1e13 * rays.condition_steepest * shift, rel=1e-12, abs=0)

    # inside of a tetrahedron that is a little larger
    z = np.linspace(0, 8, 16001)
    points = found["start"][:, None] + z[:, None] * found["direction"][:, None]
    margin = np.minimum(1 + points.min(axis=2), -1 - points.sum(axis=2)) + rays.wider[:, None]
    low, high = found["span"].T
    within = (z >= low[:, None]) & (z <= high[:, None])
    assert ((margin >= 0) == within).mean() > 0.9999
    assert within.any(axis=1).sum() > COUNT / 2


def test_fields_along_rays_are_polynomials_off_by_what_values_are(rays, found):
    """Values that are off each their own way move one coefficient by the largest sum of a row of the matrix."""
    depths = rays.span[:, :1] + NODES * (rays.span[:, 1:] - rays.span[:, :1])
    places = found["start"][:, None] + depths[..., None] * found["direction"][:, None]
    values = np.stack([rays.jets(3, places[:, k])[:, 0] for k in range(4)], axis=1) - rays.level[:, None]
    assert found["net"] == pytest.approx(values @ NET.T, rel=1e-8, abs=1e-10)
    coefficients, of_values, rounding = found["accuracy"].T
    moved = np.abs(np.sign(NET) @ NET.T).max() * rays.error
    assert coefficients == pytest.approx(moved, rel=1e-12, abs=0)
    assert of_values == pytest.approx(4 * rays.error, rel=1e-12, abs=0)
    assert rounding == pytest.approx(NET_SIZE * 7 * UNIT * np.abs(values).max(axis=1), rel=1e-9, abs=0)


def test_isolated_roots_are_off_by_errors_over_slopes_and_others_by_their_interval(rays, found):
    farthest = np.abs(rays.interval - rays.place).max(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = 2 * rays.of_field.sum(axis=0) / rays.steep + 1e-13
    isolated = (rays.steep > 0) & (moved < farthest)
    assert found["room"] == pytest.approx(np.where(isolated, moved, farthest), rel=1e-12, abs=0)
    assert 10 < isolated.sum() < COUNT - 10


def test_conditions_are_known_where_they_keep_their_sign(rays, found):
    """By the gradient and half of the second derivatives, over what roots are off and lines are misplaced."""
    r = found["start"] + rays.depth[:, None] * found["direction"]
    value, *gradient = rays.jets(4, r).T
    moved = rays.off * np.abs(found["direction"]).max(axis=1) + found["shift"]
    change = (np.abs(gradient).sum(axis=0) + 4.5 * rays.condition_steepest * moved) * moved
    known = np.abs(value) > 2 * rays.condition_error + change
    assert np.array_equal(found["known"], known)
    assert np.array_equal(found["spurious"], value > 0)
    assert 10 < known.sum() < COUNT - 10


def test_hits_are_roots_refined_by_a_step_along_the_ray(rays, found):
    origin, direction = in_world(rays)
    r = found["start"] + rays.depth[:, None] * found["direction"]
    value, *slopes = rays.jets(3, r).T
    gradient = np.linalg.solve(rays.jacobian.swapaxes(1, 2), np.transpose(slopes)[..., None])[..., 0]
    position = rays.polynomials[:, :3, 0] + np.einsum("nij,nj->ni", rays.jacobian, r)
    beside = origin + rays.depth[:, None] * direction - position
    step = -(value - rays.level + (gradient * beside).sum(axis=1)) / (gradient * direction).sum(axis=1)
    step = np.where(np.abs(step) < 1e-6 * rays.depth, step, 0)
    depth = rays.depth + step
    assert found["depth"] == pytest.approx(depth, rel=1e-12, abs=0)
    with np.errstate(divide="ignore"):
        off = (rays.wrong + np.linalg.norm(gradient, axis=1) * rays.misplaced) / rays.slope + 4 * UNIT * depth
    assert found["off"] == pytest.approx(off, rel=1e-9, abs=0)
    assert np.mean(step != 0) > 0.9
    moved = np.linalg.solve(rays.jacobian, (beside + step[:, None] * direction)[..., None])[..., 0]
    assert found["reference"] == pytest.approx(r + moved, rel=1e-12, abs=0)
    shift = np.minimum(off, 1e300) * np.abs(found["direction"]).max(axis=1)
    r = r + moved
    margin = np.minimum(1 + r.min(axis=1), -1 - r.sum(axis=1))
    clear = (off <= 1e-8 * depth) & (margin > 1e-10 + 2 * shift)
    assert np.array_equal(found["status"], np.where(clear, 1, 2))
    assert set(clear[3::8]) == {False, True}
    assert np.array_equal(found["owner"], 100 + np.arange(COUNT))
    assert np.array_equal(found["doubt"], np.where(rays.slope == 0, rays.before, 9.0))
    normal = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    normal *= -np.sign((gradient * direction).sum(axis=1, keepdims=True))
    assert found["normal"] == pytest.approx(normal, rel=1e-9, abs=0)
