"""Collapsed coordinates: there and back, volume, and the guard at collapsed vertices."""

import numpy as np
import pytest

from elvis.core.polynomials.collapse import collapse, collapse_jacobian, uncollapse
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape

VOLUMES = {
    Shape.SEGMENT: 2,
    Shape.TRIANGLE: 2,
    Shape.QUADRILATERAL: 4,
    Shape.TETRAHEDRON: 4 / 3,
    Shape.PYRAMID: 8 / 3,
    Shape.PRISM: 4,
    Shape.HEXAHEDRON: 8,
}


def inside(shape, count=200, seed=0):
    return np.random.default_rng(seed).uniform(-0.99, 0.99, (count, shape.dimension))


def test_every_shape_is_listed():
    assert set(VOLUMES) == set(Shape)


@pytest.mark.parametrize("shape", Shape)
def test_round_trip(shape):
    eta = inside(shape)
    assert np.abs(collapse(shape, uncollapse(shape, eta)) - eta).max() < 1e-12


@pytest.mark.parametrize("shape", Shape)
def test_the_jacobian_is_the_determinant_of_the_derivative(shape):
    eta, step = inside(shape), 1e-4
    columns = [
        (uncollapse(shape, eta + d) - uncollapse(shape, eta - d)) / (2 * step) for d in step * np.eye(shape.dimension)
    ]
    assert np.linalg.det(np.stack(columns, axis=2)) == pytest.approx(collapse_jacobian(shape, eta), abs=1e-10)


@pytest.mark.parametrize("shape", Shape)
def test_the_jacobian_integrates_to_the_volume(shape):
    z, w = gauss(3)
    grid = np.stack(np.meshgrid(*[z] * shape.dimension), axis=-1).reshape(-1, shape.dimension)
    weights = np.stack(np.meshgrid(*[w] * shape.dimension), axis=-1).reshape(-1, shape.dimension).prod(axis=1)
    assert collapse_jacobian(shape, grid) @ weights == pytest.approx(VOLUMES[shape], rel=1e-14)


@pytest.mark.parametrize("shape", Shape)
def test_vertices_map_to_finite_points_and_back(shape):
    eta = collapse(shape, shape.vertices)
    assert np.isfinite(eta).all()
    assert np.abs(uncollapse(shape, eta) - shape.vertices).max() < 1e-15
