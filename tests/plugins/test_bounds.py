"""Bounds of plugins: values lie within them, and some come near their ends (tests/support/claims.py)."""

from fractions import Fraction
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from claims import TEETH, check
from numpy.polynomial import chebyshev

from elvis.core.distances.search import _angle
from elvis.core.distances.surface_patches import CORNERS
from elvis.core.polynomials.bernstein import BernsteinSpace
from elvis.core.quantities.tree import call, coordinate, number
from elvis.core.shapes import Shape
from elvis.plugins.native import elements, polynomials, rounding
from elvis.plugins.native.bending import BEYOND, changes, net_of_xi, rational_changes
from elvis.plugins.native.polynomials import Net
from elvis.plugins.native.regions import Neighbourhood
from elvis.plugins.native.slopes import Polynomials, _Gradients
from elvis.plugins.runtime.volume import boxes_between

COUNT = 40
#: unit roundoff of the model: so coarse that its square counts
COARSE = 2.0**-11
QUADRATIC = BernsteinSpace(Shape.SEGMENT, (2,))
BILINEAR = BernsteinSpace(Shape.QUADRILATERAL, (1, 1))


def random_net(rng, space):
    return Net(space, rng.normal(size=(space.count, COUNT)), rng.uniform(0.05, 0.2, COUNT))


def moved(net, way):
    """The polynomials that a net may stand for, farthest from it one way."""
    return Net(net.space, net.coefficients + way * net.error, np.zeros(COUNT))


def results_of_nets(rng):
    """Sums, products, multiples and higher degrees of nets that are off by what they say."""
    first, second = random_net(rng, QUADRATIC), random_net(rng, BernsteinSpace(Shape.SEGMENT, (1,)))
    operations = {
        "sum": polynomials._sum,
        "product": polynomials._product,
        "multiple": lambda a, b: a.times(-3.0),
        "quotient": lambda a, b: a.over(-0.5),
        "with a number": lambda a, b: a.plus(2.0),
        "negative": lambda a, b: a.negative(),
        "higher degree": lambda a, b: a.elevate(BernsteinSpace(Shape.SEGMENT, (4,))),
    }
    for operation in operations.values():
        found = operation(first, second)
        for one, other in product([-1, 1], repeat=2):
            away = np.abs(operation(moved(first, one), moved(second, other)).coefficients - found.coefficients)
            yield away.max(axis=0), found.error


def derivatives_on_inexact_maps(rng):
    """The gradient of a field on a bilinear map whose coefficients are off by what they say, each its own way."""
    square = net_of_xi(BILINEAR).T
    maps = np.tile(square, (COUNT, 1, 1)) + rng.uniform(-0.1, 0.1, (COUNT, 2, 4))
    field = Polynomials(BILINEAR, rng.normal(size=(COUNT, 4)), np.zeros(COUNT))
    error = rng.uniform(0.001, 0.002, (COUNT, 2))
    found = _Gradients(Polynomials(BILINEAR, maps, error), lambda space: Neighbourhood(space, 1.0))
    center = np.array([[-0.5, 0.5, -0.5, 0.5], [-0.5, -0.5, 0.5, 0.5]]) / 2

    def gradients(places):
        jacobians = np.einsum("ncm,jm->ncj", places, center)
        return np.linalg.solve(jacobians.swapaxes(1, 2), np.einsum("nm,jm->nj", field.nets, center)[..., None])[..., 0]

    for _ in range(30):
        off = gradients(maps + error[..., None] * rng.choice([-1.0, 1.0], maps.shape)) - gradients(maps)
        for axis in range(2):
            yield np.abs(off[:, axis]), found.leaf(field, axis).error


def changes_of_rational_maps(rng):
    """y = x / w with w = 1 - a x beyond the element, where the weight is smallest: dy = 1 / w^2, ddy = 2 a / w^3."""
    for slope in rng.uniform(0.3, 0.75, 20):
        parts, weights = np.array([[[-1.0, 0.0, 1.0]]]), np.array([[1 + slope, 1.0, 1 - slope]])
        change, derivative = rational_changes(QUADRATIC, parts, weights)
        least = 1 - slope * BEYOND
        yield np.array([1 / least**2 - 1]), change
        yield np.array([2 * slope / least**3]), derivative


def changes_of_maps(rng):
    """y = x + a x^2 / 2 a little beyond the element."""
    for bend in rng.uniform(-0.7, 0.7, 20):
        parts = np.array([[[-1.0, 0.0, 1.0]]]) + bend / 2 * np.array([[[1.0, -1.0, 1.0]]])
        change, derivative = changes(QUADRATIC, parts)
        yield np.array([abs(bend) * BEYOND]), change
        yield np.array([abs(bend)]), derivative


