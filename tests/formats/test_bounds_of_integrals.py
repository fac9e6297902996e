"""Bounds of integrals: values lie within them, and some come near their ends (tests/support/claims.py)."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from claims import TEETH, check

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import (
    analytic_error,
    box_discs,
    conversion,
    copied_integrals,
    disc_algebra,
    graph_discs,
    graph_orders,
    graphs,
    groups,
    integration,
    refinement,
    taylor,
    tree_discs,
)
from elvis.core.integrals.analytic_error import Bounds
from elvis.core.integrals.box_discs import RHOS, BoxDiscs, _factors
from elvis.core.integrals.curves import Curve
from elvis.core.integrals.cut_expansions import Expansion
from elvis.core.integrals.eta_boxes import EtaBoxes
from elvis.core.integrals.graph_discs import root_radii
from elvis.core.integrals.groups import Sums
from elvis.core.integrals.integration import Integral
from elvis.core.integrals.levels import error as level_error
from elvis.core.integrals.levels.boxes import LevelBoxes
from elvis.core.integrals.quadrics import quadric
from elvis.core.integrals.reference_cells import box_rule
from elvis.core.integrals.refinement import Summation
from elvis.core.integrals.tree_discs import Ball, TreeDiscs, divided
from elvis.core.polynomials.boxnets import on_lattice
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities import Expression, discs, intervals
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.tree import call, fold, number
from elvis.core.shapes import Shape
from elvis.core.testing import grid

COUNT = 60
#: rounding of the model
COARSE = 2.0**-11
LINE = np.linspace(0, 1, 9)


def rising(rng, bend=0.2):
    """Nets (COUNT, 3, 3, 3) of polynomials g whose derivative along the last axis is near 2, along others random."""
    nets = bend * rng.uniform(-1, 1, (COUNT, 3, 3, 3)) + 2 * np.linspace(0, 1, 3)
    for axis in (1, 2):
        slope = rng.uniform(-1, 1, (COUNT, 1, 1, 1))
        nets = nets + slope * np.linspace(0, 1, 3).reshape(-1, *(1,) * (3 - axis))
    return nets


def slopes_of(nets):
    """Nets of the three derivatives."""
    return [np.diff(nets, axis=axis) * (nets.shape[axis] - 1) for axis in (1, 2, 3)]


def values_of(nets):
    """(n, 9^3) values at a lattice."""
    return on_lattice(nets, LINE).reshape(len(nets), -1)


def slopes_along_the_height(rng):
    """The relative steepness is at most that at every point."""
    for bend in (0.0, 0.3):
        nets = rising(rng, bend)
        for sign in (1, -1):
            found = graph_orders._steepness(sign * nets)
            slopes = [np.abs(values_of(slope)) for slope in slopes_of(nets)]
            yield found, slopes[-1].min(axis=1) / np.max(slopes, axis=0).max(axis=1)


def shifts_of_graphs(rng):
    """Moving g by a band moves its zeros along the last axis; on the way the area for a unit of the others changes."""
    for bend in (0.0, 0.2):
        nets, band = rising(rng, bend), rng.uniform(0.02, 0.2, COUNT)
        shift, change = graph_orders.shifts(nets, band)
        along_i, along_j, along_k = (values_of(slope) for slope in slopes_of(nets))
        yield band / np.abs(along_k).min(axis=1), shift
        found = 0.0
        for axis, along in enumerate((along_i, along_j)):
            mixed, bent = slopes_of(slopes_of(nets)[2])[axis], slopes_of(slopes_of(nets)[2])[2]
            # dr/dk of r = g_i / g_k
            found = found + np.abs(values_of(mixed) / along_k - along * values_of(bent) / along_k**2)
        yield found.max(axis=1) * shift, np.maximum(change, 1e-14)


def changes_of_areas(rng):
    """g = (1 - b) k + b k^2 + i (a + m k) with b < 0 < m: both terms are largest at the end k = 1."""
    places = np.stack(np.meshgrid(*[np.linspace(0, 1, 3)] * 3, indexing="ij"))
    for a, m, b in rng.uniform(0.1, 0.4, (20, 3)):
        i, _, k = places
        # coefficients of k^2 in degree 2 are 0, 0, 1
        net = (1 + b) * k - b * np.where(k == 1, 1.0, 0.0) + i * (a + m * k)
        shift, change = graph_orders.shifts(net[None], np.full(1, 0.1))
        steep = (1 + b) - 2 * b
        yield np.array([0.1 / steep]), shift
        yield shift * (m / steep + (a + m) * 2 * b / steep**2), change


def shares_of_moving_ends(rng):
    """The part of a face in which g is within a band of zero, next to the line j = 0.4 + 0.2 i where a graph ends."""
    i, j = np.meshgrid(*[np.linspace(0, 1, 3)] * 2, indexing="ij")
    face, fine = j - 0.4 - 0.2 * i, np.linspace(0, 1, 101)
    steep, band = rng.uniform(1, 2, (COUNT, 1, 1, 1)), rng.uniform(0.05, 0.1, COUNT)
    for others in (face + 9.0, face - 9.0, face):
        for pair in ((face, others), (others, face)):
            nets = steep * np.stack(pair, axis=2)
            values = np.abs([on_lattice(nets[..., end], fine) for end in (0, -1)])
            found = (values <= band[:, None, None]).mean(axis=(2, 3)).sum(axis=0)
            yield found, graph_orders.shares_of_ends(nets, band) + 0.02


def complex_inside(rng, disc, count=400):
    """(count, n) numbers on the borders of discs, real ones and those in opposite directions among them."""
    turn = np.exp(1j * np.pi / 4 * rng.integers(8, size=(count, len(disc[0]))))
    return disc[0] + disc[1] * turn


def random_disc(rng, middle, largest):
    return middle + rng.uniform(-0.1, 0.1, COUNT), rng.uniform(0.1, largest, COUNT)


def determinants(rng):
    for d in (2, 3):
        own = [[random_disc(rng, float(i == k), 0.4) for k in range(d)] for i in range(d)]
        values = np.array([[complex_inside(rng, entry, 500) for entry in row] for row in own])
        found = disc_algebra.determinant(own)
        matrices = np.moveaxis(values, (0, 1), (2, 3))
        yield np.abs(np.linalg.det(matrices) - found[0]).max(axis=0), found[1]
        for row in range(d):
            for k, (middle, radius) in enumerate(disc_algebra.cofactors(own, row)):
                rest = np.delete(np.delete(matrices, row, axis=2), k, axis=3)
                exact = (-1) ** (row + k) * np.linalg.det(rest)
                yield np.abs(exact - middle).max(axis=0), radius


def solutions(rng):
    """Of one unknown, g = f / (1 + R), and of several."""
    for d in (1, 2, 3):
        matrix = [[random_disc(rng, float(i == k), 0.5 / d) for k in range(d)] for i in range(d)]
        right = [random_disc(rng, 1.0, 0.5) for _ in range(d)]
        found = disc_algebra.solution(matrix, right)
        values = np.array([[complex_inside(rng, entry, 500) for entry in row] for row in matrix])
        given = np.array([complex_inside(rng, entry, 500) for entry in right])
        exact = np.linalg.solve(np.moveaxis(values, (0, 1), (2, 3)), np.moveaxis(given, 0, 2)[..., None])[..., 0]
        for k, (middle, radius) in enumerate(found):
            yield np.abs(exact[..., k] - middle).max(axis=0), radius


def values_of_expansions(rng):
    """On discs of the three coordinates: with terms of one sign, the ends of all radii."""
    for sign in (1, -1):
        coefficients = sign * rng.uniform(0, 1, (COUNT, 2, 3, 2))
        radii = tuple(rng.uniform(0.1, 1, (COUNT, 2)) for _ in range(3))
        middle, radius = Expansion(coefficients).disc(radii)
        powers = [own[..., None] ** np.arange(size) for own, size in zip(radii, (2, 3, 2), strict=True)]
        found = np.einsum("nabc,nqa,nqb,nqc->nq", coefficients, *powers)
        yield np.abs(found - middle), radius
        yield np.abs(middle[:, 0] - coefficients[:, 0, 0, 0]), np.full(COUNT, 1e-9)


def roots_of_expansions(rng):
    """Of c0 s + c1 t + c2 t^2 = 0 for |s| <= r: the quadratic formula; the disc is at most a fifth wider."""
    for bend in (0.0, 0.3):
        coefficients = np.zeros((COUNT, 1, 2, 3))
        steep, first = rng.uniform(1, 2, (2, COUNT))
        coefficients[:, 0, 0, 1], coefficients[:, 0, 0, 2] = steep, bend
        coefficients[:, 0, 1, 0] = first
        radius = rng.uniform(0.05, 0.4, COUNT)
        held = root_radii(Expansion(coefficients), np.zeros((COUNT, 1)), radius[:, None])[:, 0]
        product = first * radius
        exact = 2 * product / (steep + np.sqrt(steep**2 - 4 * bend * product))
        yield exact, held

    # c t - m a t - b t^2 = s for |a| <= r, where a start at m r / c would not converge
    steep, mixed, bend, first = 1.0, rng.uniform(0.9, 1.1, COUNT), 1.5, 0.01
    coefficients = np.zeros((COUNT, 2, 2, 3))
    coefficients[:, 0, 0, 1], coefficients[:, 1, 0, 1], coefficients[:, 0, 0, 2] = steep, -mixed, -bend
    coefficients[:, 0, 1, 0] = first
    held = root_radii(Expansion(coefficients), np.full((COUNT, 1), 0.5), np.ones((COUNT, 1)))[:, 0]
    left = steep - 0.5 * mixed
    exact = 2 * first / (left + np.sqrt(left**2 - 4 * bend * first))
    assert (held <= 2 * exact).all()
    yield exact, held
    assert np.array_equal(
        root_radii(Expansion(-coefficients), np.full((COUNT, 1), 0.5), np.ones((COUNT, 1)))[:, 0], held
    )


#: functions of leaves x and y
SMOOTH = ["x+y", "x-y", "2*x", "x*y", "x*x", "x^2", "x/3", "sqrt(x)", "log(x)", "1/x", "sqrt(x*x+y^2)", "1/(3*x^2+y*y)"]
SMOOTH += ["x/y", "x/(0-y)"]
KINKED = ["abs(x)", "min(x,y)", "max(x,y)", "sqrt(2*x*x)", "sqrt(x^2+y^2)", "sqrt(abs(x))"]
DATASET = Dataset(grid(Shape.QUADRILATERAL, 1))
OPERATIONS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "^": np.power, "abs": np.abs}
OPERATIONS |= {"sqrt": np.sqrt, "log": np.log, "min": np.minimum, "max": np.maximum}


def tree_of(text, balls, cofactor=lambda node: None, factors=((0.0,), (0.0,))):
    """The ball of an expression of leaves x and y on COUNT boxes."""

    def leaf(node):
        return balls[node.axes[0]] if node.op == "coordinate" else Ball.around(discs.number(node.value))

    return TreeDiscs(COUNT, np.array(factors), leaf, cofactor).of(Expression.of(DATASET, text).root)


def ball_of(*arguments):
    """The same of balls with one column, without it."""
    return Ball(*(np.broadcast_to(own, (COUNT, 1))[:, 0] for own in tree_of(*arguments)))


def of_leaves(cofactors):
    """Cofactors of leaves x and y."""
    return lambda node: cofactors[node.axes[0]] if node.op == "coordinate" else None


def value_of(text, places):
    """The same of numbers, complex ones too."""

    def leaf(node):
        return places[node.axes[0]] if node.op == "coordinate" else node.value

    return fold(Expression.of(DATASET, text).root, leaf, lambda node, parts: OPERATIONS[node.op](*parts))


def values_of_trees(rng):
    """At complex numbers in discs, with real parts above a bound and imaginary ones within another."""
    for text in SMOOTH:
        middle, radius = rng.uniform(2, 3, (2, COUNT, 1)), rng.uniform(0.2, 0.9, (2, COUNT, 1))
        low, imaginary = middle - 0.5 * radius, 0.7 * radius
        turn = np.exp(2j * np.pi * rng.uniform(size=(2, COUNT, 600)))
        places = middle + radius * np.where(rng.uniform(size=turn.shape) < 0.7, turn, turn.real)
        is_held = ((places.real >= low) & (np.abs(places.imag) <= imaginary)).all(axis=0)
        found = ball_of(text, [Ball(*own) for own in zip(middle, radius, low, imaginary, strict=True)])
        values = np.where(is_held, value_of(text, places), np.nan)
        yield np.nanmax(np.abs(values - found.middle[:, None]), axis=1), found.radius
        yield found.middle - np.nanmin(values.real, axis=1), found.middle - found.low
        yield np.nanmax(np.abs(values.imag), axis=1), found.imaginary


def slacks_of_trees(rng):
    """What expressions change by if leaves change by their slack; roots, next to 0, by the root of it."""
    for text, inexact in product(SMOOTH + KINKED, ([1, 1], [1, 0], [0, 1])):
        middle = rng.uniform(2, 3, (2, COUNT, 1)) if text in SMOOTH else np.zeros((2, COUNT, 1))
        radius, slack = (0.1 + 0 * middle if text in SMOOTH else 0 * middle), rng.uniform(0.05, 0.1, (2, COUNT, 1))
        slack *= np.reshape(inexact, (2, 1, 1)) * rng.choice([0.0, 1.0], slack.shape, p=[0.1, 0.9])
        balls = [Ball(m, r, m - r, r, s, np.sqrt(s)) for m, r, s in zip(middle, radius, slack, strict=True)]
        found = ball_of(text, balls)
        bound = np.where(np.isfinite(found.radius), found.slack, np.inf)
        signs = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij")).reshape(2, 1, -1)
        for way in (-1, 1):
            places = middle + way * radius
            with np.errstate(all="ignore"):
                away = np.abs(value_of(text, places + signs * slack) - value_of(text, places))
            yield np.nanmax(away, axis=1), bound.reshape(-1) + 1e-15


def values_with_factors(rng):
    """Leaves (1 + t) g that vanish on a face: functions of them where |t| is at most 1.5."""
    far = 1.5
    powers = np.tile([1, 0], (COUNT, 1))
    for text in ("sqrt(x*x+y*y)", "abs(x)", "max(2*x,x)", "sqrt(x*x*y*y)", "sqrt(x*x)*y", "sqrt(x*x+y*y)-x"):
        middle, radius = rng.uniform(2, 3, (2, COUNT, 1)), rng.uniform(0.2, 0.5, (2, COUNT, 1))
        inner = [Ball.around(own) for own in zip(middle, radius, strict=True)]
        whole = [Ball.around((m, m * far + r * (1 + far))) for m, r in zip(middle, radius, strict=True)]
        found = ball_of(text, whole, of_leaves([(powers, own) for own in inner]), ((far,), (far,)))
        factor = 1 + far * np.exp(2j * np.pi * rng.uniform(size=(COUNT, 300)))
        factor[:, 0] = 1 + far
        cofactors = middle + radius * np.exp(2j * np.pi * rng.integers(8, size=(2, COUNT, 300)) / 8)
        cofactors[..., 0] = (middle + radius)[..., 0]
        x, y = factor * cofactors
        values = {
            "sqrt(x*x+y*y)": factor * np.sqrt(cofactors[0] ** 2 + cofactors[1] ** 2),
            "abs(x)": x,
            "max(2*x,x)": 2 * x,
            "sqrt(x*x*y*y)": x * y,
            "sqrt(x*x)*y": x * y,
            "sqrt(x*x+y*y)-x": factor * (np.sqrt(cofactors[0] ** 2 + cofactors[1] ** 2) - cofactors[0]),
        }[text]
        yield np.abs(values - found.middle[:, None]).max(axis=1), found.radius


def polynomials_without_zeros(rng):
    """u = (1 -+ t) g to within a slack, which is as large as what u has on the face; once or twice."""
    for count, times in ((3, 1), (5, 1), (5, 2)):
        nodes = box_rule((count,))[0][:, 0]
        for end in (-1.0, 1.0):
            rest = 2.0 ** (-36 - 6 * times)
            values = (1 - end * nodes) ** times * (2 + nodes) + rest
            own = divided(values[None], (count,))
            column = int(end > 0)
            assert own.powers[0, column] == times
            assert own.powers[0].sum() == times
            # g through its values at the points
            places = np.linspace(-1, 1, 41)
            basis = np.linalg.inv(np.vander(nodes, count))
            cofactor = np.vander(places, count) @ basis @ own.values[0]
            exact = (1 - end * places) ** times * (2 + places) + rest
            away = np.abs((1 - end * places) ** times * cofactor - exact).max()
            yield np.array([away]), own.slack + 1e-14
            assert own.growth[0] >= (1 / (1 - end * nodes).min()) ** times * (1 - 1e-12)


def errors_of_rules(rng):
    """Of the Chebyshev polynomial of the first degree for which Gauss rules are wrong, in boxes of any dimension."""
    for n in (2, 3, 5):
        nodes, weights = gauss(n)
        error = abs(weights @ np.cos(2 * n * np.arccos(nodes)) - 2 / (1 - 4 * n * n))
        for d in (1, 2, 3):
            radii, volumes = np.zeros((COUNT, 1 + d * len(RHOS))), rng.uniform(0.1, 1, COUNT)
            radii[:, 1 : 1 + len(RHOS)] = (RHOS ** (2 * n) + RHOS ** (-2 * n)) / 2
            factors = np.tile(analytic_error.gauss_factors([n]), (d, 1, 1))
            measure = np.full((COUNT, 1), -2.0), np.full(radii.shape, 0.5)
            for is_exact in (True, False):
                disc = np.zeros((COUNT, 1)), radii
                found = SimpleNamespace(counts=(n,) * d, disc=lambda _, o=disc: (o, np.zeros(COUNT)), measure=measure)
                bound = analytic_error._analytic(found, None, is_exact, factors, volumes).sum(axis=(1, 2))
                yield 2.5 * error * 2.0 ** (d - 1) * volumes, bound
            # what isn't analytic is in the integral and in the rule
            slack = rng.uniform(0.1, 1, COUNT)
            found.disc = lambda _, r=0 * radii, s=slack: ((np.zeros((COUNT, 1)), r), s)
            bound = analytic_error._analytic(found, None, True, factors, volumes).sum(axis=(1, 2))
            yield 2 * slack * 2.5 * 2.0**d * volumes, bound


def ranges_of_integrals(rng):
    """Of integrands and measures that have both ends of what they may be."""
    for low, high in ((1.0, 2.0), (-2.0, -1.0), (-1.0, 3.0)):
        for d in (1, 2):
            middle, radius = rng.uniform(1, 2, (COUNT, 1)), rng.uniform(0.1, 1.5, (COUNT, 1))
            volumes = rng.uniform(0.1, 1, COUNT)
            ends = np.full(COUNT, low), np.full(COUNT, high)
            found = SimpleNamespace(counts=(2,) * d, interval=lambda _, own=ends: own, measure=(middle, radius))
            least, most = np.maximum(middle - radius, 0.0)[:, 0], (middle + radius)[:, 0]
            every = 2.0**d * volumes * np.stack([end * part for end in (low, high) for part in (least, most)])
            bound = analytic_error._enclosure(found, None, False, volumes, volumes)
            yield every.max(axis=0) + 100, bound[1] + 100
            yield 100 - every.min(axis=0), 100 - bound[0]
            known = Bounds(np.full((COUNT, 1, 1, 1), np.inf), *(own[:, None] for own in bound), np.zeros((COUNT, 1)))
            for value in (every.min(axis=0), every.max(axis=0)):
                off = np.maximum(every.max(axis=0) - value, value - every.min(axis=0))
                yield off, known.error(value[:, None], (0,))[:, 0]


def changes_of_moved_surfaces(rng):
    """Parts of a box that a plane cuts, and the plane's areas, if it is moved: n . x = c on a box of any lengths."""
    for d in (2, 3):
        lengths, largest = rng.uniform(0.5, 2, (COUNT, 3)), rng.uniform(1, 3, (COUNT, 1))
        slopes, shift = rng.uniform(0.2, 1, (COUNT, 3)), rng.uniform(0.01, 0.3, COUNT)
        if d == 2:
            slopes[:, 0] = 0.0
        index = np.stack(np.meshgrid(*[np.arange(2)] * 3, indexing="ij"))
        nets = np.einsum("nk,kabc->nabc", slopes, index) - 0.5
        nets = nets[:, :1] if d == 2 else nets
        own = {"patch": SimpleNamespace(shape=SimpleNamespace(dimension=d)), "shift": shift, "share": shift}
        filled = level_error._changes(SimpleNamespace(is_filled=True, **own), nets, lengths, largest)
        yield shift * lengths[:, -d:].prod(axis=1) * largest[:, 0], filled[:, 0]
        # area for a unit of i and j: all lengths times the size of the gradient in the world over the slope along k
        steep = np.linalg.norm(slopes[:, -d:] / lengths[:, -d:], axis=1) * lengths[:, -d:].prod(axis=1) / slopes[:, 2]
        on_surface = level_error._changes(SimpleNamespace(is_filled=False, **own), nets, lengths, largest)
        yield shift * steep * largest[:, 0], on_surface[:, 0]
        much = SimpleNamespace(is_filled=True, **{**own, "shift": 9 * np.ones(COUNT)})
        yield lengths[:, -d:].prod(axis=1), level_error._changes(much, nets, lengths, np.ones((COUNT, 1)))[:, 0]


