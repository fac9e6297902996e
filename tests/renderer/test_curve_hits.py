"""What rays find on strips and tubes around curves, against roots and minima of polynomials in NumPy."""

from types import SimpleNamespace

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyder, polyval
from scipy.optimize import minimize_scalar

COUNT = 160
TERMS = 8
NOBODY = 0xFFFFFFFF
CERTAIN, AMBIGUOUS = 1, 2
TIE = 0.05
FOUND = {**dict.fromkeys(["depth", "doubt", "uncertainty", "owner", "status"], 1), "normal": 3, "place": 3}


class Rays:
    """Rays (n,) of pixel (2, 3) of cameras, with two directions across each."""

    def __init__(self, rng):
        self.forward = directions(rng)
        self.eye, self.corner = rng.uniform(-1, 1, (COUNT, 3)), rng.uniform(-0.2, 0.2, (COUNT, 3))
        self.column, self.row = rng.uniform(-0.1, 0.1, (2, COUNT, 3))
        self.perspective = rng.integers(2, size=COUNT)
        aside = self.corner + 2 * self.column + 3 * self.row
        is_wide = self.perspective[:, None] > 0
        self.origin = np.where(is_wide, self.eye, self.eye + aside)
        direction = np.where(is_wide, self.forward + aside, self.forward)
        self.scale = np.linalg.norm(direction, axis=1)
        self.along = direction / self.scale[:, None]
        first = np.cross(self.along, directions(rng))
        self.first = first / np.linalg.norm(first, axis=1, keepdims=True)
        self.second = np.cross(self.along, self.first)

    def in_world(self, k, vectors):
        """Vectors (..., 3) from components in the two directions across ray k and along it."""
        return vectors @ np.stack([self.first[k], self.second[k], self.along[k]])

    def rows(self, has_beyond, radius, growth, misplaced, most):
        camera = [self.eye, self.forward, self.corner, self.column, self.row, self.perspective]
        return rows_of(COUNT, [*camera, has_beyond, radius, growth, misplaced, np.full(COUNT, TIE), most])


