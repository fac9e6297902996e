"""Quantities by name: near names, certified ranges, levels of expressions without what increases around them."""

import numpy as np
import pytest

from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.orientation import require
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.levels import peel
from elvis.core.quantities.names import Names
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid


@pytest.fixture(scope="module")
def dataset():
    mesh = grid(Shape.QUADRILATERAL, 2)
    return Dataset(mesh, (approximated(Dataset(mesh), "u", lambda p: 3 * p[:, 0] - p[:, 1], 2),))


@pytest.mark.parametrize(
    "text",
    ["u - 2", "2 + u", "2 - u", "u + 0.5", "-3*u", "0.25*u", "u*(-2)", "u/(-4)", "u/4", "exp(2*u)", "1 - exp(-u/2)"],
)
def test_levels_of_increasing_expressions_are_those_of_their_operand(dataset, text):
    """The whole exceeds its value where what is left exceeds its own; the other way around for a negative sign."""
    expression = Expression.of(dataset, text)
    names = [Expression.of(dataset, "u"), expression]
    evaluator = Evaluator(dataset, names)
    (patch,) = evaluator.patches
    rng = np.random.default_rng(3)
    rows, points = rng.integers(len(patch), size=20), rng.uniform(-1, 1, (20, 2))
    inner, whole = (evaluator.values(each, patch, rows, points) for each in names)
    for level in (-0.3, 0.45):
        node, value, sign = peel(expression.root, level)
        assert node == names[0].root
        if np.isfinite(value):
            assert np.array_equal(np.sign(whole - level), sign * np.sign(inner - value))


def test_ranges_of_functions_are_their_bounds(dataset):
    assert dataset["u"].range == pytest.approx((-1.0, 3.0), abs=1e-12)
    assert dataset["2 - u"].range == pytest.approx((-1.0, 3.0), abs=1e-12)
    assert dataset["u"](0.5, 0.25) == pytest.approx(1.25)


def test_names_that_differ_in_case_are_meant_before_symbols():
    mesh = grid(Shape.QUADRILATERAL, 1)
    fields = [approximated(Dataset(mesh), name, lambda p: p[:, 0], 2) for name in ("pressure", "p")]
    names = Names.of(Dataset(mesh, tuple(fields)))
    assert "(perhaps p)" in names.unknown("P")
    only = Names.of(Dataset(mesh, tuple(fields[:1])))
    assert "(perhaps pressure)" in only.unknown("P")


@pytest.mark.parametrize(("holds", "row"), [([[1, 1], [1, 0], [0, 0]], 1), ([[1, 1], [1, 1], [0, 1]], 2)])
def test_the_first_entity_that_breaks_a_rule_is_named(dataset, holds, row):
    mesh = dataset.mesh
    require(np.ones((3, 2), bool), mesh, Shape.QUADRILATERAL, slice(1, 4), "this", "that")
    for rows in (slice(1, 4), np.array([1, 2, 3])):
        where = f"quadrilateral {mesh.of(Shape.QUADRILATERAL).ids[1 + row]}"
        with pytest.raises(FormatError, match=f"{where}: expected this, found 7"):
            require(np.array(holds, bool), mesh, Shape.QUADRILATERAL, rows, "this", "{}", np.full(3, 7))
