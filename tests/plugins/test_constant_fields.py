"""Conversion of constants: errors of rounding are shares of the magnitude, not of a range that is rounding too."""

import numpy as np
import pytest

from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.plugins.conversion.converting import Settings, convert
from elvis.plugins.faces.derived import _deviation
from elvis.plugins.faces.nets import face_space
from elvis.plugins.testing import Analytic, AnalyticField


def one(points):
    """1 everywhere, but for rounding."""
    return np.sin(37 * points[..., 0]) ** 2 + np.cos(37 * points[..., 0]) ** 2


CONSTANTS = {
    "zero": lambda points: 0.0 * points[..., 0],
    "third": lambda points: 1 / 3 + 0.0 * points[..., 0],
    "pressure": lambda points: 101325 * one(points),
    "tiny": lambda points: 1e-250 * one(points),
    "small range": lambda points: 1 + 1e-12 * points[..., 0],
}


def source(shape=Shape.PRISM, order=5, **functions):
    return Analytic(grid(shape, 2), {name: AnalyticField(each, order) for name, each in functions.items()})


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.TETRAHEDRON, Shape.PYRAMID])
def test_constants_have_negligible_errors(shape):
    report = convert(source(shape, **CONSTANTS)).report
    assert all(measure.is_exact for measure in report.fields)
    assert report.beyond(1e-13) == []
    constant = [measure for measure in report.fields if measure.name != "small range"]
    assert max(measure.relative for measure in constant) < 1e-13


def test_deviations_from_a_constant_are_found():
    wave = source(order=4, u=lambda points: 1 + 1e-6 * np.sin(9 * points[..., 0] * points[..., 1]))
    report = convert(wave, Settings(order=1)).report
    (beyond,) = report.beyond(1e-3)
    assert beyond.name == "u"
    assert beyond.relative > 0.1


def test_constants_need_no_order():
    """A tolerance of a range that is rounding can't be met; of the magnitude the lowest order meets it."""
    conversion = convert(source(order=6, **CONSTANTS), Settings(tolerance=1e-3))
    assert {block.modes for block in conversion.blocks} == {2}
    assert conversion.report.beyond(1e-3) == []


def test_a_mesh_far_from_the_origin_is_rounded_and_not_off():
    far = Analytic(grid(Shape.HEXAHEDRON, 2), {}, warp=lambda points: points + 1e9)
    report = convert(far).report
    assert report.geometry.is_exact
    assert report.beyond(1e-13) == []


@pytest.mark.parametrize(("away", "bend", "is_off"), [(0.0, 0.0, False), (1e7, 0.0, False), (1e7, 1e-3, True)])
def test_faces_far_from_the_origin_are_the_polynomials_that_they_are(away, bend, is_off):
    space, rows = face_space(Shape.QUADRILATERAL, 1), np.zeros(1, int)
    places = np.array([[[-1.0, -1, -1], [2, 0, 0], [0, 2, 0]]])

    def positions(_, points):
        shift = away / 3 + bend * points[:, :1] ** 2
        return (points + shift)[None]

    net = np.linalg.solve(_values(space), positions(0, places[0, 0] + space.points @ places[0, 1:])[0])
    assert (_deviation(space, net[None], rows, rows, places, positions) > 1e-10) == is_off


def _values(space):
    from elvis.core.polynomials.bernstein import bernstein_values

    return bernstein_values(space.space, space.points)
