"""Margins of all shapes in kernels, twice the smallest height over the facets, and the facets found from these."""

import numpy as np
import pytest

from elvis.core.mapping.margins import facets, heights, margins
from elvis.core.shapes import Shape

#: in the order of native_hexahedron_check.slang
SHAPES = [shape for shape in Shape if shape.dimension > 1]
HOMOGENEOUS = [Shape.TRIANGLE, Shape.QUADRILATERAL]


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(3).uniform(-1.6, 1.6, (400, 3))


@pytest.fixture(scope="module")
def found(functions, points):
    """Margins and centres (n, shapes, 4), and polynomials on sides (n, 6, 2, 4) by two layers and by all."""
    count = 4 * (len(SHAPES) + len(HOMOGENEOUS))
    coefficients = np.random.default_rng(5).normal(size=(len(points), 27))
    found = functions("native_hexahedron")(points, count + 48, coefficients=coefficients)
    return found[:, :count].reshape(len(points), -1, 4), found[:, count:].reshape(len(points), 6, 2, 4)


def test_margins_are_twice_the_smallest_height_over_facets(points, found):
    """Along homogeneous directions the planes -1 and 1 are further facets."""
    for number, shape in enumerate(SHAPES + HOMOGENEOUS):
        margin = 2 * margins(shape, points[:, : shape.dimension])
        if number >= len(SHAPES):
            margin = np.minimum(margin, 1 - np.abs(points[:, 2]))
        assert found[0][:, number, 0] == pytest.approx(margin, rel=1e-14, abs=1e-14)
        assert 10 < (margin > 0).sum() < len(points)
        centre = found[0][0, number, 1 : 1 + shape.dimension]
        assert margins(shape, centre[None])[0] > 0.1


def test_polynomials_on_sides_follow_from_two_layers_of_coefficients(found):
    """Values and all derivatives, also across the side."""
    sides, cube = np.moveaxis(found[1], 2, 0)
    assert sides == pytest.approx(cube, rel=1e-11, abs=1e-11)
    assert np.abs(cube).min(axis=2).max() > 1


def test_facets_are_found_from_margins_along_lines(functions):
    """The facet through which a line from the centre leaves; none where another one is as near as the step."""
    count, step = 400, 1 / 1024
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(count, 3))
    normals, offsets = facets(Shape.TETRAHEDRON)
    # some lines leave next to an edge, by less and by more than a step
    centre = np.full(3, -0.5)
    edges = Shape.TETRAHEDRON.vertices[[0, 1, 2, 0]] * 0.4 + Shape.TETRAHEDRON.vertices[[1, 2, 3, 3]] * 0.6
    directions[::4] = edges[rng.integers(4, size=count // 4)] - centre + 10.0 ** rng.uniform(-5, -1, (count // 4, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    kernel, lines = functions("line_shape"), np.array([count], np.uint32)
    given = {"directions": directions, "facets": np.full((count, 4), np.nan)}
    found = kernel.results(count, ["facets"], item_count=lines, **given)["facets"].reshape(count, 4)

    heights_of_centre, slopes = normals @ centre + offsets, directions @ normals.T
    with np.errstate(divide="ignore"):
        ends = np.where(slopes < 0, -heights_of_centre / slopes, np.inf)
    own, place = ends.argmin(axis=1), centre + (ends.min(axis=1) + 4 * step)[:, None] * directions
    nearby = place[:, None] + step * np.concatenate([np.eye(3), -np.eye(3)])
    is_alone = (heights(Shape.TETRAHEDRON, nearby).argmin(axis=2) == own[:, None]).all(axis=1)
    expected = np.where(is_alone[:, None], 2 * np.column_stack([normals, offsets])[own], 0.0)
    assert found == pytest.approx(expected, abs=1e-9)
    assert 20 < is_alone.sum() < count - 20
    assert len(set(own[is_alone])) == 4