def polynomials_on_ellipses(rng):
    """Values, and imaginary parts, at complex places of one direction and real ones of the others."""
    counts = (3, 4)
    found = BoxDiscs(range(COUNT), None, (), None, None, counts)
    nodes = [box_rule((count,))[0][:, 0] for count in counts]
    values = rng.normal(size=(COUNT, *counts))
    ball = found._polynomial(values.reshape(-1))
    (disc,) = found._several(values.reshape(-1, 1))
    assert np.array_equal(disc[0], ball.middle)
    assert np.allclose(disc[1], ball.radius, rtol=1e-12)
    for axis in range(2):
        for k, rho in enumerate(RHOS):
            w = rho * np.exp(1j * np.pi * np.arange(24) / 12)
            places = [np.linspace(-1, 1, 24)[:, None] + 0j * w, np.linspace(-1, 1, 24)[:, None] + 0j * w]
            places[axis] = np.tile((w + 1 / w) / 2, (24, 1))
            pairs = zip(nodes, places, strict=True)
            tables = [np.linalg.solve(np.vander(own).T, np.vander(z.reshape(-1), len(own)).T) for own, z in pairs]
            exact = np.einsum("nab,ap,bp->np", values, *tables)
            column = 1 + axis * len(RHOS) + k
            yield np.abs(exact - ball.middle).max(axis=1), ball.radius[:, column]
            yield np.abs(exact.imag).max(axis=1), ball.imaginary[:, column]
    lattice = [np.linalg.solve(np.vander(own).T, np.vander(np.linspace(-1, 1, 9), len(own)).T) for own in nodes]
    exact = np.einsum("nab,ap,bq->npq", values, *lattice).reshape(COUNT, -1)
    yield np.abs(exact - ball.middle).max(axis=1), ball.radius[:, 0]
    # 1 + t and 1 - t of a direction on its own ellipses, elsewhere on the real box
    for axis in range(2):
        radii = _factors(2)[2 * axis : 2 * axis + 2]
        own = np.ones(1 + 2 * len(RHOS))
        own[1 + axis * len(RHOS) : 1 + (axis + 1) * len(RHOS)] = (RHOS + 1 / RHOS) / 2
        assert np.array_equal(radii, [own, own])


