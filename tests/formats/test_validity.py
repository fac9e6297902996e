from dataclasses import replace
from functools import partial
from math import comb

import numpy as np
import pytest

from elvis import Dataset, Shape
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate_at, evaluate_with_gradients
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.testing import approximated, curved, grid, mixed_volume, one_element, ripple
from elvis.core.validity import determinants, enclosed_determinants
from elvis.core.validity.determinants import Polynomials, determinant, tangents
from elvis.core.validity.enclosed_determinants import enclosures
from elvis.core.validity.squares import descended, lower_bound
from elvis.core.validity.validity import ValidityStatus, validity, validity_facts

EVERY_MAP = [(shape, nodes) for shape in Shape for nodes in (2, 3, 5)]


def tangled(shape, nodes, cells=2):
    """A mesh curved so strongly that some elements fold over, where the shape lets them."""
    return Dataset(curved(grid(shape, cells), ripple(0.6, seed=3), nodes))


def sampled(block, space, n=11):
    """(e, q) determinants at points spread over the element, its vertices, edges and faces included."""
    dimension = block.expansion.shape.dimension
    line = np.linspace(-1, 1, n)[: -1 if block.expansion.shape is Shape.PYRAMID else None]
    eta = np.stack(np.meshgrid(*[line] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    return sampled_at(block, space, uncollapse(block.expansion.shape, eta))


def sampled_at(block, space, xi):
    derivatives = evaluate_with_gradients(block.expansion, block.coefficients[:, :space], xi)[1]
    jacobians = np.moveaxis(derivatives, 1, -2)
    if space == jacobians.shape[-1]:
        return np.linalg.det(jacobians)
    return np.sqrt(np.linalg.det(np.swapaxes(jacobians, -1, -2) @ jacobians))


def ids_with(found, status):
    return set(found.element_ids[found.status == status].tolist())


def test_every_shape_is_here():
    assert {shape for shape, _ in EVERY_MAP} == set(Shape)


@pytest.mark.sampled
@pytest.mark.parametrize(("shape", "nodes"), EVERY_MAP)
def test_samples_never_contradict_bounds_and_statuses(shape, nodes):
    dataset = tangled(shape, nodes)
    found = validity(dataset)
    row = {element: i for i, element in enumerate(found.element_ids.tolist())}
    for block in geometry(dataset):
        values_there = sampled(block, dataset.mesh.space)
        rows = [row[element] for element in block.element_ids.tolist()]
        slack = found.error[rows] + 1e-13 * np.abs(values_there).max()
        assert (values_there.min(axis=1) >= found.lower[rows] - slack).all()
        assert (values_there.max(axis=1) <= found.upper[rows] + slack).all()
        assert (found.status[rows][(values_there < -slack[:, None]).any(axis=1)] == ValidityStatus.NOT_POSITIVE).all()
    assert not found.count(ValidityStatus.UNDECIDED)


def test_some_of_those_elements_are_tangled():
    statuses = {shape: validity(tangled(shape, 3)).status for shape in Shape.of_dimension(3)}
    for status in statuses.values():
        assert set(status.tolist()) == {ValidityStatus.NOT_POSITIVE, ValidityStatus.POSITIVE}


@pytest.mark.sampled
@pytest.mark.parametrize(("shape", "nodes"), EVERY_MAP)
def test_minima_are_attained_at_the_stated_points(shape, nodes):
    dataset = tangled(shape, nodes)
    found = validity(dataset)
    for block in geometry(dataset):
        for element, coefficients in zip(block.element_ids, block.coefficients, strict=True):
            row = int(np.flatnonzero(found.element_ids == element)[0])
            xi = found.reference[row : row + 1, : shape.dimension]
            alone = GeometryBlock(block.expansion, block.element_ids[:1], coefficients[None])
            if shape is Shape.PYRAMID and xi[0, 2] == 1:
                continue  # the determinant depends on how the apex is approached
            value = sampled_at(alone, dataset.mesh.space, xi)[0, 0]
            assert value == pytest.approx(found.minimum[row], rel=1e-9, abs=10 * found.error[row] + 1e-15)
            world = evaluate_at(block.expansion, coefficients[None], np.zeros(1, int), xi)
            assert found.world[row] == pytest.approx(world[0], abs=1e-13)


@pytest.mark.sampled
@pytest.mark.parametrize(("shape", "nodes"), EVERY_MAP)
def test_listed_elements_and_all_together_are_tight(shape, nodes):
    found = validity(tangled(shape, nodes))
    whole = found.range
    assert whole.minimum - whole.lower <= 1e-10 * abs(whole.minimum) + found.error.max()
    assert whole.upper - whole.maximum <= 1e-10 * abs(whole.maximum) + found.error.max()
    listed = found.failing_rows
    assert (found.status[listed] == ValidityStatus.NOT_POSITIVE).all()
    size = np.maximum(np.abs(found.minimum), np.abs(found.maximum))[listed]
    assert (found.minimum[listed] - found.lower[listed] <= 1e-10 * size).all()
    assert (found.upper[listed] - found.maximum[listed] <= 1e-10 * size).all()


@pytest.mark.parametrize("shape", [Shape.SEGMENT, Shape.TRIANGLE, Shape.TETRAHEDRON])
def test_affine_elements_are_exact(shape):
    mesh = grid(shape, 3)
    vertices = mesh.vertices + 0.05 * np.random.default_rng(1).standard_normal(mesh.vertices.shape)
    if shape.dimension < 3:
        vertices[:, shape.dimension :] = 0
    found = validity(Dataset(replace(mesh, vertices=vertices)))
    (block,) = geometry(Dataset(replace(mesh, vertices=vertices)))
    corners = evaluate_with_gradients(block.expansion, block.coefficients[:, : shape.dimension], shape.vertices)[0]
    edges = corners[:, :, 1:] - corners[:, :, :1]
    exact = np.linalg.det(edges) / 2**shape.dimension
    assert found.minimum == pytest.approx(exact, rel=1e-13)
    assert found.lower == pytest.approx(exact, rel=1e-13)
    assert found.upper == pytest.approx(exact, rel=1e-13)
    assert (found.error <= 1e-12 * exact).all()


def moved_node():
    """A quadratic tetrahedron whose node (0.5, 0, 0) was moved to (0.5, 0, 0.6)."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    mesh = connected(corners, {Shape.TETRAHEDRON: np.arange(4)[None]}, 3)

    def move(points):
        x, rest = points[:, 0], 1 - points.sum(axis=1)
        return points + np.stack([0 * x, 0 * x, 0.6 * 4 * x * rest], axis=1)

    return Dataset(curved(mesh, move, 3))


def test_the_tetrahedron_that_intersects_itself():
    """With x' the coordinates of the straight element, z = z' + 2.4 x' (1 - x' - y' - z'): det = 1 - 2.4 x'."""
    dataset = moved_node()
    found = validity(dataset)
    assert found.status.tolist() == [ValidityStatus.NOT_POSITIVE]
    for bound, exact in ((found.lower, -1.4), (found.upper, 1), (found.minimum, -1.4), (found.maximum, 1)):
        assert 8 * bound[0] == pytest.approx(exact, abs=1e-13)
    assert found.world[0] == pytest.approx([1, 0, 0], abs=1e-14)

    # the same on its faces: Bernstein coefficients of the powers that don't vanish there
    (block,) = geometry(dataset)
    polynomial = determinant(block.expansion, block.coefficients, 3)
    powers = np.column_stack([polynomial.space.powers, 3 - polynomial.space.powers.sum(axis=1)])
    for vertex, (low, high) in enumerate([(1, 1), (-1.4, 1), (-1.4, 1), (-1.4, 1)]):
        on_face = 8 * polynomial.net[powers[:, vertex] == 0, 0]
        assert (on_face.min(), on_face.max()) == pytest.approx((low, high), abs=1e-13)


def dip(depth, shape=Shape.QUADRILATERAL):
    """One element with det = (x' - 0.3)^2 + (y' - 0.1)^2 - depth, hidden from samples where depth is small."""
    expansion = modified(shape, (4,) * shape.dimension)
    line = np.linspace(-1, 1, 4)
    xi = np.stack(np.meshgrid(*[line] * shape.dimension, indexing="ij"), axis=-1).reshape(-1, shape.dimension)
    x, y = xi[:, 0], xi[:, 1]
    world = np.zeros((3, len(xi)))
    world[0], world[1] = (x - 0.3) ** 3 / 3 + x * ((y - 0.1) ** 2 - depth), y
    if shape.dimension == 3:
        world[2] = xi[:, 2]
    coefficients = np.linalg.solve(values(expansion, xi), world.T).T[None]
    return GeometryBlock(expansion, np.array([7]), coefficients)


def test_products_in_boxes_of_a_lattice_match_those_of_lists(monkeypatch):
    random = np.random.default_rng(3)
    a, b = (
        Polynomials(BernsteinSpace(Shape.HEXAHEDRON, degrees), random.normal(size=(count, 7)), np.zeros(7))
        for degrees, count in (((2, 1, 3), 24), ((1, 2, 0), 6))
    )
    monkeypatch.setattr(determinants, "_CACHED", 200)
    found = a * b
    monkeypatch.setattr(determinants, "_lattice_sums", determinants._sums)
    assert np.allclose(found.net, (a * b).net, rtol=1e-14, atol=1e-14)
    places = random.uniform(-1, 1, (5, 3))
    factors = [bernstein_values(each.space, places) @ each.net for each in (a, b)]
    assert np.allclose(bernstein_values(found.space, places) @ found.net, factors[0] * factors[1], rtol=0, atol=1e-13)


def wavy(count, modes):
    """A block of hexahedra whose determinants vary by terms of high degree alone."""
    random = np.random.default_rng(modes)
    highest = np.polynomial.Chebyshev.basis(modes - 1)

    def bent(xi, along):
        return xi + 0.01 * highest(xi).prod(axis=1, keepdims=True) * along

    blocks = [block_of(Shape.HEXAHEDRON, modes, partial(bent, along=along)) for along in random.normal(size=(count, 3))]
    coefficients = np.concatenate([block.coefficients for block in blocks])
    return GeometryBlock(blocks[0].expansion, np.arange(count), coefficients)


def test_quick_bounds_are_valid_and_need_the_terms_beyond_the_net(monkeypatch):
    block = wavy(3, 7)
    found = enclosures(block.expansion, block.coefficients)
    seen = sampled(block, 3, n=21)
    least, greatest = seen.min(axis=1), seen.max(axis=1)
    assert (found.lower <= least).all()
    assert (greatest <= found.upper).all()
    # attained values lie within the range of the exact net
    net = determinant(block.expansion, block.coefficients, 3).net
    assert (net.min(axis=0) - found.error <= found.minimum).all()
    assert (found.maximum <= net.max(axis=0) + found.error).all()
    monkeypatch.setattr(enclosed_determinants, "_rest", lambda terms: np.zeros(len(terms)))
    without = enclosures(block.expansion, block.coefficients)
    assert (without.lower > least).any() or (without.upper < greatest).any()


def test_quick_bounds_cover_errors_of_the_tangents(monkeypatch):
    block, off = (
        block_of(Shape.HEXAHEDRON, 5, lambda xi: xi @ np.array([[1.0, 0.3, 0.1], [-0.2, 1.0, 0.3], [0, 0.1, 1]])),
        0.05,
    )
    exact = sampled(block, 3)
    columns = tangents(block.expansion, block.coefficients)
    means = np.array([[own.net.mean(axis=0) for own in column] for column in columns]).transpose(2, 1, 0)
    signs = np.sign(np.linalg.inv(means)).transpose(2, 1, 0)
    for turn in (1, -1):
        shifted = [
            [
                Polynomials(own.space, own.net + turn * off * signs[j, i].T, own.error + off)
                for i, own in enumerate(column)
            ]
            for j, column in enumerate(columns)
        ]
        monkeypatch.setattr(enclosed_determinants, "tangents", lambda *_, made=shifted: made)
        found = enclosures(block.expansion, block.coefficients)
        assert (found.lower <= exact.min(axis=1)).all()
        assert (exact.max(axis=1) <= found.upper).all()
        apart = np.maximum(np.abs(found.minimum - exact.min(axis=1)), np.abs(found.maximum - exact.max(axis=1)))
        assert (apart <= found.error).all()
        assert (apart > 0.4 * found.error).all()


@pytest.mark.parametrize("shape", [Shape.QUADRILATERAL, Shape.HEXAHEDRON])
def test_a_dip_between_samples_is_found(shape):
    dataset = Dataset(one_element(shape, shape.dimension))
    found = validity(dataset, [dip(1e-9, shape)])
    assert found.status.tolist() == [ValidityStatus.NOT_POSITIVE]
    assert found.lower[0] == pytest.approx(-1e-9, rel=1e-4)
    assert found.reference[0, :2] == pytest.approx([0.3, 0.1], abs=1e-4)
    assert validity(dataset, [dip(-1e-9, shape)]).status.tolist() == [ValidityStatus.POSITIVE]


def block_of(shape, nodes, world):
    """One element that is mapped by ``world``, from points xi (n, 3) to (n, 3), polynomial of degree nodes - 1."""
    expansion = modified(shape, (nodes,) * shape.dimension)
    line = np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
    eta = np.stack(np.meshgrid(*[line] * shape.dimension, indexing="ij"), axis=-1).reshape(-1, shape.dimension)
    xi = uncollapse(shape, eta)
    places = np.pad(world(xi), ((0, 0), (0, 3 - shape.dimension)))
    return GeometryBlock(expansion, np.array([7]), np.linalg.lstsq(values(expansion, xi), places)[0].T[None])


def flat_valley(direction, depth):
    """A map with det = s^2 + depth, s = direction · xi + 0.3: straight lines along the direction become shorter."""

    def world(xi):
        along = np.array(direction[: xi.shape[1]])
        s = xi @ along + 0.3
        return xi + np.outer(s**3 / 3 + depth * s - s, along / (along @ along))

    return world


def bent_valley(depth):
    """A map with det = s^2 + depth, s = xi2 - xi1^2 / 5 + 0.3."""

    def world(xi):
        s, rest = xi[:, 1] - xi[:, 0] ** 2 / 5 + 0.3, xi[:, 2:]
        return np.column_stack([xi[:, 0], s**3 / 3 + depth * xi[:, 1], rest])

    return world


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (1.0, 0.5, 0.25)])
def test_thin_valleys_are_decided_in_every_direction(shape, direction):
    """The determinant decreases to 1e-10, some hundred times what rounding may do, all along a line or a surface."""
    block = block_of(shape, 4, flat_valley(direction, 1e-10))
    found = validity(Dataset(one_element(shape, shape.dimension)), [block])
    assert found.status.tolist() == [ValidityStatus.POSITIVE]
    assert 9.9e-11 < found.lower[0] <= 1e-10


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.TETRAHEDRON])
@pytest.mark.parametrize(("depth", "status"), [(-1e-10, ValidityStatus.NOT_POSITIVE), (0.0, ValidityStatus.UNDECIDED)])
def test_valleys_below_zero_are_refuted_and_at_zero_undecided(shape, depth, status):
    block = block_of(shape, 4, flat_valley((1.0, 0.5, 0.25), depth))
    found = validity(Dataset(one_element(shape, shape.dimension)), [block])
    assert found.status.tolist() == [status]
    assert found.minimum[0] == pytest.approx(depth, abs=1e-11)
    reason = validity_facts(found)["listed"][0]["reason"]
    assert reason == ("its Jacobian is zero within rounding" if status == ValidityStatus.UNDECIDED else None)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_curved_valleys_are_also_decided(shape):
    block = block_of(shape, 7, bent_valley(1e-10))
    found = validity(Dataset(one_element(shape, shape.dimension)), [block])
    assert found.status.tolist() == [ValidityStatus.POSITIVE]


