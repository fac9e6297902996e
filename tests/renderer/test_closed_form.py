"""Pixels whose truth needs none of our code: straight elements curved by a map that has an inverse in closed form."""

import numpy as np
import pytest
from warps import bent_plane, bent_volume, cubic, straightened_plane, straightened_volume

from elvis import Camera, Plane, Status
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.orientation import local_vertices
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple, shuffled

BORDER = 1e-9
DEVICES = ("vulkan", "reference")
PLANE = Plane((1.4, 0.9, 0.6), (0.3, 0.5, 1.0))
VIEWS = {
    "straight on": {},
    "oblique": {"camera": Camera((4.0, -3.0, 3.0), (1.4, 0.9, 0.6), (0.0, 0.0, 1.0), height=3.0)},
    "perspective": {"camera": Camera((2.5, -1.5, 2.5), (1.4, 0.5, 0.6), (0.0, 0.0, 1.0), fov=70.0)},
}


def depths(mesh, points):
    """(elements, n) smallest distance of straight points from the sides of each straight element, and their ids."""
    rows, ids = [], []
    for shape, entities in mesh.elements.items():
        sides = shape.faces if shape.dimension == 3 else [(*edge,) for edge in shape.edges]
        for vertices in mesh.vertices[local_vertices(mesh, shape)]:
            rows.append(np.min([side_distance(vertices, side, points) for side in sides], axis=0))
        ids.append(entities.ids)
    return np.array(rows), np.concatenate(ids)


def side_distance(vertices, side, points):
    """Distance from the plane, or line in the plane, through a side, positive on the element's own side."""
    corner = vertices[side[0]]
    along = vertices[side[1]] - corner
    across = np.array([0.0, 0.0, 1.0]) if len(side) == 2 else vertices[side[2]] - corner
    normal = np.cross(along, across)
    normal /= np.linalg.norm(normal)
    sign = np.sign((vertices.mean(axis=0) - corner) @ normal)
    return sign * ((points - corner) @ normal)


def bend(mesh, warp, straightened):
    """A straight mesh curved, with the cubic field."""
    dataset = Dataset(curved(mesh, warp, 3))
    return Dataset(dataset.mesh, (approximated(dataset, "u", lambda points: cubic(straightened(points)), 4),))


def check(frame, mesh, straightened):
    """Coverage, elements and field against analytic expressions; the mesh is the straight one."""
    points = frame.view.points()
    there = np.isfinite(points).all(axis=-1)
    depth, ids = depths(mesh, straightened(points[there]))
    best = depth.max(axis=0)
    assert frame.seen[there][best > BORDER].all()
    assert not frame.seen[there][best < -BORDER].any()
    assert not frame.seen[~there].any()
    assert frame.seen.sum() > 300

    inner = best > BORDER
    assert np.array_equal(frame.element[there][inner], ids[depth.argmax(axis=0)][inner])
    assert (frame.status[there][inner] == Status.CERTAIN).all()
    expected = cubic(straightened(frame.position[frame.seen]))
    assert np.abs(frame.field[frame.seen] - expected).max() <= 1e-11 * np.ptp(expected)


@pytest.mark.sampled
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("view", VIEWS)
def test_curved_volumes(draw, device, view):
    mesh = shuffled(mixed_volume(seed=5), seed=2)
    assert set(mesh.elements) == set(Shape.of_dimension(3))
    dataset = bend(mesh, bent_volume, straightened_volume)
    frame = draw(dataset, device, plane=PLANE, size=(150, 120), **VIEWS[view])
    check(frame, mesh, straightened_volume)


@pytest.mark.sampled
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("view", ["straight on", "perspective"])
def test_curved_plane_elements(draw, device, view):
    mesh = shuffled(mixed_plane(seed=3), seed=1)
    assert set(mesh.elements) == set(Shape.of_dimension(2))
    dataset = bend(mesh, bent_plane, straightened_plane)
    check(draw(dataset, device, size=(150, 120), **VIEWS[view]), mesh, straightened_plane)


@pytest.mark.sampled(least=3, free=("shape",))
@pytest.mark.parametrize("shape", [*Shape.of_dimension(2), *Shape.of_dimension(3)], ids=lambda shape: shape.label)
def test_rippled_elements_of_fourth_degree(same_on, linear, shape):
    straight = grid(shape, 2)
    dataset = linear(curved(straight, ripple(0.12 if shape.dimension == 3 else 0.2, seed=4), 5))
    plane = Plane((0.5, 0.5, 0.5), (0.2, -0.4, 1.0)) if shape.dimension == 3 else None
    frame, _ = same_on(dataset, plane=plane, size=(67, 60))
    expected = frame.position[frame.seen] @ [1.0, 2.0, -3.0]
    assert np.abs(frame.field[frame.seen] - expected).max() <= 1e-11 * np.ptp(expected)
