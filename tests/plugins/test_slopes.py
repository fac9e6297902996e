"""Bounds of derivatives of expressions hold what differences show, on curved elements of every shape."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.rounding import UNIT
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.shapes import Shape
from elvis.core.testing import VORTICES, approximated, curved, grid, scattered, swirled
from elvis.plugins.native import NativeVolume

TEXTS = ("q_criterion", "sin(2*u)/(3 + v) + x*exp(v)", "d(u,x)^3 - sqrt(2 + u*u)*y", "log(2 + u) - atan(w*d(v,y))")
FLAT = ("vorticity", "x*exp(u)/(3 + v)")
STEP = 1e-3


def slopes_of(dataset, text, elements):
    (part,) = NativeVolume.of(dataset, ["u", text]).parts
    return part.quantities[text].slopes.of(elements, 1.25)


def flow(shape, cells=1):
    mesh = Dataset(curved(grid(shape, cells), swirled, 3))
    return replace(mesh, fields=tuple(approximated(mesh, name, wave, 4) for name, wave in VORTICES.items()))


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1 and shape is not Shape.PYRAMID])
def test_no_difference_exceeds_the_bounds(shape):
    """Centred differences are derivatives somewhere between their ends; bounds are not a hundred times as large."""
    dataset, axes = flow(shape, 3), np.eye(shape.dimension)
    texts = TEXTS if shape.dimension == 3 else FLAT
    evaluator = Evaluator(dataset, [Expression.of(dataset, text) for text in texts])
    (patch,) = evaluator.patches
    middle = shape.vertices.mean(axis=0)
    reference = middle + 0.95 * (scattered(shape, 100, seed=2) - middle)
    elements = np.arange(0, len(patch), 1 + len(patch) // 10)
    own = np.resize(np.arange(len(elements)), len(reference))
    rows = elements[own]

    for expression in evaluator.expressions:
        found = slopes_of(dataset, expression.text, elements)

        def at(offset, expression=expression):
            return evaluator.values(expression, patch, rows, reference + STEP * offset)

        first = sum(np.abs(at(a) - at(-a)) for a in axes) / (2 * STEP)
        second = sum(np.abs(at(a + b) - at(a - b) - at(b - a) + at(-a - b)) for a in axes for b in axes)
        second = second / (4 * STEP**2)
        assert (first <= found.gradient[own]).all(), expression.text
        assert (second <= found.curvature[own] + 1e-6 * second.max()).all(), expression.text
        assert np.isfinite(found.curvature).mean() > 0.4, expression.text
        assert np.median(found.gradient) < 100 * first.max(), expression.text
        assert np.median(found.noise) < 1e-8 * np.ptp(at(np.zeros(len(axes)))), expression.text


#: largest coordinate in the unit cube extended by a quarter to all sides
FAR = 1.125


@pytest.mark.parametrize(
    ("text", "gradient", "curvature"),
    [
        ("x + 2*y", 1.5, 0.0),
        ("x*y", FAR, 0.5),
        ("x*y*z", 1.5 * FAR**2, 1.5 * FAR),
        ("u", FAR, 0.5),
        ("u*z", 1.5 * FAR**2, 1.5 * FAR),
        ("d(u,x)", 0.5, 0.0),
        ("d(u,x)*z", FAR, 0.5),
        ("x^3", 1.5 * FAR**2, 1.5 * FAR),
        ("min(x, y)", 1.0, np.inf),
        ("min(x, y + 2)", 0.5, 0.0),
        ("abs(x + 1)", 0.5, 0.0),
        ("abs(x - 2)", 0.5, 0.0),
        ("abs(x)", 0.5, np.inf),
    ],
)
def test_bounds_of_multilinear_expressions_are_the_suprema(text, gradient, curvature):
    """In the unit cube, with reference coordinates from -1 to 1 and u = x y: sums of derivatives, each at its worst."""
    mesh = Dataset(grid(Shape.HEXAHEDRON, 1))
    dataset = replace(mesh, fields=(approximated(mesh, "u", lambda p: p[:, 0] * p[:, 1], 2),))
    (part,) = NativeVolume.of(dataset, ["u", "abs(u)"]).parts
    bounds = replace(part.quantities["abs(u)"].slopes.of.__self__, expression=Expression.of(dataset, text))
    found = bounds.of(np.zeros(1, int), 1.25)
    assert found.gradient == pytest.approx([gradient], rel=1e-9)
    assert found.curvature == pytest.approx([curvature], rel=1e-9, abs=1e-9)

    # the errors of the coordinates, as far as values carry them, and of eight roundings of each operation
    if text in ("x*y", "x^3"):
        error = 4 * bounds.errors()[0, :2].sum()
        carried = FAR * error if text == "x*y" else 3 * FAR**2 * error / 2
        rounding = 8 * UNIT * (FAR**2 if text == "x*y" else 4 * FAR**3)
        assert found.noise == pytest.approx([1.01 * carried + rounding], rel=1e-6, abs=0)


def test_no_difference_on_pyramids_exceeds_the_bounds_of_its_box():
    """In boxes of collapsed coordinates, the nearer to the apex the smaller; derivatives in reference coordinates."""
    dataset, axes = flow(Shape.PYRAMID, 2), np.eye(3)
    evaluator = Evaluator(dataset, [Expression.of(dataset, text) for text in (*TEXTS, "x*x + 2*y*z")])
    (patch,) = evaluator.patches
    rng = np.random.default_rng(7)
    elements = np.repeat(np.arange(0, len(patch), 3), 8)
    share = 10.0 ** rng.uniform(-1.5, 0.0, len(elements))
    half = np.column_stack([rng.uniform(0.05, 0.5, (len(elements), 2)), 0.4 * share])
    middle = np.column_stack([rng.uniform(-0.5, 0.5, (len(elements), 2)), 1 - 2 * share])

    eta = middle + half * rng.uniform(-0.9, 0.9, half.shape)
    reference = uncollapse(Shape.PYRAMID, eta)
    step = 1e-3 * share[:, None]
    for expression in evaluator.expressions:
        (part,) = NativeVolume.of(dataset, ["u", expression.text]).parts
        slopes = part.quantities[expression.text].slopes
        if slopes is None:
            assert part.quantities[expression.text].degree
            continue
        found = slopes.in_boxes(elements, middle, half)
        at_apex = slopes.in_boxes(elements[:1], np.zeros((1, 3)), np.ones((1, 3)))
        assert np.isinf(at_apex.curvature).all()

        def at(offset, expression=expression):
            return evaluator.values(expression, patch, elements, reference + step * offset)

        first = sum(np.abs(at(a) - at(-a)) for a in axes) / (2 * step[:, 0])
        second = sum(np.abs(at(a + b) - at(a - b) - at(b - a) + at(-a - b)) for a in axes for b in axes)
        second = second / (4 * step[:, 0] ** 2)
        rounding = 1e-14 * np.abs(at(np.zeros(3))).max() / step[:, 0] ** 2
        assert (first <= found.gradient + rounding * step[:, 0]).all(), expression.text
        assert (second <= found.curvature + rounding).all(), expression.text
        assert np.isfinite(found.curvature).mean() > 0.4, expression.text
        assert np.median(found.gradient / np.maximum(first, 0.1 * first.max())) < 100, expression.text


def test_first_derivatives_are_bounded_at_kinks_and_none_at_poles():
    dataset, element = flow(Shape.HEXAHEDRON), np.zeros(1, int)
    for text in ("laplacian(u)", "u^0.5", "lambda2", "jacobian"):
        assert NativeVolume.of(dataset, ["u", text]).parts[0].quantities[text].slopes is None, text
    for text in ("1/(u - u*v)", "sqrt(d(u,x))", "tan(20*d(u,x))"):
        assert np.isinf(slopes_of(dataset, text, element).curvature).all(), text
    for text in ("abs(u)", "max(u, 0*v)", "min(u, v*0)"):
        kinked = slopes_of(dataset, text, element)
        assert np.isinf(kinked.curvature).all(), text
        assert np.isfinite(kinked.gradient).all(), text
