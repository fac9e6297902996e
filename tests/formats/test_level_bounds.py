"""Bounds on surfaces, on parts that they cut out and along kinks: against closed forms, and without a term."""

from math import exp, pi, sinh
from types import SimpleNamespace

import numpy as np
import pytest
from warps import bubble

from elvis.core.data.dataset import Dataset
from elvis.core.integrals import graph_discs, integrate, touching
from elvis.core.integrals.cut_expansions import Expansion
from elvis.core.integrals.graph_discs import RHOS, PartDiscs, graph_parts
from elvis.core.integrals.kinks import branches
from elvis.core.integrals.levels import discs as level_discs
from elvis.core.integrals.levels import error as level_error
from elvis.core.integrals.levels.boxes import LevelBoxes
from elvis.core.integrals.taylor import BENDS, multiplied, slope, straightened, taylor
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.quantities.expression import Expression
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field

BODIES = [shape for shape in Shape if shape.dimension > 1]
C = 0.37
#: integrands with kinks and their integrals over the unit square or cube
KINKS = {
    "abs(x-0.37)": (C * C + (1 - C) ** 2) / 2,
    "sign(u-0.37)": 1 - 2 * C,
    "exp(-abs(x-0.37))": 2 - exp(-C) - exp(C - 1),
    "max(0.3-abs(u-0.37),0)": 0.09,
    "min(u^2,0.1369)": C**3 / 3 + (1 - C) * C**2,
}


def is_true(dataset, truth, text, **options):
    """Whether an integral is off by no more than its error, which is a bound."""
    (row,) = integrate(dataset, text, **options)
    assert row.kind == "bound"
    return abs(row.value - truth) <= row.error + 4e-16 * abs(truth)


@pytest.mark.sampled(least=3)
@pytest.mark.parametrize("text", KINKS)
@pytest.mark.parametrize("shape", BODIES)
def test_integrands_are_cut_along_their_kinks(shape, text):
    dataset = with_field(grid(shape, 1), lambda points: points[:, 0], 2)
    (row,) = integrate(dataset, text, error=1e-3)
    assert row.kind == "bound"
    assert abs(row.value - KINKS[text]) <= row.error < 1.1e-3


def test_kinks_inside_of_kinks_and_side_by_side():
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    assert is_true(dataset, (C * C + (1 - C) ** 2) / 2 * 0.25, "abs(x-0.37)*abs(y-0.5)", error=1e-2)
    assert is_true(dataset, pi / 2 * 1e-4, "max(0.01-(x-0.37)^2-(y-0.41)^2,0)", error=1e-3)
    nested = branches(Expression.of(dataset, "max(abs(x-0.37),y)").root)
    assert len(nested) == 4
    assert [branch.root for branch in branches(Expression.of(dataset, "abs(sin(x))").root)] == [
        Expression.of(dataset, "abs(sin(x))").root
    ]


@pytest.mark.sampled(least=3)
@pytest.mark.parametrize("is_bent", [False, True])
@pytest.mark.parametrize("shape", BODIES)
def test_spheres_have_bounds(shape, is_bent):
    mesh, r = grid(shape, 1), 0.3
    dataset = Dataset(curved(mesh, bubble, 2)) if is_bent else with_field(mesh, lambda points: points[:, 0], 2)
    if shape.dimension == 2:
        circle = f"sphere:0.5,0.45,0:{r}"
        assert is_true(dataset, pi * r**2, "area", clip=f"outside:{circle}", error=1e-3)
        assert is_true(dataset, 2 * pi * r**2, "x*nx+y*ny", over=circle, error=1e-3)
        return
    sphere = f"sphere:0.5,0.45,0.52:{r}"
    assert is_true(dataset, 4 / 3 * pi * r**3, "volume", clip=f"outside:{sphere}", error=1e-2)
    if not is_bent:
        assert is_true(dataset, 4 * pi * r * exp(0.5) * sinh(r), "exp(u)", over=sphere, error=1e-2)


