"""Complex discs hold what functions make of the numbers in them, and are as small as the linear map allows."""

import mpmath
import numpy as np
import pytest

from elvis.core.quantities.functions import FUNCTIONS, OPERATORS

EVERY = {**OPERATORS, **FUNCTIONS}
COUNT, POINTS = 400, 60


def real_power(a, b):
    return np.exp(b * np.log(a))


def continued_angle(y, x):
    """atan2 as an analytic function: the imaginary part of log(x + i y) of real numbers."""
    return -1j * np.log((x + 1j * y) / np.sqrt(x * x + y * y))


#: functions of complex numbers; none where branches are constants or operands
ANALYTIC = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "^": real_power,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "pow": real_power,
}


@pytest.fixture(autouse=True)
def silence():
    """Discs of no value are infinite, without a warning, as in expressions."""
    with np.errstate(all="ignore"):
        yield


def random_discs(rng, size=1.0):
    middle = size * rng.uniform(-2.0, 3.0, COUNT)
    return middle, 10.0 ** rng.uniform(-6.0, 0.3, COUNT) * size


def inside(rng, disc):
    """(n, points) complex points of discs (n,), most of them on their borders."""
    part = np.minimum(1.0, rng.uniform(0.0, 3.0, (COUNT, POINTS)))
    turn = np.exp(1j * rng.uniform(0.0, 2 * np.pi, part.shape))
    return disc[0][:, None] + disc[1][:, None] * part * turn


def check(disc, values):
    middle, radius = (np.broadcast_to(part, COUNT)[:, None] for part in disc)
    is_known = np.isfinite(radius[:, 0])
    assert is_known.mean() > 0.1
    off = np.abs(values - middle)[is_known]
    tiny = 1e-14 * (1.0 + np.abs(values[is_known]))  # rounding of the points and values themselves
    assert (off <= radius[is_known] + tiny).all()


@pytest.mark.parametrize("name", ANALYTIC)
def test_values_at_complex_numbers_lie_in_the_discs(name):
    rng = np.random.default_rng(len(name))
    size = 0.3 if name in ("asin", "acos") else 1.0
    operands = [random_discs(rng, size) for _ in range(EVERY[name].arity)]
    check(EVERY[name].disc(*operands), ANALYTIC[name](*(inside(rng, own) for own in operands)))


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0, 3.0, 7.0, 20.0, -1.0, -2.0, -5.0, 0.5, 0.3, 1.5, 3.7, -0.5, -2.5])
def test_values_of_powers_lie_in_the_discs(exponent):
    rng = np.random.default_rng(3)
    disc = random_discs(rng)
    points = inside(rng, disc)
    check(OPERATORS["^"].disc(disc, (np.float64(exponent), np.float64(0.0))), points**exponent)


@pytest.mark.parametrize("name", ["abs", "sign", "min", "max", "step", "atan2"])
def test_branches_are_told_only_where_real_numbers_in_the_discs_share_them(name):
    rng = np.random.default_rng(5)
    operands = [random_discs(rng) for _ in range(EVERY[name].arity)]
    points = [inside(rng, own).real for own in operands]
    found = EVERY[name].disc(*operands)
    check(found, EVERY[name].numpy(*points))
    ends = [np.stack([own[0] - own[1], own[0] + own[1]], axis=1) for own in operands]
    if name == "abs":
        assert (np.isfinite(found[1]) == (ends[0][:, 0] * ends[0][:, 1] > 0)).all()
    if name == "step":
        overlap = (ends[0].min(axis=1) <= ends[1].max(axis=1)) & (ends[1].min(axis=1) <= ends[0].max(axis=1))
        assert (np.isinf(found[1]) == overlap).all()


def test_the_angle_is_analytic_where_its_disc_is_finite():
    rng = np.random.default_rng(6)
    y, x = random_discs(rng), random_discs(rng)
    found = FUNCTIONS["atan2"].disc(y, x)
    values = continued_angle(inside(rng, y), inside(rng, x))
    turns = np.round((found[0][:, None] - values.real) / (2 * np.pi))
    check(found, values + 2 * np.pi * turns)


