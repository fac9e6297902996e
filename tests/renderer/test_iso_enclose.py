"""Enclosures of polynomials over sub-elements, on complex ellipses: values lie within them and reach their ends."""

from itertools import product

import numpy as np
import pytest
from jets import POWERS, jets_of
from kernel_functions import parted, width_of
from numpy.polynomial import chebyshev

from elvis.core.polynomials.chebyshev_nodes import series
from elvis.renderer.passes.isosurface.enclosing import AXES, BOXES, powers, tails

COUNT, LEAVES, UNIT = 32, 5, 1.2e-16
ORDER = POWERS.sum(axis=1)
NODES, TO_CHEBYSHEV = series(2)
TO_POWERS = powers(TO_CHEBYSHEV)
SUMS = np.abs(TO_POWERS).sum(axis=1)
#: the corners of a box, where polynomials with positive coefficients are largest, and points at its sides
ENDS = np.array(list(product([-1, 0.2, 1], repeat=3)), float)
DISC = 7
#: so much smaller that some sub-elements have errors of series just below the limit
TAILS = 1e-4 * tails(2)
FOUND = [
    {"growth": 1, "weights": 6, "value": 1, "grown": 1, "slopes": 3},
    {"places": 2, "skewness": 1, "inverse": 9, "values": LEAVES * DISC, "gradients": 3 * LEAVES * DISC},
    {"middle": 1, "radius": 1, "error": 1, "grid_values": 2, "grid_places": 2},
    {"spurious": 1, "doubtful": 1, "avoids": 1, "spread": 7, "misfit": 4, "smooth": 1, "hopeless": 1, "steepness": 1},
]


class Boxes:
    """Sub-elements (n,) of elements whose map and fields are polynomials with positive coefficients (n, 5, 27)."""

    def __init__(self, rng):
        self.coefficients = rng.uniform(0.02, 0.3, (COUNT, LEAVES, 27)) * 3.0**-ORDER
        for axis in range(3):
            self.coefficients[:, axis, 3**axis] += 1.0
        self.coefficients[:, 3:] *= 10
        self.coefficients[::3, 4, 0] -= 8
        self.centre, self.half = rng.uniform(0, 0.6, (COUNT, 3)), rng.uniform(0.05, 0.4, (COUNT, 3))
        self.half[:4] *= 3
        self.half[4:10] /= 50
        self.e, self.kind = rng.integers(7, size=COUNT), np.arange(COUNT) % 3
        self.errors, self.grid = rng.uniform(1e-3, 1e-2, (COUNT, LEAVES)), rng.uniform(1e-3, 1e-2, (COUNT, LEAVES, 2))
        self.errors[1::2] *= 1e-8
        self.errors[3::8] = 0.0
        self.level, self.c = rng.uniform(0, 40, COUNT), rng.uniform(1.0, 1.3, COUNT)

    def rows(self):
        alone = np.stack([self.e, self.kind, self.level, self.c], axis=1)
        return np.concatenate([self.centre, self.half, alone], axis=1)

    def jets(self, s):
        """Values and derivatives (n, p, 5, 4) along s at points (n, p, 3) of sub-elements, also complex ones."""
        r = self.centre[:, None] + self.half[:, None] * s
        jets = jets_of(self.coefficients, r)
        jets[..., 1:] *= self.half[:, None, None]
        return jets


def on_ellipses(rng, axis):
    """Points (n, p, 3) of ellipses through ``axis`` (n,), with the ends of their long half axes."""
    angle = rng.uniform(0, 2 * np.pi, (COUNT, 60, 3))
    b = np.sqrt(axis**2 - 1)[:, None, None]
    around = axis[:, None, None] * np.cos(angle) + 1j * b * np.sin(angle)
    return np.concatenate([around, axis[:, None, None] * ENDS + 0j], axis=1)


@pytest.fixture(scope="module")
def boxes():
    return Boxes(np.random.default_rng(4))