def directions(rng):
    found = rng.normal(size=(COUNT, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def polynomials(rng, sizes):
    """Three polynomials with random coefficients of these sizes."""
    return rng.uniform(-1, 1, (TERMS, 3)) * np.resize([*sizes, *[0.0] * TERMS], TERMS)[:, None]


def at(coefficients, u, order=0):
    """(..., 3) of polynomials (terms, 3), or a derivative of theirs."""
    return np.moveaxis(polyval(u, polyder(coefficients, order)), 0, -1)


def shifted(coefficients, shift):
    """Coefficients of the polynomials of u + shift."""
    found = np.zeros_like(coefficients)
    for own, column in zip(coefficients.T, found.T, strict=True):
        moved = Polynomial(own)(Polynomial([shift, 1.0])).coef
        column[: len(moved)] = moved
    return found


def bound_of_turns(coefficients):
    k = np.arange(TERMS)
    return (k * (k - 1) * np.linalg.norm(coefficients, axis=1)).sum()


class Strips:
    """A strip that the ray meets, and one that runs along the ray next to it: its place is only known to the strip's
    deviation, so that it is doubtful."""

    def __init__(self, rng, rays):
        self.rays, self.misplaced = rays, np.full(COUNT, 4e-7)
        self.deviation, self.beside = np.full(COUNT, 6e-7), np.full(COUNT, 0.02)
        self.width, self.start, self.most = (np.zeros(COUNT) for _ in range(3))
        self.points, self.across = np.zeros((2, 2 * COUNT, TERMS, 3))
        self.turn = np.zeros(2 * COUNT)
        self.reference = np.array([polynomials(rng, 0.5 ** np.arange(TERMS)) for _ in range(2 * COUNT)])
        self.hits = [self._make(k, rng) for k in range(COUNT)]

    def _make(self, k, rng):
        """What is to be found."""
        slack = self.misplaced[k] + self.deviation[k]
        across = polynomials(rng, [1.0, 0.2, 0.1, 0.03])
        across[0] /= np.linalg.norm(across[0])
        points = polynomials(rng, [0.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.003])
        u, v = rng.uniform(-0.8, 0.8), rng.uniform(-0.28, 0.28)
        points[0] = -at(points, u) - v * at(across, u)
        points[0, 2] += rng.uniform(3, 5)
        if k % 8 == 0:
            # the root is an end of the piece, to its own error, or as far beyond as counts as an end
            meeting = self._meeting(points, across, u, slack)
            beyond = 4 * slack * (1 + meeting.gap) / meeting.facing
            away = rng.choice([-1.06 * beyond, -0.94 * beyond, 0.5 * meeting.off_u, 2 * meeting.off_u])
            end = rng.choice([-1, 1]) * (1 - away)
            points, across = shifted(points, u - end), shifted(across, u - end)
            u = end
        meeting = self._meeting(points, across, u, slack)
        self.width[k] = 0.3 if k % 4 else max(abs(v) + rng.choice([-2, -0.5, 0.5, 2]) * meeting.off_v, 1e-3)
        if k % 5 == 0:
            self.start[k] = meeting.place + rng.choice([-0.5, 0.5, 1.0]) * meeting.off
        self._keep(2 * k, points, across)

        # ends of the piece count as roots if errors of positions make them such
        roots = [self._meeting(points, across, np.clip(root, -1, 1), slack) for root in self._roots(points, across)]
        roots = [one for one in roots if abs(one.g) <= 4 * slack * (1 + one.gap)]
        near = [one for one in roots if abs(one.v) <= self.width[k] and one.place > self.start[k]]
        hit = min(near, key=lambda one: one.place, default=None)
        doubts = [one for one in roots if abs(one.v) <= self.width[k] + one.off_v and self._is_doubtful(k, one)]
        doubts = [(one.place - one.off, one.place + one.off) for one in doubts]
        doubts += self._beside(k, rng, hit)
        doubt = min((max(low, self.start[k]) for low, high in doubts if high > self.start[k]), default=np.inf)
        self.most[k] = rng.choice([0.5, 2.0]) * (hit.off / hit.place if hit else 1.0)
        return SimpleNamespace(hit=hit, doubt=doubt, is_plain=self._is_plain(points, across))

    def _is_doubtful(self, k, one):
        return abs(abs(one.v) - self.width[k]) <= one.off_v or abs(one.u) >= 1 - one.off_u

    def _keep(self, row, points, across):
        self.points[row] = self.rays.in_world(row // 2, points)
        self.points[row, 0] += self.rays.origin[row // 2]
        self.turn[row] = 0.02 if row % 2 else 1.0001 * bound_of_turns(points)
        self.across[row] = self.rays.in_world(row // 2, across)

    @staticmethod
    def _meeting(points, across, u, slack):
        """The place on the line across at u that is nearest to the ray, and what errors of positions do to it."""
        p, p1, n, n1 = at(points, u), at(points, u, 1), at(across, u), at(across, u, 1)
        v = -(p[:2] @ n[:2]) / (n[:2] @ n[:2])
        forth = p1 + v * n1
        normal = np.cross(forth, n)
        facing, size = abs(normal[2]), np.linalg.norm(normal)
        errors = slack / facing * np.array([np.linalg.norm(n[:2]), np.linalg.norm(forth[:2]), size])
        normal *= -np.sign(normal[2]) / size
        found = {
            "facing": facing,
            "g": p[0] * n[1] - p[1] * n[0],
            "gap": np.hypot(*p[:2]),
            "place": p[2] + v * n[2],
            "normal": normal,
        }
        return SimpleNamespace(u=u, v=v, **found, **dict(zip(["off_u", "off_v", "off"], errors, strict=True)))

    @staticmethod
    def _g(points, across):
        x, y, _ = map(Polynomial, points.T)
        a, b, _ = map(Polynomial, across.T)
        return x * b - y * a

    def _roots(self, points, across):
        g = self._g(points, across).trim(1e-14)
        roots = g.roots()
        roots = roots[np.abs(roots.imag) < 1e-7].real
        for _ in range(3):
            roots = roots - g(roots) / g.deriv()(roots)
        return roots[np.abs(roots) <= 1.01]

    def _is_plain(self, points, across):
        """Whether no root is nearly a double one."""
        g = self._g(points, across).trim(1e-14)
        turns = g.deriv().roots()
        turns = turns[(np.abs(turns.imag) < 0.1) & (np.abs(turns.real) < 1.1)].real
        return not len(turns) or np.abs(g(turns)).min() > 5e-3

    def _beside(self, k, rng, hit):
        """The strip along the ray; depths between which it makes the pixel doubtful."""
        if hit and k % 4 == 1:
            return self._edge(k, rng, hit)
        slack, turn, pace = self.misplaced[k] + self.beside[k], 0.02, rng.uniform(7, 9)
        reach = pace + 0.5 * turn + self.width[k] + slack
        limit = hit.place + TIE + reach if hit and k % 3 else self.start[k] - reach
        middle = limit + rng.choice([-0.01, 0.01])
        points, across = np.zeros((2, TERMS, 3))
        points[0], points[1, 2], points[2, 2] = [6 * slack, 0.0, middle], pace, 0.5 * turn
        across[0] = [0.0, 1.0, 0.0]
        self._keep(2 * k + 1, points, across)
        is_hidden = middle - reach > (hit.place if hit else np.inf) + TIE or middle + reach < self.start[k]
        return [] if is_hidden else [(middle - reach, middle + reach)]

    def _edge(self, k, rng, hit):
        """A straight strip along the ray behind the hit, as far away from the ray as its error allows, or farther."""
        slack, pace = self.misplaced[k] + self.beside[k], 0.3
        is_near = rng.integers(2)
        away = slack * (1 + pace) / (1 - slack) * (0.98 if is_near else 1.02)
        points, across = np.zeros((2, TERMS, 3))
        points[0], points[1, 2] = [away, 0.0, hit.place + 0.4], pace
        across[0] = [0.0, 1.0, 0.0]
        self._keep(2 * k + 1, points, across)
        self.turn[2 * k + 1] = 0.0
        return [(-np.inf, np.inf)] if is_near else []

    def records(self, empty):
        empty["points"], empty["across"] = (own.reshape(2 * COUNT, -1) for own in (self.points, self.across))
        empty["reference"] = self.reference.reshape(2 * COUNT, -1)
        empty["turn"] = self.turn
        empty["swing"] = [1.0001 * bound_of_turns(own) for own in self.across]
        empty["deviation"] = np.stack([self.deviation, self.beside], axis=1).ravel()
        empty["owner"] = 500 + np.arange(2 * COUNT)
        return empty


@pytest.fixture(scope="module")
def rays():
    return Rays(np.random.default_rng(31))


def buffers_of(start, rays):
    """Arrays that hold hits, and the depths beyond which these are searched."""
    vectors = {name: np.zeros(3 * COUNT) for name in ("hit_reference", "hit_normal")}
    numbers = {name: np.zeros(COUNT) for name in ("hit_depth", "hit_doubt", "hit_uncertainty")}
    names = {name: np.zeros(COUNT, np.uint32) for name in ("hit_owner", "hit_status")}
    pixels = np.array([COUNT], np.uint32)
    return vectors | numbers | names | {"after": start / rays.scale, "hit_pixels": pixels}


def test_rays_find_the_nearest_place_on_strips_and_know_its_error(functions, rays):
    strips = Strips(np.random.default_rng(32), rays)
    kernel = functions("ribbon_draw")
    rows = rays.rows(strips.start > 0, strips.width, np.zeros(COUNT), strips.misplaced, strips.most)
    given = {"strips": strips.records(kernel.records("strips", 2 * COUNT)), **buffers_of(strips.start, rays)}
    (found,) = parted(kernel(rows, width_of([FOUND]), **given), [FOUND])
    some = [k for k in range(COUNT) if strips.hits[k].is_plain]
    hits = [k for k in some if strips.hits[k].hit]
    assert np.isin(some, hits).mean() > 0.7
    assert len(some) > 100
    for k in some:
        hit, doubt = strips.hits[k].hit, strips.hits[k].doubt
        assert found["doubt"][k] * rays.scale[k] == pytest.approx(doubt, rel=1e-8, abs=0)
        if not hit:
            assert (found["depth"][k], found["owner"][k]) == (np.inf, NOBODY)
            assert found["status"][k] == (AMBIGUOUS if doubt < np.inf else 0)
            continue
        assert found["depth"][k] * rays.scale[k] == pytest.approx(hit.place, rel=1e-9, abs=0)
        assert found["uncertainty"][k] * rays.scale[k] == pytest.approx(hit.off, rel=1e-5, abs=0)
        is_certain = hit.off <= strips.most[k] * hit.place and doubt > hit.place
        assert found["status"][k] == (CERTAIN if is_certain else AMBIGUOUS)
        assert found["owner"][k] == 500 + 2 * k
        assert found["normal"][k] == pytest.approx(rays.in_world(k, hit.normal), abs=1e-7)
        assert found["place"][k] == pytest.approx(at(strips.reference[2 * k], hit.u), abs=1e-7)
    doubts = np.array([strips.hits[k].doubt for k in some])
    assert 0.1 < np.mean(found["status"][some] == CERTAIN) < 0.9
    assert 0.2 < np.isfinite(doubts).mean() < 0.9


class Ball:
    """Balls around the points of a curve in components of a ray, of a radius that grows linearly, and the ray's way in
    and out of them."""

    def __init__(self, points, radius, growth):
        self.points, self._radius, self._growth = points, radius, growth
        u = np.linspace(-1, 1, 401)
        best = u[np.argmax(self.room(u))]
        self.closest = narrowed(lambda x: -self.room(x), max(best - 0.01, -1), min(best + 0.01, 1))
        self.is_met = self.room(self.closest) > 0
        self.enters, self.leaves = self._turn(1), self._turn(-1)
        self.begin, self.end = self.depth(self.enters, 1), self.depth(self.leaves, -1)

    def room(self, u):
        return self.radius(u) ** 2 - (at(self.points, u)[..., :2] ** 2).sum(axis=-1)

    def radius(self, u):
        return self._radius + at(self.points, u) @ self._growth

    def depth(self, u, way):
        return at(self.points, u)[..., 2] - way * np.sqrt(np.maximum(self.room(u), 0.0))

    def _turn(self, way):
        """The parameter at which the ray enters or leaves."""
        if not self.is_met:
            return self.closest
        ends = [self._end(-1.0), self._end(1.0)]
        return narrowed(lambda x: way * self.depth(x, way), *ends)

    def _end(self, end):
        """Where the ray no longer meets balls."""
        if self.room(end) >= 0:
            return end
        inner, outer = self.closest, end
        for _ in range(60):
            middle = 0.5 * (inner + outer)
            inner, outer = (middle, outer) if self.room(middle) >= 0 else (inner, middle)
        return inner


def narrowed(function, low, high):
    """The minimum of a function with one."""
    return minimize_scalar(function, bounds=(low, high), method="bounded", options={"xatol": 1e-10}).x


class Tubes:
    """Two tubes: the ray meets one from outside, grazes it, starts in it, or the tube is wider than curves may bend."""

    def __init__(self, rng, rays):
        self.rays = rays
        self.kind = np.arange(COUNT) % 4
        self.slack = np.where(self.kind == 1, 1e-4, 1e-6)
        self.radius, self.growth = rng.uniform(0.2, 0.5, COUNT), rng.uniform(-0.02, 0.02, COUNT)
        self.growth[(self.kind == 1) | (np.arange(COUNT) % 8 < 4)] = 0.0
        self.start, self.most = np.zeros(COUNT), np.zeros(COUNT)
        self.points = np.zeros((2 * COUNT, TERMS, 3))
        self.reference = np.array([polynomials(rng, 0.5 ** np.arange(TERMS)) for _ in range(2 * COUNT)])
        self.turn, self.near, self.reach = np.zeros((3, 2 * COUNT))
        self.hits = [self._make(k, rng) for k in range(COUNT)]

    def _ball(self, k, points):
        forward = np.array(
            [self.rays.forward[k] @ own[k] for own in (self.rays.first, self.rays.second, self.rays.along)]
        )
        start = self.radius[k] + self.growth[k] * self.rays.forward[k] @ (self.rays.origin[k] - self.rays.eye[k])
        return Ball(points, start, self.growth[k] * forward)

    def _keep(self, row, ball, turn=None):
        points = ball.points
        self.points[row] = self.rays.in_world(row // 2, points)
        self.points[row, 0] += self.rays.origin[row // 2]
        u = np.linspace(-1, 1, 201)
        self.turn[row] = 1.0001 * bound_of_turns(points) + 1e-12 if turn is None else turn
        self.near[row] = (at(points, u)[:, 2] - ball.radius(u)).min() / self.rays.scale[row // 2] - 1e-3
        self.reach[row] = np.linalg.norm(at(points, u) - points[0], axis=1).max() + 1e-4

    def _make(self, k, rng):
        kind, slack = self.kind[k], self.slack[k]
        points = polynomials(rng, [0.0, 0.0, 0.08, 0.02, 0.005])
        way, slant = rng.uniform(0, 2 * np.pi), rng.uniform(-0.5, 0.5)
        points[1] = [np.cos(way), np.sin(way), slant]
        u, apart = rng.uniform(-0.5, 0.5), rng.uniform(0.0, 0.8) * self.radius[k]
        if kind == 3:
            points[1:] = [points[1] * [1, 1, 0], *np.zeros((TERMS - 2, 3))]
            apart = 0.01
        points[0] = apart * np.array([-np.sin(way), np.cos(way), 0.0]) - at(points, u)
        points[0, 2] += rng.uniform(3, 5)
        if kind == 1:
            nearest = np.sqrt(self.radius[k] ** 2 - self._ball(k, points).room(self._ball(k, points).closest))
            share = 2 * rng.choice([-2.0, -0.4, 0.5, 2.0]) * slack
            self.radius[k] = share + np.sqrt(share**2 + nearest**2)
        ball = self._ball(k, points)
        if kind == 2:
            self.start[k] = ball.begin + rng.choice([0.01, 0.1])
        self._keep(2 * k, ball, 4.0 if kind == 3 else None)
        other = self._ball(k, self._other(k, ball, rng))
        self._keep(2 * k + 1, other)
        return self._expected(k, ball, other)

    def _other(self, k, ball, rng):
        """A short piece right across the ray, whose end is next to where the first tube begins or ends."""
        points = np.zeros((TERMS, 3))
        points[0, 0], points[1, 1] = 0.3 * self.radius[k], 0.05
        own = self._ball(k, points)
        if self.kind[k] % 2 or self.growth[k]:
            points[0, 2] = 8.0
        elif self.kind[k] == 0:
            points[0, 2] = ball.begin + rng.choice([-0.02, 0.02]) - own.begin
        elif rng.integers(2):
            points[0, 2] = ball.end + rng.choice([-0.02, 0.02]) - own.end
        else:
            points[0, 2] = ball.end + TIE + rng.choice([-0.01, 0.01]) - own.begin
        return points

    def _expected(self, k, ball, other):
        doubt = np.inf
        if self.kind[k] == 1 and abs(ball.room(ball.enters)) <= 4 * ball.radius(ball.enters) * self.slack[k]:
            doubt = max(at(ball.points, ball.enters)[2] - ball.radius(ball.enters), 0.0)
        if self.kind[k] == 3:
            # parts of 1/16 are single, and may bend by 4
            u = (2 * np.arange(16) + 1) / 16 - 1
            distance = np.linalg.norm(at(ball.points, np.clip(ball.closest, u - 1 / 16, u + 1 / 16))[:, :2], axis=1)
            size = (1 + 0.5 * 4 / 16) / 16 + ball.radius(u)
            begins = at(ball.points, u)[:, 2] - size
            doubt = begins[distance - 0.5 * 4 / 16**2 <= ball.radius(u)].min()
        start, met = self.start[k], [(2 * k, ball), (2 * k + 1, other)]
        met = [(row, own) for row, own in met if own.is_met]
        within = [(row, own) for row, own in met if own.begin <= start < own.end]
        ahead = [(row, own) for row, own in met if own.begin > start]
        hit = None
        if within:
            row, own = max(within, key=lambda one: one[1].end)
            end = own.end
            for row_ahead, one in ahead:
                if one.begin <= end + TIE and one.end > end:
                    row, own = row_ahead, one
            hit = SimpleNamespace(row=row, ball=own, u=own.leaves, way=-1)
        elif ahead:
            row, own = min(ahead, key=lambda one: one[1].begin)
            hit = SimpleNamespace(row=row, ball=own, u=own.enters, way=1)
        if hit:
            hit.place = hit.ball.depth(hit.u, hit.way)
            hit.off = self.slack[k] * hit.ball.radius(hit.u) / np.sqrt(hit.ball.room(hit.u))
        self.most[k] = (0.5 if k % 3 else 2.0) * (hit.off / hit.place if hit else 1.0)
        return SimpleNamespace(hit=hit, doubt=doubt)

    def records(self, empty):
        empty["points"], empty["reference"] = (own.reshape(2 * COUNT, -1) for own in (self.points, self.reference))
        empty["turn"], empty["near"], empty["reach"] = self.turn, self.near, self.reach
        empty["deviation"] = 0.75 * np.repeat(self.slack, 2)
        empty["owner"] = 500 + np.arange(2 * COUNT)
        return empty


def test_rays_find_where_tubes_begin_or_end_and_know_its_error(functions, rays):
    tubes = Tubes(np.random.default_rng(33), rays)
    kernel = functions("tube_draw")
    rows = rays.rows(tubes.start > 0, tubes.radius, tubes.growth, 0.25 * tubes.slack, tubes.most)
    curves, listed = tubes.records(kernel.records("curves", 2 * COUNT)), np.arange(2 * COUNT, dtype=np.uint32)
    given = {"curves": curves, "listed": listed, **buffers_of(tubes.start, rays)}
    (found,) = parted(kernel(rows, width_of([FOUND]), **given), [FOUND])
    for k, expected in enumerate(tubes.hits):
        hit, doubt = expected.hit, expected.doubt
        assert found["doubt"][k] * rays.scale[k] == pytest.approx(doubt, rel=1e-8, abs=0)
        if not hit:
            assert (found["depth"][k], found["owner"][k]) == (np.inf, NOBODY)
            assert found["status"][k] == (AMBIGUOUS if doubt < np.inf else 0)
            continue
        close = 1e-5 if tubes.kind[k] == 1 else 1e-9
        assert found["depth"][k] * rays.scale[k] == pytest.approx(hit.place, rel=close)
        assert found["uncertainty"][k] * rays.scale[k] == pytest.approx(hit.off, rel=1e-4, abs=0)
        is_certain = hit.off <= tubes.most[k] * hit.place and doubt > hit.place
        assert found["status"][k] == (CERTAIN if is_certain else AMBIGUOUS)
        assert found["owner"][k] == 500 + hit.row
        away = np.array([0.0, 0.0, hit.place]) - at(hit.ball.points, hit.u)
        normal = rays.in_world(k, hit.way * away / np.linalg.norm(away))
        assert found["normal"][k] == pytest.approx(normal, abs=1e-4)
        assert found["place"][k] == pytest.approx(at(tubes.reference[hit.row], hit.u), abs=1e-4)
    rows_hit = np.array([each.hit.row % 2 for each in tubes.hits if each.hit])
    assert 0.05 < rows_hit.mean() < 0.5
    assert 0.2 < np.mean(found["status"] == CERTAIN) < 0.8
