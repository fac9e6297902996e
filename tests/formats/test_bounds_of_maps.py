"""Bounds of maps, their inverses and their determinants: values lie within them, some near their ends (claims.py)."""

from dataclasses import replace
from itertools import permutations, product
from types import SimpleNamespace

import numpy as np
import pytest
from claims import TEETH, check
from numpy.polynomial.chebyshev import chebvander

from elvis.core.cores import turning as core_turning
from elvis.core.cores.boxes import Boxes as CoreBoxes
from elvis.core.cores.graphs import by_rotation
from elvis.core.cores.matrix_ranges import Eigenvalue, MatrixRange
from elvis.core.cores.outer_sides import OuterSides
from elvis.core.cores.parallel import ParallelVectors, rotations
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.subcells import subcell_map
from elvis.core.mapping import enclosure, pointwise
from elvis.core.mapping.enclosure import _Cells, _contracted, _root_bounds
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.margins import facets, heights
from elvis.core.mapping.newton import heights_rounding
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.bernstein import BernsteinSpace
from elvis.core.polynomials.boxnets import on_lattice
from elvis.core.polynomials.evaluation import evaluate_with_gradients
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.expansion import values as mode_values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.net_zeros import values_of, without_walls
from elvis.core.polynomials.rounding import halving_roundings, raising_roundings, value_roundings
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.shapes import Shape
from elvis.core.streamlines import first_steps
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.core.validity import descent, determinants, enclosed_determinants, regularity, squares, validity
from elvis.core.validity.determinants import Polynomials

COUNT = 40
#: invariants are bounded by coefficients, which are larger than values
WIDE = {"approximations_of_invariants": 0.4}
#: unit roundoff of the model
COARSE = 2.0**-11
LINE = np.linspace(0, 1, 9)


def roots_in_cells(rng):
    """Of maps that are linear but for a bend, off by a slack in each coordinate: at its ends."""
    for d, bend in ((2, 0.0), (3, 0.0), (2, 0.05), (3, 0.05)):
        matrix = np.eye(3)[:, :d] + rng.uniform(-0.2, 0.2, (COUNT, 3, d))
        matrix[:, d:] = 0.0
        places = np.stack(np.meshgrid(*[np.linspace(0, 1, 3)] * d, indexing="ij"), axis=-1)
        bends = bend * rng.uniform(-1, 1, (COUNT, *(3,) * d, 3)) * (np.arange(3) < d)
        maps = np.einsum("nki,...i->n...k", matrix, places) + bends
        t, slack = rng.uniform(0.3, 0.7, (COUNT, d)), rng.uniform(0.01, 0.05, COUNT)
        # the map less its value at t, and less what makes the root move along each axis by most
        values = np.stack([at(maps[..., k], t) for k in range(3)], axis=1)
        inverse = np.linalg.pinv(matrix)
        for axis in range(d):
            for way in (-1, 1):
                off = way * slack[:, None] * np.sign(inverse[:, axis])
                net = maps - (values + off).reshape(COUNT, *(1,) * d, 3)
                net = np.moveaxis(net, (0, -1), (-1, 0))
                # direction i of a cell's net is axis -2 - i
                net = np.moveaxis(net, range(1, d + 1), range(d, 0, -1))
                cells = _Cells(np.arange(COUNT), np.zeros((COUNT, d)), np.ones((COUNT, d)), np.ascontiguousarray(net))
                lower, upper, is_linear = _root_bounds(cells, slack)
                assert is_linear.all()
                middle, half = (lower + upper)[:, axis] / 2, (upper - lower)[:, axis] / 2
                yield np.abs(t[:, axis] - middle), half * (1 + 1e-9)


def at(nets, t):
    """(n,) values of nets (n, 3, …) of degree 2 at places t (n, d) of their own."""
    for axis in range(t.shape[1]):
        s = t[:, axis]
        weights = np.stack([(1 - s) ** 2, 2 * s * (1 - s), s**2], axis=1)
        nets = np.einsum("na...,na->n...", nets, weights)
    return nets


def heights_of_moved_points(rng):
    """Of points whose coordinates are off, at the corners of what they may be."""
    for shape in (Shape.TRIANGLE, Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON):
        d = shape.dimension
        duals, rounding = rng.normal(size=(COUNT, 3, d)), rng.uniform(0.1, 1, COUNT)
        steps = np.stack(np.meshgrid(*[[-1, 1]] * 3, indexing="ij")).reshape(3, -1)
        own = np.zeros((1, d))
        moved = np.einsum("nci,cs,n->nsi", duals, steps, rounding).reshape(-1, d)
        away = np.abs(heights(shape, moved) - heights(shape, own)).reshape(COUNT, 8, -1).max(axis=1)
        bound = heights_rounding(shape, duals, rounding)
        for facet in range(away.shape[1]):
            yield away[:, facet], bound[:, facet]


def sums_and_products_of_polynomials(rng):
    """Of polynomials that are off by what they say, in opposite ways."""
    spaces = BernsteinSpace(Shape.TRIANGLE, (2,)), BernsteinSpace(Shape.TRIANGLE, (1,))
    first, second = (
        Polynomials(space, rng.normal(size=(space.count, COUNT)), rng.uniform(0.05, 0.2, COUNT)) for space in spaces
    )
    other = Polynomials(first.space, rng.normal(size=first.net.shape), rng.uniform(0.05, 0.2, COUNT))
    operations = [(lambda a, b: a + b, other), (lambda a, b: a - b, other), (lambda a, b: a * b, second)]
    for operation, operand in operations:
        found = operation(first, operand)
        for one in (-1, 1):
            for two in (-1, 1):
                pair = [moved(own, way) for own, way in ((first, one), (operand, two))]
                yield np.abs(operation(*pair).net - found.net).max(axis=0), found.error


