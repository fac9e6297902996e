"""Scenes of several objects: cuts by any surface, clips, opacity, samples, bands; against analytic expressions."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import (
    Camera,
    Clip,
    Cone,
    Contours,
    CutSurface,
    Cylinder,
    Faces,
    Implicit,
    Isosurface,
    Light,
    MeshLines,
    Plane,
    Scene,
    SceneError,
    Sphere,
    Status,
    Style,
    Transfer,
    TriangleMesh,
    VolumeRendering,
)
from elvis.core.base.errors import FormatError
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple
from elvis.renderer.passes.solids.hits import _touched, hits, outside
from elvis.scene import unit
from elvis.scene.cameras.view import View
from elvis.scene.figure.picture import picture

CENTER = np.array([0.5, 0.45, 0.55])
NEAR = Camera((2.0, -1.6, 1.7), (0.5, 0.5, 0.5), fov=35.0)
FLAT = Camera((2.0, -1.6, 1.7), (0.5, 0.5, 0.5), height=1.6)
AXIS = (0.2, 0.1, 1.0)
SURFACES = {
    "sphere": Sphere(tuple(CENTER), 0.35),
    "cylinder": Cylinder(tuple(CENTER), AXIS, 0.3),
    "cone": Cone((0.5, 0.45, 0.1), AXIS, 25.0),
    "plane": Plane(tuple(CENTER), AXIS),
}


def value(points):
    return points @ [1.0, 2.0, -3.0]


def apart(name, points):
    """(n,) how far points are from a surface, by a formula of this test alone."""
    axis = unit(AXIS, "axis")
    if name == "sphere":
        return np.linalg.norm(points - CENTER, axis=1) - 0.35
    if name == "plane":
        return (points - CENTER) @ axis
    if name == "cylinder":
        return np.linalg.norm(np.cross(points - CENTER, axis), axis=1) - 0.3
    away = points - [0.5, 0.45, 0.1]
    return np.rad2deg(np.arctan2(np.linalg.norm(np.cross(away, axis), axis=1), away @ axis)) - 25.0


@pytest.fixture(scope="module")
def data(linear):
    return linear(curved(grid(Shape.TETRAHEDRON, 2), ripple(0.04, seed=2), 2))


@pytest.mark.parametrize("camera", [NEAR, FLAT], ids=["perspective", "parallel"])
@pytest.mark.parametrize("name", SURFACES)
def test_cuts_by_surfaces_lie_on_them(draw, data, name, camera):
    frame = draw(data, objects=(CutSurface(SURFACES[name]), CutSurface(SURFACES[name])), camera=camera, size=(60, 50))
    seen, position = frame.seen, frame.position[frame.seen]
    assert seen.sum() > 200
    assert np.abs(apart(name, position)).max() < 1e-9
    assert np.abs(frame.field[seen] - value(position)).max() < 1e-11
    assert frame.counts()["failed"] == 0

    # the pixel's ray leads there, and the normal is the surface's, towards the viewer
    rows, columns = np.nonzero(seen)
    assert np.abs(frame.view.to_pixel[:, :3] @ position.T + frame.view.to_pixel[:, 3:])[2].min() > 0
    homogeneous = np.append(position, np.ones((len(position), 1)), axis=1) @ frame.view.to_pixel.T
    assert np.abs(homogeneous[:, :2] / homogeneous[:, 2:] - np.stack([columns, rows], axis=1)).max() < 1e-8
    normal, step = frame.normal[seen], 1e-6
    assert np.allclose(np.linalg.norm(normal, axis=1), 1.0)
    slope = [(apart(name, position + step * e) - apart(name, position - step * e)) / (2 * step) for e in np.eye(3)]
    cosine = np.einsum("in,ni->n", slope, normal) / np.linalg.norm(slope, axis=0)
    assert np.abs(np.abs(cosine) - 1.0).max() < 1e-4
    assert (np.einsum("ni,ni->n", normal, frame.view.rays(columns, rows)[1]) <= 0).all()


def test_the_nearest_of_both_hits_inside_the_volume_is_shown(draw, cube):
    """Half of the sphere before the cube is nothing: what is seen there is its back."""
    sphere = Sphere((0.5, 0.0, 0.5), 0.4)
    camera = Camera((0.5, -3.0, 0.5), (0.5, 0.5, 0.5), height=1.2)
    frame = draw(cube, objects=(CutSurface(sphere),), camera=camera, size=(40, 40))
    assert frame.seen.sum() > 300
    assert (frame.position[frame.seen][:, 1] >= 0.0).all()
    assert np.abs(np.linalg.norm(frame.position[frame.seen] - [0.5, 0, 0.5], axis=1) - 0.4).max() < 1e-12


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "glb"])
def test_triangle_files_cut(draw, cube, tmp_path, suffix):
    """A box of triangles, joined and cut open: each of its sides is a plane."""
    import trimesh

    file = tmp_path / f"box.{suffix}"
    trimesh.creation.box(bounds=[[0.25, 0.25, 0.25], [0.75, 0.75, 0.75]]).export(file)
    frame = draw(cube, objects=(CutSurface(TriangleMesh(str(file))),), camera=NEAR, size=(60, 50))
    position = frame.position[frame.seen]
    assert len(position) > 300
    assert np.abs(np.abs(position - 0.5).max(axis=1) - 0.25).max() < 1e-7
    assert np.abs(frame.field[frame.seen] - value(position)).max() < 1e-11

    # no holes where triangles join: what is seen is convex, so every row is one run
    for row in frame.seen:
        columns = np.flatnonzero(row)
        assert len(columns) == 0 or np.ptp(columns) == len(columns) - 1


def test_implicit_cuts_of_spheres_match_spheres(draw, data):
    x, y, z = CENTER
    text = f"(x-{x})^2+(y-{y})^2+(z-{z})^2-0.35^2"
    frame = draw(data, objects=(CutSurface(Implicit(text)),), camera=NEAR, size=(24, 20))
    exact = draw(data, objects=(CutSurface(SURFACES["sphere"]),), camera=NEAR, size=(24, 20))
    assert (frame.seen != exact.seen).sum() <= 2
    both = frame.seen & exact.seen
    assert np.abs(frame.position - exact.position)[both].max() < 1e-8
    assert np.abs(frame.field - exact.field)[both].max() < 1e-8


@pytest.mark.parametrize("away", ["inside", "outside"])
@pytest.mark.parametrize("name", SURFACES)
def test_clips_take_one_side_away(draw, cube, name, away):
    clip = (Clip(replace(SURFACES[name], radius=0.7) if name == "sphere" else SURFACES[name], away),)
    whole = draw(cube, objects=(Faces(),), camera=NEAR, size=(50, 40))
    rest = draw(cube, objects=(Faces(),), camera=NEAR, size=(50, 40), clip=clip)
    sign = 1.0 if away == "inside" else -1.0
    bigger = 0.35 if name == "sphere" else 0.0
    assert (sign * (apart(name, rest.position[rest.seen]) - bigger) >= -1e-9).all()
    away = apart(name, np.nan_to_num(whole.position.reshape(-1, 3))).reshape(40, 50) - bigger
    kept = whole.seen & (sign * away > 1e-9)
    assert np.array_equal(rest.depth[kept], whole.depth[kept])
    gone = whole.seen & ~kept
    assert (rest.depth[gone] > whole.depth[gone]).all()


def test_a_cut_does_not_clip_itself(draw, cube):
    sphere = SURFACES["sphere"]
    alone = draw(cube, objects=(CutSurface(sphere),), camera=NEAR, size=(40, 40))
    clipped = draw(cube, objects=(CutSurface(sphere),), camera=NEAR, size=(40, 40), clip=(Clip(sphere, "outside"),))
    assert np.array_equal(alone.seen, clipped.seen)


def test_transparent_faces_show_those_behind(draw, cube):
    """Seen along y, the cube has two faces over each pixel; colours add up by the formula of transparency."""
    camera = Camera((0.5, -3.0, 0.5), (0.5, 0.5, 0.5), height=0.8)
    style = Style(color=(1.0, 0.0, 0.0), opacity=0.3, lit=False)
    frame = draw(cube, objects=(Faces(style=style),), camera=camera, size=(20, 16))
    left = (1.0 - 0.3) ** 2
    assert np.allclose(frame.color, [1.0, left, left], atol=1e-12)
    assert np.allclose(frame.position[..., 1], 0.0)

    # an opaque plane between them is what is recorded, and hides the second
    cut = CutSurface(Plane((0.5, 0.5, 0.5), (0, 1, 0)), Style(color=(0.0, 0.0, 1.0)))
    frame = draw(cube, objects=(Faces(style=style), cut), camera=camera, size=(20, 16))
    assert np.allclose(frame.color, [0.3, 0.0, 0.7], atol=1e-12)
    assert np.allclose(frame.position[..., 1], 0.5)
    assert np.abs(frame.field - value(frame.position)).max() < 1e-12


def test_each_of_two_planes_is_visible_where_it_is_nearer(draw, data):
    planes = [Plane((0.5, 0.5, 0.5), (1.0, 0.1, 0.0)), Plane((0.5, 0.5, 0.5), (0.1, 0.0, 1.0))]
    both = draw(data, objects=tuple(map(CutSurface, planes)), camera=NEAR, size=(60, 50))
    one, two = (draw(data, plane=plane, camera=NEAR, size=(60, 50)) for plane in planes)
    first = one.depth <= two.depth
    for name in ("element", "field", "status"):
        nearer = np.where(first, getattr(one, name), getattr(two, name))
        assert np.array_equal(getattr(both, name), nearer, equal_nan=name == "field")
    assert np.allclose(both.depth[both.seen], np.minimum(one.depth, two.depth)[both.seen], rtol=0, atol=1e-12)
    assert np.allclose(both.position[both.seen], np.where(first[..., None], one.position, two.position)[both.seen])


def test_a_plane_with_a_style_has_the_record_of_a_plain_one(draw, data):
    plane = SURFACES["plane"]
    plain = draw(data, plane=plane, camera=NEAR, size=(60, 50))
    styled = draw(data, objects=(CutSurface(plane, Style(opacity=0.5)),), camera=NEAR, size=(60, 50))
    for name in ("element", "field", "status", "reference"):
        assert np.array_equal(getattr(plain, name), getattr(styled, name), equal_nan=name in ("field", "reference"))
    assert np.allclose(styled.color[plain.seen], 0.5 * plain.color[plain.seen] + 0.5, atol=1e-12)
    assert plain.range == styled.range


def test_objects_with_separate_quantities(draw, cube):
    """Each object its quantity, its map and its range."""
    one = Style(quantity="x*y", palette="gray", range=(0.0, 1.0))
    objects = (CutSurface(Plane((0.5, 0.5, 0.5), (0, 0, 1)), one), CutSurface(Plane((0.5, 0.5, 0.2), (0, 0, 1))))
    above = Camera((0.5, 0.5, 3.0), (0.5, 0.5, 0.5), (0, 1, 0), height=0.9)
    frame = draw(cube, objects=objects, camera=above, size=(20, 20))
    position = frame.position
    assert np.abs(frame.field - position[..., 0] * position[..., 1]).max() < 1e-12
    assert np.abs(frame.color[..., 0] - frame.field).max() <= 1 / 256
    assert [legend.title for legend in frame.legends] == ["x*y", "u"]
    assert frame.legends[0].palette.high == 1.0


@pytest.mark.parametrize("device", ["renderer", "reference"])
def test_isosurfaces_have_the_colours_of_the_scenes_field(draw, cube, device):
    """One of another quantity, where no style says what colours it: values, colour map and bar are the field's."""
    from elvis.reference.picture import render as reference

    scene = {"field": "u", "objects": (Isosurface((0.3,), "x*x"),), "palette": "gray", "size": (24, 20)}
    scene["camera"] = Camera((3.0, 0.4, 0.6), (0.5, 0.5, 0.5), height=1.2)
    frame = draw(cube, **scene) if device == "renderer" else reference(cube, Scene(**scene))
    seen, position = frame.seen, frame.position
    assert seen.any()
    assert np.abs(position[seen][:, 0] - 0.3**0.5).max() < 1e-9
    assert np.abs(frame.field[seen] - value(position[seen])).max() < 1e-9
    assert len(np.unique(frame.color[seen][:, 0])) > 20
    (legend,) = frame.legends
    assert legend.title == "u"
    assert legend.constant is None
    assert legend.palette.low == pytest.approx(frame.field[seen].min())


