"""Errors of integrals are bounds: never less than the truth, for kinks, bumps, near poles and small supports too."""

from dataclasses import replace
from fractions import Fraction
from itertools import product
from math import asinh, atan, erf, pi, prod, sqrt

import numpy as np
import pytest
from warps import bubble

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import ERROR, analytic_error, integrate
from elvis.core.integrals.box_discs import RHOS, _growths
from elvis.core.integrals.eta_boxes import EtaBoxes, lattice_counts
from elvis.core.integrals.reference_cells import Piece, box_rule
from elvis.core.integrals.tree_discs import divided
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple, with_field

BODIES = [shape for shape in Shape if shape.dimension > 1]
C = 0.37
#: integrands of the unit square or cube with their integrals
CLOSED = {
    "abs(x-0.37)": (C * C + (1 - C) ** 2) / 2,
    "max(u-0.37,0)": (1 - C) ** 2 / 2,
    "sign(x-0.37)*x": (1 - 2 * C * C) / 2,
    "exp(-((x-0.37)/0.01)^2)": 0.01 * sqrt(pi) / 2 * (erf(63) + erf(37)),
    "max(0.0001-(x-0.37)^2,0)": 4 / 3 * 1e-6,
    "1/((x-0.37)^2+0.0004)": (atan(31.5) + atan(18.5)) / 0.02,
    "sqrt((u-0.37)^2+0.0001)": (0.63 * np.hypot(0.63, 0.01) + C * np.hypot(C, 0.01)) / 2
    + 5e-5 * (asinh(63) + asinh(37)),
    "1/sqrt(x)": 2.0,
    "sqrt(x*y)": 4 / 9,
    "if(x-0.37, x, step(y-0.37))": (1 - C * C) / 2 + C * (1 - C),
}


@pytest.mark.sampled(least=6)
@pytest.mark.parametrize("text", CLOSED)
@pytest.mark.parametrize("is_bent", [False, True])
@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize("shape", BODIES)
def test_stated_errors_are_never_below_the_true_ones(shape, order, is_bent, text, monkeypatch):
    monkeypatch.setattr("elvis.core.integrals.refinement._MOST", 1 << (15 if "1/sqrt" in text else 12))
    mesh = grid(shape, 2)
    if is_bent:
        dataset, text_there = Dataset(curved(mesh, bubble, 3)), text.replace("u", "x")
    else:
        dataset, text_there = with_field(mesh, lambda points: points[:, 0], order + 1), text
    for error in (1e-2, 1e-5):
        (row,) = integrate(dataset, text_there, error=error)
        assert not row.exact
        assert abs(row.value - CLOSED[text]) <= row.error
        assert row.kind == ("estimate" if "1/sqrt" in text else "bound")


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_narrow_bumps_and_small_supports_are_found(shape):
    """Also where no point of the first rule sees them."""
    for text in ("exp(-((x-0.37)/0.01)^2)", "max(0.0001-(x-0.37)^2,0)"):
        (row,) = integrate(Dataset(grid(shape, 1)), text)
        assert row.error < 3 * ERROR * CLOSED[text]
        assert abs(row.value - CLOSED[text]) <= row.error


def test_jacobians_of_bent_pyramids_need_no_sign_on_boxes(monkeypatch):
    """Near the tip the discs of det J hold zero, although the element is valid."""
    monkeypatch.setattr("elvis.core.integrals.refinement._MOST", 1 << 15)
    text = "exp(-((x-0.37)/0.01)^2)"
    (row,) = integrate(Dataset(curved(grid(Shape.PYRAMID, 2), bubble, 3)), text, error=1e-2)
    assert row.kind == "bound"
    assert abs(row.value - CLOSED[text]) <= row.error


def test_a_ball_between_sample_points_is_found():
    (row,) = integrate(Dataset(grid(Shape.HEXAHEDRON, 2)), "max(0.0009-(x-.37)^2-(y-.41)^2-(z-.43)^2,0)", error=1e-2)
    truth = 8 / 15 * pi * 0.03**5
    assert abs(row.value - truth) <= row.error < 0.1 * truth