@pytest.fixture(scope="module")
def enclosed(functions, boxes):
    given = {
        "leaf_nodes": NODES,
        "leaf_transform": TO_POWERS,
        "leaf_sums": SUMS,
        "leaf_chebyshev": TO_CHEBYSHEV,
        "leaf_errors": boxes.errors,
        "grid_errors": boxes.grid,
        "polynomials": boxes.coefficients,
        "axes": np.array(AXES),
        "box_sizes": np.array(BOXES),
        "tails": TAILS,
        "memory": np.zeros(COUNT * 4 * 27),
    }
    found = {}
    for enclosing, groups in (("false", FOUND[:2]), ("true", FOUND[2:])):
        analytic = f"export static const bool analytic = true; export static const bool enclosing = {enclosing};"
        kernel = functions("iso_enclose", analytic)
        for group in parted(kernel(boxes.rows(), width_of(groups), **given), groups):
            found |= group
    found["values"] = found["values"].reshape(COUNT, LEAVES, DISC)
    found["gradients"] = found["gradients"].reshape(COUNT, LEAVES, 3, DISC)
    found["inverse"] = found["inverse"].reshape(COUNT, 3, 3)
    return found


def lagrange(z):
    """Values and derivatives (..., 3) of the polynomials that are 1 at one of the nodes."""
    others = [np.delete(NODES, i) for i in range(3)]
    scale = np.array([np.prod(NODES[i] - other) for i, other in enumerate(others)])
    values = np.stack([np.prod([z - x for x in other], axis=0) for other in others], axis=-1) / scale
    return values, np.stack([2 * z - other.sum() for other in others], axis=-1) / scale


def weights_of(c, reach):
    """Growth (n,), bounds (n, 3) of Lagrange's polynomials and of their derivatives within a reach of places."""
    c = np.abs(c)
    a = np.where(c * (c + reach) <= 1, np.sqrt(1 + reach**2 / (1 - np.minimum(c, 0.999) ** 2)), c + reach)
    ratio = a + np.sqrt(a * a - 1)
    values, slopes = lagrange(c)
    once, twice = 4 * np.sqrt(2), 4 * np.sqrt(2)
    first = np.minimum(np.abs(values) + (reach * ratio * once)[:, None], (ratio**2 * np.sqrt(2))[:, None])
    second = np.minimum(np.abs(slopes) + (reach * ratio * twice)[:, None], (ratio * once)[:, None])
    return ratio**2, first, second


def test_lagrange_polynomials_are_within_their_weights_around_places(boxes, enclosed):
    c, reach = boxes.centre[:, 0], AXES[1] * boxes.half[:, 0]
    angle = np.linspace(0, 2 * np.pi, 81)
    around = c[:, None] + reach[:, None] * np.exp(1j * angle)
    values, slopes = lagrange(around)
    found = enclosed["weights"].reshape(COUNT, 3, 2)
    assert (np.abs(values).max(axis=1) <= found[..., 0] * (1 + 1e-12)).all()
    assert (np.abs(slopes).max(axis=1) <= found[..., 1] * (1 + 1e-12)).all()
    grown = np.abs(2 * around**2 - 1).max(axis=1) / enclosed["growth"]
    assert grown.max() <= 1
    assert grown.max() > 0.5

    # closely for small reaches; nodes are symmetric, so that places of both signs have the same weights
    expected = weights_of(c, reach)
    assert enclosed["growth"] == pytest.approx(expected[0], rel=1e-12, abs=0)
    assert found[..., 0] == pytest.approx(expected[1], rel=1e-12, abs=0)
    assert found[..., 1] == pytest.approx(expected[2], rel=1e-12, abs=0)


def carried_of(boxes):
    """Amplification (n,) of errors of values, growth (n,), and amplification (n, 3) of errors of derivatives."""
    growth, values, slopes = zip(
        *(weights_of(boxes.centre[:, k], AXES[1] * boxes.half[:, k]) for k in range(3)), strict=True
    )
    nodes = NODES[POWERS]
    margin = np.minimum(1 + nodes.min(axis=1), -1 - nodes.sum(axis=1))
    outside = (1 - np.minimum(margin, 0)) ** 2
    lines = [[slopes[k] if k == axis else values[k] for k in range(3)] for axis in (None, 0, 1, 2)]
    found = [np.prod([each[:, POWERS[:, k]] for k, each in enumerate(line)], axis=0) @ outside for line in lines]
    return found[0], np.prod(growth, axis=0), np.stack(found[1:], axis=1)


