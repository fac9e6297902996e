"""Chebyshev models against the functions they stand for, on boxes so coarse that remainders are large."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.chebyshev_models import model as models
from elvis.core.chebyshev_models import modelled_boxes
from elvis.core.chebyshev_models.box_series import BoxSeries
from elvis.core.chebyshev_models.derivative_series import DerivativeSeries, derivatives_in
from elvis.core.chebyshev_models.expression_models import BoxLeaves, errors_in_eighths, has_models, model_of
from elvis.core.chebyshev_models.level_search import LevelSearch
from elvis.core.chebyshev_models.model_boxes import ModelBoxes, ShapeFacets, half_along
from elvis.core.chebyshev_models.series import (
    ORDERS,
    REACH,
    ROOM,
    along_axes,
    bounds_in_eighths,
    magnitudes_of,
    shells_of,
    to_half,
)
from elvis.core.chebyshev_models.series_boxes import SeriesBoxes
from elvis.core.quantities.names import Names
from elvis.core.quantities.parsing import Parser
from elvis.core.quantities.tree import Node, fold

NAMES = ("u", "v")
#: expressions on a curved map, with what makes their remainders: products, reciprocals, and both
EXPRESSIONS = (
    "u*v^2",
    "1/(3+u)",
    "u/(3+v)^2",
    "d(u,x)",
    "d(u,x)*d(v,y)-d(u,y)*d(v,x)",
    "(x+y)*d(v,z)/(4+d(u,x))",
)
CUBE = np.array([[sign * float(axis == k) for k in range(3)] + [1.0] for axis in range(3) for sign in (1, -1)])


def root_of(text: str) -> Node:
    """The expression of a text over the fields of these tests."""
    return Parser(text, Names(NAMES)).whole()


def random_series(boxes: int, degree: int, seed: int) -> Floats:
    """Series of x, y, z, u and v: a map near the identity, and fields of order one."""
    rng = np.random.default_rng(seed)
    size = degree + 1
    decay = 0.35 ** np.add.outer(np.add.outer(np.arange(size), np.arange(size)), np.arange(size))
    series = 0.5 * decay * rng.uniform(-1, 1, (boxes, 5, size, size, size))
    series[:, :3] *= 0.2
    series[:, 0, 0, 0, 1] += 1.0
    series[:, 1, 0, 1, 0] += 1.0
    series[:, 2, 1, 0, 0] += 1.0
    return series


def values(series: Floats, x: Floats) -> Floats:
    """(n,) a series at points (n, 3), in extended precision."""
    x = x.astype(np.longdouble)
    tables = [chebyshev.chebvander(x[:, axis], series.shape[-1] - 1) for axis in range(3)]
    return np.einsum("cba,na,nb,nc->n", series.astype(np.longdouble), *tables)


def slope(series: Floats, x: Floats, axis: int) -> Floats:
    """(n,) the derivative of a series along an axis of x."""
    derivative = chebyshev.chebder(series.astype(np.longdouble), axis=2 - axis)
    x = x.astype(np.longdouble)
    tables = [chebyshev.chebvander(x[:, k], derivative.shape[2 - k] - 1) for k in range(3)]
    return np.einsum("cba,na,nb,nc->n", derivative, *tables)


def truth(root: Node, series: Floats, x: Floats, scale: float) -> Floats:
    """(n,) an expression at points of one box, by the inverse of the map's Jacobian."""
    jacobian = np.stack([[scale * slope(series[k], x, axis) for axis in range(3)] for k in range(3)])
    inverse = np.linalg.inv(np.moveaxis(jacobian, -1, 0).astype(float))

    def leaf(node: Node) -> Floats:
        if node.op == "number":
            return np.full(len(x), node.value)
        if node.op == "coordinate":
            return values(series[node.axes[0]], x)
        own = series[3 + NAMES.index(node.name)]
        if not node.axes:
            return values(own, x)
        gradient = np.stack([scale * slope(own, x, axis) for axis in range(3)], axis=1).astype(float)
        return np.asarray((gradient * inverse[:, :, node.axes[0]]).sum(axis=1))

    operations = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "^": np.power}
    return np.asarray(fold(root, leaf, lambda node, parts: operations[node.op](*parts)))