def test_without_the_error_of_rules_errors_are_less_than_the_truth(monkeypatch):
    dataset, options = Dataset(grid(Shape.QUADRILATERAL, 1)), {"clip": "outside:y+0*x=0.5", "error": 0.5}
    text, truth = "exp(9*x)", (exp(9) - 1) / 18
    assert is_true(dataset, truth, text, **options)
    monkeypatch.setattr(level_error, "gauss_factors", lambda counts, rhos: np.full((len(counts), len(rhos)), 1e-9))
    assert not is_true(dataset, truth, text, **options)


def test_every_direction_has_its_part_of_the_error():
    """Radii on the ellipses of one direction are in the error of that direction alone, unless a rule is exact."""
    for direction in range(3):
        radius = np.zeros((1, 1 + 3 * len(RHOS) + graph_discs.MOVED))
        radius[:, 0] = 1e9
        radius[:, 1 + direction * len(RHOS) : 1 + (direction + 1) * len(RHOS)] = 1.0
        found = level_error._analytic(radius, (3, 3, 3), None)[0, :, 0]
        expected = 4 * min(level_error.gauss_factors([3], RHOS)[0])
        assert found.tolist() == [expected if own == direction else 0.0 for own in range(3)]
        assert level_error._analytic(radius, (3, 3, 3), 2)[0, 2].max() == 0


def test_errors_without_rounding_would_be_too_small(monkeypatch):
    """The volume between two planes is wrong by their distance times the shift."""
    dataset, distance = Dataset(grid(Shape.HEXAHEDRON, 1)), 1e-5
    options = {"clip": f"outside:(z-0.5)^2={distance**2 / 4!r}", "error": 1e-6}
    assert is_true(dataset, distance, "volume", **options)
    monkeypatch.setattr(level_error, "_changes", lambda boxes, nets, longest, largest: np.zeros_like(largest))
    assert not is_true(dataset, distance, "volume", **options)


def test_errors_without_lost_boxes_would_be_too_small(monkeypatch):
    """Two planes that rounding can't tell apart have the area of both."""
    dataset, level = Dataset(grid(Shape.HEXAHEDRON, 1)), "(z-0.5)^2=2.5e-15"
    assert is_true(dataset, 2.0, "area", over=level)
    monkeypatch.setattr(level_error, "_extent", lambda whole, boxes, nets: boxes.further)
    assert not is_true(dataset, 2.0, "area", over=level)


def test_surfaces_missed_by_shifted_ones_count_as_lost():
    """Beyond the band of rounding there is none; inside of it the surface may be anywhere in a box."""
    nets = np.broadcast_to([1.0, 3.0], (1, 2, 2, 2)).copy()
    corners = np.zeros((1, 3)), np.ones((1, 3))
    (patch,) = patches(Dataset(grid(Shape.HEXAHEDRON, 1)))
    nothing, none = (np.zeros(1, int),) * 2, (np.zeros((1, 1)),) * 2
    found = [
        LevelBoxes.of(patch, nothing, corners, nets, np.array([band]), none, False).resolved(1)
        for band in (0.5, 1.5, 2.5)
    ]
    assert [len(own) for own in found] == [0, 1, 1]
    assert [own.is_lost.any() for own in found] == [False, False, True]


def test_taylor_expansions_have_the_values_of_nets():
    random = np.random.default_rng(1)
    nets, places, sizes = random.normal(size=(3, 3, 4, 2)), random.uniform(size=(3, 3)), random.uniform(size=(3, 3))
    steps, bends = random.uniform(-1, 1, (3, 3)), random.normal(size=(3, len(BENDS)))
    own = taylor(nets, places, sizes)
    tables = [line_tables(size - 1, (places + sizes * steps)[:, k])[0] for k, size in enumerate(nets.shape[1:])]
    expected = np.einsum("nabc,na,nb,nc->n", nets, *tables)
    np.testing.assert_allclose(value(own, steps), expected, atol=1e-12)
    height = sum(bends[:, k] * steps[:, 0] ** i * steps[:, 1] ** j for k, (i, j) in enumerate(BENDS))
    moved = np.column_stack([steps[:, :2], steps[:, 2] - height])
    np.testing.assert_allclose(value(straightened(own, bends), moved), value(own, steps), atol=1e-11)
    factor = 1 + (bends[:, :2] * steps[:, :2]).sum(axis=1)
    np.testing.assert_allclose(value(multiplied(own, bends[:, :2]), steps), factor * value(own, steps), atol=1e-12)