def test_errors_of_series_over_elements_are_carried_to_sub_elements(boxes, enclosed):
    value, grown, slopes = carried_of(boxes)
    assert enclosed["value"] == pytest.approx(value, rel=1e-12, abs=0)
    assert enclosed["grown"] == pytest.approx(grown, rel=1e-12, abs=0)
    assert enclosed["slopes"] == pytest.approx(slopes, rel=1e-12, abs=0)
    places = [value * boxes.errors[:, :3].T + grown * boxes.grid[:, :3, 0].T, boxes.grid[:, :3, 1].T]
    assert enclosed["places"] == pytest.approx(
        np.stack([each.sum(axis=0) for each in places], axis=1), rel=1e-12, abs=0
    )
    assert enclosed["grid_places"] == pytest.approx(enclosed["places"], rel=1e-12, abs=0)


def check_discs(discs, values, s, axis):
    """Discs (n, ..., 7) hold values (n, p, ...) at points s, relative to the long half axis; returns parts of radii."""
    middle, radius, rest, slope = discs[..., 0], discs[..., 1], discs[..., 2], discs[..., 4:]
    away = np.abs(values - middle[:, None])
    assert (away <= radius[:, None] * (1 + 1e-9) + 1e-13).all()
    linear = np.einsum("n...k,npk->np...", slope, s / axis[:, None, None])
    assert (np.abs(values - middle[:, None] - linear) <= rest[:, None] * (1 + 1e-9) + 1e-13).all()
    return away.max(axis=1) / radius


def test_leaves_lie_within_their_discs_on_ellipses_and_reach_their_ends(boxes, enclosed):
    """Fields and positions, and the derivatives of fields and of X, whose map is the identity at the middle."""
    axis = np.array(AXES)[boxes.e]
    s = on_ellipses(np.random.default_rng(5), axis)
    jets = boxes.jets(s)
    part = check_discs(enclosed["values"], jets[..., 0], s, axis)
    assert part.max() > 0.9
    turned = np.einsum("nij,npjk->npik", enclosed["inverse"], jets[:, :, :3, 1:])
    slopes = np.concatenate([turned, jets[:, :, 3:, 1:]], axis=2)
    assert check_discs(enclosed["gradients"], slopes, s, axis)[:, 3:].max() > 0.8
    middle = boxes.jets(np.zeros((COUNT, 1, 3)))[:, 0]
    assert enclosed["values"][:, 3:, 4:] == pytest.approx(axis[:, None, None] * middle[:, 3:, 1:], rel=1e-9, abs=1e-13)
    assert enclosed["inverse"] @ middle[:, :3, 1:] == pytest.approx(np.tile(np.eye(3), (COUNT, 1, 1)), abs=1e-11)


def outside_of(boxes, extent):
    corners = boxes.centre[:, None] + np.array(list(product([-1, 1], repeat=3))) * extent[:, None]
    margin = np.minimum(1 + corners.min(axis=2), -1 - corners.sum(axis=2)).min(axis=1)
    return (np.abs(corners).max(axis=1).clip(1).prod(axis=1) * (1 - np.minimum(margin, 0))) ** 2


def radii_of(boxes, axis):
    """(n, 5) radii on ellipses through ``axis`` (n,), with the errors of values in each coefficient."""
    side = np.maximum(boxes.half, 0.5)
    share = boxes.half / side
    lattice = np.stack(np.broadcast_arrays(*(NODES[POWERS[:, k]] for k in range(3))), axis=-1)
    values = boxes.jets(np.broadcast_to(lattice / share[:, None], (COUNT, 27, 3)))[..., 0]
    matrix = np.prod([TO_POWERS[POWERS[:, None, k], POWERS[None, :, k]] for k in range(3)], axis=0)
    terms = np.einsum("ij,njl->nil", matrix, values)
    off = 3 * 11 * UNIT * np.abs(values).max(axis=1) + outside_of(boxes, side)[:, None] * boxes.errors
    room = np.prod(SUMS[POWERS], axis=1)[:, None] * off[:, None]
    size = np.abs(terms) * (ORDER > 0)[:, None] + room
    reach = np.prod((axis[:, None] * share)[:, None] ** POWERS, axis=2)
    return np.einsum("nt,ntl->nl", reach, size)


def test_radii_of_leaves_have_the_errors_of_values_in_each_coefficient(boxes, enclosed):
    radius = radii_of(boxes, np.array(AXES)[boxes.e])
    assert enclosed["values"][..., 1] == pytest.approx(radius, rel=1e-9, abs=0)


