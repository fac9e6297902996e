"""The linear baseline: cuts fill the shapes, meshes are tight, pictures converge at second order."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Dataset, Plane, Scene
from elvis.core.mapping.cutting import template
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.reference.baseline.linear_drawing import Baseline, affordable
from elvis.reference.baseline.mesh import concatenate, estimate
from elvis.reference.baseline.sections import section
from elvis.reference.baseline.templates import pulling, simplices_of
from elvis.reference.baseline.tracing import Tracer
from elvis.reference.picture import render
from elvis.reference.quantities import Quantities, names_of
from elvis.reference.record import Record
from elvis.scene import Clip, CutSurface, Faces, Implicit, Isosurface, Sphere, Transfer, VolumeRendering
from elvis.scene.cameras.view import View

SOLIDS = Shape.of_dimension(3)
SHAPES = [*Shape.of_dimension(2), *SOLIDS]
AREAS = {"TRIANGLE": 2, "QUADRILATERAL": 4, "TETRAHEDRON": 4 / 3, "PYRAMID": 8 / 3, "PRISM": 4, "HEXAHEDRON": 8}
VIEW = View.through(Camera((3.0, -2.0, 2.5), (0.5, 0.5, 0.5), fov=30.0), (80, 60))


def name_of(shape):
    return shape.label


def smooth(x):
    return np.sin(2 * x[:, 0] + 0.3) * np.cos(1.5 * x[:, 1]) + x[:, 2] ** 2


def solid(mesh, modes=7):
    """A mesh with the field u, smooth within every element."""
    return Dataset(mesh, (approximated(Dataset(mesh), "u", smooth, modes=modes),))


def baseline(dataset, level):
    return Baseline.of(Quantities(dataset, ["u"]), level)


def volumes(points, simplices):
    edges = points[simplices[:, 1:]] - points[simplices[:, :1]]
    return np.abs(np.linalg.det(edges[..., : simplices.shape[1] - 1])) / (2 if simplices.shape[1] == 3 else 6)


@pytest.mark.parametrize("level", range(4))
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_cells_fill_the_shape(shape, level):
    cut = template(shape, level)
    rng = np.random.default_rng(level)
    simplices = np.concatenate([pulling(kind, own, rng.random(own.shape)) for kind, own in cut.cells.items()])
    found = volumes(cut.points, simplices)
    assert len(simplices) == simplices_of(cut) == simplices_of(template(shape, 0)) * 2 ** (shape.dimension * level)
    assert found.min() > 0
    assert found.sum() == pytest.approx(AREAS[shape.name], rel=1e-13)
    assert set(map(tuple, shape.vertices)) <= set(map(tuple, cut.points))


@pytest.mark.parametrize("level", [0, 1, 2])
def test_elements_of_all_shapes_meet_without_gaps(level):
    """Every inner triangle has two tetrahedra, whatever the turns of the elements; those of the border have one."""
    whole = baseline(solid(curved(mixed_volume(seed=level), ripple(0.05), 4)), level).whole
    corners = np.unique(np.round(whole.points, 9), axis=0, return_inverse=True)[1].reshape(-1)[whole.simplices]
    triangles = np.concatenate([np.delete(corners, i, axis=1) for i in range(4)])
    count = np.unique(np.sort(triangles, axis=1), axis=0, return_counts=True)[1]
    assert set(count) == {1, 2}

    # the border is closed: each of its edges has two triangles
    rows = np.unique(np.sort(triangles, axis=1), axis=0)[count == 1]
    edges = np.concatenate([np.delete(rows, i, axis=1) for i in range(3)])
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}


@pytest.mark.parametrize("level", [0, 1, 2, 3])
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_the_estimate_counts_the_generated_elements(shape, level):
    dataset = solid(curved(grid(shape, 2), ripple(0.05), 3), modes=3)
    made = baseline(dataset, level)
    simplices, points, size = estimate(made.patches, level)
    assert made.counts["simplices"] == simplices
    assert made.counts["points"] == points
    assert size / 6 < made.counts["bytes"] <= size
    assert affordable(made.patches, level, 1, size) == (True, size)
    assert affordable(made.patches, level, 1, size - 1) == (False, size)


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_linear_fields_on_straight_elements_are_exact(shape):
    mesh = grid(shape, 2)
    dataset = Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: x @ [1.0, 2.0, -3.0], modes=3),))
    plane = Plane((0.5, 0.5, 0.47), (0.1, 0.2, 1.0)) if shape.dimension == 3 else Plane((0, 0, 0), (0, 0, 1))
    exact = render(dataset, Scene("u", plane, size=(60, 50)))
    drawn = baseline(dataset, 0).draw(exact.scene, exact.view, exact.range)
    both = exact.seen & drawn.seen
    assert both.sum() > 1000
    assert (exact.seen != drawn.seen).sum() <= 0.01 * both.sum()
    assert np.abs(drawn.field - exact.field)[both].max() < 1e-12
    assert np.abs(drawn.position - exact.position)[both].max() < 1e-12
    assert np.array_equal(drawn.element[both & (exact.status == 1)], exact.element[both & (exact.status == 1)])


@pytest.mark.thorough
@pytest.mark.sampled(least=3, free=("shape",))
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_pictures_converge_at_second_order(shape):
    dataset = solid(curved(grid(shape, 2), ripple(0.04, seed=5), 4))
    plane = Plane((0.5, 0.5, 0.47), (0.1, 0.2, 1.0)) if shape.dimension == 3 else Plane((0, 0, 0), (0, 0, 1))
    exact = Record.of(frame := render(dataset, Scene("u", plane, size=(70, 60))))
    errors = []
    for level in range(4):
        drawn = baseline(dataset, level).draw(frame.scene, frame.view, frame.range)
        errors.append(np.mean(np.abs(drawn.field - exact.field)[exact.seen & drawn.seen]))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[1:].min() > 1.7
    assert rates.mean() < 2.5


def test_isosurfaces_and_boundaries_converge_to_the_ball():
    """The field |x|^2 has spheres for isosurfaces; a sphere that cuts is approached likewise."""
    mesh = curved(grid(Shape.TETRAHEDRON, 2), ripple(0.03, seed=2), 3)
    dataset = Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: ((x - 0.5) ** 2).sum(axis=1), modes=7),))
    errors = []
    for level in range(4):
        made, radius = baseline(dataset, level), 0.35
        surfaces = [Isosurface((radius**2,)), CutSurface(Sphere((0.5, 0.5, 0.5), radius))]
        meshes = [made.triangles(surface, "u") for surface in surfaces]
        gaps = [np.abs(np.linalg.norm(own.points - 0.5, axis=1) - radius).mean() for own in meshes]
        area = np.linalg.norm(np.cross(*edges_of(meshes[0])), axis=1).sum() / 2
        errors.append([*gaps, abs(area - 4 * np.pi * radius**2)])
    rates = np.log2(np.array(errors)[1:-1] / np.array(errors)[2:])
    assert rates[-1].min() > 1.9


def edges_of(mesh):
    a, b, c = (mesh.points[mesh.simplices[:, i]] for i in range(3))
    return b - a, c - a


@pytest.mark.parametrize("shape", SOLIDS, ids=name_of)
def test_outer_faces_enclose_the_volume(shape):
    made = baseline(solid(grid(shape, 2)), 1)
    outer = made.triangles(Faces(), "u")
    a, b = edges_of(outer)
    assert np.linalg.norm(np.cross(a, b), axis=1).sum() / 2 == pytest.approx(6, rel=1e-13)
    assert (np.isin(outer.points[outer.simplices], [0, 1]).all(axis=1).any(axis=1)).all()
    one = made.triangles(Faces((f"element:{made.patches[0].element_ids[3]}",)), "u")
    assert set(one.element) == {made.patches[0].element_ids[3]}


def test_surfaces_are_visible_one_behind_the_other():
    """Rays through the unit cube meet it twice; entry and exit lie on it, depths ascend."""
    tracer = Tracer(baseline(solid(grid(Shape.HEXAHEDRON, 1)), 1).triangles(Faces(), "u"))
    first = tracer.first(VIEW)
    second = tracer.first(VIEW, first.depth)
    third = tracer.first(VIEW, second.depth)
    assert first.seen.sum() > 500
    assert (first.seen ^ second.seen).sum() < 0.02 * first.seen.sum()
    assert not third.seen.any()
    both = first.seen & second.seen
    assert (second.depth > first.depth)[both].all()
    for hits in (first, second):
        distance = np.abs(hits.position[both] - 0.5).max(axis=1) - 0.5
        assert np.abs(distance).max() < 1e-14
        assert np.abs(np.linalg.norm(hits.normal[both], axis=1) - 1).max() < 1e-14
    assert (np.einsum("ni,ni->n", first.normal, np.array(VIEW.camera.basis()[2])[None])[both] < 0.3).all()


def test_a_plane_on_faces_shows_the_elements_of_both_sides():
    """A plane at the border of the domain, or between elements, is not lost."""
    made = baseline(solid(grid(Shape.HEXAHEDRON, 2), modes=3), 1)
    for height in (0.0, 0.5, 1.0):
        cut = concatenate([section(part, part.points[:, 2] - height) for part in made.parts])
        a, b = edges_of(cut)
        area = np.linalg.norm(np.cross(a, b), axis=1).sum() / 2
        assert area == pytest.approx(2 if height == 0.5 else 1, rel=1e-13)


@pytest.mark.parametrize("shown", [CutSurface(Plane((0.5, 0.5, 0.47), (0.1, 0.2, 1.0))), Faces(), Isosurface((0.6,))])
def test_linear_data_look_the_same_through_vtk(shown):
    """Straight elements of order one: VTK's cells are the simplices themselves, and everything is exact."""
    pytest.importorskip("vtkmodules")
    from elvis.reference.baseline.vtk import VtkBaseline

    mesh = grid(Shape.TETRAHEDRON, 2)
    data = Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: x[:, 0] + 0.5 * x[:, 2], modes=2),))
    scene = Scene("u", camera=VIEW.camera, size=(80, 60), objects=(shown,))
    pictures = [made.draw(scene, VIEW, (0.0, 1.5)) for made in (baseline(data, 0), VtkBaseline(data, ["u"]))]
    first, second = pictures
    both = first.seen & second.seen
    assert both.sum() > 300
    assert (first.seen ^ second.seen).sum() <= 4
    assert np.abs(first.field - second.field)[both].max() < 1e-6
    assert np.abs(first.position - second.position)[both].max() < 1e-6
    assert np.array_equal(first.element[both], second.element[both]) or isinstance(shown, CutSurface)


