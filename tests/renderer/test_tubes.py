"""Tubes of streamlines against closed forms, and against the reference's search along each line."""

from dataclasses import replace

import numpy as np
import pytest
from made_fields import constant, data
from scipy.optimize import minimize_scalar

from elvis import Camera, Clip, CutSurface, Faces, Plane, Scene, SceneError, Sphere, Status, Streamlines, Style
from elvis.core.shapes import Shape
from elvis.core.streamlines.streamlines import trace
from elvis.core.testing import curved, grid, mixed_volume, ripple
from elvis.renderer.asking.completing import completed
from elvis.renderer.passes.tubes.tubes import GROUP_SIZE, TubeDrawer
from elvis.scene.commandline.composing import composed
from elvis.scene.commandline.parameters import streamlines
from elvis.scene.commandline.writing import option_words
from elvis.scene.model.quantities import quantities
from elvis.scene.model.tables import scene_of, table_of


@pytest.fixture(scope="module")
def circles():
    """A rotation about (0.5, 0.5) in curved hexahedra."""
    mesh = curved(grid(Shape.HEXAHEDRON, 2), ripple(0.05), 3)
    return data(mesh, u=lambda p: 0.5 - p[:, 1], v=lambda p: p[:, 0] - 0.5, w=constant(0))


@pytest.fixture(scope="module")
def helices():
    """A screw about y = z = 0.5 through curved elements of every shape."""
    mesh = curved(mixed_volume(0), ripple(0.02), 3)
    return data(mesh, u=constant(0.3), v=lambda p: 0.5 - p[:, 2], w=lambda p: p[:, 1] - 0.5)


def rays_of(frame, pixel):
    """Origins and unit directions of pixels, and the lengths of what depth counts in."""
    origins, directions = (own[pixel] for own in frame.view.every_ray())
    lengths = np.linalg.norm(directions, axis=1)
    return origins, directions / lengths[:, None], lengths


RADIUS, RING = 0.06, 0.3
TORUS = np.array([0.5, 0.5, 0.45])


def torus_depths(frame, pixel):
    """(n,) depths at which rays first meet the torus, inf where they don't: roots of quartics, by NumPy."""
    origins, along, lengths = rays_of(frame, pixel)
    origins = origins - TORUS
    shift = -np.einsum("ni,ni->n", origins, along)
    near = origins + shift[:, None] * along
    k = (near**2).sum(axis=1) + RING**2 - RADIUS**2
    a, b, c = (
        4 * RING**2 * np.einsum("ni,ni->n", one[:, :2], other[:, :2])
        for one, other in ((along, along), (near, along), (near, near))
    )
    found = np.full(len(pixel), np.inf)
    for row in range(len(pixel)):
        roots = np.roots([1, 0, 2 * k[row] - a[row], -2 * b[row], k[row] ** 2 - c[row]])
        real = roots[np.abs(roots.imag) < 1e-9].real + shift[row]
        found[row] = real[real > 0].min(initial=np.inf) / lengths[row]
    return found


@pytest.mark.parametrize(
    "camera",
    [
        Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), fov=28.0),
        Camera((0.5, -1.7, 0.47), (0.5, 0.5, 0.46), height=0.9),
        Camera((0.8, 0.5, 0.47), (0.5, 0.8, 0.44), fov=70.0),
    ],
    ids=["aside", "along its plane", "from within"],
)
def test_a_circles_tube_is_a_torus(draw, circles, camera):
    shown = Streamlines(("point:0.8,0.5,0.45",), duration=2 * np.pi, radius=RADIUS)
    frame = draw(circles, field="u", objects=(shown,), camera=camera, size=(60, 48))
    away = frame.position[frame.seen] - TORUS
    off = np.hypot(np.hypot(away[:, 0], away[:, 1]) - RING, away[:, 2]) - RADIUS
    assert len(off) > 90
    assert np.abs(off).max() < 1e-10
    # the value is that of the ball's middle, u = 0.5 - y on the circle nearby
    middle = TORUS[1] + RING * away[:, 1] / np.hypot(away[:, 0], away[:, 1])
    assert np.abs(frame.field[frame.seen] - (0.5 - middle)).max() < 1e-10
    pixel = np.arange(0, frame.view.count, 5)
    depth = torus_depths(frame, pixel)
    proved = frame.status.ravel()[pixel] != Status.AMBIGUOUS
    assert np.array_equal(frame.seen.ravel()[pixel][proved], np.isfinite(depth)[proved])
    both = proved & np.isfinite(depth)
    assert np.abs(frame.depth.ravel()[pixel][both] - depth[both]).max() < 1e-9
    assert frame.counts()["ambiguous"] < 0.06 * frame.view.count