@pytest.mark.parametrize("shape", BODIES)
def test_smooth_integrands_reach_the_requested_error(shape):
    truth = (np.e - 1) * (1 - np.cos(1))
    for error in (1e-3, 1e-6, 1e-9):
        (row,) = integrate(Dataset(grid(shape, 1)), "exp(x)*sin(y)", error=error)
        assert abs(row.value - truth) <= row.error <= 1.01 * error * truth + 1e-14


@pytest.mark.parametrize("shape", BODIES)
def test_gradients_and_normals_on_curved_elements_are_bounded(shape):
    """A gradient of x is 1; the flux of a constant through a closed surface by its normal's components is 0."""
    mesh = curved(grid(shape, 1), bubble, 3)
    dataset = replace(Dataset(mesh), fields=(approximated(Dataset(mesh), "u", lambda points: points[:, 0], 3),))
    (row,) = integrate(dataset, "exp(d(u,x))")
    assert abs(row.value - np.e) <= row.error < 1e-4
    assert row.kind == "bound"
    outside = curved(grid(shape, 1), ripple(0.05), 3)
    if shape.dimension == 2:
        outside = replace(outside, vertices=outside.vertices * [1, 1, 0])
    (row,) = integrate(Dataset(outside), "sqrt(2 + nx) - sqrt(2 + nx) + nx*nx + ny*ny + nz*nz", "all")[-1:]
    (area,) = integrate(Dataset(outside), "area", "all", error=1e-9)[-1:]
    assert abs(row.value - area.value) <= row.error + area.error
    assert row.kind == area.kind == "bound"


def test_without_a_part_of_the_bound_errors_are_less_than_the_truth(monkeypatch):
    """The ellipse of a wider parameter without its greater values, and a bound of one direction alone."""
    dataset, truth = Dataset(grid(Shape.QUADRILATERAL, 1)), CLOSED["1/((x-0.37)^2+0.0004)"]

    def is_true():
        (row,) = integrate(dataset, "1/((x-0.37)^2+0.0004)", error=1e-2)
        return abs(row.value - truth) <= row.error

    assert is_true()
    with monkeypatch.context() as patch:
        patch.setattr(analytic_error, "gauss_factors", lambda counts: 1e-12 * np.ones((len(counts), len(RHOS))))
        assert not is_true()
    with monkeypatch.context() as patch:
        patch.setattr("elvis.core.integrals.box_discs._growths", lambda count: _growths(count) * 0.0 + 1e-3)
        assert not is_true()


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_factors_bound_the_errors_of_gauss_rules(count):
    """By 1/(z - a), whose largest value on an ellipse is at its end."""
    nodes, weights = gauss(count)
    for rho, factor in zip(RHOS, analytic_error.gauss_factors([count])[0], strict=True):
        end = (rho + 1 / rho) / 2
        for a in end * np.array([1.0001, 1.01, 1.3]):
            off = abs(np.sum(weights / (nodes - a)) - np.log((a - 1) / (a + 1)))
            assert off <= factor / (a - end) + 1e-15