def test_colours_are_means_over_samples(draw, cube):
    """Half planes in two colours: at a vertical border every pixel has the part that the samples say."""
    camera = Camera((0.503, -3.0, 0.5), (0.503, 0.5, 0.5), height=2.0)
    scene = {"objects": (Faces(style=Style(color=(0.0, 0.0, 0.0), lit=False)),), "camera": camera, "size": (41, 40)}
    once = draw(cube, **scene)
    assert set(np.unique(once.color)) == {0.0, 1.0}
    for samples in (2, 3, 4):
        frame = draw(cube, **scene, samples=samples)
        assert np.array_equal(frame.depth, once.depth)
        steps = (np.arange(samples) - 0.5 * (samples - 1)) / samples
        right = 0.503 + 0.05 * (np.arange(41)[:, None] - 20 + steps)
        covered = ((right > 0) & (right < 1)).mean(axis=1)
        assert np.allclose(frame.color[20, :, 0], 1.0 - covered, atol=1e-12)


def test_ranges_of_the_visible_part_and_of_all(draw, data):
    plane = Plane(tuple(CENTER), (0, 0, 1))
    for scene in ({"plane": plane}, {"objects": (CutSurface(plane, Style(opacity=0.9)),)}):
        seen = draw(data, **scene, size=(40, 40))
        assert seen.range == (np.nanmin(seen.field), np.nanmax(seen.field))
        every = draw(data, **scene, size=(40, 40), range="all")
        assert every.range[0] < seen.range[0] - 0.3
        assert every.range[1] > seen.range[1] + 0.3
        given = draw(data, **scene, size=(40, 40), range=(0.0, 1.0))
        assert given.range == (0.0, 1.0)
    with pytest.raises(SceneError, match="no bounds of '1/u' over all data are known"):
        draw(data, plane=plane, field="1/u", size=(40, 40), range="all")


