"""The error of a conversion in quantities: each term is needed, and covers what a known perturbation does."""

import json
from dataclasses import replace

import numpy as np
import pytest

from elvis import sample
from elvis.core.bounds.quantity_extrema import quantity_extrema
from elvis.core.data.conversion_errors import REPORT
from elvis.core.integrals import integrate
from elvis.core.numbers.norms import quantity_norms
from elvis.core.quantities import Expression
from elvis.core.shapes import Shape
from elvis.core.testing import grid, with_field

PLACE = np.array([[0.3, 0.6, 0.2]])
SIZE = 0.01


def recorded(dataset, place=(0.0, 0.0), field=(0.0, 0.0)):
    """The dataset with a record of errors and their slopes."""
    errors = [{"exact": False, "max": value, "slope": slope, "relative": value} for value, slope in (place, field)]
    exact = {"exact": True}
    facts = {"geometry": errors[0] if any(place) else exact, "fields": {"u": errors[1] if any(field) else exact}}
    return replace(dataset, metadata={REPORT: json.dumps(facts)})


def flow(points):
    return 1 + points[:, 0] * points[:, 1]


def moved(shift, stretch):
    """The mesh of the converted data, whose points are off: the field stays with its element."""
    dataset = with_field(grid(Shape.HEXAHEDRON, 1), flow, 3)
    vertices = dataset.mesh.vertices * (1 + stretch) + np.array([shift, 0, 0])
    return replace(dataset, mesh=replace(dataset.mesh, vertices=vertices))


def raised(value, slope):
    """Data whose field is off."""
    return with_field(grid(Shape.HEXAHEDRON, 1), lambda points: flow(points) + value + slope * points[:, 0], 3)


#: what is wrong with the data, what is recorded of it, the point in the converted data, and a quantity that it changes
CASES = {
    "field": (lambda: raised(SIZE, 0), {"field": (SIZE, 0.0)}, PLACE, "u^2"),
    "slope": (lambda: raised(0, SIZE), {"field": (SIZE, SIZE)}, PLACE, "d(u,x)^2"),
    "place": (lambda: moved(SIZE, 0), {"place": (SIZE, 0.0)}, PLACE + SIZE * np.eye(3)[:1], "x^2"),
    "turned": (lambda: moved(0, SIZE), {"place": (2 * SIZE, SIZE)}, PLACE * (1 + SIZE), "d(u,x)^2"),
}


@pytest.mark.parametrize("name", CASES)
def test_each_term_covers_the_effect_of_a_perturbation(name):
    perturbed, errors, place, text = CASES[name]
    truth = with_field(grid(Shape.HEXAHEDRON, 1), flow, 3)
    data = recorded(perturbed(), **errors)
    wanted = sample(truth, text, PLACE).values[0, 0]
    found = sample(data, text, place)
    off = abs(found.values[0, 0] - wanted)
    assert 1e-4 < off <= found.errors[0, 0] < 4 * off

    expression = Expression.of(data, text)
    for own, best in zip(quantity_extrema(data, expression), quantity_extrema(truth, expression), strict=True):
        assert abs(own.value - best.value) <= abs(own.bound - own.value)
    norms = [quantity_norms(each, [expression])[text] for each in (truth, data)]
    assert abs(norms[0].l2 - norms[1].l2) <= norms[1].l2_error < 0.2
    assert abs(norms[0].linf - norms[1].linf) <= norms[1].linf_error


@pytest.mark.parametrize("sign", "+-")
def test_errors_of_fields_and_of_places_add(sign):
    """Whatever the signs: of sums, differences and of the end at which a square is off more."""
    data = recorded(with_field(grid(Shape.HEXAHEDRON, 1), flow, 3), place=(3 * SIZE, 0.0), field=(SIZE, 0.0))
    assert sample(data, f"u {sign} x", PLACE).errors[0, 0] == pytest.approx(4 * SIZE, rel=1e-9, abs=0)
    u = flow(PLACE)[0]
    assert sample(data, f"{sign}1*u^2", PLACE).errors[0, 0] == pytest.approx(2 * u * SIZE + SIZE**2, rel=1e-9, abs=0)


def test_measures_are_off_by_the_slope_of_the_map():
    truth = with_field(grid(Shape.HEXAHEDRON, 1), flow, 3)
    data = recorded(moved(0, SIZE), place=(2 * SIZE, SIZE))
    one = Expression.of(data, "1")
    off = quantity_norms(data, [one])["1"].l2 - quantity_norms(truth, [one])["1"].l2
    assert 0 < off <= quantity_norms(data, [one])["1"].l2_error < 2 * off
    value = integrate(data, "1")[0]
    assert SIZE < abs(value.value - 1) <= value.error < 0.1


@pytest.mark.parametrize("sign", [1, -1])
def test_integrals_are_off_by_fields_and_measures_together(sign):
    """Of either sign, where both raise the magnitude."""
    truth = integrate(with_field(grid(Shape.HEXAHEDRON, 1), flow, 3), f"{sign}*u")[0].value
    data = moved(0, SIZE)
    data = with_field(data.mesh, lambda points: flow(points / (1 + SIZE)) + 3 * SIZE, 3)
    found = integrate(recorded(data, place=(2 * SIZE, SIZE), field=(3 * SIZE, 0.0)), f"{sign}*u")[0]
    assert 0 < abs(found.value - truth) <= found.error < 1.5 * abs(found.value - truth)


def test_exact_data_state_no_error():
    truth = with_field(grid(Shape.HEXAHEDRON, 1), flow, 3)
    assert not sample(truth, "u^2", PLACE).errors.any()
    assert quantity_norms(truth, [Expression.of(truth, "u^2")])["u^2"].l2_error == 0


def test_unknown_radii_are_infinite():
    data = recorded(with_field(grid(Shape.HEXAHEDRON, 1), flow, 3), field=(SIZE, SIZE))
    assert sample(data, "d(d(u,x),y)", PLACE).errors[0, 0] == np.inf
