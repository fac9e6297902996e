"""Bounds of the core: values lie within them, and some come near their ends (tests/support/claims.py)."""

from dataclasses import replace
from fractions import Fraction
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from claims import ATTAINED, TEETH, check

from elvis.core.bounds import bounding
from elvis.core.bounds.extrema import Nets
from elvis.core.bounds.ranges import Range
from elvis.core.cores import graphs as core_graphs
from elvis.core.cores.boxes import Boxes as CoreBoxes
from elvis.core.cores.graphs import Graphs, by_eigenvalue
from elvis.core.cores.matrix_ranges import Eigenvalue, MatrixRange
from elvis.core.data.dataset import Dataset
from elvis.core.differences import diff
from elvis.core.differences.compositions import Composition
from elvis.core.distances.sides import _gaps
from elvis.core.integrals import along_curves, integrate
from elvis.core.integrals.box_discs import BoxDiscs
from elvis.core.integrals.levels import error as level_error
from elvis.core.integrals.levels.discs import LevelDiscs
from elvis.core.integrals.touching import _bounds, _shares
from elvis.core.mapping.boxes import ROUNDINGS, outward
from elvis.core.mapping.enclosure import hulls
from elvis.core.mapping.inverse import Status, invert
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import positions
from elvis.core.polynomials.bernstein import bernstein_coefficients, to_bernstein
from elvis.core.polynomials.boxnets import difference, on_lattice
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.net_zeros import values_of
from elvis.core.polynomials.rounding import coefficient_rounding, gamma
from elvis.core.quantities import Expression, intervals
from elvis.core.quantities.cells import Cells
from elvis.core.quantities.evaluator import _sized
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field
from elvis.core.validity import squares
from elvis.core.validity.squares import lower_bound
from elvis.core.validity.validity import Validity, ValidityStatus, _Facts, _widest

COUNT, SAMPLES = 60, 200


def corners_of(rng, middle, radius):
    """(SAMPLES, …) corners of the box round each middle."""
    return middle + radius * rng.choice([-1.0, 1.0], (SAMPLES, *middle.shape))


def random_matrices(rng):
    middle, radius = rng.normal(size=(COUNT, 3, 3)), rng.uniform(0.2, 1.0, (COUNT, 3, 3))
    return MatrixRange(middle, radius), corners_of(rng, middle, radius)


def cofactors(rng):
    matrices, corners = random_matrices(rng)
    found = matrices.cofactors()
    rows = corners[..., [1, 2, 0], :], corners[..., [2, 0, 1], :]
    for i, j in np.ndindex(3, 3):
        yield np.abs(np.cross(*rows)[..., i, j] - found.middle[:, i, j]), found.radius[:, i, j]


def sums_of_minors(rng):
    matrices, corners = random_matrices(rng)
    middle, radius = matrices.sum_of_minors()
    trace = np.einsum("snii->sn", corners)
    yield np.abs(0.5 * (trace**2 - np.einsum("snij,snji->sn", corners, corners)) - middle), radius


def sums_of_minors_around_diagonal_matrices(rng):
    """At corners where the changes of all products add up."""
    radius = rng.uniform(0.2, 1.0, (COUNT, 3, 3))
    middle = rng.uniform(0.0, 2.0, (COUNT, 3))[:, None] * np.eye(3)
    found, bound = MatrixRange(middle, radius).sum_of_minors()
    corner = middle + radius * (np.tri(3) - np.tri(3).T + np.eye(3))
    trace = np.einsum("nii->n", corner)
    yield np.abs(0.5 * (trace**2 - np.einsum("nij,nji->n", corner, corner)) - found)[None], bound


def shifted_matrices(rng):
    matrices, corners = random_matrices(rng)
    numbers, errors = rng.normal(size=COUNT), np.full(COUNT, 0.1)
    found = matrices.shifted(numbers, errors)
    for sign in (-1, 1):
        values = corners - (numbers + sign * errors)[:, None, None] * np.eye(3)
        yield np.abs(values - found.middle), found.radius


def ranges_of_nets(rng):
    nets = rng.normal(size=(COUNT, 9, 3, 2))
    found = MatrixRange.of_nets(nets)
    values = on_lattice(nets.reshape(-1, 3, 2), np.linspace(0, 1, 5)).reshape(COUNT, 3, 3, -1)
    yield np.abs(np.moveaxis(values, -1, 0) - found.middle), found.radius


