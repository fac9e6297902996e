"""Boxes hold their elements; the hierarchy finds what a search through all boxes finds."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Curves
from elvis.core.mapping.boxes import BoxTree, element_boxes
from elvis.core.mapping.geometry import parts
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import positions
from elvis.core.mapping.wide_boxes import vertex_boxes, wide_boxes
from elvis.core.polynomials.bernstein import bernstein_coefficients
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, mixed_volume, one_element, ripple


def random_boxes(count, seed, size=0.1):
    rng = np.random.default_rng(seed)
    low = rng.random((count, 3))
    return np.concatenate([low, low + size * rng.random((count, 3))], axis=1).astype(np.float32)


def held(boxes, points):
    """All pairs by looking at every box for every point."""
    inside = (boxes[:, :3] <= points[:, None]) & (points[:, None] <= boxes[:, 3:])
    return np.nonzero(inside.all(axis=2))


@pytest.mark.parametrize("shape", list(Shape))
@pytest.mark.parametrize("n", [2, 3, 6])
def test_boxes_contain_their_elements(shape, n):
    mesh = curved(one_element(shape), ripple(0.4, n), n)
    (patch,) = patches(Dataset(mesh))
    lattice = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * shape.dimension), axis=-1).reshape(-1, shape.dimension)
    world = positions(patch, np.zeros(len(lattice), int), uncollapse(shape, lattice))
    (box,) = element_boxes(patch).astype(float)
    assert (world >= box[:3]).all()
    assert (world <= box[3:]).all()


@pytest.mark.parametrize("size", [0.02, 0.4])
def test_wide_boxes_hold_the_exact_ones(size):
    """Half of the faces are only curved by their edges; widths of mildly curved elements are small."""
    mesh = curved(grid(Shape.HEXAHEDRON, 2), ripple(size), 5)
    curves, half = mesh.face_curves, len(mesh.face_curves) // 2
    first = Curves(curves.rows[:half], curves.kinds[:half], curves.offsets[: half + 1], curves.points[: 25 * half])
    mesh = replace(mesh, face_curves=first)
    (part,) = parts(Dataset(mesh))
    rows = np.arange(len(part))[::-1]
    inner = vertex_boxes(part, rows)
    wide = wide_boxes(part, rows, inner)
    (patch,) = patches(Dataset(mesh))
    net = bernstein_coefficients(patch.geometry, patch.geometry_coefficients)[rows]
    assert (wide[:, :3] <= net.min(axis=2)).all()
    assert (wide[:, 3:] >= net.max(axis=2)).all()
    assert (inner[:, :3] >= net.min(axis=2)).all()
    assert (inner[:, 3:] <= net.max(axis=2)).all()
    # less than the size of an element where that is mildly curved
    assert (wide[:, 3:] - inner[:, 3:]).max() < 20 * size


@pytest.mark.parametrize("shape", list(Shape))
@pytest.mark.parametrize("n", [2, 3, 6])
def test_boxes_are_tight_round_mildly_curved_elements(shape, n):
    (patch,) = patches(Dataset(curved(one_element(shape), ripple(0.1, n), n)))
    (box,) = element_boxes(patch).astype(float)
    lattice = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * shape.dimension), axis=-1).reshape(-1, shape.dimension)
    world = positions(patch, np.zeros(len(lattice), int), uncollapse(shape, lattice))
    assert (box[3:] - box[:3] <= 2 * np.ptp(world, axis=0) + 0.4).all()


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e7, -1e7])
def test_boxes_are_rounded_outwards(offset):
    mesh = curved(grid(Shape.TETRAHEDRON, 2), lambda points: points + offset + 1 / 3, 2)
    (patch,) = patches(Dataset(mesh))
    boxes, corners = element_boxes(patch).astype(float), patch.geometry_coefficients
    assert (boxes[:, :3] <= corners.min(axis=2)).all()
    assert (boxes[:, 3:] >= corners.max(axis=2)).all()
    assert np.abs(boxes[:, :3] - corners.min(axis=2)).max() <= 2 * np.spacing(np.float32(abs(offset) + 1))


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5, 8, 9, 100, 1000])
@pytest.mark.parametrize("leaf", [1, 4, 8])
def test_candidates_match_those_of_a_full_search(count, leaf):
    boxes, points = random_boxes(count, count), np.random.default_rng(leaf).random((500, 3))
    tree = BoxTree.build(boxes, leaf)
    point, element = tree.candidates(points)
    expected = held(boxes.astype(float), points)
    np.testing.assert_array_equal(point, expected[0])
    np.testing.assert_array_equal(element, expected[1])


def test_candidates_come_in_batches_of_any_size():
    boxes, points = random_boxes(300, 1, size=2.0), np.random.default_rng(2).random((200, 3))
    whole = np.stack(BoxTree.build(boxes).candidates(points))
    pieces = list(BoxTree.build(boxes).candidate_batches(points, size=64))
    assert max(len(point) for point, _ in pieces) <= 64 * 2 * 4
    joined = np.concatenate([np.stack(piece) for piece in pieces], axis=1)
    np.testing.assert_array_equal(joined[:, np.lexsort(joined[::-1])], whole)


@pytest.mark.parametrize("count", [20, 100, 600])
@pytest.mark.parametrize("way", [(0.3, -0.8, 0.5), (1.0, 0.0, 0.0)])
def test_rays_meet_the_boxes_of_a_full_search(count, way):
    # with leaves that hold nothing, which no ray meets
    boxes, points = random_boxes(count, count, size=0.3), np.random.default_rng(5).uniform(-0.3, 1.3, (400, 3))
    tree = BoxTree.build(boxes)
    batches = [np.stack(batch) for batch in tree.ray_batches(points, np.array(way))]
    point, element = np.concatenate([np.empty((2, 0), np.int64), *batches], axis=1)
    with np.errstate(divide="ignore"):
        one, other = ((boxes[:, side].astype(float) - points[:, None]) / way for side in (slice(3), slice(3, 6)))
    entry, leaving = np.minimum(one, other).max(axis=2), np.maximum(one, other).min(axis=2)
    expected = np.nonzero(np.maximum(entry, 0) <= leaving)
    assert len(expected[0]) > 5
    assert set(zip(point, element, strict=True)) == set(zip(*expected, strict=True))
    assert len(point) == len(expected[0])


@pytest.mark.parametrize("count", [1, 7, 64, 1000])
@pytest.mark.parametrize("leaf", [4, 8])
def test_the_layout_is_the_one_devices_rely_on(count, leaf):
    tree = BoxTree.build(random_boxes(count, 3), leaf)
    leaves = tree.leaves
    assert leaves & (leaves - 1) == 0
    assert leaf * leaves >= count
    assert (tree.nodes.dtype, tree.nodes.shape, tree.order.dtype) == (np.float32, (2 * leaves - 1, 6), np.uint32)
    np.testing.assert_array_equal(np.sort(tree.order), np.arange(count))

    # a leaf is the union of its elements, an inner node that of its children
    for j in range(leaves):
        members = tree.boxes[tree.order[j * leaf : (j + 1) * leaf]]
        node = tree.nodes[leaves - 1 + j]
        np.testing.assert_array_equal(node[:3], members[:, :3].min(axis=0, initial=np.inf))
        np.testing.assert_array_equal(node[3:], members[:, 3:].max(axis=0, initial=-np.inf))
    for i in range(leaves - 1):
        children = tree.nodes[2 * i + 1 : 2 * i + 3]
        np.testing.assert_array_equal(tree.nodes[i, :3], children[:, :3].min(axis=0))
        np.testing.assert_array_equal(tree.nodes[i, 3:], children[:, 3:].max(axis=0))


def test_elements_that_are_not_finite_are_never_found():
    boxes = random_boxes(9, 5)
    boxes[4] = [np.inf] * 3 + [-np.inf] * 3
    points = boxes[np.arange(9) != 4].reshape(-1, 2, 3).mean(axis=1, dtype=float)
    _, element = BoxTree.build(boxes).candidates(points)
    assert set(element) == set(range(9)) - {4}
    mesh = curved(grid(Shape.TRIANGLE, 1), lambda points: np.where(points == 1, np.nan, points), 3)
    (patch,) = patches(Dataset(mesh))
    assert not np.isfinite(element_boxes(patch)).any()


def test_points_that_are_not_finite_find_nothing():
    tree = BoxTree.build(random_boxes(9, 5))
    points = np.array([[np.nan, 0, 0], [np.inf, 0, 0], [0.1, -np.inf, np.nan]])
    assert len(tree.candidates(points)[0]) == 0


def test_patches_are_numbered_one_after_another():
    parts = patches(Dataset(curved(mixed_volume(), ripple(0.1), 3)))
    tree = BoxTree.over(parts)
    boxes = np.concatenate([element_boxes(patch) for patch in parts])
    np.testing.assert_array_equal(tree.boxes, boxes)
    assert len(tree.order) == sum(map(len, parts))


def test_space_neighbours_are_leaf_neighbours():
    (patch,) = patches(Dataset(grid(Shape.HEXAHEDRON, 16)))
    tree = BoxTree.over([patch])
    leaves = tree.nodes[tree.leaves - 1 :]
    assert np.prod(leaves[:, 3:] - leaves[:, :3], axis=1).sum() == pytest.approx(1, rel=1e-5)
