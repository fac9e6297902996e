"""Bounds of differences of two datasets: values lie within them, and some come near their ends (claims.py)."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from claims import TEETH, check

from elvis.core.bounds.extrema import Extremum
from elvis.core.differences import bent_pairs, compositions, convergence, difference, greatest, overlaps, prepared
from elvis.core.differences.compositions import Composition, PairBoxes, _crossing, _field_roundings, growth
from elvis.core.mapping.margins import heights
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.bernstein import (
    BernsteinSpace,
    bernstein_coefficients,
    bernstein_space,
    bernstein_values,
)
from elvis.core.polynomials.boxnets import all_halves, on_lattice, parts_of_boxes
from elvis.core.polynomials.rounding import box_roundings, halving_roundings, value_roundings
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field

COUNT = 40
#: unit roundoff of the model
COARSE = 2.0**-11
SPACES = {
    Shape.TRIANGLE: (3,),
    Shape.QUADRILATERAL: (2, 3),
    Shape.TETRAHEDRON: (2,),
    Shape.PRISM: (2, 1),
    Shape.HEXAHEDRON: (1, 2, 1),
}


def gamma(roundings):
    return roundings * COARSE / (1 - roundings * COARSE)


@pytest.fixture
def coarse(monkeypatch):
    monkeypatch.setattr(compositions, "gamma", gamma)
    monkeypatch.setattr(compositions, "UNIT", COARSE)


def pair(rng, shape=Shape.TRIANGLE, size=1.0, degree=2):
    """A composition of random data of order one, and boxes with errors of a tenth of ``size``."""
    d = shape.dimension
    space = BernsteinSpace(shape, SPACES[shape])
    matrix = rng.uniform(-1, 1, (COUNT, d, d))
    affine = SimpleNamespace(
        matrix=matrix, origin=np.zeros((COUNT, d)), error=0.1 * size * rng.uniform(0, 1, (COUNT, d))
    )
    inner = SimpleNamespace(
        affine=affine,
        space=space,
        patch=SimpleNamespace(shape=shape),
        total=sum(space.degrees),
        net=rng.uniform(-1, 1, (COUNT, space.count)),
        slopes=rng.uniform(0.1, 1, (COUNT, d)),
        error=0.1 * size * rng.uniform(0, 1, COUNT),
    )
    nets = rng.uniform(-1, 1, (COUNT, d, *(degree + 1,) * d))
    outer = SimpleNamespace(patch=SimpleNamespace(dimension=d), places=nets, degree=degree)
    errors = 0.1 * size * rng.uniform(0.1, 1, (COUNT, d)), 0.1 * size * rng.uniform(0.1, 1, COUNT)
    rows = np.arange(COUNT)
    boxes = PairBoxes(
        rows, rows[::-1].copy(), nets, errors[0], rng.uniform(-1, 1, (COUNT, *(degree + 1,) * d)), errors[1]
    )
    return Composition(outer, inner), boxes


def signs(d):
    return np.array(list(product([-1.0, 1.0], repeat=d)))


def places_on_other_elements(rng):
    """Coordinates at the corners of their errors, each mapped by the other element's matrix, which is off too."""
    for shape in (Shape.TRIANGLE, Shape.TETRAHEDRON):
        composition, boxes = pair(rng, shape)
        matrix = composition._inner.affine.matrix[boxes.others]
        off = np.einsum("sd,nd,ndk->snk", signs(shape.dimension), boxes.place_error, matrix)
        yield np.abs(off).max(axis=0) + composition._inner.affine.error[boxes.others], composition._off(boxes)


def differences_at_inexact_places(rng):
    """Both fields are off by their errors, the inner one by its slopes times those of places, too."""
    for shape in (Shape.TRIANGLE, Shape.TETRAHEDRON):
        composition, boxes = pair(rng, shape, 1e-3)
        inner, off = composition._inner, composition._off(boxes)
        moved = np.einsum("sd,nd,nd->sn", signs(shape.dimension), off, inner.slopes[boxes.others]).max(axis=0)
        yield boxes.own_error + inner.error[boxes.others] + moved, composition._slack_of_places(boxes)