def test_errors_of_leaves_have_those_of_values_and_derivatives(boxes, enclosed):
    """Of values in the element, of coefficients of its series, and of their sums."""
    value, grown, slopes = carried_of(boxes)
    direct = outside_of(boxes, 1.42 * boxes.half)[:, None] * boxes.errors
    coefficients = grown[:, None] * boxes.grid[..., 0]
    carried = value[:, None] * boxes.errors + coefficients
    of_values = np.stack([direct, carried, boxes.grid[..., 1]], axis=1)
    steep = slopes[:, None] * boxes.errors[..., None] + 9 * coefficients[..., None]
    steps = np.stack(np.broadcast_arrays(4 * direct[..., None], steep, 9 * boxes.grid[..., 1:]), axis=1)
    steps = steps * boxes.half[:, None, None]
    kind = np.arange(COUNT), boxes.kind
    assert enclosed["values"][..., 3] == pytest.approx(of_values[kind], rel=1e-12, abs=0)
    assert enclosed["gradients"][:, 3:, :, 3] == pytest.approx(steps[kind][:, 3:], rel=1e-7, abs=1e-13)
    turned = np.einsum("nij,njk->nik", np.abs(enclosed["inverse"]), steps[kind][:, :3])
    rounded = 16 * enclosed["skewness"] * UNIT
    assert enclosed["gradients"][:, :3, :, 3] == pytest.approx(turned + rounded[:, None, None], rel=1e-7, abs=1e-14)


def test_products_of_fields_are_enclosed_with_their_level(boxes, enclosed):
    for e, axis in enumerate(AXES):
        s = on_ellipses(np.random.default_rng(e), np.full(COUNT, axis))
        fields = boxes.jets(s)[:, :, 3:, 0]
        values = fields.prod(axis=2) - boxes.level[:, None]
        part = np.abs(values - enclosed["middle"][:, None]).max(axis=1) / enclosed["spread"][:, e]
        assert part.max() <= 1
        assert part.max() > 0.9
        # the product of discs with linear parts
        jets, radii = boxes.jets(np.zeros((COUNT, 1, 3)))[:, 0, 3:], radii_of(boxes, np.full(COUNT, axis))[:, 3:]
        middle, slope = jets[..., 0], axis * jets[..., 1:]
        rest = (radii - np.abs(slope).sum(axis=2)) * np.abs(middle[:, ::-1])
        linear = np.abs((middle[:, ::-1, None] * slope).sum(axis=1)).sum(axis=1) + rest.sum(axis=1) + radii.prod(axis=1)
        size, error = np.abs(middle) + radii, outside_of(boxes, 1.42 * boxes.half)[:, None] * boxes.errors[:, 3:]
        of_product = (size * error[:, ::-1]).sum(axis=1) + error.prod(axis=1)
        bound = linear * (1 + 1e-9) + of_product
        assert enclosed["spread"][:, e] == pytest.approx(bound, rel=1e-11, abs=0), e
        if e == 1:
            assert enclosed["error"] == pytest.approx(of_product, rel=1e-6, abs=1e-12)
    assert enclosed["radius"] == pytest.approx(enclosed["spread"][:, 0], rel=1e-12, abs=0)

    # errors of the product by those of coefficients, on the first ellipse, and of sums
    value, grown, _ = carried_of(boxes)
    coefficients = value[:, None] * boxes.errors + grown[:, None] * boxes.grid[..., 0]
    middle = np.abs(boxes.jets(np.zeros((COUNT, 1, 3)))[:, 0, 3:, 0])
    for k, error in enumerate((coefficients[:, 3:], boxes.grid[:, 3:, 1])):
        size = middle + radii_of(boxes, np.full(COUNT, AXES[1 - k]))[:, 3:]
        of_product = (size * error[:, ::-1]).sum(axis=1) + error.prod(axis=1)
        assert enclosed["grid_values"][:, k] == pytest.approx(of_product, rel=1e-9, abs=0)
    assert np.array_equal(
        enclosed["avoids"] > 0, (np.abs(enclosed["middle"]) > enclosed["radius"]) | (enclosed["spurious"] > 0)
    )
    assert 0 < enclosed["avoids"].sum() < COUNT
    assert 0 < enclosed["spurious"].sum() < COUNT
    # the second field says where nothing is to be shown, by more than it is off
    second = boxes.jets(np.broadcast_to(ENDS, (COUNT, 27, 3)))[:, :, 4, 0]
    assert (second.min(axis=1)[enclosed["spurious"] > 0] > 0).all()
    unclear = (enclosed["spurious"] == 0) & (enclosed["doubtful"] == 0)
    assert (second.max(axis=1)[unclear] < 0).all()
    assert enclosed["doubtful"].any()


