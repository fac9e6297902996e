"""The inverse mapping: round trips over every shape, strong curvature, and proofs that a point is outside."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.mapping import enclosure, inverse
from elvis.core.mapping.enclosure import excluded, search
from elvis.core.mapping.inverse import Status, invert
from elvis.core.mapping.margins import TOLERANCE, drawn_in, facets, heights, margins
from elvis.core.mapping.newton import Targets
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import determinants, jacobians, positions
from elvis.core.polynomials.collapse import collapse, collapse_jacobian, uncollapse
from elvis.core.shapes import Shape
from elvis.core.testing import (
    curved,
    grid,
    one_element,
    ripple,
    scattered,
)

#: strength of `ripple` that bends an element as far as its Jacobian stays positive, by number of modes
STRONG = {2: 0.4, 3: 0.4, 4: 0.3, 6: 0.3}


@cache
def bent(shape, n, amplitude, space=3):
    """One element, curved, whose Jacobian is positive all over."""
    for seed in range(100):
        mesh = replace(curved(one_element(shape), ripple(amplitude, seed), n), space=space)
        (patch,) = patches(Dataset(mesh))
        points = scattered(shape, 5000, 1)
        sizes = determinants(patch, np.zeros(len(points), int), points)
        if sizes.min() > 0.1 * sizes.max():
            return patch
    raise AssertionError("no valid element found")


# Reference shapes


@pytest.mark.parametrize("shape", list(Shape))
def test_facets_bound_the_shape(shape):
    normals, offsets = facets(shape)
    faces = {1: 2, 2: len(shape.vertices), 3: len(shape.faces)}[shape.dimension]
    assert normals.shape == (faces, shape.dimension)
    at_vertices = heights(shape, shape.vertices)
    assert (at_vertices.min(), at_vertices.max()) == (0, 1)
    if shape.dimension == 3:
        planes = {tuple(np.flatnonzero(column == 0)) for column in at_vertices.T}
        assert planes == {tuple(sorted(face)) for face in shape.faces}
    points = np.random.default_rng(1).uniform(-2, 2, (500, shape.dimension))
    inner = margins(shape, scattered(shape, 500))
    assert inner.min() > -1e-15
    drawn = drawn_in(shape, points, 0.25)
    assert margins(shape, drawn).min() > -0.25 - 1e-12
    near = margins(shape, points) > -0.25
    np.testing.assert_allclose(drawn[near], points[near], rtol=0, atol=1e-15)
    assert offsets.shape == (faces,)


# Round trips


@pytest.mark.parametrize("shape", list(Shape))
@pytest.mark.parametrize("n", STRONG)
@pytest.mark.parametrize("part", [0.0, 0.5, 1.0])
@pytest.mark.sampled(least=28)
def test_reference_points_are_recovered(shape, n, part):
    patch = bent(shape, n, part * STRONG[n])
    points = scattered(shape, 400)
    rows = np.zeros(len(points), int)
    world = positions(patch, rows, points)
    found = invert(patch, rows, world)
    assert (found.status == Status.INSIDE).all()
    assert_residual(patch, rows, found.reference, world)
    np.testing.assert_allclose(found.margin, margins(shape, found.reference))
    np.testing.assert_allclose(found.reference, points, rtol=0, atol=1e-9)


def assert_residual(patch, rows, reference, world):
    size = np.linalg.norm(np.ptp(world, axis=0))
    residual = np.linalg.norm(positions(patch, rows, reference) - world, axis=1)
    assert residual.max() <= 1e-13 * size + 16 * np.finfo(float).eps * np.abs(world).max()


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
@pytest.mark.parametrize("n", STRONG)
@pytest.mark.sampled(least=6)
def test_points_outside_are_not_found(shape, n):
    """Outside is proved: the share of random points found inside is the element's share of the volume."""
    patch = bent(shape, n, STRONG[n])
    rng = np.random.default_rng(2)
    points = rng.uniform(-1.8, 1.8, (8000, 3))
    found = invert(patch, np.zeros(len(points), int), points)
    assert not (found.status == Status.FAILED).any()
    hits = found.status == Status.INSIDE
    assert np.isnan(found.reference[~hits]).all()
    assert_residual(patch, np.zeros(hits.sum(), int), found.reference[hits], points[hits])
    eta = rng.uniform(-1, 1, (8000, 3))
    weights = determinants(patch, np.zeros(8000, int), uncollapse(shape, eta)) * collapse_jacobian(shape, eta)
    volume, error = 8 * weights.mean(), 8 * weights.std() / 89
    share = hits.mean()
    sigma = 3.6**3 * np.sqrt(share * (1 - share) / 8000)
    assert abs(3.6**3 * share - volume) < 5 * np.hypot(error, sigma)


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
@pytest.mark.parametrize("n", [3, 5])
@pytest.mark.sampled
def test_the_search_agrees_with_newton(shape, n):
    patch = bent(shape, n, STRONG.get(n, 0.4))
    points = np.random.default_rng(4).uniform(-1.5, 1.5, (1500, 3))
    rows = np.zeros(len(points), int)
    known = invert(patch, rows, points)
    reference, found, undecided = search(exact_targets(patch, points))
    assert not undecided.any()
    np.testing.assert_array_equal(found, known.status == Status.INSIDE)
    np.testing.assert_allclose(reference[found], known.reference[found], rtol=0, atol=1e-9)