def heights_over_facets(rng):
    """Of computed places of the other element, moved by what they may be off: by rounding alone, by errors alone."""
    for shape, (size, unit) in product(SPACES, ((1.0, 0.0), (0.0, COARSE))):
        composition, boxes = pair(rng, shape, size)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(compositions, "gamma", lambda roundings, own=unit: roundings * own)
            off = composition._shift(boxes) + composition._off(boxes)
            found = composition._heights(boxes)
        own = heights(shape, composition._reference(boxes))
        for sign in signs(shape.dimension):
            step = (sign * off).reshape(COUNT, *(1,) * shape.dimension, -1)
            moved = heights(shape, own_places(composition, boxes) + step)
            yield (moved - own).reshape(COUNT, -1), (found - own).reshape(COUNT, -1)


def own_places(composition, boxes):
    """Nets (n, …, d) of xi."""
    return np.einsum("nd...,ndk->n...k", boxes.places, composition._inner.affine.matrix[boxes.others])


def magnitudes_of_functions(rng):
    """The sum of the magnitudes of all Bernstein functions far outside of an element, and in it."""
    for shape, degrees in SPACES.items():
        space = BernsteinSpace(shape, degrees)
        for far in (1.0, 4.0):
            xi = rng.uniform(-far, far, (COUNT, 3, shape.dimension))
            values = np.abs(bernstein_values(space, xi.reshape(-1, shape.dimension))).sum(axis=1).reshape(COUNT, 3)
            yield values.max(axis=1), growth(space, xi)


def nets_through_wrong_values(rng):
    """Polynomials whose values at the lattice are off, and nets of a lower degree, at worst places between those."""
    for shape, degree in ((Shape.QUADRILATERAL, 3), (Shape.TRIANGLE, 4)):
        composition, boxes = pair(rng, shape, 0.0, degree)
        composition._inner.total = 2
        composition._inner.space = BernsteinSpace(shape, (1,) * len(SPACES[shape]))
        composition = Composition(composition._outer, composition._inner)
        count, off = composition.degree + 1, 0.25
        fine = np.linspace(0, 1, 33)
        # where sums of the magnitudes of Lagrange's functions are largest, all terms have one sign
        lagrange = np.linalg.solve(np.vander(composition.line, count).T, np.vander(fine, count).T).T
        worst = np.sign(lagrange[np.abs(lagrange).sum(axis=1).argmax()])
        exact = rng.uniform(-1, 1, (COUNT, count, count))
        computed = exact + off * worst[:, None] * worst
        composition.values = lambda _, own=computed: own.reshape(COUNT, -1)
        composition.rounding_of_values = lambda boxes, own=off: np.full(len(boxes), own)
        for allowed in (0.0, np.inf):
            for held, own in composition.compose(boxes, allowed):
                assert own.nets.shape[1] == (count if allowed == 0 else degree + 1)
                truth = lagrange @ exact[held.rows] @ lagrange.T
                away = np.abs(truth - on_lattice(own.nets, fine)).max(axis=(1, 2))
                yield away - boxes.own_error[held.rows], own.slack
                yield np.abs(truth).max(axis=(1, 2)), own.limit


def differences_whose_values_seem_to_be_zero(rng):
    """At the lattice alone: what rounding hides grows between its points."""
    composition, boxes = pair(rng, Shape.QUADRILATERAL, 0.0, 3)
    count, off, fine = composition.degree + 1, 0.25, np.linspace(0, 1, 33)
    lagrange = np.linalg.solve(np.vander(composition.line, count).T, np.vander(fine, count).T).T
    worst = np.sign(lagrange[np.abs(lagrange).sum(axis=1).argmax()])
    composition.values = lambda boxes: np.zeros((len(boxes), count**2))
    composition.rounding_of_values = lambda boxes: np.full(len(boxes), off)
    truth = np.abs(lagrange @ (off * worst[:, None] * worst) @ lagrange.T).max()
    ((_, own),) = composition.compose(boxes)
    yield np.full(COUNT, truth), own.limit
    yield np.full(COUNT, truth), own.slack


def places_where_polynomials_may_be_positive(rng):
    """Linear ones are negative up to their zero, others at least as far."""
    for count in (2, 3, 5):
        upper = rng.uniform(-1, 1, (COUNT, count, 2))
        found = _crossing(upper)
        fine = np.linspace(0, 1, 201)
        for f in range(2):
            values = on_lattice(upper[:, :, f], fine)
            first = np.where((values >= 0).any(axis=1), fine[(values >= 0).argmax(axis=1)], 2.0)
            yield found[:, f] + 1e-3, first + 1e-3
        if count == 2:
            low, high = upper[:, 0], upper[:, 1]
            zero = np.where(low >= 0, 0.0, np.where(high < 0, 2.0, low / (low - high)))
            assert np.abs(found - zero).max() < 1e-12
    assert _crossing(np.array([[[0.0], [-1.0], [-1.0]]])).item() == 0.0


