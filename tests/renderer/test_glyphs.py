"""Arrows and cones against closed forms, and against the reference's search along each ray."""

from dataclasses import replace

import numpy as np
import pytest
from made_fields import constant, data

from elvis import Camera, Clip, CutSurface, Faces, Glyphs, Plane, SceneError, Sphere, Status, Style, render
from elvis.core.data.dataset import Dataset, Field, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.core.streamlines.anchors import anchors
from elvis.core.testing import curved, grid, mixed_volume, ripple
from elvis.scene.commandline.composing import composed
from elvis.scene.commandline.parameters import glyphs
from elvis.scene.commandline.writing import option_words
from elvis.scene.figure.picture import picture
from elvis.scene.flow.frusta import frusta_in
from elvis.scene.model.tables import scene_of, table_of


@pytest.fixture(scope="module")
def steady():
    """A constant velocity of magnitude 3 in curved hexahedra."""
    mesh = curved(grid(Shape.HEXAHEDRON, 2), ripple(0.05), 3)
    return data(mesh, u=constant(1), v=constant(2), w=constant(2), p=lambda p: p[:, 0] ** 2 + p[:, 1])


@pytest.fixture(scope="module")
def screw():
    """A screw about y = z = 0.5 through curved elements of every shape."""
    mesh = curved(mixed_volume(0), ripple(0.02), 3)
    return data(mesh, u=constant(0.3), v=lambda p: 0.5 - p[:, 2], w=lambda p: p[:, 1] - 0.5)


@pytest.fixture(scope="module")
def flat():
    """A rotation about the middle of a square of curved triangles."""
    mesh = curved(grid(Shape.TRIANGLE, 3), ripple(0.03), 3)
    return data(mesh, u=lambda p: 0.5 - p[:, 1], v=lambda p: p[:, 0] - 0.5)


PLACE = np.array([0.4, 0.3, 0.35])
AXIS = np.array([1.0, 2.0, 2.0]) / 3.0
ONE = Glyphs(("point:0.4,0.3,0.35",), length=0.5, thickness=0.2)
CAMERAS = {
    "aside": Camera((2.2, -1.7, 1.9), (0.5, 0.6, 0.6), fov=16.0),
    "along the axis": Camera(tuple(PLACE + 3 * AXIS), tuple(PLACE), up=(0.0, 0.0, 1.0), height=0.3),
    "parallel": Camera((-2.0, 0.9, 0.3), (0.5, 0.5, 0.5), height=0.8),
    "from within": Camera(tuple(PLACE + 0.1 * AXIS), tuple(PLACE + 0.1 * AXIS + [1, 0.1, 0.3]), fov=80.0),
}


def rays_of(frame):
    """Origins and unit directions of all pixels, and the lengths of what depth counts in."""
    origins, directions = frame.view.every_ray()
    lengths = np.linalg.norm(directions, axis=1)
    return origins, directions / lengths[:, None], lengths


def ends_in_frustum(frame, low, high, radius, slope):
    """(n, 2) lengths along rays where they are between heights of a solid of radius r + k s; NaN where nowhere."""
    origins, along, _ = rays_of(frame)
    found = np.full((len(along), 2), np.nan)
    for row, (place, way) in enumerate(zip(origins - PLACE, along, strict=True)):
        height, rise = place @ AXIS, way @ AXIS
        across, turn = place - height * AXIS, way - rise * AXIS
        thick, change = radius + slope * height, slope * rise
        sides = np.roots([turn @ turn - change**2, 2 * (turn @ across - thick * change), across @ across - thick**2])
        sides = sides[np.abs(sides.imag) < 1e-12].real
        caps = (np.array([low, high]) - height) / rise if rise else np.empty(0)
        at = np.concatenate([sides, caps])
        heights = height + at * rise
        wide = np.linalg.norm(across + at[:, None] * turn, axis=1)
        on = (heights > low - 1e-9) & (heights < high + 1e-9) & (wide < radius + slope * heights + 1e-9)
        if on.sum() > 1:
            found[row] = at[on].min(), at[on].max()
    return found


