"""The reference draws faces, cut surfaces and isosurfaces: against analytic expressions, without any device."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Dataset, Plane, Scene, Status
from elvis.core.base.errors import ElvisError
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple, with_field
from elvis.core.testing.meshes import connected
from elvis.reference.picture import render
from elvis.reference.study import compare_scene
from elvis.scene import (
    Clip,
    Cone,
    Contours,
    CutSurface,
    Cylinder,
    Faces,
    Implicit,
    Isosurface,
    MeshLines,
    Sphere,
    Style,
    Transfer,
    VolumeRendering,
)

SOLIDS = Shape.of_dimension(3)
CENTRE = np.array([0.5, 0.5, 0.5])
NEAR = Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), fov=28.0)
PARALLEL = Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), height=1.9)
SIZE = (60, 50)


def name_of(shape):
    return shape.label


def ball(x):
    return ((x - CENTRE) ** 2).sum(axis=1)


def solid(shape, cells=2, bend=0.0, function=ball, modes=3):
    """The unit cube with a field; curved inside, so that the cube stays a cube, where ``bend`` is not zero."""
    mesh = grid(shape, cells)
    if bend:
        inner = ripple(bend, seed=4)
        mesh = curved(mesh, lambda x: x + (inner(x) - x) * np.prod(4 * x * (1 - x), axis=1, keepdims=True), 4)
    return Dataset(mesh, (approximated(Dataset(mesh), "u", function, modes=modes),))


def rays(frame):
    """Origins and directions (h, w, 3)."""
    rows, columns = np.indices(frame.status.shape)
    found = frame.view.rays(columns.ravel().astype(float), rows.ravel().astype(float))
    return [part.reshape(*frame.status.shape, 3) for part in found]


def cube_depths(origins, directions):
    """Depths at which rays enter and leave the unit cube; NaN where they miss it."""
    with np.errstate(divide="ignore"):
        ends = np.sort(np.stack([-origins / directions, (1 - origins) / directions]), axis=0)
    near, far = ends[0].max(axis=-1), ends[1].min(axis=-1)
    return np.where(near < far, near, np.nan), np.where(near < far, far, np.nan)


def sphere_depths(origins, directions, radius):
    """Depths at which rays meet a sphere about the centre; NaN where they don't."""
    away = origins - CENTRE
    a, b, c = ((u * v).sum(axis=-1) for u, v in ((directions, directions), (away, directions), (away, away)))
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b**2 - a * (c - radius**2))
    return (-b - root) / a, (-b + root) / a


def check_depths(frame, expected, tolerance=1e-12):
    """Depths as expected, but for pixels whose ray touches what is drawn within rounding."""
    assert frame.counts()["failed"] == 0
    certain = frame.status != Status.AMBIGUOUS
    assert np.array_equal(frame.seen[certain], np.isfinite(expected)[certain])
    both = frame.seen & np.isfinite(expected)
    assert both.sum() > 200
    assert np.abs(frame.depth - expected)[both].max() < tolerance


@pytest.mark.parametrize("camera", [NEAR, PARALLEL], ids=["perspective", "parallel"])
@pytest.mark.parametrize("shape", SOLIDS, ids=name_of)
def test_outer_faces_match_the_cube(shape, camera):
    frame = render(solid(shape, bend=0.05), Scene("u", camera=camera, size=SIZE, objects=(Faces(),)))
    check_depths(frame, cube_depths(*rays(frame))[0])
    seen = frame.seen
    assert np.abs(frame.field[seen] - ball(frame.position[seen])).max() < 0.05
    outwards = np.abs(frame.position - 0.5)[seen].argmax(axis=1)
    expected = np.eye(3)[outwards] * np.sign(frame.position - 0.5)[seen]
    certain = frame.status[seen] == Status.CERTAIN
    assert np.abs(frame.normal[seen] - expected)[certain].max() < 1e-9


@pytest.mark.parametrize("shape", SOLIDS, ids=name_of)
def test_isosurfaces_are_spheres(shape):
    radius = 0.37
    frame = render(solid(shape), Scene("u", camera=NEAR, size=SIZE, objects=(Isosurface((radius**2,)),)))
    check_depths(frame, sphere_depths(*rays(frame), radius)[0], 1e-11)
    seen = frame.seen
    assert np.abs(frame.field[seen] - radius**2).max() < 1e-13
    assert np.abs(frame.normal - (frame.position - CENTRE) / radius)[seen].max() < 1e-9


