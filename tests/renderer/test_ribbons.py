"""Ribbons of streamlines against closed forms, and against the reference's search with another equation."""

from dataclasses import replace

import numpy as np
import pytest
from made_fields import constant, data
from scipy.integrate import solve_ivp

from elvis import Camera, Clip, CutSurface, Plane, SceneError, Sphere, Status, Streamlines, Style
from elvis.core.data.dataset import Dataset, Field, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.core.streamlines.course import Course
from elvis.core.streamlines.lines.pieces import curves
from elvis.core.streamlines.ribbons import ribbons
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.scene.commandline.composing import composed
from elvis.scene.commandline.parameters import streamlines
from elvis.scene.model.tables import scene_of, table_of

#: of the screw: turns in time, speed along its axis y = z = 0.5
TURN, SPEED = 1.2, 0.3


def screw(mesh):
    return data(mesh, u=constant(SPEED), v=lambda p: TURN * (0.5 - p[:, 2]), w=lambda p: TURN * (p[:, 1] - 0.5))


@pytest.fixture(scope="module")
def screws():
    """A swirling jet through curved elements of every shape."""
    return screw(curved(mixed_volume(0), ripple(0.02), 3))


def turned(vectors, angle):
    """Vectors (n, 3) turned about x by angles (n,)."""
    x, y, z = np.broadcast_to(vectors, (len(angle), 3)).T
    return np.stack([x, y * np.cos(angle) - z * np.sin(angle), y * np.sin(angle) + z * np.cos(angle)], axis=1)


def truth(times, radius):
    """(n, 3) the vector across a line of the screw at times (n,), by another integrator, from y at its seed."""

    def rate(time, across):
        velocity = np.array([SPEED, -radius * TURN * np.sin(TURN * time), radius * TURN * np.cos(TURN * time)])
        change = -radius * TURN**2 * np.array([0, np.cos(TURN * time), np.sin(TURN * time)])
        along = velocity / np.linalg.norm(velocity)
        bend = (change - along * (along @ change)) / np.linalg.norm(velocity)
        twist = 0.5 * 2.0 * TURN * along[0]
        return np.cross(np.cross(along, bend), across) + twist * np.cross(along, across)

    start = np.array([0.0, 1.0, 0.0])
    ends = [solve_ivp(rate, (0.0, time), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1] for time in times]
    return np.array(ends)


@pytest.mark.sampled
@pytest.mark.parametrize("radius", [0.0, 0.3])
@pytest.mark.parametrize("direction", ["forward", "backward"])
def test_strips_turn_with_half_the_vorticity_along_the_line(screws, radius, direction):
    course = Course(((0.9, 0.5 + radius, 0.5),), direction=direction, length=0.7)
    found = ribbons(screws, curves(screws, course).pieces, across=(0, 1, 0))
    assert found.deviation.max() < 1e-10
    times, ends = found.pieces.time[:, 1], found.across.sum(axis=1)
    assert np.sign(times).sum() == len(times) * (1 if direction == "forward" else -1)
    wanted = turned([0, 1, 0], TURN * times) if radius == 0 else truth(times, radius)
    assert np.abs(ends - wanted).max() < 1e-9
    # what is across stays across and of length 1
    directions = (found.pieces.points[:, 1:] * np.arange(1, 8)[:, None]).sum(axis=1)
    assert np.abs(np.linalg.norm(ends, axis=1) - 1).max() < 1e-12
    assert np.abs(np.einsum("ni,ni->n", ends, directions)).max() < 1e-9


SHAPES = [Shape.HEXAHEDRON, Shape.TETRAHEDRON, Shape.PRISM, Shape.PYRAMID]
CAMERAS = {
    "aside": Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), fov=24.0),
    "along": Camera((3.0, 0.52, 0.47), (0.5, 0.5, 0.5), height=0.6),
    "within": Camera((0.6, 0.55, 0.52), (0.1, 0.48, 0.5), fov=70.0),
}
HELICOID = Streamlines(("point:0.05,0.5,0.5",), length=0.9, ribbon=0.4, across=(0.0, 1.0, 0.0))


