"""Bounds of distances and of pairs of boxes: values lie within them, and some come near their ends (claims.py)."""

from types import SimpleNamespace

import numpy as np
import pytest
from claims import TEETH, check

from elvis.core.data.dataset import Dataset
from elvis.core.differences import overlaps
from elvis.core.differences.bent_pairs import _limits
from elvis.core.differences.compositions import PairBoxes
from elvis.core.distances.parts import Model, Parts, linear_distance
from elvis.core.distances.quadratic import least
from elvis.core.distances.surface_patches import BOUNDED, CORNERS, SurfacePatches
from elvis.core.polynomials.net_zeros import has_no_zero, is_injective
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import _sized
from elvis.core.quantities.regions import EVERYWHERE, NOWHERE, side
from elvis.core.shapes import Shape
from elvis.core.testing import grid

COUNT = 40
LINE = np.array([1.0, 0.0, 0.0])


def exponentials(rng, size):
    """Parts around the middle of patches X = e^(a s + b t) along a line, as far from 0; bounds of X's derivatives."""
    rates = rng.uniform(0.3, 1, (COUNT, 2))
    frames = size * rng.uniform(0.2, 1, (COUNT, 2, 2))
    own = np.einsum("nia,ni->na", frames, rates)
    greatest = np.exp(own.sum(axis=1))
    columns = [rates[:, 0] ** a * rates[:, 1] ** b * greatest for a, b in BOUNDED]
    bounds = np.column_stack([*columns, np.full(COUNT, 0.3)])
    signed = frames * rng.choice([-1, 1], frames.shape)
    parts = Parts(4, np.arange(COUNT), np.zeros((COUNT, 2)), signed, 1)
    nothing = np.zeros((COUNT, 3))
    model = Model(parts, nothing, np.tile(LINE, (COUNT, 1)), np.zeros((COUNT, 2, 3)), nothing[:, :2], nothing)
    return model, bounds, own


def test_models_have_the_derivatives_of_half_the_squared_distance():
    """At middles of parts in skewed coordinates, by differences of second order."""
    rng, step = np.random.default_rng(9), 1e-4
    rows = np.arange(COUNT)
    patches = SurfacePatches(4, rng.uniform(-1, 1, (COUNT, 3, 3, 3)), rows, rows)
    parts = Parts(4, rows, rng.uniform(-0.5, 0.5, (COUNT, 2)), rng.uniform(-1, 1, (COUNT, 2, 2)))
    goal = rng.uniform(-1, 1, (COUNT, 3))

    def half(s, t):
        points = parts.middle + s * step * parts.frame[:, :, 0] + t * step * parts.frame[:, :, 1]
        return 0.5 * ((patches.at(points, rows) - goal) ** 2).sum(axis=1)

    model = Model.of(patches, parts, goal)
    slopes = [half(1, 0) - half(-1, 0), half(0, 1) - half(0, -1)]
    assert model.gradient == pytest.approx(np.transpose(slopes) / (2 * step), rel=1e-5, abs=1e-6)
    twice = [half(1, 0) - 2 * half(0, 0) + half(-1, 0), half(0, 1) - 2 * half(0, 0) + half(0, -1)]
    mixed = (half(1, 1) - half(1, -1) - half(-1, 1) + half(-1, -1)) / 4
    assert model.bend == pytest.approx(np.transpose([twice[0], mixed, twice[1]]) / step**2, rel=1e-4, abs=1e-5)


def changes_of_second_derivatives(rng):
    """Of half the squared distance e^(2 a s + 2 b t) / 2 from the middle of a part to a corner."""
    model, bounds, rates = exponentials(rng, 0.02)
    found = 2 * rates[:, :, None] * rates[:, None] * np.expm1(2 * rates.sum(axis=1))[:, None, None]
    stated = model.change(bounds)
    for a, b in np.ndindex(2, 2):
        yield found[:, a, b], stated[:, a, b]


def derivatives_of_parts(rng):
    """The chain rule, for each order."""
    model, bounds, rates = exponentials(rng, 1.0)
    greatest = np.exp(rates.sum(axis=1))
    for order in (1, 2, 3):
        found = greatest
        for _ in range(order):
            found = found[..., None] * rates.reshape(COUNT, *(1,) * (found.ndim - 1), 2)
        yield found, model._bounds(bounds, order)