CLAIMS = [
    polynomials_on_ellipses,
    slopes_along_the_height,
    shifts_of_graphs,
    changes_of_areas,
    shares_of_moving_ends,
    determinants,
    solutions,
    values_of_expansions,
    roots_of_expansions,
    values_of_trees,
    slacks_of_trees,
    values_with_factors,
    polynomials_without_zeros,
    errors_of_rules,
    ranges_of_integrals,
    changes_of_moved_surfaces,
]


@pytest.fixture(autouse=True)
def silence():
    """Discs of no value are infinite, without a warning, as in expressions."""
    with np.errstate(all="ignore"):
        yield


@pytest.mark.parametrize("claim", CLAIMS)
def test_values_lie_within_bounds_and_some_near_their_ends(claim):
    check(claim, TEETH)


def test_graphs_run_along_the_direction_of_steepest_growth():
    slopes = np.random.default_rng(3).permuted(np.tile([0.2, 1.0, 3.0], (20, 1)), axis=1)
    index = np.stack(np.meshgrid(*[np.arange(2)] * 3, indexing="ij"))
    nets = np.einsum("nk,kabc->nabc", slopes, index) - 0.1
    order, is_graph = graph_orders.orders(nets, are_ends_free=True)
    assert is_graph.all()
    assert (order[:, 2] == slopes.argmax(axis=1)).all()
    assert graph_orders._steepness(np.ones((1, 2, 2, 2)))[0] == 0.0
    # a tenth of the largest slope is too little
    for slope, is_one in ((0.099, False), (0.101, True)):
        flat = np.array([[[[0.0, slope], [1.0, 1.0 + slope]]]])
        assert (graph_orders._steepness(flat)[0] > graph_orders._STEEP) == is_one