def moved(own, way):
    return Polynomials(own.space, own.net + way * own.error, np.zeros(COUNT))


def eigenvalues_of_two_entries(rng):
    """[[0, a], [b, d]] and another eigenvalue: all that an error is divided by is as small as it may be."""
    for a in rng.uniform(0.12, 0.16, 20):
        radius = np.zeros((1, 3, 3))
        radius[0, [0, 1], [1, 0]] = a
        middle = np.diag([0.0, 1.0, 1.5])[None]
        slope = np.zeros((1, 3, 3))
        slope[0, 0, 1] = 1.0
        known = Eigenvalue.of(MatrixRange(middle, radius), [MatrixRange(slope, 0 * slope)] * 3)
        assert known.is_known.all()
        # y^2 - y + a b = 0 with b = -a and b = a
        for both in (-a * a, a * a):
            value = (1 - np.sqrt(1 + 4 * both)) / 2
            yield np.array([abs(value)]), known.error
            yield np.array([a / abs(2 * value - 1)]), known.slope_error[:, 0]


def eigenvalues_of_one_entry(rng):
    """A product of one entry and a constant, in which nothing is taken twice; and a start next to the first entry."""
    for x in rng.uniform(0.02, 0.03, 20):
        middle, radius = np.array([[[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 1.9]]]), np.zeros((1, 3, 3))
        radius[0, 1, 0] = x
        nothing = [MatrixRange(0 * middle, 0 * radius)] * 3
        known = Eigenvalue.of(MatrixRange(middle, radius), nothing)
        assert known.is_known.all()
        found = [np.linalg.eigvals(middle[0] + way * radius[0]) for way in (-1, 1)]
        yield np.array([max(abs(own[np.abs(own.imag).argmin()].real) for own in found)]), known.error
        # an eigenvalue that differs from the first entry, next to complex ones
        middle[0] = [[0.0, 1.0, 0.0], [-x, 1.0, -2.0], [0.0, 2.0, 1.5]]
        start = Eigenvalue.of(MatrixRange(middle, 0 * radius), nothing)
        assert start.is_known.all()
        values = np.linalg.eigvals(middle[0])
        yield np.abs(values[np.abs(values.imag).argmin()].real)[None], start.error


def approximations_of_invariants(rng):
    """Of a higher degree than three: off by their error at most."""
    nets = rng.uniform(-1, 1, (COUNT, 1, 5, 5, 5)) + 9 * (-1.0) ** np.indices((5, 5, 5)).sum(axis=0)
    found, error = core_turning._reduced(nets)
    assert found.shape[2] == 4
    away = np.abs(on_lattice(found[:, 0], LINE) - on_lattice(nets[:, 0], LINE)).max(axis=(1, 2, 3))
    yield away, error


def errors_of_quick_determinants(rng):
    """Entries that are off, each the way that moves the determinant most: of the largest one of ones and minus ones."""
    space = BernsteinSpace(Shape.HEXAHEDRON, (1, 1, 1))
    matrix = np.array([[-1.0, 1, 1], [1, -1, 1], [1, 1, -1]])
    off = rng.uniform(0.01, 0.02, COUNT)
    ways = np.sign(np.linalg.inv(matrix).T)
    columns = [
        [Polynomials(space, np.full((space.count, COUNT), matrix[i, k]), off) for i in range(3)] for k in range(3)
    ]
    moved_matrices = matrix + ways * off[:, None, None]
    yield np.abs(np.linalg.det(moved_matrices) - np.linalg.det(matrix)), enclosed_determinants._error(columns)


def quotients_on_pyramids(rng):
    """Derivatives that are off each way, divided by what their coefficients have in common towards the apex."""
    space = BernsteinSpace(Shape.PYRAMID, (2, 2, 3))
    nets, errors = rng.uniform(-1, 1, (COUNT, 3, space.count)), rng.uniform(0.05, 0.2, (COUNT, 3))
    _, divided, found = determinants._divide(space, nets, errors)
    ways = rng.choice([-1.0, 1.0], nets.shape)
    moved_nets = determinants._divide(space, nets + errors[..., None] * ways, errors)[1]
    yield np.abs(moved_nets - divided).max(axis=2), found


CLAIMS = [
    errors_of_quick_determinants,
    quotients_on_pyramids,
    roots_in_cells,
    heights_of_moved_points,
    sums_and_products_of_polynomials,
    eigenvalues_of_two_entries,
    eigenvalues_of_one_entry,
    approximations_of_invariants,
]


@pytest.mark.parametrize("claim", CLAIMS)
def test_values_lie_within_bounds_and_some_near_their_ends(claim):
    check(claim, WIDE.get(claim.__name__, TEETH))