@pytest.mark.parametrize("is_side", [False, True])
@pytest.mark.parametrize("shape", BODIES)
def test_points_in_boxes_have_the_values_of_elements(shape, is_side):
    """Interpolated from lattices of whole elements: positions, derivatives, fields."""
    mesh = curved(grid(shape, 1), bubble, 3)
    dataset = replace(Dataset(mesh), fields=(approximated(Dataset(mesh), "u", lambda p: np.sin(p[:, 0]), 4),))
    (patch,) = patches(dataset, ("u",))
    side = Shape.SEGMENT if shape.dimension == 2 else Shape.TRIANGLE if shape is not Shape.HEXAHEDRON else None
    side = Shape.QUADRILATERAL if side is None else side
    number = 1 if shape in (Shape.PRISM, Shape.PYRAMID) else 0
    piece = Piece(patch, np.arange(len(patch)), side, number) if is_side else Piece(patch, np.arange(len(patch)), shape)
    whole = EtaBoxes.whole(piece, np.zeros((len(piece), 1)))
    boxes = whole.halves().halved(np.eye(whole.low.shape[1], dtype=bool)[np.zeros(len(whole.halves()), int)])
    counts = tuple(count + 1 for count in lattice_counts(piece))
    found, shares, _ = boxes.quadrature(counts)
    direct = ElementPoints(patch, found.rows, found.points)
    for name in ("positions", "jacobians"):
        np.testing.assert_allclose(getattr(found, name), getattr(direct, name), atol=1e-13)
    np.testing.assert_allclose(found.derivative(0, 0), direct.derivative(0, 0), atol=1e-13)
    np.testing.assert_allclose(found.derivative(0, 1), direct.derivative(0, 1), atol=1e-11)
    assert shares.sum() == pytest.approx(whole.quadrature(tuple(count + 4 for count in counts))[1].sum(), rel=1e-6)


def test_a_single_value_of_several_quantities_is_rejected():
    found = integrate(Dataset(grid(Shape.TRIANGLE, 1)), ["x", "y"])
    with pytest.raises(ElvisError, match=r"expected one quantity, found x, y; take one by of\('x'\)\.value"):
        _ = found.value
    assert found.of("y").value == pytest.approx(0.5)


def test_unbounded_integrals_are_called_estimates():
    found = integrate(Dataset(grid(Shape.TRIANGLE, 1)), ["distance(all)", "exp(x)", "x"], error=1e-2)
    assert [row.kind for row in found] == ["estimate", "bound", "exact"]
    assert "(estimate)" in repr(found).splitlines()[1]


def test_long_sums_under_roots_are_bounded():
    """A sum of 120 squares."""
    text = "+".join(["(x+1)^2"] * 120)
    (row,) = integrate(Dataset(grid(Shape.TRIANGLE, 1)), f"sqrt({text})", error=1e-4)
    assert abs(row.value - 1.5 * sqrt(120)) <= row.error
    assert row.kind == "bound"


def test_speed_near_a_wall_is_bounded():
    """sqrt(u^2 + v^2) with u = y and v = x y: a root of 0 on the wall, where only intervals are known."""
    dataset = Dataset(grid(Shape.TRIANGLE, 2))
    (row,) = integrate(dataset, "sqrt(y^2 + (x*y)^2)", error=1e-5)
    truth = (sqrt(2) + asinh(1)) / 4
    assert abs(row.value - truth) <= row.error <= 1.1e-5 * truth
    assert row.kind == "bound"


def no_slip(points):
    """A velocity of degree 3 between walls y = 0 and y = 1, of length y (1 - y) (1 + x)."""
    x, y, _ = points.T
    return np.outer([2 / 3, -1 / 3, 2 / 3], y * (1 - y) * (1 + x))


@pytest.mark.parametrize(
    ("shape", "order", "is_bent", "error"),
    [
        (Shape.HEXAHEDRON, 4, False, 1e-9),
        (Shape.HEXAHEDRON, 7, True, 1e-6),
        (Shape.PRISM, 4, False, 1e-6),
        (Shape.PYRAMID, 4, False, 1e-3),
        (Shape.TETRAHEDRON, 4, False, 1e-4),
    ],
)
def test_speed_between_walls_takes_few_points(shape, order, is_bent, error, monkeypatch):
    """Zeros on faces of elements come out of the root; only elements with a zero on an edge are divided."""
    monkeypatch.setattr("elvis.core.integrals.refinement._MOST", 1 << 17)
    mesh = grid(shape, 1)
    dataset = Dataset(curved(mesh, bubble, 3) if is_bent else mesh)
    velocity = [approximated(dataset, name, lambda p, k=k: no_slip(p)[k], order) for k, name in enumerate("uvw")]
    (row,) = integrate(replace(dataset, fields=tuple(velocity)), "sqrt(u*u + v*v + w*w)", error=error)
    assert abs(row.value - 1 / 4) <= row.error <= 1.01 * error / 4
    assert row.kind == "bound"