def eigenvalues(rng):
    """Of an eigenvalue 0 and a block with complex ones: the first entry is known, everything else is in a range."""
    middle = np.zeros((COUNT, 3, 3))
    middle[:, 1:, 1:] = [[1.0, -2.0], [2.0, 1.5]] + 0.3 * rng.normal(size=(COUNT, 2, 2))
    radius = rng.uniform(0.02, 0.15, (COUNT, 3, 3))
    radius[:, 0, 0] = 0.0
    slopes = [MatrixRange(rng.normal(size=(COUNT, 3, 3)), rng.uniform(0.1, 0.5, (COUNT, 3, 3))) for _ in range(3)]
    for slope in slopes:
        slope.middle[:, 0, 0] = slope.radius[:, 0, 0] = 0.0
    known = Eigenvalue.of(MatrixRange(middle, radius), slopes)
    assert known.is_known.mean() > 0.2
    matrices = corners_of(rng, middle, radius)[:, known.is_known]
    values, vectors = np.linalg.eig(matrices)
    which = np.abs(values.imag).argmin(axis=-1)[..., None]
    own = np.take_along_axis(values, which, -1)[..., 0].real
    yield np.abs(own), known.error[known.is_known]
    right = np.take_along_axis(vectors, which[..., None, :], -1)[..., 0].real
    left = np.take_along_axis(np.linalg.inv(vectors), which[..., None], -2)[..., 0, :].real
    left /= np.einsum("sni,sni->sn", left, right)[..., None]
    for k, slope in enumerate(slopes):
        # the worst derivative of entries in the range has the signs of the eigenvectors' products
        both = np.einsum("sni,snj->snij", left, right)
        worst = slope.middle[known.is_known] + np.sign(both) * slope.radius[known.is_known]
        found = np.abs(np.einsum("snij,snij->sn", both, worst))
        yield found, known.slope_error[known.is_known, k]


def core_boxes(rng):
    """Boxes whose gradients have a real eigenvalue and complex ones, and what velocity and gradient are there."""
    gradient = np.zeros((COUNT, 3, 3, 2, 2, 2))
    gradient[:, 1:, 1:] = np.reshape([[1.0, -2.0], [2.0, 1.5]], (2, 2, 1, 1, 1))
    gradient += 0.05 * rng.normal(size=gradient.shape)
    above = rng.normal(size=(COUNT, 3, 2, 2, 2))
    return CoreBoxes.whole(np.arange(COUNT), above, gradient.reshape(COUNT, 9, 2, 2, 2), np.zeros(COUNT), True)


def parallel_at(boxes, place):
    """(n, 3) (gradient - eigenvalue) velocity at one place of all boxes."""
    places = np.tile(place, (COUNT, 1))
    matrices, velocity = values_of(boxes.gradient, places).reshape(-1, 3, 3), values_of(boxes.above, places)
    values = np.linalg.eigvals(matrices)
    own = np.take_along_axis(values, np.abs(values.imag).argmin(axis=1)[:, None], 1)[:, 0].real
    return np.einsum("nij,nj->ni", matrices, velocity) - own[:, None] * velocity


def graphs_of_eigenvalues(rng):
    """(gradient - eigenvalue) velocity, combined, at the corners of boxes; the first product is off by an error."""
    for error in (0.0, 0.1):
        boxes = core_boxes(rng)
        boxes = replace(boxes, turned_error=np.full((COUNT, 3), error))
        graphs = by_eigenvalue(boxes, None)
        assert graphs.is_known.mean() > 0.2
        for corner in product([0.0, 1.0], repeat=3):
            zero = parallel_at(boxes, corner)
            own = values_of(graphs.nets, np.tile(corner, (COUNT, 1)))
            away = np.abs(np.einsum("nai,ni->na", graphs.combining, zero) - own)
            away += np.abs(graphs.combining).sum(axis=2) * error
            yield away[graphs.is_known], graphs.errors[graphs.is_known]


def slopes_of_graphs_of_eigenvalues(rng, step=1e-4):
    """Their derivatives next to the corners, by differences."""
    boxes = core_boxes(rng)
    graphs = by_eigenvalue(boxes, None)
    for corner, axis in product(product([step, 1 - step], repeat=3), range(3)):
        ends = [np.array(corner) + way * step * np.eye(3)[axis] for way in (-1, 1)]
        off = [np.einsum("nai,ni->na", graphs.combining, parallel_at(boxes, place)) for place in ends]
        own = [values_of(graphs.nets, np.tile(place, (COUNT, 1))) for place in ends]
        away = np.abs(np.diff(off, axis=0) - np.diff(own, axis=0))[0] / (2 * step)
        yield away[graphs.is_known], graphs.slope_errors[graphs.is_known][:, :, axis] + 1e-6


