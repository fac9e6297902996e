"""Arrow heads along streamlines: where they stand and point, in closed form, and pictures next to the reference's."""

from dataclasses import replace

import numpy as np
import pytest
from made_fields import constant, data

from elvis import Camera, SceneError, Streamlines, Style
from elvis.core.base.errors import ElvisError
from elvis.core.shapes import Shape
from elvis.core.streamlines.course import Course
from elvis.core.streamlines.lines.pieces import curves
from elvis.core.streamlines.marks import marks
from elvis.core.testing import curved, grid, mixed_volume, ripple
from elvis.scene.commandline.parameters import streamlines
from elvis.scene.flow.flow import heads_in

#: of the screw: turns in time, speed along its axis y = z = 0.5, distance of a seed from that
TURN, SPEED, RADIUS = 1.2, 0.3, 0.25
SEED = (0.9, 0.5 + RADIUS, 0.5)


@pytest.fixture(scope="module")
def screw():
    """A swirling jet through curved elements of every shape."""
    mesh = curved(mixed_volume(0), ripple(0.02), 3)
    return data(mesh, u=constant(SPEED), v=lambda p: TURN * (0.5 - p[:, 2]), w=lambda p: TURN * (p[:, 1] - 0.5))


@pytest.mark.parametrize("by", ["length", "time"])
def test_arrows_are_evenly_spaced_and_point_with_the_flow(screw, by):
    pieces = curves(screw, Course((SEED,), direction="both", length=0.8)).pieces
    pace = np.hypot(SPEED, TURN * RADIUS)
    spacing = 0.11 if by == "length" else 0.11 / pace
    found = marks(screw, pieces, spacing, by)
    assert len(found) == 2 * int(0.8 / 0.11)
    order = np.argsort(found.points[:, 0])
    time = 0.11 / pace * np.array([*range(-7, 0), *range(1, 8)])
    angle = TURN * time
    line = np.stack([0.9 + SPEED * time, 0.5 + RADIUS * np.cos(angle), 0.5 + RADIUS * np.sin(angle)], axis=1)
    assert np.abs(found.points[order] - line).max() < 1e-10
    # with the flow on either side of the seed
    velocity = np.stack([0 * time + SPEED, -RADIUS * TURN * np.sin(angle), RADIUS * TURN * np.cos(angle)], axis=1)
    assert np.abs(found.direction[order] - velocity / pace).max() < 1e-10


def test_no_arrow_is_lost_or_doubled_between_parts(screw):
    # many lines, whose lengths are rounded where pieces of them meet; none has a mark at its seed
    seeds = tuple(f"point:{0.3 + 0.01 * k},{0.3 + 0.02 * k},0.45" for k in range(20))
    pieces = curves(screw, Course(seeds, length=0.5)).pieces
    ends = np.zeros(20)
    np.maximum.at(ends, pieces.line, pieces.length.sum(axis=1))
    # spacings at which marks lie just where pieces end, too
    for spacing in (0.05, *pieces.length.sum(axis=1)[:5]):
        found = marks(screw, pieces, spacing)
        assert len(found) == np.floor(ends / spacing * (1 + 1e-12)).sum()


def test_marks_on_walls_point_along_them():
    parts = {"u": lambda p: p[:, 2] * (0.5 - p[:, 1]), "v": lambda p: p[:, 2] * (p[:, 0] - 0.5), "w": constant(0)}
    whole = data(grid(Shape.HEXAHEDRON, 2), **parts)
    course = Course(((0.8, 0.5, 0.0),), duration=2.0, wall="all")
    found = marks(whole, curves(whole, course).pieces, 0.5, "time", wall="all")
    angle = 0.5 * np.arange(1, 5)
    assert (
        np.abs(found.points - np.stack([0.5 + 0.3 * np.cos(angle), 0.5 + 0.3 * np.sin(angle), 0 * angle], 1)).max()
        < 1e-10
    )
    assert np.abs(found.direction - np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)).max() < 1e-8


def test_the_number_of_arrows_is_limited(screw):
    pieces = curves(screw, Course((SEED,), length=0.8)).pieces
    with pytest.raises(ElvisError, match="expected 1000000 at most, found"):
        marks(screw, pieces, 1e-7)


VIEW = {"camera": Camera((4.2, -2.7, 2.9), (1.0, 0.5, 0.5), fov=16.0), "size": (54, 40), "field": "x"}
BASE = Streamlines(("point:0.9,0.75,0.5", "point:0.7,0.23,0.4"), direction="both", length=0.7, arrows=0.2)
OBJECTS = {
    "tubes": replace(BASE, radius=0.03, style=Style(opacity=0.6)),
    "ribbons": replace(BASE, ribbon=0.15, arrows_by="time", arrow_length=0.12),
    "lines": replace(BASE, width=2.0, arrow_length=0.3),
}


@pytest.mark.thorough
@pytest.mark.parametrize("shown", OBJECTS)
@pytest.mark.sampled(least=2, free=("shown",))
def test_pictures_match_those_of_the_reference(draw, screw, shown):
    scene = {**VIEW, "range": (0.0, 1.9), "objects": (OBJECTS[shown],)}
    frame, other = (draw(screw, device, **scene) for device in ("vulkan", "reference"))
    assert np.array_equal(frame.element, other.element)
    assert frame.counts()["certain"] > 0.9 * frame.seen.sum() > 100
    assert np.abs(frame.depth[frame.seen] - other.depth[frame.seen]).max() < 1e-9
    assert np.abs(frame.color - other.color).max() < 1e-7
    without = draw(
        screw, **{**scene, "objects": (replace(OBJECTS[shown], arrows=None, arrows_by="length", arrow_length=None),)}
    )
    assert (frame.depth < without.depth).sum() > 10


def test_heads_scale_with_their_lines(screw):
    for item, length in ((replace(BASE, radius=0.03), 0.24), (replace(BASE, ribbon=0.15), 0.09)):
        assert heads_in(screw, item).length == pytest.approx(length)


def test_settings_and_invalid_input(draw, screw):
    text = "random:5;arrows=0.2;arrows_by=time;arrow_length=0.05"
    assert streamlines(text) == Streamlines(("random:5",), arrows=0.2, arrows_by="time", arrow_length=0.05)
    for given, match in (
        ({"arrows": 0.0}, "arrows of streamlines: expected a positive number, found 0.0"),
        ({"arrow_length": 0.1}, "arrows of streamlines: expected their spacing, found nothing"),
        ({"arrows": 1.0, "arrows_by": "speed"}, "arrows_by of streamlines: expected length or time, found speed"),
    ):
        with pytest.raises(SceneError, match=match):
            draw(screw, objects=(Streamlines(("point:1,0.5,0.5",), **given),), size=(8, 8))
    shown = Streamlines(("point:1,0.5,0.5",), length=0.5, arrows=3.0)
    frame = draw(screw, **VIEW, objects=(shown,))
    assert any("no line is as long as the spacing of its arrows, 3" in remark for remark in frame.remarks)