def first_of_union(parts):
    """(n,) smallest length in front of the eye at which a ray enters intervals, or leaves those it begins in."""
    found = np.full(len(parts[0]), np.inf)
    for row in range(len(found)):
        own = sorted((enters, leaves) for enters, leaves in (part[row] for part in parts) if leaves > 0)
        reach = 0.0
        for enters, leaves in own:
            if enters > reach:
                break
            reach = max(reach, leaves)
        found[row] = reach or min((enters for enters, _ in own), default=np.inf)
    return found


@pytest.mark.sampled
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("shape", ["arrow", "cone"])
def test_pixels_show_the_cone_and_the_cylinder(draw, steady, shape, camera):
    frame = draw(steady, field="p", objects=(replace(ONE, shape=shape),), camera=camera, size=(40, 30))
    # radius of the head 0.1, of the shaft 0.04; an arrow's head is 3 radii long, and the shaft ends 0.3 of it within
    start = 0.2 if shape == "arrow" else 0.0
    slope = -0.1 / (0.5 - start)
    parts = [ends_in_frustum(frame, start, 0.5, -0.5 * slope, slope)]
    if shape == "arrow":
        parts.append(ends_in_frustum(frame, 0.0, 0.29, 0.04, 0.0))
    depth = first_of_union(parts) / rays_of(frame)[2]
    proved = frame.status.ravel() != Status.AMBIGUOUS
    assert proved.mean() > 0.98
    assert proved[frame.seen.ravel()].mean() > 0.9
    assert np.array_equal(frame.seen.ravel()[proved], np.isfinite(depth)[proved])
    both = proved & np.isfinite(depth)
    assert both.sum() >= 30
    assert np.abs(frame.depth.ravel()[both] - depth[both]).max() < 1e-12
    # the value is that of the place it stands at
    assert np.abs(frame.field[frame.seen] - (0.4**2 + 0.3)).max() < 1e-12


def test_normals_match_the_side(draw, steady):
    frame = draw(steady, field="p", objects=(replace(ONE, shape="cone"),), camera=CAMERAS["aside"], size=(60, 45))
    away = frame.position[frame.seen] - PLACE
    height = away @ AXIS
    across = away - height[:, None] * AXIS
    wide = np.linalg.norm(across, axis=1)
    side = wide > 1e-3
    truth = (across / wide[:, None] + 0.2 * AXIS) / np.hypot(1.0, 0.2)
    is_base = height < 1e-9
    truth[is_base] = -AXIS
    assert side.sum() > 60
    assert np.abs(frame.normal[frame.seen] - truth)[side].max() < 1e-9


def test_lattices_have_exact_points_and_vectors(screw):
    found = anchors(screw, ["plane:0.7,0.5,0.5:1,0,0:7", "elements", "boundary:all:2"])
    kinds = found.points[:, 0] == 0.7
    assert kinds.sum() == 12
    x, y, z = found.points.T
    truth = np.stack([np.full(len(x), 0.3), 0.5 - z, y - 0.5], axis=1)
    assert np.abs(found.vectors - truth).max() < 1e-12
    solids = frusta_in(screw, Glyphs(("plane:0.7,0.5,0.5:1,0,0:7",), length=0.2, magnitude=0.4, shape="cone"))
    assert np.array_equal(solids.base, found.points[kinds])
    tips = solids.base + solids.length[:, None] * solids.axis
    assert np.abs(tips - solids.base - 0.5 * truth[kinds]).max() < 1e-13
    equal = frusta_in(screw, Glyphs(("plane:0.7,0.5,0.5:1,0,0:7",), length=0.2, lengths="equal", shape="cone"))
    assert np.array_equal(equal.length, np.full(12, 0.2))