def distances_of_linear_parts(rng):
    """Less how far the part may be from them: by its second derivatives, whole patches by what is known of them."""
    model, bounds, rates = exponentials(rng, 0.1)
    first = np.zeros((COUNT, 2, 3))
    first[:, :, 0] = rates
    model = Model(model.parts, model.goal, model.gap, first, first[:, :, 0], model.bend)
    where, nearest = model.nearest_linear(bounds)
    linear = 1 - rates.sum(axis=1)
    assert np.abs(where + 1).max() < 1e-12
    second = rates[:, :, None] * rates[:, None] * np.exp(rates.sum(axis=1))[:, None, None]
    yield second.sum(axis=(1, 2)) / 2, linear - nearest
    whole = Model(Parts.whole(4, np.arange(COUNT)), model.goal, model.gap, first, model.gradient, model.bend)
    yield np.full(COUNT, 0.3), linear - whole.nearest_linear(bounds)[1]


def derivatives_of_patches(rng):
    """Polynomials whose coefficients have one direction are largest at the corner (1, 1)."""
    for corners in (2, 4):
        shape = (COUNT, 1, 4, 1) if corners == 2 else (COUNT, 4, 4, 1)
        patches = SurfacePatches(corners, rng.uniform(0.2, 1, shape) * LINE, np.zeros(COUNT, int), np.zeros(COUNT, int))
        rows, corner = np.arange(COUNT), np.ones((COUNT, 2))
        if corners == 2:
            corner[:, 1] = 0.0
        values = patches.derivatives(corner, rows, 3)
        for column, (a, b) in enumerate(BOUNDED):
            if corners == 4 or b == 0:
                yield np.linalg.norm(values[:, b, a], axis=1), patches.bounds[:, column]
        linear = patches.coefficients[:, 0, 0] + patches.coefficients[:, 0, 1]
        linear = linear if corners == 2 else linear + patches.coefficients[:, 1, 0]
        yield np.linalg.norm(values[:, 0, 0] - linear, axis=1), patches.bounds[:, 9]
        yield values[:, 0, 0, 0], patches.boxes[:, 3]
        turned = SurfacePatches(corners, -patches.coefficients, patches.face, patches.outer)
        yield values[:, 0, 0, 0], -turned.boxes[:, 0]


@pytest.mark.parametrize("corners", [2, 3, 4])
def test_patches_are_cut_if_they_bend_by_more_than_a_part_of_their_sides(corners):
    """Of sides of length 2 a and, but for lines, 2 b; those next to the limit bend by 0.99 or 1.01 of it."""
    for a, b in ((1.0, 0.1), (0.1, 1.0)):
        side = a + b * (corners > 2)
        for factor, parts in ((0.99, 1), (1.01, 2 if corners == 2 else 4)):
            coefficients = np.zeros((1, 1 if corners == 2 else 3, 3, 3))
            coefficients[0, 0, 1, 0] = a
            if corners > 2:
                coefficients[0, 1, 0, 1] = b
            coefficients[0, 0, 2, 2] = 0.04 * factor * side
            patches = SurfacePatches(corners, coefficients, np.zeros(1, int), np.zeros(1, int))
            assert len(patches.flatten()) == parts


def random_boxes(rng, places):
    """Boxes with fields and coordinates that are off."""
    rows = np.arange(COUNT)
    error = rng.uniform(0.05, 0.2, (COUNT, 2))
    return PairBoxes(rows, rows, places, error, rng.normal(size=(COUNT, 2, 3)), rng.uniform(0.05, 0.2, COUNT))


def differences_in_boxes_that_meet(rng):
    """Of fields at the ends of what they may be."""
    places = rng.uniform(-1, 1, (COUNT, 2, 2, 2))
    one, two = random_boxes(rng, places), random_boxes(rng, places)
    rows = np.arange(COUNT)
    stated = _limits(one, two, rows, rows)
    ends = [
        [own.own.reshape(COUNT, -1).min(axis=1) - own.own_error, own.own.reshape(COUNT, -1).max(axis=1) + own.own_error]
        for own in (one, two)
    ]
    sides = [SimpleNamespace(ranges=lambda own=own: tuple(own)) for own in ends]
    for bound in (stated, overlaps._apart(*sides, rows, rows)):
        yield np.maximum(ends[0][1] - ends[1][0], ends[1][1] - ends[0][0]), bound