def test_omitted_terms_of_expansions_are_bounded():
    """Values and derivatives of all truncated terms, at random complex points of the discs."""
    random, count = np.random.default_rng(2), 6
    degrees = np.add.outer(np.add.outer(np.arange(8), np.arange(8)), np.arange(8))
    coefficients = random.normal(size=(count, 8, 8, 8)) * 0.5**degrees
    bends = random.normal(scale=0.4, size=(count, len(BENDS)))
    radii = [random.uniform(0.3, 1.2, (count, 1)) for _ in range(3)]
    found = Expansion.curved(coefficients, bends, radii[:2])
    whole = straightened(coefficients, bends)
    assert found.coefficients[0].size < whole[0].size / 10
    left_out = whole.copy()
    left_out[tuple(map(slice, (None, *found.coefficients.shape[1:])))] -= found.coefficients
    for turns in np.exp(2j * np.pi * random.uniform(size=(20, count, 3))):
        places = np.hstack(radii) * turns
        powers = radii[2] ** np.arange(8)
        for own, most in zip((left_out, slope(left_out, 0), slope(left_out, 1)), found.omitted, strict=True):
            assert (np.abs(value(own, places)) <= (most[:, 0] * powers).sum(axis=1)).all()
        for axis in range(3):
            middle, radius = found.slope(axis, radii)
            assert (np.abs(value(slope(whole, axis), places) - middle[:, 0]) <= radius[:, 0]).all()


def value(coefficients, places):
    powers = [places[:, k, None] ** np.arange(coefficients.shape[1 + k]) for k in range(3)]
    return np.einsum("nabc,na,nb,nc->n", coefficients, *powers)


def graphs(count, seed):
    """Nets of g = k - h(i, j) with small bends, some of whose surfaces end inside of the box."""
    random = np.random.default_rng(seed)
    nets = random.normal(scale=0.04, size=(count, 3, 3, 3))
    nets += np.linspace(-1, 1, 3) * 0.5 - random.uniform(-0.6, 0.6, (count, 1, 1, 1))
    nets += np.linspace(-1, 1, 3)[:, None] * random.uniform(0.5, 1.0, (count, 1, 1, 1))
    return nets


def root(polynomial, near):
    """The root of a complex polynomial of one variable that is nearest to a number."""
    every = np.roots(polynomial[::-1])
    return every[np.abs(every - near).argmin()]


def values_of(discs, nets, parts, number, v):
    """i, j and k of a part at coordinates v, by roots that are continued along a line from the centre."""
    i = (parts.low[number] + parts.high[number]) / 2
    ends, k = parts.ends[number].astype(complex), parts.root[number]
    for step in np.linspace(0, 1, 40):
        here = i + step * v[0] * (parts.high[number] - parts.low[number]) / 2
        for column in (0, 1):
            if parts.kinds[number, column] >= 0:
                line = value_along(nets[number, :, :, -parts.kinds[number, column]], here)
                ends[column] = root(line, ends[column])
        j = ends.mean() + step * v[1] * (ends[1] - ends[0]) / 2
        line = np.einsum("ab,a->b", powers_of_net(nets[number], here), [j**p for p in range(3)])
        k = root(line, k)
    return here, j, k


def to_powers(net):
    """Coefficients of powers from those of Bernstein polynomials of degree 2, in each direction."""
    matrix = np.array([[1, 0, 0], [-2, 2, 0], [1, -2, 1.0]])
    for axis in range(net.ndim):
        net = np.moveaxis(np.tensordot(matrix, net, (1, axis)), 0, axis)
    return net


def value_along(face, i):
    return np.array([i**p for p in range(3)]) @ to_powers(face)


def powers_of_net(net, i):
    return np.einsum("a,abc->bc", np.array([i**p for p in range(3)]), to_powers(net))