def screw(time):
    """(n, 3) the line of the test below, at times (n,)."""
    return np.stack([0.2 + 0.3 * time, 0.5 + 0.3 * np.cos(time), 0.5 + 0.3 * np.sin(time)], axis=-1)


def entry(origin, along, radius, last):
    """Where a ray first enters the balls about the screw, otherwise inf: the minimum of a function of one time."""

    def depth(time):
        away = screw(time) - origin
        place = away @ along
        room = radius**2 - ((away - place[..., None] * along) ** 2).sum(axis=-1)
        return np.where(room >= 0, place - np.sqrt(np.maximum(room, 0)), np.inf)

    times = np.linspace(0, last, 3001)
    sampled = depth(times)
    best = sampled.argmin()
    if not np.isfinite(sampled[best]):
        return np.inf
    ends = times[max(best - 1, 0)], times[min(best + 1, 3000)]
    return min(sampled[best], minimize_scalar(depth, bounds=ends, method="bounded", options={"xatol": 1e-12}).fun)


def test_a_screws_tube_is_that_of_the_closed_form(draw, helices):
    shown = Streamlines(("point:0.2,0.8,0.5",), length=2.0, radius=0.05)
    camera = Camera((4.2, -2.7, 2.9), (0.9, 0.5, 0.5), fov=12.0)
    frame = draw(helices, field="v", objects=(shown,), camera=camera, size=(80, 50))
    last = 2.0 / np.hypot(0.3, 0.3)
    counts = dict.fromkeys(Status, 0)
    for pixel in range(0, frame.view.count, 3):
        origin, along, length = (own[0] for own in rays_of(frame, [pixel]))
        first = entry(origin, along, 0.05, last) / length
        status = Status(frame.status.flat[pixel])
        counts[status] += 1
        if status == Status.CERTAIN:
            assert abs(first - frame.depth.flat[pixel]) < 1e-10
        elif status == Status.MISS:
            assert not np.isfinite(first)
    assert counts[Status.CERTAIN] > 60
    assert counts[Status.AMBIGUOUS] < 0.1 * counts[Status.CERTAIN]

    # hits lie at the radius from the line, whose nearest point Newton's method tells, and have its value v
    hits = frame.position[frame.status == Status.CERTAIN]
    times = np.linspace(0, last, 400)
    time = times[np.linalg.norm(hits[:, None] - screw(times), axis=2).argmin(axis=1)]
    for _ in range(20):
        away = screw(time) - hits
        forth = np.stack([np.full(len(time), 0.3), -0.3 * np.sin(time), 0.3 * np.cos(time)], axis=1)
        turn = np.stack([0 * time, -0.3 * np.cos(time), -0.3 * np.sin(time)], axis=1)
        slope = (away * forth).sum(axis=1)
        time = np.clip(time - slope / ((forth**2).sum(axis=1) + (away * turn).sum(axis=1)), 0, last)
    assert np.abs(np.linalg.norm(screw(time) - hits, axis=1) - 0.05).max() < 1e-10
    assert np.abs(frame.field[frame.status == Status.CERTAIN] + 0.3 * np.sin(time)).max() < 1e-9


BASE = Streamlines(("point:0.5,0.8,0.5", "point:0.7,0.23,0.4"), length=0.9, radius=0.05)
VIEW = {
    "camera": Camera((4.2, -2.7, 2.9), (1.0, 0.5, 0.5), fov=22.0),
    "size": (48, 36),
    "field": "x",
    "range": (0.0, 1.9),
}
SCENES = {
    "behind one another": {
        "objects": (
            replace(BASE, style=Style(opacity=0.5, quantity="x*u")),
            CutSurface(Plane((1.2, 0, 0), (1, 0, 0)), Style(opacity=0.7)),
        ),
        "clip": (Clip(Sphere((1.0, 0.5, 0.9), 0.4)),),
    },
    "width in pixels": {"objects": (replace(BASE, radius=None, width=6.0), Faces(style=Style(opacity=0.3)))},
}