CLAIMS = [
    places_on_other_elements,
    differences_at_inexact_places,
    heights_over_facets,
    magnitudes_of_functions,
    nets_through_wrong_values,
    differences_whose_values_seem_to_be_zero,
    places_where_polynomials_may_be_positive,
]


#: heights change by half of what reference coordinates do
WIDE = {heights_over_facets: 0.49}


@pytest.mark.parametrize("claim", CLAIMS)
def test_values_lie_within_bounds_and_some_near_their_ends(claim):
    check(claim, WIDE.get(claim, TEETH))


@pytest.mark.parametrize("shape", SPACES)
def test_all_roundings_of_values_are_counted(coarse, shape):
    """All away from zero: of the first field, of the second, and of the places that it is taken at."""
    rng = np.random.default_rng(4)
    composition, boxes = pair(rng, shape, 1e-6)
    inner, d = composition._inner, shape.dimension
    inner.slopes, grown = 0 * inner.slopes, compositions._MORE * composition.growth(boxes)
    inner.total = 0
    net, own = inner.net, boxes.own
    field, size = np.abs(net[boxes.others]).max(axis=1), np.abs(own).reshape(COUNT, -1).max(axis=1)

    def bound(net, own, slopes=0.0):
        inner.net, inner.slopes = net, np.full((COUNT, d), slopes)
        return composition.rounding_of_values(
            PairBoxes(*[boxes.rows, boxes.others], boxes.places, boxes.place_error, own, None)
        )

    # each value is rounded, and the difference of both
    first = size * ((1 + COARSE) ** (value_roundings(own.shape[1:]) + 1) - 1)
    second = field * grown * ((1 + COARSE) ** (_field_roundings(inner.space) + 1) - 1)
    shift = composition._shift(boxes)
    for found, exact in (
        (bound(0 * net, own), first),
        (bound(net, 0 * own), second),
        (bound(0 * net, 0 * own, 1.0), grown * shift.sum(axis=1)),
        (bound(net, own, 1.0), first + second + grown * shift.sum(axis=1)),
    ):
        assert (exact <= found * (1 + 1e-12)).all()
        assert (found <= 1.2 * exact).all()
    # sums of d products of coordinates with a matrix, and the sum with 1, next to which coordinates are large
    boxes = replace(boxes, places=100 * boxes.places)
    shift = composition._shift(boxes)
    reach = np.einsum(
        "nd,ndk->nk", np.abs(boxes.places).reshape(COUNT, d, -1).max(axis=2), np.abs(inner.affine.matrix[boxes.others])
    )
    away = reach * ((1 + COARSE) ** (value_roundings(own.shape[1:]) + d) - 1) + COARSE * (1 + reach)
    assert (away <= shift).all()
    assert (shift <= 8 * away + 8 * COARSE * value_roundings(own.shape[1:])).all()


