"""Bounds of Chebyshev models, of nets of expressions and of norms: values lie within them (tests/support/claims.py)."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from claims import TEETH, check
from numpy.polynomial import Chebyshev, chebyshev

from elvis.core.bounds.extrema import Extremum
from elvis.core.chebyshev_models import expression_models, model, series
from elvis.core.chebyshev_models.model import ChebyshevModel, leibniz
from elvis.core.chebyshev_models.series import ORDERS, REACH, ROOM, amplification, growth, nodes, steepness
from elvis.core.differences import difference
from elvis.core.integrals.graph_discs import _height
from elvis.core.integrals.groups import BoxIntegrals, Compared
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.rounding import UNIT
from elvis.core.quantities import Expression, expression_nets
from elvis.core.quantities.cells import Cells
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression_nets import Rounded
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple, with_field
from elvis.core.validity import largest_scale

COUNT = 40
#: unit roundoff of the model
COARSE = 2.0**-11
#: places in an element, with its ends but the last, where pyramids have their apex
LINE = np.array([-1.0, -0.3, 0.5, 0.999])
#: where bounds of series hold
INNER = np.linspace(-REACH / ROOM, REACH / ROOM, 201)


def products_of_exponentials(rng):
    """e^(a x) e^(b x) = e^((a + b) x) at x = 1, with two derivatives."""
    rates = rng.uniform(0.1, 2, (2, COUNT))
    first, second, both = (
        np.stack([rate**order * np.exp(rate) for order in range(ORDERS)]) for rate in (*rates, rates.sum(axis=0))
    )
    yield both, leibniz(first, second)


def terms_of_series(rng):
    """|T_k| and its derivatives, those of products of two terms among them."""
    del rng
    for count in (2, 5, 12):
        k = count - 1
        values, first, second = (
            np.abs(Chebyshev.basis(k).deriv(order)(INNER)) if order else np.abs(Chebyshev.basis(k)(INNER))
            for order in range(ORDERS)
        )
        bound = growth(count)[:, k]
        yield values.max(keepdims=True), bound[:1]
        yield first.max(keepdims=True), bound[1:2]
        yield np.maximum(second, first**2).max(keepdims=True), bound[2:]
        for order in (1, 2):
            derivative = np.abs(Chebyshev.basis(k).deriv(order)(INNER)).max()
            yield np.array([derivative]), np.array([steepness(count, order)])


def errors_at_nodes(rng):
    """The Lebesgue constant of Chebyshev points, in three directions."""
    del rng
    for count in (1, 2, 5, 11, 30):
        fine = np.linspace(-1, 1, 2001)
        table = np.linalg.solve(
            chebyshev.chebvander(nodes(count), count - 1).T, chebyshev.chebvander(fine, count - 1).T
        )
        yield np.array([np.abs(table).sum(axis=0).max() ** 3]), np.array([amplification(count)])


def constant_model(rng, low, high):
    """Constants that are off by remainders and by errors."""
    value = rng.uniform(low, high, COUNT)
    remainder = rng.uniform(0.05, 0.2, (ORDERS, COUNT))
    values = np.broadcast_to(value[:, None, None, None], (COUNT, 3, 3, 3))
    return ChebyshevModel(values, remainder, rng.uniform(0.05, 0.2, COUNT)), value


def operations_of_models(rng):
    """Truths are next to polynomials by the remainder, computed values next to these by the error."""
    first, one = constant_model(rng, 1, 2)
    second, two = constant_model(rng, 2, 3)
    operations = {
        "sum": (first + second, np.add),
        "difference": (first - second, np.subtract),
        "multiple": (first.times(-3.0), lambda a, b: -3 * a),
        "with a number": (first.plus(0.5), lambda a, b: a + 0.5),
        "product": (first * second, np.multiply),
        "reciprocal": (second.reciprocal(), lambda a, b: 1 / b),
        "power": (first.power(3), lambda a, b: a**3),
    }
    for found, operation in operations.values():
        exact = operation(one, two)
        assert np.abs(found.values - exact[:, None, None, None]).max() < 1e-12
        for a in (-1, 1):
            for b in (-1, 1):
                by_remainder = operation(one + a * first.remainder[0], two + b * second.remainder[0])
                yield np.abs(by_remainder - exact), found.remainder[0]
                by_error = operation(one + a * first.error, two + b * second.error)
                yield np.abs(by_error - exact), found.error


def derivatives_of_reciprocals(rng):
    """1 / (c + r e^(a x)), of the constant c: at x = 1 where r is negative."""
    for rate in (0.5, 1.5):
        part = rng.uniform(0.05, 0.2, COUNT)
        remainder = np.stack([part * rate**order for order in range(ORDERS)])
        value = rng.uniform(1, 2, COUNT)
        values = np.broadcast_to(value[:, None, None, None], (COUNT, 3, 3, 3))
        found = ChebyshevModel(values, remainder, np.zeros(COUNT)).reciprocal().remainder
        g, slope, bend = value - part, -part * rate, -part * rate**2
        yield 1 / g - 1 / value, found[0]
        yield np.abs(slope) / g**2, found[1]
        yield np.abs(2 * slope**2 / g**3 - bend / g**2), found[2]


def sums_and_products_of_nets(rng):
    """Off by their slack, in opposite ways."""
    first, second = (Rounded(rng.normal(size=(COUNT, 3, 2)), rng.uniform(0.05, 0.2, COUNT)) for _ in range(2))
    for operation in (lambda a, b: a + b, lambda a, b: a * b):
        found = operation(first, second)
        for one in (-1, 1):
            for two in (-1, 1):
                pair = (
                    Rounded(own.nets + way * own.slack[:, None, None], np.zeros(COUNT))
                    for own, way in ((first, one), (second, two))
                )
                yield np.abs(operation(*pair).nets - found.nets).max(axis=(1, 2)), found.slack


def roots_of_inexact_squares(rng):
    """The norm of what has a squared norm with an error, which may be the larger one."""
    for square, error in rng.uniform(0.1, 1, (20, 2)):
        found = max(np.sqrt(square + error) - np.sqrt(square), np.sqrt(square) - np.sqrt(max(square - error, 0)))
        yield np.array([found]), np.array([difference._of_root(square, error)])


def heights_of_curved_surfaces(rng):
    """P(a, b) at the ends of a and b."""
    bends = rng.uniform(0.1, 1, (COUNT, 5)) * rng.choice([-1, 1], (COUNT, 1))
    a, b = rng.uniform(0.1, 1, (2, COUNT, 1))
    found = np.abs(sum(bends[:, k, None] * term for k, term in enumerate((a, b, a * a, a * b, b * b))))
    yield found, _height(bends, a, b)


def determinants_at_factors(rng):
    """Sums of c_k S^k whose coefficients are off."""
    errors, scale = rng.uniform(0.1, 1, (COUNT, 4)), 0.7
    piece = largest_scale._Piece(None, np.arange(COUNT), np.zeros((COUNT, 2, 2, 4)), errors, None)
    yield errors @ scale ** np.arange(4), piece.error_at(scale)


def quantities_on_whole_elements(rng):
    """Gradients and determinants on curved elements, and distances to their boundary, at corners and in between."""
    for shape in [shape for shape in Shape if shape.dimension > 1]:
        bent, middle = ripple(0.06, seed=int(rng.integers(99))), 0.5 * (np.arange(3) < shape.dimension)
        mesh = curved(grid(shape, 1), lambda p, bent=bent, middle=middle: bent(p) - middle, 3)
        dataset = with_field(mesh, lambda p: np.sin(2 * p[:, 0] + p[:, 1]) + p[:, 2] ** 2, 3)
        texts = ["d(u,x)", "d(u,y)", "jacobian", "x*u"]
        texts += ["distance(all)"] if shape is Shape.TRIANGLE or shape is Shape.PRISM else []
        evaluator = Evaluator(dataset, [Expression.of(dataset, text) for text in texts])
        (patch,) = evaluator.patches
        rows, lattice = np.arange(len(patch)), np.stack(np.meshgrid(*[LINE] * shape.dimension, indexing="ij"), axis=-1)
        places = uncollapse(shape, lattice.reshape(-1, shape.dimension))
        cells = Cells.of(patch, evaluator.names, evaluator.attributes, rows, True)
        for expression in evaluator.expressions:
            low, high = cells.bounds(expression.root)
            assert np.isfinite(low).all()
            every = np.repeat(rows, len(places))
            values = evaluator.values(expression, patch, every, np.tile(places, (len(rows), 1)))
            middle = (low + high) / 2
            away = np.nanmax(np.abs(values.reshape(len(rows), -1) - middle[:, None]), axis=1)
            yield away, (high - low) / 2 * (1 + 1e-12)


CLAIMS = [
    quantities_on_whole_elements,
    products_of_exponentials,
    terms_of_series,
    errors_at_nodes,
    operations_of_models,
    derivatives_of_reciprocals,
    sums_and_products_of_nets,
    roots_of_inexact_squares,
    heights_of_curved_surfaces,
    determinants_at_factors,
]


@pytest.mark.parametrize("claim", CLAIMS)
def test_values_lie_within_bounds_and_some_near_their_ends(claim):
    with np.errstate(all="ignore"):
        check(claim, TEETH)


def test_all_roundings_of_sums_and_products_of_nets_are_counted(monkeypatch):
    """All coefficients of one size, each product and sum rounded away from zero."""
    monkeypatch.setattr(expression_nets, "EPS", COARSE)
    one, two = Rounded(np.ones((1, 3, 2)), np.zeros(1)), Rounded(np.ones((1, 2, 2)), np.zeros(1))
    # raised by means of as many terms as there are in each direction; a sum of as many products as coefficients
    for found, count in ((one + two, 2), ((one * two), 6)):
        away = np.abs(found.nets).max() * ((1 + COARSE) ** (count + 1) - 1)
        assert away <= found.slack[0] <= 8 * away


def test_operations_of_models_round_values(monkeypatch):
    monkeypatch.setattr(model, "UNIT", COARSE)
    exact = ChebyshevModel(np.full((1, 2, 2, 2), -3.0), np.zeros((ORDERS, 1)), np.zeros(1))
    for found, size in ((exact + exact, 6), (exact.times(2.0), 6), (exact.plus(-1.0), 4), (exact * exact, 9)):
        assert size * COARSE <= found.error[0] <= 4 * size * COARSE


@pytest.mark.parametrize("count", [2, 6, 15])
def test_rounding_of_series_covers_three_passes(count):
    """Products and sums of all terms, each away from zero, with tables that are off by 8 units."""
    of_sums = 3 * (count + 8) * UNIT
    of_kernels = (15 * count**2 + 3 * count) * UNIT
    of_transforms = (2**1.5 * count**2 + 2 * count**1.5 + 2**0.5 * count) * (count + 7) * UNIT
    for found, counted in (
        (series.sum_rounding(count), of_sums),
        (series.kernel_rounding(count), of_kernels),
        (series.transform_rounding(count), of_transforms),
    ):
        assert counted * (1 - 1e-12) <= found <= 2.1 * counted


def test_errors_of_norms_include_those_of_integrals_and_rounding(monkeypatch):
    monkeypatch.setattr(difference, "_ROUNDING", 0.01)
    value, error, measure = np.arange(1.0, 7.0), np.arange(0.1, 0.7, 0.1), np.array([2.0, 2, 2, 2, 4, 8])
    sums = SimpleNamespace(value=value, error=error, measure=measure)
    greatest = SimpleNamespace(value=9.0, bound=9.5, position=(0, 0, 0), element=1)
    found = difference._difference("u", sums, greatest)
    noise = 0.01 * 2.0
    assert found.l1_error == pytest.approx(0.1 + 2 * noise)
    assert found.l2_error == pytest.approx(np.sqrt(2.2) - np.sqrt(1.8) + noise)
    assert found.h1_error == pytest.approx(np.sqrt(5.5) - np.sqrt(4.5) + noise)
    assert found.covered == 0.5
    assert found.covered_error == pytest.approx(1.1 / 8)


def test_largest_of_several_differences_has_the_largest_bound():
    """Patches whose difference isn't known don't count, unless it is known on none."""
    first, second = Extremum(2.0, 2.5, (0.0, 0.0, 0.0), 1), Extremum(1.0, 3.0, (1.0, 0.0, 0.0), 2)
    unknown = Extremum(np.nan, np.inf, (0.0, 0.0, 0.0), 3)
    for found in ([first, second], [second, first], [unknown, second, first]):
        assert difference._greatest_of(found) == replace(first, bound=3.0)
    assert difference._greatest_of([unknown]) is not unknown
    assert difference._greatest_of([unknown]).bound == np.inf


@pytest.mark.parametrize("part", [0.99, 1.01])
def test_remarks_name_wide_bounds_unless_all_is_rounding(part):
    """A thousandth more than the largest difference, where differences exceed 1e-11."""
    row = SimpleNamespace(field="u", covered=1.0, linf=2.0, bound=2.0 * (1 + part * 1e-3), relative=1.0)
    assert len([*difference._remarks([row])]) == (part > 1)
    row.bound, row.relative = 3.0, part * 1e-11
    assert len([*difference._remarks([row])]) == (part > 1)


def test_errors_of_groups_include_rounding_and_moved_surfaces():
    """Boxes whose error is below their rounding are not improved."""
    measure, rounding, moved = np.array([[2.0], [3.0]]), np.array([[0.1], [0.2]]), np.array([[0.05], [0.0]])
    nothing = np.zeros((2, 1))
    integrals = BoxIntegrals(np.ones((2, 1)), np.ones((2, 1)), measure, nothing)
    group = Compared(
        SimpleNamespace(rounding=rounding), [0], (2,), integrals, np.array([[0.26], [0.59]]), nothing == 0, moved, False
    )
    assert np.allclose(group._rounding, [[0.25], [0.6]])
    assert np.allclose(group.scores(np.array([0.13])), [2.0, 0.0])
    total = group.sums(1)
    assert total.rounding[0] == pytest.approx(0.85)
    assert total.error[0] == pytest.approx(0.85 + 0.85)
    assert total.is_bound[0]
    assert not replace(group, is_bound=np.array([[True], [False]])).sums(1).is_bound[0]


def test_determinants_at_factors_are_rounded(monkeypatch):
    monkeypatch.setattr(largest_scale, "_UNIT", COARSE)
    nets = np.zeros((1, 2, 2, 3))
    nets[0, 0, 1] = [1.0, -2.0, 4.0]
    piece = largest_scale._Piece(None, np.zeros(1, int), nets, np.zeros((1, 3)), None)
    # Horner's rule: two roundings for each power, and those of the change to Bernstein form
    least = 1.0 + 2 * 2.0 * 0.5 + 4 * 4.0 * 0.25
    assert COARSE * least <= piece.error_at(0.5)[0] <= 16 * COARSE * least


@pytest.mark.parametrize(("part", "is_doubtful"), [(0.99, True), (1.01, False)])
def test_elements_are_doubtful_if_their_determinant_may_be_within_its_error(part, is_doubtful):
    """At one corner, while it is large everywhere else."""
    nets = np.ones((1, 2, 2, 2))
    nets[0, 0, 0, 0] = 0.1 * part
    piece = SimpleNamespace(error_at=lambda factor: np.full(1, 0.1), boxes=lambda low, high: nets)
    search = SimpleNamespace(_known=SimpleNamespace(scale=5.0), _typical=1.0, _note=lambda *_: None)
    assert largest_scale._Search._doubtful(search, [(0, piece)], 0.0, 1.0) == is_doubtful


def test_models_of_eighths_are_bounded_by_their_mean_of_either_sign():
    """Constants -2 and 3 that are off by 0.1."""
    coefficients = np.zeros((2, 3, 3, 3))
    coefficients[:, 0, 0, 0] = [-2.0, 3.0]
    leaves = SimpleNamespace(_series=lambda *_: (coefficients, np.zeros(2)), _remainder=lambda *_: (np.full(2, 0.1),))
    found = expression_models.LeavesOfEighths._evaluated(leaves, 0, (0, 0, 0))
    assert found.bounds == pytest.approx(np.repeat([2.1, 3.1], 8), rel=1e-9)


def test_determinants_that_equal_their_error_may_be_zero():
    """In a net that is searched for roots, and in the constant term of a polynomial in the factor."""
    for value, is_positive in ((0.1, False), (0.2, True)):
        assert largest_scale._is_positive(np.full((2, 2, 2), value), 0.1) == is_positive
    roots = largest_scale._smallest_roots(np.array([[0.1, -1.0], [0.2, -1.0]]), np.full(2, 0.1))
    assert roots == pytest.approx([0.0, 0.2])
