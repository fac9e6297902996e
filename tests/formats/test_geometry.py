"""The geometry mapping: theorems over every shape, straight and curved, whichever way round entities are entered."""

import tracemalloc
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

from elvis.formats.arrays import frozen_ints
from elvis.formats.collapse import collapse_jacobian, uncollapse
from elvis.formats.connectivity import connected
from elvis.formats.dataset import Block, Dataset, Field
from elvis.formats.errors import ElvisError, FormatError
from elvis.formats.evaluation import evaluate, evaluate_with_gradients
from elvis.formats.geometry import geometry
from elvis.formats.mesh import Curves, Entities
from elvis.formats.orientation import local_vertices
from elvis.formats.patch import patches
from elvis.formats.points import PointsType, nodes, triangle_nodes
from elvis.formats.pointwise import gradients, jacobians, positions, values
from elvis.formats.quadrature import gauss
from elvis.formats.shapes import Shape
from elvis.formats.tangents import determinants
from elvis.formats.testing import approximated, curved, grid, mixed_plane, mixed_volume, one_element, ripple, shuffled

LINES = (PointsType.LOBATTO_LEGENDRE, PointsType.POLY_EVENLY_SPACED)
TRIANGLES = (PointsType.TRIANGLE_EVENLY_SPACED, PointsType.TRIANGLE_ELECTROSTATIC, PointsType.TRIANGLE_FEKETE)
SOLIDS = Shape.of_dimension(3)


def by_element(mesh):
    """Element id -> (expansion, (3, m) coefficients)."""
    blocks = geometry(Dataset(mesh))
    return {int(id): (b.expansion, c) for b in blocks for id, c in zip(b.element_ids, b.coefficients, strict=True)}


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
        slopes = evaluate_with_gradients(block.expansion, block.coefficients, points)[1]
        dets = [determinants(np.ascontiguousarray(s.transpose(1, 0, 2))) for s in slopes]
        assert min(d.min() for d in dets) > 0
        result |= dict(zip(block.element_ids.tolist(), [float(d @ weights) for d in dets], strict=True))
    return result


# Orientation


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("make", [mixed_volume, mixed_plane])
def test_local_vertices_are_those_the_mesh_was_made_of(make, seed):
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
def test_the_map_does_not_depend_on_how_edges_and_faces_are_entered(make, faces, n, seed):
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
def test_simplices_hold_cubic_maps_exactly(shape, triangle):
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
    for n, error in [(3, 6e-2), (5, 1e-4), (9, 1e-9), (13, 1e-13)]:
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
    matrix, slopes = jacobians(patch, rows, points), gradients(patch, 0, rows, points)
    for i in range(shape.dimension):
        shift = step * np.eye(shape.dimension)[i]
        ahead, behind = positions(patch, rows, points + shift), positions(patch, rows, points - shift)
        np.testing.assert_allclose(matrix[:, :, i], (ahead - behind) / (2 * step), rtol=0, atol=1e-8)
        change = values(patch, 0, rows, points + shift) - values(patch, 0, rows, points - shift)
        along = np.einsum("nc,nc->n", slopes, matrix[:, :, i])
        np.testing.assert_allclose(along, change / (2 * step), rtol=0, atol=1e-8)


# Grouping


def test_straight_elements_stay_apart_from_curved_ones():
    mesh = grid(Shape.TETRAHEDRON, 2)
    bent = curved(mesh, ripple(0.1), 3)
    some = np.flatnonzero((mesh.vertices[mesh.of(Shape.SEGMENT).members] == 0).all(axis=1)[:, 0])
    assert 0 < len(some) < len(mesh.of(Shape.SEGMENT))
    edges = bent.edge_curves
    points = edges.points.reshape(-1, 3, 3)[some].reshape(-1, 3)
    few = Curves(frozen_ints(some), edges.kinds[some], frozen_ints(3 * np.arange(len(some) + 1)), points)
    blocks = geometry(Dataset(replace(mesh, edge_curves=few)))
    assert [b.expansion.modes for b in blocks] == [(2, 2, 2), (3, 3, 3)]
    np.testing.assert_array_equal(np.sort(np.concatenate([b.element_ids for b in blocks])), mesh.domain_ids())
    straight = by_element(mesh)
    for id, coefficients in zip(blocks[0].element_ids, blocks[0].coefficients, strict=True):
        np.testing.assert_array_equal(coefficients, straight[id][1])


def test_only_the_domain_counts():
    mesh = mixed_volume()
    tetrahedra = replace(mesh, domains={0: (0,)})
    (block,) = geometry(Dataset(tetrahedra))
    assert block.expansion.shape is Shape.TETRAHEDRON
    np.testing.assert_array_equal(block.element_ids, mesh.of(Shape.TETRAHEDRON).ids)


