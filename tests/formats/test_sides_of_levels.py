"""On which side of a level set an expression is less: volumes by many points, fluxes by the divergence theorem."""

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Sampler
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid

SHAPES = [shape for shape in Shape if shape.dimension > 1]
PLANES = Shape.of_dimension(2)
POINTS = np.random.default_rng(7).uniform(0.001, 0.999, (20000, 3))
#: five standard deviations of a mean of that many values of size one half
NOISE = 5 * 0.5 / np.sqrt(len(POINTS))
FIELDS = {
    "u": lambda p: -p[:, 0] * p[:, 1] - 0.1,
    "w": lambda p: 1 + p[:, 0] * p[:, 1],
    "s": lambda p: p[:, 0] - 0.45 + 0.2 * p[:, 1],
}
#: expressions of f that increase or decrease with it, for both signs of every constant
OF_ONE = [
    "f",
    "-f",
    "2*f",
    "f*(-2)",
    "f/3",
    "f/(-3)",
    "1 - f",
    "f - 1",
    "-1/f",
    "1/f",
    "x/f",
    "f/x",
    "-f/x",
    "f/(-1 - x)",
]
OF_ONE += [
    "w*x/f",
    "f^2",
    "f^3",
    "f^-1",
    "f^-2",
    "abs(f)",
    "-abs(f)",
    "1/abs(f)",
    "exp(-f)",
    "tanh(2*f)",
    "1 - atan(f)",
]
OF_ONE += ["sinh(f)/(-2)", "sqrt(2 - f)", "-sqrt(2 - f)", "log(f + 2)", "-log(f + 2)", "sqrt(f + 0.4)"]
#: of two or more, which are intersections and unions of regions
OF_SEVERAL = ["max(f, y - 0.5)", "-max(f, y - 0.5)", "min(f, s)", "1 - min(1/(1 + y), f)", "max(min(f, s), u)"]
OF_SEVERAL += ["middle_eigenvalue(f, y - 0.5, x - 0.3, 0.1, 0.2*x, 0.1*y)", "-middle_eigenvalue(f, y, 0.1, 0.3, x, s)"]
OF_SEVERAL += ["imaginary_root(f + 0.2, y - 0.5)", "-imaginary_root(f - 0.4, s)", "f*s", "-f*s/u", "s/(f*u)"]


def gas(shape):
    bare = Dataset(grid(shape, 1))
    fields = (approximated(bare, name, function, 3) for name, function in FIELDS.items())
    return Dataset(bare.mesh, tuple(fields))


def values(dataset, text):
    """(n,) values at the points; in the plane where z is zero."""
    points = POINTS * [1, 1, dataset.mesh.dimension > 2]
    return Sampler(dataset, [Expression.of(dataset, text)]).sample(points).values[:, 0]


def level(dataset, text):
    """A value that the expression is less than on a quarter of the domain."""
    own = values(dataset, text)
    return own, round(float(np.quantile(own[np.isfinite(own)], 0.25)), 4)


@pytest.mark.sampled(least=12)
@pytest.mark.parametrize("own", ["u", "w", "s", "d(u,x)", "-d(u,x)"])
@pytest.mark.parametrize("form", [*OF_ONE, *OF_SEVERAL])
def test_clips_leave_the_side_where_the_expression_is_smaller(form, own):
    # in solids quotients of derivatives and coordinates take seconds each
    shapes = PLANES if "x" in form and "d(" in own else SHAPES
    shape = shapes[(len(form) + len(own)) % len(shapes)]
    dataset, text = gas(shape), form.replace("f", f"({own})")
    every, value = level(dataset, text)
    measure = "area" if shape.dimension == 2 else "volume"
    for clip, inside in ((f"outside:{text}={value!r}", every < value), (f"{text}={value!r}", every > value)):
        found = integrate(dataset, [measure, "x"], clip=clip, error=1e-2)
        truth = [inside.mean(), (inside * POINTS[:, 0]).mean()]
        assert all(abs(row.value - own) <= NOISE for row, own in zip(found, truth, strict=True))
        assert found[0].error < 0.02


def test_a_factor_of_unknown_sign_keeps_its_sign():
    """u = -x y: -d(u,x) = y is greater than 0.6 on 0.4 of the cube."""
    bare = Dataset(grid(Shape.TETRAHEDRON, 1))
    dataset = Dataset(bare.mesh, (approximated(bare, "u", lambda p: -p[:, 0] * p[:, 1], 3),))
    assert integrate(dataset, "volume", clip="-d(u,x)=0.6", error=1e-10).value == pytest.approx(0.4, rel=1e-12)
    assert integrate(dataset, "ny", over="-d(u,x)=0.6", error=1e-10).value == pytest.approx(1.0, rel=1e-12)
    assert integrate(dataset, "ny", over="d(u,x)=-0.6", error=1e-10).value == pytest.approx(-1.0, rel=1e-12)


@pytest.mark.sampled(least=6)
@pytest.mark.parametrize("own", ["u", "s", "-d(u,x)"])
@pytest.mark.parametrize(
    "form",
    ["f", "1 - f", "-2*f", "f/(-3)", "f/(-1 - x)", "abs(f)", "exp(-f)", "f^3", "sqrt(2 - f)", "-max(f, y - 0.5)"],
)
def test_fluxes_through_level_sets_match_those_of_the_divergence(form, own):
    """The vector (x (1 - x), y (1 - y), 0) has no flux through the sides of the cube, whose normals are axes."""
    shape = SHAPES[(len(form) + len(own)) % len(SHAPES)]
    dataset, text = gas(shape), form.replace("f", f"({own})")
    every, value = level(dataset, text)
    found = integrate(dataset, ["x*(1-x)*nx", "y*(1-y)*ny"], over=f"{text}={value!r}", error=1e-3)
    inside = every < value
    truth = [(inside * (1 - 2 * POINTS[:, axis])).mean() for axis in range(2)]
    assert all(abs(row.value - own) <= NOISE for row, own in zip(found, truth, strict=True))
    assert max(np.abs(truth)) > NOISE


def test_poles_bound_a_clip_but_are_not_surfaces():
    """1/(x - 0.3) < 2 holds for x < 0.3 and x > 0.8; the value 2 is attained at x = 0.8 only, decreasing."""
    dataset = Dataset(grid(Shape.HEXAHEDRON, 1))
    assert integrate(dataset, "volume", clip="outside:1/(x-0.3)=2", error=1e-10).value == pytest.approx(0.5, rel=1e-12)
    assert integrate(dataset, "volume", clip="1/(x-0.3)=2", error=1e-10).value == pytest.approx(0.5, rel=1e-12)
    found = integrate(dataset, ["area", "nx"], over="1/(x-0.3)=2", error=1e-10)
    assert [row.value for row in found] == pytest.approx([1, -1], rel=1e-12)


def test_points_without_a_value_are_on_neither_side():
    """sqrt(x - 0.3) is less than 0.5 from 0.3 to 0.55, and greater beyond."""
    dataset = Dataset(grid(Shape.PRISM, 1))
    assert integrate(dataset, "volume", clip="outside:sqrt(x-0.3)=0.5", error=1e-10).value == pytest.approx(
        0.25, rel=1e-12
    )
    assert integrate(dataset, "volume", clip="sqrt(x-0.3)=0.5", error=1e-10).value == pytest.approx(0.45, rel=1e-12)
    assert integrate(dataset, "volume", clip="sqrt(x-0.3)=-0.5", error=1e-10).value == pytest.approx(0.7, rel=1e-12)
    assert integrate(dataset, "area", over="sqrt(x-0.3)=-0.5", error=1e-10).value == 0.0
