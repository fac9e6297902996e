"""Bounds of rounding against arithmetic of 60 digits, with bases that are written from their definition."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from audit import basis

from elvis.core.bounds import extrema
from elvis.core.data.dataset import Dataset
from elvis.core.differences.compositions import Composition, PairBoxes
from elvis.core.differences.prepared import sides
from elvis.core.mapping.margins import heights
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.boxnets import EXACT, GRID, all_half_boxes, all_halves, on_lattice, parts_of_boxes
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.rounding import gamma
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple

PLANE = [shape for shape in Shape if shape.dimension == 2]
SPACE = [shape for shape in Shape if shape.dimension == 3]
PAIRS = [(a, b) for group in (PLANE, SPACE) for a in group for b in group if b is not Shape.PYRAMID]
MP = mpmath.mp.clone()
MP.dps = 60
TINY = MP.mpf(10) ** -25


def exact(values):
    """An array of numbers of 60 digits."""
    return np.vectorize(MP.mpf, otypes=[object])(np.asarray(values, float))


def truth(expansion, coefficients, eta):
    """The polynomials with coefficients (…, m) at exact collapsed coordinates."""
    return exact(coefficients) @ np.array(basis.table(expansion, list(eta)), dtype=object)


def placed(shape, seed, bend=0.0, away=3.0):
    """A patch of a mesh whose vertices aren't dyadic, with a field of random coefficients.

    away  how far from the origin
    """
    rng = np.random.default_rng(seed)
    mesh = grid(shape, 1)
    d = shape.dimension
    turn = np.eye(3)
    turn[:d, :d] += rng.uniform(-0.3, 0.3, (d, d))
    shift = np.append(rng.uniform(0, 0.4, d) + away, np.zeros(3 - d))
    mesh = replace(mesh, vertices=mesh.vertices @ turn.T * rng.uniform(0.5, 1.5) + shift)
    if bend:
        mesh = curved(mesh, ripple(bend), 3)
    modes = (3, 4, 4)[:d] if shape in (Shape.TRIANGLE, Shape.TETRAHEDRON, Shape.PRISM) else (4, 3, 4)[:d]
    return with_random(mesh, modified(shape, (4,) * d if shape is Shape.PYRAMID else modes), rng)


def with_random(mesh, expansion, rng):
    bare = patches(Dataset(mesh))[0]
    count = len(basis.table(expansion, [0.3] * expansion.shape.dimension))
    coefficients = rng.uniform(-1, 1, (len(bare), count)) + 1 / 3
    return replace(bare, fields=(expansion,), coefficients=(coefficients,))


def inverse(patch, row, point):
    """Exact xi of an exact point in an element whose map is affine to 14 digits: each step gains as many."""
    d = patch.dimension
    xi = exact(np.zeros(d) - 0.3)
    value = position(patch, row, xi)
    columns = [(position(patch, row, xi + step) - value) / TINY for step in steps(d)]
    slope = MP.matrix([[column[i] for column in columns] for i in range(d)]) ** -1
    for _ in range(4):
        away = MP.matrix(list(position(patch, row, xi) - point))
        xi = xi - np.array(list(slope * away), dtype=object)
    assert max(abs(position(patch, row, xi) - point)) < TINY
    return xi


def steps(d):
    return [np.array([TINY if i == j else MP.mpf(0) for i in range(d)], dtype=object) for j in range(d)]


def position(patch, row, xi):
    return truth(patch.geometry, patch.geometry_coefficients[row][: len(xi)], collapsed(patch.shape, xi))


def collapsed(shape, xi):
    """Exact eta."""
    eta = list(xi)
    if shape is Shape.TRIANGLE:
        eta[0] = 2 * (1 + xi[0]) / (1 - xi[1]) - 1
    elif shape is Shape.PRISM:
        eta[0] = 2 * (1 + xi[0]) / (1 - xi[2]) - 1
    elif shape is Shape.TETRAHEDRON:
        eta[0], eta[1] = 2 * (1 + xi[0]) / (-xi[1] - xi[2]) - 1, 2 * (1 + xi[1]) / (1 - xi[2]) - 1
    return eta


def whole_parts(side):
    """What boxes of whole elements have."""
    return side.places, side.place_error, side.box, side.box_error


def net_value(net, t):
    """A net's exact value at exact t in [0, 1]."""
    net = exact(net)
    for own in t:
        p = len(net) - 1
        weights = [MP.binomial(p, k) * own**k * (1 - own) ** (p - k) for k in range(p + 1)]
        net = sum(weight * part for weight, part in zip(weights, net, strict=True))
    return net