def test_points_without_a_glyph_are_counted(draw, flat, tmp_path):
    table = tmp_path / "points.csv"
    table.write_text("x,y\n0.5,0.5\n0.2,0.2\n7,7\n8,8\n")
    shown = Glyphs((str(table),), "x-0.5,y-0.5", length=0.3)
    frame = draw(flat, field="u", objects=(shown,), size=(20, 20))
    assert set(frame.remarks) >= {
        "points of glyphs that lie outside the mesh: 2",
        "points of glyphs that have the vector zero: 1",
    }
    shown = Glyphs((str(table),), "log(x-0.4),1", length=0.3)
    frame = draw(flat, field="u", objects=(shown,), size=(20, 20))
    assert "points of glyphs that have a vector that is not a number: 1" in frame.remarks


def test_arrows_in_plane_data_are_seen_from_above(draw, flat):
    shown = Glyphs(("point:0.5,0.25",), "1,0", length=0.4, thickness=0.2, style=Style(lit=False))
    camera = Camera((0.7, 0.25, 9), (0.7, 0.25, 0), height=0.53)
    frame = draw(flat, field="u", objects=(shown,), camera=camera, size=(80, 80))
    # a shaft of half the width 0.032 up to a head of radius 0.08, a third of its length
    x, y, _ = frame.view.every_ray()[0].T
    wide = np.where(x < 0.66, 0.032, (0.9 - x) / 3)
    inside = (x > 0.5) & (x < 0.9) & (np.abs(y - 0.25) < wide)
    assert np.array_equal(frame.seen.ravel(), inside)
    assert frame.counts()["ambiguous"] == 0
    assert len(np.unique(frame.element[frame.seen])) == 1


def test_the_key_is_as_long_as_a_glyph_of_its_magnitude(draw, flat, tmp_path):
    shown = Glyphs(("point:0.5,0.25",), "2,0", length=0.4, unit="m/s", style=Style(color=(0.5, 0.5, 0.5)))
    camera = Camera((0.7, 0.25, 9), (0.7, 0.25, 0), height=0.5)
    frame = draw(flat, field="u", objects=(shown,), camera=camera, size=(320, 320))
    (key,) = [legend.arrow for legend in frame.legends if legend.arrow]
    # 2 m/s are 256 pixels long; a fifth of the width is 64, of 0.5 m/s
    assert key.text == "|2, 0| = 0.5 m/s"
    assert np.ptp(key.outline[:, 0]) == pytest.approx(64.0, abs=1e-12)
    # it has the proportions of the glyph as it is seen
    columns, rows = frame.seen.any(axis=0).sum(), frame.seen.any(axis=1).sum()
    assert np.ptp(key.outline, axis=0) / [columns, rows] == pytest.approx(np.full(2, 0.25), rel=0.03)
    # and is drawn below the picture
    with_key, without = (
        np.asarray(picture(replace(frame, drawing=replace(frame.drawing, legends=own))))
        for own in (frame.legends, frame.legends[:-1])
    )
    dark = (with_key[len(without) - 2 :] < 128).all(axis=2)[:, : 20 + round(np.ptp(key.outline[:, 0]))]
    assert abs(dark.any(axis=0).sum() - np.ptp(key.outline[:, 0])) <= 2
    frame.save(tmp_path / "key.svg")
    assert key.text in (tmp_path / "key.svg").read_text(encoding="utf-8")


@pytest.mark.parametrize("change", [{"key": False}, {"lengths": "equal"}])
def test_no_key_without_glyphs(draw, flat, change):
    shown = Glyphs(("point:0.5,0.25",), **change)
    assert not any(legend.arrow for legend in draw(flat, field="u", objects=(shown,), size=(20, 20)).legends)


