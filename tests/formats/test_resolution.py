"""Modal bases, decay rates and estimates of the error on every shape, against theory and functions that are known."""

import numpy as np
import pytest
from scipy.special import eval_legendre, spherical_jn

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Expansion, Field
from elvis.core.integrals import integrate
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import mode_count, values
from elvis.core.polynomials.interpolation import modified
from elvis.core.portions import along_curve, portions
from elvis.core.portions.borrowing import borrowing
from elvis.core.quantities import Expression
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.needed import needed_fields
from elvis.core.resolution.decay_rates import decay_rates, grows_at_top
from elvis.core.resolution.element_resolution import element_resolution
from elvis.core.resolution.facts import resolution_facts
from elvis.core.resolution.low_order_errors import with_neighbours
from elvis.core.resolution.modal_bases import exact_rule, modal_basis
from elvis.core.resolution.truncation import truncated
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, one_element, ripple, scattered
from elvis.core.testing.played_ranks import played

ORTHO = {
    Shape.TRIANGLE: (Basis.ORTHO_A, Basis.ORTHO_B),
    Shape.TETRAHEDRON: (Basis.ORTHO_A, Basis.ORTHO_B, Basis.ORTHO_C),
    Shape.PYRAMID: (Basis.ORTHO_A, Basis.ORTHO_A, Basis.ORTHO_PYR_C),
    Shape.PRISM: (Basis.ORTHO_A, Basis.GLL_LAGRANGE, Basis.ORTHO_B),
}


def other_bases(shape, modes):
    return Expansion(shape, ORTHO.get(shape, (Basis.GLL_LAGRANGE,) * shape.dimension), modes)


@pytest.mark.parametrize("expansion", [modified, other_bases])
@pytest.mark.parametrize("counts", [(3, 3, 3), (4, 5, 6)])
@pytest.mark.parametrize("shape", Shape)
def test_truncation_is_the_orthogonal_projection(shape, counts, expansion):
    own = expansion(shape, counts[: shape.dimension])
    basis = modal_basis(own)
    coefficients = np.random.default_rng(3).standard_normal((4, mode_count(own)))
    kept = basis.truncated(coefficients)
    points, weights = exact_rule(own)
    table = values(own, points)
    whole, part = coefficients @ table.T, kept @ table.T

    # Parseval, what is removed is orthogonal to what is retained, and a second projection changes nothing
    energies = basis.modal(coefficients).reshape(4, -1) ** 2
    assert energies.sum(axis=1) == pytest.approx(whole**2 @ weights, rel=1e-12)
    assert energies @ basis.is_top() == pytest.approx((whole - part) ** 2 @ weights, rel=1e-11)
    assert ((whole - part) * part) @ weights == pytest.approx(np.zeros(4), abs=1e-11)
    assert basis.truncated(kept) == pytest.approx(kept, abs=1e-11)


@pytest.mark.parametrize("shape", Shape)
def test_truncation_keeps_polynomials_of_lower_degree(shape):
    bare = Dataset(grid(shape, 2))
    field = approximated(bare, "u", lambda p: p[:, 0] ** 3 - p[:, 1] * p[:, 2], 5)
    less = truncated(field, "less")
    assert less.name == "less"
    for block, own in zip(field.blocks, less.blocks, strict=True):
        assert own.expansion == block.expansion
        assert own.coefficients == pytest.approx(block.coefficients, abs=2e-9)


@pytest.mark.parametrize("order", [2, 3, 4, 5, 7])
@pytest.mark.parametrize("shape", Shape)
def test_decay_rate_is_that_of_the_nearest_pole(shape, order):
    """Coefficients of 1/(a - x) on [-1, 1] fall like (a + sqrt(a^2 - 1))^-k (Trefethen, Approximation Theory, 8)."""
    bare = Dataset(grid(shape, 2))
    pole = 1.5
    field = approximated(bare, "u", lambda p: 1 / (pole - p[:, 0]), order + 1)
    found = element_resolution(Dataset(bare.mesh, (field,)), "u")
    a = (pole - 0.75) / 0.25
    assert found.decay.min() == pytest.approx(np.log(a + np.sqrt(a * a - 1)), rel=0.1)