def differences_of_nets(rng):
    """Operands that are off by what they say, in opposite ways."""
    first, second = (
        Nets(rng.normal(size=(COUNT, *sizes)), rng.uniform(0.05, 0.2, COUNT)) for sizes in ((3, 4), (4, 2))
    )
    found = first.minus(second)
    for sign in (-1, 1):
        moved = [own.values + sign * way * own.error[:, None, None] for own, way in ((first, 1), (second, -1))]
        away = np.abs(difference(*moved) - found.values)
        yield away.max(axis=(1, 2)), found.error


def gradients_on_stretched_elements(rng):
    """x = xi + n (xi^2 - 1) / 2 on [-1, 1]: the field xi has the derivative 1 / (1 + n xi) along x."""
    for stretch in (0.3, 0.6, 0.8):
        mesh = curved(grid(Shape.QUADRILATERAL, 1), lambda p, n=stretch: p + n * p * (p - 1) * [1.0, 0, 0], 3)
        bare = patches(Dataset(mesh))[0]
        expansion = modified(Shape.QUADRILATERAL, (2, 2))
        bernstein = np.array([[0.0, 1.0, 0.0, 1.0]])
        modal = np.linalg.solve(to_bernstein(expansion).T, bernstein.T).T
        patch = replace(bare, fields=(expansion,), coefficients=(modal,))
        cells = Cells.of(patch, ["u"], None, np.arange(1), True)
        low, high = cells._gradient(0, 0)
        middle, radius = (low + high) / 2, (high - low) / 2
        ends = 1 / (1 + stretch * np.array([-1.0, 1.0]))
        yield np.abs(ends - middle).max(keepdims=True), radius


def gradients_on_elements_stretched_at_one_end(rng):
    """x = p - n p^3 / 3 on [0, 1]: dp/dx = 1 / (1 - n p^2), whose inverse is far below its mean; fields p and -p^2."""
    for stretch in (0.5, 0.8, 0.9):
        mesh = curved(grid(Shape.QUADRILATERAL, 1), lambda p, n=stretch: p - n / 3 * p**3 * [1.0, 0, 0], 4)
        for field, slopes in ((lambda p: p, [1.0, 1.0]), (lambda p: -(p**2), [0.0, -2.0])):
            dataset = with_field(mesh, lambda x, n=stretch, f=field: f(roots_of(n, x[:, 0])), 3)
            (patch,) = patches(dataset, ("u",))
            low, high = Cells.of(patch, ["u"], None, np.arange(1), True)._gradient(0, 0)
            middle, radius = (low + high) / 2, (high - low) / 2
            ends = np.array(slopes) / [1.0, 1 - stretch]
            yield np.abs(ends - middle).max(keepdims=True), radius


def roots_of(stretch, x):
    """P with p - n p^3 / 3 = x, by Newton's method."""
    p = x
    for _ in range(30):
        p = p - (p - stretch / 3 * p**3 - x) / (1 - stretch * p**2)
    return p


def shares_near_zero(rng):
    """The part of [0, 1] or of the square where a polynomial is within something of zero."""
    places = np.linspace(0, 1, 2001)
    for sizes in ((2,), (3,), (2, 2)):
        nets = rng.normal(size=(COUNT, *sizes))
        within = rng.uniform(0.02, 0.1, COUNT)
        values = on_lattice(nets, places if len(sizes) == 1 else places[::20]).reshape(COUNT, -1)
        counted = (np.abs(values) <= within[:, None]).mean(axis=1)
        yield counted, np.minimum(_shares(nets, within), 1.0) + 2e-2 * (len(sizes) - 1) + 1e-3


def shares_of_parabolas(rng):
    """a (t - m)^2 - w is within w of zero on a width of 2 sqrt(2 w / a), in any degree."""
    steep, within = rng.uniform(1, 2, COUNT), rng.uniform(0.01, 0.05, COUNT)
    middle = rng.uniform(0.4, 0.6, COUNT)
    quadratic = np.stack([middle**2, middle**2 - middle, (1 - middle) ** 2], axis=1)
    nets = steep[:, None] * quadratic - within[:, None]
    cubic = np.stack(
        [nets[:, 0], (nets[:, 0] + 2 * nets[:, 1]) / 3, (2 * nets[:, 1] + nets[:, 2]) / 3, nets[:, 2]], axis=1
    )
    for own in (nets, cubic):
        yield 2 * np.sqrt(2 * within / steep), _bounds(own, within)[1] * (1 + 1e-12)