def boxes_of_parts(rng):
    """Corners of all sizes, in exact comparison; and those that 32-bit floats hold, where nothing else makes room."""
    low = rng.uniform(-1, 1, (2000, 3)) * 10.0 ** rng.uniform(-30, 30, (2000, 1))
    low[::2] = low[::2].astype(np.float32)
    high = low + 1e-12 * np.abs(low)
    boxes = boxes_between(low, high).astype(float)
    off = 8 * np.spacing(np.abs(low).max(axis=1, keepdims=True))
    yield off, low - boxes[:, :3]
    yield off, boxes[:, 3:] - high
    whole = low[::2]
    size = np.spacing(whole.astype(np.float32)).astype(float)
    yield whole - boxes_between(whole, whole).astype(float)[:, :3], 1.1 * np.abs(size).max(axis=1, keepdims=True)


#: errors of slopes are taken four times as large as they are, and those of maps twice
WIDE = {derivatives_on_inexact_maps: 0.05}


@pytest.mark.parametrize(
    "claim",
    [results_of_nets, derivatives_on_inexact_maps, changes_of_rational_maps, changes_of_maps, boxes_of_parts],
)
def test_values_lie_within_bounds_and_some_near_their_ends(claim):
    check(claim, WIDE.get(claim, TEETH))


def test_all_roundings_of_products_are_counted(monkeypatch):
    """All terms of one sign, each product and sum rounded away from zero: within the bound, above an eighth of it."""
    monkeypatch.setattr(polynomials, "UNIT", COARSE)
    for degree in (1, 4, 9):
        space = BernsteinSpace(Shape.SEGMENT, (degree,))
        ones = Net(space, np.ones((space.count, 1)), np.zeros(1))
        (bound,) = polynomials._product(ones, ones).error
        # the middle coefficient has a product of four numbers from each coefficient of a factor, a sum, and a quotient
        terms = np.array([choose(degree, k) * choose(degree, degree - k) for k in range(degree + 1)], float)
        total = 0.0
        for term in terms / terms.sum():
            total = (total + term * (1 + COARSE) ** 3) * (1 + COARSE)
        away = total * (1 + COARSE) - 1
        assert bound / 8 < away <= bound


def choose(n, k):
    return float(np.prod([(n - i) / (i + 1) for i in range(k)]))


def test_values_of_a_net_have_its_error_and_that_of_their_evaluation(monkeypatch):
    """Horner's scheme, 2 i + 2 roundings of term i and p - i of its power, each away from zero, in each direction."""
    monkeypatch.setattr(elements, "UNIT", COARSE)
    for degree in (1, 3, 6):
        space = BernsteinSpace(Shape.QUADRILATERAL, (degree, degree))
        net = Net(space, np.ones((space.count, 1)), np.full(1, 0.1))
        part = SimpleNamespace(geometry=space, _all_arguments=lambda space: "")
        (bound,) = elements.Elements._of_net(part, net).rounding()
        powers = np.arange(degree + 1)
        terms = np.array([choose(degree, k) for k in powers]) / 2.0**degree
        line = (terms * (1 + COARSE) ** (degree + 2 + powers)).sum()
        assert (bound - 0.1) / 8 < line**2 - 1 <= bound - 0.1


@pytest.fixture(scope="module")
def stated(renderer):
    """Bounds (n,) that a kernel states for cases of up to twelve numbers."""
    device = renderer("vulkan").device
    folders = list(device._folders)
    device.include(Path(__file__).parent / "shaders")
    kernel = device.kernel("bounds_check")
    device.include(folders[-1])

    def bounds(number, first, second=0.0, third=0.0, surface=(0.0,)):
        cases = np.zeros(len(first), kernel.dtype("cases"))
        for name, value in (("first", first), ("second", second), ("third", third)):
            cases[name][:, : np.shape(value)[-1] if np.ndim(value) else 4] = value
        cases["bound"] = number
        found = device.empty(np.float64, len(first))
        numbers = device.buffer(np.asarray(surface, float))
        unused = dict.fromkeys(kernel._needed, numbers)
        kernel(len(first), {**unused, "cases": device.buffer(cases), "found": found, "surface_numbers": numbers})
        return device.read(found, np.float64)[: len(first)]

    return bounds


def test_distances_over_boxes_extend_to_their_corners(stated):
    """Computed places are off, too: corners are the farthest."""

    def claim(rng):
        radius, error = rng.uniform(0, 1, (COUNT, 3)), rng.uniform(0, 0.2, (COUNT, 3))
        yield np.linalg.norm(radius + error, axis=1), stated(0, radius, error)

    check(claim)