@pytest.mark.parametrize("scene", SCENES)
def test_pictures_match_those_of_the_reference(draw, helices, scene):
    frame, truth = (draw(helices, device, **VIEW, **SCENES[scene]) for device in ("vulkan", "reference"))
    assert np.array_equal(frame.element, truth.element)
    assert frame.counts()["certain"] > 0.95 * frame.seen.sum() > 200
    assert np.abs(frame.depth[frame.seen] - truth.depth[frame.seen]).max() < 1e-9
    assert np.abs(frame.field[frame.seen] - truth.field[frame.seen]).max() < 1e-9
    assert np.abs(frame.color - truth.color).max() < 1e-7


def test_scenes_commands_and_python_agree():
    text = "random:5;seeds.csv;direction=both;radius=0.01;velocity=u,v,w+0.1;steps=50"
    made = streamlines(text)
    assert made == Streamlines(("random:5", "seeds.csv"), "u,v,w+0.1", direction="both", steps=50, radius=0.01)
    scene = composed((), {"streamlines": (made,), "contours": None, "opacity": 0.5}, ())
    assert scene.objects[0].style.opacity == 0.5
    assert scene_of(table_of(scene)) == scene
    assert scene_of(table_of(scene), "below").objects[0].seeds[1].replace("\\", "/") == "below/seeds.csv"
    words = option_words(scene)
    assert words[:2] == ["--streamlines", "random:5;seeds.csv;velocity=u,v,w+0.1;direction=both;steps=50;radius=0.01"]


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"seeds": ()}, "seeds of streamlines: expected at least one, found none"),
        ({"radius": 1.0, "width": 2.0}, "streamlines: expected a radius, a width or a ribbon, found radius and width"),
        ({"direction": "up"}, "direction of streamlines: expected forward or backward or both, found up"),
        ({"length": -1.0}, "length of streamlines: expected a positive number, found -1.0"),
        ({"seeds": ("point:7,7,7",)}, "all lie outside the mesh"),
        ({"seeds": ("pont:7,7,7",)}, "streamlines: expected seeds as one of .*perhaps point"),
        ({"velocity": "u,v"}, "streamlines: expected a velocity of 3 components"),
        ({"seeds": ("-",)}, "expected the name of a table, found -"),
    ],
)
def test_invalid_input_is_rejected(draw, helices, given, match):
    with pytest.raises(SceneError, match=match):
        draw(helices, objects=(Streamlines(**{"seeds": ("point:1,0.5,0.5",), **given}),), size=(8, 8))


def test_several_objects_are_prepared_once_for_a_view(renderer, helices, monkeypatch):
    prepared = []
    whole = TubeDrawer._prepared
    monkeypatch.setattr(TubeDrawer, "_prepared", lambda *given: prepared.append(given) or whole(*given))
    scene = completed(helices, Scene(**VIEW, objects=(BASE, replace(BASE, seeds=("point:0.3,0.3,0.5",)))))
    drawing = renderer("vulkan")
    drawing.load(helices, *quantities(scene))
    for _ in range(2):
        drawing.render(scene)
    assert len(prepared) == 2


@pytest.mark.parametrize("size", [{"radius": 0.05}, {"ribbon": 0.1, "arrows": 0.1}])
def test_stagnant_lines_are_reported(draw, size):
    still = data(grid(Shape.HEXAHEDRON, 1), u=constant(0), v=constant(0), w=constant(0))
    shown = Streamlines(("random:3",), **size)
    for device in ("vulkan", "reference"):
        frame = draw(still, device, field="x", objects=(Faces(), shown), size=(20, 20))
        assert frame.seen.any()
    frame = draw(still, field="x", objects=(Faces(), shown), size=(20, 20))
    assert any("none is drawn, as none of the 3 lines moves" in remark for remark in frame.remarks)
    with pytest.raises(SceneError, match="none is drawn, as none of the 3 lines moves"):
        draw(still, field="x", objects=(shown,), size=(20, 20))