def test_rounding_of_fields_covers_powers_products_and_sums():
    """b = multinomial * product of powers: on triangles of t1, t2 and 1 - t1 - t2, which three roundings make."""
    triangle, line = BernsteinSpace(Shape.TRIANGLE, (3,)), BernsteinSpace(Shape.SEGMENT, (2,))
    power = compositions.POWER + 2
    assert _field_roundings(triangle) == triangle.count + 3 * 4 + 3 * power + 1
    assert _field_roundings(line) == line.count + 2 * 3 + 2 * power + 1
    prism = BernsteinSpace(Shape.PRISM, (3, 2))
    assert _field_roundings(prism) == prism.count + 3 * 4 + 3 * power + 1 + 2 * 3 + 2 * power + 1


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.HEXAHEDRON])
def test_halving_and_cutting_add_their_roundings(coarse, shape):
    """Coefficients of one size, each product and sum rounded away from zero."""
    composition, boxes = pair(np.random.default_rng(1), shape)
    del composition
    d = shape.dimension
    sizes = np.abs(boxes.places).reshape(COUNT, d, -1).max(axis=2), np.abs(boxes.own).reshape(COUNT, -1).max(axis=1)
    halved = boxes.halved()
    count = halving_roundings(boxes.own.shape[1:])
    for found, old, size in (
        (halved.place_error, boxes.place_error, sizes[0]),
        (halved.own_error, boxes.own_error, sizes[1]),
    ):
        added = found.reshape(2**d, *old.shape) - old
        assert (added >= size * ((1 + COARSE) ** count - 1)).all()
        assert (added <= 2 * size * ((1 + COARSE) ** count - 1)).all()
    assert np.array_equal(halved.own, all_halves(boxes.own))
    low, high = np.full(COUNT, 2), np.full(COUNT, 7)
    cut = boxes.cut(1, low, high)
    once = (1 + COARSE) ** boxes.own.shape[2] - 1
    for found, old, size in (
        (cut.place_error, boxes.place_error, sizes[0]),
        (cut.own_error, boxes.own_error, sizes[1]),
    ):
        assert (found - old >= size * once).all()
        assert (found - old <= 2 * size * once).all()
    assert np.array_equal(cut.own, parts_of_boxes(boxes.own, 1, low, high))


@pytest.mark.parametrize("part", [0.99, 1.01])
def test_distant_points_give_no_bound(part):
    """Gradients and growth change by 1 % where xi is off by a thousandth over the degree, in one direction."""
    composition, boxes = pair(np.random.default_rng(2), Shape.TRIANGLE, 0.0)
    limit = compositions._FAR / composition._inner.total
    far = np.zeros((COUNT, 2))
    far[:, 1] = part * limit
    composition._off = composition._shift = lambda boxes: far
    for bound in (composition._slack_of_places, composition.rounding_of_values):
        assert (np.isfinite(bound(boxes)) == (part < 1)).all()


def test_rounding_of_places_from_the_origin_is_counted(coarse):
    """The difference of two coordinates is rounded once."""
    composition, boxes = pair(np.random.default_rng(2))
    outer, inner = composition._outer, composition._inner
    inner.affine.origin = np.full((COUNT, 2), 3.0)
    outer.place_error, outer.box, outer.box_error = boxes.place_error, boxes.own, boxes.own_error
    whole = composition.whole(boxes.rows, boxes.others)
    size = np.abs(outer.places - 3.0).reshape(COUNT, 2, -1).max(axis=2)
    assert np.allclose(whole.place_error - boxes.place_error, COARSE * size, rtol=1e-12)
    assert np.array_equal(whole.places, outer.places - 3.0)


def test_nets_of_a_lower_degree_have_the_rounding_of_their_values(monkeypatch):
    """These are compared at the lattice, where both are rounded, here so little that squares don't count."""
    unit = 2.0**-24
    monkeypatch.setattr(compositions, "gamma", lambda roundings: roundings * unit)
    composition, _ = pair(np.random.default_rng(2), Shape.QUADRILATERAL, 0.0, 3)
    nets, apart = composition._fitted(np.ones((COUNT, composition.count)), composition.degree)
    counted = (value_roundings(nets.shape[1:]) + 1) * unit
    assert (apart >= counted).all()
    assert (apart <= 1.02 * counted).all()


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_boxes_are_reduced_to_parts_that_may_meet_elements(shape):
    """Of linear maps: no point in the element is left out; what is left reaches an eighth of a box beyond it."""
    rng = np.random.default_rng(3)
    composition, boxes = pair(rng, shape, 0.0, 1)
    composition._inner.affine.matrix = np.tile(np.eye(2), (COUNT, 1, 1))
    ends = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], indexing="ij"))
    size, middle = rng.uniform(1.5, 4, (COUNT, 2, 1, 1)), rng.uniform(-2, 2, (COUNT, 2, 1, 1))
    boxes = replace(boxes, places=middle + size * ends)
    found = composition.clipped(boxes)
    low, high = np.full((2, COUNT, 2), np.nan)
    low[found.rows], high[found.rows] = found.places.min(axis=(2, 3)), found.places.max(axis=(2, 3))
    points = rng.uniform(-1, 1, (400, 2))
    points = np.concatenate([points[heights(shape, points).min(axis=1) >= 0], shape.vertices])
    is_met = np.zeros(COUNT, bool)
    for point in points:
        own = (np.abs(point - middle[..., 0, 0]) <= size[..., 0, 0]).all(axis=1)
        assert ((low[own] <= point + 1e-12) & (point <= high[own] + 1e-12)).all()
        is_met |= own
    assert is_met.sum() > 10
    if shape is Shape.QUADRILATERAL:
        room = size[..., 0, 0][is_met] / 4 + 1e-9
        assert (np.maximum(low, -1)[is_met] - low[is_met] <= room).all()
        assert (high[is_met] - np.minimum(high, 1)[is_met] <= room).all()