def test_misfits_are_those_of_the_best_ellipse_on_the_next_larger_box(boxes, enclosed):
    known, boxes_at = TAILS, np.searchsorted(BOXES, boxes.c)
    bounds = enclosed["spread"][:, 1:, None] * known[1:, boxes_at].transpose(1, 0, 2)
    best = np.argmin(np.where(np.isfinite(bounds[..., 2]), bounds[..., 2], np.inf), axis=1)
    assert enclosed["misfit"] == pytest.approx(bounds[np.arange(COUNT), best], rel=1e-12, abs=0)
    assert enclosed["steepness"] == pytest.approx(1 / (AXES[1] - boxes.c), rel=1e-12, abs=0)
    own = enclosed["spread"][:, 1:, None] * known[1:, 0]
    first = own[np.arange(COUNT), np.argmin(own[..., 2], axis=1), 1]
    part = first / enclosed["radius"]
    assert np.array_equal(enclosed["hopeless"] > 0, ~(part <= 2e-3))
    assert part[part <= 2e-3].max() > 1e-3
    assert part.max() > 2e-3
    assert enclosed["smooth"].all()


SERIES = {"radius": 1, "error": 1, "summed": 1, "places": 1, "reach": 1, "misfit": 4, "is_small": 1, "smooth": 1}


def test_series_of_boxes_hold_as_far_as_their_boxes_reach(functions):
    """Derivatives along a sub-element's sides are smaller than along those of its box, in proportion to its longest."""
    rng = np.random.default_rng(9)
    box_centre, box_half = rng.uniform(-0.5, 0.5, (COUNT, 3)), rng.uniform(0.2, 0.4, (COUNT, 1))
    share = rng.uniform(0.05, 0.9, (COUNT, 3))
    centre, half = box_centre + rng.uniform(-0.8, 0.8, (COUNT, 3)) * box_half, share * box_half
    misfit, numbers = rng.uniform(0.5, 1.0, (COUNT, 3)), rng.uniform(0.5, 1.0, (COUNT, 3))
    models = np.concatenate([box_centre, box_half, misfit, numbers, np.zeros((COUNT, 7))], axis=1)
    # the larger of two parts, relative to what the limit allows of it; one of each pair is just too large
    part = share.max(axis=1)
    value, first = misfit[:, 0], part * misfit[:, 1]
    is_by_value, is_small = np.arange(COUNT) % 4 < 2, np.arange(COUNT) % 2 == 0
    pixels = np.where(is_by_value, 1.5, 0.5) * first / value
    largest = np.where(is_by_value, pixels * value, first)
    extent = np.where(is_small, 1.01, 0.99) * 1000 * largest
    within = np.where(np.arange(COUNT) % 8 == 7, 1.01, 0.99)
    exports = "export static const bool in_boxes = true; export static const bool analytic = true;"
    rows = np.concatenate([centre, half, np.stack([pixels, extent, within], axis=1)], axis=1)
    kernel = functions("iso_enclose", exports)
    (found,) = parted(kernel(rows, width_of([SERIES]), box_models=models), [SERIES])

    assert (found["radius"] >= 1e300).all()
    assert np.array_equal(np.stack([found["error"], found["summed"], found["places"]], axis=1), numbers)
    ends = (np.abs(centre - box_centre) + found["reach"][:, None] * half).max(axis=1)
    assert ends == pytest.approx(1.12 * box_half[:, 0], rel=1e-14)
    second = part**2 * misfit[:, 2]
    expected = np.where((within < 1)[:, None], np.stack([value, first, second, second], axis=1), np.inf)
    assert found["misfit"] == pytest.approx(expected, rel=1e-14)
    assert np.array_equal(found["is_small"] > 0, is_small & (within < 1))
    assert np.array_equal(found["smooth"] > 0, found["reach"] >= 1)
    assert {0, 1} == set(found["smooth"])