def test_rounding_of_quick_determinants_is_relative_to_their_largest_value(monkeypatch):
    """The mean is off as far as its sum may be, which lowers all values, also those at the corner (1, 1, 1)."""
    (block,) = geometry(Dataset(curved(grid(Shape.HEXAHEDRON, 1), lambda points: points**4, 5)))
    largest = enclosed_determinants.enclosures(block.expansion, block.coefficients).maximum
    # of these sums only, not of those of the net
    of_net = 3 * (enclosed_determinants.LOW + enclosed_determinants._ENTRY)
    monkeypatch.setattr(enclosed_determinants, "gamma", lambda count: count * COARSE if count > of_net else 0.0)
    monkeypatch.setattr(enclosed_determinants, "_error", lambda columns: np.zeros(1))
    exact, is_series = enclosed_determinants.along_axes, iter([*[False] * 9, True, *[False] * 9])

    def rounded(values, *tables):
        found = exact(values, *tables)
        if not next(is_series):
            return found
        of_sums = sum(len(table) for table in tables) * COARSE * exact(np.abs(values), *map(np.abs, tables))
        found[:, 0, 0, 0] -= of_sums[:, 0, 0, 0]
        return found

    monkeypatch.setattr(enclosed_determinants, "along_axes", rounded)
    assert (enclosed_determinants.enclosures(block.expansion, block.coefficients).upper >= largest).all()


@pytest.mark.parametrize(("part", "is_empty"), [(0.99, False), (1.01, True)])
def test_cells_with_images_beyond_the_slack_have_no_root(part, is_empty):
    """In one coordinate, at the one end or at the other; the map is constant there."""
    for way in (-1, 1):
        for coordinate in range(3):
            net = np.zeros((3, 2, 2, 1))
            net[coordinate] = way * part * 0.1
            cells = _Cells(np.arange(1), np.zeros((1, 2)), np.ones((1, 2)), net)
            lower, upper, _ = _root_bounds(cells, np.full(1, 0.1))
            assert (lower > upper).any() == is_empty


@pytest.mark.parametrize(("part", "is_kept"), [(0.99, True), (1.01, False)])
def test_roots_beyond_the_slanted_side_are_kept_within_reach(part, is_kept):
    """The map of a triangle is the identity; the target is where coordinates add up to more than 1."""
    place = 0.5 + 0.05 * part
    net = np.zeros((3, 2, 2, 1))
    net[0, :, :, 0], net[1, :, :, 0] = np.array([[0.0], [1.0]]) - place, np.array([0.0, 1.0]) - place
    cells = _Cells(np.arange(1), np.zeros((1, 2)), np.ones((1, 2)), net)
    tiny = np.full(1, 1e-9)
    targets = SimpleNamespace(precision=tiny, distance=tiny, patch=SimpleNamespace(shape=Shape.TRIANGLE))
    assert len(_contracted(cells, targets, np.full(1, 0.1))[0]) == is_kept


@pytest.mark.parametrize("degrees", [(1,), (3,)])
def test_all_roundings_of_products_are_counted(monkeypatch, degrees):
    """All terms of one sign, each product, sum and weight rounded away from zero."""
    monkeypatch.setattr(determinants, "UNIT", COARSE)
    space = BernsteinSpace(Shape.TRIANGLE, degrees)
    ones = Polynomials(space, np.ones((space.count, 1)), np.zeros(1))
    # a weight times each factor, their product, sums of as many terms as the shorter factor has, and a quotient
    away = (1 + COARSE) ** (2 + 1 + space.count + 1) - 1
    (bound,) = (ones * ones).error
    assert bound / 8 < away <= bound
    (bound,) = (ones + ones).error
    assert 2 * COARSE <= bound < 2.1 * COARSE


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.HEXAHEDRON, Shape.PYRAMID])
def test_all_roundings_of_derivatives_are_counted(monkeypatch, shape):
    """Modal coefficients of one size: entries, products and sums of modes, differences, and multiples of degrees."""
    monkeypatch.setattr(determinants, "UNIT", COARSE)
    d, degree = shape.dimension, 3
    expansion = modified(shape, (degree + 1,) * d)
    count = determinants.to_bernstein(expansion).shape[0]
    coefficients = np.random.default_rng(1).choice([-1.0, 1.0], (COUNT, 3, count))
    columns = determinants.tangents(expansion, coefficients)
    size = np.abs(coefficients) @ np.abs(determinants.to_bernstein(expansion)).max(axis=1)
    # sums of modes, those of one direction after the other on hexahedra, and entries with 4 roundings a direction
    roundings = (d * (degree + 1) if shape is Shape.HEXAHEDRON else count) + 4 * d
    for direction, column in enumerate(columns):
        for axis, own in enumerate(column):
            # both coefficients of a difference, times half the degree; the difference and the product
            off = degree * size[:, axis] * ((1 + COARSE) ** roundings - 1)
            is_divided = shape is Shape.PYRAMID and direction < 2
            away = off * (degree if is_divided else 1)
            assert (away <= own.error).all()
            assert (own.error <= 4 * away + 8 * COARSE * np.abs(own.net).max()).all()


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON, Shape.PYRAMID])
def test_all_roundings_of_control_matrices_are_counted(monkeypatch, shape):
    """Raised to one size, bisected in every direction as often as is allowed; on pyramids sums before that."""
    monkeypatch.setattr(regularity, "UNIT", COARSE)
    exact = [[] for _ in range(3)]
    for direction in range(3):
        degrees = (2, 2, 1) if shape is Shape.PYRAMID and direction < 2 else (2, 2, 2)
        space = BernsteinSpace(shape, degrees[: 1 if shape is Shape.TETRAHEDRON else 3])
        exact[direction] = [Polynomials(space, np.ones((space.count, 1)), np.zeros(1)) for _ in range(3)]
    controls, error = regularity._controls(exact, 3)
    sizes = controls.shape[3:]
    count = raising_roundings(sizes) + regularity.HALVINGS * halving_roundings(sizes)
    if shape is Shape.PYRAMID:
        # a product of a net with (0, 1) or (1, 1), raised, and two sums
        count += 2 * (3 + 1) + raising_roundings(sizes)
    # the Frobenius norm of nine entries
    away = 3 * np.abs(controls).max() * ((1 + COARSE) ** count - 1)
    assert (away <= error).all()
    assert (error <= 4 * away).all()


