"""Distances on a device: values and gradients against NumPy, surfaces at a distance, what plugins have of them."""

import numpy as np
import pytest
import trimesh

from elvis.core.distances import nearest, surface_of
from elvis.core.errors import ElvisError
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple, scattered
from elvis.formats import Dataset
from elvis.plugins.serving import volume_of
from elvis.renderer import Camera, Isosurface, Scene, Status, render

#: of the greatest magnitude
VALUE, UNIT = 1e-12, 1e-9


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A closed body with spikes."""
    ball = trimesh.creation.icosphere(1, radius=0.6)
    ball.vertices *= 1 + 0.8 * (np.arange(len(ball.vertices)) % 4 == 0)[:, None]
    path = tmp_path_factory.mktemp("bodies") / "spikes.ply"
    ball.apply_translation((1, 0.5, 0.5)).export(path)
    return str(path)


def with_field(mesh):
    """A dataset with the field u = x."""
    return Dataset(mesh, (approximated(Dataset(mesh), "u", lambda p: p[:, 0], 3),))


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.TRIANGLE])
def test_distances_and_their_gradients_are_those_of_numpy(renderer, file, shape):
    text = "distance(all)" if shape is Shape.TRIANGLE else f"distance('{file}')"
    dataset, drawing = with_field(curved(grid(shape, 2), ripple(0.05), n=4)), renderer("vulkan")
    (part,) = volume_of(dataset, [text]).parts
    drawing.show(volume_of(dataset, [text]))
    reference, elements = np.zeros((80, 3)), np.resize(np.arange(len(part)), 80)
    reference[:, : shape.dimension] = 0.95 * scattered(shape, 80, seed=1) + 0.05 * shape.vertices.mean(axis=0)
    centre = drawing.sample_elements(0, elements[:1], reference[:1]).center
    found = drawing.sample_elements(0, elements, reference - centre, text)
    expression = Expression.of(dataset, text)
    truth = Evaluator(dataset, [expression]).at(expression, part.element_ids[elements], reference)
    assert np.abs(found.value - truth).max() < VALUE * np.abs(truth).max()
    gradient = np.linalg.solve(found.jacobian.transpose(0, 2, 1), found.gradient[:, :, None])[:, :, 0]
    assert np.abs(np.linalg.norm(gradient, axis=1) - 1).max() < UNIT
    place = nearest(surface_of(dataset, text[9:-1].strip("'")), found.position).place
    assert np.abs(found.position - found.value[:, None] * gradient - place).max() < UNIT


def test_the_surface_at_a_distance_of_a_plane_is_parallel_to_it(tmp_path, renderer):
    corners = np.array([[-9, -9, 0.1], [9, -9, 0.1], [9, 9, 0.4], [-9, 9, 0.4]], np.float64)
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]).export(tmp_path / "plane.obj")
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    normal /= np.linalg.norm(normal)
    scene = Scene(
        field=f"distance('{tmp_path / 'plane.obj'}')",
        objects=(Isosurface((0.2,)),),
        camera=Camera((0.5, 0.5, 4.0), (0.5, 0.5, 0.5), up=(0, 1, 0), height=0.8),
        size=(24, 20),
    )
    frame = render(with_field(grid(Shape.TETRAHEDRON, 1)), scene)
    hit = np.isfinite(frame.depth)
    assert hit.all()
    height = (frame.position[hit] - corners[0]) @ normal
    assert np.abs(height - 0.2).max() < 1e-10
    assert np.abs(np.abs(frame.normal[hit] @ normal) - 1).max() < 1e-9
    assert (frame.status[hit] == Status.CERTAIN).mean() > 0.9


def test_bounds_of_elements_leave_out_those_that_are_too_far():
    dataset = with_field(grid(Shape.TETRAHEDRON, 4))
    (part,) = volume_of(dataset, ["distance(boundary)"]).parts
    low, high = part.quantities["distance(boundary)"].bounds()
    value = Evaluator(dataset, [Expression.of(dataset, "distance(boundary)")])
    expression = value.expressions[0]
    for spot in scattered(Shape.TETRAHEDRON, 20, seed=2):
        own = value.at(expression, part.element_ids, np.tile(spot, (len(part), 1)))
        assert (low <= own).all()
        assert (own <= high).all()
    assert ((low > -0.1) | (high < -0.1)).sum() > 0.1 * len(part)


def test_an_unknown_boundary_is_refused_before_anything_is_drawn():
    with pytest.raises(ElvisError, match="there is no boundary 'wall'; there are all, boundary, 1"):
        volume_of(with_field(grid(Shape.HEXAHEDRON, 1)), ["distance(wall)"])