def test_graphs_have_at_most_one_end_on_a_face():
    """On a face g has one sign, or a curve with one point on each side of the face."""
    free, single = np.ones((2, 2)), np.array([[-1.0, 3.0], [-2.0, 3.0]])
    for face, is_graph in (
        (free, True),
        (-free, True),
        (single, True),
        (single.T, False),
        (np.array([[-1.0, 1.0, -0.5]] * 3), False),
        (np.array([[0.0, 0.0], [1.0, 1.0]]), False),
    ):
        other = np.ones_like(face)
        for pair in ((face, other), (other, face)):
            assert graph_orders._are_ends_graphs(np.stack(pair, axis=2)[None])[0] == is_graph
    changes = [graph_orders._changes(np.array([signs]))[0] for signs in ([1, 1], [1, -1], [-1, 1, -1], [0, -1], [0, 1])]
    assert changes == [0, 1, 2, 1, 0]


def test_quadrics_equal_their_distances_and_squares():
    places = np.random.default_rng(2).normal(size=(3, 50))
    point, axis = np.array([0.3, -0.2, 0.7]), np.array([0.6, 0.0, -0.8])
    away = places.T - point
    along = away @ axis
    texts = {
        "plane:0.3,-0.2,0.7:3,0,-4": along,
        "plane:0.3,-0.2:0,2": away[:, 1],
        "sphere:0.3,-0.2,0.7:1.5": (away**2).sum(axis=1) - 1.5**2,
        "cylinder:0.3,-0.2,0.7:3,0,-4:0.5": (away**2).sum(axis=1) - along**2 - 0.5**2,
    }
    for text, expected in texts.items():
        found = fold(quadric(text), lambda n: places[n.axes[0]] if n.op == "coordinate" else n.value, numbers)
        assert np.abs(found - expected).max() < 1e-13
    for text in ("sphere:0,0,0:0", "sphere:0,0,0:-1", "plane:0,0,0:0,0,0", "cylinder:0,0,0:0,0,1:0", "sphere:0:1"):
        with pytest.raises(ElvisError, match="expected"):
            quadric(text)