def test_few_targets_are_searched_together_where_cells_have_many_numbers(monkeypatch):
    """With the same results; an element has 375 numbers."""
    patch = bent(Shape.HEXAHEDRON, 5, STRONG.get(5, 0.4))
    points = np.random.default_rng(4).uniform(-1.2, 1.2, (200, 3))
    expected, sizes = search(exact_targets(patch, points)), []
    contracted = enclosure._contracted

    def counted(cells, *others):
        sizes.append(cells.net.size if len(set(cells.pair)) > 1 else 0)
        return contracted(cells, *others)

    monkeypatch.setattr(enclosure, "_contracted", counted)
    monkeypatch.setattr(enclosure, "_MOST_NUMBERS", 20 * 375)
    for own, other in zip(search(exact_targets(patch, points)), expected, strict=True):
        np.testing.assert_array_equal(own, other)
    assert 10 * 375 < max(sizes) <= 20 * 375


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
@pytest.mark.parametrize("n", [3, 5])
@pytest.mark.sampled
def test_only_points_away_from_an_element_are_excluded(shape, n):
    patch, reach = bent(shape, n, STRONG.get(n, 0.4)), 1e-3

    # points of the element, and points beyond its facets by less than the reach, on pyramids in collapsed coordinates
    centre = shape.vertices.mean(axis=0)
    inner = scattered(shape, 600)
    if shape is Shape.PYRAMID:
        outer = uncollapse(shape, (1 + reach) * collapse(shape, inner))
    else:
        outer = centre + (1 + reach) * (inner - centre)
    points = positions(patch, np.zeros(1200, int), np.concatenate([inner, outer]))
    assert not excluded(exact_targets(patch, points), np.full(len(points), reach)).any()

    # all others of a box around it, in which few are next to the element
    points = np.random.default_rng(4).uniform(-1.5, 1.5, (600, 3))
    outside = points[invert(patch, np.zeros(len(points), int), points).status == Status.OUTSIDE]
    assert excluded(exact_targets(patch, outside), np.full(len(outside), reach)).mean() > 0.9


def exact_targets(patch, points):
    precision = np.full(len(points), 1e-12)
    return Targets(patch, np.zeros(len(points), int), points, precision, precision, np.zeros(len(points)))


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
def test_points_just_inside_and_just_outside_are_distinguished(shape):
    patch = bent(shape, 4, 0.3)
    border = scattered(shape, 4000)
    border = border[np.abs(margins(shape, border)) < 1e-15]
    centre = shape.vertices.mean(axis=0)
    rows = np.zeros(len(border), int)
    for distance, expected in [(1e-8, Status.INSIDE), (0, Status.INSIDE), (-1e-8, Status.OUTSIDE)]:
        world = positions(patch, rows, border + distance * (centre - border))
        found = invert(patch, rows, world)
        outside = margins(shape, border + distance * (centre - border)) < -TOLERANCE * 2
        assert (found.status == Status.FAILED).sum() == 0
        if expected is Status.INSIDE:
            assert (found.status == Status.INSIDE).all()
        else:
            assert (found.status[outside] == Status.OUTSIDE).all()


@pytest.mark.parametrize("shape", [s for s in Shape if s not in (Shape.SEGMENT, Shape.QUADRILATERAL, Shape.HEXAHEDRON)])
def test_collapsed_vertices_are_found(shape):
    patch = bent(shape, 4, 0.3)
    top = np.array([v for v in shape.vertices if v[-1] == 1])
    rows = np.zeros(len(top), int)
    found = invert(patch, rows, positions(patch, rows, top))
    assert (found.status == Status.INSIDE).all()
    np.testing.assert_allclose(found.reference, top, rtol=0, atol=1e-9)


