"""The smallest factor of a displacement that folds an element: closed forms, bounds, and dense samples."""

from dataclasses import replace
from math import inf
from time import process_time
from types import SimpleNamespace

import numpy as np
import pytest

from elvis import Dataset, ElvisError, Shape, largest_scale
from elvis.core.deformed.deforming import moving_maps
from elvis.core.mapping.geometry import geometry
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.testing import approximated, curved, grid, ripple, scattered
from elvis.core.validity.largest_scale import _is_positive, _Piece

SOLIDS = [Shape.TETRAHEDRON, Shape.PYRAMID, Shape.PRISM, Shape.HEXAHEDRON]
FLAT = [Shape.TRIANGLE, Shape.QUADRILATERAL]


def still(x):
    return 0 * x[:, 0]


#: displacements, their degree, and the smallest factor at which det(1 + S grad d) = 0 on the unit cube
CLOSED_FORMS = {
    # (1 - S)^n
    "swelling": ([lambda x: -x[:, 0], lambda x: -x[:, 1], lambda x: -x[:, 2]], 1, 1.0),
    # 1 - S y, smallest along one side
    "bending": ([lambda x: -x[:, 0] * x[:, 1], still, still], 2, 1.0),
    # 1 - 2 S (x - 0.3), smallest on one face
    "stretching": ([lambda x: -((x[:, 0] - 0.3) ** 2), still, still], 2, 1 / 1.4),
    # 1 - S (x - x^2), smallest in the middle
    "pinching": ([lambda x: -(x[:, 0] ** 2 / 2 - x[:, 0] ** 3 / 3), still, still], 3, 4.0),
    # 1
    "shear": ([lambda x: x[:, 1] ** 2, still, still], 2, inf),
    # 1 + S^2
    "turning": ([lambda x: x[:, 1], lambda x: -x[:, 0], still], 1, inf),
}


def displaced(mesh, functions, order):
    data, names = Dataset(mesh), "uvw"[: mesh.space]
    fields = [approximated(data, name, own, order + 1) for name, own in zip(names, functions, strict=False)]
    return replace(data, fields=tuple(fields)), ",".join(names)


@pytest.mark.parametrize("name", CLOSED_FORMS)
@pytest.mark.parametrize("shape", [*FLAT, *SOLIDS])
def test_analytic_values_are_reached_to_a_millionth(shape, name):
    functions, order, expected = CLOSED_FORMS[name]
    found = largest_scale(*displaced(grid(shape, 1), functions, order))
    assert found.is_certified
    if expected == inf:
        assert (found.folded, found.element) == (inf, -1)
        assert found.valid > 1e3
        return
    assert found.valid <= expected <= found.folded
    assert found.folded - found.valid <= 1e-6 * expected
    assert found.state == ("zero" if name == "swelling" else "negative")


def test_a_twist_is_valid_at_large_factors(slowness):
    """The determinant, 1 + S^2 (z - 0.3)^2, has values of very different size when S is large."""
    functions = [lambda x: x[:, 1] * (x[:, 2] - 0.3), lambda x: -x[:, 0] * (x[:, 2] - 0.3), still]
    data = displaced(curved(grid(Shape.TETRAHEDRON, 1), ripple(0.02), 3), functions, 5)
    start = process_time()
    found = largest_scale(*data)
    assert found.folded == inf
    assert found.valid > 100
    assert process_time() - start < 3 * slowness


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_analytic_values_are_reached_on_curved_elements(shape):
    # maps of degree 2 and displacements of degree 2 in x are of degree 4 in the coordinates of the elements
    data = Dataset(curved(grid(shape, 1), ripple(0.03), 3))
    points = np.concatenate([shape.vertices, scattered(shape, 500)])
    highest = max(evaluate(own.expansion, own.coefficients[:, 1], points).max() for own in geometry(data))
    for name, scale in {"swelling": 1.0, "bending": 1.0 / highest, "shear": inf}.items():
        found = largest_scale(*displaced(data.mesh, CLOSED_FORMS[name][0], 4))
        assert found.is_certified
        assert found.folded == pytest.approx(scale, rel=1e-6)
        if scale < inf:
            assert found.valid == pytest.approx(scale, rel=1e-6)


def jacobians(maps, points, scale):
    """(elements, points) determinants, by the derivatives of the map at points alone."""
    dimension = points.shape[1]
    own = (maps.places + scale * maps.moves)[:, :dimension]
    return np.linalg.det(evaluate_with_gradients(maps.expansion, own, points)[1].transpose(0, 2, 1, 3))


@pytest.mark.parametrize("shape", [Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_curved_elements_are_valid_up_to_the_bound_and_folded_beyond(shape):
    functions = [lambda x: np.sin(3 * x[:, 1]) + x[:, 2], lambda x: np.cos(2 * x[:, 0]), lambda x: np.sin(3 * x[:, 0])]
    data, names = displaced(curved(grid(shape, 1), ripple(0.03), 3), functions, 2)
    found = largest_scale(data, names)
    assert found.is_certified
    points, least = scattered(shape, 2000), []
    for maps in moving_maps(geometry(data), data.fields):
        least += [jacobians(maps, points, share * found.valid).min() for share in (0.3, 0.7, 1.0)]
        row = np.flatnonzero(maps.element_ids == found.element)
        if len(row):
            there = jacobians(maps, np.array([found.reference]), found.folded)[row[0], 0]
    assert min(least) > 0
    assert there < 0


def test_elements_folded_in_the_original_geometry_have_no_valid_scale():
    mesh = grid(Shape.QUADRILATERAL, 1)
    data, names = displaced(replace(mesh, vertices=mesh.vertices * [-1.0, 1.0, 1.0]), CLOSED_FORMS["bending"][0], 2)
    assert largest_scale(data, names).folded == 0


def test_surfaces_in_space_are_rejected():
    mesh = replace(grid(Shape.QUADRILATERAL, 1), space=3)
    with pytest.raises(ElvisError, match="expected elements of the dimension of space"):
        largest_scale(*displaced(mesh, CLOSED_FORMS["swelling"][0], 1))


def test_all_roundings_of_values_are_counted(monkeypatch):
    """Entries of the change to Bernstein form in S have twelve, the sum over c_0 to c_3 four more."""
    monkeypatch.setitem(_Piece.error_at.__globals__, "_UNIT", 2.0**-10)
    sizes, errors = np.array([[1.0, 2.0, 4.0, 8.0]]), np.array([[0.5, 0.0, 1.0, 0.0]])
    own = SimpleNamespace(nets=np.zeros((1, 2, 2, 2, 4)), errors=errors, sizes=sizes)
    assert _Piece.error_at(own, 0.5) == [0.5 + 0.25 + 16 * 2.0**-10 * 4.0]


def test_polynomials_are_positive_if_all_their_coefficients_in_the_scale_are():
    """In Bernstein form: (2 t - 1)^2 + c, which is a square for c = 0, next to one without a zero."""
    for constant, is_positive in ((0.1, True), (0.0, False), (-0.1, False)):
        parabola = np.array([1.0, -1.0, 1.0]) + constant
        net = np.stack([np.ones((3, 2)), parabola[:, None] * np.ones(2)], axis=-1)
        assert _is_positive(net, 1e-6) == is_positive
