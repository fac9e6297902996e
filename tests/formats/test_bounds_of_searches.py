"""Searches examine exactly the elements, boxes and roots that their bounds allow."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from elvis.core.bounds import bounding
from elvis.core.bounds.ranges import Range
from elvis.core.cores.matrix_ranges import Eigenvalue, MatrixRange
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import cut_expansions
from elvis.core.integrals.cut_expansions import Expansion
from elvis.core.integrals.taylor import BENDS
from elvis.core.mapping.boxes import ROUNDINGS
from elvis.core.mapping.inverse import _Elements
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.newton import Targets, newton
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.chebyshev_nodes import series
from elvis.core.quantities import Expression
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid
from elvis.core.validity import enclosed_determinants, largest_scale, regularity, validity
from elvis.core.validity.descent import TOLERANCE as TIGHT
from elvis.core.validity.validity import _SHAPES, _Facts

#: unit roundoff of the model
COARSE = 2.0**-11


@pytest.mark.parametrize(("part", "is_inside"), [(0.99, True), (1.01, False)])
def test_roots_beyond_a_side_by_rounding_are_inside(part, is_inside):
    """Next to each side of a unit square: its heights are distances, which may have the tolerance in addition."""
    patch = patches(Dataset(grid(Shape.QUADRILATERAL, 1)))[0]
    rounding = 1e-10
    away = rounding + part * TOLERANCE
    ends = [-away, 1 + away]
    points = np.array([[ends[0], 0.3, 0], [ends[1], 0.3, 0], [0.3, ends[0], 0], [0.3, ends[1], 0]])
    tiny = np.full(4, 1e-14)
    found = newton(Targets(patch, np.zeros(4, int), points, tiny, tiny, np.full(4, rounding)), np.zeros((4, 2)))
    assert found.converged.all()
    assert (found.inside == is_inside).all()


def test_elements_may_fold_where_their_smallest_coefficient_may_be_zero(monkeypatch):
    """One coefficient of the second element is below its error, one of the third just above."""
    nets = np.ones((3, 2, 2, 2))
    nets[1, 0, 1, 0] = 0.0999
    nets[2, 1, 0, 1] = 0.1001
    places = np.arange(3.0)[:, None, None]
    examined = []

    def are_regular_between(expansion, first, last):
        examined.extend(first.ravel().tolist())
        return np.zeros(len(first), bool)

    monkeypatch.setattr(largest_scale, "are_regular_between", are_regular_between)
    maps = SimpleNamespace(places=places, moves=0 * places, expansion=None)
    piece = SimpleNamespace(
        boxes=lambda low, high: nets, error_at=lambda scale: np.full(3, 0.1), rows=np.arange(3), maps=maps
    )
    assert not largest_scale._Search._is_regular(piece, 0.0, 1.0)
    assert examined == [1.0]


@pytest.mark.parametrize("degrees", [[1, 1, 1], [1, 2, 4], [7, 3, 2]])
def test_rounding_of_transforms_has_a_part_for_each_term(degrees, monkeypatch):
    """Rounding of values to coefficients and of coefficients to the net, each of one sign; errors of values."""
    monkeypatch.setattr(enclosed_determinants, "gamma", lambda roundings: roundings * COARSE)
    none = np.zeros((1, 2, 2, 2))

    def slack(greatest=0.0, low=none, error=0.0):
        return enclosed_determinants._slack(np.full(1, greatest), low, degrees, np.full(1, error))[0]

    transforms = [series(degree)[1] for degree in degrees]
    largest = np.prod([np.abs(own).sum() for own in transforms])
    # sums of so many products, with cosines that are accurate to 5 roundings
    least = COARSE * sum(degree + 1 + 5 for degree in degrees) * largest
    assert least <= slack(greatest=1.0) <= 8 * least

    low = np.random.default_rng(3).normal(size=(1, 6, 6, 6))
    matrix = np.abs(enclosed_determinants._to_bernstein(6))
    raised = np.einsum("ai,bj,ck,ijk->abc", matrix, matrix, matrix, np.abs(low[0])).max()
    least = COARSE * 3 * (6 + 1) * raised
    assert least <= slack(low=low) <= 2.1 * least

    places = np.polynomial.chebyshev.chebvander(np.linspace(-1, 1, 201), max(degrees))
    lebesgue = [np.abs(places[:, : len(own)] @ own).sum(axis=1).max() for own in transforms]
    exact = slack(error=1.0)
    assert np.prod(lebesgue) <= exact <= 1.1 * max(lebesgue) ** 3
    # the bound itself has about 20 roundings
    monkeypatch.setattr(enclosed_determinants, "UNIT", COARSE)
    assert 1 + 20 * COARSE <= slack(error=1.0) / exact <= 1 + 100 * COARSE


def test_bounds_of_a_quantity_move_with_a_constant():
    """Accuracy is relative to the range of values, not to their size."""
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    text = "sin(5*x + 3)*cos(4*y + 1)"
    for constant in (-30.0, 30.0):
        found = bounding.quantity_range(dataset, Expression.of(dataset, f"{text} + {constant}"))
        size = found.maximum - found.minimum
        assert found.lower <= constant - 1 + 1e-12
        assert found.upper >= constant + np.cos(1) * 1.0
        assert found.minimum - found.lower <= 2 * bounding._TOLERANCE * size
        assert found.upper - found.maximum <= 2 * bounding._TOLERANCE * size


def test_cut_expansions_have_the_discs_of_whole_ones(monkeypatch):
    """Majorants of polynomials without negative coefficients are attained; mirrored ones have the same radii."""
    rng = np.random.default_rng(21)
    count, columns = 12, 2
    signs = (-1.0) ** np.add.outer(np.arange(4), np.arange(4))
    coefficients = rng.uniform(0.2, 1.0, (count, 4, 4, 4))
    bends = rng.uniform(0.2, 1.0, (count, len(BENDS)))
    radii = tuple(rng.uniform(0.3, 0.8, (count, columns)) for _ in range(3))
    slopes, factors = rng.uniform(0.2, 1.0, (2, count, 2))

    def discs_of(sign, most):
        """Discs of the polynomial, a product and a sum, and of their derivatives."""
        monkeypatch.setattr(cut_expansions, "_ALL", most)
        mirror = signs[:, :, None] if sign < 0 else 1.0
        turned = bends * [sign ** (i + j) for i, j in BENDS]
        own = Expansion.curved(mirror * coefficients, turned, radii[:2])
        other = Expansion.curved(mirror * coefficients[::-1], turned, radii[:2])
        product = own.multiplied(sign * slopes, radii[:2])
        total = Expansion.combined(sign * factors, [own, other])
        assert (own.omitted is None) == (most > 0)
        return [
            found
            for each in (own, product, total)
            for found in (each.disc(radii), *(each.slope(axis, radii) for axis in range(3)))
        ]

    whole = discs_of(1, 1 << 20)
    for sign in (1, -1):
        for (middle, radius), (wanted_middle, wanted) in zip(discs_of(sign, 0), whole, strict=True):
            np.testing.assert_allclose(np.abs(middle), np.abs(wanted_middle), rtol=1e-12)
            np.testing.assert_allclose(radius, wanted, rtol=1e-12)


def unknown_facts(count, **numbers):
    """Facts of squares about whose determinants nothing is known but some numbers."""
    facts = _Facts.empty(count)
    facts.element_ids[:], facts.shapes[:] = np.arange(count), _SHAPES.index(Shape.QUADRILATERAL)
    facts.lower[:], facts.upper[:], facts.minimum[:], facts.maximum[:] = -np.inf, np.inf, np.inf, -np.inf
    facts.error[:] = 0.1
    for name, values in numbers.items():
        getattr(facts, name)[:] = values
    return facts


def test_signs_are_open_where_bounds_and_values_differ_by_several_errors(monkeypatch):
    """A bound may prove a positive sign, a value a negative one; the largest value is bounded otherwise."""
    cases = [(0.099, 0.6, True), (0.101, 0.6, False), (-1.0, -0.099, True), (-1.0, -0.101, False)]
    cases += [(-0.2, 0.201, True), (-0.2, 0.199, False)]
    # what equals its error proves nothing
    cases += [(0.1, 0.6, True), (-1.0, -0.1, True), (-0.2, 0.2, False)]
    lower, value, is_open = map(np.array, zip(*cases, strict=True))
    nets = np.arange(9.0)[:, None, None] * np.ones((2, 2))
    calls = []

    def least(nets, error, goal=-np.inf):
        calls.append((nets[:, 0, 0], goal))
        number = np.abs(nets[:, 0, 0]).astype(int)
        return SimpleNamespace(lower=lower[number], value=value[number], place=np.zeros((len(nets), 2)))

    monkeypatch.setattr(validity, "least", least)
    facts = unknown_facts(9)
    facts.decide(np.arange(9), nets)
    assert facts.is_open.tolist() == is_open.tolist()
    assert facts.lower.tolist() == lower.tolist()
    assert facts.minimum.tolist() == value.tolist()
    assert calls[1][0].tolist() == [0, -2, -3, -4, -5, -6, -7, -8]
    assert facts.upper[[0, 2, 3]].tolist() == [-0.099, 1.0, 1.0]
    assert facts.maximum[[0, 2, 3]].tolist() == [-0.6, 0.099, 0.101]


@pytest.mark.parametrize("value", [2.0, -2.0, 0.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_elements_whose_bound_undercuts_the_extremum_are_rivals(sign, value):
    """Bounds must exceed the extremum by its tolerance; extrema of further elements are taken into account."""
    goal = value - TIGHT * abs(value)
    bounds = np.array([goal + 1e-12, goal - 2e-12, goal - 1.0, goal + 1.0])
    values = np.array([value + 3.0, value, value + 5.0, value + 4.0])
    numbers = {"lower": bounds, "minimum": values} if sign > 0 else {"upper": -bounds, "maximum": -values}
    rows, found = unknown_facts(4, **numbers).rivals(sign)
    assert rows.tolist() == [2, 1]
    assert found == pytest.approx(goal, abs=1e-15)
    for part, wanted in ((1e-3, [2, 1]), (-0.5, [2])):
        ends = Range(-np.inf, np.inf, *((value + part, np.inf) if sign > 0 else (-np.inf, -(value + part))))
        assert unknown_facts(4, **numbers).rivals(sign, ends)[0].tolist() == wanted


def test_closer_looks_only_narrow_bounds(monkeypatch):
    """Bounds found for x(1 - x) + y are replaced where they are tighter, on both sides."""
    coefficients = np.array([[0.0, 1.0], [0.5, 1.5], [0.0, 1.0]])
    block = SimpleNamespace(expansion=SimpleNamespace(shape=Shape.QUADRILATERAL), coefficients=None)
    facts = unknown_facts(2, lower=[-5.0, 0.0], upper=[5.0, 1.25], minimum=[0.5, 0.5], maximum=[0.5, 0.5])
    facts.is_open[:] = False

    def nets_of(self, rows, blocks, space):
        yield rows, block, np.repeat(coefficients[None], len(rows), axis=0), self.error[rows]

    monkeypatch.setattr(_Facts, "_nets", nets_of)
    monkeypatch.setattr(validity, "evaluate_at", lambda expansion, coefficients, rows, places: np.zeros((len(rows), 3)))
    facts.look_closer([block], 2)
    assert facts.lower == pytest.approx([0.0, 0.0], abs=1e-9)
    assert facts.minimum == pytest.approx([0.0, 0.0], abs=1e-9)
    assert facts.upper == pytest.approx([1.25, 1.25], abs=1e-9)
    assert facts.maximum == pytest.approx([1.25, 1.25], abs=1e-9)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_matrices_are_definite_beyond_the_rounding_of_their_largest_entries(size, monkeypatch):
    """Symmetric parts with the smallest eigenvalue just above, or below, the rounding of products."""
    monkeypatch.setattr(regularity, "ROUNDING", COARSE)
    rng = np.random.default_rng(4)
    turns = np.linalg.qr(rng.normal(size=(40, size, size)))[0]
    for part, is_definite in ((0.99, False), (40.0, True)):
        products = np.einsum("bik,k,bjk->bij", turns, [4.0] * (size - 1) + [0.0], turns)
        largest = np.maximum(np.abs(products).max(axis=(1, 2)), 1.0)
        products += (part * COARSE * largest)[:, None, None] * np.eye(size)
        found = regularity._are_definite(np.tile(np.eye(size), (40, 1, 1)), products[..., None], np.zeros(40))
        assert (found == is_definite).all()


def test_rounding_of_elements_does_not_depend_on_the_side_of_the_origin():
    """Elements of a thousandth at 1 and at -1."""
    rounding = []
    for sign in (1, -1):
        mesh = curved(grid(Shape.TRIANGLE, 1), lambda p, side=sign: side * (1 + 1e-3 * p * [1, 1, 0]), 2)
        patch = patches(Dataset(mesh))[0]
        rounding.append(_Elements(patch, np.arange(len(patch)), 0.0).rounding)
    assert rounding[0] == pytest.approx(rounding[1], rel=1e-2, abs=0.0)
    assert (rounding[0] >= 0.9 * ROUNDINGS * np.finfo(float).eps).all()


@pytest.mark.parametrize(("part", "is_known"), [(0.99, True), (1.01, False)])
def test_eigenvalues_are_identified_while_the_trace_may_be_as_large(part, is_known):
    """Entries 0 up to d and r on the diagonal: P is up to d + r, D up to d, and Q is in its own range."""
    d = 0.05
    middle = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]])

    def matrices(r):
        radius = np.zeros((1, 3, 3))
        radius[0, [0, 1], [0, 1]] = d, r
        return MatrixRange(middle, radius)

    def excess(r):
        minors, radius = matrices(r).sum_of_minors()
        return 8 * (d + r) * d - (minors - radius)[0] ** 2

    nothing = [MatrixRange(0 * middle, 0 * middle)] * 3
    assert Eigenvalue.of(matrices(part * brentq(excess, 0.0, 3.0)), nothing).is_known[0] == is_known


def test_eigenvectors_of_identified_eigenvalues_keep_the_sign_of_their_first_components():
    """Their products with those of left eigenvectors have one sign at all corners of ranges; some are small."""
    rng = np.random.default_rng(6)
    count = 1500
    right, left = rng.normal(size=(2, count, 3))
    right[:, 0] *= 10.0 ** rng.uniform(-2, 0, count)
    left[:, 0] *= 10.0 ** rng.uniform(-2, 0, count)
    # bases whose inverses have a given first row: the others are normal to it
    bases = np.stack([right, *np.moveaxis(np.linalg.svd(left[:, None])[2][:, 1:], 1, 0)], axis=2)
    block = np.zeros((3, 3))
    block[1:, 1:] = [[1.5, -2.0], [2.0, 1.5]]
    middle = bases @ block @ np.linalg.inv(bases)
    radius = 10.0 ** rng.uniform(-3, -1, (count, 1, 1)) * rng.choice([1e-3, 1.0], (count, 3, 3))
    nothing = [MatrixRange(0 * middle, 0 * middle)] * 3
    is_known = Eigenvalue.of(MatrixRange(middle, radius), nothing).is_known
    corners = (middle + radius * rng.choice([-1.0, 1.0], (24, count, 3, 3)))[:, is_known]
    values, vectors = np.linalg.eig(corners)
    which = np.abs(values.imag).argmin(axis=-1)
    first = np.take_along_axis(vectors[..., 0, :] * np.linalg.inv(vectors)[..., :, 0], which[..., None], -1)[..., 0]
    signs = np.sign(first.real)
    assert (signs == signs[0]).all()
    assert 0.1 < (signs[0] > 0).mean() < 0.9
    assert is_known.mean() > 0.1
