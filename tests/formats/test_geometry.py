"""The geometry mapping: theorems over every shape, straight and curved, whichever way round entities are entered."""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from element_maps import by_element

from elvis.core.data.dataset import Dataset
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import gradients, jacobians, positions, values
from elvis.core.mapping.tangents import determinants
from elvis.core.polynomials.collapse import collapse_jacobian, uncollapse
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.polynomials.points import PointsType, nodes, triangle_nodes
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, one_element, ripple, shuffled

LINES = (PointsType.LOBATTO_LEGENDRE, PointsType.POLY_EVENLY_SPACED)
TRIANGLES = (PointsType.TRIANGLE_EVENLY_SPACED, PointsType.TRIANGLE_ELECTROSTATIC, PointsType.TRIANGLE_FEKETE)


def inner_points(shape, count=6, seed=1):
    """(n, d) reference points inside a shape."""
    return uncollapse(shape, np.random.default_rng(seed).uniform(-1, 1, (count, shape.dimension)))


def quadrature(shape, count):
    """Points xi and weights that integrate over a shape."""
    z, w = gauss(count)
    eta = np.stack(np.meshgrid(*[z] * shape.dimension, indexing="ij"), axis=-1).reshape(-1, shape.dimension)
    weights = w
    for _ in range(shape.dimension - 1):
        weights = np.multiply.outer(weights, w)
    return uncollapse(shape, eta), weights.reshape(-1) * collapse_jacobian(shape, eta)


def volumes(mesh, count=10):
    """Element id -> volume, area or length."""
    result = {}
    for block in geometry(Dataset(mesh)):
        points, weights = quadrature(block.expansion.shape, count)
        derivatives = evaluate_with_gradients(block.expansion, block.coefficients, points)[1]
        dets = [determinants(np.ascontiguousarray(s.transpose(1, 0, 2))) for s in derivatives]
        assert min(d.min() for d in dets) > 0
        result |= dict(zip(block.element_ids.tolist(), [float(d @ weights) for d in dets], strict=True))
    return result


# Orientation


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("make", [mixed_volume, mixed_plane])
def test_local_vertices_match_the_mesh(make, seed):
    mesh = make(seed)
    for shape in mesh.elements:
        np.testing.assert_array_equal(local_vertices(shuffled(mesh, seed), shape), local_vertices(mesh, shape))