def common_points(composition, boxes, inner, count):
    """Boxes and places t (d,) of a dyadic lattice on them, in elements of the other side, some at random."""
    line, d = np.arange(9) / 8, boxes.places.shape[1]
    world = on_lattice(boxes.places.reshape(-1, *boxes.places.shape[2:]), line).reshape(len(boxes), d, -1)
    xi = np.einsum("ndq,ndk->nqk", world, inner.affine.matrix[boxes.others])
    box, place = np.nonzero(heights(inner.patch.shape, xi).min(axis=2) >= 1e-9)
    which = np.random.default_rng(6).permutation(len(box))[:count]
    lattice = np.stack(np.meshgrid(*[line] * d, indexing="ij"), axis=-1).reshape(-1, d)
    return zip(box[which].tolist(), lattice[place[which]], strict=True)


@pytest.mark.parametrize("shape", [*PLANE, *SPACE])
def test_errors_of_nets_of_elements_are_below_the_stated_bound(shape):
    """Of the field and the coordinates, far from the origin, at first and after halving."""
    patch = placed(shape, 1, 0.05, 1000.0)
    d, row, rng = patch.dimension, 1 % len(patch), np.random.default_rng(2)
    (side,) = sides([patch])
    boxes = PairBoxes(*[np.array([row])] * 2, *(own[[row]] for own in whole_parts(side)))
    low, high = np.full((1, d), -1.0), np.full((1, d), 1.0)
    for _ in range(4):
        for _ in range(3):
            t = exact(rng.integers(0, 17, d) / 16)
            eta = exact(low[0]) + (exact(high[0]) - exact(low[0])) * t
            field = truth(patch.fields[0], patch.coefficients[0][row], eta)
            assert abs(field - net_value(boxes.own[0], t)) <= boxes.own_error[0]
            places = truth(patch.geometry, patch.geometry_coefficients[row][:d], eta)
            for axis in range(d):
                assert abs(places[axis] - net_value(boxes.places[0, axis], t)) <= boxes.place_error[0, axis]
        which = int(rng.integers(2**d))
        boxes = boxes.halved().part(np.array([which]))
        low, high = (own[[which]] for own in all_half_boxes(low, high))
        axis = int(rng.integers(d))
        boxes = boxes.cut(axis, np.array([1]), np.array([6]))
        width = high[0, axis] - low[0, axis]
        low[0, axis], high[0, axis] = low[0, axis] + width / 8, low[0, axis] + 0.75 * width


@pytest.mark.parametrize("shape", [shape for shape in (*PLANE, *SPACE) if shape is not Shape.PYRAMID])
def test_errors_of_inverse_maps_are_below_the_stated_bound(shape):
    """In elements that lie far from the origin, so that hexahedra are affine to rounding alone."""
    patch = placed(shape, 4, 0.0, 1000.0)
    (side,) = sides([patch])
    assert side.affine.holds.all()
    for xi in exact(uncollapse(shape, np.random.default_rng(3).integers(-8, 9, (5, patch.dimension)) / 8 * 0.99)):
        away = position(patch, 0, xi) - exact(side.affine.origin[0])
        found = away @ exact(side.affine.matrix[0])
        assert (abs(found - xi) <= side.affine.error[0]).all()


