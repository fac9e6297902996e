import numpy as np
import pytest

from elvis.core.bounds import ranges
from elvis.core.bounds.ranges import value_range, value_ranges
from elvis.core.data.dataset import Expansion, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import mode_count
from elvis.core.shapes import Shape

A, B, C, PYR = Basis.MODIFIED_A, Basis.MODIFIED_B, Basis.MODIFIED_C, Basis.MODIFIED_PYR_C
BASES = {
    Shape.SEGMENT: (A,),
    Shape.TRIANGLE: (A, B),
    Shape.QUADRILATERAL: (A, A),
    Shape.TETRAHEDRON: (A, B, C),
    Shape.PYRAMID: (A, A, PYR),
    Shape.PRISM: (A, A, B),
    Shape.HEXAHEDRON: (A, A, A),
}
EVERY_SPACE = [(shape, n) for shape in Shape for n in (2, 3, 5, 8)]


def elements(shape, n, count=20):
    expansion = Expansion(shape, BASES[shape], (n,) * shape.dimension)
    return expansion, np.random.default_rng(n).standard_normal((count, mode_count(expansion)))


def grid(shape, n):
    line = np.linspace(-1, 1, n)
    points = np.stack(np.meshgrid(*[line] * shape.dimension, indexing="ij"), axis=-1).reshape(-1, shape.dimension)
    return uncollapse(shape, points)


def test_every_shape_is_here():
    assert set(BASES) == set(Shape)


@pytest.mark.parametrize(("shape", "n"), EVERY_SPACE)
def test_no_value_is_outside_the_range(shape, n):
    expansion, coefficients = elements(shape, n)
    found = value_range([(expansion, coefficients)])
    values = evaluate(expansion, coefficients, grid(shape, 17))
    assert found.lower - 1e-12 <= values.min()
    assert values.max() <= found.upper + 1e-12


@pytest.mark.parametrize(("shape", "n"), EVERY_SPACE)
def test_the_bounds_are_nearly_attained(shape, n):
    found = value_range([elements(shape, n)])
    spread = found.maximum - found.minimum
    assert 0 <= found.upper - found.maximum <= 1e-7 * spread
    assert 0 <= found.minimum - found.lower <= 1e-7 * spread


def test_blocks_of_several_shapes_make_one_range():
    blocks = [elements(shape, 4) for shape in Shape]
    apart = [value_range([block]) for block in blocks]
    together = value_range(blocks)
    spread = together.maximum - together.minimum
    assert together.upper == pytest.approx(max(part.upper for part in apart), abs=1e-7 * spread)
    assert together.lower == pytest.approx(min(part.lower for part in apart), abs=1e-7 * spread)


def test_many_equal_extrema_stay_bounded_in_time_and_certain():
    expansion, coefficients = elements(Shape.HEXAHEDRON, 6, count=1)
    found = value_range([(expansion, np.repeat(coefficients, 3000, axis=0))])
    single = value_range([(expansion, coefficients)])
    assert found.upper >= single.maximum
    assert found.upper < single.maximum + 100 * (single.maximum - single.minimum)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_elements_that_are_not_finite_are_skipped(bad):
    expansion, coefficients = elements(Shape.TRIANGLE, 4)
    spoiled = np.vstack([coefficients, np.full((1, coefficients.shape[1]), bad)])
    assert value_range([(expansion, spoiled)]) == value_range([(expansion, coefficients)])


def test_empty_data_have_no_range():
    expansion, coefficients = elements(Shape.TRIANGLE, 4)
    assert value_range([]) is None
    assert value_range([(expansion, coefficients[:0])]) is None
    assert value_range([(expansion, coefficients * np.nan)]) is None


def test_fourier_directions_are_also_bounded():
    planes = Homogeneous((Basis.FOURIER,), (2.0,), (0, 1, 2, 3))
    expansion = Expansion(Shape.TRIANGLE, (A, B, Basis.FOURIER)[:2], (4, 4), planes)
    coefficients = np.random.default_rng(3).standard_normal((9, mode_count(expansion)))
    found = value_range([(expansion, coefficients)])
    points = np.column_stack([np.tile(grid(Shape.TRIANGLE, 9), (11, 1)), np.repeat(np.linspace(-1, 1, 11), 81)])
    values = evaluate(expansion, coefficients, points)
    assert found.lower <= values.min()
    assert values.max() <= found.upper
    assert found.lower <= found.minimum <= found.maximum <= found.upper


@pytest.mark.parametrize("shape", Shape)
def test_ranges_of_many_fields_are_those_of_each(shape):
    random = np.random.default_rng(7)
    fields = [[]]
    for n in (2, 5):
        for number in range(40):
            expansion, coefficients = elements(shape, n, 1 + number % 5)
            # equal coefficients make boxes that can't be told apart; some elements have no finite values
            values = random.standard_normal(coefficients.shape)
            values = np.round(values) if number % 3 else np.where(random.random(values.shape) < 0.02, np.nan, values)
            fields.append([(expansion, values)] * (1 + number % 2))
    shuffled = [fields[number] for number in random.permutation(len(fields))]
    assert value_ranges(shuffled) == [value_range(blocks) for blocks in shuffled]


def test_fields_with_many_equal_extrema_are_divided(monkeypatch):
    """The boxes of all fields would take memory without end; each field's are limited, as if it were alone."""
    expansion, _ = elements(Shape.QUADRILATERAL, 5, 1)
    # equal at both ends and without other modes: constant in one direction, so that the extrema fill lines of boxes
    waves = np.zeros((30, 5, 5))
    waves[:, :2] = np.random.default_rng(2).standard_normal((30, 1, 5))
    waves = waves.reshape(30, 25)
    sizes = []
    halved = ranges.all_halves
    monkeypatch.setattr(ranges, "_NUMBERS_AT_ONCE", 1 << 12)
    monkeypatch.setattr(ranges, "_room", lambda expansions: 1000)
    monkeypatch.setattr(ranges, "all_halves", lambda nets: sizes.append(len(nets)) or halved(nets))
    found = value_ranges([[(expansion, wave[None])] for wave in waves])
    assert max(sizes) <= ranges._most_boxes(expansion)
    assert found == [value_range([(expansion, wave[None])]) for wave in waves]
