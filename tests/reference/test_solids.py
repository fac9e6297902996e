"""Quasi-3D data, surfaces in space, triangles from files: reference and linear meshes against analytic expressions."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from elvis import Camera, Dataset, Plane, Scene
from elvis.core.data.dataset import Homogeneous
from elvis.core.mapping.cutting import drawn_out, template
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.reference.baseline.linear_drawing import Baseline
from elvis.reference.baseline.templates import pulling, simplices_of
from elvis.reference.picture import render
from elvis.reference.quantities import Quantities, names_of
from elvis.reference.record import Record
from elvis.reference.scenes.ray_integrals import RayIntegral
from elvis.reference.solids import bounds, faces, heights
from elvis.reference.study import compare_scene
from elvis.scene import Clip, CutSurface, Faces, Isosurface, Style, Transfer, TriangleMesh, VolumeRendering

PLANE_SHAPES = Shape.of_dimension(2)
LENGTH = 0.8
CAMERA = Camera((2.6, -1.9, 2.1), (0.5, 0.5, 0.4), fov=30.0)
SIZE = (60, 50)


def name_of(shape):
    return shape.label


def flat(x):
    return x[:, 0] ** 2 + 0.3 * x[:, 1]


def wave(x):
    """The closed form of `channel`: (1 + cos k z / 2 + sin k z / 4) of a polynomial."""
    angle = 2 * np.pi * x[..., 2] / LENGTH
    return (x[..., 0] ** 2 + 0.3 * x[..., 1]) * (1 + 0.5 * np.cos(angle) + 0.25 * np.sin(angle))


def channel(shape=Shape.QUADRILATERAL, bend=0.0, cells=2):
    """The unit square along one period; planes are those of 1, of nothing, of cos and of -sin."""
    mesh = curved(grid(shape, cells), ripple(bend, seed=1), 3) if bend else grid(shape, cells)
    field = approximated(Dataset(mesh), "u", flat, modes=3 if not bend else 8)
    waves = Homogeneous((Basis.FOURIER,), (LENGTH,), (0, 1, 2, 3))
    blocks = tuple(
        replace(
            block,
            expansion=replace(block.expansion, homogeneous=waves),
            coefficients=np.hstack([part * block.coefficients for part in (1.0, 0.0, 0.5, -0.25)]),
        )
        for block in field.blocks
    )
    return Dataset(mesh, (replace(field, blocks=blocks),))


@pytest.mark.parametrize("shape", PLANE_SHAPES, ids=name_of)
def test_extruded_cells_fill_the_solid(shape):
    cut = drawn_out(template(shape, 2), 3)
    rng = np.random.default_rng(0)
    simplices = np.concatenate([pulling(kind, own, rng.random(own.shape)) for kind, own in cut.cells.items()])
    edges = cut.points[simplices[:, 1:]] - cut.points[simplices[:, :1]]
    found = np.abs(np.linalg.det(edges)) / 6
    assert len(simplices) == simplices_of(cut)
    assert found.min() > 0
    assert found.sum() == pytest.approx(8 if shape is Shape.QUADRILATERAL else 4, rel=1e-13)


@pytest.mark.parametrize("extruded", [False, True])
@pytest.mark.parametrize("shape", [*PLANE_SHAPES, *Shape.of_dimension(3)], ids=name_of)
def test_faces_lie_at_their_stated_positions(shape, extruded):
    if extruded and shape.dimension == 3:
        return
    every = faces(shape, extruded)
    assert len(every) == (len(shape.faces) if shape.dimension == 3 else len(shape.edges) + 2 if extruded else 1)
    for face in every:
        corners = face.frame[0] + face.kind.vertices @ face.frame[1:]
        assert np.abs(heights(face.height[None], corners)).max() < 1e-15
        assert heights(face.others, corners).min() > -1e-15
        assert heights(face.others, corners.mean(axis=0)[None]).min() > 0.1
    assert heights(bounds(shape, extruded), np.full((1, 3), -0.5)).min() > 0


@pytest.mark.parametrize("shape", PLANE_SHAPES, ids=name_of)
def test_quasi_3d_data_have_faces_isosurfaces_and_cuts(shape):
    """The box 1 x 1 x LENGTH: its outside, a value inside, and a plane through it, against the closed form."""
    data = channel(shape)
    scene = Scene("u", camera=CAMERA, size=SIZE, objects=(Faces(),))
    frame = render(data, scene)
    seen = frame.seen
    away = np.abs(frame.position - np.array([0.5, 0.5, LENGTH / 2])) / np.array([1.0, 1.0, LENGTH])
    assert seen.sum() > 700
    assert np.abs(away.max(axis=2)[seen] - 0.5).max() < 1e-12
    assert np.abs(frame.field - wave(frame.position))[seen].max() < 1e-12
    level = render(data, replace(scene, objects=(Isosurface((0.5,)),)))
    assert level.seen.sum() > 300
    assert np.abs(wave(level.position) - 0.5)[level.seen].max() < 1e-11
    cut = render(data, replace(scene, objects=(CutSurface(Plane((0.5, 0.5, 0.4), (1.0, 2.0, 3.0)), Style(lit=True)),)))
    assert np.abs(cut.field - wave(cut.position))[cut.seen].max() < 1e-12


def test_walls_and_lids_are_chosen_by_name():
    data = channel(Shape.TRIANGLE)
    scene = Scene("u", camera=CAMERA, size=SIZE)
    every, inner, one = (
        render(data, replace(scene, objects=(Faces((word,)),))) for word in ("all", "inner", "element:3")
    )
    assert set(np.unique(one.element[one.seen])) == {3}
    x, y, z = inner.position[inner.seen].T
    assert (np.minimum(z, LENGTH - z) > -1e-12).all()
    assert (np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y)) > 1e-9).mean() > 0.9
    assert every.seen.sum() > inner.seen.sum() > 300
    solids = replace(scene, objects=(Faces(("shape:extruded triangle",)),))
    assert np.array_equal(render(data, solids).seen, every.seen)


def test_absorption_in_quasi_3d_data_depends_on_path_length():
    volume = VolumeRendering(Transfer((-1.0, 2.0), (1.7, 1.7), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))))
    frame = render(
        channel(), Scene("u", camera=replace(CAMERA, fov=None, height=1.8), size=(20, 16), objects=(volume,))
    )
    rows, columns = np.indices(frame.status.shape)
    origins, directions = frame.view.rays(columns.ravel().astype(float), rows.ravel().astype(float))
    with np.errstate(divide="ignore"):
        ends = (np.array([[0.0, 0.0, 0.0], [1.0, 1.0, LENGTH]])[:, None] - origins) / directions
    length = np.maximum(ends.max(axis=0).min(axis=1) - ends.min(axis=0).max(axis=1), 0.0)
    assert (length > 0.1).sum() > 100
    assert np.abs(frame.color[..., 0].ravel() - np.exp(-1.7 * length)).max() < 1e-9


def test_linear_meshes_of_quasi_3d_data_converge_at_second_order():
    data = channel(Shape.TRIANGLE, bend=0.03)
    scene = Scene("u", camera=CAMERA, size=SIZE, objects=(Faces(), CutSurface(Plane((0.5, 0.5, 0.4), (1.0, 2.0, 3.0)))))
    study = compare_scene(data, scene, (0, 1, 2), draw=lambda own, shown, device: render(own, shown), validation_size=0)
    errors = [rival.errors.value_mean for rival in study.rivals if rival.errors and rival.level is not None]
    assert len(errors) == 3
    assert np.log2(errors[0] / errors[1]) > 1.6
    assert np.log2(errors[1] / errors[2]) > 1.8


def test_surfaces_in_space_are_their_faces():
    """Elements of a plane that is curved into a paraboloid: hits lie on it, with the values there."""
    flat_mesh = grid(Shape.TRIANGLE, 3)
    raised = curved(flat_mesh, lambda x: np.column_stack([x[:, :2], 0.3 * x[:, 0] ** 2]), 3)
    mesh = replace(raised, space=3)
    data = Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: x[:, 0] - x[:, 2], modes=4),))
    frame = render(data, Scene("u", camera=CAMERA, size=SIZE, objects=(Faces(),)))
    x, _, z = frame.position[frame.seen].T
    assert frame.seen.sum() > 200
    assert np.abs(z - 0.3 * x**2).max() < 1e-12
    assert np.abs(frame.field[frame.seen] - (x - z)).max() < 1e-12


@pytest.fixture
def ball(tmp_path):
    """A sphere as an STL file, of radius 0.3 about the middle of the unit cube."""
    made = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
    made.apply_translation((0.5, 0.5, 0.5))
    made.export(tmp_path / "ball.stl")
    return TriangleMesh(str(tmp_path / "ball.stl"))


def cube(function=lambda x: x @ np.array([1.0, 2.0, -1.0]), modes=2):
    mesh = grid(Shape.PRISM, 2)
    return Dataset(mesh, (approximated(Dataset(mesh), "u", function, modes=modes),))


def test_triangles_from_a_file_cut_linear_meshes_at_their_position(ball):
    """A linear field on straight elements is exact after no refinement, place by place."""
    scene = Scene("u", camera=CAMERA, size=SIZE, objects=(CutSurface(ball),))
    exact = render(cube(), scene)
    completed = replace(exact.scene, camera=exact.view.camera)
    made = Baseline.of(Quantities(cube(), names_of(completed)), 0)
    drawn = made.draw(completed, exact.view, (0.0, 1.0))
    assert exact.seen.sum() > 150
    assert np.array_equal(drawn.seen, exact.seen)
    assert np.abs(drawn.position - exact.position)[exact.seen].max() < 1e-12
    assert np.abs(drawn.field - exact.field)[exact.seen].max() < 1e-12


@pytest.mark.parametrize("away", ["inside", "outside"])
def test_closed_triangulations_clip_their_inside(ball, away):
    scene = Scene("u", camera=CAMERA, size=SIZE, clip=(Clip(ball, away),))
    scene = replace(scene, objects=(CutSurface(Plane((0.5, 0.5, 0.5), (0.1, 0.2, 1.0))), Isosurface((1.0,))))
    frame = render(cube(), scene)
    far = np.linalg.norm(frame.position[frame.seen] - 0.5, axis=1)
    assert frame.seen.sum() > 100
    assert (far > 0.29).all() if away == "inside" else (far < 0.31).all()

    # linear meshes are clipped alike
    made = Baseline.of(Quantities(cube(), names_of(scene)), 0).draw(scene, frame.view, (0.0, 1.0))
    assert np.array_equal(made.seen, Record.of(frame).seen)


def test_a_comparison_with_triangles_succeeds(ball):
    def draw(data, scene, device):
        return render(data, scene)

    scene = Scene("u", camera=CAMERA, size=SIZE, objects=(CutSurface(ball), VolumeRendering(Transfer((0, 1), (0, 1)))))
    study = compare_scene(cube(), scene, (0, 1), draw=draw, validation_size=0, meshes=True)
    assert [rival.skipped for rival in study.rivals if rival.level is not None] == [None, None]
    assert set(study.rivals[0].meshes) == {"n0"}


def test_errors_of_light_include_the_remainder_of_bisection():
    """Densities with a kink inside the stretch, no rounding: alpha is 1 - exp(-(area under the densities))."""
    largest = 0.0
    for kink in (0.1, 0.3, 1 / 3, 0.5, 0.7):
        transfer = Transfer(values=(0.0, kink, 1.0), densities=(0.0, 3.0, 0.5), colors=((1.0, 1.0, 1.0),) * 3)
        along = RayIntegral(lambda which, shares: [shares], [transfer], np.ones(1), np.zeros((1, 1)))
        light = along.light()
        away = abs(light.alpha[0] + np.expm1(-(1.5 * kink + 1.75 * (1 - kink))))
        assert away <= light.error[0] < 1e-7
        largest = max(largest, away)
    assert largest > 1e-12