@pytest.mark.parametrize("shape", [Shape.QUADRILATERAL, Shape.TETRAHEDRON])
def test_bisecting_and_cutting_add_rounding(shape):
    """To nets that are exact at first, many times: in each direction of a box around one place."""
    patch = placed(shape, 7)
    d, rng = patch.dimension, np.random.default_rng(8)
    (side,) = sides([patch])
    places, place_error, own, own_error = (each[:1] for each in whole_parts(side))
    first = PairBoxes(*[np.array([0])] * 2, places, 0 * place_error, own, 0 * own_error)
    boxes, low, high = first, np.zeros(d), np.ones(d)
    low, high = exact(low), exact(high)
    for _ in range(12):
        upper = rng.integers(0, 2, d)
        boxes = boxes.halved().part(np.array([int("".join(map(str, upper[::-1])), 2)]))
        middle = (low + high) / 2
        low, high = np.where(upper, middle, low), np.where(upper, high, middle)
        boxes = boxes.cut(0, np.array([1]), np.array([7]))
        low[0], high[0] = low[0] + (high[0] - low[0]) / 8, high[0] - (high[0] - low[0]) / 8
    worst = 0.0
    for t in exact(rng.integers(0, 5, (5, d)) / 4):
        away = abs(net_value(own[0], low + (high - low) * t) - net_value(boxes.own[0], t))
        assert away <= boxes.own_error[0]
        worst = max(worst, float(away / boxes.own_error[0]))
        for axis in range(d):
            wanted = net_value(places[0, axis], low + (high - low) * t)
            assert abs(wanted - net_value(boxes.places[0, axis], t)) <= boxes.place_error[0, axis]
    assert worst > 1e-3


@pytest.mark.parametrize("degree", [0, 1, 3, EXACT])
def test_parts_of_boxes_are_exact(degree):
    """So are halves: values of either net are the same polynomial's."""
    net = np.random.default_rng(1).uniform(-1, 1, (1, degree + 1))
    low, high = np.array([3]), np.array([7])
    part = parts_of_boxes(net, 0, low, high)
    for t in exact(np.arange(5) / 4):
        wanted = net_value(net[0], [(3 + 4 * t) / GRID])
        assert abs(net_value(part[0], [t]) - wanted) <= gamma(degree + 1)
        assert abs(net_value(all_halves(net)[1], [t]) - net_value(net[0], [(1 + t) / 2])) <= gamma(degree + 1)


@pytest.mark.parametrize("shape", [*PLANE, *SPACE])
def test_extrema_include_rounding_of_nets(shape):
    """A difference of polynomials of other degrees, and its halves, against exact values."""
    rng = np.random.default_rng(1)
    one, two = placed(shape, 1), placed(shape, 2)
    lower = modified(shape, (3,) * shape.dimension)
    two = with_random(grid(shape, 1), lower, rng)
    patch = replace(one, fields=(*one.fields, lower), coefficients=(*one.coefficients, two.coefficients[0]))
    rows = np.arange(len(patch))
    own = extrema._nets(patch, 0, rows)
    for t in exact(rng.integers(0, 17, (5, patch.dimension)) / 16):
        away = truth(patch.fields[0], patch.coefficients[0][0], 2 * t - 1) - net_value(own.values[0], t)
        assert abs(away) <= own.error[0]
    boxes = extrema._whole(own.minus(extrema._nets(patch, 1, rows)))
    for _ in range(3):
        k = int(rng.integers(len(boxes.rows)))
        t = exact(rng.integers(0, 17, patch.dimension) / 16)
        eta = exact(boxes.low[k]) + (exact(boxes.high[k]) - exact(boxes.low[k])) * t
        first, second = (truth(patch.fields[i], patch.coefficients[i][boxes.rows[k]], eta) for i in range(2))
        assert abs(first - second - net_value(boxes.nets.values[k], t)) <= boxes.nets.error[k]
        boxes = boxes.part(np.array([k])).halved()


def beyond(space, net, xi):
    """A polynomial's exact value from its Bernstein coefficients, anywhere."""
    t, total = (1 + xi) / 2, MP.mpf(0)
    groups = [[axis] for axis in range(len(xi))]
    if space.shape in (Shape.TRIANGLE, Shape.TETRAHEDRON):
        groups = [list(range(len(xi)))]
    elif space.shape is Shape.PRISM:
        groups = [[0, 2], [1]]
    for coefficient, powers in zip(exact(net), space.powers.tolist(), strict=True):
        value = coefficient
        for own, degree in zip(groups, space.degrees, strict=True):
            parts = [*t[own], 1 - sum(t[own])]
            exponents = [*(powers[axis] for axis in own), degree - sum(powers[axis] for axis in own)]
            value *= MP.factorial(degree)
            for part, exponent in zip(parts, exponents, strict=True):
                value *= part**exponent / MP.factorial(exponent)
        total += value
    return total


