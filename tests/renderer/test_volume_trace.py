"""Rays in curved elements: points along them, and polynomials with their differences from the field."""

import numpy as np
import pytest
from jets import POWERS, jets_of
from kernel_functions import parted, rows_of, width_of
from numpy.polynomial import Polynomial

from elvis.renderer.volume.traversal import hermite_weights

COUNT, NODES = 48, 8
FOUND = {
    **dict.fromkeys(["mean", "parabola", "cubic", "quintic"], 3),
    "net": 4,
    **dict.fromkeys(["error", "found", "depth", "value"], 1),
    **dict.fromkeys(["middle", "last", "rate"], 3),
    "end": 1,
    "hits": 1,
    "thinned": 16,
}
#: relative distance up to which two hits are one touched edge
APART = 1e-3


class Rays:
    """Curves of reference coordinates, and rays through nearly straight elements."""

    def __init__(self, rng):
        def some(low, high, *shape):
            return rng.uniform(low, high, (COUNT, *shape))

        self.curves = some(-1, 1, 4, 3)
        self.first, self.last = some(0, 1), some(2, 3)
        self.to, self.before = some(1.5, 1.9), some(-1, -0.5)
        self.earlier = np.column_stack([some(-3, -2), some(-1, 1, 3), some(-1, 1, 3)])
        self.polynomials = some(-0.02, 0.02, 5, 27)
        self.polynomials[:, [0, 1, 2], [1, 3, 9]] += 1.0
        self.polynomials[:, 3:] *= 50
        self.span = np.stack([some(1, 2), some(2.5, 3)], axis=1)
        self.places = np.sort(rng.uniform(0.05, 0.95, NODES - 1))
        self.matrix = rng.uniform(-1, 1, (NODES, NODES))
        self.lead(some(-0.6, -0.5, 3), some(-0.12, 0.12, 3))
        self._add_hits(rng)

    def lead(self, enter, direction):
        """Let the rays enter the elements at reference points (n, 3) and leave them at others."""
        self.enter, self.direction, self.leave = enter, direction, enter + direction
        self.position = np.stack([self.jets(k, self.enter)[:, 0] for k in range(3)], axis=1)
        end = np.stack([self.jets(k, self.leave)[:, 0] for k in range(3)], axis=1)
        self.world = (end - self.position) / (self.span[:, 1] - self.span[:, 0])[:, None]
        self.origin = self.position - self.span[:, :1] * self.world

    def _add_hits(self, rng):
        """Entries (1) and exits (-1) by turns, and pairs at nearly one depth that are or aren't touched edges.

        Every third direction is undecided (0), of hits outside such pairs.
        """
        self.hits, self.kept = np.zeros((COUNT, 8, 2)), []
        for row in self.hits:
            plain = np.sort(rng.uniform(1, 10, 4) + 20 * np.arange(4))
            after, is_touched = rng.integers(4), rng.integers(2) > 0
            depth = plain[after] + 5.0
            pair = np.array([depth, depth * (1 + (0.9 if is_touched else 1.1) * APART)])
            kinds = np.array([1.0, -1.0, 1.0, -1.0])
            turned = np.array([-1.0, 1.0]) * kinds[after]
            held = np.column_stack([plain, kinds])
            every = np.insert(held, after + 1, np.column_stack([pair, turned]), axis=0)
            self.kept.append(held if is_touched else every)
            unsure = (np.arange(6) % 3 == 1) & ~np.isin(every[:, 0], pair)
            row[:6] = np.column_stack([every[:, 0], np.where(unsure, 0.0, every[:, 1])])
            rng.shuffle(row[:6])

    def jets(self, function, r):
        """Values and derivatives (n, 4) of a function at points (n, 3)."""
        return jets_of(self.polynomials[:, [function]], r[:, None])[:, 0, 0]

    def curve(self, z, order=0):
        """Points (n, 3) at z (n,) of cubic curves, or their derivatives."""
        k = np.arange(4)
        powers = z[:, None] ** k if order == 0 else k * z[:, None] ** np.maximum(k - 1, 0)
        return np.einsum("nk,nkc->nc", powers, self.curves)

    def quintic(self):
        """Values (n, 3) at `to` of the polynomials of degree 5 through three points with their derivatives."""
        at, k = np.stack([self.first, self.before, self.earlier[:, 0]], axis=1)[..., None], np.arange(6)
        conditions = np.concatenate([at**k, k * at ** np.maximum(k - 1, 0)], axis=1)
        points = [self.curve(self.first), self.curve(self.before), self.earlier[:, 1:4]]
        rates = [self.curve(self.first, 1), self.curve(self.before, 1), self.earlier[:, 4:]]
        coefficients = np.linalg.solve(conditions, np.stack(points + rates, axis=1))
        return np.einsum("nk,nkc->nc", self.to[:, None] ** k, coefficients)

    def at(self, depth):
        """Reference points (n, 3) of the rays at depths (n,), and their derivatives."""
        target = self.origin + depth[:, None] * self.world
        r = self.enter + (depth - self.span[:, 0])[:, None] * self.direction / np.ptp(self.span, axis=1)[:, None]
        for _ in range(20):
            jets = np.stack([self.jets(k, r) for k in range(3)], axis=1)
            r = r - np.linalg.solve(jets[..., 1:], (jets[..., 0] - target)[..., None])[..., 0]
        return r, np.linalg.solve(jets[..., 1:], self.world[..., None])[..., 0]

    def rows(self):
        columns = [
            *[self.first, self.last],
            *[self.curve(self.first), self.curve(self.last), self.curve(self.first, 1), self.to],
            *[self.before, self.curve(self.before), self.curve(self.before, 1), self.earlier],
            *[self.origin, self.world, self.span, self.enter, self.leave],
            *[np.full(COUNT, 6), self.hits, np.full(COUNT, APART)],
        ]
        return rows_of(COUNT, columns)