def _lattice(dimension, count):
    """(count^dimension, dimension) evenly spaced points."""
    line = np.linspace(-1, 1, count)
    return np.stack(np.meshgrid(*[line] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)


@pytest.mark.parametrize("shape", [Shape.SEGMENT, Shape.QUADRILATERAL, Shape.HEXAHEDRON])
def test_slopes_are_within_their_deviation(shape):
    """Random coefficients stay within it; modes 2 to 4 of the first direction attain it at a vertex."""
    d = shape.dimension
    expansion = modified(shape, (5, 4, 3)[:d])
    coefficients = np.random.default_rng(d).normal(size=(COUNT + 3, d, mode_count(expansion)))
    coefficients[COUNT:] = np.eye(5, mode_count(expansion))[2:, None]
    slopes = evaluate_with_gradients(expansion, coefficients, _lattice(d, 9))[1]
    net = coefficients.reshape(len(coefficients), d, *expansion.modes[::-1])
    for direction in range(d):
        means, bounds = regularity._slope(np.moveaxis(net, -1 - direction, 2))
        away = np.abs(slopes[..., direction] - means[:, :, None]).max(axis=2)
        assert (away <= bounds * (1 + 1e-12)).all()
        assert direction or (away >= 0.999 * bounds)[COUNT:].all()


@pytest.mark.parametrize("bend", [0.99, 1.01])
@pytest.mark.parametrize("shape", [Shape.SEGMENT, Shape.QUADRILATERAL, Shape.HEXAHEDRON])
def test_maps_are_nearly_affine_until_they_fold(shape, bend):
    """The Jacobian is 1 + bend xi1, and its mean 1."""
    expansion, nodes = modified(shape, (3,) * shape.dimension), _lattice(shape.dimension, 3)
    places = nodes.copy()
    places[:, 0] += bend * nodes[:, 0] ** 2 / 2
    coefficients = np.linalg.solve(mode_values(expansion, nodes), places).T[None]
    assert regularity._are_nearly_affine(expansion.modes, coefficients).tolist() == [bend < 1]


@pytest.mark.parametrize("part", [0.99, 1.01])
@pytest.mark.parametrize("directions", [1, 2, 3])
def test_matrices_are_definite_up_to_their_error(part, directions):
    """The smallest eigenvalue of the symmetric part against the error, which P magnifies by its norm."""
    rng = np.random.default_rng(directions)
    turns = np.linalg.qr(rng.normal(size=(COUNT, directions, directions)))[0]
    eigenvalues = rng.uniform(1, 2, (COUNT, directions))
    matrices = np.einsum("nik,nk,njk->nij", turns, eigenvalues, turns)
    skew = rng.normal(size=matrices.shape)
    matrices = matrices + skew - skew.swapaxes(1, 2)
    inverse = np.tile(2 * np.eye(directions), (COUNT, 1, 1))
    least = 2 * eigenvalues.min(axis=1)
    error = part * least / (2 * np.sqrt(directions))
    controls = np.stack([matrices, matrices + np.eye(directions)], axis=3)
    assert (regularity._are_definite(inverse, controls, error) == (part < 1)).all()
    # whatever the other eigenvalues are
    eigenvalues[:, 0] = -0.1 * np.sign(part - 1)
    matrices = np.einsum("nik,nk,njk->nij", turns, eigenvalues, turns)
    assert (regularity._are_definite(inverse, matrices[..., None], np.zeros(COUNT)) == (part < 1)).all()


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_walls_are_zero_to_rounding(part):
    """Heights over a side are divided out if all of the vector is zero there, relative to its largest component."""
    rng = np.random.default_rng(3)
    for axis in range(3):
        for end in (0, 1):
            height = np.linspace(0, 1, 2) if end == 0 else np.linspace(1, 0, 2)
            net = 1 + rng.uniform(0, 1, (1, 3, 2, 2, 2))
            net *= height.reshape(-1, *(1,) * (2 - axis))
            size = np.abs(net).max()
            moved = np.moveaxis(net, 2 + axis, -1)
            moved[0, 1, 0, 1, -end] = part * 1e-11 * size
            for sign in (1, -1):
                found, _ = without_walls(sign * net, np.abs(net).max(axis=(1, 2, 3, 4)))
                # divided, it doesn't vanish on the side any more
                at_side = np.abs(np.moveaxis(found, 2 + axis, -1)[..., -end]).min()
                assert (at_side > 0.4) == (part < 1)


def test_velocity_at_walls_is_that_divided_by_heights_over_them():
    """Each box has its own walls: heights times what is found are the velocity all over it."""
    rng, shape = np.random.default_rng(5), (3, 4, 2)
    walls = np.array(list(product(range(2), repeat=6)), bool).reshape(-1, 3, 2)
    walls = walls[~walls.all(axis=2).any(axis=1)]
    nets = rng.normal(size=(len(walls), 2, *shape))
    places = rng.uniform(size=(len(walls), 3))
    heights = np.ones(len(walls))
    for axis, end in product(range(3), range(2)):
        outer = [slice(None)] * 5
        outer[2 + axis] = -end
        rows = np.flatnonzero(walls[:, axis, end])
        nets[(rows, *outer[1:])] = 0.0
        heights[rows] *= (1 - places[rows, axis]) if end else places[rows, axis]
    values = np.concatenate([values_of(nets[i : i + 1], places[i : i + 1]) for i in range(len(walls))])
    found, on_side = without_walls(nets, np.abs(nets).max(axis=(1, 2, 3, 4)))
    assert np.array_equal(on_side, walls)
    divided = np.concatenate([values_of(found[i : i + 1], places[i : i + 1]) for i in range(len(walls))])
    assert heights[:, None] * divided == pytest.approx(values, rel=1e-12, abs=1e-13)
    assert np.array_equal(found[~walls.any(axis=(1, 2))], nets[~walls.any(axis=(1, 2))])


@pytest.mark.parametrize("part", [0.99, 1.01])
def test_flows_turn_less_than_the_imaginary_part_of_their_eigenvalues(part):
    """Of constant gradients with eigenvalues a and b +- i v, in any basis."""
    rng = np.random.default_rng(4)
    bases = rng.normal(size=(COUNT, 3, 3))
    a, b, v = rng.uniform(-1, 1, (3, COUNT))
    middle = np.zeros((COUNT, 3, 3))
    middle[:, 0, 0], middle[:, 1, 1], middle[:, 2, 2], middle[:, 1, 2], middle[:, 2, 1] = a, b, b, v, -v
    gradient = np.einsum("nij,njk,nkl->nil", bases, middle, np.linalg.inv(bases)).reshape(COUNT, 9, 1, 1, 1)
    gradient = np.tile(gradient, (2, 2, 2))
    above = np.ones((COUNT, 3, 2, 2, 2))
    boxes = CoreBoxes.whole(np.arange(COUNT), above, gradient, np.abs(v) / part, False)
    assert (core_turning.turns_less(boxes) == (part < 1)).all()


@pytest.mark.parametrize("off", [1.9e-6, 2.1e-6])
def test_places_are_on_outer_sides_to_within_a_tolerance(off):
    shape = Shape.HEXAHEDRON
    normals, offsets = facets(shape)
    neighbours = SimpleNamespace(
        is_outer=lambda patch, row, side: side != 1,
        facets=lambda patch: (normals, offsets),
        boundary=lambda patch, row, side: np.where(side == 2, -1, side),
        names=[f"side {number}" for number in range(6)],
    )
    own = OuterSides([Sized(shape)], [np.arange(8)[None]], neighbours)
    assert own.boundary(0, 0, np.zeros(3)) is None
    for side, corners in enumerate(shape.faces):
        middle = shape.vertices[list(corners)].mean(axis=0)
        # heights are half of what reference coordinates are
        name = own.boundary(0, 0, middle * (1 - 2 * off))
        if off > 2e-6 or side == 1:
            assert name is None
        else:
            assert name == ("left" if side == 2 else f"side {side}")


class Sized(SimpleNamespace):
    """A patch of one element."""

    def __init__(self, shape):
        super().__init__(shape=shape)

    def __len__(self):
        return 1


def test_polynomials_are_not_subdivided_below_their_error(monkeypatch):
    """A bound that is as near as rounding, or as the tolerance, is near enough."""
    monkeypatch.setattr(descent._Boxes, "halves", lambda self: 1 / 0)
    net = np.array([[1.0, 0.95, 1.0]])
    for error in (0.1, 0.06):
        found = descent.least(net, np.full(1, error), np.full(1, 9.0))
        assert found.lower[0] == 0.95
        assert found.value[0] == 1.0
    with pytest.raises(ZeroDivisionError):
        descent.least(net, np.full(1, 0.04), np.full(1, 9.0))


def test_rotation_of_flows_includes_rounding_of_their_invariants(monkeypatch):
    """In a shear layer, where gradients are large next to their eigenvalues: y and r off by parts of its powers."""
    part = 1e-6
    monkeypatch.setattr(core_turning, "_ROUNDING", part)
    gradient = np.zeros((1, 3, 3))
    gradient[0] = [[0.1, 0.0, 0.0], [0.0, -0.05, 20.0], [0.0, -0.05, -0.05]]
    flat = np.tile(gradient.reshape(1, 9, 1, 1, 1), (2, 2, 2))
    scale, above = np.linalg.norm(gradient), np.ones((1, 3, 2, 2, 2))
    reduced = gradient[0] - np.trace(gradient[0]) / 3 * np.eye(3)
    y, r = np.trace(reduced @ reduced) / 2, np.linalg.det(reduced)
    for y_off, r_off in ((-1, 0), (0, 1), (0, -1)):
        roots = np.roots([1.0, 0.0, -(y + y_off * part * scale**2), -(r + r_off * part * scale**3)])
        least = np.abs(roots.imag).max() * (1 - 1e-7)
        boxes = CoreBoxes.whole(np.zeros(1, int), above, flat, np.array([least]), False)
        assert not core_turning.turns_less(boxes)[0]
        assert core_turning.turns_less(replace(boxes, least=boxes.least * 1.2))[0]


def test_graphs_by_rotation_are_decided_if_all_rotations_agree():
    """The worst entries of gradients within their ranges, all corners of which are tried."""
    rng = np.random.default_rng(8)
    wide = rng.uniform(0.3, 1.5, (COUNT, 1, 1, 1, 1)) * rng.uniform(-1, 1, (COUNT, 9, 2, 2, 2))
    gradient = rng.normal(size=(COUNT, 9, 1, 1, 1)) + wide
    boxes = CoreBoxes.whole(np.arange(COUNT), rng.normal(size=(COUNT, 3, 2, 2, 2)), gradient, np.zeros(COUNT), False)
    known = by_rotation(boxes, None).is_known
    ranges = MatrixRange.of_nets(gradient)
    normal = rotations(ranges.middle)
    rows, columns = [0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]
    worst = np.full(COUNT, np.inf)
    for signs in product([-1, 1], repeat=6):
        moved = ranges.middle.copy()
        moved[:, rows, columns] += np.array(signs) * ranges.radius[:, rows, columns]
        worst = np.minimum(worst, np.einsum("ni,ni->n", rotations(moved), normal))
    assert np.array_equal(known, worst > 0)
    assert 0.2 < known.mean() < 0.8


@pytest.mark.parametrize("axis", range(3))
def test_halves_of_boxes_have_their_ends_and_end_values(axis):
    rng = np.random.default_rng(axis)
    gradient, above = rng.normal(size=(COUNT, 9, 3, 3, 3)), rng.normal(size=(COUNT, 3, 3, 3, 3))
    boxes = CoreBoxes.whole(np.arange(COUNT), above, gradient, np.zeros(COUNT), True)
    halves = boxes.halved(axis).halved(axis)
    places = rng.uniform(size=(len(halves), 3))
    there = halves.low + (halves.high - halves.low) * places
    for name in ("above", "gradient", "crossed", "turned", "square", "cubic"):
        found, own = values_of(getattr(halves, name), places), values_of(getattr(boxes, name)[halves.rows], there)
        assert np.abs(found - own).max() < 1e-10 * np.abs(own).max()
    for name in ("crossed", "turned"):
        greatest = np.abs(getattr(boxes, name)).max(axis=(2, 3, 4))
        assert np.allclose(1e13 * getattr(halves, f"{name}_error"), greatest[halves.rows], rtol=1e-12)
    assert np.bincount(halves.rows).tolist() == [4] * COUNT
    assert np.allclose(halves.high - halves.low, np.where(np.arange(3) == axis, 0.25, 1.0))
    assert sorted(halves.low[halves.rows == 0, axis].tolist()) == [0.0, 0.25, 0.5, 0.75]


@pytest.mark.parametrize(("part", "axis"), [(0.9, 0), (1.1, 1)])
def test_boxes_are_bisected_along_maximum_curvature_times_degree(part, axis):
    """Second differences of 1.5 and of 0.9 part, times 3 and 5."""
    net = np.zeros((1, 3, 5))
    net[0, 1, :] -= 0.75
    net[0, :, 2] -= 0.45 * part
    boxes = descent._Boxes.of(np.zeros(1, int), np.zeros((1, 2)), np.ones((1, 2)), net)
    assert boxes._axes().tolist() == [axis]


def test_bounds_by_squares_are_rounded_by_the_largest_magnitude(monkeypatch):
    """Without squares what is left is the net itself, whose largest number is negative here."""
    monkeypatch.setattr(squares, "_UNIT", COARSE)
    monkeypatch.setattr(squares, "_start", lambda net, values: (np.zeros((1, 3)), np.zeros(values.size)))
    monkeypatch.setattr(squares, "_fit_squares", lambda values, basis, roots, near: 0 * roots)
    net = np.array([[-8.0, 1.0, 0.5], [1.0, 1.0, 1.0], [0.0, 1.0, 2.0]])
    # 4 coefficients of a root, and 3 + 3 terms when it is raised
    assert squares._without_squares(net) == -8.0 - 4 * (4 + 6) * COARSE * 8.0


def test_all_roundings_of_quick_determinants_are_counted(monkeypatch):
    """Two products, a difference, and two sums of each of six terms; and the values that these are made of."""
    monkeypatch.setattr(enclosed_determinants, "gamma", lambda roundings: roundings * COARSE)
    space = BernsteinSpace(Shape.HEXAHEDRON, (1, 1, 1))
    ones = [[Polynomials(space, np.ones((space.count, 1)), np.zeros(1)) for _ in range(3)] for _ in range(3)]
    of_values = value_roundings([2, 2, 2]) * COARSE
    (found,) = enclosed_determinants._error(ones)
    size = 1 + of_values
    counted = 6 * (3 * of_values * size**2 + ((1 + COARSE) ** 5 - 1) * size**3)
    assert counted <= found <= 1.5 * counted
    monkeypatch.setattr(enclosed_determinants, "_DETERMINANT", 0)
    (found,) = enclosed_determinants._error(ones)
    assert found == pytest.approx(6 * 3 * of_values * size**2)
    monkeypatch.setattr(enclosed_determinants, "_DETERMINANT", 8)
    monkeypatch.setattr(enclosed_determinants, "value_roundings", lambda sizes: 0)
    (found,) = enclosed_determinants._error(ones)
    assert 6 * ((1 + COARSE) ** 5 - 1) <= found <= 2 * 6 * 5 * COARSE


def test_errors_of_quick_determinants_are_those_of_products_of_their_entries(monkeypatch):
    """Entries of any size that are off by parts of it, all in the worst way: in one column, and in all."""
    monkeypatch.setattr(enclosed_determinants, "gamma", lambda roundings: 0.0)
    space = BernsteinSpace(Shape.HEXAHEDRON, (1, 1, 1))
    rng = np.random.default_rng(8)
    sizes, parts = 10.0 ** rng.uniform(-1, 1, (3, 3)), 10.0 ** rng.uniform(-2, -1, (3, 3))
    nets = [[np.full((space.count, 1), size) for size in column] for column in sizes]
    ways = list(permutations(range(3)))
    for mask, room in [*((own, 1e-12) for own in np.eye(3)), (np.ones(3), 0.2)]:
        errors = mask[:, None] * parts * sizes
        columns = [
            [Polynomials(space, net, np.full(1, error)) for net, error in zip(*own, strict=True)]
            for own in zip(nets, errors, strict=True)
        ]
        (found,) = enclosed_determinants._error(columns)
        worst, exact = ([own[range(3), way].prod() for way in ways] for own in (sizes + errors, sizes))
        away = np.subtract(worst, exact).sum()
        assert away * (1 - 1e-12) <= found <= away * (1 + room)


@pytest.mark.parametrize(("part", "is_known"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("trace", [-1.9, 1.9])
def test_eigenvalues_are_identified_while_their_range_contains_no_other(trace, part, is_known):
    """One entry up to x and a constant 1: D = |P| x, and Q is at least 1 - x, so that 8 P^2 x <= (1 - x)^2."""
    ratio = 8 * trace**2 / part
    x = 1 + ratio / 2 - np.sqrt((1 + ratio / 2) ** 2 - 1)
    middle, radius = np.array([[[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, trace]]]), np.zeros((1, 3, 3))
    radius[0, 1, 0] = x
    nothing = [MatrixRange(0 * middle, 0 * radius)] * 3
    assert Eigenvalue.of(MatrixRange(middle, radius), nothing).is_known[0] == is_known


@pytest.mark.parametrize("off", [0.3, 0.5, 0.7])
def test_slopes_of_eigenvalues_are_divided_by_the_smallest_trace_of_cofactors(off):
    """[[0, a, 0], [0, 1, r], [0, r, 1]]: the derivative with respect to the entry below a is a / (1 - r^2)."""
    a = 1e-3
    middle, radius, slope = np.zeros((3, 1, 3, 3))
    middle[0, [1, 2], [1, 2]] = 1.0
    radius[0, [0, 0, 1, 2], [1, 0, 2, 1]] = a, 0.0, off, off
    slope[0, 1, 0] = 1.0
    known = Eigenvalue.of(MatrixRange(middle, radius), [MatrixRange(slope, 0 * slope)] * 3)
    assert known.is_known.all()
    exact = a / (1 - off**2)
    assert known.slope_error[0] == pytest.approx([exact] * 3, rel=1e-2)
    assert (known.slope_error >= exact * (1 - 1e-12)).all()


@pytest.mark.parametrize(("first", "is_known"), [(0.0, False), (0.1, True)])
def test_eigenvalues_need_eigenvectors_along_the_first_axis(first, is_known):
    """A left one (first, 1, 0) next to a right one (1, 1, 0); of the transposed matrix it is the right one."""
    bases = np.array([[1.0, 1.0, 0.0], [1.0, -first, 0.0], [0.0, 0.0, 1.0]])
    matrix = bases @ [[0.5, 0.0, 0.0], [0.0, 1.5, -2.0], [0.0, 2.0, 1.5]] @ np.linalg.inv(bases)
    for middle in (matrix[None], matrix.T[None]):
        nothing = MatrixRange(0 * middle, 0 * middle)
        assert Eigenvalue.of(MatrixRange(middle, 1e-12 + 0 * middle), [nothing] * 3).is_known[0] == is_known


#: places along a line, more than the largest degree
PLACES = (1 + np.cos(np.pi * (np.arange(30) + 0.5) / 30)) / 2


def beyond(values, degree):
    """Largest Chebyshev coefficient beyond a degree of values (k, m, 30) along lines, relative to the largest value."""
    table = chebvander(2 * PLACES - 1, len(PLACES) - 1)
    found = np.linalg.solve(table, values.reshape(-1, len(PLACES)).T)
    return np.abs(found[degree + 1 :]).max() / np.abs(values).max()


@pytest.mark.parametrize("velocity", [["u", "v", "w"], ["u/s", "v/s", "w/s"]], ids=["plain", "over density"])
@pytest.mark.parametrize("is_affine", [True, False])
@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON, Shape.PYRAMID])
def test_velocity_and_its_gradient_have_the_degrees_of_cores(shape, is_affine, velocity):
    """Along lines in boxes; gradients on curved elements times the determinant.  Lower degrees are too low."""
    rng = np.random.default_rng(3)
    mesh = curved(grid(shape, 1), (lambda p: p) if is_affine else ripple(0.1), 2 if is_affine else 3)
    waves = rng.uniform(-4, 4, (4, 3))
    fields = [
        approximated(Dataset(mesh), name, lambda p, k=k: 2 + np.sin(p @ waves[k] + k), 3 + k // 3)
        for k, name in enumerate("uvws")
    ]
    parallel = ParallelVectors(Dataset(mesh, tuple(fields)), velocity, "acceleration")
    patch = parallel.evaluator.patches[0]

    lines = np.tile(rng.uniform(0.1, 0.9, (3, 1, 3)), (1, len(PLACES), 1))
    for axis in range(3):
        lines[axis, :, axis] = PLACES
    xi = subcell_map(shape, np.zeros(3 * len(PLACES), int), lines.reshape(-1, 3))[0]
    places = ElementPoints(patch, np.zeros(len(xi), int), xi)
    motions = parallel.at(places)
    factor = 1.0 if is_affine else np.linalg.det(places.jacobians)[:, None, None]
    own, slope = parallel.degrees(patch, is_affine)
    # derivatives of curved hexahedra have one degree less in their own direction
    spare = int(shape is Shape.HEXAHEDRON and not is_affine)
    for values, degree, lowest in (
        (motions.above[:, :, None], own, own),
        (factor * motions.gradient, slope, slope - spare),
    ):
        along = np.moveaxis(values.reshape(3, len(PLACES), -1), 1, -1)
        assert beyond(along, degree) < 1e-13
        assert shape is Shape.PYRAMID or beyond(along, lowest - 1) > 1e-9


@pytest.mark.parametrize("beyond", [0.0, 1e-9])
def test_roots_at_corners_belong_to_all_cells_that_have_them(beyond):
    """Without any error: cells up to their ends, none beyond these."""
    corners = np.array([(a, b) for a in (0.0, 1.0) for b in (0.0, 1.0)])
    net = np.zeros((3, 2, 2, 4))
    net[0, :, 1], net[1, 1] = 1.0, 1.0
    roots = corners + beyond * (2 * corners - 1) * [1, 0]
    net[:2] -= roots.T[:, None, None]
    lower, upper, is_linear = _root_bounds(_Cells(np.arange(4), np.zeros((4, 2)), np.ones((4, 2)), net), np.zeros(4))
    assert is_linear.all()
    if beyond:
        assert (upper < lower).any(axis=1).all()
    else:
        assert (np.abs(lower - corners) < 1e-6).all()
        assert (np.abs(upper - corners) < 1e-6).all()
        assert (lower < upper).all()


def test_errors_of_both_maps_count_between_them(monkeypatch):
    monkeypatch.setattr(regularity, "tangents", lambda expansion, own: own)
    monkeypatch.setattr(regularity, "_controls", lambda own, world: (np.zeros((2, 1)), own))
    monkeypatch.setattr(regularity, "_pass", lambda controls, error: error)
    errors = np.array([1.0, 5.0]), np.array([3.0, 2.0])
    assert regularity.are_regular_between(SimpleNamespace(shape=Shape.TRIANGLE), *errors).tolist() == [3.0, 5.0]


@pytest.mark.parametrize("bend", [0.0, 0.05])
@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.PRISM])
def test_motion_in_elements_is_no_faster_and_changes_no_more_than_is_bounded(shape, bend):
    """f = J^-1 v at a lattice of each element; its differences per distance, in the maximum norm."""
    d = shape.dimension

    def warped(points):
        return points + bend * points[:, [1, 0, 2]] ** 2 * (np.arange(3) < d)

    bare = Dataset(curved(grid(shape, 1), warped, 3))
    speeds = [lambda p, k=k: 2 + np.sin(k + p @ [1.0, 2.0, 0.5]) for k in range(d)]
    data = Dataset(bare.mesh, tuple(approximated(bare, "uvw"[k], own, 3) for k, own in enumerate(speeds)))
    (patch,) = patches(data, tuple("uvw"[:d]))
    velocity = SimpleNamespace(patches=[patch], component_fields=lambda number: tuple(range(d)))
    rng = np.random.default_rng(4)
    rows = np.arange(len(patch))
    middle = np.tile(shape.vertices.mean(axis=0), (len(rows), 1))
    fastest, rate = first_steps._bounds(velocity, 0, rows, pointwise.jacobians(patch, rows, middle))

    def motion(xi):
        every, places = np.tile(rows, len(xi)), xi.reshape(-1, d)
        jacobians = pointwise.jacobians(patch, every, places)[:, :d]
        values = np.stack([pointwise.values(patch, k, every, places) for k in range(d)], axis=1)
        return np.linalg.solve(jacobians, values[..., None])[..., 0].reshape(xi.shape)

    weights = rng.dirichlet(0.2 * np.ones(len(shape.vertices)), (200, len(rows)))
    places = np.concatenate([np.tile(shape.vertices[:, None], (1, len(rows), 1)), weights @ shape.vertices])
    near = places + 1e-4 * rng.choice([-1.0, 1.0], places.shape)
    found = motion(places)
    faster = np.abs(found).max(axis=(0, 2)) / fastest
    changes = np.abs(found - motion(near)).max(axis=2) / np.abs(places - near).max(axis=2)
    changes = changes.max(axis=0) / rate
    assert faster.max() <= 1 + 1e-12
    assert changes.max() <= 1 + 1e-3
    assert faster.max() > (0.8 if bend == 0 else 0.5)
    assert changes.max() > (0.4 if bend == 0 else 0.1)


def test_cells_with_a_root_at_their_end_keep_a_little_of_it():
    """t - 1 on one axis and t on the other: what is left of the cell must have a length."""
    net = np.array([[[-1.0, -1.0], [0.0, 0.0]], [[0.0, 1.0], [0.0, 1.0]], np.zeros((2, 2))])[..., None]
    lower, upper, _ = _root_bounds(_Cells(np.zeros(1, int), np.zeros((1, 2)), np.ones((1, 2)), net), np.zeros(1))
    ends = sorted([(lower[0, 0], upper[0, 0]), (lower[0, 1], upper[0, 1])])
    assert ends == [(0.0, enclosure._SMALLEST), (1 - enclosure._SMALLEST, 1.0)]


def test_determinants_a_few_roundings_below_zero_touch_it(monkeypatch):
    lower = np.array([0.99, 1.01, -0.5]) * -validity.TOUCHING * 0.1
    found = SimpleNamespace(lower=lower, error=np.full(3, 0.1))
    monkeypatch.setattr(validity, "_proved", lambda *_: (np.array([True, False, False, False]), found))
    assert validity.are_never_negative(None, 3).tolist() == [True, True, False, True]