def boxes_in_single_precision(rng):
    """Of corners of all sizes: what their coordinates may be off by lies within, in exact comparison."""
    low = rng.uniform(-1, 1, (20_000, 3)) * 10.0 ** rng.uniform(-30, 30, (20_000, 1))
    high = low + rng.uniform(0, 1, low.shape) * np.abs(low).max(axis=1, keepdims=True) * 10.0 ** rng.uniform(
        -20, 0, (20_000, 1)
    )
    box = outward(low, high, 0.0).astype(float)
    rounding = (ROUNDINGS - 1) * np.finfo(float).eps * np.maximum(np.abs(low), np.abs(high)).max(axis=1, keepdims=True)
    room = (
        np.spacing(np.maximum(np.abs(box[:, :3]), np.abs(box[:, 3:])).astype(np.float32)).astype(float) + 2 * rounding
    )
    yield rounding, low - box[:, :3]
    yield rounding, box[:, 3:] - high
    yield low - box[:, :3], room
    yield box[:, 3:] - high, room


def boxes_without_rounding(rng):
    """Corners that 32-bit floats nearly hold: only rounding of coordinates moves them, and nothing the origin."""
    assert not outward(np.zeros((1, 3)), np.zeros((1, 3)), 0.0).any()
    exact = rng.uniform(1, 2, (1000, 3)).astype(np.float32).astype(float)
    eps = np.finfo(float).eps
    for ulps in (-0.9, 0.9):
        low = exact * (1 + ulps * ROUNDINGS * eps)
        box = outward(low, low, 0.0).astype(float)
        off = (ROUNDINGS - 1) * eps * low.max(axis=1, keepdims=True)
        assert (box[:, :3] <= low - off).all()
        assert (box[:, 3:] >= low + off).all()
    yield np.ones(1), np.ones(1)


def hulls_of_elements(rng):
    """Points count for an element by TOLERANCE beyond it; s of its box is within TOLERANCE of [0, 1]."""
    for shape in (Shape.QUADRILATERAL, Shape.HEXAHEDRON, Shape.SEGMENT):
        (patch,) = patches(Dataset(grid(shape, 1)))
        d = shape.dimension
        low, high = hulls(patch, 0, 3)
        for sign in (-1.0, 1.0):
            corner = positions(patch, np.zeros(1, int), np.full((1, d), sign * (1 + 2 * TOLERANCE)))[0, :d]
            end = low.min(axis=0)[:d] if sign < 0 else high.max(axis=0)[:d]
            yield sign * (corner - (sign > 0)), sign * (end - (sign > 0)) + 1e-15


def valleys(rng):
    """Bounds by sums of squares of (a x + b y - c)^2, whose smallest value 0 isn't exceeded, at any size."""
    for size in 10.0 ** np.arange(-3, 4):
        for a, b in rng.uniform(0.3, 1.0, (4, 2)):
            c = a * rng.uniform(0.2, 0.8)
            linear = np.array([[-c, b - c], [a - c, a + b - c]])
            net = square_of(linear) * size
            bound = lower_bound(net, -1e-9 * size)
            assert -1e-9 * size <= bound <= 0.0
    yield np.ones(1), np.ones(1)


def square_of(linear):
    """(3, 3) box net of the square of a bilinear function with a net (2, 2)."""
    found = np.zeros((3, 3))
    weight = np.array([1.0, 2.0, 1.0])
    for i, j, k, m in product(range(2), repeat=4):
        found[i + k, j + m] += linear[i, j] * linear[k, m]
    return found / (weight[:, None] * weight)


CLAIMS = [
    cofactors,
    sums_of_minors,
    sums_of_minors_around_diagonal_matrices,
    shifted_matrices,
    ranges_of_nets,
    eigenvalues,
    graphs_of_eigenvalues,
    slopes_of_graphs_of_eigenvalues,
    differences_of_nets,
    gradients_on_stretched_elements,
    gradients_on_elements_stretched_at_one_end,
    shares_near_zero,
    shares_of_parabolas,
    boxes_in_single_precision,
    boxes_without_rounding,
    hulls_of_elements,
    valleys,
]
#: the eigenvalue's bound 2 |D| / Q takes all factors of D as independent: wide, but of the right order
WIDE = {slopes_of_graphs_of_eigenvalues: 0.05}
#: parabolas attain their bound
WIDE[shares_of_parabolas] = 0.99
#: as do the corners at which all terms have one sign
WIDE[sums_of_minors_around_diagonal_matrices] = 1 - 1e-12


@pytest.mark.parametrize("claim", CLAIMS)
def test_values_lie_within_bounds_and_some_near_their_ends(claim):
    check(claim, WIDE.get(claim, TEETH))


#: unit roundoff of the model: so coarse that its square counts
COARSE = 2.0**-11


def adversarial(terms):
    """The sum of terms (n,) one after another, each product and each sum rounded away from zero."""
    found = 0.0
    for term in terms:
        found = (found + term * (1 + COARSE)) * (1 + COARSE)
    return found