def test_fields_can_be_the_map():
    mesh = curved(mixed_volume(), ripple(0.2), 3)
    columns = {f"map_{axis}": i for i, axis in enumerate("xyz")}
    plain = Dataset(mesh)
    fields = tuple(approximated(plain, name, lambda x, i=i: x[:, i] ** 2, 4) for name, i in columns.items())
    chosen = tuple(replace(f, blocks=tuple(b for b in f.blocks if len(b) != 1)) for f in fields)
    mapped = geometry(Dataset(mesh, chosen, metadata={"GeometryMap": "map_x, map_y,map_z"}))
    kept = [b for b in mapped if b.expansion.shape is Shape.HEXAHEDRON]
    assert len(kept) == 1
    assert kept[0].expansion.modes == (3, 3, 3)
    for block in mapped:
        if block is not kept[0]:
            assert max(block.expansion.modes) == 4
            for i, field in enumerate(chosen):
                (own,) = (b for b in field.blocks if b.expansion.shape is block.expansion.shape)
                np.testing.assert_array_equal(block.element_ids, own.element_ids)
                np.testing.assert_array_equal(block.coefficients[:, i], own.coefficients)
    default = geometry(Dataset(mesh, chosen, metadata={"GeometryMap": ""}))
    assert [b.expansion for b in default] == [b.expansion for b in mapped]
    flat = geometry(Dataset(mesh, fields, metadata={"GeometryMap": "map_y"}))
    assert all(not b.coefficients[:, 1:].any() for b in flat)


def test_a_map_needs_its_fields():
    mesh = mixed_volume()
    fields = tuple(approximated(Dataset(mesh), f"map_{axis}", lambda x: x[:, 0], 3) for axis in "xyz")
    with pytest.raises(FormatError, match="map_x, map_y, map_z among u"):
        geometry(Dataset(mesh, (Field("u", ()),), metadata={"GeometryMap": ""}))
    less = replace(fields[2], blocks=fields[2].blocks[1:])
    with pytest.raises(FormatError, match="other expansions for element 0"):
        geometry(Dataset(mesh, (*fields[:2], less), metadata={"GeometryMap": ""}))


def test_patches_group_by_all_expansions_and_copy_nothing_they_need_not():
    dataset = Dataset(curved(mixed_volume(), ripple(0.2), 3))
    whole = approximated(dataset, "u", lambda x: x[:, 0], 3)
    split = Field("v", tuple(part for block in whole.blocks for part in halves(block)))
    finer = approximated(dataset, "w", lambda x: x[:, 1], 4)
    partial = Field("w", finer.blocks[:2])
    found = patches(replace(dataset, fields=(whole, split, partial)), ["u", "v", "w"])
    assert [p.shape for p in found] == list(SOLIDS)
    for patch, block, blocks in zip(found, whole.blocks, geometry(dataset), strict=True):
        assert patch.geometry == blocks.expansion
        np.testing.assert_array_equal(patch.geometry_coefficients, blocks.coefficients)
        assert np.shares_memory(patch.coefficients[0], block.coefficients)
        np.testing.assert_array_equal(patch.coefficients[1], block.coefficients)
        assert (patch.fields[2] is None) == (patch.shape not in SOLIDS[:2])
        assert (patch.coefficients[2] is None) == (patch.fields[2] is None)


def halves(block):
    """A block in two parts, the second one first and backwards."""
    middle = len(block) // 2
    rows = [np.arange(middle, len(block))[::-1], np.arange(middle)]
    return [Block(block.expansion, block.element_ids[r], block.coefficients[r]) for r in rows if len(r)]


def test_patches_tell_what_does_not_fit():
    dataset = Dataset(mixed_volume())
    field = approximated(dataset, "u", lambda x: x[:, 0], 3)
    with pytest.raises(ElvisError, match=r"\(u\), found p"):
        patches(replace(dataset, fields=(field,)), ["p"])
    tets, pyramids, *_ = field.blocks
    swapped = Field("u", (Block(pyramids.expansion, tets.element_ids, pyramids.coefficients[:3]),))
    with pytest.raises(FormatError, match="field u, element 0: expected a tetrahedron as in the mesh, found a pyramid"):
        patches(replace(dataset, fields=(swapped,)), ["u"])
    short = Field("u", (Block(tets.expansion, tets.element_ids, tets.coefficients[:, :5]),))
    with pytest.raises(FormatError, match="expected 10 coefficients for its bases and orders, found 5"):
        patches(replace(dataset, fields=(short,)), ["u"])


# Size


def test_straight_meshes_need_little_memory():
    mesh = grid(Shape.TETRAHEDRON, 24)
    tracemalloc.start()
    (block,) = geometry(Dataset(mesh))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3 * block.coefficients.nbytes + 3e7


# Broken meshes


def broken(mesh, shape, row, members):
    entities = mesh.of(shape)
    changed = np.array(entities.members)
    changed[row] = members
    return replace(mesh, entities={**mesh.entities, shape: Entities(entities.ids, frozen_ints(changed))})


def with_ids_from(mesh, shape, first):
    entities = mesh.of(shape)
    moved = Entities(frozen_ints(first + np.arange(len(entities))), entities.members)
    return replace(mesh, entities={**mesh.entities, shape: moved}, domains={})