def test_the_key_in_perspective_uses_the_mean_visible_depth(draw, steady):
    shown = Glyphs(("point:0.4,0.3,0.3", "point:0.4,0.3,0.5", "point:0.95,0.95,0.5"), length=0.1, magnitude=3.0)
    camera = Camera((0.4, 0.3, 2.4), (0.4, 0.3, 0.4), up=(0.0, 1.0, 0.0), fov=20.0)
    for device in ("vulkan", "reference"):
        frame = draw(steady, device, field="p", objects=(shown,), camera=camera, size=(400, 400))
        (key,) = [legend.arrow for legend in frame.legends if legend.arrow]
        pixels = 200 / np.tan(np.radians(10)) / 2.0
        assert key.text == "|u, v, w| = 2 at the mean depth of these glyphs"
        assert key.outline[:, 0].max() == pytest.approx(0.1 * 2 / 3 * pixels, rel=1e-12)


def test_on_surfaces_in_space_the_part_along_them_is_drawn(renderer):
    renderer("vulkan")
    mesh = grid(Shape.QUADRILATERAL, 3)
    tilted = replace(mesh, space=3, vertices=mesh.vertices + np.outer(mesh.vertices[:, 0], [0, 0, 2.0]))
    found = anchors(Dataset(tilted), ["elements"], ["0", "y", "5"])
    # the unit vector up the slope is (1, 0, 2) / sqrt 5: of (0, 0, 5) that leaves (2, 0, 4)
    truth = np.stack([np.full(9, 2.0), found.points[:, 1], np.full(9, 4.0)], axis=1)
    assert np.abs(found.vectors - truth).max() < 1e-12
    shown = Glyphs(("elements",), "0,y,5", length=0.3)
    frame = render(Dataset(tilted), field="x", objects=(shown,), camera="iso", size=(60, 60))
    assert len(np.unique(frame.element[frame.seen])) == 9


def test_quasi_3d_data_have_three_components(draw):
    mesh = curved(grid(Shape.QUADRILATERAL, 2), ripple(0.04), 3)
    waves = Homogeneous((Basis.FOURIER,), (0.5,), (0, 1))
    blocks = data(mesh, u=lambda p: p[:, 0] * p[:, 1]).field("u").blocks
    spread = tuple(
        replace(
            block,
            expansion=replace(block.expansion, homogeneous=waves),
            coefficients=np.hstack([block.coefficients, 0 * block.coefficients]),
        )
        for block in blocks
    )
    whole = Dataset(mesh, (Field("u", spread),))
    shown = Glyphs(("point:0.3,0.6,0.2", "point:0.8,0.4,0.4"), "0*u,u,z", length=0.2, lengths="equal")
    found = anchors(whole, shown.points, ["0*u", "u", "z"])
    assert found.vectors == pytest.approx(np.array([[0, 0.18, 0.2], [0, 0.32, 0.4]]), abs=1e-12)
    frame = draw(whole, field="u", objects=(shown,), camera="iso", size=(60, 60))
    values = frame.field[frame.seen]
    assert np.abs(values[:, None] - [0.18, 0.32]).min(axis=1).max() < 1e-12
    assert np.ptp(values) > 0.1


#: what touches: axes of solids, rays and edges that run along one another, or meet
@pytest.mark.sampled(free=("seed",))
@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("shape", ["arrow", "cone"])
def test_certain_pixels_are_right_in_aligned_views(draw, steady, shape, seed):
    random = np.random.default_rng(seed)
    points = random.integers(1, 8, (3, 3)) / 8
    axis = int(random.integers(3))
    vector = ("1,0,0", "0,1,0", "0,1,1", "1,0,-1")[seed % 4]
    shown = Glyphs(
        tuple(f"point:{x},{y},{z}" for x, y, z in points.tolist()),
        vector,
        shape=shape,
        lengths="equal",
        length=0.25,
        thickness=0.25,
        style=Style(opacity=0.5),
    )
    eye = points[0] + 10.0 ** random.integers(0, 6) * np.eye(3)[axis]
    camera = Camera(tuple(eye), tuple(points[0]), up=tuple(np.eye(3)[axis - 1]), height=0.5)
    scene = {"field": "p", "objects": (shown,), "camera": camera, "size": (17, 17)}
    frame, truth = (draw(steady, device, **scene) for device in ("vulkan", "reference"))
    sure = (frame.status != Status.AMBIGUOUS) & (truth.status != Status.AMBIGUOUS)
    assert np.array_equal(frame.element[sure], truth.element[sure])
    sure &= frame.seen
    assert sure.sum() > 10
    assert np.abs(frame.depth[sure] - truth.depth[sure]).max() < 1e-9 * max(1.0, np.abs(eye).max())