@pytest.mark.parametrize("shape", list(Shape))
def test_roundings_of_coefficients_are_all_counted(shape):
    """All terms of one sign, all roundings away from zero: within the bound, above an eighth of it."""
    expansion = modified(shape, (4,) * shape.dimension)
    matrix = np.abs(to_bernstein(expansion)) * (1 + COARSE) ** (4 * shape.dimension)
    found = np.array([adversarial(column) for column in matrix.T])
    exact = np.abs(to_bernstein(expansion)).sum(axis=0)
    bound = float(coefficient_rounding(expansion, np.ones(len(matrix)), unit=COARSE))
    away = (found - exact).max()
    if shape in (Shape.SEGMENT, Shape.QUADRILATERAL, Shape.HEXAHEDRON):
        # these are computed direction by direction, with fewer roundings
        away = by_directions(expansion)
    assert bound / 8 < away <= bound


def by_directions(expansion):
    """The largest error of coefficients that are computed one direction after another."""
    line = np.abs(to_bernstein(modified(Shape.SEGMENT, (expansion.modes[0],))))
    exact, found = line.sum(axis=0).max(), 1.0
    for _ in expansion.modes:
        found *= max(adversarial(column * (1 + COARSE) ** 4) for column in line.T)
    return found - exact ** len(expansion.modes)


@pytest.mark.parametrize("axis", range(3))
def test_points_a_few_roundings_outside_are_inside_far_away(axis):
    """Coordinates of a point are rounded; elements are 1e-4 long at 1e6, where that is 1e-6 of them."""
    away = 1e6
    mesh = grid(Shape.HEXAHEDRON, 1)
    far = curved(replace(mesh, vertices=mesh.vertices * 1e-4 + away), lambda p: p, 3)
    (patch,) = patches(Dataset(far))
    for end, way in ((0.0, -1), (1e-4, 1)):
        points = np.full((8, 3), away + 5e-5)
        points[:, axis] = away + end + way * np.arange(8) * np.spacing(away)
        status = invert(patch, np.zeros(8, int), points, prove=False).status
        assert (status == Status.INSIDE).all()


def test_coefficients_of_magnitudes_bound_coefficients():
    """Magnitudes of all terms, not of their sum."""
    expansion = modified(Shape.TRIANGLE, (4, 4))
    signs = np.sign(to_bernstein(expansion)).T
    for column, sign in enumerate(signs):
        found = bernstein_coefficients(expansion, sign)[column]
        assert bernstein_coefficients(expansion, sign, magnitudes=True)[column] >= abs(found) / ATTAINED


def test_bounds_by_squares_allow_for_rounding(monkeypatch):
    """Each coefficient of what is left is rounded upwards, as often as terms are added: the bound isn't above 0."""
    monkeypatch.setattr(squares, "_UNIT", COARSE)
    enlarge, above = squares._enlarge, 0.0
    for a, b in np.random.default_rng(3).uniform(0.3, 1.0, (6, 2)):
        net = square_of(np.array([[-a / 2, b - a / 2], [a / 2, a / 2 + b]]))
        roundings = COARSE * sum(net.shape) * np.abs(net).max()
        monkeypatch.setattr(squares, "_enlarge", lambda own, shape, off=roundings: enlarge(own, shape) - off)
        bound = squares._without_squares(net)
        assert -16 * roundings < bound <= 0.0
        above = max(above, bound / roundings)
    assert above > -16


def test_bounds_of_differences_include_rounding_of_nets(monkeypatch):
    """Nets that are off by a part of the difference bound it by that much more, also after boxes were bisected."""
    part, compose = 0.02, Composition.compose

    def off(self, boxes, allowed=0.0):
        for group, own in compose(self, boxes, allowed):
            yield group, replace(own, limit=own.limit + part, slack=own.slack + part)

    monkeypatch.setattr(Composition, "compose", off)
    one = with_field(grid(Shape.TRIANGLE, 1), lambda p: np.sin(2.8 * p[:, 0] + 2.9 * p[:, 1]), 3)
    other = with_field(grid(Shape.QUADRILATERAL, 1), lambda p: 0 * p[:, 0], 2)
    row = diff(one, other)[0]
    assert row.bound >= row.linf + part * (1 - 1e-9)


def test_errors_of_integrals_along_curves_include_rounding(monkeypatch):
    monkeypatch.setattr(along_curves, "_ROUNDING", 0.1)
    (found,) = integrate(Dataset(grid(Shape.HEXAHEDRON, 1)), "1 + x", "line:0,0.1,0.2:1,0.1,0.2")
    assert found.error >= 0.1 * found.value


