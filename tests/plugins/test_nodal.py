"""Nodal data: polynomials given at nodes are those polynomials everywhere."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.converters.shared.unit import UNIT, lattice, unit_basis
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import (
    NodalBlock,
    NodalConverter,
    NodalValues,
    affine_image,
    bernstein,
    component_names,
    native_points,
    nearest_nodes,
    order_of_space,
    space_size,
)
from elvis.plugins.conversion.plugin import Elements

SHAPES = [shape for shape in Shape if shape.dimension]


def inside(shape, count=9):
    """(count, d) points of a reference element."""
    return uncollapse(shape, np.random.default_rng(0).uniform(-1, 1, (count, shape.dimension)))


def unit_of(shape, points):
    """(n, d) the points in coordinates from 0 to 1."""
    return affine_image(points, shape.vertices, UNIT[shape].frame)


def powers_of(order, points):
    """(n, 2) two polynomials of a degree in the coordinates."""
    total = points.sum(axis=1)
    return np.stack([(0.3 + total) ** order, 1 + total * points[:, 0] ** (order - 1)], axis=1)


class Source(NodalConverter):
    """Two elements, the second moved by 10, with the same polynomials as values on both."""

    def __init__(self, shape, order, is_shared=False, weights=None):
        nodes = lattice(shape, order) / order
        functions = unit_basis(shape, order, nodes)
        number = np.arange(2 * len(nodes)).reshape(2, -1)
        places = np.stack([nodes, nodes + 10])
        values = np.tile(powers_of(order, nodes), (2, 1, 1))
        if is_shared:
            geometry = NodalValues(places.reshape(-1, shape.dimension), functions, number, weights)
            own = replace(geometry, values=values.reshape(-1, 2))
        else:
            geometry, own = NodalValues(places, functions), NodalValues(values, functions)
        self.blocks = [Elements(shape, 2, order, key=NodalBlock(geometry))]
        self.add_field("p", component_names("p", 2), [own], is_continuous=True)
        self.add_field("c", ["c"], [NodalValues(np.array([[[2.0]], [[3.0]]]), None)])

    @classmethod
    def opens(cls, paths):
        return False


@pytest.mark.parametrize("is_shared", [False, True])
@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("shape", SHAPES)
def test_polynomials_are_recovered_from_nodes(shape, order, is_shared):
    source, points = Source(shape, order, is_shared), inside(shape)
    (block,) = source.blocks
    unit = unit_of(shape, points)
    assert np.abs(source.positions(block, points) - np.stack([unit, unit + 10])).max() < 1e-12
    first, second, constant = source.fields
    wanted = powers_of(order, unit)
    assert np.abs(source.sample(block, first, points) - wanted[:, 0]).max() < 1e-12 * np.abs(wanted).max()
    second_only = source.sample(block.take(slice(1, 2)), second, points)
    assert second_only.shape == (1, len(points))
    assert np.abs(second_only - wanted[:, 1]).max() < 1e-12 * np.abs(wanted).max()
    assert (source.sample(block.take(np.array([1])), constant, points) == 3).all()
    assert [(each.name, each.order_on(0)) for each in source.fields] == [("p_x", order), ("p_y", order), ("c", 0)]
    assert [each.is_continuous for each in source.fields] == [True, True, False]


def test_larger_weights_pull_towards_their_nodes():
    points = inside(Shape.TRIANGLE)
    plain = Source(Shape.TRIANGLE, 2, True)
    even = Source(Shape.TRIANGLE, 2, True, weights=np.full(12, 3.0))
    uneven = Source(Shape.TRIANGLE, 2, True, weights=np.linspace(1, 2, 12))
    places = [each.positions(each.blocks[0], points) for each in (plain, even, uneven)]
    assert np.abs(places[0] - places[1]).max() < 1e-13
    assert np.abs(places[0] - places[2]).max() > 1e-3
    nodes = native_points(Shape.TRIANGLE, UNIT[Shape.TRIANGLE].frame, lattice(Shape.TRIANGLE, 2) / 2)
    at_nodes = [each.positions(each.blocks[0], nodes) for each in (plain, uneven)]
    assert np.abs(at_nodes[0] - at_nodes[1]).max() < 1e-12


class Doubled(Source):
    """The same with twice the values."""

    def sample(self, block, field, points):
        return 2 * super().sample(block, field, points)


def test_values_at_nodes_stand_for_samples():
    """Not for rational functions, constants, and samples that a subclass changes."""
    source, points = Source(Shape.TRIANGLE, 2), inside(Shape.TRIANGLE)
    block = source.blocks[0].take(np.array([1]))
    field, _, constant = source.fields
    values, to_points = source.at_nodes(block, field)
    assert np.array_equal(to_points(points)(values), source.sample(block, field, points))
    places, to_points = source.at_nodes(block, None)
    found = to_points(points)(places).transpose(0, 2, 1)
    assert np.array_equal(found[..., :2], source.positions(block, points))
    assert not found[..., 2].any()
    assert source.at_nodes(block, constant) is None
    weighted = Source(Shape.TRIANGLE, 2, True, weights=np.linspace(1, 2, 12))
    assert weighted.at_nodes(weighted.blocks[0], None) is None
    doubled = Doubled(Shape.TRIANGLE, 2)
    assert doubled.at_nodes(doubled.blocks[0], doubled.fields[0]) is None
    assert doubled.at_nodes(doubled.blocks[0], None) is not None


def test_a_block_may_miss_a_field():
    source = Source(Shape.SEGMENT, 1, False)
    source.add_field("q", ["q"], [None])
    assert source.fields[-1].order_on(0) is None


@pytest.mark.parametrize("order", [1, 2, 3, 5])
@pytest.mark.parametrize("shape", SHAPES)
def test_lattices_are_unisolvent_and_contain_the_vertices(shape, order):
    nodes = lattice(shape, order)
    assert len(np.unique(nodes, axis=0)) == len(nodes) == space_size(shape, order)
    assert order_of_space(shape, len(nodes), 30) == order
    assert order_of_space(shape, len(nodes), order - 1) is None
    corners = nearest_nodes(nodes, order * UNIT[shape].frame)
    assert (nodes[corners] == order * UNIT[shape].frame).all()


@pytest.mark.parametrize("order", [0, 1, 4])
def test_bernstein_polynomials_sum_to_one_and_match_their_formula(order):
    t = np.linspace(0, 1, 6)
    powers = np.stack([np.arange(order + 1), order - np.arange(order + 1)], axis=1)
    table = bernstein(np.stack([t, 1 - t], axis=1), powers)
    assert np.abs(table.sum(axis=1) - 1).max() < 1e-14
    if order == 4:
        assert np.abs(table[:, 2] - 6 * t**2 * (1 - t) ** 2).max() < 1e-15


def test_tables_of_a_few_points_are_cached(monkeypatch):
    functions = unit_basis(Shape.TRIANGLE, 2, lattice(Shape.TRIANGLE, 2) / 2)
    some, others = inside(Shape.TRIANGLE), inside(Shape.TRIANGLE, 5)
    table = functions.at(some)
    functions.at(others)
    assert np.shares_memory(functions.at(np.array(some)), table)
    assert not np.shares_memory(functions.at(others), table)
    monkeypatch.setattr("elvis.plugins.conversion.nodal._MOST_KEPT", table.size)
    functions.at(inside(Shape.TRIANGLE, 8))
    assert not np.shares_memory(functions.at(some), table)
    assert (functions.at(some) == table).all()