def numbers(node, parts):
    return OPERATIONS[node.op](*parts)


def boxes_of(count, low=-1.0, high=1.0):
    corners = np.full((count, 2), low), np.full((count, 2), high)
    return EtaBoxes("piece", np.arange(count), np.zeros((count, 1)), *corners)


def test_boxes_of_a_part_are_joined_and_bisected():
    one = boxes_of(2)
    for several in ([one], [one, one.part(np.array([1]))]):
        joined = EtaBoxes.joined(several)
        assert joined.piece == "piece"
        assert joined.rows.tolist() == [0, 1, 1][: len(joined)]
    halves = one.halved(np.array([[True, False], [True, True]]))
    assert halves.rows.tolist() == [0, 1, 0, 1, 1, 1]
    assert halves.volumes.tolist() == [0.5, 0.25, 0.5, 0.25, 0.25, 0.25]
    for side, can in ((1.0, False), (1.01, True)):
        assert (boxes_of(1, 0.0, 2 * side * 2.0**-43).can_be_halved == can).all()


@pytest.mark.parametrize("texts", [("x",), ("sqrt(x)",), ("x", "sqrt(x)"), ("sqrt(x)", "x")])
def test_boxes_on_surfaces_are_evaluated_if_bounds_or_values_may_be_missing(texts):
    """An expression of sums and products always has a value; one that isn't bounded on any box of the four is not."""
    roots = [Expression.of(DATASET, text).root for text in texts]
    errors = np.ones((4, len(roots), 2, 1))
    errors[1, 0, 0] = errors[2, -1, 1] = errors[3] = np.inf
    nothing = np.zeros((4, len(roots)))
    known = Bounds(errors, nothing - np.inf, nothing + np.inf, nothing)
    rules = SimpleNamespace(bounds=lambda part, roots, counts: (known, nothing))
    evaluated = []
    own = SimpleNamespace(
        _expressions=[SimpleNamespace(root=root) for root in roots],
        _raised=lambda group, steps: evaluated.extend(group.boxes.rows.tolist()),
    )
    groups = list(Summation._enclosed(own, Boxes(np.arange(4)), rules, list(range(len(roots)))))
    without = [row for group in groups if group is not None for row in group.boxes.rows.tolist()]
    has_values = texts == ("x",)
    assert without == ([0, 1, 2, 3] if has_values else [0])
    assert evaluated == ([] if has_values else [1, 2, 3])


class Boxes(SimpleNamespace):
    """Rows alone, of squares."""

    dimension = 2

    def __init__(self, rows):
        super().__init__(rows=rows)

    def __len__(self):
        return len(self.rows)

    def part(self, chosen):
        return Boxes(self.rows[chosen])


def test_areas_in_boxes_are_bounded_by_intersections_with_lines():
    """A line meets g = 0 as often as the degree; faces have the area of their lengths."""
    lengths = np.array([[2.0, 3.0, 5.0]] * 3)
    several, further = np.array([1.0, 2.0, 0.0]), np.array([0.0, 0.5, 0.25])
    boxes = SimpleNamespace(patch=SimpleNamespace(shape=Shape.HEXAHEDRON), is_lost=np.ones(3, bool))
    boxes.several, boxes.further = several, further
    found = level_error._extent(SimpleNamespace(longest=lengths), boxes, np.zeros((3, 2, 3, 4)))
    assert found.tolist() == [1 * 15 + 2 * 10 + 3 * 6, 2 * 53 + 0.5, 0.25]


def test_areas_of_graphs_are_bounded_by_their_steepness():
    """The plane z = 1/2 + (x + y)/4 over a box has the area of its base times sqrt(1 + 1/8), at most 1 + 1/2 times."""
    x, y, z = np.meshgrid(*[np.array([0.0, 1.0])] * 3, indexing="ij")
    nets = (z - 0.5 - (x + y) / 4)[None]
    lengths = np.ones((1, 3))
    boxes = SimpleNamespace(patch=SimpleNamespace(shape=Shape.HEXAHEDRON), is_lost=np.zeros(1, bool))
    boxes.several, boxes.further = np.ones(1), np.zeros(1)
    found = level_error._extent(SimpleNamespace(longest=lengths), boxes, nets)
    assert np.sqrt(1 + 1 / 8) <= found[0] == pytest.approx(1.5)


def test_lower_bounds_of_real_parts_have_room_for_rounding(monkeypatch):
    """In parts of the middle and of the radius, which is unknown of some."""
    monkeypatch.setattr(tree_discs, "ROUNDING", COARSE)
    middle, radius = np.full((2, COUNT, 1), 2.0), np.full((2, COUNT, 1), 0.5)
    balls = [Ball.around(own) for own in zip(middle, radius, strict=True)]
    for text, low in (("x+y", 3.0), ("3*x", 4.5), ("x^2", 2.25), ("x*x", 2.25)):
        found = ball_of(text, balls)
        exact = low - COARSE * (np.abs(found.middle) + found.radius)
        assert np.abs(found.low - exact).max() < 1e-12
    unknown = ball_of("x+y", [balls[0], balls[1]._replace(radius=np.full((COUNT, 1), np.inf))])
    assert np.abs(unknown.low - (3.0 - COARSE * 4)).max() < 1e-12


def test_divided_polynomials_have_the_rounding_of_their_values(monkeypatch):
    """Values near a face may be off by as much as others; division makes that greater."""
    monkeypatch.setattr(tree_discs, "ROUNDING", 2.0**-41)
    nodes = box_rule((4,))[0][:, 0]
    values = (1 + nodes) * (2 - nodes)
    own = divided(values[None], (4,))
    assert own.slack[0] >= 2.0**-41 * np.abs(values).max()
    assert own.growth[0] == 1 / (1 + nodes).min()


def test_roundings_of_discs_are_taken_outwards(monkeypatch):
    """Of values of polynomials, and of functions that grow on ellipses."""
    found = BoxDiscs(range(1), None, (), None, None, (2, 2))
    values = np.array([1.0, 2.0, 2.0, 1.0])
    exact = found._polynomial(values)
    monkeypatch.setattr(box_discs, "ROUNDING", COARSE)
    rounded = found._polynomial(values)
    for name, sign in (("radius", 1), ("low", -1), ("imaginary", 1)):
        assert np.allclose(getattr(rounded, name) - getattr(exact, name), sign * 2 * COARSE, atol=1e-12), name
    assert np.allclose(found._several(values[:, None])[0][1] - exact.radius, 2 * COARSE, atol=1e-12)


