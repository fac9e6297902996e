"""Lines next to the edge of a picture, and of the bands that it is drawn in: what lies beyond it covers pixels, too."""

import numpy as np
import pytest

from elvis import Camera, Contours, CutSurface, Faces, MeshLines, Plane, Style
from elvis.core.shapes import Shape
from elvis.core.testing import grid, with_field
from elvis.renderer.device import persistence
from elvis.renderer.passes.lines.lines import line_coverage

SIZE, STEP = (24, 20), 0.008
#: sides and corners of a picture, in columns to the right and rows downwards
SIDES = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)]
SURFACES = {
    "2D data": (Shape.QUADRILATERAL, lambda style: Faces(style=style)),
    "a cut": (Shape.HEXAHEDRON, lambda style: CutSurface(Plane((0.0, 0.0, 0.52), (0.0, 0.0, 1.0)), style)),
    "faces": (Shape.HEXAHEDRON, lambda style: Faces(style=style)),
}


def beyond(side, place, away):
    """A camera that has the line x = place this many pixels beyond the centre of the last pixel on a side.

    And the distances (h, w) of pixels' centres from that line, in pixels.
    """
    direction = np.array(side) / np.hypot(*side)
    line = 0.5 * (np.array(SIZE) - 1) @ np.abs(direction) + away
    middle = (place - STEP * line, 0.5)
    up = (-direction[1], direction[0], 0.0)
    camera = Camera((*middle, 3.0), (*middle, 0.0), up, height=STEP * SIZE[1])
    columns, rows = np.meshgrid(*(np.arange(count) - 0.5 * (count - 1) for count in SIZE))
    return camera, np.abs(columns * direction[0] + rows * direction[1] - line)


@pytest.mark.sampled
@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("kind", ["contours", "mesh_lines"])
def test_lines_beyond_the_edge_cover_pixels_within_their_width(draw, surface, kind):
    shape, item = SURFACES[surface]
    data = with_field(grid(shape, 3), lambda points: points[..., 0] - 0.1, 2)
    black, covering = (0.0, 0.0, 0.0), 0
    place = 0.45 if kind == "contours" else 1 / 3
    for number, side in enumerate(SIDES):
        width = (1.5, 3.0)[number % 2]
        camera, distance = beyond(side, place, 0.3 * width)
        line = Contours((place - 0.1,), width=width, color=black) if kind == "contours" else MeshLines(width, black)
        style = Style(color=(1.0, 1.0, 1.0), lit=False, **{kind: line})
        found = 1.0 - draw(data, objects=(item(style),), camera=camera, size=SIZE).color[..., 0]
        expected = line_coverage(distance, width)
        assert np.abs(found - expected).max() < 1e-3, side
        covering += (expected > 0.2).sum()
    assert covering > 80


def test_a_picture_is_a_part_of_a_larger_one(draw):
    data = with_field(grid(Shape.QUADRILATERAL, 3), lambda points: ((points[..., :2] - 0.47) ** 2).sum(axis=-1), 3)
    style = Style(color=(1.0, 1.0, 1.0), contours=Contours((0.01, 0.03, 0.08), width=2.5), mesh_lines=MeshLines(4.0))
    every = []
    for half in (1, 2):
        camera = Camera((0.5, 0.5, 3.0), (0.5, 0.5, 0.0), (0.2, 1.0, 0.0), height=1.0 / half)
        every.append(draw(data, objects=(Faces(style=style),), camera=camera, size=(60 // half, 48 // half)).color)
    assert np.abs(every[0][12:36, 15:45] - every[1]).max() < 1e-6


def test_surfaces_beyond_the_edge_do_not_affect_lines(draw, monkeypatch):
    """Neither in ranges nor in counts, of whole pictures and of bands."""
    data = with_field(grid(Shape.QUADRILATERAL, 3), lambda points: points[..., 0] - 0.5, 2)
    camera = Camera((0.5, 0.5, 3.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=0.4)
    style = Style(contours=Contours(count=3, width=20.0))
    for most in (persistence.BAND, 5 * 30):
        monkeypatch.setattr(persistence, "BAND", most)
        frame = draw(data, field="sqrt(u)", objects=(Faces(style=style),), camera=camera, size=(30, 30))
        assert frame.range == (np.nanmin(frame.field), np.nanmax(frame.field))
        assert frame.counts()["not_a_number"] == np.isnan(frame.field).sum() > 100