def test_roots_of_cubics_lie_in_the_discs():
    rng = np.random.default_rng(7)
    a, b = random_discs(rng), random_discs(rng)
    a, b = (a[0], 0.05 * a[1]), (b[0], 0.05 * b[1])
    found = FUNCTIONS["imaginary_root"].disc(a, b)
    points = np.stack([inside(rng, a), inside(rng, b)], axis=2)
    values = np.zeros(points.shape[:2], complex)
    for k in np.flatnonzero(np.isfinite(found[1])):
        if found[0][k] == 0:
            assert (4 * points[k, :, 0].real ** 3 + 27 * points[k, :, 1].real ** 2 < 0).all()
            continue
        for j, (p, q) in enumerate(points[k]):
            roots = np.roots([1, 0, p, q])
            # half the difference of the pair that is nearly conjugate, over i
            pairs = [(roots[m] - roots[n]) / 2j for m in range(3) for n in range(3) if m != n]
            values[k, j] = min(pairs, key=lambda pair: abs(pair - found[0][k]))
    middle, radius = found[0][:, None], found[1][:, None]
    is_known = np.isfinite(found[1])
    assert is_known.mean() > 0.2
    assert (np.abs(values - middle) <= radius + 1e-12)[is_known].all()


def test_middle_eigenvalues_of_symmetric_matrices_lie_in_the_discs():
    rng = np.random.default_rng(8)
    spread = 10.0 ** rng.uniform(-4, -0.5, COUNT)
    entries = [(rng.uniform(-1, 1, COUNT), spread * rng.uniform(0, 1, COUNT)) for _ in range(6)]
    found = FUNCTIONS["middle_eigenvalue"].disc(*entries)
    xx, yy, zz, xy, xz, yz = (inside(rng, own) for own in entries)
    matrices = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(COUNT, POINTS, 3, 3)
    values = np.linalg.eigvals(matrices)
    nearest = np.take_along_axis(values, np.abs(values - found[0][:, None, None]).argmin(axis=2)[:, :, None], axis=2)[
        :, :, 0
    ]
    check((found[0], found[1] + 1e-12), nearest)
    reals = np.linalg.eigvalsh(matrices.real)[..., 1]
    check((found[0], found[1] + 1e-12), reals)


@pytest.mark.parametrize("name", [name for name in ANALYTIC if EVERY[name].arity == 1])
def test_small_discs_are_as_small_as_the_linear_map_makes_them(name):
    middle, radius = np.linspace(0.2, 0.8, 7), 1e-5
    found = EVERY[name].disc((middle, np.full(7, radius)))[1]
    slopes = [abs(float(mpmath.diff(getattr(mpmath, name), m))) for m in middle]
    assert (found <= 1.001 * radius * np.array(slopes)).all()


def _exact(numbers):
    return [mpmath.mpf(float(own)) for own in numbers]


def test_rounding_of_operations_is_in_the_radius():
    """tan near a multiple of pi by 200 digits: the middle's disc holds the truth."""
    places = np.array([355.0, 1e6, 3e8, 1.0, 0.1])
    found = FUNCTIONS["tan"].disc((places, np.zeros(5)))
    with mpmath.workdps(50):
        truths = [float(mpmath.tan(own) - middle) for own, middle in zip(*map(_exact, (places, found[0])), strict=True)]
    assert (np.abs(np.array(truths)) <= found[1]).all()
    assert (found[1] < 1e-13 * np.maximum(1.0, np.abs(found[0]))).all()


def test_a_branch_that_is_not_taken_counts_nothing():
    """0 times what may have a pole."""
    found = OPERATORS["*"].disc((np.zeros(1), np.zeros(1)), (np.array([np.nan]), np.array([np.inf])))
    assert found[0] == 0
    assert found[1] == 0