BASE = Glyphs(("plane:0.7,0.5,0.5:1,0.2,0:4", "point:1.4,0.5,0.5"), length=0.35, thickness=0.2)
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
    "cones on faces": {
        "objects": (
            Glyphs(("boundary:all:1",), lengths="equal", shape="cone", length=0.2, thickness=0.3),
            Faces(style=Style(opacity=0.3)),
        )
    },
}


@pytest.mark.parametrize("scene", SCENES)
def test_pictures_match_those_of_the_reference(draw, screw, scene):
    frame, truth = (draw(screw, device, **VIEW, **SCENES[scene]) for device in ("vulkan", "reference"))
    sure = frame.status != Status.AMBIGUOUS
    assert np.array_equal(frame.element[sure], truth.element[sure])
    assert frame.counts()["certain"] > 0.95 * frame.seen.sum() > 200
    sure &= frame.seen
    assert np.abs(frame.depth[sure] - truth.depth[sure]).max() < 1e-9
    assert np.abs(frame.field[sure] - truth.field[sure]).max() < 1e-9
    assert np.abs(frame.color - truth.color).max(axis=2)[sure].max() < 1e-7


def test_scenes_commands_and_python_agree(draw, flat):
    text = "elements;points.csv;vector=u,v,0;shape=cone;lengths=equal;length=0.1"
    made = glyphs(text)
    assert made == Glyphs(("elements", "points.csv"), "u,v,0", shape="cone", lengths="equal", length=0.1)
    scene = composed((), {"glyphs": (made,), "contours": None, "opacity": 0.5}, ())
    assert scene.objects[0].style.opacity == 0.5
    assert scene_of(table_of(scene)) == scene
    assert scene_of(table_of(scene), "below").objects[0].points[1].replace("\\", "/") == "below/points.csv"
    assert option_words(scene)[:2] == ["--glyphs", text]
    one = render(flat, field="u", glyphs=[(0.5, 0.25), (0.3, 0.3)], size=(30, 30))
    other = draw(flat, field="u", objects=(Glyphs(("point:0.5,0.25", "point:0.3,0.3")),), size=(30, 30))
    assert one.seen.any()
    assert np.array_equal(one.rgb, other.rgb)


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"points": ()}, "points of glyphs: expected at least one, found none"),
        ({"shape": "fish"}, "shape of glyphs: expected arrow or cone, found fish"),
        ({"lengths": "odd"}, "lengths of glyphs: expected magnitude or equal, found odd"),
        ({"length": -1.0}, "length of glyphs: expected a positive number, found -1.0"),
        ({"thickness": 0.5}, "thickness of glyphs: expected a number from 0 to 0.3, found 0.5"),
        ({"style": Style(mesh_lines=True)}, "style"),
        (
            {"points": ("point:7,7,7",)},
            "expected some in the elements where the vector is not zero, found 1 that lie out",
        ),
        ({"vector": "0*x,0*y,0*z"}, "expected some in the elements .*, found 1 that have the vector zero"),
        ({"points": ("pont:7,7,7",)}, "glyphs: expected seeds as one of .*perhaps point"),
        ({"vector": "u,v"}, "glyphs: expected a velocity of 3 components"),
        ({"vector": "u,v,vv"}, "glyphs: .*'vv'"),
        ({"points": ("-",)}, "expected the name of a table, found -"),
    ],
)
def test_invalid_input_is_rejected(draw, screw, given, match):
    with pytest.raises(SceneError, match=match):
        draw(screw, objects=(Glyphs(**{"points": ("point:1,0.5,0.5",), **given}),), size=(8, 8))