def test_integrals_over_boxes_are_between_products_of_ends():
    """Of volumes of either sign in a disc, and integrands between two values."""
    middle, radius = np.array([[3.0], [-3.0], [0.5]]), np.ones((3, 1))
    whole = SimpleNamespace(volume=(middle, radius))
    boxes = SimpleNamespace(is_filled=True, is_whole=np.ones(3, bool), is_lost=np.zeros(3, bool))
    for ends, low, high in (
        ((2.0, 4.0), (4, 4, 0), (16, 16, 6)),
        ((-4.0, -2.0), (-16, -16, -6), (-4, -4, 0)),
        ((-1.0, 5.0), (-4, -4, -1.5), (20, 20, 7.5)),
    ):
        found = level_error._enclosure(whole, tuple(np.full(3, end) for end in ends), boxes, np.zeros((3, 2, 2, 2)))
        assert np.abs(np.subtract(found, (low, high))).max() < 1e-14


def test_components_of_normals_are_between_minus_one_and_one():
    for middle, radius in ((np.float64(0.0), np.float64(1.0)), (np.array([[0.25]]), np.array([[0.5]]))):
        parts = SimpleNamespace(_leaf=lambda node, normals, m=middle, r=radius: (m, r), rows=np.zeros(1, int))
        dataset = Dataset(grid(Shape.HEXAHEDRON, 1))
        low, high = LevelDiscs.interval(parts, Expression.of(dataset, "x").root)
        assert np.broadcast_to(low, 1)[0] == np.ravel(middle - radius)[0]
        assert np.broadcast_to(high, 1)[0] == np.ravel(middle + radius)[0]


@pytest.mark.parametrize("part", [0.99, 1.01])
@pytest.mark.parametrize("which", [0, 1])
def test_cores_are_graphs_up_to_a_slope_and_a_distance_from_the_unit_matrix(part, which):
    """Either of two functions decides, its error too: half of what is allowed is in the error."""
    near = 0.25
    limits = {"across": (0.5, 0.0), "along": (near, 2 / 3 * (1 - near))}
    for kind, (off, along) in limits.items():
        changes = np.zeros((2, 3))
        changes[:, :2] = np.eye(2)
        errors = np.zeros((1, 2, 3))
        errors[0, which, 0] = off / 2 * (part if kind == "across" else 1)
        changes[which, 2], errors[0, which, 2] = along / 2 * part, along / 2 * part
        places = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"))
        nets = np.einsum("fk,kabc->fabc", changes, places)[None]
        # the derivative across deviates at one end of the core alone
        nets[0, which] += off / 2 * (part * places[2] if kind == "across" else 1) * places[0]
        # directions of nets run backwards or not: the third is the last coordinate
        graphs = Graphs(np.ones(1, bool), None, None, nets, None, errors, None)
        assert graphs.is_graph()[0] == (part < 1), kind


def test_bounds_include_boxes_left_after_the_last_round(monkeypatch):
    """A peak of height 1 that no sample comes near, in boxes that could be bisected further."""
    monkeypatch.setattr(bounding, "_ROUNDS", 1)
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    for sign in ("", "-"):
        text = f"{sign}1/(1 + 1e8*((x - 0.3137)^2 + (y - 0.7071)^2))"
        found = bounding.quantity_range(dataset, Expression.of(dataset, text))
        assert (found.lower <= -1) if sign else (found.upper >= 1)
        assert max(-found.minimum, found.maximum) < 0.5


def test_boxes_with_the_largest_bounds_are_bisected_first(monkeypatch):
    """If only 16 are kept, these are the ones next to the maximum, in a corner."""
    monkeypatch.setattr(bounding, "_NUMBERS", 1)
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    found = bounding.quantity_range(dataset, Expression.of(dataset, "x*(2 - x)*y*(2 - y)"))
    assert 1 <= found.upper < 1.1


def test_sizes_of_functions_do_not_depend_on_signs():
    """Rounding is a part of sizes: of an odd function of x and of -x it is the same."""
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    for text in ("sin(x)", "atan(x)", "sinh(x)", "tan(x)"):
        node = Expression.of(dataset, text).root
        (value, size), (negative, other) = (_sized(node, [(sign * 0.9, 0.9)]) for sign in (1, -1))
        assert value == -negative
        assert size == other >= abs(value)


@pytest.mark.parametrize("shift", [0.0, -1 - 1e-9])
def test_sides_shared_up_to_rounding_leave_no_gap(shift):
    """Wherever the origin is: rounding is a part of the largest magnitude."""
    square = np.array([[0.0, 0, -1], [1, 0, -1], [1, 1, -1], [0, 1, -1]])
    square += np.array([shift, shift, -1e-9])
    triangles = square[[[0, 1, 2], [2, 3, 0]]]
    triangles[1] += 1e-14
    gaps = _gaps(triangles, np.full(2, 0.1))
    assert sorted(gaps.reshape(-1).tolist()) == [0.0, 0.0, 0.2, 0.2, 0.2, 0.2]
    # flat patches have none, next to curved ones
    gaps = _gaps(triangles, np.array([0.1, 0.0]))
    assert sorted(gaps.reshape(-1).tolist()) == [0.0, 0.0, 0.0, 0.0, 0.2, 0.2]


