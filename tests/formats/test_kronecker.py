"""Sum factorization of matrices between lattices."""

import numpy as np
import pytest

from elvis.core.mapping.projections import best, conforming
from elvis.core.polynomials import kronecker
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.kronecker import Lattice, RowMap
from elvis.core.shapes import Shape


def shuffled(sizes, rng):
    """A lattice of unequal lines, its points in any order."""
    lines = [np.sort(rng.uniform(-1, 1, size)) for size in sizes]
    points = np.stack([axis.reshape(-1) for axis in np.meshgrid(*lines)], axis=1)
    return points[rng.permutation(len(points))], lines


@pytest.mark.parametrize("sizes", [(7,), (3, 5), (2, 3, 4)])
def test_lattices_are_recognized_in_any_order(sizes):
    points, lines = shuffled(sizes, np.random.default_rng(0))
    found = Lattice.of(points)
    assert found.sizes == sizes
    ordered = points[found.order].reshape(*sizes[::-1], len(sizes))
    for direction, line in enumerate(lines):
        along = np.moveaxis(ordered[..., direction], -1 - direction, -1)
        assert (along == line).all()
    assert len(sizes) == 1 or Lattice.of(points[1:]) is None
    assert len(sizes) == 1 or Lattice.of(points + 0.1 * points[:, ::-1] ** 2) is None


@pytest.mark.parametrize(("change", "is_product"), [(0, True), (1e-11, False)])
def test_a_matrix_of_monomials_is_applied_by_its_factors(monkeypatch, change, is_product):
    """Rows of coefficients of x^i y^j z^k times the matrix of these at points."""
    monkeypatch.setattr(kronecker, "_LEAST", 0)
    rng = np.random.default_rng(1)
    powers = np.stack([axis.reshape(-1) for axis in np.meshgrid(*map(np.arange, (3, 2, 4)))], axis=1)
    powers = powers[rng.permutation(24)]
    points, _ = shuffled((4, 5, 3), rng)
    matrix = np.prod(points[None] ** powers[:, None], axis=2)
    matrix[5, 7] += change
    own = RowMap(matrix, Lattice.of(powers), Lattice.of(points))
    assert (own.factors is not None) == is_product
    rows = rng.normal(size=(50, 24))
    assert np.abs(own(rows) - rows @ matrix).max() < 1e-14 * np.abs(rows).sum(axis=1).max()

    # no result depends on the other rows
    assert np.array_equal(own(rows[7:8]), own(rows)[7:8])


@pytest.mark.parametrize("kind", [best, conforming])
@pytest.mark.parametrize("shape", [Shape.QUADRILATERAL, Shape.HEXAHEDRON])
def test_projections_on_products_have_factors_and_reproduce_their_functions(shape, kind):
    order = 13 if shape is Shape.QUADRILATERAL else 5
    expansion = modified(shape, (order + 1,) * shape.dimension)
    operator = kind(expansion, 1)
    assert operator.fit.factors is not None
    table = values(expansion, operator.points)
    assert np.abs(operator.fit(table.T) - np.eye(table.shape[1])).max() < 1e-12