@pytest.mark.parametrize("degree", [2, 5])
def test_tails_are_twice_the_terms_beyond_the_degree(degree):
    """Of all products of three lines' terms those with one of them, by their bounds on a box, nearly attained."""
    for e, b in ((2, 0), (4, 3), (6, 8)):
        ratio = AXES[e] + np.sqrt(AXES[e] ** 2 - 1)
        terms = np.zeros((3, 120))
        for k in range(120):
            line = np.eye(120)[k] * (1 if k == 0 else 2) * ratio**-k
            terms[:, k] = [chebyshev.chebval(BOXES[b], chebyshev.chebder(line, m)) for m in range(3)]
        both = terms.sum(axis=1), terms[:, : degree + 1].sum(axis=1)
        sums = [[*own[0] ** 2 * own, own[0] * own[1] ** 2] for own in both]
        beyond = 2 * np.subtract(*sums)
        share = tails(degree)[e, b] / beyond
        assert (share >= 1).all()
        assert share.max() < 1.5


HELD = [
    {"known": 1, "slope": 3, "room": 3, "held": 1, "noise": 1},
    {"gradient": 9, "level": 3, "reach": 2, "coordinates": 9, "distance": 3},
    {"outcome": 1, "extent": 1, "far_held": 1, "far_noise": 1, "depth": 1, "near": 1, "miss": 2, "worth": 3},
]


