"""Histograms by volume, against closed forms."""

import numpy as np
import pytest

from elvis import Dataset, Shape
from elvis.core.base.errors import ElvisError
from elvis.core.numbers.histogram import histogram
from elvis.core.quantities import Expression
from elvis.core.testing import approximated, curved, grid
from elvis.plugins.runtime.serving import names_of


@pytest.fixture(scope="module")
def stretched():
    """The unit cube, whose cells are stretched so that x = t (1 + t) / 2, with a field x^2."""
    mesh = curved(
        grid(Shape.HEXAHEDRON, 3), lambda x: np.stack([x[:, 0] * (1 + x[:, 0]) / 2, x[:, 1], x[:, 2]], 1), n=3
    )
    return Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: x[:, 0] ** 2, 5),))


def test_shares_are_volumes(stretched):
    """Of all that is below a value v of x^2 in the unit cube the volume is sqrt(v)."""
    found = histogram(stretched, Expression.parse("u", names_of(stretched)), bins=8)
    assert found.shares.sum() == pytest.approx(1.0)
    below = np.cumsum(found.shares)[:-1]
    # a bin takes or leaves whole columns of points, of which there are some 45 along x
    assert below == pytest.approx(np.sqrt(found.ends[1:-1]), abs=0.03)
    assert (found.elements, found.total) == (27, 27)


def test_a_sample_takes_whole_elements_evenly(stretched):
    whole = histogram(stretched, Expression.parse("x", names_of(stretched)))
    part = histogram(stretched, Expression.parse("x", names_of(stretched)), most=14 * 4**3)
    assert whole.elements == 27
    assert (part.elements, part.total) == (14, 27)
    assert part.points == 14 * 4**3
    assert part.shares.sum() == pytest.approx(1.0)


def test_quantities_without_finite_values_are_reported(stretched):
    with pytest.raises(ElvisError, match="no finite value"):
        histogram(stretched, Expression.parse("1 / (x - x)", names_of(stretched)))