def test_isosurfaces_in_curved_elements():
    """The map is not linear and the field is none of the space; it still has its value everywhere on the surface."""
    data = solid(Shape.HEXAHEDRON, 2, 0.08, modes=6)
    frame = render(data, Scene("u", camera=NEAR, size=SIZE, objects=(Isosurface((0.12,)),)))
    assert frame.seen.sum() > 200
    assert np.abs(frame.field[frame.seen] - 0.12).max() < 1e-13
    expected = sphere_depths(*rays(frame), np.sqrt(0.12))[0]
    both = frame.seen & np.isfinite(expected)
    assert np.abs(frame.depth - expected)[both].max() < 0.05


def test_all_shells_behind_one_another_are_found():
    """Transparent: every ray's hits with three spheres count, their opacities multiply."""
    radii, opacity = (0.2, 0.3, 0.4), 0.25
    style = Style(opacity=opacity, color=(0.0, 0.0, 0.0), lit=False)
    shells = Isosurface(tuple(r**2 for r in radii), style=style)
    frame = render(solid(Shape.TETRAHEDRON), Scene("u", camera=PARALLEL, size=SIZE, objects=(shells,)))
    crossed = sum(2 * np.isfinite(sphere_depths(*rays(frame), radius)[0]) for radius in radii)
    certain = frame.status != Status.AMBIGUOUS
    assert np.abs(frame.color[..., 0] - (1 - opacity) ** crossed)[certain].max() < 1e-12
    assert set(np.unique(crossed)) == {0, 2, 4, 6}


@pytest.mark.parametrize(
    ("surface", "function"),
    [
        (Sphere((0.5, 0.5, 0.5), 0.4), lambda p: np.linalg.norm(p - 0.5, axis=-1) - 0.4),
        (Cylinder((0.5, 0.4, 0.0), (0.1, 0.2, 1.0), 0.3), None),
        (Cone((0.5, 0.5, 1.1), (0.0, 0.1, -1.0), 20.0), None),
        (Plane((0.5, 0.5, 0.5), (0.1, 0.3, 1.0)), None),
        (Implicit("(x-0.5)^2+(y-0.5)^2+(z-0.5)^2-0.16"), lambda p: np.linalg.norm(p - 0.5, axis=-1) - 0.4),
    ],
    ids=lambda own: type(own).__name__,
)
def test_cut_surfaces(surface, function):
    """Hits lie on the surface and in the cube, and are the first ones that do, by steps along the ray."""
    from elvis.reference.surfaces import levels

    function = function or (lambda p: levels(surface, p.reshape(-1, 3)).reshape(p.shape[:-1]))
    frame = render(solid(Shape.PRISM), Scene("u", camera=NEAR, size=SIZE, objects=(CutSurface(surface),)))
    assert frame.seen.sum() > 200
    assert np.abs(function(frame.position)[frame.seen]).max() < 1e-12
    assert (
        np.abs(frame.field - ball(frame.position.reshape(-1, 3)).reshape(frame.field.shape))[frame.seen].max() < 1e-12
    )

    # a change of sign between neighbouring steps inside of the cube is a hit
    origins, directions = rays(frame)
    near, far = cube_depths(origins, directions)
    steps = np.linspace(1e-6, 1 - 1e-6, 400)[:, None, None]
    depth = near + steps * (far - near)
    sign = np.sign(function(origins + depth[..., None] * directions))
    change = (sign[1:] * sign[:-1] < 0).argmax(axis=0)
    crossed = (sign[1:] * sign[:-1] < 0).any(axis=0)
    expected = np.take_along_axis(depth, change[None], axis=0)[0]
    assert (crossed & ~frame.seen).sum() == 0
    assert ((frame.depth - expected)[crossed] < (far - near)[crossed] / 300).all()
    assert (frame.seen & ~crossed).sum() < 0.03 * frame.seen.sum()


def test_clips_remove_the_inside():
    clip = Clip(Plane((0.5, 0.5, 0.5), (1.0, 0.0, 0.0)), "outside")
    scene = Scene("u", camera=PARALLEL, size=SIZE, objects=(Faces(),), clip=(clip,))
    frame = render(solid(Shape.HEXAHEDRON), scene)
    assert frame.position[frame.seen][:, 0].max() <= 0.5 + 1e-12
    whole = render(solid(Shape.HEXAHEDRON), replace(scene, clip=()))
    kept = whole.seen & (whole.position[..., 0] < 0.5)
    assert np.array_equal(frame.depth[kept], whole.depth[kept])