def test_nets_of_a_lower_degree_are_used_within_the_tolerance():
    composition, boxes = pair(np.random.default_rng(2), Shape.QUADRILATERAL, 0.0, 3)
    composition._inner.total = 2
    composition._inner.space = BernsteinSpace(Shape.QUADRILATERAL, (1, 1))
    composition._inner.net = composition._inner.net[:, :4]
    composition = Composition(composition._outer, composition._inner)
    one = boxes.part(np.zeros(1, int))
    ((_, low),) = composition.compose(one, np.inf)
    apart = float(low.slack[0] - composition.lebesgue * composition.rounding_of_values(one)[0])
    for part, degree in ((0.99, composition.degree), (1.01, 3)):
        ((_, own),) = composition.compose(one, part * apart)
        assert own.nets.shape[1] == degree + 1


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.PRISM])
def test_elements_are_prepared_with_all_roundings(monkeypatch, shape):
    """Of coefficients, of boxes, of coordinates; ranges of fields have room for the first."""
    monkeypatch.setattr(prepared, "gamma", gamma)
    monkeypatch.setattr(prepared, "coefficient_rounding", lambda expansion, modal: np.full(modal.shape[:-1], 0.5))
    data = with_field(curved(grid(shape, 1), lambda p: p, 3), lambda p: p[:, 0], 3)
    (side,) = prepared.sides(patches(data, ("u",)))
    d, maps = shape.dimension, bernstein_space(side.patch.geometry)
    points = bernstein_coefficients(side.patch.geometry, side.patch.geometry_coefficients[:, :d])
    for error, net, space in (
        (side.box_error, side.net, side.space),
        (side.place_error, points, maps),
    ):
        assert np.allclose(error, 0.5 + gamma(box_roundings(space)) * np.abs(net).max(axis=-1), rtol=1e-12)
        assert box_roundings(space) > space.count
    low, high = side.ranges()
    assert np.array_equal(low, side.net.min(axis=1) - 0.5)
    assert np.array_equal(high, side.net.max(axis=1) + 0.5)


@pytest.mark.parametrize(("greatest", "expected"), [(0.9, 0.0), (1.0, 0.0), (1.1, 7.0)])
def test_patches_are_compared_if_a_pair_may_exceed_the_difference_found(monkeypatch, greatest, expected):
    upper = np.array([0.5, greatest])
    monkeypatch.setattr(overlaps, "_apart", lambda *_: upper)
    monkeypatch.setattr(overlaps, "_roles", lambda one, two, rows, others: [(one, two, rows, others, [0, 1])])
    monkeypatch.setattr(overlaps, "_Pairs", lambda *_: SimpleNamespace(bound=lambda a, b, upper: 7.0))
    tree = SimpleNamespace(overlaps=lambda low, high: (np.arange(2), np.arange(2)))
    side = SimpleNamespace(boxes=np.zeros((2, 6)), tree=tree)
    assert overlaps._between(side, side, SimpleNamespace(best=SimpleNamespace(value=1.0))) == expected


@pytest.mark.parametrize("part", [0.99, 1.01])
def test_boxes_are_bisected_if_their_bound_exceeds_the_largest_difference(part):
    """By a ten-thousandth of it and four times their rounding; the others count with their bounds."""
    limit = 2.0 * (1 + part * overlaps._CLOSE) + part * 4 * 0.5
    noted = []
    pairs = overlaps._Pairs.__new__(overlaps._Pairs)
    pairs._search = SimpleNamespace(best=SimpleNamespace(value=2.0), budget=0)
    pairs._composition = SimpleNamespace(meet=lambda boxes: np.ones(3, bool))
    pairs._improve = lambda boxes, nets, slack: None
    pairs._note = lambda boxes, limit: noted.append(limit)
    boxes = SimpleNamespace(without_fields=lambda: boxes, part=lambda chosen: boxes)
    for slack, limits in ((0.5, [1.0, limit, 0.5]), (0.0, [1.0, 2.0 * (1 + part * overlaps._CLOSE), 0.5])):
        noted.clear()
        composed = SimpleNamespace(nets=np.ones((3, 2, 2)), limit=np.array(limits), slack=np.full(3, slack))
        assert pairs._halved(boxes, composed) == limits[1]
        assert len(noted) == (part > 1)


