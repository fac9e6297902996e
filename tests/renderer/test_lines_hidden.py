"""Contours where samples don't show them, or show what isn't there: near pairs, touched values, poles and jumps."""

import numpy as np
import pytest

from elvis import Camera, Plane
from elvis.core.shapes import Shape
from elvis.core.testing import grid, with_field
from elvis.plugins.runtime.serving import volume_of
from elvis.renderer.passes.lines.lines import Lines, line_coverage
from elvis.renderer.passes.plane.cut import Cutter
from elvis.renderer.passes.solids.solids import values_at_hits
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import PlaneView, View

SIZE = (130, 110)
CAMERA = Camera((0.5, 0.5, 3.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=1.2)
#: how far coverages may be from the truth
CLOSE = 0.02


@pytest.fixture(scope="session")
def cut(renderer):
    """Lines of a quantity of a dataset, a straight view of a plane, and the hit buffer of the cut there."""

    def cut(dataset, quantity="u"):
        loaded = DeviceVolume(renderer("vulkan").device, volume_of(dataset, ["u", quantity]))
        view = PlaneView.on(View.through(CAMERA, SIZE), Plane((0.5, 0.5, 0.52), (0.0, 0.0, 1.0)))
        hits = Cutter(loaded).draw(view)
        return Lines(loaded), view, hits if quantity == "u" else hits.showing(values_at_hits(loaded, hits, quantity))

    return cut


def distance_of_line(view, height, slope=0.0):
    """(n,) pixels from each pixel's centre to the line y = height + slope x, in a view straight at FLAT."""
    x, y, _ = view.points().reshape(-1, 3).T
    size = np.linalg.norm(view.points()[0, 1] - view.points()[0, 0])
    return np.abs(y - height - slope * x) / np.hypot(1.0, slope) / size


@pytest.mark.sampled
@pytest.mark.parametrize(("level", "slope"), [(1e-8, 0.0), (1e-8, 0.13), (1e-12, 0.13), (0.0, 0.0)])
@pytest.mark.parametrize("sign", [1, -1])
def test_lines_closer_together_than_samples_have_no_gaps(cut, level, slope, sign):
    """u = (y - s x - 0.1003)^2, sign either: two lines 0.02 pixels apart, nearer still, and one that is touched."""

    def field(points):
        return sign * (points[..., 1] - slope * points[..., 0] - 0.1003) ** 2

    lines, view, hits = cut(with_field(grid(Shape.HEXAHEDRON, 3), field))
    inner = hits.owner != NOBODY
    coverage = lines.contours(view, hits, np.array([sign * level]), 1.0).coverage
    expected = line_coverage(distance_of_line(view, 0.1003, slope), 1.0)
    assert np.abs(coverage - expected)[inner].max() < 0.03
    assert not lines.contours(view, hits, np.array([-sign * 1e-11]), 1.0).coverage.any()


def test_lines_that_are_touched_on_a_border_are_drawn(cut):
    """Each of the two elements sees half of a valley, which is as deep as rounding of its coefficients lets it be."""
    lines, view, hits = cut(with_field(grid(Shape.HEXAHEDRON, 2), lambda p: (p[..., 1] - 0.5) ** 2, 3))
    coverage = lines.contours(view, hits, np.array([1e-12]), 1.0).coverage
    expected = np.where(hits.owner == NOBODY, 0.0, line_coverage(distance_of_line(view, 0.5), 1.0))
    assert np.abs(coverage - expected).max() < CLOSE


#: quantities of u = y - 0.47 + 0.03 x that go through infinity or jump, a value, and u where they have it
BROKEN = [
    ("1/u", 0.5, None),
    ("1/u", 3.0, 1 / 3),
    ("sign(u)", 0.5, None),
    ("tan(8*u)", 0.5, np.arctan(0.5) / 8 + np.pi / 8 * np.arange(-4, 4)),
    ("tanh(1e5*u)", 0.5, np.arctanh(0.5) / 1e5),
]


@pytest.mark.parametrize(("quantity", "value", "roots"), BROKEN)
def test_nothing_is_drawn_at_poles_and_jumps(cut, quantity, value, roots):
    """And everything where a value is taken, however steeply."""
    data = with_field(grid(Shape.HEXAHEDRON, 2), lambda p: p[..., 1] - 0.47 + 0.03 * p[..., 0], 2)
    lines, view, hits = cut(data, quantity)
    coverage = lines.contours(view, hits, np.array([value]), 1.0, quantity).coverage
    if roots is None:
        assert not coverage.any()
        return
    away = [distance_of_line(view, 0.47 + root, -0.03) for root in np.atleast_1d(roots)]
    close = 0.13 if quantity.startswith("tanh") else CLOSE
    x, y, _ = view.points().reshape(-1, 3).T
    inner = (np.abs(x - 0.5) < 0.47) & (np.abs(y - 0.5) < 0.47)
    assert np.abs(coverage - line_coverage(np.min(away, axis=0), 1.0))[inner].max() < close