def test_determinants_of_valid_elements_have_their_sign_taken_off():
    """By the largest one at points: next to a zero, rounding may change the sign."""
    jacobians = np.tile(np.eye(2), (4, 1, 1))
    jacobians[:, 0, 0] = [-1e-9, 3.0, -2.0, -5.0]
    piece = SimpleNamespace(is_signed=False, patch=SimpleNamespace(shape=Shape.QUADRILATERAL))
    rules = SimpleNamespace(is_valid=True, piece=piece)
    found = BoxDiscs(range(2), rules, (), None, SimpleNamespace(jacobians=jacobians), (1, 2))
    found.__dict__["_determinant"] = (np.array([[1.5], [-3.5]]), np.array([[1.5], [1.5]]))
    middle, radius = found._volume
    assert middle.tolist() == [[1.5], [3.5]]
    assert radius.tolist() == [[1.5], [1.5]]


def test_polynomials_that_are_zero_are_not_divided():
    assert divided(np.zeros((1, 4)), (4,)).powers.tolist() == [[0, 0]]


def test_roots_of_lines_and_parabolas_are_found_for_both_signs():
    """A zero counts as positive: on the way up the root is there, on the way down there is none."""
    net = np.array([[-1.0, 0.5, 3.0], [1.0, -0.5, -3.0], [-1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, -1.0, -1.0]])
    root = (np.sqrt(13) - 3) / 2
    assert np.abs(graphs.roots(net) - [root, root, 1.0, 1.0, 0.0]).max() < 1e-12


def test_sums_add_up_and_averages_have_the_error_of_their_measure():
    numbers = np.arange(1.0, 7.0).reshape(6, 1)
    every = np.ones(1, bool)
    one, two = (Sums(*(factor * numbers), every, every, converted=factor * numbers[0]) for factor in (1, 10))
    both = one + two
    names = ("value", "error", "rounding", "magnitude", "measure", "beyond")
    assert [getattr(both, name).item() for name in names] == [11 * k for k in range(1, 7)]
    assert both.converted.item() == 11
    wanted = [SimpleNamespace(is_average=is_average, text="") for is_average in (False, True)]
    two_rows = Sums(*np.tile(numbers, (1, 2)), *np.ones((2, 2), bool), converted=np.array([0.5, 0.0]))
    whole, mean = integration._rows("domain", wanted, two_rows, True)
    assert (whole.value, whole.error, whole.kind) == (1.0, 2.5, integration.ESTIMATE)
    assert (mean.value, mean.error, mean.measure) == (0.2, 0.4, 5.0)


def test_boxes_are_chosen_by_their_scores_and_costs():
    scores = np.array([0.1, 0.5, 0.3, 0.3])
    assert refinement._threshold(scores / 9) == np.inf
    assert refinement._threshold(np.array([0.2, 0.2, 0.3, 0.9])) == 0.3
    for budget, chosen in ((9, 4), (3, 3), (2, 1), (1, 1), (0, 0)):
        assert (scores >= refinement._affordable(scores, np.array([1, 1, 1, 1]), budget)).sum() == chosen
    assert (scores >= refinement._affordable(scores, np.array([1, 2, 1, 1]), 1)).sum() == 0


def test_estimates_are_eight_times_the_difference_of_rules_above_rounding():
    rules = {(2,): 1.0, (3,): 1.25, (4,): 1.0}
    for rounding, expected in ((0.5, 2.0), (0.99, 2.0), (1.0, 0.0), (1.01, 0.0)):
        boxes = SimpleNamespace(rounding=np.full((1, 1), 2.0 * rounding))
        best = {count: SimpleNamespace(value=np.full((1, 1), v), measure=np.ones((1, 1))) for count, v in rules.items()}
        own = SimpleNamespace(_planned=0, _integrate=lambda boxes, numbers, counts, b=best: b[counts])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(refinement, "compared_counts", lambda counts: [(2,), (3,), (4,)])
            patch.setattr(refinement, "_points", lambda boxes, rules: 0)
            found = Summation._compared(own, boxes, [0], (2,), False)
        assert found.error.item() == expected


def test_errors_without_bounds_are_eight_times_the_integrals_size():
    nothing = np.zeros((3, 1))
    known = Bounds(np.array([np.inf, 0.5, np.inf]).reshape(3, 1, 1, 1), nothing - np.inf, nothing + np.inf, nothing)
    values = np.array([[2.0], [2.0], [np.nan]])
    integrals = SimpleNamespace(value=values, magnitude=np.full((3, 1), 3.0))
    error, is_bound = refinement._error(known, integrals, (0,))
    assert error.tolist() == [[24.0], [0.5], [0.0]]
    assert is_bound.tolist() == [[False], [True], [True]]


def test_errors_are_relative_to_sizes_and_exclude_rounding():
    told = []
    total = SimpleNamespace(error=np.array([3.0, 1.0, np.nan]), rounding=np.array([1.0, 1.0, 0.0]))
    Summation._tell(SimpleNamespace(_reached=told.append), total, np.array([4.0, 1.0, 1.0]))
    assert told == [0.5]


def test_shares_of_directions_match_those_of_the_next_rule():
    """Boxes are bisected in the direction in which the second smallest rule is wrong by most."""
    errors = np.ones((1, 1, 2, 4))
    errors[0, 0, 0, 1], errors[0, 0, 1, 2:] = 9.0, 99.0
    bounds = SimpleNamespace(errors=errors)
    own = SimpleNamespace(
        bounds=bounds, gains=np.ones((1, 2)), boxes=SimpleNamespace(can_be_halved=np.ones((1, 2), bool))
    )
    assert groups.Bounded.halving(own, np.ones(1)).tolist() == [[True, False]]


@pytest.mark.parametrize(
    "text",
    [
        "circle:0,0,0:0,0,0:1",
        "circle:0,0,0:0,0,1:0",
        "line:0,0,0:1,0,0:2,0,0",
        "line:0,0,0:0,0,0",
        "spline:0,0,0",
        "normal:all:0.5,0.5,2:0",
        "normal:all:0.5,0.5,2:-1",
        "normal:all:0.5,0.5,2:inf",
        "normal::0.5,0.5,2:1",
    ],
)
def test_curves_without_length_are_rejected(text):
    with pytest.raises(ElvisError, match="expected"):
        Curve.parse(Dataset(grid(Shape.HEXAHEDRON, 1)), text)


def test_splines_pass_through_their_points_with_continuous_curvature():
    points = np.array([[0.0, 0, 0], [1, 0.5, 0], [1.5, 2, 0.3], [2, 2, 2]])
    text = "spline:" + ":".join(",".join(map(str, point)) for point in points.tolist())
    curve, step = Curve.parse(DATASET, text), 1e-4
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.abs(curve.at(np.arange(4.0))[0] - points).max() < 1e-12
    for part in range(3):
        t = part + np.array([0.2, 0.7])
        slopes = (curve.at(t + step)[0] - curve.at(t - step)[0]) / (2 * step)
        assert np.abs(slopes - curve.at(t)[1]).max() < 1e-6
    for knot in (1, 2):
        before, after = (curve.at(np.array([knot + way * step, knot + 2 * way * step])) for way in (-1, 1))
        slope = [own[1][0] / lengths[part] for own, part in ((before, knot - 1), (after, knot))]
        assert np.abs(slope[0] - slope[1]).max() < 1e-2
        bend = [
            (own[1][1] - own[1][0]) / step / lengths[part] ** 2 for own, part in ((before, knot - 1), (after, knot))
        ]
        assert np.abs(bend[0] + bend[1]).max() < 1e-2
    # straight at both ends
    for end, way in ((0.0, 1), (3.0, -1)):
        near = curve.at(end + way * step * np.array([0.5, 1.5]))[1]
        assert np.abs(near[1] - near[0]).max() / step < 1e-2