def test_vtk_draws_fields_whose_names_have_control_characters():
    """No file of VTK contains such names."""
    pytest.importorskip("vtkmodules")
    from elvis.reference.baseline.vtk import VtkBaseline

    mesh = grid(Shape.HEXAHEDRON, 1)
    names = ["u\x9b", "u\x7f"]
    data = Dataset(mesh, tuple(approximated(Dataset(mesh), name, lambda x: x[:, 0], 2) for name in names))
    for shown in (Faces(), Isosurface((0.6,))):
        drawn = VtkBaseline(data, names).triangles(shown, "u\x7f")
        assert np.allclose(drawn.values["u\x7f"], drawn.points[:, 0])


def test_vtk_draws_the_order_of_the_data():
    """Of quadratic data on straight elements VTK's picture is better than linear elements', and not exact."""
    pytest.importorskip("vtkmodules")
    from elvis.reference.baseline.vtk import VtkBaseline

    mesh = grid(Shape.HEXAHEDRON, 2)
    data = Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: x[:, 0] ** 2, modes=3),))
    exact = render(data, Scene("u", Plane((0.5, 0.5, 0.4), (0.1, 0.0, 1.0)), size=(60, 50)))
    errors = []
    for made in (baseline(data, 0), VtkBaseline(data, ["u"])):
        drawn = made.draw(exact.scene, exact.view, exact.range)
        errors.append(np.abs(drawn.field - exact.field)[exact.seen & drawn.seen].max())
    assert errors[0] == pytest.approx(0.25**2, rel=0.05)
    assert 1e-3 < errors[1] < 0.3 * errors[0]