def gradient(net, place):
    """Derivatives of a polynomial at a complex place."""
    powers = [np.array([x**p for p in range(3)]) for x in place]
    slopes = [np.array([0, 1, 2 * x]) for x in place]
    tables = [[*powers[:axis], slopes[axis], *powers[axis + 1 :]] for axis in range(3)]
    return [np.einsum("abc,a,b,c->", to_powers(net), *table) for table in tables]


def test_discs_contain_the_complex_points_of_parts():
    """Roots at complex places, which are continued from the real centre, and ratios of slopes there."""
    nets = graphs(16, 5)
    parts = graph_parts(nets)
    parts = parts.part(parts.has_root)
    own = nets[parts.box]
    discs = PartDiscs.of(own, parts, (0, 1), False)
    random, tried, second = np.random.default_rng(2), 0, 1 + len(RHOS)
    for number in range(len(parts)):
        for direction, column in ((0, 1), (0, 2), (0, 3), (1, second), (1, second + 1), (1, second + 2)):
            if not discs.is_proved[number, column]:
                continue
            rho = RHOS[(column - 1) % len(RHOS)]
            w = rho * np.exp(1j * random.uniform(0, 2 * pi))
            v = random.uniform(-1, 1, 3).astype(complex)
            v[direction] = (w + 1 / w) / 2
            place = np.array(values_of(discs, own, parts, number, v))
            a, b, height = place - discs.centres[number]
            p, q, along_i, mixed, along_j = discs.bends[number]
            t = height - (p * a + q * b + along_i * a * a + mixed * a * b + along_j * b * b)
            for size, radius in zip((a, b, t), discs.radii, strict=True):
                assert abs(size) <= radius[number, column] + 1e-9
            g_i, g_j, g_k = gradient(own[number], place)
            ratios = g_i / g_k + p + 2 * along_i * a + mixed * b, g_j / g_k + q + mixed * a + 2 * along_j * b
            for ratio, (middle, radius) in zip(ratios, discs.tilts, strict=True):
                assert abs(ratio - middle[number, 0]) <= radius[number, column] + 1e-9
            tried += 1
    assert tried > 60


def test_discs_of_roots_have_room_for_the_change_of_the_slope():
    """The root of t^2/2 + t + s = 0 with s = 0.2 is 0.225 off; with s = 0.5 it is a double one."""
    coefficients = np.zeros((1, 1, 2, 3))
    coefficients[0, 0, 0] = [0.0, 1.0, 0.5]
    coefficients[0, 0, 1, 0] = 1.0
    one = np.ones((1, 1))
    found = graph_discs.root_radii(Expansion(coefficients), 0 * one, 0.2 * one)
    assert 1 - np.sqrt(1 - 2 * 0.2) <= found[0, 0] < np.inf
    assert graph_discs.root_radii(Expansion(coefficients), 0 * one, 0.5 * one)[0, 0] == np.inf


def test_discs_of_roots_have_room_for_rounding_of_the_slope(monkeypatch):
    """The root of c t + s = 0 for |s| <= 8 if c, which is 1, is off by a large unit roundoff."""
    monkeypatch.setattr(graph_discs, "_ROUNDING", 0.125)
    coefficients = np.zeros((1, 1, 2, 2))
    coefficients[0, 0, 0, 1] = coefficients[0, 0, 1, 0] = 1.0
    one = np.ones((1, 1))
    found = graph_discs.root_radii(Expansion(coefficients), 0 * one, 8 * one)
    assert 8 / (1 - 0.125) <= found[0, 0] < 12


def test_equations_of_straight_surfaces_have_no_mixed_terms():
    """A factor takes the products of the height with either of the other coordinates out of them."""
    nets = np.random.default_rng(7).uniform(-0.1, 0.1, (4, 3, 3, 3)) + np.linspace(-1, 1, 3)
    centres, radii = np.full((4, 3), 0.5), (np.zeros((4, 1)), np.zeros((4, 1)))
    level, _ = graph_discs._straight(nets, centres, np.ones(4, bool), radii)
    assert np.abs(graph_discs._mixed(taylor(nets, centres, np.ones_like(centres)))).min() > 1e-3
    assert np.abs(graph_discs._mixed(level.coefficients)).max() < 1e-14