def test_deviation_of_patches_from_linear_follows_taylors_theorem(stated):
    """X = (a s^2 + 2 b s t + c t^2) / 2 for |s|, |t| <= h, whose derivatives are bounded by a, b and c."""

    def claim(rng):
        for _ in range(5):
            a, b, c = rng.uniform(0.1, 1, 3)
            half = rng.uniform(0.2, 2, (COUNT, 1))
            s, t = half[:, 0] * rng.choice([-1, 1], (2, COUNT))
            yield np.abs(a * s**2 + 2 * b * s * t + c * t**2) / 2, stated(1, half, surface=[0, 0, a, b, c, *[0] * 8])

    check(claim)


def exponential(rates, degree, size=1.0):
    """Bounds of the derivatives of size e^(a s + b t) at its middle, how far it is from flat, and further numbers."""
    a, b = rates
    terms = [a**i * b ** (k - i) for k in range(1, degree + 1) for i in range(k, -1, -1)]
    return [*(np.array(terms) * size), 0.3, *[0] * 8]


@pytest.mark.parametrize("corners", [2, 3, 4])
def test_angles_of_faces_match_those_of_numpy(stated, corners):
    """At corners, on sides and within patches that are a part of their face: any of these may lie on its border."""
    rng = np.random.default_rng(corners)
    ends = CORNERS[corners]
    places = np.concatenate([ends, (ends + np.roll(ends, -1, axis=0)) / 2, ends.mean(axis=0, keepdims=True)])
    places = np.repeat(places, 40, axis=0)
    tangents = rng.normal(size=(len(places), 4))
    border = rng.integers(1 << 2 * 4, size=len(places))
    found = stated(9, places, tangents, np.column_stack([np.full(len(places), corners), border]))
    along, across = (np.pad(own, ((0, 0), (0, 1))) for own in np.split(tangents, 2, axis=1))
    patches = SimpleNamespace(corners=corners, outer=border)
    expected = _angle(patches, np.arange(len(places)), places, along, across)
    within = expected > np.pi
    assert (found[within] > np.pi).all()
    # arc tangents are in single precision, of 4096 units as Vulkan allows
    assert np.abs(found - expected)[~within].max() < 4096 * 2.0**-23


def test_derivatives_of_patches_along_their_sides_are_within_their_bounds(stated):
    """Of e^(a s + b t), which is its derivative in any direction but for a factor."""

    def claim(rng):
        for a, b in rng.uniform(0.1, 1, (5, 2)):
            way, half = rng.uniform(0.1, 1, (COUNT, 2)), rng.uniform(0.2, 2, COUNT)
            slope = (way @ [a, b]) * half
            # sizes of turned parts are negative
            first = half[:, None] * rng.choice([-1, 1], (COUNT, 1))
            for order in (1, 2, 3):
                third = np.tile([2, 0, order - 1], (COUNT, 1))
                yield (
                    slope**order,
                    stated(5, first, way * rng.choice([-1, 1], way.shape), third, exponential((a, b), 3)),
                )
            yield slope**2 / 2, stated(5, first, way, np.tile([2, 0, 3], (COUNT, 1)), exponential((a, b), 3))
            yield np.full(COUNT, 0.3), stated(5, first, way, np.tile([4, 1, 3], (COUNT, 1)), exponential((a, b), 3))

    check(claim, 0.99)


def test_second_derivatives_of_squared_distances_change_within_their_bounds(stated):
    """Of a line e^(a s + b t) to 0, for |s| and |t| up to h: all derivatives are largest at the corner."""

    def claim(rng):
        for a, b in rng.uniform(0.2, 1, (5, 2)):
            half = rng.uniform(0.005, 0.02, COUNT)
            # bounds over the whole patch are for the largest part; steps are in parts of half its side
            numbers = exponential((a, b), 3, np.exp(0.02 * (a + b)))
            grown = np.expm1(2 * half * (a + b))
            for which, second in enumerate((2 * a * a, 2 * a * b, 2 * b * b)):
                third = np.tile([4, 0, 4 + which], (COUNT, 1))
                first = np.column_stack([half, np.ones(COUNT)])
                yield second * half**2 * grown, stated(5, first, np.zeros(2), third, numbers)

    check(claim, 0.9)