def differences(text: str, count: int, half: float, seed: int) -> tuple[Floats, Floats]:
    """(ORDERS, boxes) largest differences found between a quantity and its model, and the bounds of them, in x."""
    root, series, scale = root_of(text), random_series(2, 4, seed), 1.0 / (ROOM * half)
    exact = np.zeros(series.shape[:2])
    model = model_of(root, BoxLeaves(NAMES, (), series, exact, exact, exact[:, None], scale, count))
    inner, step = REACH / ROOM, 1e-4
    points = np.random.default_rng(seed + 1).uniform(-inner, inner, (200, 3))
    points[:100] = inner * np.sign(points[:100])

    found = np.zeros((ORDERS, len(series)))
    for box, own in enumerate(series):

        def lacking(x: Floats, own: Floats = own, box: int = box) -> Floats:
            return truth(root, own, x, scale) - values(model.coefficients[box], x)

        found[0, box] = np.abs(lacking(points)).max()
        for axis in np.eye(3):
            before, here, after = (lacking(points + shift * step * axis) for shift in (-1, 0, 1))
            found[1, box] = max(found[1, box], np.abs(after - before).max() / (2 * step))
            found[2, box] = max(found[2, box], np.abs(after - 2 * here + before).max() / step**2)
    return found, model.remainder


def exact_leaves(series: Floats, count: int) -> BoxLeaves:
    """Leaves of one box without errors."""
    exact = np.zeros(series.shape[:2])
    return BoxLeaves(NAMES, (), series, exact, exact, exact[:, None], 1.0, count)


@dataclass(frozen=True, eq=False)
class Whole:
    """Elements with exact series (n, 5, size three times) on their whole cubes."""

    series: Floats

    @property
    def finite(self) -> Bools:
        """(n,) which of them have only finite numbers."""
        return np.asarray(np.isfinite(self.series).all(axis=(1, 2, 3, 4)))

    @property
    def maps(self) -> Whole:
        """The elements without fields."""
        return Whole(self.series[:, :3])

    def boxes(self, rows: Ints, centre: Floats, half: float) -> ModelBoxes:
        """A box of some elements, by bisection."""
        series, place, side = self.series[rows], np.zeros(3), 1.0
        while side > half:
            sides = np.where(centre > place, 1, -1)
            series = along_axes(series, *(to_half(series.shape[-1], own) for own in sides))
            side /= 2
            place = place + side * sides
        places = np.tile(centre, (len(rows), 1)), np.full(len(rows), half)
        return ModelBoxes.of_polynomials(rows, *places, series, np.zeros(series.shape[:2]))


@pytest.mark.parametrize("text", EXPRESSIONS)
@pytest.mark.parametrize("count", [5, 7])
def test_no_remainder_is_below_the_true_difference(text: str, count: int) -> None:
    found, bounds = differences(text, count, 0.5, seed=count)
    assert np.isfinite(bounds).all()
    assert (found <= 1.001 * bounds + [[1e-13], [1e-9], [1e-5]]).all()
    # the bounds are no worse than they must be for what they decide
    assert (found[0] > 1e-4 * bounds[0]).all()


@pytest.mark.parametrize("text", ["u*v^2", "1/(3+u)", "d(u,x)"])
def test_terms_beyond_the_lattice_are_needed(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "_aliased", lambda first, second: np.zeros((ORDERS, len(first))))
    found, bounds = differences(text, 5, 0.5, seed=5)
    assert (found[0] > bounds[0]).any()


def test_products_carry_the_remainders_of_their_factors() -> None:
    series = random_series(1, 4, 3)
    leaves = exact_leaves(series, 12)
    factor = leaves.value(3)
    for remainder, error in ((0.25, 0.0), (0.0, 0.125)):
        inexact = models.ChebyshevModel(factor.values, np.full((ORDERS, 1), remainder), np.full(1, error))
        product, quotient = inexact * factor, inexact.plus(3.0).reciprocal()
        greatest = np.abs(factor.values).max()
        assert product.remainder[0] >= remainder * greatest
        assert product.error >= error * greatest
        least = (factor.values + 3.0).min()
        assert quotient.remainder[0] >= remainder / (least * (least + remainder))
        assert quotient.error >= error / (least * (least + error))


