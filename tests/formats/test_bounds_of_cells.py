"""Cells and boxes of searches: parts have the values of wholes, and limits are those that are stated."""

from types import SimpleNamespace

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate, reference_cells
from elvis.core.integrals.levels.boxes import _DOUBTFUL, _LEAST_SIDE, LevelBoxes
from elvis.core.integrals.reference_cells import Piece, _has_constant_slopes
from elvis.core.integrals.targets import Places
from elvis.core.mapping import enclosure
from elvis.core.mapping.enclosure import _Cells, _cut, _halves, _Search, _shared
from elvis.core.mapping.locate import Locator, Status
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.core.validity.largest_scale import TOLERANCE, LargestScale

COUNT = 24
EPS = np.finfo(np.float64).eps


def some_cells(rng):
    """Cells of polynomials of degrees 2, 3 and 1, longest in one direction or another."""
    low = rng.uniform(0, 0.5, (COUNT, 3))
    net = rng.normal(size=(3, 2, 4, 3, COUNT))
    for axis, count in enumerate((3, 4, 2)):
        net += np.multiply.outer(np.linspace(0, 1, count), rng.uniform(0, 9, COUNT)).reshape(count, *(1,) * axis, COUNT)
    return _Cells(np.arange(COUNT), low, low + rng.uniform(0.1, 0.5, (COUNT, 3)), net)


def values_at(cells, places):
    """(3, c) values of the nets of cells at places (c, 3), which may be outside of these."""
    found = cells.net
    for axis in range(3):
        t = (places[:, axis] - cells.low[:, axis]) / (cells.high - cells.low)[:, axis]
        table = line_tables(found.shape[-2] - 1, t)[0]
        found = np.einsum("...ic,ci->...c", found, table)
    return found


def test_parts_of_cells_have_their_polynomials():
    rng = np.random.default_rng(2)
    cells = some_cells(rng)
    ends = np.sort(rng.uniform(-0.1, 1.1, (2, COUNT, 3)), axis=0)
    cut = _cut(cells, *ends)
    width = cells.high - cells.low
    assert cut.low == pytest.approx(cells.low + ends[0] * width)
    assert cut.high == pytest.approx(cells.low + ends[1] * width)
    for part in (cut, *_halves(cells, Shape.HEXAHEDRON)):
        places = part.low + rng.uniform(0, 1, (COUNT, 3)) * (part.high - part.low)
        assert values_at(part, places) == pytest.approx(values_at(cells, places), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.PYRAMID])
def test_cells_are_halved_across_the_longest_lines_of_their_nets_and_apexes_across_their_axis(shape):
    cells = some_cells(np.random.default_rng(4))
    cells.high[::4, 2] = 1.0
    lower, upper = _halves(cells, shape)
    directions = []
    for number in range(COUNT):
        lengths = [np.ptp(cells.net[..., number], axis=3 - i).max() for i in range(3)]
        longest = 2 if shape is Shape.PYRAMID and cells.high[number, 2] >= 1 else int(np.argmax(lengths))
        middle = (cells.low[number] + cells.high[number]) / 2
        expected = np.where(np.arange(3) == longest, middle, cells.high[number])
        assert lower.high[number] == pytest.approx(expected)
        assert upper.low[number] == pytest.approx(np.where(np.arange(3) == longest, middle, cells.low[number]))
        directions.append(longest)
    assert np.array_equal(lower.low, cells.low)
    assert upper.high == pytest.approx(cells.high)
    assert set(directions) == {0, 1, 2}


def test_cells_of_as_many_targets_as_have_few_numbers_are_searched_together(monkeypatch):
    pair = np.array([7, 7, 7, 2, 2, 5, 9, 9, 9, 9])
    cells = _Cells(pair, np.zeros((10, 1)), np.ones((10, 1)), np.ones((3, 2, 10)))
    for most, expected in (
        (6, {2}),
        (12, {2}),
        (17, {2}),
        (18, {2, 5}),
        (35, {2, 5}),
        (36, {2, 5, 7}),
        (60, {2, 5, 7, 9}),
    ):
        monkeypatch.setattr(enclosure, "_MOST_NUMBERS", most)
        first, others = _shared(cells)
        assert set(first.pair.tolist()) == expected
        assert set(others.pair.tolist()) == set(pair.tolist()) - expected


def test_targets_are_given_up_with_tiny_cells_or_too_many_of_them(monkeypatch):
    """A target that is found already may have any number of cells."""
    monkeypatch.setattr(enclosure, "_MOST_CELLS", 2)
    pair = np.array([0, 1, 1, 2, 2, 2, 3, 3, 3])
    width = np.array([0.9, 1.0, 1.1, 9, 9, 9, 9, 9, 9]) * enclosure._SMALLEST
    low = np.zeros((9, 2))
    high = np.stack([width, 0.5 * width], axis=1)
    own = SimpleNamespace(targets=range(4), undecided=np.zeros(4, bool), found=np.arange(4) == 3)
    left = _Search._give_up(own, _Cells(pair, low, high, np.ones((3, 2, 2, 9))))
    assert own.undecided.tolist() == [True, False, True, False]
    assert left.pair.tolist() == [1, 1, 3, 3, 3]