def test_positions_move_as_the_minimum_second_derivatives_allow(stated):
    """(|s| |X_s| + |t| |X_t|)^2 in parts of a form in s and t whose mixed part has the worse sign."""
    turn = np.linspace(0, np.pi / 2, 400)
    u, v = np.cos(turn), np.sin(turn)

    def claim(rng):
        one = np.array([0.7, 0.4])
        for is_even in (False, True):
            least = rng.uniform(0.5, 2, (COUNT, 2))
            least = one**2 if is_even else least
            most = rng.uniform(0, 0.9, COUNT) * np.sqrt(np.broadcast_to(least, (COUNT, 2)).prod(axis=1))
            first = np.column_stack([np.ones((COUNT, 2)), np.broadcast_to(least, (COUNT, 2))])
            second = np.column_stack([np.zeros((COUNT, 2)), most])
            s, t = np.broadcast_to(least, (COUNT, 2)).T
            form = s[:, None] * u * u + t[:, None] * v * v - 2 * most[:, None] * u * v
            found = ((one[0] * u + one[1] * v) ** 2 / form).max(axis=1)
            yield found, stated(5, first, second, np.tile([4, 0, 7], (COUNT, 1)), [*one, *[0] * 15])
            along = stated(5, first, [1.0, 0.0], np.tile([2, 0, 7], (COUNT, 1)), [*one, *[0] * 15])
            yield one[0] ** 2 / s, along

    check(claim, 0.99)


def test_distances_change_by_no_more_than_one_moves_and_are_computed(stated):
    """Over a box, to within the error of computed places and of distances themselves."""

    def claim(rng):
        radius, error, own = rng.uniform(0, 1, (COUNT, 3)), rng.uniform(0, 0.2, (COUNT, 3)), rng.uniform(0, 0.2, COUNT)
        off = np.zeros(COUNT)
        yield np.linalg.norm(radius + error, axis=1) + own, stated(6, radius, error, np.column_stack([own, off]))
        yield np.linalg.norm(error, axis=1) + own, stated(6, radius, error, np.column_stack([own, off + 1]))

    check(claim, 0.99)


def test_deviation_of_fields_along_rays_follows_taylors_theorem(stated):
    """x . H x / 2 at the corners of a cube; half of the bound is room for steps that are linear, too."""

    def claim(rng):
        hessian = rng.uniform(0.1, 1, (COUNT, 3, 3))
        hessian += hessian.swapaxes(1, 2)
        distance = rng.uniform(0.1, 2, COUNT)
        half = np.abs(hessian).sum(axis=(1, 2)) / 2
        found = np.einsum("nij->n", hessian) * distance**2 / 2
        yield found, stated(2, np.stack([half, distance], axis=1))

    check(claim, 0.49)


def test_rays_meet_levels_between_the_stated_depths(stated):
    """Of a linear field, off by a remainder and by noise; and of what is in the cube, off by a deviation."""
    rng = np.random.default_rng(2)
    start = np.array([0.1, -0.2, 0.3])
    gradient, direction = rng.uniform(0.3, 1, (2, COUNT, 3))
    gradient[::2], direction[1::3] = -gradient[::2], -direction[1::3]
    remainder, noise = rng.uniform(0.01, 0.1, (2, COUNT))
    second, steep = np.column_stack([direction, remainder]), np.einsum("nk,nk->n", gradient, direction)
    for deviation, largest in ((9.0, 0.2), (0.0, 2.0)):
        value = rng.uniform(-largest, largest, COUNT)
        first, level = np.column_stack([gradient, value]), -(value + gradient @ start)
        third = np.column_stack([np.full(COUNT, deviation), noise, np.zeros(COUNT)])
        low, high = (stated(7, first, second, third + np.array([0, 0, which])) for which in (0, 1))
        ends = [(sign * (1 + deviation + 1e-7) - start) / direction for sign in (-1, 1)]
        inside = np.minimum(*ends).max(axis=1), np.maximum(*ends).min(axis=1)
        # both noises: that of the value here, and that of the root
        off = (remainder + 2 * noise) / np.abs(steep)
        assert np.abs(low - np.maximum(inside[0], level / steep - off)).max() < 1e-12
        assert np.abs(high - np.minimum(inside[1], level / steep + off)).max() < 1e-12
        assert (np.abs(low - inside[0]) < 1e-12).any() == (deviation == 0)

    # without a slope all counts, or nothing, by the value alone
    first[:, :3] = 0.0
    for part, is_met in ((0.99, True), (1.01, False)):
        first[:, 3] = part * (remainder + noise) * rng.choice([-1, 1], COUNT)
        low, high = (stated(7, first, second, third + np.array([0, 0, which])) for which in (0, 1))
        assert ((low <= high) == is_met).all()