class Held:
    """Boxes of a product of fields plus 0.7 of a distance, and a linear map whose positions are wrong."""

    def __init__(self, rng, boxes):
        self.extent, self.away = rng.uniform(1.05, 1.3, COUNT), rng.uniform(-1, 1, (COUNT, 3))
        self.misplaced, self.errors = rng.choice([1e-3, 1e-12, 0.0], COUNT), boxes.errors.copy()
        self.errors[::2] *= rng.choice([1e-1, 1e-2, 1e-3], (COUNT // 2, 1))
        self.across = rng.uniform(1, 2, COUNT)
        self.inverse = np.linalg.inv(0.3 * (3 * np.eye(3) + rng.uniform(-1, 1, (COUNT, 3, 3))))
        # too large by a part, or too small; then parts that are too wide, and that aren't divided any more
        self.share, self.last = np.where(np.arange(COUNT) % 4 > 1, 1.01, 0.99), (np.arange(COUNT) % 8 > 5).astype(float)
        self.scale = np.where(np.arange(COUNT) % 16 == 13, 100.0, 1.0)
        self.smaller = np.where(np.arange(COUNT) % 16 == 9, 1e-13, 1.0)
        self.limit = self.largest(boxes)
        self.columns = np.linalg.inv(self.inverse)
        self.columns[:, 0] *= self.scale[:, None]

    def largest(self, boxes):
        """By how much positions may be wrong: room of 0.002 in steps, and twice their own error, holds them."""
        places = np.stack([2 * self.across / self.scale, 2 * self.across, np.ones(COUNT)], axis=1)
        steps = np.einsum("nij,nj->ni", np.abs(self.inverse), places).max(axis=1)
        amplified = (1 + 0.637 * np.log(np.float32(3))) ** 3 * outside_of(boxes, boxes.half * self.smaller[:, None])
        off = np.zeros(COUNT)
        for _ in range(50):
            grown = (2 * (1.002 + 2 * off) ** 2 - 1) ** 3
            off = 0.002 / (grown * amplified - 2)
        return off / steps

    def rows(self, boxes):
        alone = [self.extent[:, None], self.away, boxes.level[:, None], self.misplaced[:, None]]
        last = [self.extent + 4e-3, self.across, self.share * self.limit, self.last, self.smaller]
        columns = [boxes.centre, boxes.half, *alone, np.stack(last, axis=1), self.values().reshape(COUNT, -1)]
        return np.concatenate(columns, axis=1)

    def values(self):
        """u, v, z and 0 at the nodes of linear maps."""
        nodes = np.stack(np.broadcast_arrays(*(NODES[POWERS[:, k]] for k in range(3))), axis=-1)
        return np.concatenate([np.einsum("nij,tj->nti", self.columns, nodes), np.zeros((COUNT, 27, 1))], axis=2)


@pytest.fixture(scope="module")
def held(boxes):
    return Held(np.random.default_rng(8), boxes)


@pytest.fixture(scope="module")
def slopes(functions, boxes, held):
    given = {
        "leaf_nodes": NODES,
        "leaf_transform": TO_POWERS,
        "leaf_sums": SUMS,
        "leaf_errors": held.errors,
        "polynomials": boxes.coefficients,
        "axes": np.array(AXES),
        "transform": TO_CHEBYSHEV,
        "grid": np.zeros(COUNT * 4 * 27),
    }
    exports = "export static const bool analytic = true; export static const bool leaf_distances = true;"
    kernel = functions("iso_held", exports)
    found = {}
    for group in parted(kernel(held.rows(boxes), width_of(HELD), **given), HELD):
        found |= group
    return found


def test_slopes_with_held_distances_hold_on_boxes_that_are_slightly_larger(boxes, held, slopes):
    s = (held.extent + 4e-3)[:, None, None] * ENDS
    jets = boxes.jets(s)
    fields = jets[:, :, 3:]
    along = fields[..., 0, 1:] * fields[..., 1, :1] + fields[..., 0, :1] * fields[..., 1, 1:]
    gradient = np.linalg.solve(jets[:, :, :3, 1:].swapaxes(2, 3), along[..., None])[..., 0]
    known = slopes["known"] > 0
    assert 10 < known.sum() < COUNT
    part = np.abs(gradient - slopes["slope"][:, None]).max(axis=1) / slopes["room"]
    assert part[known].max() <= 1
    assert part[known].max() > 0.4

    discs = slopes["gradient"].reshape(COUNT, 3, 3)
    assert slopes["slope"][known] == pytest.approx(discs[known, :, 0], rel=1e-13, abs=0)
    assert slopes["room"][known] == pytest.approx(discs[known, :, 1:].sum(axis=2), rel=1e-11, abs=0)
    assert (discs[known, :, 2] > 0.01 * discs[known, :, 1]).any()


def test_noise_counts_positions_that_move_along_slopes_and_distances(boxes, held, slopes):
    known = slopes["known"] > 0
    coordinates = slopes["coordinates"].reshape(COUNT, 3, 3)
    radius, error = coordinates[..., 1], coordinates[..., 2]
    reach = np.stack([np.linalg.norm(radius + error, axis=1), np.linalg.norm(error, axis=1)], axis=1)
    assert slopes["reach"] == pytest.approx(reach, rel=1e-12, abs=0)
    assert (slopes["reach"] >= reach * (1 + 5e-15)).all()
    assert slopes["distance"][:, 0] == pytest.approx(held.away[:, 1], rel=1e-15, abs=0)
    assert slopes["distance"][:, 1:] == pytest.approx(reach + 0.1, rel=1e-12, abs=0)

    steepest = (np.abs(slopes["slope"]) + slopes["room"]).sum(axis=1) + 0.7
    assert slopes["held"] == pytest.approx(0.7, rel=1e-15)
    places = (held.misplaced + 1e-13 * reach[:, 0]) * steepest
    assert slopes["noise"][known] == pytest.approx((slopes["level"][:, 2] + places)[known], rel=1e-10, abs=0)
    assert (places > 1e-3 * slopes["level"][:, 2])[known & (held.misplaced == 0)].any()


def test_rays_through_held_parts_are_followed_unless_positions_are_off_by_more_than_the_room(held, slopes):
    """A part is drawn, or divided if it is wide or not straight, down to sizes at which division ends."""
    straight, known = held.share < 1, np.isfinite(slopes["far_noise"])
    assert known[straight & (slopes["known"] > 0)].all()
    clear = straight & known & (held.scale == 1)
    size = 2 * np.abs(held.columns).sum(axis=2)
    small = (size[:, :2].max(axis=1) < 1) | (held.smaller < 1) | (held.last > 0)
    expected = np.where(clear, 1, np.where(small, 2, 0))
    assert np.array_equal(slopes["outcome"], expected)
    assert {0, 1, 2} == set(expected)
    lengths = np.linalg.norm(held.columns / np.stack([held.across] * 2 + [np.ones(COUNT)], axis=1)[..., None], axis=1)
    assert slopes["worth"][straight] == pytest.approx(lengths[straight], rel=1e-12, abs=0)
    assert (slopes["worth"][~straight] < 1e-9).all()
    assert np.isinf(slopes["far_held"][~straight]).all()
    assert np.isinf(slopes["far_noise"][~straight]).all()
    assert slopes["depth"] == pytest.approx(20, abs=1e-12)
    assert slopes["near"] == pytest.approx(20 - np.abs(held.columns[:, 2]).sum(axis=1), rel=1e-12)
    assert slopes["miss"] == pytest.approx(0, abs=1e-12)