@pytest.mark.parametrize("parity", [0, 1])
@pytest.mark.parametrize("order", [3, 4, 5, 8])
def test_empty_levels_of_even_and_odd_functions_do_not_count(order, parity):
    energies = np.exp(-2 * 1.3 * np.arange(order + 1))[None]
    assert decay_rates(energies, 1e-14) == pytest.approx([1.3], rel=1e-9)
    energies[0, parity::2] = 0.0
    if (order, parity) != (3, 1):
        assert decay_rates(energies, 1e-14) == pytest.approx([1.3], rel=0.02)
    assert not grows_at_top(energies, np.ones(order + 1), 1e-6).any()


@pytest.mark.parametrize("order", [3, 5, 7, 9])
@pytest.mark.parametrize("frequency", [1.0, 2.0])
def test_decay_rate_of_a_wave_does_not_depend_on_its_phase(frequency, order):
    """Coefficients of exp(i w x) on [-1, 1] have the magnitude sqrt(2 k + 1) j_k(w) (Abramowitz and Stegun 10.1.47)."""
    levels = np.arange(order + 1)
    law = np.sqrt(2 * levels + 1) * spherical_jn(levels, frequency)
    phases = np.linspace(0.01, np.pi, 40)[:, None]
    energies = np.where(levels % 2, law * np.cos(phases), law * np.sin(phases)) ** 2
    fitted = levels[max(1, order - 5) :]
    expected = -np.polyfit(fitted, np.log(law[fitted]), 1)[0]
    assert decay_rates(energies, 1e-14) == pytest.approx(np.full(40, expected), rel=0.1)


def test_decay_rate_of_a_jump_is_that_of_its_mean_spectrum():
    """Coefficients of sign(x - s) on [-1, 1] are P_(k+1)(s) - P_(k-1)(s), up to a factor that depends on k only."""
    order, places = 9, np.linspace(-0.95, 0.95, 77)
    table = np.array([eval_legendre(k, places) for k in range(order + 2)])
    levels = np.arange(1, order + 1)
    energies = np.zeros((len(places), order + 1))
    energies[:, 1:] = ((table[2:] - table[:-2]) ** 2 / (2 * levels[:, None] + 1)).T
    law = (1 / (2 * levels - 1) + 1 / (2 * levels + 3)) / (2 * levels + 1)
    expected = -np.polyfit(levels[-6:], 0.5 * np.log(law[-6:]), 1)[0]
    assert np.median(decay_rates(energies, 1e-14)) == pytest.approx(expected, rel=0.1)


def test_a_field_with_nothing_but_its_highest_level_does_not_decay():
    bare = Dataset(grid(Shape.SEGMENT, 1))
    field = approximated(bare, "u", lambda p: (2 * p[:, 0] - 1) ** 2, 3)
    assert element_resolution(Dataset(bare.mesh, (field,)), "u").decay.tolist() == [0.0]


@pytest.mark.parametrize(("shape", "cells"), [(Shape.TRIANGLE, 23), (Shape.HEXAHEDRON, 10)])
def test_growth_in_one_of_a_thousand_elements_is_found(shape, cells):
    bare = Dataset(grid(shape, cells))
    field = approximated(bare, "u", lambda p: np.sin(2 * p[:, 0] + p[:, 1]), 5)
    (block,) = field.blocks
    basis = modal_basis(block.expansion)
    assert not element_resolution(Dataset(bare.mesh, (field,)), "u").grows.any()

    # the highest modes of one element are enlarged
    coefficients = block.coefficients.copy()
    row = len(block) // 2
    removed = coefficients[row] - basis.truncated(coefficients[row : row + 1])[0]
    coefficients[row] += 0.03 * removed / np.linalg.norm(basis.modal(removed[None]))
    planted = Field("u", (type(block)(block.expansion, block.element_ids, coefficients),))
    found = element_resolution(Dataset(bare.mesh, (planted,)), "u")
    assert found.element_ids[found.grows].tolist() == [block.element_ids[row]]