def test_quantities_are_evaluated_where_rays_hit():
    """An expression of derivatives: the gradient of |x - c|^2 has the length 2 |x - c|."""
    name = "sqrt(d(u,x)^2+d(u,y)^2+d(u,z)^2)"
    scene = Scene(name, camera=NEAR, size=SIZE, objects=(CutSurface(Sphere((0.5, 0.5, 0.5), 0.45)),))
    frame = render(solid(Shape.PYRAMID), scene)
    assert np.abs(frame.field[frame.seen] - 0.9).max() < 1e-10
    faces = render(solid(Shape.PYRAMID), replace(scene, objects=(Faces(),)))
    expected = 2 * np.linalg.norm(faces.position - 0.5, axis=2)
    assert np.abs(faces.field - expected)[faces.seen].max() < 1e-10
    level = render(solid(Shape.PYRAMID), replace(scene, objects=(Isosurface((0.7,)),)))
    assert np.abs(2 * np.linalg.norm(level.position - 0.5, axis=2)[level.seen] - 0.7).max() < 1e-9


def test_lines_are_drawn_at_the_right_places():
    style = Style(color=(1.0, 1.0, 1.0), lit=False, contours=Contours((0.3,), color=(1.0, 0.0, 0.0)))
    scene = Scene("u", camera=PARALLEL, size=SIZE, objects=(Faces(style=style),))
    frame = render(solid(Shape.TETRAHEDRON), scene)
    red = frame.seen & (frame.color[..., 1] < 0.5)
    assert red.sum() > 20
    assert np.abs(frame.field[red] - 0.3).max() < 0.05
    lined = replace(style, contours=None, mesh_lines=MeshLines(color=(0.0, 0.0, 0.0)))
    frame = render(solid(Shape.TETRAHEDRON), replace(scene, objects=(Faces(style=lined),)))
    black = frame.seen & (frame.color[..., 0] < 0.5)
    assert 50 < black.sum() < 0.5 * frame.seen.sum()


def test_flat_data_are_also_drawn_with_lines():
    flat = Dataset(mesh := grid(Shape.TRIANGLE, 3), (approximated(Dataset(mesh), "u", lambda x: x[:, 0], modes=2),))
    ground = CutSurface(Plane((0, 0, 0), (0, 0, 1)), Style(contours=Contours(count=3)))
    frame = render(flat, Scene("u", size=SIZE, objects=(ground,)))
    assert np.abs(frame.field - frame.position[..., 0])[frame.seen].max() < 1e-13


def test_lines_have_no_reference():
    """1D data: neither the device reference nor a comparison has anything exact to say of them."""
    points, ends = np.arange(3.0)[:, None] * np.eye(3)[:1], np.array([[0, 1], [1, 2]])
    line = with_field(connected(points, {Shape.SEGMENT: ends}, 1), lambda x: x[:, 0])
    with pytest.raises(ElvisError, match="omit --device reference"):
        render(line, Scene("u", size=SIZE))
    with pytest.raises(ElvisError, match="there are no linear pictures to compare with"):
        compare_scene(line, Scene("u", size=SIZE))


def test_unsupported_scenes_are_reported():
    flat = Dataset(mesh := grid(Shape.TRIANGLE, 2), (approximated(Dataset(mesh), "u", lambda x: x[:, 0], modes=2),))
    scene = Scene("u", size=SIZE, camera=NEAR)
    with pytest.raises(ElvisError, match="isosurfaces of volumes only, found elements of two dimensions"):
        render(flat, replace(scene, objects=(Isosurface((0.5,)),)))
    with pytest.raises(ElvisError, match="expected all, inner or a composite of the mesh"):
        render(solid(Shape.HEXAHEDRON), replace(scene, objects=(Faces(("nowhere",)),)))
    with pytest.raises(ElvisError, match="nothing of any object is visible"):
        render(solid(Shape.HEXAHEDRON), replace(scene, objects=(Isosurface((7.0,)),)))
    with pytest.raises(ElvisError, match="there is no 'w'"):
        render(solid(Shape.HEXAHEDRON), replace(scene, objects=(Faces(style=Style(quantity="w")),)))


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", SOLIDS, ids=name_of)
def test_absorption_of_uniform_volumes_depends_on_path_length(shape):
    """A constant density s over a chord L hides 1 - exp(-s L)."""
    volume = VolumeRendering(Transfer((-1.0, 2.0), (1.7, 1.7), ((0.2, 0.4, 0.6), (0.2, 0.4, 0.6))))
    frame = render(solid(shape, bend=0.05), Scene("u", camera=NEAR, size=(24, 20), objects=(volume,)))
    origins, directions = rays(frame)
    near, far = cube_depths(origins, directions)
    length = np.nan_to_num((far - near) * np.linalg.norm(directions, axis=-1))
    hidden = (1 - np.exp(-1.7 * length))[..., None]
    assert np.abs(frame.color - (1 - hidden * (1 - np.array([0.2, 0.4, 0.6])))).max() < 1e-9
    assert np.array_equal(frame.status > 0, length > 0)
    assert not frame.seen.any()


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", SOLIDS, ids=name_of)
def test_rays_may_begin_within_elements(shape):
    """The eye is in the cube: volume hides by the length from there on, and the surface behind it is not seen."""
    volume = VolumeRendering(Transfer((-1.0, 2.0), (1.7, 1.7), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))))
    for camera in (
        Camera((0.4, 0.3, 0.45), (0.9, 0.8, 0.6), fov=70.0),
        Camera((0.3, 0.45, 0.4), (0.9, 0.8, 0.6), height=0.2),
    ):
        scene = Scene("u", camera=camera, size=(12, 10), objects=(volume,))
        data = solid(shape, function=lambda x: x[:, 0])
        frame = render(data, scene)
        origins, directions = rays(frame)
        assert (np.abs(origins - 0.5).max(axis=2) < 0.5).any()
        near, far = cube_depths(origins, directions)
        length = np.nan_to_num((far - np.maximum(near, 0)) * np.linalg.norm(directions, axis=-1)) * (far > 0)
        assert np.abs(frame.color[..., 0] - np.exp(-1.7 * length)).max() < 1e-9
        level = render(data, replace(scene, objects=(Isosurface((0.35, 0.5)),)))
        assert level.seen.sum() > 25
        assert np.abs(level.position[..., 0] - np.where(origins[..., 0] < 0.35, 0.35, 0.5))[level.seen].max() < 1e-12


