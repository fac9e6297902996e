"""Proofs and notes of searches: granted within a bound, refused beyond it."""

from types import SimpleNamespace

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.differences import overlaps
from elvis.core.integrals import coincident
from elvis.core.mapping.enclosure import _whole_elements
from elvis.core.mapping.newton import Targets
from elvis.core.mapping.patch import patches
from elvis.core.quantities import intervals
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.core.validity import largest_scale

ERROR = 0.1


@pytest.fixture
def square():
    return patches(Dataset(grid(Shape.QUADRILATERAL, 1)))[0]


@pytest.mark.parametrize(("of_bent", "wanted"), [(4.0, 5.0), (6.0, 6.0)])
def test_differences_that_are_not_examined_have_the_bound_of_their_ranges(of_bent, wanted):
    """Pairs with affine maps are not examined without a budget; other pairs have their own bound."""
    pairs = SimpleNamespace(
        _inner=SimpleNamespace(affine=SimpleNamespace(holds=np.ones(3, bool))),
        _composition=SimpleNamespace(degree=np.ones(3), count=1),
        _search=SimpleNamespace(best=SimpleNamespace(value=1.0), budget=0),
        _bent=lambda rows, others, upper: of_bent,
    )
    upper = np.array([3.0, 5.0, 0.5])
    assert overlaps._Pairs.bound(pairs, np.arange(3), np.arange(3), upper) == wanted
    # with a budget, a bound that is no better than the range is not needed
    pairs._search.budget, pairs._bent = 1, lambda rows, others, upper: 0.0
    pairs._bound_of = lambda rows, others: 7.0
    assert overlaps._Pairs.bound(pairs, np.arange(3), np.arange(3), upper) == 5.0
    pairs._bound_of = lambda rows, others: 2.5
    assert overlaps._Pairs.bound(pairs, np.arange(3), np.arange(3), upper) == 2.5


#: bases and exponents, each at an end, and what the powers are between
POWERS = [
    ((-2.0, 1.0), (2.0, 2.0), (0.0, 4.0)),
    ((-2.0, 1.0), (3.0, 3.0), (-8.0, 8.0)),
    ((-2.0, 1.0), (2.0, 3.0), (-8.0, 8.0)),
    ((-2.0, 1.0), (2.5, 3.5), (-(2**3.5), 2**3.5)),
    ((-2.0, 1.0), (0.5, 0.75), (0.0, 1.0)),
    ((-2.0, -1.0), (3.0, 3.0), (-8.0, 8.0)),
    ((-2.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)),
    ((-0.5, 1.0), (-2.0, -2.0), (1.0, np.inf)),
    ((0.0, 2.0), (0.0, 1.0), (0.0, 2.0)),
]


def test_powers_of_negative_numbers_have_the_sign_of_whole_exponents():
    """Exponents are single numbers or intervals, whose bounds also contain powers of 0."""
    bases, exponents, wanted = np.moveaxis(np.array(POWERS), 0, -1)
    with np.errstate(divide="ignore"):
        found = intervals.power(tuple(bases), tuple(exponents))
    assert found[0] == pytest.approx(wanted[0])
    assert found[1] == pytest.approx(wanted[1])


