"""Orders in which shared triangles collapse alike; what is detached where there is none."""

import numpy as np
import pytest

from elvis import Shape
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.orientation import local_vertices
from elvis.core.testing import grid, mixed_volume
from elvis.plugins.conversion.converting import convert
from elvis.plugins.projection.frames import MIRRORED, PROPER, affine, source_points
from elvis.plugins.projection.numbering import TRIANGLES, Corners, chosen_orders, conflicting_elements, ranks
from elvis.plugins.projection.vertices import clusters, connected_labels, merge_vertices, merging_tolerance, neighbours
from elvis.plugins.testing import Analytic, AnalyticField


@pytest.mark.parametrize("shape", list(Shape))
def test_orders_are_turns_and_mirrors_of_the_shape(shape):
    for order in PROPER[shape]:
        matrix, _ = affine(shape, order)
        assert np.linalg.det(matrix) > 0
        assert np.allclose(source_points(shape, order, shape.vertices), shape.vertices[list(order)])
    assert np.linalg.det(affine(shape, MIRRORED[shape])[0]) < 0


def test_every_highest_vertex_of_a_tetrahedron_or_prism_can_be_collapsed():
    rng = np.random.default_rng(0)
    numbers = np.array([rng.permutation(4) for _ in range(100)])
    rank = np.arange(4)
    table = np.array(PROPER[Shape.TETRAHEDRON])
    corners = Corners(Shape.TETRAHEDRON, numbers)
    native = np.take_along_axis(numbers, table[chosen_orders(corners, rank)], axis=1)
    assert (native[:, 2:] == [2, 3]).all()
    lines = np.array([[0, 1], [2, 3], [4, 5]])[np.array([rng.permutation(3) for _ in range(100)])]
    prisms = np.empty((100, 6), int)
    prisms[:, [0, 1, 4]], prisms[:, [3, 2, 5]] = lines[:, :, 0], lines[:, :, 1]
    table = np.array(PROPER[Shape.PRISM])
    chosen = chosen_orders(Corners(Shape.PRISM, prisms), np.arange(6))
    assert (np.take_along_axis(prisms, table[chosen], axis=1)[:, 4:] == [4, 5]).all()


@pytest.mark.parametrize("seed", range(5))
def test_ranks_let_prisms_and_pyramids_follow(seed):
    source = Analytic(mixed_volume(), {}, seed=seed)
    known = np.unique(np.concatenate([block.vertices.reshape(-1) for block in source.blocks]))
    blocks = [Corners(block.shape, np.searchsorted(known, block.vertices)) for block in source.blocks]
    rank = ranks(blocks, len(known))
    assert sorted(rank) == list(range(len(known)))
    for block in blocks:
        if block.shape is Shape.PYRAMID:
            assert (rank[block.vertices[:, :4]].max(axis=1) < rank[block.vertices[:, 4]]).all()
    native = []
    for block in blocks:
        table = np.array(PROPER[block.shape])[chosen_orders(block, rank)]
        native.append(Corners(block.shape, np.take_along_axis(block.vertices, table, axis=1)))
    assert not any(mark.any() for mark in conflicting_elements(native, rank))
    for block in native:
        for face in TRIANGLES[block.shape]:
            assert (rank[block.vertices[:, list(face)]].argmax(axis=1) == 2).all()


def test_without_prisms_and_pyramids_vertices_keep_their_order():
    mesh = grid(Shape.TETRAHEDRON, 2)
    assert ranks([Corners(Shape.TETRAHEDRON, local_vertices(mesh, Shape.TETRAHEDRON))], 27).tolist() == list(range(27))


def crossed():
    """Two prisms that share a side with their lines across each other, and tetrahedra on all their triangles."""
    # the shared square; a line above it along z, a line below it along x; what the tetrahedra end in
    places = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1), (0.5, 1, 0), (0.5, 1, 1), (0, -1, 0.5), (1, -1, 0.5)]
    places += [(0.5, 0.5, -1), (0.5, 0.5, 2), (-1, -0.5, 0.5), (2, -0.5, 0.5)]
    upright, across = [0, 1, 2, 3, 4, 5], [0, 3, 2, 1, 6, 7]
    tetrahedra = [[0, 1, 4, 8], [3, 2, 5, 9], [0, 3, 6, 10], [1, 2, 7, 11]]
    return np.array(places, float), np.array([upright, across]), np.array(tetrahedra)