def test_unbounded_determinants_are_reported(monkeypatch):
    monkeypatch.setattr("elvis.core.validity.validity._VALLEYS", 0)
    block = block_of(Shape.TRIANGLE, 4, flat_valley((1.0, 0.5), 1e-10))
    found = validity(Dataset(one_element(Shape.TRIANGLE, 2)), [block])
    assert found.reason(0) == "the search for its minimum Jacobian ended before a bound was found"


@pytest.mark.parametrize("seed", range(4))
def test_bounds_by_squares_are_below_every_value(seed):
    """Polynomials with and without valleys: no fit, however bad, makes the bound wrong."""
    random = np.random.default_rng(seed)
    net = random.standard_normal((5, 4, 3)) if seed % 2 else random.uniform(0.0, 1.0, (5, 4, 3)) ** 8
    t = np.linspace(0.0, 1.0, 41)
    lines = [[comb(n, i) * t**i * (1 - t) ** (n - i) for i in range(n + 1)] for n in (4, 3, 2)]
    least = np.einsum("ijk,ia,jb,kc->abc", net, *map(np.array, lines)).min()
    bound = lower_bound(net, np.inf)
    assert net.min() <= bound <= least
    assert bound <= descended(net, np.full(3, 0.5)).value


def test_zero_is_neither_proved_nor_refuted():
    found = validity(Dataset(one_element(Shape.QUADRILATERAL, 2)), [dip(0.0)])
    assert found.status.tolist() == [ValidityStatus.UNDECIDED]
    assert abs(found.lower[0]) <= 2 * found.error[0]
    assert found.reference[0, :2] == pytest.approx([0.3, 0.1], abs=1e-5)


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
def test_elements_with_a_vertex_twice_are_never_called_positive(shape):
    mesh = one_element(shape, shape.dimension)
    vertices = mesh.vertices.copy()
    vertices[1] = vertices[0]
    found = validity(Dataset(replace(mesh, vertices=vertices)))
    assert found.status.tolist() == [ValidityStatus.UNDECIDED]
    assert abs(found.minimum[0]) <= found.error[0]