CLAIMS = [
    changes_of_second_derivatives,
    derivatives_of_parts,
    distances_of_linear_parts,
    derivatives_of_patches,
    differences_in_boxes_that_meet,
]


@pytest.mark.parametrize("claim", CLAIMS)
def test_values_lie_within_bounds_and_some_near_their_ends(claim):
    check(claim, TEETH)


@pytest.mark.parametrize("part", [0.99, 1.01])
@pytest.mark.parametrize("axis", [0, 1])
def test_boxes_within_their_errors_overlap(part, axis):
    """On either side of one another."""
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 1, (COUNT, 2, 2, 2))
    one = random_boxes(rng, places)
    for way in (-1, 1):
        two = random_boxes(rng, places.copy())
        size = np.ptp(places[:, axis].reshape(COUNT, -1), axis=1)
        gap = size + part * (one.place_error + two.place_error)[:, axis]
        two.places[:, axis] += way * gap[:, None, None]
        limits = _limits(one, two, np.arange(COUNT), np.arange(COUNT))
        assert ((limits >= 0) == (part < 1)).all()


@pytest.mark.parametrize("corners", [2, 3, 4])
def test_minima_of_quadratic_functions_are_below_all_samples(corners):
    rng = np.random.default_rng(corners)
    a, b = rng.normal(size=(2, 400))
    c = rng.normal(size=400)
    bend = np.stack([a, b, c], axis=1)
    gradient = rng.normal(size=(400, 2)) * rng.choice([0.2, 1.0], (400, 1))
    # some have their minimum inside, at any distance from the sides
    inner = rng.uniform(-0.9, 0.9, (400, 2)) if corners == 4 else rng.uniform(-0.9, -0.1, (400, 2))
    convex = np.arange(400) % 2 == 0
    bend[convex, 0], bend[convex, 2] = np.abs(a)[convex] + np.abs(b)[convex], np.abs(c)[convex] + np.abs(b)[convex]
    matrices = bend[:, [[0, 1], [1, 2]]]
    gradient[convex] = -np.einsum("nij,nj->ni", matrices, inner)[convex]
    if corners == 2:
        gradient[:, 1] = 0.0
    line = np.linspace(-1, 1, 41)
    s, t = np.meshgrid(line, line if corners > 2 else np.zeros(1))
    samples = np.stack([s.reshape(-1), t.reshape(-1)], axis=1)
    samples = samples[samples.sum(axis=1) <= 1e-12] if corners == 3 else samples
    found = least(corners, bend, gradient)

    def value(points):
        return np.einsum("ni,nmi->nm", gradient, points) + np.einsum("nmi,nij,nmj->nm", points, matrices, points) / 2

    lowest = value(np.tile(samples, (400, 1, 1))).min(axis=1)
    own = value(found[:, None])[:, 0]
    assert (own <= lowest + 1e-12).all()
    assert (np.abs(found) <= 1 + 1e-12).all()
    assert corners != 3 or (found.sum(axis=1) <= 1e-12).all()
    if corners == 4:
        assert np.abs(found - inner)[convex].max() < 1e-9


@pytest.mark.parametrize("part", [0.99, 1.01])
def test_convexity_and_monotonicity_of_squared_distances_hold_up_to_their_change(part):
    """Derivatives s, t and mixed ones, of either sign, against the worst matrix within the changes."""
    rng = np.random.default_rng(3)
    change = rng.uniform(0.1, 0.5, (COUNT, 2, 2))
    change = (change + change.swapaxes(1, 2)) / 2
    mixed = rng.uniform(0.1, 0.5, COUNT) * rng.choice([-1, 1], COUNT)
    worst = np.abs(mixed) + change[:, 0, 1]
    s = worst * rng.uniform(0.5, 2, COUNT)
    bend = np.stack([s + change[:, 0, 0], mixed, worst**2 / s / part + change[:, 1, 1]], axis=1)
    nothing, row = np.zeros((COUNT, 3)), np.zeros(COUNT, int)
    steps = np.abs(bend[:, [[0, 1], [1, 2]]]) + change
    for axis in (0, 1):
        gradient = np.zeros((COUNT, 2))
        gradient[:, axis] = steps[:, axis].sum(axis=1) / part * rng.choice([-1, 1], COUNT)
        for corners in (3, 4):
            parts = Parts(corners, row, np.zeros((COUNT, 2)), np.tile(np.eye(2), (COUNT, 1, 1)))
            model = Model(parts, nothing, nothing, np.zeros((COUNT, 2, 3)), gradient, bend)
            assert (model.is_convex(change) == (part < 1)).all()
            assert (model.is_steady(change) == (part < 1)).all()
    line = Parts(2, row, np.zeros((COUNT, 2)), np.tile(np.eye(2), (COUNT, 1, 1)))
    bend[:, 0] = change[:, 0, 0] / part
    model = Model(line, nothing, nothing, np.zeros((COUNT, 2, 3)), gradient, bend)
    assert (model.is_convex(change) == (part < 1)).all()