@pytest.mark.parametrize("shape", SOLIDS, ids=name_of)
def test_volume_of_a_linear_field(shape):
    """Density x and colour black: what is hidden follows from the middle of each chord."""
    volume = VolumeRendering(Transfer((-1.0, 2.0), (0.0, 6.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))))
    data = solid(shape, function=lambda x: x[:, 0])
    frame = render(data, Scene("u", camera=PARALLEL, size=(24, 20), objects=(volume,)))
    origins, directions = rays(frame)
    near, far = cube_depths(origins, directions)
    middle = (origins + (0.5 * (near + far))[..., None] * directions)[..., 0]
    depth = np.nan_to_num(2 * (1 + middle) * (far - near) * np.linalg.norm(directions, axis=-1))
    assert np.abs(frame.color[..., 0] - np.exp(-depth)).max() < 1e-9


def test_surfaces_end_the_volume_before_them():
    """An opaque plane within even volume: only what lies before it absorbs; a half transparent one lets half in."""
    volume = VolumeRendering(Transfer((-1.0, 2.0), (1.5, 1.5), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))))
    data = solid(Shape.HEXAHEDRON)
    plane = Plane((0.5, 0.5, 0.6), (0.1, 0.3, 1.0))
    for opacity in (1.0, 0.5):
        cut = CutSurface(plane, Style(color=(1.0, 1.0, 1.0), opacity=opacity))
        scene = Scene("u", camera=NEAR, size=SIZE, objects=(volume, cut), background=(1.0, 0.0, 0.0))
        frame = render(data, scene)
        origins, directions = rays(frame)
        near, far = cube_depths(origins, directions)
        speed = 1.5 * np.linalg.norm(directions, axis=-1)
        seen = frame.seen
        before = np.exp(-speed * (frame.depth - near))[seen]
        behind = np.exp(-speed * (far - frame.depth))[seen]
        assert seen.sum() > 200
        assert np.abs(frame.color[seen][:, 1] - before * opacity).max() < 1e-8
        assert np.abs(frame.color[seen][:, 0] - before * (opacity + (1 - opacity) * behind)).max() < 1e-8


def test_volumes_converge_at_kinks_of_transfer_functions():
    """A tent over a quadratic field, against sums over many small steps."""
    tent = Transfer((0.05, 0.15, 0.25), (0.0, 9.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    scene = Scene("u", camera=PARALLEL, size=(24, 20), objects=(VolumeRendering(tent),), background=(0.0, 0.0, 0.0))
    frame = render(solid(Shape.TETRAHEDRON), scene)
    origins, directions = rays(frame)
    near, far = cube_depths(origins, directions)
    steps = (np.arange(20000) + 0.5) / 20000
    rows, columns = np.nonzero(np.isfinite(near))
    for row, column in list(zip(rows, columns, strict=True))[::17]:
        start, end = near[row, column], far[row, column]
        points = origins[row, column] + (start + steps * (end - start))[:, None] * directions[row, column]
        values, step = ball(points), (end - start) / 20000
        density = np.interp(values, tent.values, tent.densities) * step
        through = np.exp(-np.concatenate([[0], np.cumsum(density)[:-1]]))
        color = np.column_stack([np.interp(values, tent.values, np.array(tent.colors)[:, i]) for i in range(3)])
        expected = ((through * -np.expm1(-density))[:, None] * color).sum(axis=0)
        assert np.abs(frame.color[row, column] - expected).max() < 2e-4
