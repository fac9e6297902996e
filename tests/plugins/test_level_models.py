"""Series of native elements in boxes, from which isosurfaces of quantities are drawn."""

import numpy as np
import pytest

from elvis.core.chebyshev_models.series import ROOM
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.shapes import Shape
from elvis.plugins.native import level_models
from elvis.plugins.native.level_models import series_of

#: boxes by their centre and half side, up to the corner of a cube that lies farthest from a simplex
BOXES = (((-0.5, -0.5, -0.5), 0.5), ((-0.25, -0.75, 0.25), 0.25), ((0.0, 0.0, 0.0), 1.0))


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON])
@pytest.mark.parametrize(("centre", "half"), BOXES)
def test_series_of_boxes_are_within_their_errors(shape, centre, half):
    """Values of Bernstein polynomials of order 7, far from zero, between points of the lattice."""
    rng = np.random.default_rng(3)
    degrees = {Shape.TETRAHEDRON: (7,), Shape.PRISM: (7, 7)}.get(shape, (7, 7, 7))
    space = BernsteinSpace(shape, degrees)
    nets = 40.0 + rng.uniform(-1, 1, (2, space.count))
    found, off = series_of(space, nets, 8, np.array(centre), half)
    x = rng.uniform(-1, 1, (100, 3))
    table = bernstein_values(space, np.array(centre) + half * ROOM * x)
    exact = table @ (nets.T - 40.0) + 40.0
    vander = np.polynomial.chebyshev.chebvander(x, 7)
    values = np.einsum("ecba,na,nb,nc->ne", found, *np.moveaxis(vander, 1, 0))
    sums = 1e-15 * (np.abs(table).sum(axis=1) * np.abs(nets - 40.0).max() + 40.0)
    assert (np.abs(values - exact).max(axis=0) <= off + sums.max()).all()
    # inside, errors are rounding, which the corners of a cube around a simplex amplify
    assert half == 1.0 or (off < 1e-9).all()
    negative, same = series_of(space, -nets, 8, np.array(centre), half)
    assert np.array_equal(negative, -found)
    assert np.array_equal(same, off)


def test_rounding_of_sums_counts_in_errors_of_series():
    from elvis.core.chebyshev_models.expression_models import BoxLeaves, sum_rounding

    series, none = np.zeros((1, 3, 4, 4, 4)), np.zeros((1, 3))
    series[0, 0, 0, 0, :2] = 3.0, -2.0
    for own in (0.0, 1e-13):
        found = BoxLeaves((), (), series, none, np.full((1, 3), own), none[:, None], 1.0, 6).value(0)
        assert found.remainder[0] == pytest.approx([own + 5.0 * sum_rounding(4)], rel=1e-9, abs=0)


def test_the_mean_of_values_is_rounded_in_series(monkeypatch):
    """Constants of either sign have nothing but their mean, which is added in the end."""
    monkeypatch.setattr(level_models, "UNIT", 2.0**-11)
    space = BernsteinSpace(Shape.HEXAHEDRON, (1, 1, 1))
    found, off = series_of(space, np.repeat([[3.0], [-3.0]], 8, axis=1), 3, np.zeros(3), 0.5)
    assert found[:, 0, 0, 0].tolist() == [3.0, -3.0]
    assert off.tolist() == [2 * 3.0 * 2.0**-11] * 2