def helicoid_depths(frame, pixel):
    """(n,) depths at which rays first meet the strip turned about its axis, by dense sampling; inf where they don't."""
    origins, directions = (own[pixel] for own in frame.view.every_ray())
    x = np.linspace(0.05, 0.95, 20001)
    middle = np.stack([x, np.full_like(x, 0.5), np.full_like(x, 0.5)], axis=1)
    across = turned([0, 1, 0], TURN * (x - 0.05) / SPEED)
    found = np.full(len(pixel), np.inf)
    for k, (origin, along) in enumerate(zip(origins, directions, strict=True)):
        g = np.cross(across, along)
        value = np.einsum("ni,ni->n", middle - origin, g)
        here = np.flatnonzero(np.signbit(value[:-1]) != np.signbit(value[1:]))
        part = (value[here] / (value[here] - value[here + 1]))[:, None]
        point = (1 - part) * middle[here] + part * middle[here + 1]
        vector = (1 - part) * across[here] + part * across[here + 1]
        for one, other in zip(point, vector, strict=True):
            depth, place = np.linalg.lstsq(np.stack([along, -other], axis=1), one - origin, rcond=None)[0]
            if abs(place) <= 0.2 and 0 < depth < found[k]:
                found[k] = depth
    return found


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.sampled(free=("shape",))
def test_the_ribbon_of_a_swirling_jet_is_a_helicoid(draw, shape, camera):
    whole = screw(curved(grid(shape, 1), ripple(0.05), 3))
    frame = draw(whole, field="x", objects=(HELICOID,), camera=CAMERAS[camera], size=(60, 48))
    place = frame.position[frame.seen]
    assert len(place) > 200
    angle = TURN * (place[:, 0] - 0.05) / SPEED
    away = place - [0, 0.5, 0.5]
    side, off = (
        np.einsum("ni,ni->n", away, turned([0, 1, 0], angle)),
        np.einsum("ni,ni->n", away, turned([0, 0, 1], angle)),
    )
    assert np.abs(off).max() < 1e-10
    assert np.abs(side).max() <= 0.2 + 1e-12
    # values are those of the line itself, straight across: its place there
    assert np.abs(frame.field[frame.seen] - place[:, 0]).max() < 1e-10
    # normals are across both ways along the surface, and turned to the viewer; next to vertices steps are so short that
    # rounding of places turns them
    normal = frame.normal[frame.seen]
    forth = np.stack([np.full(len(side), SPEED), *(TURN * side[:, None] * turned([0, 0, 1], angle)).T[1:]], axis=1)
    assert np.abs(np.einsum("ni,ni->n", normal, turned([0, 1, 0], angle))).max() < 1e-9
    assert np.abs(np.einsum("ni,ni->n", normal, forth)).max() < 1e-7
    rays = frame.view.every_ray()[1][frame.seen.ravel()]
    assert (np.einsum("ni,ni->n", normal, rays) < 0).all()
    pixel = np.arange(0, frame.view.count, 23)
    depth, own = helicoid_depths(frame, pixel), frame.depth.ravel()[pixel]
    proved = frame.status.ravel()[pixel] != Status.AMBIGUOUS
    assert np.array_equal(np.isfinite(own)[proved], np.isfinite(depth)[proved])
    both = proved & np.isfinite(depth)
    assert np.abs(own[both] - depth[both]).max() < 1e-6
    assert frame.counts()["ambiguous"] < 0.01 * frame.view.count


FROM_ABOVE = Camera((1.2, 0.7, 4.0), (1.2, 0.7, 0.5), height=1.3)


def test_without_vorticity_strips_are_flat(draw):
    # stagnation in the plane z = 0.5: lines are hyperbolas in it, along which nothing turns
    mesh = curved(mixed_volume(0), ripple(0.02), 3)
    whole = data(mesh, u=lambda p: p[:, 0] - 0.5, v=lambda p: 0.5 - p[:, 1], w=constant(0))
    shown = Streamlines(("point:0.6,0.9,0.5",), length=1.2, ribbon=0.1, across=(1.0, 1.0, 0.0))
    frame = draw(whole, field="x", objects=(shown,), camera=FROM_ABOVE, size=(90, 70))
    assert frame.seen.sum() > 300
    assert np.abs(frame.position[frame.seen][:, 2] - 0.5).max() < 1e-12
    # and on both sides as wide as asked: x y is 0.04 along the line
    x = np.geomspace(0.05, 2.0, 4001)
    line = np.stack([0.5 + x, 0.5 + 0.04 / x], axis=1)
    some = frame.position[frame.seen][::17, :2]
    distance = np.linalg.norm(some[:, None] - line, axis=2).min(axis=1)
    assert 0.045 < distance.max() < 0.05 + 1e-5


