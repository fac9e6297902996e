"""Recovered fields are exact for polynomials of one degree more, continuous, and superconvergent in derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.base.arrays import frozen_floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Field
from elvis.core.numbers.norms import quantity_norms
from elvis.core.polynomials.interpolation import modified
from elvis.core.quantities import Expression
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.jumps import jumps
from elvis.core.resolution.modal_bases import exact_rule
from elvis.core.resolution.recovered_remarks import remarks_on_recovered
from elvis.core.resolution.recovery import is_continuous
from elvis.core.resolution.stored_precision import DOUBLE, SINGLE
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, interpolated, mixed_plane, mixed_volume, one_element, ripple

SHAPES = [shape for shape in Shape if shape.dimension < 3]


def error(dataset, text):
    """L2 norm of a quantity that would be zero without an error."""
    return quantity_norms(dataset, [Expression.of(dataset, text)])[text].l2


@pytest.mark.parametrize("make", [approximated, interpolated])
@pytest.mark.parametrize("shape", Shape)
def test_polynomials_of_one_degree_more_are_recovered(shape, make):
    bare = Dataset(grid(shape, 2))
    column = shape.dimension - 1
    axis = "xyz"[column]
    field = make(bare, "u", lambda p: p[:, column] ** 3 - 2 * p[:, 0] ** 2 * p[:, column], 3)
    dataset = Dataset(bare.mesh, (field,))
    assert error(dataset, f"recovered(u) - ({axis}^3 - 2*x^2*{axis})") < 1e-10
    slope = f"(3*{axis}^2 - 2*x^2)" if axis != "x" else "(-3*x^2)"
    assert error(dataset, f"recovered(d(u,{axis})) - {slope}") < 1e-9
    assert error(dataset, f"d(u,{axis}) - {slope}") > 1e-3


@pytest.mark.parametrize("make", [approximated, interpolated])
@pytest.mark.parametrize("mesh", [mixed_plane, lambda: one_element(Shape.QUADRILATERAL, 2)])
def test_meshes_of_one_layer_are_recovered_exactly(mesh, make):
    bare = Dataset(mesh())
    dataset = Dataset(bare.mesh, (make(bare, "u", lambda p: np.exp(p[:, 0] / 2 - p[:, 1]), 4),))
    truth = "exp(x/2 - y)"
    assert error(dataset, f"recovered(u) - {truth}") < 1.1 * error(dataset, f"u - {truth}")


@pytest.mark.parametrize(
    ("order", "make", "is_curved"),
    [(1, approximated, True), (2, interpolated, False), (2, interpolated, True), (3, approximated, False)],
)
@pytest.mark.parametrize("shape", SHAPES)
def test_recovered_derivatives_are_one_order_more_accurate(shape, order, make, is_curved):
    """Order p + 0.9 at least, also at the boundary, where patches are one-sided; the derivatives have the order p."""
    text = "(2*cos(2*x + 0.3)*cos(1.5*y))"
    errors = []
    for cells in (4, 8):
        mesh = curved(grid(shape, cells), ripple(0.05), 3) if is_curved else grid(shape, cells)
        bare = Dataset(mesh)
        field = make(bare, "u", lambda p: np.sin(2 * p[:, 0] + 0.3) * np.cos(1.5 * p[:, 1]), order + 1)
        dataset = Dataset(mesh, (field,))
        errors.append([error(dataset, f"recovered(d(u,x)) - {text}"), error(dataset, f"d(u,x) - {text}")])
        assert errors[-1][0] < 0.6 * errors[-1][1]
    recovered, raw = np.log2(np.divide(*errors))
    assert recovered >= order + 0.9
    assert raw <= order + 0.2


@pytest.mark.parametrize(("shape", "order"), [(Shape.TETRAHEDRON, 2), (Shape.PYRAMID, 2), (Shape.PRISM, 1)])
def test_recovered_derivatives_are_one_order_more_accurate_in_space(shape, order):
    errors = []
    for cells in (3, 5):
        bare = Dataset(grid(shape, cells))
        field = approximated(bare, "u", lambda p: np.sin(2 * p[:, 0] + 0.3) * np.cos(p[:, 1] + p[:, 2]), order + 1)
        dataset = Dataset(bare.mesh, (field,))
        errors.append(error(dataset, "recovered(d(u,x)) - 2*cos(2*x + 0.3)*cos(y + z)"))
    assert np.log(errors[0] / errors[1]) / np.log(5 / 3) >= order + 0.9


@pytest.mark.parametrize(
    "mesh", [lambda: curved(grid(Shape.QUADRILATERAL, 3), ripple(0.05), 3), lambda: mixed_volume(1)]
)
def test_recovered_fields_are_continuous_and_state_their_distance(mesh):
    bare = Dataset(mesh())
    dataset = Dataset(bare.mesh, (approximated(bare, "u", lambda p: np.exp(p[:, 0] + p[:, 1]), 2),))
    for text in ("recovered(u)", "recovered(d(u,y))"):
        quantity = Expression.of(dataset, text)
        own = Dataset(bare.mesh, (dataset.field(text),))
        assert jumps(own, text)[1].max() < 1e-11 * dataset["u"].range[1]
        assert not quantity.is_local
        (remark,) = remarks_on_recovered(dataset, [quantity])
        raw = text[len("recovered(") : -1]
        assert remark.startswith(
            f"{text} is recovered: a continuous field fitted to the data, which differs from {raw}"
        )
        bound = float(remark.split("at most ")[1].split()[0])
        found = quantity_norms(dataset, [Expression.of(dataset, f"{text} - {raw}")])[f"{text} - {raw}"].linf
        assert 0 < found <= bound * 1.001


def gradient_error(dataset, slopes):
    """Ids (n,) of elements and the true L2 norms (n,) of the error of the gradient of u."""
    squares = " + ".join(f"(d(u,{axis}) - {slope})^2" for axis, slope in slopes.items())
    quantity = Expression.of(dataset, f"({squares})*abs(jacobian)")
    evaluator = Evaluator(dataset, [quantity])
    (patch,) = evaluator.patches
    points, weights = exact_rule(modified(patch.shape, (6,) * patch.shape.dimension))
    rows = np.repeat(np.arange(len(patch)), len(points))
    found = evaluator.values(quantity, patch, rows, np.tile(points, (len(patch), 1)))
    return patch.element_ids, np.sqrt(found.reshape(len(patch), -1) @ weights)


@pytest.mark.parametrize(
    ("shape", "order", "make"),
    [*((shape, 2, approximated) for shape in Shape), (Shape.TRIANGLE, 3, interpolated)],
)
def test_error_of_the_gradient_is_estimated_on_smooth_elements(shape, order, make):
    """Between half and twice the true error on nine of ten elements; it is an attribute of elements too."""
    bare = Dataset(grid(shape, {1: 12, 2: 6, 3: 2}[shape.dimension]))
    rates = dict(zip("xyz"[: shape.dimension], (1.0, 0.7, -0.6), strict=False))
    text = "exp(" + " + ".join(f"{rate}*{axis}" for axis, rate in rates.items()) + ")"
    factors = np.array([*rates.values(), 0, 0])[:3]
    dataset = Dataset(bare.mesh, (make(bare, "u", lambda p: np.exp(p @ factors), order + 1),))
    ids, true = gradient_error(dataset, {axis: f"({rate}*{text})" for axis, rate in rates.items()})
    found = Attributes(dataset).constant("recovered_error(u)", shape, ids)
    quotient = found / true
    assert np.mean((quotient > 0.5) & (quotient < 2)) >= 0.9
    assert 0.8 < np.median(quotient) < 1.25


@pytest.mark.parametrize(
    ("function", "slopes", "from_column"),
    [
        (
            lambda p: np.hypot(p[:, 0], p[:, 1]) ** (2 / 3),
            {axis: f"(2/3*{axis}*(x^2 + y^2)^(-2/3))" for axis in "xy"},
            2,
        ),
        (lambda p: np.exp(-25 * p[:, 0]), {"x": "(-25*exp(-25*x))", "y": "0"}, 0),
    ],
)
def test_errors_of_gradients_are_not_those_of_a_corner_or_layer_nearby(function, slopes, from_column):
    """A corner with its neighbours, and a layer in which the error falls eightfold from element to element."""
    cells, order = 12, 5
    bare = Dataset(grid(Shape.QUADRILATERAL, cells))
    dataset = Dataset(bare.mesh, (approximated(bare, "u", function, order + 1),))
    ids, true = gradient_error(dataset, slopes)
    found = Attributes(dataset).constant("recovered_error(u)", Shape.QUADRILATERAL, ids)
    column, row = np.arange(cells**2) % cells, np.arange(cells**2) // cells
    is_away = (np.maximum(column, row) >= from_column) & (true > 1e-9)
    quotient = found[is_away] / true[is_away]
    assert np.mean((quotient > 0.5) & (quotient < 2)) >= 0.9


def test_bad_fields_are_rejected():
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    dataset = Dataset(bare.mesh, (Field("u", ()),))
    with pytest.raises(ElvisError, match="expected elements of the domain with finite values of u, found none"):
        dataset.field("recovered(u)")
    surface = Dataset(one_element(Shape.TRIANGLE))
    with pytest.raises(ElvisError, match="expected elements of the dimension of the space"):
        Dataset(surface.mesh, (approximated(surface, "u", lambda p: p[:, 0], 3),)).field("recovered(u)")


@pytest.mark.parametrize(("part", "continuous"), [(0.8, True), (1.2, False)])
@pytest.mark.parametrize(("value", "rounding", "kind"), [(1 / 3, DOUBLE, np.float64), (0.25, SINGLE, np.float32)])
def test_fields_are_continuous_if_their_jumps_are_rounding(part, continuous, value, rounding, kind):
    """Ten roundings of the largest coefficient, in the precision in which the field is stored."""
    mesh = grid(Shape.QUADRILATERAL, 2)
    (block,) = approximated(Dataset(mesh), "u", lambda p: np.full(len(p), value), 2).blocks
    coefficients = np.array(block.coefficients)
    coefficients[0, np.abs(coefficients[0]) > 0.5 * value] += part * 10 * rounding * value
    stored = frozen_floats(coefficients.astype(kind).astype(float))
    dataset = Dataset(mesh, (Field("u", (replace(block, coefficients=stored),)),))
    assert is_continuous(dataset, "u") is continuous
    known = replace(dataset, fields=(replace(dataset.fields[0], continuous=not continuous),))
    assert is_continuous(known, "u") is not continuous