def test_uncertainty_of_root_depths_is_error_over_derivative_plus_rounding(stated):
    first = np.array([[0.1, 2.0, 5.0], [0.1, 0.0, 5.0], [0.0, 2.0, -5.0]])
    found = stated(8, first)
    assert found[0] == pytest.approx(0.05, abs=1e-14)
    assert found[0] > 0.05
    assert np.isinf(found[1])
    assert 4 * 2.0**-53 * 5 <= found[2] < 10 * 2.0**-53 * 5


def test_series_have_the_errors_of_values_and_their_rounding(stated):
    """The coefficient of T_n from values at its nodes, each off its own way, and rounded; where T_n grows."""

    def claim(rng):
        for degree, end in ((2, 1.0), (4, 1.2), (6, 1.5)):
            nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
            from_values = np.linalg.inv(chebyshev.chebvander(nodes, degree))[-1]
            growth = chebyshev.chebval(end, np.eye(degree + 1)[-1])
            own, local = rng.uniform(0.05, 0.2, (2, COUNT))
            values = own[:, None] * np.sign(from_values)
            found = growth * (values @ from_values + local)
            factors = np.tile([growth, np.abs(from_values).sum()], (COUNT, 1))
            yield found, stated(3, np.stack([own, local], axis=1), factors)

    check(claim)


def test_roundings_of_sums_for_series_are_all_counted(stated):
    """Of three passes, whose sums have n terms with tables that are off by 7 units, and of the sum of magnitudes."""
    n = np.arange(2.0, 20.0)
    found = stated(10, n[:, None])
    passes = (2**1.5 * n**2 + 2 * n**1.5 + 2**0.5 * n) * (n + 7) + n**3
    assert (passes * 2.0**-53 <= found).all()
    assert (found <= 1.6 * passes * 2.0**-53).all()
    assert stated(10, np.zeros((1, 1)))[0] == 1.0


def test_rays_in_skewed_tetrahedra_are_off_by_less_than_is_stated(stated):
    """Reference coordinates by cofactors, in floats and in fractions, of slivers a millionth as thick as long."""
    rng = np.random.default_rng(5)
    jacobians = rng.uniform(-1, 1, (COUNT, 3, 3))
    jacobians[:, :, 2] = jacobians[:, :, :2] @ [0.3, 0.4] + 1e-6 * jacobians[:, :, 2]
    points = rng.uniform(-1, 1, (COUNT, 3))
    after, last = jacobians[:, :, [1, 2, 0]], jacobians[:, :, [2, 0, 1]]
    cofactors = np.cross(after, last, axis=1).swapaxes(1, 2)
    determinants = np.einsum("nk,nk->n", jacobians[:, :, 0], cofactors[:, 0])
    computed = np.einsum("nkc,nc->nk", cofactors, points) / determinants[:, None]
    exact = np.array([solved(*both) for both in zip(jacobians, points, strict=True)], float)
    skewed = np.linalg.norm(jacobians, axis=1).prod(axis=1) / np.abs(determinants)
    third = np.column_stack([skewed, np.ones(COUNT)])
    bound = stated(4, exact, np.zeros(3), third)
    away = np.abs(computed - exact).max(axis=1)
    assert (away <= bound).all()
    assert (away / bound).max() > 1e-2


def solved(jacobian, point):
    """Cramer's rule in fractions."""
    j = [[Fraction(float(entry)) for entry in row] for row in jacobian]
    p = [Fraction(float(entry)) for entry in point]

    def determinant(a):
        return sum(a[0][i] * (a[1][i - 2] * a[2][i - 1] - a[1][i - 1] * a[2][i - 2]) for i in range(3))

    whole = determinant(j)
    with_point = [[[p[r] if c == k else j[r][c] for c in range(3)] for r in range(3)] for k in range(3)]
    return [float(determinant(matrix) / whole) for matrix in with_point]


@pytest.mark.parametrize("ends", [(-3.0, 1.0), (-1.0, 3.0)])
def test_expressions_are_rounded_in_proportion_to_the_end_of_larger_magnitude(ends):
    class Cells:
        patch = SimpleNamespace(shape=Shape.HEXAHEDRON)

        def bounds(self, node):
            return np.full(1, ends[0]), np.full(1, ends[1])

        def __len__(self):
            return 1

    root = call("*", coordinate(0), number(2.0))
    (found,) = rounding.expression_rounding(root, Cells(), lambda name: np.zeros(1), 2)
    # the coordinate by Horner's scheme, and the product
    expected = (2 * rounding._horner(3, 2, False) + 2) * rounding.UNIT * 3.0
    assert found == pytest.approx(expected, rel=1e-6)