def test_light_falls_by_the_cosine(draw, cube):
    camera = Camera((0.5, -3.0, 0.5), (0.5, 0.5, 0.5), height=0.8)
    style = Style(color=(1.0, 1.0, 1.0))
    for direction, cosine in (((0, -1, 0), 1.0), ((0, -1, 1), 0.5**0.5), ((0, 1, 0), 0.0), (None, 1.0)):
        lights = (Light(direction, 0.5),)
        frame = draw(cube, objects=(Faces(style=style),), camera=camera, size=(20, 20), lights=lights, ambient=0.25)
        assert np.allclose(frame.color, 0.25 + 0.5 * cosine, atol=1e-12)


@pytest.mark.parametrize(("style", "share"), [(Style(color=(1.0, 1.0, 1.0)), 0.3), (Style(), 0.5)])
def test_colours_of_maps_have_more_ambient_light(draw, cube, style, share):
    camera = Camera((0.5, -3.0, 0.5), (0.5, 0.5, 0.5), height=0.8)
    bright, dark = (
        draw(cube, objects=(Faces(style=style),), camera=camera, size=(20, 20), lights=(), **ambient).color
        for ambient in ({"ambient": 1.0}, {})
    )
    assert np.allclose(dark, share * bright, atol=1e-12)


def test_views_are_fitted_to_the_visible_objects(draw, cube):
    sphere = Sphere((0.9, 0.9, 0.9), 0.05)
    for objects in ((CutSurface(sphere),), (Faces(),)):
        frame = draw(cube, objects=objects, camera="iso", size=(80, 60))
        rows, columns = np.flatnonzero(frame.seen.any(axis=1)), np.flatnonzero(frame.seen.any(axis=0))
        assert np.ptp(rows) > 0.85 * 60 or np.ptp(columns) > 0.85 * 80
        assert not frame.seen[[0, -1]].any()
        assert not frame.seen[:, [0, -1]].any()