def test_elements_are_positive_only_if_bounds_exceed_their_error():
    """A bound equal to its error, 0 among them, proves nothing; neither does one below 0 by no more than that."""
    lower, error = np.array([0.0, 0.1, 0.11, -0.1, -0.11]), np.array([0.0, 0.1, 0.1, 0.1, 0.1])
    facts = SimpleNamespace(lower=lower, minimum=lower, error=error, is_finite=np.ones(5, bool))
    status = _Facts.status.fget(facts).tolist()
    undecided = ValidityStatus.UNDECIDED
    assert status == [undecided, undecided, ValidityStatus.POSITIVE, undecided, ValidityStatus.NOT_POSITIVE]


@pytest.mark.parametrize(("part", "is_rounding"), [(1.0, True), (1.01, False)])
def test_minima_up_to_twice_their_error_are_zero_within_rounding(part, is_rounding):
    found = SimpleNamespace(status=[ValidityStatus.UNDECIDED], minimum=[part * 0.25], error=[0.125])
    assert (Validity.reason(found, 0) == "its Jacobian is zero within rounding") == is_rounding


def test_ranges_of_several_parts_contain_all_of_them():
    first, second = Range(0.0, 4.0, 1.0, 3.0), Range(-1.0, 3.5, 0.5, 3.2)
    for found in (_widest(first, None, second), _widest(second, first)):
        assert found == Range(-1.0, 4.0, 0.5, 3.2)
    assert _widest(None) is None


def test_waves_of_large_arguments_attain_their_extrema():
    """Between two adjacent numbers with a place 2 k pi + pi / 2 of the maximum between them, and with the minimum."""
    pi = Fraction("3.14159265358979323846264338327950288419716939937510582")
    for k in range(10**9, 10**9 + 200):
        for part, end in ((Fraction(1, 2), 1), (Fraction(-1, 2), 0)):
            place = (2 * k + part) * pi
            low = float(place)
            low = low if Fraction(low) <= place else np.nextafter(low, 0.0)
            found = intervals.sine((np.array([low]), np.nextafter(np.array([low]), np.inf)))
            assert found[end][0] == 2 * end - 1


def test_sums_of_squares_are_fitted():
    """Of nearly linear polynomials, and 0.1, which is found although coefficients are negative."""
    rng, (s, t) = np.random.default_rng(1), np.meshgrid(*[np.linspace(0, 1, 3)] * 2, indexing="ij")
    bounds = []
    for _ in range(10):
        a, b = rng.uniform(0.3, 0.7, 2)
        first, second = s - a + 0.5 * (t - b), 2 * (t - b)
        roots = [own + rng.uniform(-0.1, 0.1, (3, 3)) for own in (first, second)]
        net = 0.1 + sum(squares._square(root) for root in roots)
        assert net.min() < 0
        bounds.append(squares._without_squares(net))
    assert min(bounds) > 0.09
    assert max(bounds) <= 0.1
    # most fits are exact up to rounding
    assert 0.1 - np.median(bounds) < 1e-12


def test_middle_eigenvalues_are_rounded_by_the_size_of_their_matrix(monkeypatch):
    """Entries that are known exactly leave rounding alone."""
    monkeypatch.setattr(intervals, "_ROUNDING", 2.0**-10)
    entries = np.array([1.0, -2.0, 3.0, 0.5, -0.25, 4.0])
    low, high = intervals.middle_eigenvalue(lambda *entries: entries[0])(*((each, each) for each in entries))
    rounding = 2.0**-10 * np.abs(entries).sum()
    assert (low, high) == (1.0 - rounding, 1.0 + rounding)


def test_squares_of_imaginary_roots_are_off_in_proportion_to_their_operands(monkeypatch):
    """By a part of |a| + |b|^(2/3), below and above."""
    monkeypatch.setattr(intervals, "_ROUNDING", 0.01)
    a, b = np.random.default_rng(3).uniform(-2, 2, (2, COUNT))
    low, high = intervals.imaginary_root(lambda a, b: np.full_like(a, 2.0))((a, a), (b, b))
    room = 0.01 * (np.abs(a) + np.abs(b) ** (2 / 3))
    assert low**2 == pytest.approx(4 - room, rel=1e-12)
    assert high**2 == pytest.approx(4 + room, rel=1e-12)