def test_reflected_elements_are_not_positive():
    mesh = mixed_volume()
    found = validity(Dataset(replace(mesh, vertices=mesh.vertices * [1, 1, -1])))
    assert found.count(ValidityStatus.NOT_POSITIVE) == len(found) == 12
    assert (found.upper < 0).all()


def test_maps_given_as_fields_are_checked():
    straight = Dataset(grid(Shape.TETRAHEDRON, 2))
    warp = ripple(0.6, seed=3)
    fields = tuple(approximated(straight, f"map_{'xyz'[i]}", lambda p, i=i: warp(p)[:, i], 3) for i in range(3))
    found = validity(replace(straight, fields=fields, metadata={"GeometryMap": "map_x,map_y,map_z"}))
    assert validity(straight).count(ValidityStatus.POSITIVE) == 48
    assert ids_with(found, ValidityStatus.NOT_POSITIVE)


def test_maps_that_are_not_finite_are_undecided():
    (block,) = geometry(tangled(Shape.TETRAHEDRON, 3))
    coefficients = block.coefficients.copy()
    coefficients[5, 1, 2] = np.nan
    spoiled = GeometryBlock(block.expansion, block.element_ids, coefficients)
    dataset = Dataset(grid(Shape.TETRAHEDRON, 2))
    found, sound = validity(dataset, [spoiled]), validity(dataset, [block])
    assert ids_with(found, ValidityStatus.UNDECIDED) == {int(block.element_ids[5])}
    assert np.isnan(found.lower[5])
    assert np.array_equal(np.delete(found.status, 5), np.delete(sound.status, 5))
    assert found.range is not None