@pytest.mark.parametrize("distance", [1e-8, 1e-7, 1e-6])
@pytest.mark.parametrize("space", [2, 3])
def test_points_on_the_line_that_folds_onto_a_vertex_are_outside(space, distance):
    """All of xi_2 = 1 is one point in collapsed coordinates; the map as a polynomial in xi goes on there."""
    patch, rows = bent(Shape.TRIANGLE, 3, 0.2, space), np.zeros(3, int)
    centre = patch.shape.vertices.mean(axis=0)
    for place in np.array([[-1 + distance, 1.0], [-1 - distance, 1.0]]):
        # the image of the place, by the parabola through three points of the element on the line to the centre
        first, second, third = positions(patch, rows, place + np.array([[0.5], [0.75], [1.0]]) * (centre - place))
        image = 6 * first - 8 * second + 3 * third
        np.testing.assert_allclose(positions(patch, rows[:1], place[None])[0], image, rtol=0, atol=1e-13)
        assert invert(patch, rows[:1], image[None]).status == Status.OUTSIDE


@pytest.mark.parametrize("shape", [Shape.SEGMENT, Shape.TRIANGLE, Shape.QUADRILATERAL])
@pytest.mark.parametrize("space", [1, 2, 3])
def test_points_on_curves_and_surfaces_are_found(shape, space):
    if space < shape.dimension:
        return
    patch = bent(shape, 5, 0.3, space)
    points = scattered(shape, 300)
    points = points[margins(shape, points) > 1e-3]
    rows = np.zeros(len(points), int)
    world, derivatives = positions(patch, rows, points), jacobians(patch, rows, points)
    found = invert(patch, rows, world)
    assert (found.status == Status.INSIDE).all()
    np.testing.assert_allclose(found.reference, points, rtol=0, atol=1e-9)

    # a little off the element the foot is found, farther off nothing
    normal = np.linalg.svd(derivatives)[0][:, :, -1]
    near = invert(patch, rows, world + 1e-8 * normal)
    assert (near.status == Status.INSIDE).all()
    np.testing.assert_allclose(near.reference, points, rtol=0, atol=1e-7)
    assert (invert(patch, rows, world + 1e-4 * normal).status == Status.OUTSIDE).all()


def test_a_folded_element_gives_some_root_or_fails():
    """A map that isn't one to one still never gives a wrong answer."""
    fold = curved(one_element(Shape.QUADRILATERAL, 2), lambda x: np.stack([x[:, 0] ** 2, x[:, 1], 0 * x[:, 2]], 1), 3)
    (patch,) = patches(Dataset(fold))
    x = np.linspace(0, 1, 11)
    world = np.stack([x, 0.3 * x, 0 * x], axis=1)
    found = invert(patch, np.zeros(11, int), world)
    assert (found.status[1:] == Status.INSIDE).all()
    np.testing.assert_allclose(found.reference[1:, 0] ** 2, x[1:], rtol=0, atol=1e-12)
    assert found.status[0] in (Status.INSIDE, Status.FAILED)
    assert (invert(patch, np.zeros(1, int), np.array([[-0.1, 0, 0]])).status == Status.OUTSIDE).all()


def test_large_coordinates_cost_digits_but_points_are_found():
    mesh = curved(one_element(Shape.HEXAHEDRON), lambda x: 1e-3 * ripple(0.2)(x) + 1e3, 4)
    (patch,) = patches(Dataset(mesh))
    points = scattered(Shape.HEXAHEDRON, 300)
    rows = np.zeros(300, int)
    found = invert(patch, rows, positions(patch, rows, points))
    assert ((found.status == Status.INSIDE) | (margins(Shape.HEXAHEDRON, points) < 1e-8)).all()
    hits = found.status == Status.INSIDE
    np.testing.assert_allclose(found.reference[hits], points[hits], rtol=0, atol=1e-7)


@pytest.mark.parametrize(("numbers", "pairs"), [(1, 1 << 15), (1 << 21, 7), (1, 7)])
def test_pairs_are_found_in_batches_of_any_size(monkeypatch, numbers, pairs):
    (patch,) = patches(Dataset(curved(grid(Shape.HEXAHEDRON, 7), ripple(0.02), 3)))
    rows = np.random.default_rng(0).integers(0, len(patch), 500)
    reference = np.random.default_rng(1).uniform(-0.9, 0.9, (len(rows), 3))
    monkeypatch.setattr(inverse, "_BATCH", numbers)
    monkeypatch.setattr(inverse, "_PAIRS", pairs)
    found = invert(patch, rows, positions(patch, rows, reference))
    assert (found.status == Status.INSIDE).all()
    assert np.abs(found.reference - reference).max() < 1e-11