def test_ends_of_curves_are_off_by_twice_the_tolerance_of_places(monkeypatch):
    """Where an expression, here 3, stops having values, relative to the length of what has some."""

    def at(t):
        return t[:, None] * [1.0, 0.0, 0.0], np.tile([1.0, 0.0, 0.0], (len(t), 1))

    def values(t):
        return np.where(t < 0.3, 3.0, np.nan)[:, None]

    piece = SimpleNamespace(curve=SimpleNamespace(at=at, parts=1), intervals=4, values=lambda *_: values)
    found = []
    for tolerance in (0.0, 0.1):
        monkeypatch.setattr(along_curves, "TOLERANCE", tolerance)
        found.append(along_curves.along_curve(piece, None, [None], 1e-3))
    assert 0.29 < found[1].measure[0] < 0.31
    assert found[1].error - found[0].error == pytest.approx(2 * 0.1 * 3.0 * found[1].measure, rel=1e-9)


@pytest.mark.parametrize("count", [1, 4, 9])
def test_roundings_in_a_row_are_off_by_no_more_than_gamma(count):
    """A product with so many roundings towards zero, undone by a quotient, is off by exactly that."""
    unit = 2.0**-4
    assert gamma(count, unit) == pytest.approx(1 / (1 - count * unit) - 1, rel=1e-14)
    assert (1 - unit) ** -count - 1 <= gamma(count, unit)


def test_eigenvalues_are_known_unless_a_left_eigenvector_may_be_normal_to_the_first_axis():
    """Of matrices with complex eigenvalues, and 0 with one that is normal to it, or at an obtuse angle to the right."""
    turning = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    basis = np.array([[1.0, 1, 0], [2, 1, 0], [0, 0, 1]])
    assert np.linalg.inv(basis)[0, 0] < 0
    oblique = basis @ turning[::-1, ::-1] @ np.linalg.inv(basis)
    matrices = np.array([turning, turning[::-1, ::-1], oblique])
    nothing = MatrixRange(np.zeros((3, 3, 3)), np.zeros((3, 3, 3)))
    known = Eigenvalue.of(MatrixRange(matrices, 1e-3 * np.array([0, 1, 1])[:, None, None] * np.ones((3, 3))), [nothing])
    assert known.is_known.tolist() == [False, True, True]


def test_rounding_of_products_in_core_boxes_is_that_of_magnitudes():
    """A gradient of the other sign has products of the other sign."""
    rng = np.random.default_rng(4)
    above, gradient = rng.normal(size=(2, 3, 2, 2, 2)), rng.normal(size=(2, 9, 2, 2, 2))
    one, other = (CoreBoxes.whole(np.arange(2), above, sign * gradient, np.zeros(2), True) for sign in (1, -1))
    assert np.array_equal(one.crossed, -other.crossed)
    assert np.array_equal(one.crossed_error, other.crossed_error)
    assert np.array_equal(one.turned_error, other.turned_error)


@pytest.mark.parametrize(("error", "slope_error"), [(0.1, 0.0), (0.0, 0.1)])
def test_graphs_are_off_by_errors_of_the_eigenvalue_and_of_its_slopes(monkeypatch, error, slope_error):
    """The one times the velocity and its slopes, the other times the velocity, in slopes alone."""
    eigenvalue = Eigenvalue(np.ones(COUNT, bool), np.full(COUNT, error), np.full((COUNT, 3), slope_error))
    monkeypatch.setattr(core_graphs, "Eigenvalue", SimpleNamespace(of=lambda *_: eigenvalue))
    boxes = replace(core_boxes(np.random.default_rng(2)), turned_error=np.full((COUNT, 3), 0.05))
    graphs = by_eigenvalue(boxes, None)
    sizes = np.abs(boxes.above).max(axis=(2, 3, 4))
    off = (0.05 + error * sizes)[..., None]
    assert graphs.errors == pytest.approx((np.abs(graphs.combining) @ off)[..., 0], rel=1e-12)
    slopes = [np.abs(np.diff(boxes.above, axis=2 + k)).max(axis=(2, 3, 4)) for k in range(3)]
    off = error * np.stack(slopes, axis=2) + slope_error * sizes[..., None]
    assert graphs.slope_errors == pytest.approx(np.abs(graphs.combining) @ off, rel=1e-12)


def test_values_on_real_boxes_are_within_the_first_radius():
    """Radii on ellipses, which are larger, follow it."""
    middle, radius = np.array([[0.5], [-1.0]]), np.array([[0.5, 2.0], [0.25, 3.0]])
    parts = SimpleNamespace(_leaf=lambda node: SimpleNamespace(disc=(middle, radius)), count=2)
    low, high = BoxDiscs.interval(parts, Expression.of(Dataset(grid(Shape.HEXAHEDRON, 1)), "x").root)
    assert low.tolist() == [0.0, -1.25]
    assert high.tolist() == [1.0, -0.75]