@pytest.mark.parametrize(("shape", "nodes"), [(Shape.TRIANGLE, 4), (Shape.QUADRILATERAL, 3), (Shape.SEGMENT, 4)])
def test_surfaces_and_curves_in_space_have_lengths_and_areas(shape, nodes):
    flat = replace(grid(shape, 2), space=3)
    dataset = Dataset(curved(flat, ripple(0.3, seed=1), nodes))
    found = validity(dataset)
    assert found.count(ValidityStatus.POSITIVE) == len(found)
    samples = np.concatenate([sampled(block, 3) for block in geometry(dataset)])
    assert found.range.lower <= samples.min() * (1 + 1e-12)
    assert samples.max() <= found.range.upper * (1 + 1e-12)
    assert found.range.lower == pytest.approx(samples.min(), rel=0.05)


def test_empty_meshes_have_no_range():
    mesh = grid(Shape.TETRAHEDRON, 1)
    found = validity(Dataset(replace(mesh, domains={0: ()}, composites=())))
    assert (len(found), found.range) == (0, None)
    assert validity_facts(found)["listed"] == []


def test_products_in_bernstein_form_are_products():
    for shape in Shape:
        block = geometry(tangled(shape, 4, cells=1))[0]
        polynomial = determinant(block.expansion, block.coefficients, shape.dimension)
        eta = np.random.default_rng(0).uniform(-1, 1, (20, shape.dimension))
        xi = uncollapse(shape, eta)
        found = polynomial.net.T @ bernstein_values(polynomial.space, xi).T
        expected = sampled_at(block, shape.dimension, xi)
        assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()