def test_objects_outside_the_data_are_reported(draw, cube):
    with pytest.raises(
        SceneError, match="the picture is empty: nothing of any object is visible; the domain lies between"
    ):
        draw(cube, objects=(CutSurface(Sphere((9.0, 9.0, 9.0), 0.5)),), camera=NEAR, size=(20, 20))


def test_flat_data_accept_styles_but_no_cuts(draw, linear):
    flat = linear(grid(Shape.QUADRILATERAL, 2))
    frame = draw(flat, objects=(Faces(style=Style(contours=Contours(count=3))),), size=(60, 60))
    plain = draw(flat, size=(60, 60))

    # with lines a margin is drawn around the picture, so that places are rounded otherwise
    assert np.allclose(frame.field, plain.field, rtol=0, atol=1e-14, equal_nan=True)
    assert np.array_equal(frame.element, plain.element)
    assert 0 < (frame.color != plain.color).any(axis=2).mean() < 0.2
    with pytest.raises(SceneError, match="2D data are drawn in their own plane"):
        draw(flat, objects=(CutSurface(Sphere((0, 0, 0), 1.0)),), size=(60, 60))


def test_rays_and_triangles_intersect_for_every_eye_position(tmp_path):
    """An eye within a tetrahedron sees a side in every direction, also of triangles that reach behind it."""
    import trimesh

    corners = [[-3.0, -3.0, -3.0], [9.0, -3.0, -3.0], [-3.0, 9.0, -3.0], [-3.0, -3.0, 9.0]]
    faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    trimesh.Trimesh(corners, faces).export(tmp_path / "t.ply")
    surface = TriangleMesh(str(tmp_path / "t.ply"))
    view = View.through(Camera((0.0, 0.0, 0.0), (1.0, 0.3, 0.2), fov=120.0), (40, 30))
    met = hits(surface, view)
    assert np.array_equal(met.pixel, np.arange(1200))
    points = np.multiply(met.depth[:, None], view.rays(met.pixel % 40, met.pixel // 40)[1])
    level = np.stack([*(points.T + 3.0), 3.0 - points.sum(axis=1)])
    assert np.abs(level).min(axis=0).max() < 1e-6
    assert (level > -1e-6).all()
    inner = np.array([[0.0, 0.0, 0.0], [4.0, 4.0, 4.0], [-4.0, 0.0, 0.0]])
    assert np.array_equal(outside(surface, inner) < 0, [True, False, False])
    trimesh.Trimesh(corners, faces[1:]).export(tmp_path / "open.ply")
    with pytest.raises(FormatError, match=r"open\.ply: expected a closed surface, found open edges"):
        outside(TriangleMesh(str(tmp_path / "open.ply")), inner)


@pytest.mark.parametrize("content", [b"", b"solid\nendsolid\n", b"nonsense"])
def test_files_without_triangles_are_rejected(tmp_path, content):
    (tmp_path / "a.stl").write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.stl: expected (a triangle mesh|triangles), found none"):
        hits(TriangleMesh(str(tmp_path / "a.stl")), View.through(NEAR, (4, 4)))


def test_pictures_of_objects_have_their_legends(draw, cube):
    style = Style(contours=Contours(values=(-1.0, 0.0, 1.0)))
    frame = draw(cube, objects=(Faces(style=style),), camera=NEAR, size=(300, 240))
    assert frame.legends[0].marks == ((-1.0, (0.0, 0.0, 0.0)), (0.0, (0.0, 0.0, 0.0)), (1.0, (0.0, 0.0, 0.0)))
    assert picture(frame, plain=True).size == (300, 240)
    assert np.array_equal(np.asarray(picture(frame, plain=True)), frame.rgb)
    assert (frame.status[~frame.seen] == Status.MISS).all()


def test_volumes_lie_in_front_of_and_behind_surfaces(draw, linear):
    """Density 2 all over the cube, seen along y, with a half opaque plane in its middle: closed form."""
    camera = Camera((0.507, -3.0, 0.5), (0.507, 0.5, 0.5), height=0.6)
    straight = linear(grid(Shape.TETRAHEDRON, 1))
    volume = VolumeRendering(Transfer((-9.0, 9.0), (2.0, 2.0), ((0.0, 1.0, 0.0),) * 2), error=1e-6)
    left = np.exp(-2.0)
    alone = draw(straight, objects=(volume,), camera=camera, size=(16, 12))
    assert np.allclose(alone.color, [left, 1.0, left], atol=1e-5)
    assert (alone.status == Status.CERTAIN).all()
    half = CutSurface(Plane((0.5, 0.5, 0.5), (0, 1, 0)), Style(color=(1.0, 0.0, 0.0), opacity=0.5))
    both = draw(straight, objects=(half, volume), camera=camera, size=(16, 12))
    first = np.exp(-1.0)
    red = first * (0.5 + 0.5 * first)
    green = (1 - first) + first * 0.5 * (1 - first) + first * 0.5 * first
    assert np.allclose(both.color, [red, green, first * 0.5 * first], atol=1e-5)
    assert np.allclose(both.position[..., 1], 0.5)


def test_hits_are_not_found_twice(draw, linear):
    """A transparent isosurface that every ray meets once has one fragment: one colour all over."""
    style = Style(color=(1.0, 0.0, 0.0), opacity=0.5, lit=False)
    camera = Camera((0.5, -3.0, 0.5), (0.5, 0.5, 0.5), height=0.8)
    frame = draw(
        linear(grid(Shape.TETRAHEDRON, 2)), objects=(Isosurface((0.0,), style=style),), camera=camera, size=(40, 30)
    )
    assert frame.seen.sum() > 300
    assert np.allclose(frame.color[frame.seen], [1.0, 0.5, 0.5], atol=1e-12)


def test_surfaces_in_space_are_shown_by_default(draw, shared):
    """Positions and values are those of map and field at the reference coordinates."""
    sphere = shared("sphere_manifold")
    name = sphere.fields[0].name
    frame = draw(sphere, objects=(Faces(),), size=(60, 50))
    evaluator = Evaluator(sphere, [Expression.of(sphere, text) for text in ("x", "y", "z", name)])
    seen = frame.seen
    assert seen.sum() > 1000
    *place, value_there = (evaluator.at(e, frame.element[seen], frame.reference[seen]) for e in evaluator.expressions)
    assert np.abs(frame.position[seen] - np.stack(place, axis=1)).max() < 1e-10
    assert np.abs(frame.field[seen] - value_there).max() < 1e-11

    # the equator, where the surface runs along z, is like the rest
    lines = Style(mesh_lines=MeshLines(), contours=Contours(count=5), opacity=0.5)
    styled = draw(sphere, objects=(Faces(style=lines),), size=(60, 50))
    assert np.array_equal(styled.element, frame.element)
    radius = np.linalg.norm(frame.position[seen], axis=1)
    assert np.abs(np.einsum("ni,ni->n", frame.normal[seen], frame.position[seen]) / radius - 1.0).max() < 0.02
    with pytest.raises(SceneError, match="surfaces in space are drawn as they are"):
        draw(sphere, plane=Plane((0, 0, 0), (0, 0, 1)), size=(30, 30))


@pytest.mark.parametrize("surface", [Sphere((0.3, 0.2, 0.1), 0.5), Cylinder((0.3, 0.2, 0.1), (1, 2, 2), 0.5)])
def test_rays_that_touch_a_surface_are_doubtful_from_just_before_it(surface):
    rng = np.random.default_rng(7)
    centre = np.array([0.3, 0.2, 0.1])
    normal = rng.normal(size=(60, 3))
    if isinstance(surface, Cylinder):
        axis = np.array([1, 2, 2]) / 3
        normal -= (normal @ axis)[:, None] * axis
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.cross(normal, rng.normal(size=(60, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    depth = rng.uniform(1, 5, 60)
    origins = centre + 0.5 * normal - depth[:, None] * along
    found = _touched(surface, origins, along)
    assert (found < depth).all()
    assert (found > depth - 1e-5).all()
    for way in (-1e-3, 1e-3):
        assert np.isinf(_touched(surface, origins + way * normal, along)).all()
