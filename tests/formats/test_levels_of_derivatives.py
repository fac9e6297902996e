"""Surfaces and parts of curved elements by derivatives, against closed forms.

With u = x y on elements that hold this exactly, d(u,x) is y and d(u,y) is x.
"""

from dataclasses import replace
from math import asinh, pi, sqrt

import numpy as np
import pytest
from warps import bubble

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.quantities import expression_nets
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, with_field

BODIES = [shape for shape in Shape if shape.dimension > 1]
ERROR = 1e-3
#: shapes whose grids of one cell have no sides inside, which alone the warp bends
INSIDE = (Shape.QUADRILATERAL, Shape.HEXAHEDRON)


def swelling(points):
    """A warp of the unit square with a volume that varies."""
    x, y, z = points.T
    return np.stack([x + 0.9 * x * y, y - 0.4 * x * x, z], axis=1)


def bent(shape: Shape, product=lambda x, y: x * y) -> Dataset:
    mesh = curved(grid(shape, 2 if shape in INSIDE else 1), bubble, 3)
    return with_field(mesh, lambda points: product(points[:, 0], points[:, 1]), 5)


#: levels with the area of the surface, and the volume where the quantity is less
CLOSED = {
    "d(u,x)=0.37": (1.0, 0.37),
    "-d(u,x)=-0.37": (1.0, 0.63),
    "d(u,x)^2+d(u,y)^2=0.36": (0.3 * pi, 0.09 * pi),
    "d(u,x)/(1+d(u,y))=0.5": (sqrt(1.25), 0.75),
    "d(u,y)^2-d(u,x)=0": ((2 * sqrt(5) + asinh(2)) / 4, 2 / 3),
}


#: the quick cases: all of the plane, and of space those of first degree
CASES = [
    pytest.param(shape, level, marks=[pytest.mark.thorough] if shape.dimension == 3 and "^" in level else [])
    for shape in BODIES
    for level in CLOSED
]


@pytest.mark.parametrize(("shape", "level"), CASES)
def test_levels_of_derivatives_on_curved_elements(shape, level):
    dataset, (area, volume) = bent(shape), CLOSED[level]
    (surface,) = integrate(dataset, "1", level, ERROR)
    (inside,) = integrate(dataset, "1", "domain", ERROR, clip=f"outside:{level}")
    assert abs(surface.value - area) <= surface.error < 2 * ERROR * area
    assert abs(inside.value - volume) <= inside.error < 2 * ERROR * volume


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_kinks_of_derivatives_are_cut(shape):
    (row,) = integrate(bent(shape), "abs(d(u,x)-0.37)", error=ERROR)
    assert row.kind == "bound"
    assert abs(row.value - (0.37**2 + 0.63**2) / 2) <= row.error


def test_rational_derivatives_become_polynomials_by_volumes(monkeypatch):
    """On a strongly bent quadrilateral, against the mean over a fine lattice."""
    mesh = curved(grid(Shape.QUADRILATERAL, 1), swelling, 3)
    dataset = Dataset(mesh)
    dataset = replace(dataset, fields=(approximated(dataset, "u", lambda points: np.sin(3 * points.sum(axis=1)), 4),))
    level = "d(u,x)^2+d(u,y)^2"
    evaluator = Evaluator(dataset, [Expression.of(dataset, level)])
    (patch,) = evaluator.patches
    line = (np.arange(1000) + 0.5) / 500 - 1
    lattice = Lattice(patch, np.zeros(1, int), np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2))
    (values,) = evaluator.values_at(evaluator.expressions, lattice)
    volumes = np.linalg.det(lattice.jacobians[:, :2, :2]) / 500**2
    truth = volumes[values < 4].sum()

    def found():
        (row,) = integrate(dataset, "1", "domain", 1e-9, clip=f"outside:{level}=4")
        return row

    right = found()
    assert abs(right.value - truth) < 3e-5
    monkeypatch.setattr(expression_nets, "_relative_volumes", lambda lattice, count: np.ones(len(lattice)))
    assert abs(found().value - right.value) > 10 * right.error


def test_levels_without_polynomials_are_refused():
    folded = with_field(curved(grid(Shape.QUADRILATERAL, 2), lambda p: 9 * bubble(p) - 8 * p, 3), lambda p: p[:, 0])
    with pytest.raises(ElvisError, match="folds as in element"):
        integrate(folded, "1", "d(u,x)=0.5")
    high = with_field(curved(grid(Shape.HEXAHEDRON, 2), bubble, 6), lambda p: p[:, 0], 8)
    with pytest.raises(ElvisError, match="at most 24 on curved elements, found 35"):
        integrate(high, "1", "d(u,x)^2+u=0.5")
