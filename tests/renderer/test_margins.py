"""Margins of all shapes in kernels: twice the smallest height over the facets."""

import numpy as np
import pytest

from elvis.core.mapping.margins import margins
from elvis.core.shapes import Shape

#: in the order of native_hexahedron_check.slang
SHAPES = [shape for shape in Shape if shape.dimension > 1]
HOMOGENEOUS = [Shape.TRIANGLE, Shape.QUADRILATERAL]


def test_margins_are_twice_the_smallest_height_over_facets(functions):
    """Along homogeneous directions the planes -1 and 1 are further facets."""
    points = np.random.default_rng(3).uniform(-1.6, 1.6, (400, 3))
    found = functions("native_hexahedron")(points, 4 * (len(SHAPES) + len(HOMOGENEOUS))).reshape(len(points), -1, 4)
    for number, shape in enumerate(SHAPES + HOMOGENEOUS):
        margin = 2 * margins(shape, points[:, : shape.dimension])
        if number >= len(SHAPES):
            margin = np.minimum(margin, 1 - np.abs(points[:, 2]))
        assert found[:, number, 0] == pytest.approx(margin, rel=1e-14, abs=1e-14)
        assert 10 < (margin > 0).sum() < len(points)
        centre = found[0, number, 1 : 1 + shape.dimension]
        assert margins(shape, centre[None])[0] > 0.1
