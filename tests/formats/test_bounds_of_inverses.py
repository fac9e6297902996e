"""Models of the inverses of maps: their errors against points whose reference coordinates are known."""

import numpy as np
import pytest

from elvis.core.chebyshev_models import inverse_maps as inverse_module
from elvis.core.chebyshev_models.inverse_maps import (
    aliased,
    at_points,
    horner_order,
    inverse_maps,
    largest_sum,
    power_places,
    to_powers,
)
from elvis.core.chebyshev_models.model_boxes import ShapeFacets
from elvis.core.chebyshev_models.series import coefficients_of, nodes
from elvis.core.mapping.margins import facets
from elvis.core.shapes import Shape

COUNT = 7
SHAPES = (Shape.HEXAHEDRON, Shape.PRISM, Shape.TETRAHEDRON)


def inside_of(shape):
    return ShapeFacets(np.column_stack(facets(shape)))


def bent_map(rng, bend, rough=0.0):
    """Series (1, 3, COUNT three times) of a map of a cube that bends, and whose high terms may be rough."""
    line = nodes(COUNT)
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    angle, radius = bend * x + 0.3 * bend * z, 1.0 + 0.5 * bend * y
    values = np.stack([radius * np.sin(angle), radius * np.cos(angle), bend * (z + 0.2 * bend * x * y)])
    values *= np.array([1.0 / bend, 2.0 / bend, 1.0 / bend])[:, None, None, None]
    series = coefficients_of(np.einsum("ij,jcba->icba", np.eye(3) + 0.3 * rng.uniform(-1, 1, (3, 3)), values))
    return (series + rough * rng.uniform(-1, 1, series.shape))[None]


def at(series, points):
    """(m, n) values of series (m, COUNT three times) at points (n, 3)."""
    x, y, z = (np.polynomial.chebyshev.chebvander(points[:, axis], COUNT - 1) for axis in range(3))
    return np.einsum("mcba,na,nb,nc->mn", series, x, y, z, optimize=True)