@pytest.mark.parametrize("shape", list(Shape))
def test_a_single_element_has_the_reference_vertices(shape):
    mesh = one_element(shape, shape.dimension)
    np.testing.assert_array_equal(local_vertices(mesh, shape), [range(len(shape.vertices))])
    (block,) = geometry(Dataset(mesh))
    assert set(block.expansion.modes) == {2}
    points = inner_points(shape)
    world = evaluate(block.expansion, block.coefficients, points)[0].T
    np.testing.assert_allclose(world[:, : shape.dimension], points, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(world[:, shape.dimension :], 0)


# Curvature


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("n", [2, 3, 4, 6])
@pytest.mark.parametrize("faces", [True, False])
@pytest.mark.parametrize("make", [mixed_volume, mixed_plane])
@pytest.mark.sampled(least=24)
def test_the_map_is_independent_of_the_orientation_of_edges_and_faces(make, faces, n, seed):
    mesh, warp = make(seed), ripple(0.2, seed)
    one = by_element(curved(mesh, warp, n, faces=faces))
    other = by_element(curved(shuffled(mesh, seed), warp, n, faces=faces))
    assert one.keys() == other.keys()
    for id, (expansion, coefficients) in one.items():
        assert other[id][0] == expansion
        np.testing.assert_allclose(other[id][1], coefficients, rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("triangle", [*TRIANGLES, PointsType.POLY_EVENLY_SPACED])
@pytest.mark.parametrize("n", [2, 3, 5, 7])
@pytest.mark.sampled(least=32)
def test_elements_meet_on_shared_faces(n, triangle, seed):
    mesh = curved(shuffled(mixed_volume(seed), seed + 100), ripple(0.3, seed), n, triangle=triangle, faces=seed % 3 > 0)
    maps = by_element(mesh)
    sides = faces_of(mesh)
    shared = [pair for pair in sides.values() if len(pair) == 2]
    assert len(shared) == 19
    rng = np.random.default_rng(seed)
    for pair in shared:
        corners = sorted(pair[0][1])
        weights = corner_weights(len(corners), rng.random((20, 2)))
        worlds = [world_on_face(*maps[id], local, weights, pair[0][1]) for id, local in pair]
        np.testing.assert_allclose(worlds[0], worlds[1], rtol=0, atol=1e-13)


def faces_of(mesh):
    """Vertices of each face -> the elements there, each with {vertex row: reference vertex} of the face."""
    sides = defaultdict(list)
    for shape, entities in mesh.elements.items():
        for id, vertices in zip(entities.ids.tolist(), local_vertices(mesh, shape).tolist(), strict=True):
            for face in shape.faces:
                sides[frozenset(vertices[j] for j in face)].append((id, {vertices[j]: shape.vertices[j] for j in face}))
    return sides


def corner_weights(corners, random):
    """(n, corners) weights of the corners in cyclic order: barycentric or bilinear."""
    s, t = random.T
    if corners == 4:
        return np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=1)
    return np.stack([(1 - s) * (1 - t), s * (1 - t), t], axis=1)


def world_on_face(expansion, coefficients, local, weights, order):
    """World points of a face, its corners weighted in the given order."""
    return evaluate(expansion, coefficients, weights @ np.array([local[vertex] for vertex in order])).T


@pytest.mark.parametrize("line", LINES)
@pytest.mark.parametrize("n", range(2, 9))
def test_edges_run_through_their_nodes(line, n):
    mesh, warp = mixed_volume(2), ripple(0.2, 5)
    maps = by_element(curved(mesh, warp, n, line, faces=False))
    for shape, entities in mesh.elements.items():
        for id, vertices in zip(entities.ids.tolist(), local_vertices(mesh, shape), strict=True):
            for start, end in shape.edges:
                t = ((1 + nodes(line, n)) / 2)[:, None]
                xi = (1 - t) * shape.vertices[start] + t * shape.vertices[end]
                straight = (1 - t) * mesh.vertices[vertices[start]] + t * mesh.vertices[vertices[end]]
                world = evaluate(*maps[id], xi).T
                np.testing.assert_allclose(world, warp(straight), rtol=0, atol=1e-13)


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("line", "triangle", "digits"),
    [
        (PointsType.POLY_EVENLY_SPACED, PointsType.TRIANGLE_EVENLY_SPACED, 1e-12),
        (PointsType.LOBATTO_LEGENDRE, PointsType.TRIANGLE_ELECTROSTATIC, 1e-8),  # tables of ten digits
        (PointsType.LOBATTO_LEGENDRE, PointsType.TRIANGLE_FEKETE, 1e-8),
    ],
)
@pytest.mark.parametrize("n", range(2, 9))
def test_faces_run_through_their_nodes(line, triangle, digits, n):
    if (triangle, n) == (PointsType.TRIANGLE_FEKETE, 7):
        digits = 1e-6  # the edge nodes of this published table are those of Lobatto to five digits only
    mesh, warp = mixed_volume(2), ripple(0.2, 5)
    maps = by_element(curved(mesh, warp, n, line, triangle))
    x, y = ((1 + triangle_nodes(triangle, n)) / 2).T
    square = np.stack(np.meshgrid(*[(1 + nodes(line, n)) / 2] * 2), axis=-1).reshape(-1, 2)
    weights = {3: np.stack([1 - x - y, x, y], axis=1), 4: corner_weights(4, square)}
    for shape, entities in mesh.elements.items():
        for id, vertices in zip(entities.ids.tolist(), local_vertices(mesh, shape), strict=True):
            for face in shape.faces:
                straight = weights[len(face)] @ mesh.vertices[vertices[list(face)]]
                world = evaluate(*maps[id], weights[len(face)] @ shape.vertices[list(face)]).T
                np.testing.assert_allclose(world, warp(straight), rtol=0, atol=digits)


def shear(points):
    """A polynomial map of degree 3 that keeps volumes, and areas in the plane."""
    x, y, z = points.T
    x = x + 0.2 * y**2 - 0.1 * y**3 + 0.1 * z**2 * y
    return np.stack([x, y - 0.1 * x + 0.05 * z**3, z], axis=1)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("make", [mixed_volume, mixed_plane])