def test_shares_near_zero_are_those_of_lines_and_parabolas():
    """Lengths of the unit interval in which 2.5 t - 1, and 4 (t - 1/2)^2 - w, are at most w = 0.01."""
    within = np.full(1, 0.01)
    by_slope, _ = touching._bounds(np.array([[-1.0, 0.25, 1.5]]), within)
    _, by_bend = touching._bounds(np.array([[1.0, -1.0, 1.0]]), within)
    assert by_slope == pytest.approx(0.02 / 2.5, rel=1e-14)
    assert by_bend == pytest.approx(2 * np.sqrt(0.02 / 4), rel=1e-14)


def test_only_upright_graphs_keep_their_height():
    """(s + (1 - s) y) z = 0.3 has slopes along z from s to 1: the halves of an inclined surface are cubes again."""
    (patch,) = patches(Dataset(grid(Shape.HEXAHEDRON, 1)))
    _, y, z = np.meshgrid(*[np.array([0.0, 1.0])] * 3, indexing="ij")
    nothing, none = (np.zeros(1, int),) * 2, (np.zeros((1, 1)),) * 2
    sizes = []
    for least in (0.8, 0.4):
        nets = ((least + (1 - least) * y) * z - 0.3)[None]
        boxes = LevelBoxes.of(patch, nothing, (np.zeros((1, 3)), np.ones((1, 3))), nets, np.zeros(1), none, False)
        halves = boxes.resolved(1).halved(np.ones((1, 2), bool))
        sizes.append(np.unique(halves.high - halves.low, axis=0).tolist())
    assert sizes == [[[0.5, 0.5, 1.0]], [[0.5, 0.5, 0.5]]]


def test_real_points_bound_the_area_where_its_branch_points_are_near():
    """1 + r^2 with |r| < 3: the root of its disc isn't analytic, but of real numbers it is below sqrt(10)."""
    disc = np.ones((1, 1)), np.full((1, 3), 9.0)
    with np.errstate(all="ignore"):
        middle, radius = level_discs._root_of_squares(disc, (1, 3))
    assert np.isinf(radius[0, 1:]).all()
    assert np.sqrt(10) <= middle[0, 0] + radius[0, 0] < 6


def test_the_smallest_known_change_by_moving_counts():
    """A disc that is known for the smaller of two movements bounds a movement that is smaller still, and no other."""
    shifts, radii = np.array([[0.1, 1e-4]] * 3), np.array([[np.inf, 2.0], [4.0, 2.0], [np.inf, 2.0]])
    found = level_error._changes_of_moved(np.array([1e-6, 1e-6, 1e-3]), shifts, radii)
    assert found.tolist() == pytest.approx([2 * 1e-2 * 2.0, 2 * 1e-5 * 4.0, np.inf])


def test_ends_of_parts_are_in_discs_around_parabolas():
    """An end j = 1/2 + q(i - 1/2) on either face with q(x) = (x + x^2 + x^3)/10: its disc ends where q does."""
    places = np.linspace(0, 1, 4)
    x = places - 0.5
    ends = 0.5 + (x + x**2 + x**3) / 10
    controls = np.linalg.solve(line_tables(3, places)[0], ends)
    upright = np.array([0.0, 1.0]) - controls[:, None]
    elsewhere = np.full_like(upright, 2.0)
    middle, first = np.full(2, 0.5), np.array([[0.5, 1.0]] * 2)
    farthest = (first + first**2 + first**3) / 10
    for faces in ([upright, elsewhere], [elsewhere, upright]):
        nets = np.stack([np.stack(faces, axis=2), np.stack(faces[::-1], axis=2)])
        kinds = np.array([[0, -1], [1, -1]]) if faces[0] is upright else np.array([[1, -1], [0, -1]])
        parts = SimpleNamespace(kinds=kinds, ends=np.full((2, 2), 0.5))
        found = graph_discs._end_radii(nets, parts, 0, middle, first)
        assert (found >= farthest).all()
        assert (found <= 1.1 * farthest).all()
        assert not graph_discs._end_radii(nets, parts, 1, middle, first).any()
