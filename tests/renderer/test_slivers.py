"""Contours of elements that are thinner than a pixel and own no pixel's centre around."""

import numpy as np
import pytest

from elvis import Camera, Plane
from elvis.core.shapes import Shape
from elvis.core.testing import grid, with_field
from elvis.plugins.native.buffers import NativeVolume
from elvis.renderer.passes.lines.lines import Lines, line_coverage
from elvis.renderer.passes.plane.cut import Cutter
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import PlaneView, View

SIZE, PIXEL = (130, 110), 1.2 / 110
PLANES = {Shape.QUADRILATERAL: 0.0, Shape.TRIANGLE: 0.0, Shape.HEXAHEDRON: 0.52, Shape.TETRAHEDRON: 0.52}
#: radians by which the strips are turned from the columns of pixels
TURNS = [0.0, 0.3, 0.7]


def turned(points, turn):
    """Coordinates across and along the strips, from the middle."""
    cosine, sine = np.cos(turn), np.sin(turn)
    return (points[..., :2] - 0.5) @ np.array([[cosine, -sine], [sine, cosine]])


def strips(shape, thick, count, turn):
    """A square of 0.8: two halves, and between them ``count`` strips that are this many pixels thick."""
    mesh = grid(shape, count + 2)
    moved = mesh.vertices.copy()
    ends = [0.1, *(0.5 + thick * PIXEL * (np.arange(count + 1) - 0.5 * count)), 0.9]
    moved[:, 0] = np.interp(moved[:, 0], np.arange(count + 3) / (count + 2), ends)
    moved[:, 1] = 0.1 + 0.8 * moved[:, 1]
    moved[:, :2] = turned(moved, -turn) + 0.5
    return type(mesh)(**{**vars(mesh), "vertices": moved})


@pytest.fixture
def cut(renderer):
    """A dataset's lines, a view straight on, and the hit buffer of its cut."""

    def cut(dataset, height):
        loaded = DeviceVolume(renderer("vulkan").device, NativeVolume.of(dataset, "u"))
        camera = Camera((0.5, 0.5, 3.0), (0.5, 0.5, height), (0.0, 1.0, 0.0), height=1.2)
        view = PlaneView.on(View.through(camera, SIZE), Plane((0.5, 0.5, height), (0.0, 0.0, 1.0)))
        return Lines(loaded), view, Cutter(loaded).draw(view)

    return cut


@pytest.mark.sampled
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("shape", PLANES, ids=lambda shape: shape.label)
def test_contours_don_t_depend_on_how_thin_elements_are(cut, shape, turn):
    """The same linear field on one strip of 1.8 pixels and on nine of 0.2."""
    drawn = []
    for count in (1, 9):
        dataset = with_field(strips(shape, 1.8 / count, count, turn), lambda p: p[..., 1] + 0.3 * p[..., 0], 5)
        lines, view, hits = cut(dataset, PLANES[shape])
        drawn.append(lines.contours(view, hits, np.linspace(0.3, 0.9, 7), 1.0).coverage)
    assert (drawn[0] > 0.5).sum() > 300
    assert np.abs(drawn[0] - drawn[1]).max() < 0.02


@pytest.mark.sampled
@pytest.mark.parametrize(("turn", "power"), [*((turn, 1) for turn in TURNS), (0.0, 3)])
@pytest.mark.parametrize("shape", PLANES, ids=lambda shape: shape.label)
def test_a_contour_within_a_strip_of_a_fifth_of_a_pixel(cut, shape, turn, power):
    """The value is taken on the middle of the strip and nowhere else: whole lines there, and nothing next to them."""
    thick = 0.2 * PIXEL

    def field(points):
        across = turned(points, turn)[..., 0] / thick
        return np.where(np.abs(across) < 0.55, (across + 0.3) ** power, 5.0)

    lines, view, hits = cut(with_field(strips(shape, 0.2, 1, turn), field, 5), PLANES[shape])
    coverage = lines.contours(view, hits, np.array([0.3**power]), 1.0).coverage
    i, j = np.meshgrid(np.arange(view.width), np.arange(view.height))
    across, along = turned(view.points_of(i.ravel(), j.ravel()), turn).T / PIXEL
    expected = line_coverage(np.hypot(across, np.maximum(np.abs(along) - 0.4 / PIXEL, 0.0)), 1.0)
    hit = hits.owner != NOBODY
    assert expected[hit].sum() > 70
    assert np.abs(coverage - expected)[hit].max() < 0.02
    assert not lines.contours(view, hits, np.array([3.0]), 1.0).coverage.any()