@pytest.mark.parametrize("triangle", [*TRIANGLES, PointsType.LOBATTO_LEGENDRE])
def test_volumes_follow_from_the_boundary(make, triangle, seed):
    mesh = make(seed)
    straight = volumes(mesh)
    assert sum(straight.values()) == pytest.approx(3.5 if mesh.dimension == 3 else 3, rel=1e-14)
    bent = volumes(shuffled_and_curved(mesh, shear, 4, triangle, seed))
    assert bent == pytest.approx(straight, rel=1e-8 if triangle in TRIANGLES[1:] else 1e-12)


def shuffled_and_curved(mesh, warp, n, triangle, seed):
    return curved(shuffled(mesh, seed), warp, n, triangle=triangle)


@pytest.mark.parametrize("shape", list(Shape))
@pytest.mark.parametrize("cells", [1, 2, 3])
def test_grids_fill_the_unit_cube(shape, cells):
    mesh = grid(shape, cells)
    assert sum(volumes(mesh, 4).values()) == pytest.approx(1, rel=1e-13)
    kind, ids = mesh.composites[-1].parts[0]
    outside = {"A": 12, "P": 6, "R": 8, "H": 6, "T": 4, "Q": 4, "S": 2}[shape.tag]
    assert (kind, len(ids)) == ("VEF"[shape.dimension - 1], outside * cells ** (shape.dimension - 1))


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.TETRAHEDRON])
@pytest.mark.parametrize("triangle", [*TRIANGLES, PointsType.GAUSS_LEGENDRE, PointsType.LOBATTO_LEGENDRE])
def test_simplices_represent_cubic_maps_exactly(shape, triangle):
    mesh = one_element(shape)
    line = PointsType.LOBATTO_LEGENDRE if triangle.is_triangular else triangle
    ((expansion, coefficients),) = by_element(curved(mesh, shear, 4, line, triangle)).values()
    points = inner_points(shape)
    straight = np.zeros((len(points), 3))
    straight[:, : shape.dimension] = points
    world = evaluate(expansion, coefficients, points).T
    np.testing.assert_allclose(world, shear(straight), rtol=0, atol=1e-8 if triangle in TRIANGLES[1:] else 1e-13)


def test_a_quarter_ring_has_its_closed_form():
    def polar(points):
        angle = np.pi / 4 * (1 + points[:, 0])
        radius = (3 + points[:, 1]) / 2
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)

    mesh = one_element(Shape.QUADRILATERAL, 2)
    for n, error in [(3, 6e-2), (5, 1e-3), (9, 1e-8), (13, 1e-12)]:
        ((expansion, coefficients),) = by_element(curved(mesh, polar, n)).values()
        points = inner_points(Shape.QUADRILATERAL, 50)
        world = evaluate(expansion, coefficients, points).T
        np.testing.assert_allclose(world, polar(points), rtol=0, atol=error)


@pytest.mark.parametrize("space", [1, 2, 3])
@pytest.mark.parametrize("shape", [Shape.SEGMENT, Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_coordinates_beyond_the_space_are_zero(shape, space):
    if space < shape.dimension:
        return
    mesh = replace(curved(one_element(shape), lambda points: points + 0.1 * points[:, ::-1] + 7, 4), space=space)
    (block,) = geometry(Dataset(mesh))
    assert not block.coefficients[:, space:].any()
    assert block.coefficients[:, :space].any(axis=2).all()


@pytest.mark.parametrize("shape", list(Shape))
def test_jacobians_are_differences_of_positions(shape):
    mesh = curved(one_element(shape), ripple(0.2, 3), 5)
    dataset = Dataset(mesh)
    field = approximated(dataset, "u", lambda x: np.sin(x[:, 0]) + x[:, 1] * x[:, 2], 5)
    (patch,) = patches(replace(dataset, fields=(field,)), ["u"])
    points, rows, step = inner_points(shape), np.zeros(6, int), 1e-6
    matrix, derivatives = jacobians(patch, rows, points), gradients(patch, 0, rows, points)
    for i in range(shape.dimension):
        shift = step * np.eye(shape.dimension)[i]
        ahead, behind = positions(patch, rows, points + shift), positions(patch, rows, points - shift)
        np.testing.assert_allclose(matrix[:, :, i], (ahead - behind) / (2 * step), rtol=0, atol=1e-8)
        change = values(patch, 0, rows, points + shift) - values(patch, 0, rows, points - shift)
        along = np.einsum("nc,nc->n", derivatives, matrix[:, :, i])
        np.testing.assert_allclose(along, change / (2 * step), rtol=0, atol=1e-8)
