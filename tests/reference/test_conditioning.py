"""What the reference calls certain where fields are flat, touch their level or hardly rise."""

from dataclasses import replace

import conditioning
import numpy as np
import pytest

from elvis import Camera, CutSurface, Isosurface, Plane, Scene, Status
from elvis.core.shapes import Shape
from elvis.reference.picture import render
from elvis.reference.record import Record
from elvis.reference.tolerances import check_tolerances

CAMERA, SIZE = Camera((2.6, -1.9, 1.9), (0.5, 0.5, 0.25), fov=32.0), (18, 18)


def exact(shape, function, scale, offset):
    """A function of z."""
    return conditioning.exact(shape, lambda points: function(points[:, 2]), scale, offset)


def picture(data, level, *objects):
    return render(data, Scene("u", camera=CAMERA, size=SIZE, objects=(Isosurface((level,)), *objects)))


def places(view, height):
    """Depths of rays at a height; how far inside the unit cube that is."""
    origins, ways = view.every_ray()
    depth = (height - origins[:, 2]) / ways[:, 2]
    inside = 0.5 - np.abs(origins + depth[:, None] * ways - 0.5)
    return depth, inside[:, :2].min(axis=1)


FLAT = {
    "inflection": (lambda z: (2 * z - 1) ** 3, 1.0, 1.0, 0.5),
    "inflection at zero": (lambda z: (2 * z - 1) ** 3, 1.0, 0.0, 0.5),
    "small slope": (lambda z: 2 * z - 1, 2.0**-17, 2.0**20, 0.5),
    "touching at zero": (lambda z: (z - 0.25) ** 2, 1.0, 0.0, 0.25),
    "touching": (lambda z: (z - 0.25) ** 2, 1.0, 3.0, 0.25),
}


@pytest.mark.sampled
@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
@pytest.mark.parametrize("name", FLAT)
def test_flat_and_touching_surfaces_are_ambiguous_hits(shape, name):
    function, scale, level, height = FLAT[name]
    frame = picture(exact(shape, function, scale, level), level)
    _, inside = places(frame.view, height)
    assert (frame.status.ravel()[inside > 1e-9] == Status.AMBIGUOUS).all()
    assert frame.seen.ravel()[inside > 1e-9].all()
    assert not (frame.seen & (frame.status == Status.CERTAIN)).any()


@pytest.mark.parametrize("shape", [Shape.PRISM, Shape.PYRAMID])
@pytest.mark.parametrize("scale", [1.0, 2.0**100, 2.0**-100])
def test_steep_surfaces_are_certain_and_their_uncertainty_bounds_the_error(shape, scale):
    frame = picture(exact(shape, lambda z: z + z**2, scale, 0.0), scale * (0.375 + 0.375**2))
    depth, inside = places(frame.view, 0.375)
    held = inside > 1e-9
    assert (frame.status.ravel()[held] == Status.CERTAIN).all()
    assert (np.abs(frame.depth.ravel() - depth) <= frame.uncertainty.ravel())[held].all()
    assert np.nanmax(frame.uncertainty) < 1e-12
    assert np.array_equal(np.isnan(frame.uncertainty), ~frame.seen)


def test_pixels_behind_a_doubtful_surface_are_not_certain():
    low = CutSurface(Plane((0.0, 0.0, 0.1), (0.0, 0.0, 1.0)))
    frame = picture(exact(Shape.HEXAHEDRON, lambda z: (2 * z - 1) ** 3, 1.0, 1.0), 1.0, low)
    _, inside = places(frame.view, 0.5)
    assert (frame.status.ravel()[inside > 1e-9] == Status.AMBIGUOUS).all()
    assert (frame.status == Status.CERTAIN).any()


@pytest.mark.parametrize(("uncertainty", "passed"), [(1.1e-9, True), (0.9e-9, False)])
def test_tolerances_include_the_stated_errors_of_pictures(uncertainty, passed):
    """A place may differ along its ray by the uncertainties of both pictures, no more."""
    record = Record.of(picture(exact(Shape.HEXAHEDRON, lambda z: z, 1.0, 0.0), 0.375))
    ways = (record.position - CAMERA.eye) / record.depth[..., None]
    moved = replace(
        record,
        depth=record.depth + 1e-9,
        position=record.position + 1e-9 * ways,
        uncertainty=np.where(record.seen, uncertainty, np.nan),
    )
    (position,) = (check for check in check_tolerances(record, moved) if check.name == "position")
    assert position.passed == passed