@pytest.mark.thorough
def test_plane_data_have_strips_in_the_plane(draw):
    mesh = curved(grid(Shape.TRIANGLE, 3), ripple(0.03), 3)
    whole = data(mesh, u=lambda p: 0.5 - p[:, 1], v=lambda p: p[:, 0] - 0.5)
    shown = Streamlines(("point:0.8,0.5",), duration=2 * np.pi, ribbon=0.1)
    camera = Camera((0.5, 0.5, 3.0), (0.5, 0.5, 0.0), up=(0.0, 1.0, 0.0), height=0.8)
    for device in ("vulkan", "reference"):
        frame = draw(whole, device, field="x", objects=(shown,), camera=camera, size=(60, 60))
        place = frame.position[frame.seen]
        radius = np.hypot(place[:, 0] - 0.5, place[:, 1] - 0.5)
        assert len(radius) > 300
        assert np.abs(place[:, 2]).max() < 1e-12
        assert np.abs(radius - 0.3).max() <= 0.05 + 1e-9
        # a pixel's centre within the ring shows it
        ring = np.hypot(*(frame.view.every_ray()[0][:, :2] - 0.5).T)
        assert np.array_equal(frame.seen.ravel(), np.abs(ring - 0.3) <= 0.05)


def test_quasi_3d_data_have_ribbons(draw):
    """A screw about z whose velocity is the same in all planes, beyond the period."""
    mesh = curved(grid(Shape.QUADRILATERAL, 1), ripple(0.04), 3)
    plane = data(mesh, u=lambda p: 0.5 - p[:, 1], v=lambda p: p[:, 0] - 0.5)
    waves = Homogeneous((Basis.FOURIER,), (0.5,), (0, 1))
    fields = []
    for name in "uv":
        (block,) = plane.field(name).blocks
        both = np.hstack([block.coefficients, 0 * block.coefficients])
        spread = replace(block, expansion=replace(block.expansion, homogeneous=waves), coefficients=both)
        fields.append(Field(name, (spread,)))
    whole = Dataset(mesh, tuple(fields))
    shown = Streamlines(("point:0.5,0.5,0.05",), "u,v,0.3", duration=2.5, ribbon=0.4, across=(1.0, 0.0, 0.0))
    camera = Camera((2.5, -1.5, 0.9), (0.5, 0.5, 0.4), fov=24.0)
    for device in ("vulkan", "reference"):
        frame = draw(whole, device, field="u", objects=(shown,), camera=camera, size=(50, 40))
        away = frame.position[frame.seen] - [0.5, 0.5, 0.05]
        assert len(away) > 100
        angle = away[:, 2] / 0.3
        assert np.abs(away[:, 1] * np.cos(angle) - away[:, 0] * np.sin(angle)).max() < 1e-10
        assert np.hypot(away[:, 0], away[:, 1]).max() <= 0.2 + 1e-12


BASE = Streamlines(("point:0.5,0.8,0.5", "point:0.7,0.23,0.4"), length=0.9, ribbon=0.2)
VIEW = {
    "camera": Camera((4.2, -2.7, 2.9), (1.0, 0.5, 0.5), fov=16.0),
    "size": (60, 44),
    "field": "x",
    "range": (0.0, 1.9),
}
SCENES = {
    "both ways": {"objects": (replace(BASE, direction="both", style=Style(lit=True)),)},
    "behind one another": {
        "objects": (
            replace(BASE, style=Style(opacity=0.5, quantity="x*u")),
            CutSurface(Plane((1.2, 0, 0), (1, 0, 0)), Style(opacity=0.7)),
        ),
        "clip": (Clip(Sphere((1.0, 0.5, 0.9), 0.4)),),
    },
}


@pytest.mark.thorough
@pytest.mark.parametrize("scene", SCENES)
def test_pictures_match_those_of_the_reference(draw, screws, scene):
    frame, other = (draw(screws, device, **VIEW, **SCENES[scene]) for device in ("vulkan", "reference"))
    assert np.array_equal(frame.element, other.element)
    assert frame.counts()["certain"] > 0.95 * frame.seen.sum() > 200
    assert np.abs(frame.depth[frame.seen] - other.depth[frame.seen]).max() < 1e-9
    assert np.abs(frame.field[frame.seen] - other.field[frame.seen]).max() < 1e-9
    assert np.abs(frame.color - other.color).max() < 1e-7


