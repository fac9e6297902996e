"""Sum factorization of matrices between lattices."""

from functools import reduce

import numpy as np
import pytest

from elvis.core.mapping.projections import best, conforming
from elvis.core.polynomials import kronecker
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.kronecker import Lattice, RowMap, lagrange_factors
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import NodalBasis


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
    points, lines = shuffled((4, 5, 3), rng)
    matrix = np.prod(points[None] ** powers[:, None], axis=2)
    matrix[5, 7] += change

    def factors(source, target):
        assert all(np.array_equal(own, line) for own, line in zip(target.lines, lines, strict=True))
        return [line ** np.arange(count)[:, None] for line, count in zip(target.lines, source.sizes, strict=True)]

    own = RowMap(matrix, Lattice.of(powers), Lattice.of(points), factors)
    assert (own.factors is not None) == is_product
    rows = rng.normal(size=(50, 24))
    assert np.abs(own(rows) - rows @ matrix).max() < 1e-14 * np.abs(rows).sum(axis=1).max()

    # no result depends on the other rows
    assert np.array_equal(own(rows[7:8]), own(rows)[7:8])


def test_factors_of_nodes_are_lagrange_polynomials(monkeypatch):
    """They give back the values of a polynomial at nodes in any order."""
    monkeypatch.setattr(kronecker, "_LEAST", 0)
    rng = np.random.default_rng(2)
    nodes, _ = shuffled((5, 4, 3), rng)
    points, _ = shuffled((3, 6, 2), rng)
    basis = NodalBasis(Shape.HEXAHEDRON, 2, shuffled((3, 3, 3), rng)[0])
    assert basis.to_points(points).factors is not None

    def polynomial(x):
        return x[:, 0] ** 4 - 2 * x[:, 1] ** 3 * x[:, 2] ** 2 + x[:, 0] ** 2 * x[:, 1]

    found = Lattice.of(nodes), Lattice.of(points)
    product = reduce(np.kron, lagrange_factors(*found)[::-1])
    values = polynomial(nodes)[found[0].order] @ product
    assert np.abs(values - polynomial(points)[found[1].order]).max() < 1e-11


@pytest.mark.parametrize("kind", [best, conforming])
@pytest.mark.parametrize("shape", [Shape.QUADRILATERAL, Shape.HEXAHEDRON])
def test_projections_on_products_have_factors_and_reproduce_their_functions(shape, kind):
    order = 13 if shape is Shape.QUADRILATERAL else 5
    expansion = modified(shape, (order + 1,) * shape.dimension)
    operator = kind(expansion, 1)
    assert operator.fit.factors is not None
    table = values(expansion, operator.points)
    assert np.abs(operator.fit(table.T) - np.eye(table.shape[1])).max() < 1e-12

    # also beyond the functions of the expansion they do what the whole matrix does
    samples = np.cos(3.0 * operator.points.sum(axis=1))[None]
    assert np.abs(operator.fit(samples) - samples @ operator.matrix).max() < 1e-12


@pytest.mark.parametrize("least", [0, 1 << 30], ids=["factors", "matrices"])
def test_maps_after_one_another_are_one_map(monkeypatch, least):
    """The first map takes nodes to points, the second one points to coefficients."""
    monkeypatch.setattr(kronecker, "_LEAST", least)
    rng = np.random.default_rng(3)
    fit = conforming(modified(Shape.HEXAHEDRON, (4, 4, 4)))
    basis = NodalBasis(Shape.HEXAHEDRON, 3, shuffled((4, 4, 4), rng)[0])
    to_points = basis.to_points(fit.points)
    joined = to_points.then(fit.fit)
    assert (joined.factors is not None) == (least == 0)
    assert to_points.then(fit.fit) is joined
    rows = rng.normal(size=(20, 64))
    expected = fit.fit(to_points(rows))
    assert np.abs(joined(rows) - expected).max() < 1e-12 * np.abs(expected).max()

    # one of them has no factors
    dense = RowMap(to_points.matrix, Lattice.of(basis._nodes), Lattice.of(fit.points), lambda source, target: [])
    assert np.abs(dense.then(fit.fit)(rows) - expected).max() < 1e-12 * np.abs(expected).max()