def test_lines_on_surfaces_in_space(draw):
    flat = grid(Shape.QUADRILATERAL, 3)
    tilted = replace(flat, space=3, vertices=flat.vertices + np.outer(flat.vertices[:, 0], [0, 0, 2.0]))
    whole = data(tilted, u=lambda p: 0.5 - p[:, 1], v=lambda p: p[:, 0] - 0.5, w=lambda p: 1.0 - 2.0 * p[:, 1])
    found = trace(whole, [[0.8, 0.5, 1.6]], duration=2 * np.pi)
    assert found[0][-1] == pytest.approx([0.8, 0.5, 1.6], abs=1e-10)
    assert np.abs(found.points[:, 2] - 2 * found.points[:, 0]).max() < 1e-12
    shown = Streamlines(("point:0.8,0.5,1.6",), duration=6.0, radius=0.03, arrows=0.4)
    camera = Camera((2.2, -1.7, 3.0), (0.5, 0.5, 1.0), fov=30.0)
    frame = draw(whole, field="u", objects=(replace(shown, arrows=None),), camera=camera, size=(60, 48))
    # the ellipse over the circle of radius 0.3: a pixel's place is a radius from it
    angle = np.linspace(0, 6, 20001)
    line = np.stack([0.5 + 0.3 * np.cos(angle), 0.5 + 0.3 * np.sin(angle), 1 + 0.6 * np.cos(angle)], axis=1)
    place = frame.position[frame.seen]
    assert len(place) > 60
    assert np.abs(np.linalg.norm(place[:, None] - line, axis=2).min(axis=1) - 0.03).max() < 1e-6
    assert draw(whole, field="u", objects=(shown,), camera=camera, size=(60, 48)).seen.sum() > len(place)
    with pytest.raises(SceneError, match="ribbons: expected 2D data in the plane or 3D data, found surfaces in space"):
        draw(whole, objects=(Streamlines(shown.seeds, ribbon=0.1),), size=(8, 8))


class Layout:
    """A kernel whose only record is the ball of a group."""

    def dtype(self, name):
        return np.dtype([(part, float) for part in ("x", "y", "z", "reach", "deviation")])


def test_balls_of_groups_hold_the_balls_of_their_curves():
    rng, count = np.random.default_rng(1), 50
    records = np.zeros(count, [("points", float, 24), ("reach", float), ("deviation", float)])
    for name in records.dtype.names:
        records[name] = rng.uniform(0, 1, records[name].shape)
    listed = rng.integers(count, size=3 * GROUP_SIZE + 5)
    groups = TubeDrawer.around(None, Layout(), records, listed)["groups"]
    assert len(groups) == 3
    own = records[listed[: 3 * GROUP_SIZE]].reshape(3, GROUP_SIZE)
    middle = np.stack([groups[name] for name in "xyz"], axis=1)
    far = np.linalg.norm(own["points"][..., :3] - middle[:, None], axis=2) + own["reach"]
    assert (far.max(axis=1) <= groups["reach"]).all()
    assert groups["reach"] == pytest.approx(far.max(axis=1))
    assert np.array_equal(groups["deviation"], own["deviation"].max(axis=1))
    assert len(TubeDrawer.around(None, Layout(), records, listed[:3])["groups"]) == 1


def test_curves_that_are_skipped_together_change_nothing(draw, circles, monkeypatch):
    """In a small picture, tiles list many curves."""
    lines = Streamlines(("random:40",), "u,v,w", length=6.0)
    scene = {"size": (40, 32), "objects": (lines,), "camera": Camera((2.0, -2.0, 2.0), (0.5, 0.5, 0.5), height=1.6)}
    sizes, around = list[int](), TubeDrawer.around

    def never(drawer, kernel, records, listed):
        groups = around(drawer, kernel, records, listed)["groups"]
        sizes.append(len(groups))
        groups["reach"] = 1e9
        return {"groups": groups}

    skipping = draw(circles, **scene)
    monkeypatch.setattr(TubeDrawer, "around", never)
    every = draw(circles, **scene)
    assert min(sizes) > 20
    for name in ("depth", "status", "element", "field"):
        assert np.array_equal(getattr(skipping, name), getattr(every, name), equal_nan=name in ("depth", "field"))