@pytest.mark.parametrize("shape", Shape)
def test_the_maximum_of_the_removed_part_is_certified(shape):
    mesh = curved(one_element(shape), ripple(0.05), n=3) if shape is not Shape.PYRAMID else one_element(shape)
    bare = Dataset(mesh)
    field = approximated(bare, "u", lambda p: np.exp(p[:, 0]) * np.cos(2 * p[:, 1] + p[:, 2]), 5)
    (facts,) = resolution_facts(Dataset(mesh, (field,)), ["u"])["fields"]
    points = scattered(shape, 400)
    (block,), (less,) = field.blocks, truncated(field, "u").blocks
    difference = np.abs(values(block.expansion, points) @ (block.coefficients - less.coefficients)[0])
    removed = facts["removed"]
    assert difference.max() <= removed["bound"]
    assert removed["attained"] <= removed["bound"] <= 1.01 * removed["attained"]
    assert facts["jump"] == 0.0


def test_advice_names_the_direction_of_a_layer():
    bare = Dataset(grid(Shape.HEXAHEDRON, 3))
    layer = approximated(bare, "u", lambda p: np.tanh((p[:, 1] - 0.55) / 0.02) + p[:, 0], 5)
    smooth = approximated(bare, "v", lambda p: p[:, 0] ** 2 + p[:, 2], 5)
    facts = resolution_facts(Dataset(bare.mesh, (layer, smooth)), ["u", "v"])
    assert facts["fields"][0]["advice"].startswith("refine h in reference direction 2 (along y) in 9 of 27 elements")
    assert facts["fields"][1]["advice"].startswith("resolved")
    decay = element_resolution(Dataset(bare.mesh, (layer,)), "u").decay
    assert facts["fields"][0]["decay"] == {"median": np.nanmedian(decay), "minimum": np.nanmin(decay)}
    assert [row["field"] for row in facts["worst"][:9]] == ["u"] * 9
    assert all(1 / 3 <= row["position"][1] <= 2 / 3 for row in facts["worst"][:9])


FIELDS = {
    "smooth": lambda p: np.exp(-30 * ((p[:, 0] - 0.3) ** 2 + (p[:, 1] - 0.4) ** 2)),
    "layer": lambda p: np.tanh((p[:, 0] + 0.6 * p[:, 1] - 0.8) / 0.04),
    "shock": lambda p: np.sign(p[:, 0] + 0.6 * p[:, 1] - 0.8),
    "corner": lambda p: np.hypot(p[:, 0], p[:, 1]) ** (2 / 3),
}


@pytest.mark.parametrize("name", FIELDS)
def test_estimated_error_is_near_the_true_one_and_finds_the_worst_elements(name):
    cells = 20
    bare = Dataset(grid(Shape.QUADRILATERAL, cells))
    coarse, fine = (approximated(bare, "u", FIELDS[name], modes) for modes in (7, 19))
    points, weights = exact_rule(fine.blocks[0].expansion)
    difference = coarse.blocks[0].coefficients @ values(coarse.blocks[0].expansion, points).T
    difference -= fine.blocks[0].coefficients @ values(fine.blocks[0].expansion, points).T
    truth = np.sqrt(difference**2 @ weights) / 2 / cells
    found = element_resolution(Dataset(bare.mesh, (coarse,)), "u").error
    assert 0.3 < np.linalg.norm(found) / np.linalg.norm(truth) < 3

    # elements count that have nearly the error of the last one among the truly worst
    worst = np.argsort(-found)[:20]
    assert np.mean(truth[worst] >= 0.9 * np.sort(truth)[-20]) >= 0.8