@pytest.mark.parametrize(("part", "is_affine"), [(0.99, True), (1.01, False)])
def test_maps_are_affine_if_slopes_differ_by_rounding_of_the_largest_coefficient(part, is_affine, monkeypatch):
    coefficients = np.array([[[1.0, -8.0], [0.0, 2.0], [0.0, 0.0]]])
    for component, axis in np.ndindex(3, 2):
        slopes = np.ones((1, 3, 4, 2))
        slopes[0, component, 2, axis] += part * 64 * EPS * 8
        monkeypatch.setattr(reference_cells, "evaluate_with_gradients", lambda *_, own=slopes: (None, own))
        assert _has_constant_slopes(None, coefficients, None)[0] == is_affine


@pytest.mark.parametrize(("part", "is_flat"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("away", [0.0, 40.0])
@pytest.mark.parametrize("shape", [Shape.SEGMENT, Shape.QUADRILATERAL])
def test_sides_are_flat_if_normals_differ_by_rounding_of_coordinates(shape, away, part, is_flat, monkeypatch):
    """Curves if their directions do."""
    (patch,) = patches(Dataset(grid(shape, 1)))
    piece = Piece(patch, np.zeros(2, int), shape)
    size = np.abs(patch.geometry_coefficients[0]).max()

    def with_tilt(_patch, rows, points):
        tangents = np.tile(np.eye(3)[:, : shape.dimension], (len(rows), len(points), 1, 1)) * size / max(1.0, away)
        tangents[0, 1, 2, 0] = part * 64 * EPS * max(1.0, away) * tangents[0, 1, 0, 0]
        return SimpleNamespace(jacobians=tangents.reshape(-1, *tangents.shape[2:]))

    monkeypatch.setattr(reference_cells, "Lattice", with_tilt)
    assert piece.is_flat.tolist() == [is_flat, True]


@pytest.mark.parametrize(("part", "is_inside"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("distance", [1e-3, 0.1, 0.5])
@pytest.mark.parametrize("shape", [Shape.SEGMENT, Shape.QUADRILATERAL])
def test_points_are_on_curves_and_surfaces_within_the_requested_distance(shape, distance, part, is_inside):
    """Relative to the diagonal of the element."""
    locator = Locator(patches(Dataset(grid(shape, 1))), distance)
    point = np.where(np.arange(3) < shape.dimension, 0.5, 0.0)
    point[2] = part * distance * np.sqrt(shape.dimension)
    assert (locator.locate(point[None]).status[0] == Status.INSIDE) == is_inside


def test_sides_without_elements_have_no_owner():
    own = SimpleNamespace(_members=(np.array([[0, 2], [2, 3]]),), boundaries={"inlet": np.array([5, 0])})
    assert Places._owners.func(own).tolist() == [1, 0, 2, 1, 0, 0]
    assert not len(Places._owners.func(SimpleNamespace(_members=(), boundaries={"none": np.empty(0, int)})))


def test_boxes_on_levels_are_bisected_unless_they_are_small_or_lost_beyond_doubt():
    """Lost boxes only with one polynomial that may be zero, no further area, and values above rounding."""
    number = np.arange(7)
    several, further = np.where(number == 2, 2, 1), np.where(number == 3, 1e-3, 0.0)
    nets = np.ones((7, 2, 2, 2))
    nets[:, 1, 0, 1] = -_DOUBTFUL * np.where(number == 4, 0.99, 1.01)
    nets[4] *= 0.5
    high = np.full((7, 3), 1.0)
    high[[5, 6], 1] = 2 * _LEAST_SIDE * np.array([1.0, 1.01])
    own = SimpleNamespace(
        nets=nets,
        band=np.ones(7),
        is_lost=number > 0,
        several=several,
        further=further,
        high=0.25 + high,
        low=0.25 + 0 * high,
    )
    assert LevelBoxes.can_be_halved.fget(own)[:, 0].tolist() == [True, True, False, False, False, False, True]


def test_largest_scales_are_certified_within_their_tolerance():
    for part, is_certified in ((0.99, True), (1.01, False)):
        valid = 8.0 * (1 - part * TOLERANCE)
        assert LargestScale(valid, 8.0, "negative").is_certified == is_certified
        assert not LargestScale(valid, 8.0, "undecided").is_certified
    assert LargestScale(3.0, np.inf).is_certified
    assert not LargestScale(0.0, np.inf).is_certified


def test_names_of_boundaries_include_all_sides_if_there_are_any():
    for shape, names in ((Shape.SEGMENT, "domain, region:"), (Shape.TRIANGLE, "domain, all, boundary,")):
        with pytest.raises(ElvisError) as error:
            integrate(Dataset(grid(shape, 2)), "x", "nowhere")
        assert f"there are {names}" in str(error.value)