def points_in(rng, shape, count=4000):
    points = np.concatenate([rng.uniform(-1, 1, (count, 3)), rng.choice((-1.0, 0.0, 1.0), (count // 8, 3))])
    return points[(points @ facets(shape)[0].T + facets(shape)[1]).min(axis=1) >= 0.0]


def misses_of(models, series, points):
    """Largest error of each model at the points in its domain, and how many models hold each point."""
    places = at(series[0], points).T
    misses, held = np.zeros(len(models)), np.zeros(len(points), int)
    for k in range(len(models)):
        y = (places - models.origin[k]) @ models.axes[k].T
        within = np.abs(y).max(axis=1) <= 1.0
        found = at_points(to_powers(models.series[k : k + 1]), y[within].T[None])[0].T
        truth = (points[within] - models.centre[k]) / models.half[k]
        misses[k] = np.abs(found - truth).max(initial=0.0)
        held += within
    return misses, held


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("rough", [0.0, 3e-7])
@pytest.mark.parametrize("halvings", [0, 1])
def test_inverses_are_within_their_errors_at_all_points_of_the_element(shape, rough, halvings):
    rng = np.random.default_rng(4)
    series = bent_map(rng, (0.012, 0.05)[halvings], rough)
    models = inverse_maps(series, inside_of(shape), np.array([0]), halvings)
    misses, held = misses_of(models, series, points_in(rng, shape))
    assert np.isfinite(models.error).all()
    assert (held > 0).all()
    assert (misses <= models.error).all()
    # without rough terms, the reserve for rounding is most of the error
    assert misses.max() > 0.02 * models.error.max() or rough == 0.0


def test_sums_of_magnitudes_only_count_in_elements():
    """A box that is halfway outside of the cube, and a series that is large outside."""
    series = np.zeros((1, 1, COUNT, COUNT, COUNT))
    series[0, 0, 0, 0, :2] = 1.0, 1.0
    bound = largest_sum(series, np.array([[1.0, 0.0, 0.0]]), np.array([1.0]))
    assert 1.0 <= bound[0] < 1.6
    assert largest_sum(series, np.zeros((1, 3)), np.ones(1))[0] >= 2.0


def test_folded_and_undefined_maps_have_no_models():
    rng = np.random.default_rng(1)
    series = np.concatenate([bent_map(rng, 0.05), bent_map(rng, 0.05), bent_map(rng, 2.5)])
    series[1, 0, 2, 1, 1] = np.nan
    models = inverse_maps(series, inside_of(Shape.HEXAHEDRON), np.arange(3), 1)
    assert np.isfinite(models.error[models.element == 0]).all()
    assert np.isinf(models.error[models.element > 0]).all()


def test_models_of_some_elements_are_those_of_all():
    rng = np.random.default_rng(2)
    series = np.concatenate([bent_map(rng, bend) for bend in (0.03, 0.05, 0.04)])
    inside = inside_of(Shape.HEXAHEDRON)
    models, some = (inverse_maps(series, inside, rows, 1) for rows in (np.arange(3), np.array([1])))
    assert np.allclose(models.part(models.element == 1).error, some.error, rtol=1e-9)
    assert np.allclose(models.part(models.element == 1).series, some.series, atol=1e-12)


def test_sums_of_magnitudes_are_bounded_closely():
    rng = np.random.default_rng(3)
    series = rng.normal(size=(5, 3, COUNT, COUNT, COUNT))
    corners = np.array(np.meshgrid(*[np.array((-1.0, 1.0))] * 3)).reshape(3, -1).T
    points = np.concatenate([corners, rng.uniform(-1, 1, (3000, 3))])
    sums = np.array([np.abs(at(own, points)).sum(axis=0).max() for own in series])
    bounds = largest_sum(series, np.zeros((5, 3)), np.ones(5))
    assert (sums <= bounds).all()
    assert (bounds <= 2.0 * sums).all()


def test_interpolants_are_within_the_error_of_aliasing():
    """1 / (c - x - y - z), scaled so that its largest magnitude on the ellipses is 1."""
    count, axis = 6, 1.6
    line, rng = nodes(count), np.random.default_rng(5)
    pole = 3.0 * axis + 0.05
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    series = coefficients_of((pole - 3.0 * axis) / (pole - x - y - z))
    points = np.concatenate([np.ones((1, 3)), rng.uniform(-1, 1, (2000, 3))])
    x, y, z = (np.polynomial.chebyshev.chebvander(points[:, k], count - 1) for k in range(3))
    found = np.einsum("cba,na,nb,nc->n", series, x, y, z)
    miss = np.abs(found - (pole - 3.0 * axis) / (pole - points.sum(axis=1))).max()
    assert miss <= aliased(axis, count)
    # a product of peaks in each direction comes nearer than a sum
    assert aliased(axis, count) < 40.0 * aliased(axis, count + 1)


def test_powers_and_their_order_give_values_of_series():
    rng = np.random.default_rng(6)
    series = rng.normal(size=(2, 1, 4, 4, 4)) * (power_sum(4) <= 3)
    points = rng.uniform(-1, 1, (2, 3, 9))
    powers = to_powers(series)
    places = power_places(3)
    direct = np.array([powers[k, 0] @ np.prod(points[k, ::-1].T[None] ** places[:, None], axis=2) for k in range(2)])
    basis = [[np.polynomial.chebyshev.chebvander(points[k, axis], 3) for axis in range(3)] for k in range(2)]
    truth = [np.einsum("cba,na,nb,nc->n", series[k, 0], *basis[k]) for k in range(2)]
    assert np.allclose(at_points(powers, points)[:, 0], truth)
    assert np.allclose(direct, truth)
    order = places[horner_order(3)]
    assert (np.diff(order @ (100, 10, 1)) < 0).all()


def power_sum(count):
    k = np.arange(count)
    return k[:, None, None] + k[:, None] + k


def test_bends_are_the_largest_differences_from_the_identity_over_all_boxes():
    """A straight map with one bent term bends most at a corner of its box."""
    rng = np.random.default_rng(5)
    own = np.zeros((6, 3, 3, 3, 3))
    for axis, place in enumerate([(0, 0, 1), (0, 1, 0), (1, 0, 0)]):
        own[(slice(None), axis, *place)] = rng.uniform(0.9, 1.1, 6)
    own[:, 0, 0, 1, 1] = rng.uniform(-0.3, 0.3, 6)
    axes = inverse_module.MARGIN * np.eye(3) * rng.uniform(0.9, 1.1, (6, 1, 1))
    found = inverse_module._bends(own, axes, 3)
    bend = np.abs(own[:, 0, 0, 1, 1])
    for element in range(2):
        boxes = slice(3 * element, 3 * element + 3)
        factors = axes[boxes, 0, 0][:, None] / inverse_module.MARGIN
        straight = [own[boxes, 0, 0, 0, 1], own[boxes, 1, 0, 1, 0], own[boxes, 2, 1, 0, 0]]
        rows = [np.abs(factors * slope - 1) for slope in straight]
        rows[0] = rows[0] + 2 * np.abs(factors) * bend[boxes]
        assert found[boxes] == pytest.approx(np.max(rows, axis=(0, 2)), rel=1e-9)