@pytest.mark.parametrize("end", [-1.0, 1.0])
@pytest.mark.parametrize("remainder", [0.0, 1e-14])
def test_cofactors_with_their_slack_contain_polynomials(end, remainder):
    """(1 - end t)^2 (2 + s) and a remainder on the face."""
    counts = (4, 3)
    nodes, _ = box_rule(counts)
    t, s = nodes.T

    def polynomial(t, s):
        return (1 - end * t) ** 2 * (2 + s) + remainder * (1 + s)

    found = divided(polynomial(t, s)[None], counts)
    assert found.powers.tolist() == [[2, 0, 0, 0] if end < 0 else [0, 2, 0, 0]]
    np.testing.assert_allclose(found.values, (2 + s)[None], atol=1e-11)
    off = np.abs((1 - end * t) ** 2 * found.values[0] - polynomial(t, s)).max()
    assert max(off, 2 * remainder) <= found.slack[0] < 1e-11


@pytest.mark.parametrize(
    ("text", "truth"),
    [
        ("sqrt(x^2 + (x*y)^2)", (sqrt(2) + asinh(1)) / 4),
        ("abs(x*(1+y))", 3 / 4),
        ("max(x, 2*x*y)", 5 / 8),
    ],
)
def test_zeros_on_faces_of_functions_are_found(text, truth):
    (row,) = integrate(Dataset(grid(Shape.QUADRILATERAL, 2)), text, error=1e-5)
    assert abs(row.value - truth) <= row.error <= 1.01e-5 * truth
    assert row.kind == "bound"


def test_slack_is_part_of_the_error(monkeypatch):
    """A speed of 1e-13 on the wall."""
    velocity = tuple(
        approximated(Dataset(grid(Shape.HEXAHEDRON, 1)), name, lambda p, k=k: (p[:, 1] + 1e-13) * [1, p[:, 0]][k], 3)
        for k, name in enumerate("uv")
    )
    dataset = replace(Dataset(grid(Shape.HEXAHEDRON, 1)), fields=velocity)
    (row,) = integrate(dataset, "sqrt(u*u + v*v)", error=1e-9)
    assert abs(row.value - (0.5 + 1e-13) * (sqrt(2) + asinh(1)) / 2) <= row.error
    monkeypatch.setattr("elvis.core.integrals.refinement._MOST", 1 << 14)
    (row,) = integrate(dataset, "sqrt(u*u + v*v)", error=1e-15)
    assert row.error > 1e-13


@pytest.mark.parametrize("shape", BODIES)
def test_rounding_of_exact_rules_counts_values_away_from_the_middle(shape):
    """High powers are small in the middle of an element, where their sizes are taken."""
    dataset = Dataset(grid(shape, 1))
    names = "xyz"[: shape.dimension]
    for powers in product((1, 5, 8), repeat=shape.dimension):
        text = "*".join(f"{name}^{power}" for name, power in zip(names, powers, strict=True))
        truth = 1 / prod(Fraction(power + 1) for power in powers)
        (row,) = integrate(dataset, text)
        assert row.kind == "exact"
        assert abs(Fraction(float(row.value)) - truth) <= row.error < 1e-14


def test_levels_of_degrees_above_twenty_are_integrated():
    """Factorials above 20! exceed 64 bits."""
    mesh = grid(Shape.QUADRILATERAL, 1)
    (row,) = integrate(with_field(mesh, lambda points: points[:, 0], 8), "length", "u^3+(u-x)^2=0.2", error=1e-2)
    assert abs(row.value - 1) <= row.error