def test_slacks_of_quotients_do_not_depend_on_signs():
    middle, radius, slack = np.full((COUNT, 1), 2.0), np.full((COUNT, 1), 0.5), np.full((COUNT, 1), 0.1)
    balls = [Ball(middle, radius, middle - radius, radius, own, np.sqrt(own)) for own in (slack, 0 * slack)]
    for text in ("x/y", "x/(0-y)"):
        assert np.allclose(tree_of(text, balls).slack, 0.1 / 1.5)


def test_slacks_and_zeros_count_only_at_real_points():
    """The first column; other columns are those of ellipses."""
    middle, radius, slack = np.full((2, COUNT, 1), 2.0), np.full((2, COUNT, 1), 0.5), np.full((2, COUNT, 1), 0.1)
    wider = np.concatenate([radius, 3 * radius], axis=2)
    for text in ("x*y", "x^2", "x/y", "x+y", "sqrt(x)", "abs(x)"):
        exact = text == "x/y"
        found = []
        for own in (radius, wider):
            given = zip(middle, own, [slack[0], 0 * slack[1] if exact else slack[1]], strict=True)
            balls = [Ball(m, r, m - r, r, s, np.sqrt(s)) for m, r, s in given]
            found.append(tree_of(text, balls))
        assert np.array_equal(np.broadcast_to(found[0].slack, (COUNT, 1)), np.broadcast_to(found[1].slack, (COUNT, 1)))
        assert np.abs(balls[0].size - 2.6).max() < 1e-12
    nothing = np.zeros((COUNT, 1))
    for column in (0, 1):
        radius = np.zeros((COUNT, 2))
        radius[:, column] = 0.1
        assert not Ball.around((nothing, radius)).is_zero.any()
    assert Ball.around((nothing, np.zeros((COUNT, 2)))).is_zero.all()


def test_rules_and_integrals_differ_by_four_radii_of_real_points():
    """Where nothing is known of ellipses: values at the nodes at the one end, elsewhere at the other."""
    for d in (1, 2, 3):
        radius = np.full((1, 1 + d * len(level_error.RHOS) + graph_discs.MOVED), np.inf)
        radius[:, 0] = 0.5
        assert level_error._analytic(radius, (3,) * d, None)[0, :, 0].tolist() == [2.0 * 2 ** (d - 1)] * d


def test_circles_have_the_tangents_of_their_places():
    curve, t, step = Curve.parse(DATASET, "circle:0.1,0.2,0.3:1,2,2:0.7"), np.array([0.1, 0.45, 0.8]), 1e-5
    place, tangent = curve.at(t)
    slopes = (curve.at(t + step)[0] - curve.at(t - step)[0]) / (2 * step)
    assert np.abs(slopes - tangent).max() < 1e-8
    assert np.abs(np.linalg.norm(place - [0.1, 0.2, 0.3], axis=1) - 0.7).max() < 1e-12
    assert np.abs((place - [0.1, 0.2, 0.3]) @ [1, 2, 2]).max() < 1e-12


def test_surfaces_are_expanded_to_the_second_order():
    """P has the values of the root of g up to terms of the third order."""
    rng = np.random.default_rng(9)
    coefficients = rng.uniform(-1, 1, (COUNT, 3, 3, 3))
    coefficients[:, 0, 0, 0], coefficients[:, 0, 0, 1] = 0.0, 2.0
    bends = graph_discs._bends(coefficients)
    a, b = 1e-3 * rng.choice([-1.0, 1.0], (2, COUNT))
    powers = [own[:, None] ** np.arange(3) for own in (a, b)]
    line = np.einsum("nabc,na,nb->nc", coefficients, *powers)
    k = np.zeros(COUNT)
    for _ in range(6):
        k -= (line[:, 0] + line[:, 1] * k + line[:, 2] * k * k) / (line[:, 1] + 2 * line[:, 2] * k)
    expanded = sum(bends[:, column] * term for column, term in enumerate((a, b, a * a, a * b, b * b)))
    assert np.abs(k - expanded).max() < 5e-8
    assert np.abs(k).min() < 1e-3 < 100 * np.abs(k).max()


def test_enclosures_of_integrals_combine_ends_of_integrands_and_measures():
    """Integrands of either sign are multiplied by the smaller or by the larger end of the measure."""
    low, high, volumes = np.array([2.0, -3.0, -1.0]), np.array([3.0, -2.0, 1.0]), np.array([0.5, 0.5, 2.0])
    found = SimpleNamespace(interval=lambda root: (low, high), counts=(2, 2))
    found.measure = np.ones((3, 1)), np.full((3, 1), 0.1)
    least, most = analytic_error._enclosure(found, None, False, volumes, None)
    assert np.allclose(least, 4 * volumes * [2 * 0.9, -3 * 1.1, -1.1], rtol=1e-14)
    assert np.allclose(most, 4 * volumes * [3 * 1.1, -2 * 0.9, 1.1], rtol=1e-14)


def test_discs_of_expansions_have_all_terms_but_the_constant_as_their_radius():
    """Constants of both signs; bounds of coefficients contain the constant's magnitude."""
    rng = np.random.default_rng(5)
    coefficients, radius = rng.normal(size=(COUNT, 1, 1, 1)), rng.uniform(0.1, 1, (COUNT, 2))
    by_power = rng.uniform(0, 1, (COUNT, 2, 3))
    by_power[..., 0] += np.abs(coefficients[:, 0, 0])
    middle, found = taylor.constant_and_rest(coefficients, by_power, radius)
    assert np.array_equal(middle[:, 0], coefficients[:, 0, 0, 0])
    terms = (by_power * radius[..., None] ** np.arange(3)).sum(axis=2)
    assert found == pytest.approx(terms - np.abs(middle), rel=1e-12)
    assert (found >= terms - np.abs(middle)).all()


def test_roots_of_multiples_have_the_slack_of_roots_times_that_of_the_factor():
    node = call("*", number(4.0), call("abs", number(1.0)))
    disc = np.float64(1.0), np.float64(0.5)
    first, last = Ball(*disc, 0.5, 0.5, 0.1, 0.1), Ball(*disc, 0.5, 0.5, 0.2, 0.3)
    total, of_root = tree_discs._slacks_of_product(node, first, last)
    assert total == pytest.approx(0.1 * last.size + 0.2 * first.size)
    assert of_root == pytest.approx(2 * 0.3)