@pytest.fixture(scope="module")
def rays():
    return Rays(np.random.default_rng(18))


@pytest.fixture(scope="module")
def traced(functions):
    """The kernel's results for rays."""
    kernel = functions("volume_trace")

    def traced(rays):
        places = np.append(rays.places, 1.0)
        given = {"polynomials": rays.polynomials, "places": places, "fit": rays.matrix}
        given["guesses"] = hermite_weights(places)
        (found,) = parted(kernel(rays.rows(), width_of([FOUND]), **given), [FOUND])
        return found

    return traced


@pytest.fixture(scope="module")
def found(traced, rays):
    return traced(rays)


def test_points_are_extrapolated_by_the_polynomials_of_all_that_is_known(rays, found):
    """A parabola through the exit, with the derivative; a cubic with both derivatives, which cubic curves are."""
    mean = (rays.curve(rays.last) - rays.curve(rays.first)) / (rays.last - rays.first)[:, None]
    assert found["mean"] == pytest.approx(mean, rel=1e-12)
    start, slope = rays.curve(rays.first), rays.curve(rays.first, 1)
    ahead, way = rays.last - rays.first, rays.to - rays.first
    bend = (rays.curve(rays.last) - start - ahead[:, None] * slope) / ahead[:, None] ** 2
    assert found["parabola"] == pytest.approx(start + way[:, None] * slope + way[:, None] ** 2 * bend, rel=1e-11)
    assert found["cubic"] == pytest.approx(rays.curve(rays.to), rel=1e-10)
    assert found["quintic"] == pytest.approx(rays.quintic(), rel=1e-9)


def test_guesses_between_three_points_are_exact_for_polynomials_of_degree_five():
    """Values, then derivatives, at the first, the middle and the last place."""
    places = np.array([0.0, 0.1, 0.3, 0.6, 0.9, 1.0])
    polynomial = Polynomial([0.3, -1.0, 2.0, 0.5, -0.7, 1.1])
    stations = places[[0, 2, 5]]
    given = np.concatenate([polynomial(stations), polynomial.deriv()(stations)])
    assert hermite_weights(places) @ given == pytest.approx(polynomial(places), abs=1e-12)


def test_fields_along_parts_are_fitted_at_points_of_the_ray(rays, found):
    width = np.ptp(rays.span, axis=1)
    depths = rays.span[:, :1] + np.column_stack([width[:, None] * rays.places, width])
    points = [rays.at(depth)[0] for depth in depths.T]
    values = np.stack([rays.jets(3, point)[:, 0] for point in points], axis=1)
    fitted = values @ rays.matrix.T
    assert found["found"].all()
    assert found["net"] == pytest.approx(fitted[:, :4], rel=1e-9, abs=1e-9)
    assert found["error"] == pytest.approx(np.abs(fitted[:, 4:]).sum(axis=1), rel=1e-9)
    middle = (NODES - 1) // 2
    assert found["depth"] == pytest.approx(depths[:, middle], rel=1e-12)
    assert found["middle"] == pytest.approx(points[middle], rel=1e-9)
    assert found["value"] == pytest.approx(values[:, middle], rel=1e-8)
    assert np.array_equal(found["last"], rays.leave)
    assert found["rate"] == pytest.approx(rays.at(depths[:, -1])[1], rel=1e-6)
    assert np.array_equal(found["end"], rays.span[:, 1])


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_points_may_be_outside_by_a_millionth(part, traced):
    """Rays along a side of elements with straight sides."""
    rays = Rays(np.random.default_rng(19))
    is_bent = POWERS.sum(axis=1) > 1
    rays.polynomials[:, :3, is_bent] = 0.0
    rays.lead(rays.enter * [0, 1, 1] + [-1 - 1e-6 * part, 0, 0], rays.direction * [0, 1, 1])
    assert (traced(rays)["found"] == (part < 1)).all()


def test_hits_at_one_depth_of_opposite_directions_are_removed(rays, found):
    for kept, count, thinned in zip(rays.kept, found["hits"], found["thinned"], strict=True):
        expected = np.column_stack([kept[:, 0], kept[:, 1] > 0])
        assert count == len(expected)
        assert np.array_equal(thinned.reshape(-1, 2)[: len(expected)], expected)