def test_clips_remove_the_inside():
    """Of the cube without its front half one sees the inner sides of its back; the plane of the clip stays."""
    from elvis.scene import Clip

    made = baseline(solid(grid(Shape.HEXAHEDRON, 2)), 1)
    clip = Clip(Plane((0.5, 0.5, 0.5), (0.0, -1.0, 0.0)), "outside")
    scene = Scene("u", camera=VIEW.camera, size=(80, 60), objects=(Faces(),), clip=(clip,))
    drawn = made.draw(scene, VIEW, (0.0, 1.0))
    whole = made.draw(Scene("u", camera=VIEW.camera, size=(80, 60), objects=(Faces(),)), VIEW, (0.0, 1.0))
    assert drawn.position[drawn.seen][:, 1].min() >= 0.5 - 1e-12
    kept = whole.seen & (whole.position[..., 1] > 0.5)
    assert np.array_equal(drawn.depth[kept], whole.depth[kept])
    assert (drawn.seen & ~kept).sum() > 0
    distance = np.abs(drawn.position[drawn.seen] - 0.5).max(axis=1)
    assert np.abs(distance - 0.5).max() < 1e-12


def test_volumes_are_clipped_and_mixed():
    """Linear fields on straight elements: two volumes in one another, cut by a plane, a sphere and an expression."""
    mesh = grid(Shape.TETRAHEDRON, 2)
    ways = {"u": (1.0, 0.5, 0.2), "v": (-0.3, 0.4, 1.0)}
    data = Dataset(
        mesh, tuple(approximated(Dataset(mesh), name, lambda x, w=w: x @ np.array(w), 2) for name, w in ways.items())
    )
    volumes = tuple(
        VolumeRendering(Transfer((-0.5, 0.4, 1.8), (0.0, most, 1.0), (color, color, (0.1, 0.2, 0.3))), quantity=name)
        for name, most, color in (("u", 3.0, (1.0, 0.0, 0.0)), ("v", 1.5, (0.0, 0.0, 1.0)))
    )
    clips = (
        Clip(Plane((0.5, 0.5, 0.7), (0.2, 0.1, 1.0)), "outside"),
        Clip(Sphere((0.6, 0.4, 0.4), 0.25), "inside"),
        Clip(Implicit("u-1.1"), "outside"),
    )
    scene = Scene("u", camera=VIEW.camera, size=(40, 30), objects=volumes, clip=clips, range=(0.0, 1.7))
    exact = render(data, scene)
    made = Baseline.of(Quantities(data, names_of(scene)), 0).draw(scene, exact.view, (0.0, 1.7))
    assert (exact.color.min(axis=2) < 0.8).mean() > 0.1
    assert np.abs(made.color - exact.color).max() < 1e-3
    for gone in range(3):
        other = render(data, replace(scene, clip=clips[:gone] + clips[gone + 1 :]))
        assert np.abs(other.color - exact.color).max() > 0.02


def test_volumes_are_exact_for_linear_fields_and_converge_for_others():
    """Light along rays through straight elements: of a linear field as the reference has it, else of second order."""
    from elvis.scene import Transfer, VolumeRendering

    volume = VolumeRendering(Transfer((-1.0, 3.0), (0.0, 5.0), ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))))
    scene = Scene("u", camera=VIEW.camera, size=(24, 18), objects=(volume,), range=(0.0, 1.0))
    view = View.through(VIEW.camera, (24, 18))
    for function, levels, tolerance in ((lambda x: x[:, 0] + x[:, 2], (0,), 1e-4), (smooth, (0, 1, 2), None)):
        mesh = grid(Shape.PRISM, 2)
        data = Dataset(mesh, (approximated(Dataset(mesh), "u", function, modes=6),))
        exact = Record.of(render(data, scene))
        drawn = [baseline(data, level).draw(scene, view, (0.0, 1.0)) for level in levels]
        errors = [np.abs(own.color - exact.color).mean() for own in drawn]
        assert (exact.color < 0.99).any()
        if tolerance is None:
            assert np.log2(errors[1] / errors[2]) > 1.7
        else:
            assert np.abs(drawn[0].color - exact.color).max() < tolerance