def test_reciprocals_of_vanishing_functions_have_no_model() -> None:
    series = random_series(1, 4, 3)
    leaves = exact_leaves(series, 8)
    assert np.isinf(leaves.value(0).reciprocal().remainder).all()


def test_series_on_a_half_are_the_same_polynomials() -> None:
    rng = np.random.default_rng(1)
    for side in (-1, 1):
        series, x = rng.uniform(-1, 1, 8), rng.uniform(-1, 1, 20)
        half = to_half(8, side) @ series
        assert chebyshev.chebval(x, half) == pytest.approx(
            chebyshev.chebval((side + ROOM * x) / (2 * ROOM), series), abs=1e-13
        )


def test_series_stay_within_their_bounds_in_eighths() -> None:
    """Also the terms of high degree, which are not restricted; the bounds are sharper than those of the whole box."""
    rng = np.random.default_rng(5)
    powers = np.indices((10, 10, 10)).sum(axis=0)
    series = rng.uniform(-1, 1, (3, 10, 10, 10)) * 0.2**powers
    mean, reach = bounds_in_eighths(series, magnitudes_of(series))
    for eighth in range(8):
        sides = np.array([eighth >> 2 & 1, eighth >> 1 & 1, eighth & 1])
        s = np.concatenate([rng.uniform(0, 1, (60, 3)), rng.integers(0, 2, (8, 3))]) + sides - 1
        values = [chebyshev.chebval3d(*(s / ROOM).T, own) for own in series]
        assert (np.abs(np.array(values) - mean[:, eighth, None]) <= reach[:, eighth, None]).all()
    total = np.abs(series).sum(axis=(1, 2, 3)) - np.abs(series[:, 0, 0, 0])
    assert (reach.max(axis=1) < 0.7 * total).all()


@pytest.mark.parametrize("nodes", [0, 8])
def test_boxes_contain_the_whole_level_set(nodes: int) -> None:
    """Also with models of the derivatives on larger boxes, whose errors are a good part of those of the product."""
    root, level = root_of("d(u,x)*d(v,y)-d(u,y)*d(v,x)"), 0.05
    series = random_series(2, 3, 11)
    exact = np.zeros(series.shape[:2])
    search = LevelSearch(Whole(series), root, NAMES, exact, ShapeFacets(CUBE), 7)
    if nodes:
        derivatives = derivatives_in((root,))
        search = replace(search, halvings=2, count=10, derivatives=derivatives, nodes_of_derivatives=nodes)
    boxes = search.find(level)
    assert len(boxes.unmodelled) == 0
    assert len(boxes) > 0
    line = np.linspace(-1, 1, 24)
    lattice = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    for element in range(2):
        above = truth(root, series[element], lattice / ROOM, 1.0 / ROOM) > level
        crossed = np.argwhere(np.diff(above.reshape(24, 24, 24), axis=0))
        ends = np.stack([line[crossed], line[crossed + np.array([1, 0, 0])]], axis=1)
        own = boxes.element == element
        inside = np.abs(ends[:, :, None] - boxes.centre[own]).max(axis=-1) <= boxes.half[own] + 1e-12
        # an end at least lies in a box where the level passes between two points of a line
        assert inside.any(axis=(1, 2)).all()

    # series of boxes are those of the quantity within what they state
    rng = np.random.default_rng(2)
    for number in rng.choice(len(boxes), 10):
        s = rng.uniform(-REACH, REACH, (50, 3))
        point = boxes.centre[number] + boxes.half[number] * s
        value = truth(root, series[boxes.element[number]], point / ROOM, 1.0 / ROOM)
        stated = values(boxes.series[number], s / ROOM)
        assert np.abs(stated - value).max() <= boxes.misfit[number, 0] + boxes.error[number]
        larger = boxes.map_of[number]
        of_map = (point - boxes.map_centre[larger]) / boxes.map_half[larger]
        places = np.stack([values(own, of_map / ROOM) for own in boxes.maps[larger]], axis=1)
        true = np.stack([values(own, point / ROOM) for own in series[boxes.element[number], :3]], axis=1)
        assert np.abs(places - true).max() < 1e-12
        inner = (np.abs(s) <= 1).all(axis=1)
        assert (true[inner] >= boxes.world[number, :3]).all()
        assert (true[inner] <= boxes.world[number, 3:]).all()