@pytest.mark.parametrize("corners", [2, 3, 4])
def test_distances_to_linear_patches_match_those_of_samples(corners):
    rng = np.random.default_rng(corners)
    coefficients = rng.normal(size=(COUNT, 1 if corners == 2 else 2, 2, 3))
    patches = SurfacePatches(corners, coefficients, np.zeros(COUNT, int), np.zeros(COUNT, int))
    goal = 2 * rng.normal(size=(COUNT, 3))
    found = linear_distance(patches, np.arange(COUNT), goal)
    fine = np.linspace(-1, 1, 81)
    s, t = (own.reshape(-1) for own in np.meshgrid(fine, fine if corners > 2 else np.zeros(1)))
    is_in = s + t <= 1e-12 if corners == 3 else np.ones(len(s), bool)
    across = coefficients[:, 1, 0] if corners > 2 else 0 * goal
    along = coefficients[:, 0, 1]
    points = coefficients[:, None, 0, 0] + s[is_in, None] * along[:, None] + t[is_in, None] * across[:, None]
    nearest = np.linalg.norm(points - goal[:, None], axis=2).min(axis=1)
    assert (found <= nearest + 1e-12).all()
    assert (nearest - found <= 0.05 * (np.linalg.norm(along, axis=1) + np.linalg.norm(across, axis=1))).all()
    assert len(CORNERS[corners]) == corners


@pytest.mark.parametrize(("part", "is_told"), [(0.99, False), (1.01, True)])
def test_components_above_their_rounding_have_no_zero(part, is_told):
    for way in (-1, 1):
        for component in (0, 1):
            nets = np.random.default_rng(2).normal(size=(COUNT, 2, 3, 3))
            nets[:, component] = way * (np.abs(nets[:, component]) + 0.1)
            nets[:, component, 1, 2] = way * 0.1
            rounding = np.full((COUNT, 2), 99.0)
            rounding[:, component] = 0.1 / part
            assert (has_no_zero(nets, rounding) == is_told).all()


@pytest.mark.parametrize(("part", "is_told"), [(0.99, True), (1.01, False)])
def test_maps_near_the_identity_are_injective(part, is_told):
    """Rows of derivatives differ from those of the unit matrix by less than 1 together."""
    for row in (0, 1):
        places = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], indexing="ij"))
        unit = places.copy()
        unit[row] += part * (0.4 * places[0] - 0.6 * places[1])
        assert is_injective(unit[None])[0] == is_told


def test_roots_of_cubics_have_regions_by_the_sign_of_their_level():
    root = Expression.of(Dataset(grid(Shape.HEXAHEDRON, 1)), "imaginary_root(x, y)").root
    assert side(root, -0.1, 1) is NOWHERE
    assert side(root, -0.1, -1) is EVERYWHERE
    assert side(root, 0.0, 1) is side(root, 0.0, -1) is None
    assert side(root, 0.1, 1).kind == "product"


def test_sizes_of_sums_match_those_of_their_terms():
    """Also where these cancel, as rounding does not."""
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    for text, size in (("x - y", 5.0), ("x + y", 5.0), ("x*y", 6.0), ("x^2", 4.0), ("x^-2", 0.25)):
        node = Expression.of(dataset, text).root
        parts = [(2.0, 2.0), (-3.0, 3.0)] if "y" in text else [(-2.0, 2.0), (node.operands[1].value,) * 2]
        assert _sized(node, parts)[1] == size
