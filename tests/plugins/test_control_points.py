"""Control points of straight elements: the vertices of the mesh, by number."""

import numpy as np
import pytest

from elvis import Dataset, Shape
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.bernstein import bernstein_space, bernstein_values
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.testing import grid
from elvis.plugins.native.maps import Maps

SHAPES = (Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON)


def maps_of(mesh):
    """The only patch of a mesh, and the maps of its elements."""
    (patch,) = patches(Dataset(mesh))
    return patch, Maps.of([patch], bernstein_space(patch.geometry))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.label)
def test_numbered_vertices_are_the_control_points_of_the_maps(shape):
    patch, maps = maps_of(grid(shape, 2))
    nets = maps.points[maps.indices.reshape(len(patch), -1)]
    points = np.random.default_rng(4).uniform(-1, 0, (20, shape.dimension)) / shape.dimension
    basis = bernstein_values(bernstein_space(patch.geometry), points)
    expected = evaluate(patch.geometry, patch.geometry_coefficients, points)
    assert np.abs(np.einsum("pk,nkd->ndp", basis, nets) - expected).max() < 1e-14


def test_numbers_of_tetrahedra_are_not_copied():
    mesh = grid(Shape.TETRAHEDRON, 2)
    _, maps = maps_of(mesh)
    assert np.shares_memory(maps.indices, local_vertices(mesh, Shape.TETRAHEDRON))