def test_bounds_of_bisected_pairs_include_the_rounding_of_halves(monkeypatch):
    """Of ones that are off by 0.5, and by four roundings more after a bisection of two by two numbers."""
    monkeypatch.setattr(overlaps, "_ROUNDS", 1)
    monkeypatch.setattr(overlaps, "gamma", lambda roundings: 0.025 * roundings)
    pairs = overlaps._Pairs.__new__(overlaps._Pairs)
    pairs._search = SimpleNamespace(best=SimpleNamespace(value=0.0), budget=1e9)
    pairs._composition = SimpleNamespace(meet=lambda boxes: np.ones(1, bool))
    pairs._improve = lambda boxes, nets, slack: None
    boxes = SimpleNamespace(places=np.zeros(1), halved=lambda: boxes, part=lambda chosen: boxes)
    boxes.without_fields = boxes.halved
    composed = SimpleNamespace(nets=np.ones((1, 2, 2)), limit=np.full(1, 9.0), slack=np.full(1, 0.5))
    assert pairs._halved(boxes, composed) == pytest.approx(1.6, rel=1e-14)


@pytest.mark.parametrize(("largest", "most"), [(1.00005, bent_pairs._MOST_PAIRS), (3.0, 0)])
def test_all_pairs_of_bent_elements_count_with_their_bounds(largest, most, monkeypatch):
    """Closed ones, differing by 1.00005 where 1 was found, and open ones if there are too many to bisect them."""
    monkeypatch.setattr(bent_pairs, "_MOST_PAIRS", most)
    places = np.tile(np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], indexing="ij")), (2, 1, 1, 1))
    values = np.array([largest, 1.5 if largest > 2 else 0.5])

    def side(constants):
        nets = np.broadcast_to(constants[:, None, None], (2, 2, 2))
        return SimpleNamespace(places=places, place_error=np.zeros((2, 2)), box=nets, box_error=np.zeros(2))

    bound, points = bent_pairs.bound_of_bent_pairs(side(values), side(0 * values), np.arange(2), np.arange(2), 1.0)
    assert points.shape[1] == 3
    assert values[0] <= bound <= values[0] * (1 + 1e-12)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_errors_of_inverse_maps_have_all_their_terms(monkeypatch, shape):
    """Places that are off, corners that aren't those of an affine map, and rounding away from zero."""
    rng, d = np.random.default_rng(5), shape.dimension
    index = np.stack(np.meshgrid(*[[-1.0, 1.0]] * d, indexing="ij"))
    matrix, origin = np.eye(d) + rng.uniform(-0.3, 0.3, (COUNT, d, d)), rng.uniform(-1, 1, (COUNT, d))
    straight = np.einsum("nij,j...->ni...", matrix, index) + origin.reshape(COUNT, d, *[1] * d)

    def corners(nets):
        return np.stack([nets[(slice(None), slice(None), *end)] for end in np.where(shape.vertices > 0, 1, 0)], axis=1)

    # errors of places alone, at their worst corner
    place_error = rng.uniform(0.1, 0.2, (COUNT, d))
    maps = prepared.AffineMaps.of(shape, straight, place_error)
    found = np.abs(np.einsum("sd,nd,ndk->snk", signs(d), place_error, maps.matrix)).max(axis=0)
    assert maps.holds.all()
    assert (found <= maps.error * (1 + 1e-12)).all()
    assert (maps.error <= found * (1 + 1e-9)).all()

    # corners alone
    monkeypatch.setattr(prepared, "_NEARLY", np.inf)
    nets = straight + 0.1 * rng.uniform(-1, 1, straight.shape)
    maps = prepared.AffineMaps.of(shape, nets, np.zeros((COUNT, d)))
    own = np.einsum("nvd,ndk->nvk", corners(nets) - maps.origin[:, None], maps.matrix)
    found = np.abs(own - shape.vertices).max(axis=1)
    assert np.allclose(maps.error, found, rtol=1e-9, atol=1e-13)

    # rounding alone: the difference from the origin, d products and d - 1 sums, and the difference from the vertex
    monkeypatch.setattr(prepared, "gamma", gamma)
    maps = prepared.AffineMaps.of(shape, straight, np.zeros((COUNT, d)))
    away = np.abs(corners(straight) - maps.origin[:, None])
    size = np.einsum("nvd,ndk->nvk", away, np.abs(maps.matrix)).max(axis=1)
    counted = size * ((1 + COARSE) ** (d + 1) - 1) + COARSE
    assert (maps.error >= counted).all()
    assert (maps.error <= 4 * counted).all()


