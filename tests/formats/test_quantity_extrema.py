"""Extrema of expressions that are known in closed form, and those of others against samples."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.bounds import quantity_extrema as quantity_extrema_module
from elvis.core.bounds import single_field_extrema
from elvis.core.bounds.extrema import Extremum
from elvis.core.bounds.quantity_extrema import quantity_extrema
from elvis.core.data.dataset import Dataset, Field
from elvis.core.polynomials.boxnets import all_halves, corners, product, total
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator, Sampler
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple, scattered

BODIES = [shape for shape in Shape if shape.dimension > 1]


def of(dataset, text):
    return quantity_extrema(dataset, Expression.of(dataset, text))


def test_nets_are_added_and_multiplied_like_polynomials():
    """At the corners of the box and of its halves, of degrees that differ."""
    random = np.random.default_rng(3)
    one, other = random.uniform(-1, 1, (4, 3, 2, 4)), random.uniform(-1, 1, (4, 2, 3, 3))
    parts = [corners(all_halves(nets)) for nets in (one, other, product(one, other), total(one, other))]
    assert np.allclose(parts[2], parts[0] * parts[1], rtol=0, atol=1e-14)
    assert np.allclose(parts[3], parts[0] + parts[1], rtol=0, atol=1e-14)


@pytest.mark.parametrize("shape", BODIES)
def test_polynomials_and_their_roots(shape):
    """x (1 - x) y is 1/4 at most, on the border y = 1; sqrt(u^2 + v^2) of u = x, v = y - 0.3 from 0 to sqrt(1.49)."""
    bare = Dataset(grid(shape, 2))
    fields = (approximated(bare, "u", lambda p: p[:, 0], 3), approximated(bare, "v", lambda p: p[:, 1] - 0.3, 3))
    dataset = Dataset(bare.mesh, fields)
    least, greatest = of(dataset, "x*(1 - u)*y")
    assert greatest.value == pytest.approx(0.25, rel=1e-12)
    assert greatest.position[:2] == pytest.approx((0.5, 1), abs=1e-5)
    assert 0 <= greatest.bound - greatest.value < 1e-12
    assert abs(least.bound) < 1e-12
    least, greatest = of(dataset, "sqrt(u^2 + v^2)")
    assert greatest.value == pytest.approx(np.sqrt(1.49), rel=1e-13)
    assert greatest.position[:2] == pytest.approx((1, 1))
    assert 0 <= greatest.bound - greatest.value < 1e-12
    assert 0 <= least.bound <= least.value < 1e-6


def test_nonpolynomial_quantities_are_bounded_by_intervals():
    dataset = Dataset(curved(grid(Shape.QUADRILATERAL, 2), lambda p: p + 0.05 * np.sin(np.pi * p) * [1, 1, 0], 4))
    least, greatest = of(dataset, "sin(3*x)*y")
    assert greatest.value == pytest.approx(1, abs=1e-9)
    assert greatest.value <= greatest.bound < 1 + 1e-3
    assert greatest.position == pytest.approx((np.pi / 6, 1, 0), abs=1e-4)
    assert least.bound <= least.value <= 0


def test_functions_of_one_field_reach_their_bounds_where_they_are_flat():
    """exp(-u^2) is 1 wherever u is 0, on a whole surface, and u^2 is 0 there."""
    bare = Dataset(curved(grid(Shape.TETRAHEDRON, 1), ripple(0.03), 3))
    field = approximated(bare, "u", lambda p: np.sin(5 * p[:, 0]) - p[:, 1], 6)
    dataset = Dataset(bare.mesh, (field,))
    greatest, least = of(dataset, "exp(-u^2)")[1], of(dataset, "u^2")[0]
    assert greatest.value == pytest.approx(1, abs=1e-13)
    assert 0 <= greatest.bound - greatest.value < 1e-13
    assert -1e-13 <= least.bound <= least.value < 1e-20
    for found in (greatest, least):
        samples = Sampler(dataset, [Expression.of(dataset, "u")]).sample(np.array([found.position]))
        assert samples.values[0, 0] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_functions_of_one_field_stay_below_their_bounds_wherever_bisection_ends(sign, monkeypatch):
    dataset = Dataset(grid(Shape.SEGMENT, 1))
    root = Expression.of(dataset, "sin(20*x)*exp(-x^2)").root
    ends = [Extremum(end, end, (end, 0.0, 0.0), 0) for end in (-1.0, 1.0)]
    x = np.linspace(-1, 1, 200_001)
    truth = (sign * np.sin(20 * x) * np.exp(-(x**2))).max()
    bounds = []
    for parts, most, bisections in [(2, 1, 1), (2, 1, 4), (2, 4, 2), (2, 8, 5), (2, 64, 9), (256, 64, 60)]:
        limits = {"_PARTS": parts, "_MOST_PARTS": most, "_BISECTIONS": bisections}
        for name, limit in limits.items():
            monkeypatch.setattr(single_field_extrema, name, limit)
        found = single_field_extrema.best_argument(root, ends, sign)
        assert found.value <= truth + 1e-7
        assert truth <= found.bound
        bounds.append(found.bound)
    assert bounds[-1] - truth < 1e-7


def test_functions_of_a_field_that_jumps_over_their_maximum():
    """On elements where u is -1 or 2, exp(-u^2) nowhere reaches 1."""
    dataset = Dataset(grid(Shape.QUADRILATERAL, 2))
    field = approximated(dataset, "u", lambda p: np.where(p[:, 0] < 0.5, -1.0, 2.0), 2)
    least, greatest = of(Dataset(dataset.mesh, (field,)), "exp(-u^2)")
    assert greatest.value == pytest.approx(np.exp(-1), rel=1e-12)
    assert greatest.bound == pytest.approx(greatest.value, rel=1e-6)
    assert least.value == pytest.approx(np.exp(-4), rel=1e-12)


@pytest.mark.sampled(least=4)
@pytest.mark.parametrize("text", ["u*x - u^2", "d(u,x)", "abs(u) + y", "exp(u)", "log(2 + u)"])
@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.PYRAMID, Shape.PRISM])
def test_no_sample_exceeds_the_bounds(shape, text):
    bare = Dataset(curved(grid(shape, 1), ripple(0.03), 3))
    field = approximated(bare, "u", lambda p: np.sin(5 * p[:, 0]) * np.cos(4 * p[:, 1] + 3 * p[:, 2]), 4)
    dataset = Dataset(bare.mesh, (field,))
    least, greatest = of(dataset, text)
    expression = Expression.of(dataset, text)
    evaluator = Evaluator(dataset, [expression])
    for patch in evaluator.patches:
        points = np.tile(scattered(shape, 300, 1), (len(patch), 1))
        values = evaluator.values(expression, patch, np.repeat(np.arange(len(patch)), 300), points)
        assert least.bound <= values.min()
        assert values.max() <= greatest.bound
    assert greatest.bound - greatest.value < 0.02 * (greatest.value - least.value)


def test_omitted_terms_are_bounded(monkeypatch):
    """Where few boxes are examined, greater values may be missed, but none is above the bound."""
    bare = Dataset(grid(Shape.TRIANGLE, 3))
    is_missed = []
    for seed in range(10):
        (block,) = approximated(bare, "u", lambda p: p[:, 0], 4).blocks
        noise = np.random.default_rng(seed).normal(size=block.coefficients.shape)
        dataset = Dataset(bare.mesh, (Field("u", (replace(block, coefficients=noise),)),))
        _, truth = of(dataset, "abs(u) + y/8")
        with monkeypatch.context() as patch:
            patch.setattr(quantity_extrema_module, "_MANY", 1)
            _, greatest = of(dataset, "abs(u) + y/8")
        assert greatest.bound >= truth.value
        is_missed.append(greatest.value < truth.value)
    assert any(is_missed)


def test_second_derivatives_have_places_without_bounds():
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    dataset = Dataset(curved(bare.mesh, ripple(0.03), 3), (approximated(bare, "u", lambda p: p[:, 0] ** 3, 4),))
    least, greatest = of(dataset, "laplacian(u)")
    assert np.isinf(greatest.bound)
    assert least.value <= greatest.value


def test_quantities_without_values_are_rejected():
    with pytest.raises(ElvisError, match="expected elements of the domain with a value of log"):
        of(Dataset(grid(Shape.TRIANGLE, 1)), "log(-1 - x)")
