"""Integrals over parts of elements that a level set leaves, and over what bounds them, against closed forms."""

from math import factorial

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid

SPHERE = 4 / 3 * np.pi * 0.4**3


def test_a_sphere_in_a_box_of_hexahedra():
    """What is inside, what is left of the box, and the interface, whose flux is three times the volume."""
    dataset, sphere = Dataset(grid(Shape.HEXAHEDRON, 2)), "sphere:0.5,0.5,0.5:0.4"
    inside = integrate(dataset, ["volume", "x", "x*x"], clip=f"outside:{sphere}", error=1e-4)
    truth = [SPHERE, SPHERE / 2, SPHERE / 4 + SPHERE * 0.16 / 5]
    assert [row.value for row in inside] == pytest.approx(truth, rel=1e-6)
    assert all(abs(row.value - own) <= row.error < 1e-4 for row, own in zip(inside, truth, strict=True))
    assert integrate(dataset, "volume", clip=sphere, error=1e-4).value == pytest.approx(1 - SPHERE, rel=1e-6)
    out = "(x-0.5)*nx + (y-0.5)*ny + (z-0.5)*nz"
    interface = integrate(dataset, out, "(x-0.5)^2 + (y-0.5)^2 + (z-0.5)^2 = 0.16", error=1e-3)
    assert interface.value == pytest.approx(3 * SPHERE, rel=1e-4)


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PYRAMID, Shape.PRISM])
def test_planes_leave_parts_of_known_moments(shape):
    """The corner x + y + z < 1 of the cube: volume 1/6, first moment 1/24; the rest; along borders of elements."""
    dataset = Dataset(grid(shape, 1))
    corner = integrate(dataset, ["volume", "x"], clip="outside:plane:1,0,0:1,1,1", error=1e-9)
    assert [row.value for row in corner] == pytest.approx([1 / 6, 1 / 24], rel=1e-11)
    rest = integrate(dataset, ["volume", "x"], clip="plane:1,0,0:1,1,1", error=1e-9)
    assert [row.value for row in rest] == pytest.approx([5 / 6, 11 / 24], rel=1e-11)
    assert integrate(dataset, "volume", clip="plane:1,0,0:1,0,0").value == pytest.approx(0, abs=1e-12)
    assert integrate(dataset, "volume", clip="outside:plane:1,0,0:1,0,0").value == pytest.approx(1, rel=1e-12)


def test_level_sets_through_the_apex_of_pyramids():
    """A sphere that the bottom of the cube cuts and whose top is the apex, and a double cone with its tip there."""
    dataset = Dataset(grid(Shape.PYRAMID, 1))
    ball = 4 / 3 * np.pi * 0.3**3 - np.pi * 0.1**2 * (3 * 0.3 - 0.1) / 3
    cone = 2 * np.pi / 3 * 0.25**2 * 0.5
    for clip, truth in (
        ("sphere:0.5,0.5,0.2:0.3", ball),
        ("(x-0.5)^2 + (y-0.5)^2 - (z-0.5)^2/4 = 0", cone),
    ):
        found = integrate(dataset, "volume", clip=f"outside:{clip}", error=1e-3)
        assert found.value == pytest.approx(truth, rel=1e-6)
        assert abs(found.value - truth) <= found[0].error < 1e-3 * truth


def test_the_error_of_a_zero_integral_is_absolute():
    """Not in parts of a size that is rounding: p on a parabola p = 0 that touches the border of a square."""
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    level = approximated(bare, "p", lambda p: p[:, 1] - (p[:, 0] - 0.5) ** 2, 4)
    found = integrate(Dataset(bare.mesh, (level,)), "p", over="p=0")
    assert abs(found.value) <= found[0].error < 1e-6
    assert "p over p=0 is only known within" in found.remarks[0]


def test_a_level_set_that_is_a_field():
    """A disc of radius 0.4 in the unit square, of a field on squares; several regions are added up."""
    bare = Dataset(grid(Shape.QUADRILATERAL, 3))
    level = approximated(bare, "g", lambda p: (p[:, 0] - 0.5) ** 2 + (p[:, 1] - 0.5) ** 2, 3)
    dataset = Dataset(bare.mesh, (level,))
    disc = integrate(dataset, ["area", "g"], clip="outside:g = 0.16", error=1e-8)
    assert [row.value for row in disc] == pytest.approx([np.pi * 0.16, np.pi * 0.4**4 / 2], rel=1e-9)
    assert integrate(dataset, "area", clip="g = 0.16", error=1e-8).value == pytest.approx(1 - 0.16 * np.pi, rel=1e-9)
    for clip, over, sentence in (
        ("sphere:0,0:0", "domain", "expected sphere:CENTRE:RADIUS"),
        ("g", "domain", "--clip: expected plane:P:N, sphere:C:R, cylinder:P:A:R or QUANTITY=VALUE"),
        ("g=0.1", "all", "--clip: expected the domain or a region to be clipped, found all"),
    ):
        with pytest.raises(ElvisError) as error:
            integrate(dataset, "area", over, clip=clip)
        assert sentence in str(error.value)


def test_a_polynomial_on_boxes_that_are_whole_is_integrated_exactly():
    """Of degree 5, by rules that would not be exact for it: a plane's corner of the cube; all points are told."""
    told: list[tuple[int, int]] = []
    found = integrate(
        Dataset(grid(Shape.TETRAHEDRON, 2)),
        ["x^5", "x^2*y^2*z"],
        clip="outside:plane:1,0,0:1,1,1",
        progress=lambda done, planned: told.append((done, planned)),
    )
    truth = [factorial(5) / factorial(8), 4 / factorial(8)]
    assert [row.value for row in found] == pytest.approx(truth, rel=1e-13)
    assert all(abs(row.value - own) <= row.error for row, own in zip(found, truth, strict=True))
    assert told[-1][0] == told[-1][1]
    assert all(done <= planned for done, planned in told)