def test_largest_differences_are_of_either_sign_and_less_than_their_rounding():
    """On a segment from -0.5 to 0.5 of an element, of whose ends both are in the other one."""
    affine = SimpleNamespace(matrix=np.ones((1, 1, 1)), origin=np.array([[0.1]]))
    pairs = overlaps._Pairs.__new__(overlaps._Pairs)
    pairs._inner = SimpleNamespace(affine=affine, patch=SimpleNamespace(shape=Shape.SEGMENT))
    pairs._outer = SimpleNamespace(patch=SimpleNamespace(element_ids=np.array([7])))
    pairs._search, pairs._is_ours = SimpleNamespace(best=SimpleNamespace(value=2.0)), True
    first = np.zeros(1, int)
    boxes = SimpleNamespace(places=np.array([[[-0.5, 0.5]]]), rows=first, others=first)
    pairs._improve(boxes, np.array([[-3.0, 1.0]]), np.array([0.25]))
    best = pairs._search.best
    assert (best.value, best.element) == (2.75, 7)
    assert np.allclose(best.position, [-0.4, 0, 0])


def test_orders_of_convergence_are_known_between_sizes_and_errors_that_differ():
    errors, sizes = (1.0, 0.25, 0.0, 0.1, 0.05), (1.0, 0.5, 0.25, 0.125, 0.125)
    members = [
        SimpleNamespace(size=size, of=lambda _, own=error: SimpleNamespace(l2=own))
        for error, size in zip(errors, sizes, strict=True)
    ]
    found = convergence.Family.orders(SimpleNamespace(members=members), "u")
    assert found[1] == pytest.approx(2.0)
    assert np.isnan([found[0], *found[2:]]).all()


def extremum(value, bound):
    return Extremum(value, bound, (0.0, 0.0, 0.0), 0)


def test_the_largest_of_two_extrema_has_the_larger_bound(monkeypatch):
    lowest, highest = extremum(-3.0, -4.0), extremum(2.0, 5.0)
    monkeypatch.setattr(greatest, "extrema_of_difference", lambda *_: (lowest, highest))
    found = greatest.greatest_of_fields(None, "u", "v")
    assert (found.value, found.bound) == (3.0, 5.0)


@pytest.mark.parametrize(("value", "bound"), [(1.0, 2.0), (1.5, 2.0), (3.0, 3.0)])
def test_larger_differences_nearby_raise_the_bound(monkeypatch, value, bound):
    monkeypatch.setattr(difference, "greatest_near", lambda *_: extremum(value, value))
    own = SimpleNamespace(_evaluator=None, held=None, _expressions={"value": None})
    best = difference._Compared._or_near(own, extremum(1.0, 2.0), np.zeros((1, 3)))
    assert (best.value, best.bound) == (value, bound)
    unbounded = difference._Compared._or_near(own, extremum(1.0, np.inf), np.zeros((1, 3)))
    assert (unbounded.value, unbounded.bound) == (value, np.inf)


def test_rounding_of_reference_coordinates_has_that_of_values_sums_and_products(monkeypatch):
    """Sums of three products, on a surface in space: coordinates are 1.5 at most, and 1 is added."""
    monkeypatch.setattr(compositions, "gamma", float)
    inner = SimpleNamespace(affine=SimpleNamespace(matrix=np.ones((1, 3, 2))))
    boxes = SimpleNamespace(places=np.full((1, 3, 2, 2), 0.5), others=np.zeros(1, int))
    found = Composition._shift(SimpleNamespace(_inner=inner), boxes)
    assert found.tolist() == [[(value_roundings((2, 2)) + 3 + 3) * 2.5] * 2]
