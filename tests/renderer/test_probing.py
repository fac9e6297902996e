"""Points located on the device, and in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Renderer, SceneError, Status
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Field
from elvis.core.mapping.inverse import Status as InverseStatus
from elvis.core.mapping.locate import locate
from elvis.core.mapping.margins import margins
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import positions, values
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, mixed_volume, ripple

BORDER = 1e-9


def scattered_points(mesh, count, seed=0, length=0.0):
    """(count, 3) points in and around the mesh, some of its vertices and midpoints between them, on borders, first."""
    rng = np.random.default_rng(seed)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = rng.uniform(low - 0.02 * (high - low), high + 0.02 * (high - low), (count, 3))
    some = mesh.vertices[rng.integers(len(mesh.vertices), size=(count // 10, 2))]
    points[: 2 * len(some)] = np.concatenate([some[:, 0], some.mean(axis=1)])
    if mesh.dimension == 2:
        points[:, 2] = length * rng.uniform(0.01, 0.99, count)
    return points


def check(places, dataset, name, points, tolerance):
    """Places against the location in NumPy."""
    found = locate(patches(dataset, [name]), points)
    assert np.array_equal(found.point, np.arange(len(points)))
    inside = found.status == InverseStatus.INSIDE
    assert not (places.status == Status.FAILED).any()
    assert not (found.status == InverseStatus.FAILED).any()

    # the same elements away from borders; border points in some element that holds them
    sure = inside & (found.margin > BORDER)
    assert np.array_equal(places.element[sure], found.element_id[sure])
    assert (places.status[sure] == Status.CERTAIN).all()
    seen = places.element >= 0
    assert seen[inside & (found.margin > -1e-12)].all()
    assert not seen[~inside & (places.status != Status.AMBIGUOUS)].any()
    assert (places.element[~seen] == -1).all()
    assert np.isnan(places.field[~seen]).all()
    assert np.isnan(places.reference[~seen]).all()
    check_values(places, dataset, name, points, tolerance(dataset.field(name)))


def check_values(places, dataset, name, points, tolerance):
    """Every answer, whichever element gave it: its reference point maps to the point, its field is the field there."""
    for patch in patches(dataset, [name]):
        order = np.argsort(patch.element_ids)
        row = np.minimum(np.searchsorted(patch.element_ids[order], places.element), len(order) - 1)
        here = patch.element_ids[order][row] == places.element
        rows, reference = order[row[here]], places.reference[here][:, : patch.dimension]
        assert (margins(patch.shape, reference[:, : patch.shape.dimension]) > -BORDER).all()
        size = np.linalg.norm(np.ptp(points, axis=0))
        assert np.abs(positions(patch, rows, reference) - points[here]).max(initial=0) < 1e-13 * size
        wrong = np.abs(values(patch, 0, rows, reference) - places.field[here])
        assert wrong.max(initial=0) <= tolerance


@pytest.mark.sampled(least=10, free=("case",))
def test_shared_cases(case, shared, renderer, liveliest, tolerance):
    dataset = shared(case)
    name = liveliest(dataset)
    if dataset.mesh.dimension != dataset.mesh.space or dataset.mesh.dimension < 2:
        return
    device = renderer("vulkan")
    device.load(dataset, name)
    planes = dataset.fields[0].blocks[0].expansion.homogeneous
    points = scattered_points(dataset.mesh, 2000, length=planes.lengths[0] if planes else 0.0)
    check(device.probe(points), dataset, name, points, tolerance)


@pytest.mark.sampled(least=3, free=("shape",))
@pytest.mark.parametrize("shape", [*Shape.of_dimension(2), *Shape.of_dimension(3)], ids=lambda shape: shape.label)
def test_curved_elements(linear, renderer, tolerance, shape):
    dataset = linear(curved(grid(shape, 2), ripple(0.12, seed=4), 5))
    device = renderer("vulkan")
    device.load(dataset, "u")
    points = scattered_points(dataset.mesh, 2000, seed=2)
    places = device.probe(points)
    check(places, dataset, "u", points, tolerance)
    seen = places.element >= 0
    assert 500 < seen.sum() < 2000
    assert np.abs(places.field - points @ [1.0, 2.0, -3.0])[seen].max() < 1e-12


def test_the_same_without_a_graphics_driver(linear, renderer, tolerance):
    dataset = linear(curved(grid(Shape.TETRAHEDRON, 1), ripple(0.1, seed=4), 3))
    points = scattered_points(dataset.mesh, 200)
    device = renderer("cpu")
    device.load(dataset, "u")
    check(device.probe(points), dataset, "u", points, tolerance)


def test_any_number_of_points(linear, renderer):
    dataset = linear(mixed_volume(seed=1))
    device = renderer("vulkan")
    device.load(dataset, "u")
    points = scattered_points(dataset.mesh, 130)
    whole = device.probe(points)
    for count in (0, 1, 64, 65):
        part = device.probe(points[:count])
        assert len(part.element) == count
        assert np.array_equal(part.element, whole.element[:count])
        assert part.field.tobytes() == whole.field[:count].tobytes()


def test_invalid_points(linear, renderer):
    device = renderer("vulkan")
    device.load(linear(grid(Shape.HEXAHEDRON, 2)), "u")
    places = device.probe(np.array([[np.nan, 0.5, 0.5], [np.inf, 0, 0], [0.3, 0.3, 0.3], [1e300, 0, 0]]))
    assert places.status.tolist() == [Status.MISS, Status.MISS, Status.CERTAIN, Status.MISS]


def test_no_points_to_probe(linear, renderer):
    renderer("vulkan")
    with Renderer("vulkan") as device:
        with pytest.raises(ElvisError, match="no dataset is loaded"):
            device.probe(np.zeros((1, 3)))
        device.load(replace(linear(grid(Shape.HEXAHEDRON, 1)), fields=(Field("u", ()),)), "u")
        with pytest.raises(SceneError, match="no element to search"):
            device.probe(np.zeros((1, 3)))
