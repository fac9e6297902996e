"""Contours in the lattice of a pixel's square: exact for quadratic values, and no cell is left out that has a part."""

from itertools import product

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of

COUNT, MANY = 96, 8
CORNERS = np.array([[x, y] for y in range(MANY + 1) for x in range(MANY + 1)])
STEPS = np.array([[1, 0], [0, 1], [-1, 1]])
FOUND = {
    **dict.fromkeys(["part", "crosses"], 1),
    "where": 2,
    "dips": 1,
    "extremum": 2,
    "half": 2,
    "in_triangle": 1,
    "from": 2,
    "to": 2,
    "cells": 6,
    "first_cells": 2,
    "left": 2,
    "empty": 2,
    "center": 2,
    "right": 2,
    "below": 2,
    "remains": 1,
    "start": 2,
    "end": 2,
}
#: margins of the unit square's half below the diagonal: x, y, and 1 - x - y
FACETS = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [-1.0, -1.0, 0, 1.0]])


class Squares:
    """Squares whose values are quadratic, with the level between two corners of a cell or an extremum next to it."""

    def __init__(self, rng):
        self.form, self.slope = rng.uniform(-1, 1, (COUNT, 3)), rng.uniform(-1, 1, (COUNT, 2))
        self.middle = rng.uniform(0, MANY, (COUNT, 2))
        self.first = rng.integers(3, MANY - 2, (COUNT, 2))
        self.second = self.first + STEPS[np.arange(COUNT) % 3]
        turned = rng.integers(2, size=COUNT) > 0
        self.first[turned], self.second[turned] = self.second[turned], self.first[turned]
        self.noise = rng.choice([0.0, 1e-3, 0.05], COUNT)
        # an extremum on the side, which the level just crosses or misses
        self.dips = np.arange(COUNT) % 2 == 0
        self.slope[self.dips] *= 0.05
        part = rng.uniform(-0.2, 1.2, (COUNT, 1))
        self.middle[self.dips] = (self.first + part * (self.second - self.first))[self.dips]
        t = rng.uniform(0.02, 0.98, COUNT)
        self.level = self.at(self.first + t[:, None] * (self.second - self.first))
        self.level[self.dips] = self.extremum()[1][self.dips] + rng.uniform(-0.1, 0.1, self.dips.sum())
        self.lattice = np.stack([self.at(np.tile(corner, (COUNT, 1))) for corner in CORNERS], axis=1)
        # inner ones: on their sides a third corner is there for a parabola
        row, column = rng.integers(1, MANY - 1, (2, COUNT))
        self.triangle = 2 * (MANY * row + column) + rng.integers(2, size=COUNT)
        flat = np.array([[x, y, 0.0] for y in (0, 0.5, 1) for x in (0, 0.5, 1)])
        turn = rng.uniform(-1, 1, (COUNT, 2, 2))
        self.nodes = np.zeros((COUNT, 9, 3))
        self.nodes[..., :2] = np.einsum("nij,kj->nki", turn, flat[:, :2] - 0.5) + rng.uniform(-0.2, 0.7, (COUNT, 1, 2))
        # each way that is largest at some place between nodes, where all of their deviations add up
        worst = np.sign([weights_at(*rng.choice([0.4, 1.6], 2)) for _ in range(COUNT // 2)])
        self.nodes[::2, :, :2] += 0.05 * rng.choice([-1, 1], (COUNT // 2, 1, 2)) * worst[..., None]
        # half a cell beyond the last column of cells, the border of the element is a little farther, or nearer
        self.nodes[-2:] = 2 * flat - [2.125, 0, 0]
        self.nodes[-2:, :, 0] += np.array([[-0.5e-10], [-1.5e-10]])

        self._thin(rng)
        self.segments = rng.uniform(0, 2, (COUNT, 2, 2))

    def _thin(self, rng):
        """Elements that are narrow in one direction of the pixel, and have a point in its square."""
        self.center, self.base, point = rng.uniform(-1, 1, (3, COUNT, 2))
        turns = np.linalg.qr(rng.normal(size=(2, COUNT, 2, 2)))[0]
        stretch = np.stack([rng.uniform(3, 40, COUNT), rng.uniform(0.05, 0.6, COUNT)], axis=1)
        self.linear = np.einsum("nik,nk,njk->nij", turns[0], stretch, turns[1])
        inside = rng.dirichlet(np.ones(3), COUNT)[:, :2]
        self.reference = inside - np.einsum("nij,nj->ni", self.linear, self.center + 0.5 * point - self.base)

    def margins_in_pixels(self, places):
        """(n, k, 3) margins of the thin elements at places (n, k, 2)."""
        found = self.reference[:, None] + np.einsum("nij,nkj->nki", self.linear, places - self.base[:, None])
        return found @ FACETS[:, :2].T + FACETS[:, 3]

    def at(self, places):
        x, y = (places - self.middle).T
        a, b, c = self.form.T
        return a * x**2 + b * x * y + c * y**2 + (self.slope * (places - self.middle)).sum(axis=1)

    def along(self):
        """Coefficients (n, 3) of the values on the side from the first corner to the second: of 1, t and t^2."""
        step = self.second - self.first
        values = [self.at(self.first + t * step) for t in (0.0, 0.5, 1.0)]
        curved = 2 * (values[0] - 2 * values[1] + values[2])
        return np.stack([values[0], values[2] - values[0] - curved, curved], axis=1)

    def extremum(self):
        start, slope, curved = self.along().T
        place = -slope / 2 / curved
        return place, start + slope * place / 2

    def rows(self):
        one = np.tile([0.3, 0.3, 0.0, 1.0, 0.2, 0.0, 0.1, 1.0, 0.0], (COUNT, 1))
        columns = [self.level, self.noise, self.first, self.second, self.triangle, one, self.nodes]
        columns += [np.pad(own, ((0, 0), (0, 1))) for own in (self.reference, *np.moveaxis(self.linear, 2, 0))]
        columns += [self.base, self.center, self.segments]
        return rows_of(COUNT, columns)


@pytest.fixture(scope="module")
def squares():
    return Squares(np.random.default_rng(10))


@pytest.fixture(scope="module")
def found(functions, squares):
    kernel = functions("line_lattice")
    given = {"lattices": squares.lattice, "facets": FACETS}
    (found,) = parted(kernel(squares.rows(), width_of([FOUND]), **given), [FOUND])
    return found


def in_square(places):
    return places * 2 / MANY


def test_levels_cross_sides_where_parabolas_do(squares, found):
    start, slope, curved = squares.along().T
    u, v = start - squares.level, start + slope + curved - squares.level
    crosses = (u > 0) != (v > 0)
    assert np.array_equal(found["crosses"], crosses)
    assert COUNT / 3 < crosses.sum() < COUNT
    for k in np.flatnonzero(crosses):
        roots = np.roots([curved[k], slope[k], u[k]])
        (root,) = roots[(roots >= 0) & (roots <= 1)]
        assert found["part"][k] == pytest.approx(root, abs=1e-9)
        place = squares.first[k] + root * (squares.second[k] - squares.first[k])
        assert found["where"][k] == pytest.approx(in_square(place), abs=1e-9)


def test_dips_are_extrema_that_the_level_crosses_twice(squares, found):
    start, slope, curved = squares.along().T
    place, value = squares.extremum()
    side, ends = np.sign(curved), np.stack([start, start + slope + curved], axis=1)
    above = (side[:, None] * (ends - squares.level[:, None])).min(axis=1)
    bend = 2 * np.abs(curved)
    height = side * (value - squares.level)
    dips = (
        (np.abs(place - 0.5) <= 0.5)
        & (above >= -squares.noise)
        & (height <= squares.noise)
        & (bend > 8 * squares.noise)
    )
    assert np.array_equal(found["dips"], dips)
    assert dips.sum() > 5
    step = squares.second - squares.first
    extremum = in_square(squares.first + place[:, None] * step)
    half = np.sqrt(np.maximum(-2 * height / bend, 0))
    assert found["extremum"][dips] == pytest.approx(extremum[dips], abs=1e-9)
    assert found["half"][dips] == pytest.approx((half[:, None] * in_square(step))[dips], abs=1e-9)


def bits(sets):
    """(n, rows, columns) of cells that belong to sets (n, 2) of 32 bits each."""
    numbers = sets.astype(np.uint64)
    whole = numbers[:, 0] | numbers[:, 1] << np.uint64(32)
    return (whole[:, None] >> np.arange(64, dtype=np.uint64) & np.uint64(1)).reshape(-1, MANY, MANY) > 0


def test_cells_with_lines_are_those_whose_corners_lie_on_both_sides(squares, found):
    near, first, second = (bits(found["cells"][:, k : k + 2]) for k in (0, 2, 4))
    away = (squares.lattice - squares.level[:, None]).reshape(COUNT, MANY + 1, MANY + 1)
    up = away > 0
    a, b, c, d = up[:, :-1, :-1], up[:, :-1, 1:], up[:, 1:, :-1], up[:, 1:, 1:]
    assert np.array_equal(first, (a ^ b) | (a ^ c))
    assert np.array_equal(second, (b ^ c) | (c ^ d))
    assert np.array_equal(near, around(turning(away, squares.noise[:, None, None])))
    cell, which = squares.triangle // 2, squares.triangle % 2
    own = np.where(
        which, second.reshape(COUNT, -1)[np.arange(COUNT), cell], first.reshape(COUNT, -1)[np.arange(COUNT), cell]
    )
    assert np.array_equal(found["in_triangle"], own)


def test_cells_are_taken_in_order(found):
    for cells, first, left in zip(bits(found["cells"][:, 2:4]), found["first_cells"], bits(found["left"]), strict=True):
        among = np.flatnonzero(cells)
        if len(among) > 2:
            assert (first == among[:2]).all()
            assert np.array_equal(np.flatnonzero(left), among[2:])


def turning(away, noise):
    """Corners (n, 9, 9) that may be the middle of a dip on a side of a cell."""
    found = np.zeros(away.shape, bool)
    for x, y in STEPS:
        wide = np.pad(away, ((0, 0), (1, 1), (1, 1)), constant_values=np.nan)
        before, after = (wide[:, 1 + s * y : 10 + s * y, 1 + s * x : 10 + s * x] - away for s in (-1, 1))
        bend = np.abs(before + after)
        is_turning = np.minimum(np.abs(before), np.abs(after)) <= 0.51 * bend
        found |= is_turning & (np.abs(away) <= 0.54 * bend + noise)
    return found


def around(corners):
    """Cells with one of the corners."""
    return corners[:, 1:, 1:] | corners[:, 1:, :-1] | corners[:, :-1, 1:] | corners[:, :-1, :-1]


def test_lines_in_triangles_end_on_two_sides_at_the_level(squares, found):
    some = np.flatnonzero(found["in_triangle"])
    assert len(some) > 5
    for end in ("from", "to"):
        place = found[end] * MANY / 2
        assert np.abs(squares.at(place) - squares.level)[some].max() < 1e-9
    cell, which = squares.triangle // 2, squares.triangle % 2
    corner = np.stack([cell % MANY, cell // MANY], axis=1)
    inside = [found[end] * MANY / 2 - corner for end in ("from", "to")]
    for place in inside:
        below = np.where(which, 2 - place.sum(axis=1), place.sum(axis=1))[some]
        assert (below <= 1 + 1e-9).all()
        assert (place[some] >= -1e-9).all()
        assert (place[some] <= 1 + 1e-9).all()
    assert np.linalg.norm(inside[0] - inside[1], axis=1)[some].min() > 0


def test_empty_cells_have_no_point_in_the_element_within_half_a_cell(squares, found):
    empty = bits(found["empty"])
    line = np.arange(-1, 2 * MANY + 2) / MANY
    margins = np.stack([margins_at(squares.nodes, x, y) for y, x in product(line, line)], axis=1)
    margins = margins.reshape(COUNT, len(line), len(line), 3)
    # maps that are not linear are bounded between their nodes
    margins[np.ix_(range(0, COUNT - 2, 2), [0, -1])] = -np.inf
    margins[np.ix_(range(0, COUNT - 2, 2), range(len(line)), [0, -1])] = -np.inf
    greatest = np.full((COUNT, MANY, MANY, 3), -np.inf)
    for y, x in product(range(5), range(5)):
        greatest = np.maximum(greatest, margins[:, y : y + 2 * MANY : 2, x : x + 2 * MANY : 2])
    is_outside = (greatest < 0).any(axis=3)
    assert (empty[-2:].all(axis=1) == [[*[True] * 7, is_beyond] for is_beyond in (False, True)]).all()
    assert not (empty & ~is_outside).any()
    assert np.array_equal(empty[1::2], is_outside[1::2])
    assert empty[::2].sum() > 0.3 * is_outside[::2].sum()


def test_squares_in_thin_elements_are_narrower_and_leave_nothing_out(squares, found):
    """The narrowed square contains all points of the element in the square; some lie near its sides."""
    places = squares.center[:, None] + np.random.default_rng(11).uniform(-0.5, 0.5, (COUNT, 4000, 2))
    is_inside = (squares.margins_in_pixels(places) >= 0).all(axis=2)
    sides = np.stack([found["right"], found["below"]], axis=1)
    away = np.einsum("nsi,nki->nks", sides, places - found["center"][:, None]) / (sides**2).sum(axis=2)[:, None]
    is_narrow = np.linalg.norm(found["right"], axis=1) < 0.499
    assert is_narrow.mean() > 0.3
    farthest = np.where(is_inside[..., None], np.abs(away), 0.0).max(axis=1)
    assert (farthest <= 1 + 1e-9).all()
    # half the width is 0.75 of the extent: places reach two thirds of it
    assert farthest[is_narrow, 0].max() > 0.6


def test_lines_are_clipped_to_the_element(squares, found):
    """They end where the margin is 0, which is linear along them."""
    start, end = np.moveaxis(squares.segments, 1, 0)
    margins = np.stack(
        [
            [margins_at(own[None], *place)[0] for own, place in zip(squares.nodes, line, strict=True)]
            for line in (start, end)
        ]
    )
    with np.errstate(all="ignore"):
        meets = margins[0] / (margins[0] - margins[1])
    low = np.where(margins[0] < 0, meets, 0.0).max(axis=1)
    high = np.where((margins[0] >= 0) & (margins[1] < 0), meets, 1.0).min(axis=1)
    remains = ~((margins < 0).all(axis=0).any(axis=1)) & (low <= high)
    assert np.array_equal(found["remains"] > 0, remains)
    assert 5 < remains.sum() < COUNT - 5
    for name, part in (("start", low), ("end", high)):
        place = start + part[:, None] * (end - start)
        assert np.abs(found[name] - place)[remains].max() < 1e-9


def weights_at(x, y):
    """(9,) of the nodes of a biquadratic function at a place of [0, 2]^2."""
    u, v = (np.array([(t - 1) * (t - 2) / 2, t * (2 - t), t * (t - 1) / 2]) for t in (x, y))
    return np.outer(v, u).reshape(-1)


def margins_at(nodes, x, y):
    """(n, 3) margins at a place, biquadratic through nodes."""
    return np.einsum("nkc,k->nc", nodes, weights_at(x, y)) @ FACETS[:, :3].T + FACETS[:, 3] + 1e-10