@pytest.mark.parametrize(
    ("beyond", "there", "state"),
    [
        (-1.01, -1.01, "negative"),
        (-0.99, 5.0, "zero"),
        (0.99, 5.0, "zero"),
        (5.0, -0.99, "zero"),
        (1.01, 1.01, "undecided"),
        (5.0, -1.01, "undecided"),
    ],
)
def test_folds_are_stated_by_values_beyond_their_error(beyond, there, state, square):
    """The values are those of the determinant at a root and just beyond it."""
    step = largest_scale.ABOVE * largest_scale.TOLERANCE
    slope = ERROR * (beyond - there) / (2 * step)
    corners = square.geometry_coefficients
    maps = SimpleNamespace(
        expansion=square.geometry,
        places=np.concatenate([0 * corners, corners]),
        moves=np.concatenate([0 * corners, corners]),
        element_ids=[6, 7],
    )
    piece = SimpleNamespace(
        at=lambda row, eta: np.array([ERROR * there - 2 * slope, slope]),
        error_at=lambda scale: np.full(1, ERROR),
        maps=maps,
        rows=np.ones(1, int),
    )
    search = SimpleNamespace(_known=largest_scale._Candidate(2.0, 0, 0, (0.0, 0.0)), _every=[piece])
    found = largest_scale._Search._told(search, 1.5)
    assert (found.state, found.element, found.valid) == (state, 7, 1.5)
    assert found.folded - 2.0 == pytest.approx(2 * step)
    # places are added to that multiple of the moves
    assert found.before[:2] == pytest.approx((0.5, 0.5))
    assert found.after[:2] == pytest.approx((0.5 + found.folded / 2,) * 2)


def zero_sides(square, function):
    """The sides of a square on which a function of the reference coordinates is zero within the error."""

    def values(patch, rows, points):
        return np.tile(ERROR * function(points[..., 0], (points[..., 1] + 1) / coincident._INWARDS), (len(rows), 1))

    within = lambda patch, rows: np.full(len(rows), ERROR)  # noqa: E731
    return list(coincident._zero_sides(3, square, np.arange(4)[None], 2, values, np.inf, within))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("on", "inside", "is_zero", "has_sign"),
    [
        ((0.99, 0.99), (2.0, 2.0), True, True),
        ((1.01, 1.01), (2.0, 2.0), False, True),
        ((0.0, 1.4), (3.0, 3.0), False, True),
        ((0.0, 0.0), (1.01, 1.01), True, True),
        ((0.0, 0.0), (0.99, 0.99), True, False),
        ((0.0, 0.0), (0.5, 3.0), True, False),
    ],
)
def test_sides_are_zero_within_the_bound_and_have_a_sign_inside_beyond_it(on, inside, is_zero, has_sign, sign, square):
    """A function with these values at both ends of the lower side, and next to it."""

    def function(x, y):
        start, end = (np.interp(x, [-1, 1], own) for own in (on, inside))
        return sign * (start + (end - start) * y)

    found = zero_sides(square, function)
    assert len(found) == is_zero
    for own in found:
        assert own.sign.tolist() == [sign * has_sign]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("power", "is_simple"), [(1.5, True), (1.6, False)])
def test_zeros_are_simple_if_values_grow_at_most_threefold_at_twice_the_distance(power, is_simple, sign, square):
    """The root of 3 to the base 2 is 1.585."""
    (found,) = zero_sides(square, lambda x, y: sign * np.maximum(y, 0.0) ** power)
    assert found.is_simple.tolist() == [is_simple]
    # at all points
    (found,) = zero_sides(square, lambda x, y: np.maximum(y, 0.0) ** np.where(x > 0, 1.6, 1.5))
    assert found.is_simple.tolist() == [False]


def test_cells_of_whole_elements_are_larger_by_what_counts_as_inside(square):
    """The map of a unit square, relative to a point, at the ends of the cell."""
    points = np.array([[0.5, 0.0, 0.0], [0.0, 0.25, 0.0]])
    targets = Targets(square, np.zeros(2, int), points, *np.zeros((3, 2)))
    reach = np.array([0.1, 0.2])
    cells = _whole_elements(targets, reach)
    assert np.array_equal(cells.low, np.tile(-reach[:, None], 2))
    assert np.array_equal(cells.high, np.tile(1 + reach[:, None], 2))
    for axis in range(2):
        net = cells.net[axis].reshape(-1, 2)
        assert net.min(axis=0) == pytest.approx(-reach - points[:, axis])
        assert net.max(axis=0) == pytest.approx(1 + reach - points[:, axis])