def altered(dataset, factor):
    """A dataset with w multiplied in every other element, so that it jumps."""

    def own(block):
        scale = np.where(np.arange(len(block.coefficients)) % 2, factor, 1.0)
        return replace(block, coefficients=block.coefficients * scale[:, None])

    fields = [replace(f, blocks=tuple(map(own, f.blocks))) if f.name == "w" else f for f in dataset.fields]
    return Dataset(dataset.mesh, tuple(fields))


def test_strips_are_connected_at_velocity_jumps(draw):
    # w is 0.2 or 0.3: the line bends at borders, and the strip, which is across w, turns there in one place
    mesh = curved(grid(Shape.HEXAHEDRON, 3), ripple(0.03), 3)
    whole = altered(data(mesh, u=constant(0.3), v=constant(0), w=constant(0.2)), 1.5)
    shown = Streamlines(("point:0.05,0.5,0.1",), length=1.0, ribbon=0.2, across=(0.0, 0.0, 1.0))
    pieces = ribbons(whole, curves(whole, Course(shown.seeds, length=1.0)).pieces, across=shown.across)
    fans = np.ptp(pieces.pieces.time, axis=1) == 0
    assert fans.sum() >= 2
    camera = Camera((0.503, -3.0, 0.5), (0.503, 0.5, 0.5), height=1.0)
    frame, other = (
        draw(whole, device, field="x", objects=(shown,), camera=camera, size=(50, 40))
        for device in ("vulkan", "reference")
    )
    assert np.array_equal(frame.seen, other.seen)
    assert np.abs(frame.depth[frame.seen] - other.depth[frame.seen]).max() < 1e-9
    # every column of pixels that the line goes through has one run of pixels: no gaps
    runs = (np.diff(frame.seen.astype(int), axis=0, prepend=0) == 1).sum(axis=0)
    assert runs.max() == 1


def test_scenes_commands_and_python_agree():
    made = streamlines("random:5;ribbon=0.1;across=0,0,1")
    assert made == Streamlines(("random:5",), ribbon=0.1, across=(0.0, 0.0, 1.0))
    scene = composed((), {"streamlines": (made,), "contours": None}, ())
    assert scene_of(table_of(scene)) == scene


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"radius": 1.0}, "streamlines: expected a radius, a width or a ribbon, found radius and ribbon"),
        ({"ribbon": -1.0}, "ribbon of streamlines: expected a positive number, found -1.0"),
        ({"across": (0.0, 0.0, 0.0)}, "across of streamlines: expected a direction, found zero"),
        ({"ribbon": None, "across": (0.0, 0.0, 1.0)}, "across of streamlines: expected also the width of a ribbon"),
        ({"wall": "boundary"}, "ribbons: expected lines in elements, found lines on the wall boundary"),
    ],
)
def test_invalid_input_is_rejected(draw, screws, given, match):
    with pytest.raises(SceneError, match=match):
        draw(screws, objects=(Streamlines(**{"seeds": ("point:1,0.5,0.5",), "ribbon": 0.1, **given}),), size=(8, 8))


def test_a_seed_on_a_side_does_not_turn_the_strip():
    # a line that starts on a side has a first piece whose length is rounding, and its direction noise
    def bump(p):
        return p + (p[:, 0] * (1 - p[:, 0]) * (p[:, 1] - 0.3))[:, None] * np.array([0.0, 0.2, 0.3])

    bare = Dataset(curved(grid(Shape.HEXAHEDRON, 2), bump, 4))
    flow = {"u": lambda p: 1 + p[:, 0] * p[:, 1], "v": lambda p: p[:, 0] ** 2 - p[:, 2], "w": lambda p: 0.3 * p[:, 2]}
    data = Dataset(bare.mesh, tuple(approximated(bare, name, function, 4) for name, function in flow.items()))
    corner = bump(np.array([[0.5, 0.5, 0.5]]))[0]
    found = []
    for seed in (corner, corner + np.array([1e-7, 0.0, 0.0])):
        lines = curves(data, Course(seeds=seed[None]))
        strips = ribbons(data, lines.pieces)
        last = np.abs(strips.pieces.time[:, 1]).argmax()
        found.append((lines.pieces.points[:, 1:], strips.across[last].sum(axis=0)))
    assert min(np.abs(points).sum(axis=(1, 2)).min() for points, _ in found) < 1e-12
    assert found[0][1] == pytest.approx(found[1][1], abs=1e-5)