@pytest.mark.parametrize(("integrand", "share"), [("u", 1.0), ("average u", 0.5)])
def test_copies_add_up_with_their_errors(integrand, share):
    rows = [Integral("domain", integrand, 1.0, 0.25, 2.0, True), Integral("domain", integrand, 4.0, 0.5, 3.0, False)]
    found = copied_integrals._total(rows)
    assert (found.value, found.error, found.measure, found.exact) == (5 * share, 0.75 * share, 5.0, False)


@pytest.mark.parametrize("part", [0.99, 1.01])
def test_integrals_are_remarked_on_beyond_twice_the_requested_error(part):
    """Their rounding is left aside."""
    sums = SimpleNamespace(places={}, beyond=np.zeros(1), magnitude=np.array([3.0]), is_bound=np.ones(1, bool))
    sums.rounding, sums.error = np.array([0.1]), np.array([0.1 + 2 * 3.0 * 1e-3 * part])
    found = [*integration._remarks([("domain", sums)], [SimpleNamespace(text="u")], 1e-3)]
    assert len(found) == (part > 1)


def test_boxes_on_levels_have_lost_surfaces_in_their_error():
    measure, moved = np.ones((1, 1)), np.array([[0.25]])

    class Boxes(LevelBoxes):
        lost, moved, rounding = np.array([[0.5]]), np.array([[0.25]]), np.zeros((1, 1))

        def __len__(self):
            return 1

    boxes = object.__new__(Boxes)
    values = iter([1.0, 1.1, 1.3])

    def integrate(boxes, numbers, counts):
        return groups.BoxIntegrals(np.array([[next(values)]]), measure, measure, 0 * measure)

    own = SimpleNamespace(_integrate=integrate, _planned=0)
    found = Summation._compared(own, boxes, [0], (2, 2), False)
    assert found.error == pytest.approx(refinement._SAFETY * 0.3 + 0.5)
    assert found.moved == moved


def test_steepness_is_that_of_derivatives_whatever_degrees_and_sizes_are():
    """Linear functions as nets with two, three and four coefficients in the three directions."""
    rng = np.random.default_rng(6)
    slopes, sizes = rng.uniform(0.5, 2, (2, COUNT, 3))
    lines = np.meshgrid(*(np.linspace(0, 1, count) for count in (2, 3, 4)), indexing="ij")
    nets = np.einsum("nk,k...->n...", slopes, np.stack(lines))
    for own, slope in ((None, slopes), (sizes, slopes / sizes)):
        found = graph_orders._steepness_by_axis(nets, own).swapaxes(0, 1)
        assert found == pytest.approx(slope / slope.max(axis=1, keepdims=True), rel=1e-12)


def test_majorants_are_sums_of_magnitudes_at_the_radii_of_their_columns():
    """Or at the first radius where theirs is smaller in all rows."""
    rng = np.random.default_rng(9)
    coefficients = rng.normal(size=(COUNT, 3, 2, 2))
    first, second = rng.uniform(1, 2, (COUNT, 1)) * [1.0, 1.5, 0.5], rng.uniform(0.5, 1, (COUNT, 3))
    r = np.maximum(first, first[:, :1])[..., None] ** np.arange(3)
    s = second[..., None] ** np.arange(2)
    expected = np.einsum("nabc,nqa,nqb->nqc", np.abs(coefficients), r, s)
    assert taylor.majorants(coefficients, first, second) == pytest.approx(expected, rel=1e-12)


def test_solutions_are_unbounded_if_a_part_of_them_may_be_as_large():
    """g = 1 - R g with |R| = 0.5 is 2 at most; with |R| = 1 it isn't bounded."""
    assert intervals.largest_solution(np.ones(3), np.array([0.5, 1.0, 1.5])).tolist() == [2.0, np.inf, np.inf]


def test_surfaces_without_a_slope_across_may_have_any_area():
    nets = np.array([0.0, 1.0])[None, None, :, None] * np.ones((2, 2, 2, 2))
    nets[1] += np.array([0.0, 1.0])
    found = level_error._graph_area(nets, np.ones((2, 3)))
    assert found[0] == np.inf
    assert found[1] < 10


def test_expressions_are_rounded_in_proportion_to_their_precision():
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    expressions = [Expression.of(dataset, text) for text in ("x", "x*y")]
    for precision, roundings in (((), [1.0, 1.0]), ((0.25, 0.5), [0.25, 0.5])):
        found = Summation(dataset, Evaluator(dataset, expressions), expressions, 1e-3, precision)
        assert found._roundings.tolist() == roundings


def test_conversions_move_integrals_by_values_and_by_measures(monkeypatch):
    """Three elements of area 1, values -2 that are off by 0.5, and places whose slopes are off by a tenth."""
    monkeypatch.setattr(conversion, "ElementPoints", lambda *_: SimpleNamespace(jacobians=None))

    class Squares:
        dimension, patch, rows = 2, None, np.arange(3)
        points, measures = staticmethod(lambda eta: eta), staticmethod(lambda _, eta: np.full(len(eta), 0.25))

        def __len__(self):
            return 3

    evaluator = SimpleNamespace(
        values_at=lambda _, places: [np.full(3 * conversion._COUNT**2, -2.0)], radius_at=lambda *_: 0.5
    )
    errors = SimpleNamespace(place=SimpleNamespace(slope=0.1))
    own = SimpleNamespace(errors=errors, _expressions=[None], _evaluator=evaluator)
    found = conversion.ConversionTerms._over(own, Squares())
    assert found == pytest.approx([3 * (0.5 + 2 * (1.1**2 - 1))], rel=1e-12)


def test_factors_in_discs_around_one_grow_balls_and_at_most_double_their_slack():
    """Of 3 +- 0.5, times powers of factors in discs of radii 0.5 and 0.25; factors are between 0 and 2."""
    ball = Ball(*(np.full((3, 1), own) for own in (3.0, 0.5, 1.0, 0.2, 0.1, 0.3)))
    tree = TreeDiscs(3, np.array([[0.5], [0.25]]), None, None)
    found = tree._product(ball, np.array([[0, 0], [1, 0], [2, 1]]))
    assert found.middle[:, 0].tolist() == [3.0] * 3
    radii = [0.5, 3.5 * 1.5 - 3, 3.5 * 1.5**2 * 1.25 - 3]
    assert found.radius[:, 0] == pytest.approx(radii, rel=1e-12)
    assert found.low[:, 0] == pytest.approx([1.0, *(3 - radius for radius in radii[1:])], rel=1e-12)
    assert found.slack[:, 0] == pytest.approx([0.1, 0.2, 0.8], rel=1e-12)
    assert found.root_slack[:, 0] == pytest.approx(0.3 * np.sqrt([1.0, 2.0, 8.0]), rel=1e-12)