def test_derivatives_on_parts_of_boxes_are_within_their_errors() -> None:
    """Series of four terms a direction lack terms, which count with those that the models lack."""
    series, rows, half = random_series(2, 3, 11), np.arange(2), 0.5
    elements, exact = Whole(series), np.zeros(series.shape[:2])
    centres = np.array([[-half] * 3, [half] * 3])
    boxes = [elements.boxes(rows, centre, half) for centre in centres]
    scale = 1.0 / (ROOM * half)
    leaves = [BoxLeaves(NAMES, (), own.leaves, exact, own.off, own.lost, scale, 8) for own in boxes]
    root = root_of("d(u,x)")
    found = DerivativeSeries.of((root,), leaves, elements, rows, centres, half, 4)
    place, side = np.array([0.25, 0.75, 0.25]), 0.25
    part = found.boxes(rows, place, side)
    assert part.leaves.shape[1:] == (6, 4, 4, 4)
    s = np.random.default_rng(1).uniform(-REACH, REACH, (200, 3))
    for element in rows:
        true = truth(root, series[element], (place + side * s) / ROOM, 1.0 / ROOM)
        difference = np.abs(values(part.leaves[element, -1], s / ROOM) - true).max()
        bound = part.lost[element, 0, -1] + part.off[element, -1]
        assert 0.02 * bound < difference <= bound


def test_conditions_drop_boxes_and_tell_where_they_are_open() -> None:
    """Levels count nowhere, everywhere, or where a sign says so; the slope of its values is then bounded."""
    series = random_series(2, 3, 11)
    exact = np.zeros(series.shape[:2])

    def found(condition: str) -> SeriesBoxes:
        root, condition_root = root_of("u*v"), root_of(condition)
        return LevelSearch(Whole(series), root, NAMES, exact, ShapeFacets(CUBE), 7, condition_root).find(0.0)

    assert len(found("u+9")) == 0
    assert (found("u-9").condition == [-1.0, 0.0]).all()
    boxes, step = found("u+v"), 1e-3
    assert len(boxes)
    assert (boxes.condition[:, 0] >= 0).all()
    rng = np.random.default_rng(4)
    for number, slope_bound in enumerate(boxes.condition[:, 1]):
        s = rng.uniform(-1, 1, (200, 3))
        ends = [(boxes.centre[number] + boxes.half[number] * (s + shift)) / ROOM for shift in (0.0, step)]
        first, last = (truth(root_of("u+v"), series[boxes.element[number]], point, 1.0 / ROOM) for point in ends)
        change = np.abs(last - first).max() / step
        assert 0.02 * slope_bound < change <= 1.001 * slope_bound


@pytest.mark.parametrize("text", ["u*v^2", "1/(3+u)", "d(u,x)*v"])
def test_errors_of_values_are_bounded_in_eighths(text: str) -> None:
    """Values that are computed from leaves that are off by their errors; bounds of the whole box are larger."""
    root, series, wrong = root_of(text), random_series(1, 3, 7), 1e-6
    leaves = replace(exact_leaves(series, 8), errors=np.array([[0.0, 0.0, 0.0, wrong, wrong]]))
    (bounds,) = errors_in_eighths((root,), leaves)
    rng = np.random.default_rng(8)
    sides = np.array([[number >> axis & 1 for axis in range(3)] for number in range(8)])
    found = np.zeros(8)
    for change in (-wrong, wrong):
        moved = series.copy()
        # derivatives of polynomials of degree 3 change by up to 2 * 3 times the error of values
        moved[0, 3, 0, 0, 0] += change
        moved[0, 3, 0, 0, 1] += 6.0 * change * ("d(" in text)
        moved[0, 4, 0, 0, 0] += change
        for eighth in range(8):
            s = 0.5 * (2.0 * sides[eighth] - 1.0 + rng.uniform(-REACH, REACH, (200, 3)))
            values_of = [truth(root, own[0], s / ROOM, 1.0) for own in (series, moved)]
            found[eighth] = max(found[eighth], np.abs(values_of[1] - values_of[0]).max())
    assert (found <= bounds[0]).all()
    assert (found > 0.1 * bounds[0]).all()
    assert bounds.max() < model_of(root, leaves).error[0]