@pytest.mark.sampled
@pytest.mark.parametrize(("outer", "inner"), PAIRS)
def test_errors_of_differences_far_beyond_elements_are_below_the_stated_bound(outer, inner):
    """At Chebyshev points of a box, for the polynomial of its own nets; a part of that is reached."""
    one, two = placed(outer, 3, 0.05), placed(inner, 4)
    (ours,), (theirs,) = sides([one]), sides([two])
    composition = Composition(ours, theirs)
    boxes = composition.whole(np.array([0, len(one) - 1]), np.array([len(two) - 1, 0]))
    values, rounding = composition.values(boxes), composition.rounding_of_values(boxes)
    assert composition.growth(boxes).max() > 5
    lattice = np.stack(np.meshgrid(*[composition.line] * one.dimension, indexing="ij"), axis=-1)
    lattice = lattice.reshape(-1, one.dimension)
    closest = 0.0
    for k in range(2):
        for place in np.argsort(-np.abs(values[k]))[:6]:
            t = exact(lattice[place])
            world = np.array([net_value(net, t) for net in boxes.places[k]])
            xi = world @ exact(theirs.affine.matrix[boxes.others[k]])
            wanted = net_value(boxes.own[k], t) - beyond(theirs.space, theirs.net[boxes.others[k]], xi)
            away = float(abs(wanted - values[k, place]))
            assert away <= rounding[k]
            closest = max(closest, away / rounding[k])
    assert closest > 1e-4


@pytest.mark.sampled
@pytest.mark.parametrize(("outer", "inner"), PAIRS)
def test_differences_on_boxes_are_bounded_with_all_rounding(outer, inner):
    """At common points of both elements: |exact difference - net| <= slack, |exact difference| <= limit."""
    one, two = placed(outer, 3, 0.05), placed(inner, 4)
    d = one.dimension
    (ours,), (theirs,) = sides([one]), sides([two])
    assert theirs.affine.holds.all()
    composition = Composition(ours, theirs)
    boxes = composition.whole(*(own.reshape(-1) for own in np.indices((len(one), len(two)))))
    low = np.full((len(boxes), d), -1.0)
    high = -low
    for _ in range(2):
        meets = composition.meet(boxes)
        for k, t in common_points(composition, boxes, theirs, 3):
            assert meets[k]
            ((_, composed),) = composition.compose(boxes.part(np.array([k])), 1e-6)
            assert composed.slack[0] < 1e-5
            eta = exact(low[k]) + (exact(high[k]) - exact(low[k])) * exact(t)
            row, other = boxes.rows[k], boxes.others[k]
            xi = inverse(two, other, truth(one.geometry, one.geometry_coefficients[row][:d], eta))
            difference = truth(one.fields[0], one.coefficients[0][row], eta)
            difference -= truth(two.fields[0], two.coefficients[0][other], collapsed(inner, xi))
            away = abs(difference - net_value(composed.nets[0], exact(t)))
            assert away <= composed.slack[0]
            assert abs(difference) <= composed.limit[0]
        low, high = all_half_boxes(low, high)
        boxes = boxes.halved()


@pytest.mark.parametrize("axis", [0, 1])
def test_parts_of_boxes_are_rounded_once_for_each_coefficient_of_their_direction(axis):
    rng = np.random.default_rng(8)
    places, own = rng.normal(size=(3, 2, 5, 6)), rng.normal(size=(3, 4, 7))
    errors = rng.uniform(0, 1e-16, (3, 3))
    boxes = PairBoxes(np.arange(3), np.arange(3), places, errors[:, :2], own, errors[:, 2])
    cut = boxes.cut(axis, np.zeros(3, int), np.full(3, GRID // 2))
    of_places = gamma((5, 6)[axis]) * np.abs(places).max(axis=(2, 3))
    assert cut.place_error == pytest.approx(errors[:, :2] + of_places, rel=1e-12, abs=0)
    of_own = gamma((4, 7)[axis]) * np.abs(own).max(axis=(1, 2))
    assert cut.own_error == pytest.approx(errors[:, 2] + of_own, rel=1e-12, abs=0)