def oriented(places, elements, corners):
    """The elements with a positive Jacobian at their first vertex."""
    a, b, c = (places[elements[:, i]] - places[elements[:, 0]] for i in corners)
    negative = np.einsum("ei,ei->e", np.cross(a, b), c) < 0
    result = elements.copy()
    mirror = [3, 2, 1, 0, 5, 4] if elements.shape[1] == 6 else [1, 0, 2, 3]
    result[negative] = elements[negative][:, mirror]
    return result


def test_elements_without_a_valid_order_are_detached_and_exact():
    places, prisms, tetrahedra = crossed()
    prisms, tetrahedra = oriented(places, prisms, (1, 3, 4)), oriented(places, tetrahedra, (1, 2, 3))
    field = {"u": AnalyticField(lambda x: x[..., 0] - 2 * x[..., 1] * x[..., 2], 2)}
    detached = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        numbers = rng.permutation(len(places))
        elements = {Shape.PRISM: numbers[prisms], Shape.TETRAHEDRON: numbers[tetrahedra]}
        moved = places[np.argsort(numbers)]
        source = Analytic(grid(Shape.TETRAHEDRON, 1), field)
        source.places = moved
        source.blocks = [
            type(source.blocks[0])(shape, len(rows), 1, rows, key=rows) for shape, rows in elements.items()
        ]
        conversion = convert(source)
        detached += len(conversion.report.listed["detached"])
        assert conversion.report.fields[0].state == conversion.report.geometry.state == "exact"
        for shape in elements:
            local_vertices(conversion.dataset.mesh, shape)
    assert detached


def test_clusters_are_numbered_by_their_first_point():
    rng = np.random.default_rng(1)
    places = rng.random((50, 3))
    which = rng.permutation(np.repeat(np.arange(50), 4))
    points = places[which] + 1e-9 * rng.uniform(-1, 1, (200, 3))
    found = clusters(points, 5e-9)
    assert len(np.unique(found)) == 50
    assert len(np.unique(which * 50 + found)) == 50
    assert (np.diff(np.unique(found, return_index=True)[1]) > 0).all()


def test_labels_of_connected_items():
    labels = connected_labels(np.arange(7), np.array([5, 3, 6]), np.array([3, 1, 6]))
    assert labels.tolist() == [0, 1, 2, 1, 4, 1, 6]


def test_vertices_by_number_and_by_place():
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 0]], float)
    vertex, places = merge_vertices(np.array([4, 9, 9, 4, -1]), corners, 1e-9)
    assert len(places) == 4
    assert vertex[1] == vertex[2]
    assert len({vertex[0], vertex[3], vertex[4]}) == 3
    assert np.array_equal(places[vertex], corners)


def test_connected_meshes_of_turned_elements_are_valid():
    places, prisms, _ = crossed()
    mesh = connected(places, {Shape.PRISM: oriented(places, prisms, (1, 3, 4))})
    assert (local_vertices(mesh, Shape.PRISM) >= 0).all()


def test_vertices_without_numbers_are_numbered_by_their_first_corner():
    places = np.random.default_rng(2).random((20, 3))
    which = np.random.default_rng(3).permutation(np.repeat(np.arange(20), 3))
    corners = places[which] + 1e-10 * np.arange(60)[:, None]
    vertex, found = merge_vertices(np.full(60, -1), corners, 1e-7)
    first = np.unique(vertex, return_index=True)[1]
    assert len(found) == 20
    assert (np.diff(first) > 0).all()
    assert np.array_equal(found, corners[first])
    assert all(len(set(vertex[which == place].tolist())) == 1 for place in range(20))


def test_the_merge_tolerance_is_below_the_shortest_edge():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1e-6, 0]], [[0, 0, 0], [1, 0, 0], [1, 1, 1], [0, 1, 0]]])
    assert merging_tolerance([corners], 1e-2) == 1e-9
    assert merging_tolerance([corners[1:], corners[:1]], 1e-2, neighbours) == 1e-9
    diagonal = corners[:, [0, 1, 3, 2]]
    assert merging_tolerance([diagonal], 1e-2) == 1e-9
    assert merging_tolerance([diagonal], 1e-2, neighbours) == 1e-3
    assert merging_tolerance([], 1e-2) == 0