def test_elements_with_nan_or_flat_maps_have_no_model() -> None:
    series = random_series(3, 3, 5)
    series[1, 3] = np.nan
    series[2, 2] = 0.0
    exact = np.zeros(series.shape[:2])
    boxes = LevelSearch(Whole(series), root_of("d(u,x)"), NAMES, exact, ShapeFacets(CUBE), 7).find(0.05)
    assert boxes.unmodelled.tolist() == [1, 2]
    assert set(boxes.element) <= {0}


def test_only_sums_products_and_quotients_have_models() -> None:
    assert all(has_models(root_of(text)) for text in EXPRESSIONS)
    assert not any(has_models(root_of(text)) for text in ("sqrt(u)", "u^0.5", "max(u,v)", "d(d(u,x),x)"))


@pytest.mark.parametrize("axis", range(3))
def test_an_empty_list_of_boxes_has_no_halves(axis: int) -> None:
    """A search halves boxes of which none may hold the level."""
    assert half_along(np.zeros((0, 3, 4, 4, 4)), axis, 1).shape == (0, 3, 4, 4, 4)
    assert shells_of(np.zeros((0, 4, 4, 4))).shape == (0, 4)


@pytest.mark.parametrize(("remainder", "share", "is_within"), [(0.9, 1.0, True), (1.1, 1.0, False), (0.6, 0.5, False)])
def test_models_are_good_within_their_part_of_the_range(remainder: float, share: float, is_within: bool) -> None:
    """A constant without any error has no range, and is."""
    coefficients = np.zeros((2, 3, 3, 3))
    coefficients[0, 1, 0, 0] = 1.0
    lacking = np.zeros((ORDERS, 2))
    series = BoxSeries.of(coefficients)
    nowhere = None, np.zeros(2, int), np.zeros((2, 3)), np.ones(2)
    boxes = modelled_boxes.ModelledBoxes(*nowhere, series, lacking, np.zeros(2), None, np.zeros((2, 1, 8)))
    assert boxes.is_good.all()
    limit = modelled_boxes.MODEL_PART * boxes.series.range[0]
    lacking[:, 0] = remainder * limit / modelled_boxes.lacking(np.ones((ORDERS, 1)))
    assert boxes.is_within(share).tolist() == [is_within, True]


def test_derivatives_of_conditions_halve_with_their_boxes() -> None:
    """The sum of their magnitudes is attained by a linear function."""
    coefficients = np.zeros((1, 3, 3, 3))
    coefficients[0, 1, 0, 0], coefficients[0, 0, 1, 0], coefficients[0, 0, 0, 1] = 3.0, -2.0, 1.0
    nothing = np.zeros(1)
    condition = modelled_boxes.Condition(BoxSeries.of(coefficients), nothing, np.array([6.0]), nothing)
    for axis in range(3):
        condition = condition.on_side(axis, 1)
    condition = condition.halved()
    linear = condition.series.coefficients.copy()
    linear[0, 0, 0, 0] = 0.0
    assert condition.steepness == np.abs(linear).sum() == 3.0


def test_shortened_conditions_count_their_dropped_terms() -> None:
    """Terms are dropped while they are at most a share of the range; they are bounds of the error from then on."""
    series, nothing = random_series(3, 8, 13)[:, 3], np.zeros(3)
    condition = modelled_boxes.Condition(BoxSeries.of(series), nothing, nothing, nothing)
    short = condition.shortened(1e-3)
    count = short.series.count
    assert 1 < count < 9
    assert (short.remainder <= 1e-3 * condition.series.range).all()
    dropped = series.copy()
    dropped[:, :count, :count, :count] = 0.0
    assert np.allclose(short.remainder, np.abs(dropped).sum(axis=(1, 2, 3)), rtol=1e-12, atol=0)
    assert condition.shortened(0.0) is condition