def test_edges_that_form_no_polygon():
    mesh = with_ids_from(mixed_plane(), Shape.TRIANGLE, 100)
    edges = mesh.of(Shape.TRIANGLE).members[1]
    with pytest.raises(FormatError, match="triangle 101: expected edges that form a closed polygon, found edges from"):
        geometry(Dataset(broken(mesh, Shape.TRIANGLE, 1, [edges[0], edges[1], edges[1]])))
    quad = mesh.of(Shape.QUADRILATERAL).members[0]
    with pytest.raises(FormatError, match="quadrilateral 2: expected edges that form a closed polygon"):
        geometry(Dataset(broken(mesh, Shape.QUADRILATERAL, 0, quad[[0, 2, 1, 3]])))


@pytest.mark.parametrize("shape", SOLIDS)
def test_faces_that_form_no_solid(shape):
    mesh = with_ids_from(grid(shape, 2), shape, 40)
    faces = mesh.of(shape).members
    other = next(row for row in faces if not set(row) & set(faces[2]))
    with pytest.raises(FormatError, match=f"{shape.label.lower()} 42: expected (faces that share one|local face)"):
        geometry(Dataset(broken(mesh, shape, 2, [*faces[2, :-1], other[-1]])))
    with pytest.raises(FormatError, match=f"{shape.label.lower()} 42: expected"):
        geometry(Dataset(broken(mesh, shape, 2, [*faces[2, :-1], faces[2, -2]])))


@pytest.mark.parametrize("shape", [Shape.PRISM, Shape.PYRAMID])
def test_faces_of_the_wrong_kind(shape):
    mesh = grid(shape, 1)
    faces = mesh.of(shape).members[1]
    with pytest.raises(FormatError, match="1: expected a quadrilateral as local face 0, found a triangle"):
        geometry(Dataset(broken(mesh, shape, 1, [faces[1], *faces[1:]])))
    with pytest.raises(FormatError, match="1: expected a triangle as local face 1, found a quadrilateral"):
        geometry(Dataset(broken(mesh, shape, 1, [faces[0], faces[0], *faces[2:]])))


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PRISM, Shape.PYRAMID])
def test_triangles_collapsed_elsewhere(shape):
    mesh = with_ids_from(one_element(shape), shape, 7)
    last = mesh.of(shape).members[0, 1]
    turned = broken(mesh, Shape.TRIANGLE, last, np.roll(mesh.of(Shape.TRIANGLE).members[last], 1))
    expected = f"{shape.label.lower()} 7: expected local face 1 to be collapsed at local vertex"
    with pytest.raises(FormatError, match=expected):
        geometry(Dataset(turned))


def bent(mesh, **changes):
    """A mesh curved with three nodes, its face or edge curves changed."""
    done = curved(mesh, ripple(0.1), 3)
    name = next(iter(changes))
    return replace(done, **{name: replace(getattr(done, name), **changes[name])})


def test_a_curved_face_needs_curved_edges():
    mesh = replace(curved(mixed_plane(), ripple(0.1), 3), edge_curves=Curves.none())
    with pytest.raises(FormatError, match="triangle 0: expected edges curved with 3 nodes each, as the face is, found"):
        geometry(Dataset(mesh))


def test_curves_of_unknown_kinds_and_counts():
    mesh = mixed_plane()
    edges = len(mesh.of(Shape.SEGMENT))
    cases = [
        (
            bent(mesh, edge_curves={"kinds": frozen_ints(np.full(edges, 77))}),
            "segment 0: expected the number of a family",
        ),
        (
            bent(mesh, edge_curves={"kinds": frozen_ints(np.full(edges, 22))}),
            "curve of segment 0: expected nodes for a segment",
        ),
        (bent(mesh, edge_curves={"kinds": frozen_ints(np.full(edges, 20))}), "curve of segment 0: expected a one-dim"),
        (bent(mesh, face_curves={"kinds": frozen_ints(np.full(4, 24))}), "curve of quadrilateral 2: expected"),
        (bent(mesh, face_curves={"kinds": frozen_ints(np.full(4, 4))}), "curve of triangle 0: expected a number of"),
    ]
    for case, message in cases:
        with pytest.raises(FormatError, match=message):
            geometry(Dataset(case))


def test_absurd_orders_are_refused_at_once():
    mesh = mixed_plane()
    count = 1 << 20
    curve = Curves(frozen_ints([0]), frozen_ints([17]), frozen_ints([0, count]), np.zeros((count, 3)))
    with pytest.raises(FormatError, match="of order up to 63, found 1048576"):
        geometry(Dataset(replace(mesh, edge_curves=curve)))
    with pytest.raises(FormatError, match="of order up to 63, found 1048576"):
        geometry(Dataset(replace(mesh, face_curves=curve)))


def test_connected_numbers_everything_once():
    mesh = connected(np.eye(3), {Shape.TRIANGLE: np.array([[0, 1, 2]])})
    assert (len(mesh.of(Shape.SEGMENT)), len(mesh.of(Shape.TRIANGLE)), mesh.space) == (3, 1, 3)