@pytest.mark.parametrize("shape", Shape)
def test_neighbours_tell_the_errors_of_order_two(shape):
    """The error of a wave is largest where its highest mode, the second, vanishes."""
    cells = {1: 60, 2: 12, 3: 4}[shape.dimension]
    bare = Dataset(grid(shape, cells))

    def wave(p):
        return np.sin(cells * (p @ [0.8, 0.5, 0.3]) + 0.3)

    coarse, fine = (approximated(bare, "u", wave, modes) for modes in (3, 6))
    points, weights = exact_rule(fine.blocks[0].expansion)
    values_of = [evaluate(own.blocks[0].expansion, own.blocks[0].coefficients, points) for own in (coarse, fine)]
    own = Dataset(bare.mesh, (coarse,))
    spectra = element_resolution(own, "u")
    truth = np.sqrt((values_of[0] - values_of[1]) ** 2 @ weights / weights.sum() * spectra.measure)
    quotients = with_neighbours(own, "u", spectra).error / truth
    is_large = truth > np.median(truth)
    assert np.mean((quotients > 0.5) & (quotients < 2) & is_large) > 0.9 * np.mean(is_large)


def test_errors_of_low_order_are_known_on_curved_elements_and_next_to_unknown_ones():
    bare = Dataset(curved(grid(Shape.QUADRILATERAL, 5), ripple(0.02), n=3))
    field, fine = (approximated(bare, "u", lambda p: np.exp(p[:, 0] + 0.5 * p[:, 1]), modes) for modes in (4, 8))
    own, best = Dataset(bare.mesh, (field,)), Dataset(bare.mesh, (fine,))
    spectra = element_resolution(own, "u")
    found = with_neighbours(own, "u", spectra)
    points, weights = exact_rule(fine.blocks[0].expansion)
    values_of = [
        evaluate(own.field("u").blocks[0].expansion, own.field("u").blocks[0].coefficients, points)
        for own in (own, best)
    ]
    truth = np.sqrt((values_of[0] - values_of[1]) ** 2 @ weights / 4 * found.measure)
    assert np.median(found.error / truth) == pytest.approx(1, rel=0.3)
    assert found.errors.max(axis=1) == pytest.approx(spectra.errors.max(axis=1) / spectra.error * found.error)

    # an element without finite values is left out of all patches
    coefficients = field.blocks[0].coefficients.copy()
    coefficients[12, 0] = np.nan
    broken = Field("u", (type(field.blocks[0])(field.blocks[0].expansion, field.blocks[0].element_ids, coefficients),))
    own = Dataset(bare.mesh, (broken,))
    assert np.isnan(with_neighbours(own, "u", element_resolution(own, "u")).error).nonzero()[0].tolist() == [12]


@pytest.mark.parametrize("modes", [7, 8])
def test_error_of_an_even_function_on_one_element_is_estimated(modes):
    bare = Dataset(grid(Shape.SEGMENT, 1))
    field, fine = (approximated(bare, "u", lambda p: np.exp(-6 * (p[:, 0] - 0.5) ** 2), n) for n in (modes, 20))
    points, weights = exact_rule(fine.blocks[0].expansion)
    difference = [own.blocks[0].coefficients[0] @ values(own.blocks[0].expansion, points).T for own in (field, fine)]
    truth = np.sqrt((difference[0] - difference[1]) ** 2 @ weights / 2)
    assert 0.3 < element_resolution(Dataset(bare.mesh, (field,)), "u").error[0] / truth < 10


def test_bad_fields_are_named():
    bare = Dataset(grid(Shape.QUADRILATERAL, 2))
    field = approximated(bare, "u", lambda p: p[:, 0], 3)
    coefficients = field.blocks[0].coefficients.copy()
    coefficients[1, 0] = np.nan
    broken = Field("u", (type(field.blocks[0])(field.blocks[0].expansion, field.blocks[0].element_ids, coefficients),))
    found = element_resolution(Dataset(bare.mesh, (broken,)), "u")
    assert np.isnan(found.decay).tolist() == [False, True, False, False]
    with pytest.raises(ElvisError, match="expected elements of the domain under v, found none"):
        element_resolution(Dataset(bare.mesh, (Field("v", ()),)), "v")


def test_single_elements_and_low_orders_give_one_sentence():
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    dataset = Dataset(bare.mesh, (approximated(bare, "u", lambda p: p[:, 0] ** 2, 2),))
    (facts,) = resolution_facts(dataset, ["u"])["fields"]
    assert facts["decay"]["median"] is None
    assert "orders below 2 have no decay rate" in facts["advice"]
    assert facts["gradient_error"]["reason"] == "a single element has no neighbours to recover it from"
    for name, sentence in (
        ("decay(u)", "expected a field of order 2 or more, found order 1"),
        ("recovered_error(u)", "expected elements with neighbours, found a single element"),
    ):
        with pytest.raises(ElvisError, match=sentence):
            Attributes(dataset).constant(name, Shape.QUADRILATERAL, np.zeros(1, np.int64))


def test_decay_and_tail_are_quantities():
    bare = Dataset(grid(Shape.TRIANGLE, 2))
    dataset = Dataset(bare.mesh, (approximated(bare, "u", lambda p: np.exp(2 * p[:, 0] + p[:, 1]), 5),))
    measures = element_resolution(dataset, "u")
    quantity = Expression.of(dataset, "decay(u) + 10*tail(u)")
    evaluator = Evaluator(dataset, [quantity])
    (patch,) = evaluator.patches
    rows = np.arange(len(patch))
    found = evaluator.values(quantity, patch, rows, np.tile([-0.5, -0.2], (len(rows), 1)))
    order = np.argsort(measures.element_ids)[np.argsort(np.argsort(patch.element_ids))]
    assert found == pytest.approx((measures.decay + 10 * measures.tail)[order])
    assert needed_fields(dataset, ["decay(u)"]) == ("u",)
    with pytest.raises(ElvisError, match="expected a field in decay"):
        Expression.of(dataset, "decay(u*u)")


def test_truncated_fields_are_ordinary_fields():
    bare = Dataset(grid(Shape.TRIANGLE, 2))
    own = approximated(bare, "u", lambda p: np.exp(2 * p[:, 0] + p[:, 1]), 5)
    dataset = Dataset(bare.mesh, (own,))
    less = truncated(own, "u")
    for text, same in (("truncated(u)", "u"), ("truncated(u*d(u,x) + x)", "u*d(u,x) + x")):
        quantity = Expression.of(dataset, text)
        evaluator = Evaluator(dataset, [quantity])
        other = Dataset(bare.mesh, (less,))
        reference = Evaluator(other, [Expression.of(other, same)])
        rows, points = np.arange(8), np.tile([-0.5, -0.2], (8, 1))
        found = evaluator.values(quantity, evaluator.patches[0], rows, points)
        expected = reference.values(Expression.of(other, same), reference.patches[0], rows, points)
        assert found.tolist() == expected.tolist()
    assert needed_fields(dataset, ["d(truncated(u),x)"]) == ("u",)
    assert Expression.of(dataset, "truncated(u)^2").is_local
    assert dataset["truncated(u)"].range == Dataset(bare.mesh, (less,))["u"].range
    for text in ("truncated(x)", "truncated(decay(u))"):
        with pytest.raises(ElvisError, match="expected fields or expressions of fields in truncated"):
            Expression.of(dataset, text)


def test_ranks_truncate_fields_of_their_parts():
    bare = Dataset(grid(Shape.TRIANGLE, 2))
    dataset = Dataset(bare.mesh, (approximated(bare, "u", lambda p: np.exp(2 * p[:, 0] + p[:, 1]), 4),))
    text, parts = "truncated(u)*d(truncated(u),x)", along_curve(dataset, 2)

    def integral(ranks):
        part = borrowing(portions(dataset, parts)[ranks.rank], [text], ranks)
        return integrate(part.dataset, text, ranks=ranks)

    first, _ = played(2, integral)
    assert first.value == pytest.approx(integrate(dataset, text).value, rel=1e-13)
