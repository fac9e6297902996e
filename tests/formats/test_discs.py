"""Complex discs hold what functions make of the numbers in them, and are as small as the linear map allows."""

import mpmath
import numpy as np
import pytest
from scipy.optimize import brentq

from elvis.core.quantities import discs
from elvis.core.quantities.functions import FUNCTIONS, OPERATORS

EVERY = {**OPERATORS, **FUNCTIONS}
COUNT, POINTS = 400, 60
#: rounding of the model
COARSE = 2.0**-11


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
    # both real ends, and the points above and below the middle
    part[:, :4], turn[:, :4] = 1.0, [1.0, -1.0, 1j, -1j]
    return disc[0][:, None] + disc[1][:, None] * part * turn


def check(disc, values, teeth=0.0):
    """Values lie in discs, and some come near their borders."""
    middle, radius = (np.broadcast_to(part, COUNT)[:, None] for part in disc)
    is_known = np.isfinite(radius[:, 0])
    assert is_known.mean() > 0.1
    off = np.abs(values - middle)[is_known]
    tiny = 1e-14 * (1.0 + np.abs(values[is_known]))  # rounding of the points and values themselves
    assert (off <= radius[is_known] + tiny).all()
    is_large = radius[is_known][:, 0] > 0.1
    assert not teeth or (off[is_large] / radius[is_known][is_large]).max() > teeth


@pytest.mark.parametrize("name", ANALYTIC)
def test_values_at_complex_numbers_lie_in_the_discs(name):
    rng = np.random.default_rng(len(name))
    size = 0.3 if name in ("asin", "acos") else 1.0
    operands = [random_discs(rng, size) for _ in range(EVERY[name].arity)]
    check(EVERY[name].disc(*operands), ANALYTIC[name](*(inside(rng, own) for own in operands)), 0.9)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0, 3.0, 7.0, 20.0, -1.0, -2.0, -5.0, 0.5, 0.3, 1.5, 3.7, -0.5, -2.5])
def test_values_of_powers_lie_in_the_discs(exponent):
    rng = np.random.default_rng(3)
    disc = random_discs(rng)
    points = inside(rng, disc)
    check(OPERATORS["^"].disc(disc, (np.float64(exponent), np.float64(0.0))), points**exponent, 0.9 * (exponent != 0))


@pytest.mark.parametrize("name", ["abs", "sign", "min", "max", "step", "atan2"])
def test_branches_are_decided_only_if_all_real_numbers_in_the_discs_share_them(name):
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
    p, q = inside(rng, a), inside(rng, b)
    is_real = np.isfinite(found[1]) & (found[0] == 0)
    assert found[0] == pytest.approx(FUNCTIONS["imaginary_root"].numpy(a[0], b[0]), rel=1e-9, abs=1e-12)
    assert (4 * p.real**3 + 27 * q.real**2 < 0)[is_real].all()
    assert is_real.mean() > 0.05
    assert not found[1][is_real].any()

    # half the difference of the pair that is nearly conjugate, over i
    companions = np.zeros((COUNT, POINTS, 3, 3), complex)
    companions[..., [1, 2], [0, 1]] = 1.0
    companions[..., 0, 2], companions[..., 1, 2] = -q, -p
    roots = np.linalg.eigvals(companions)
    halves = ((roots[..., :, None] - roots[..., None, :]) / 2j).reshape(COUNT, POINTS, 9)
    nearest = np.abs(halves - found[0][:, None, None]).argmin(axis=2)
    values = np.take_along_axis(halves, nearest[..., None], axis=2)[..., 0]
    is_known = np.isfinite(found[1]) & (found[0] != 0)
    assert is_known.mean() > 0.2
    away = np.abs(values - found[0][:, None])[is_known]
    assert (away <= found[1][is_known, None] + 1e-12).all()
    assert (away.max(axis=1) / found[1][is_known]).max() > 0.3


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
def test_small_discs_are_as_small_as_their_linear_map(name):
    middle, radius = np.linspace(0.2, 0.8, 7), 1e-5
    found = EVERY[name].disc((middle, np.full(7, radius)))[1]
    slopes = [abs(float(mpmath.diff(getattr(mpmath, name), m))) for m in middle]
    assert (found <= 1.001 * radius * np.array(slopes)).all()


def _exact(numbers):
    return [mpmath.mpf(float(own)) for own in numbers]


def test_rounding_of_operations_is_in_the_radius():
    """tan near a multiple of pi by 200 digits: the middle's disc holds the truth."""
    places = np.array([355.0, 1e6, 3e8, 1.0, 0.1])
    places = np.concatenate([places, -places])
    found = FUNCTIONS["tan"].disc((places, np.zeros(10)))
    with mpmath.workdps(50):
        truths = [float(mpmath.tan(own) - middle) for own, middle in zip(*map(_exact, (places, found[0])), strict=True)]
    assert (np.abs(np.array(truths)) <= found[1]).all()
    assert (found[1] < 1e-13 * np.maximum(1.0, np.abs(found[0]))).all()


def test_an_unused_branch_has_no_effect():
    """0 times what may have a pole."""
    found = OPERATORS["*"].disc((np.zeros(1), np.zeros(1)), (np.array([np.nan]), np.array([np.inf])))
    assert found[0] == 0
    assert found[1] == 0


def above(rng):
    """Discs (COUNT,), bounds below the real parts and of the imaginary parts of numbers, and numbers in the discs."""
    disc = rng.uniform(0.5, 2.0, COUNT), rng.uniform(0.3, 3.0, COUNT)
    low, imaginary = rng.uniform(0.05, 0.4, COUNT), disc[1] * rng.uniform(0.3, 1.0, COUNT)
    angle = rng.uniform(0.0, 2 * np.pi, (COUNT, 300))
    part = np.sqrt(rng.uniform(0.0, 1.5, angle.shape))
    points = disc[0][:, None] + disc[1][:, None] * np.minimum(part, 1.0) * np.exp(1j * angle)
    return disc, low, imaginary, points


def test_functions_of_numbers_right_of_a_bound_lie_in_their_discs():
    disc, low, _, points = above(np.random.default_rng(9))
    points = np.where(points.real >= low[:, None], points, np.nan)
    one = np.full(COUNT, 1.0), np.full(COUNT, 0.5)
    functions = {
        "sqrt": (discs.root_above(disc, low), np.sqrt(points)),
        "log": (discs.logarithm_above(disc, low), np.log(points)),
        "/": (discs.over_above(one, disc, low), (1.0 - 0.5 * np.sign(disc[0] - 1))[:, None] / points),
    }
    for name, (found, values) in functions.items():
        part = np.nanmax(np.abs(values - found[0][:, None]), axis=1) / found[1]
        assert part.max() <= 1 + 1e-12, name
        assert part.max() > 0.6, name


def test_real_parts_of_squares_are_above_their_bounds():
    """Of numbers with small imaginary parts, and of any in a disc."""
    disc, _, imaginary, points = above(np.random.default_rng(10))
    for limit in (imaginary, disc[1]):
        held = np.where(np.abs(points.imag) <= limit[:, None], points, np.nan)
        for sign in (1, -1):
            bound = discs.square_above((sign * disc[0], disc[1]), limit)
            lowest = np.nanmin((held**2).real, axis=1)
            assert (lowest >= bound - 1e-12).all()
            # for half of the discs a tenth of the size of squares, at most, is lost
            assert np.median((lowest - bound) / (np.abs(disc[0]) + disc[1]) ** 2) < 0.1


@pytest.mark.parametrize("part", [0.99, 1.01])
def test_middle_eigenvalues_are_identified_until_another_may_coincide(part):
    """Matrices with eigenvalues -1, 0.5 and 1 may change by half the gap of 0.5: by their rows."""
    rng = np.random.default_rng(11)
    turns = np.linalg.qr(rng.normal(size=(COUNT, 3, 3)))[0]
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    for ends in ([-1.0, 0.5, 1.0], [-1.0, -0.5, 1.0]):
        middles = np.einsum("nik,k,njk->nij", turns, ends, turns)[:, rows, columns].T
        share = np.abs(rng.uniform(size=(6, COUNT)))
        largest = np.max(
            [share[0] + share[3] + share[4], share[3] + share[1] + share[5], share[4] + share[5] + share[2]], axis=0
        )
        radii = share / largest * 0.25 * part
        middle, radius = FUNCTIONS["middle_eigenvalue"].disc(*zip(middles, radii, strict=True))
        assert np.abs(middle - ends[1]).max() < 1e-12
        assert (np.isfinite(radius) == (part < 1)).all()
        if part < 1:
            assert np.abs(radius - 0.25 * part).max() < 1e-12


def test_angles_are_continuous_off_their_branch_cut():
    """As tight as the linear map: (r_y |x| + r_x |y|) / (x^2 + y^2)."""
    turn = np.linspace(-np.pi, np.pi, COUNT, endpoint=False)
    x, y, r = np.cos(turn), np.sin(turn), 1e-3
    middle, radius = FUNCTIONS["atan2"].disc((y, np.full(COUNT, r)), (x, np.full(COUNT, 2 * r)))
    jumps = (x < 0) & (np.abs(y) <= r)
    assert (np.isinf(radius) == jumps).all()
    assert (radius <= 1.02 * r * (np.abs(x) + 2 * np.abs(y)))[~jumps].all()
    assert np.abs(middle - turn)[1:].max() < 1e-15


def test_each_operation_is_rounded(monkeypatch):
    """With roundings so coarse that their squares count; operands are exact."""
    monkeypatch.setattr(discs, "_ROUNDING", COARSE)
    exact = (np.array([0.3, 0.6, -0.4]), np.zeros(3))
    other = (np.array([0.7, 0.5, 0.9]), np.zeros(3))
    for name in (*ANALYTIC, "atan2", "abs"):
        if name in ("sqrt", "log", "pow", "^"):
            continue
        middle, radius = EVERY[name].disc(*(exact, other)[: EVERY[name].arity])
        is_difference = name in ("asin", "acos")
        assert (radius >= COARSE * (np.abs(middle) + is_difference)).all(), name
        assert (radius <= 8 * COARSE * (np.abs(middle) + 1)).all(), name
    for own in (discs.root(other), discs.logarithm(other), discs.power(other, discs.number(2.5))):
        assert (own[1] >= COARSE * np.abs(own[0])).all()
    # powers grow by as many roundings
    wide = (np.full(3, 2.0), np.full(3, 0.5))
    for exponent, nearest in ((5.0, 2.5), (2.5, 2.5), (-2.5, 1.5)):
        middle, radius = discs.power(wide, discs.number(exponent))
        exact_radius = abs(nearest**exponent - 2.0**exponent)
        wanted = exact_radius * (1 + abs(exponent) * COARSE)
        assert (radius >= wanted + COARSE * (middle + exact_radius)).all()
        assert (radius <= wanted + 1.1 * COARSE * (middle + wanted)).all()


@pytest.mark.parametrize("part", [-0.55, 0.0, 0.4])
def test_discs_within_rounding_of_a_pole_are_infinite(part):
    """Poles of tan at pi/2, of tanh at i pi/2, of atan at i."""
    off = 1 + part * discs._ROUNDING
    for place in (0.0, 0.4, -0.4):
        for function, pole in (("tan", np.pi / 2 - abs(place)), ("atan", np.hypot(1, place))):
            assert np.isinf(FUNCTIONS[function].disc((np.array([place]), np.array([pole * off])))[1]).all(), function
            assert np.isfinite(FUNCTIONS[function].disc((np.array([place]), np.array([pole * 0.99])))[1]).all()
    assert np.isinf(discs.hyperbolic_tangent((np.array([0.3]), np.array([np.pi / 2 * off])))[1]).all()
    assert np.isfinite(discs.hyperbolic_tangent((np.array([0.3]), np.array([np.pi / 2 * 0.99])))[1]).all()


def test_distances_from_poles_are_rounded_in_proportion_to_the_number(monkeypatch):
    """30 is 1.42 below 10 pi: its disc ends before the next pole by three quarters of its rounding."""
    monkeypatch.setattr(discs, "_ROUNDING", COARSE)
    for place in (30.0, -30.0):
        radius = np.pi / 2 - (10 * np.pi - 30) - 0.75 * 30 * COARSE
        assert np.isinf(discs.tangent((np.array([place]), np.array([radius])))[1]).all()


def test_rounding_of_a_cubic_is_in_the_disc_of_its_root(monkeypatch):
    """t^3 - 2 t - 4 has the root 2, where its derivative is 10 and its terms add up to 16."""
    monkeypatch.setattr(discs, "_ROUNDING", COARSE)
    exact = (np.array([-2.0]), np.zeros(1)), (np.array([-4.0]), np.zeros(1))
    middle, radius = discs._real_root(*exact, np.array([2.0]))
    assert middle == 2.0
    assert 16 * COARSE / 10 <= radius[0] < 8 * 16 * COARSE / 10
    off = discs._real_root(exact[0], (exact[1][0], np.array([0.1])), np.array([2.0]))[1]
    assert off[0] >= radius[0] + 0.1 / 10

    # the last term may be off by the rounding of all, and the derivative by its own
    wanted = 2 * 16 * COARSE / (10 * (1 - COARSE))
    assert radius[0] >= discs.rounded(2.0, wanted)[1] * (1 - 1e-12)


def test_middle_eigenvalues_are_rounded_by_the_size_of_the_matrix(monkeypatch):
    monkeypatch.setattr(discs, "_ROUNDING", 1e-4)
    entries = [(np.array([value]), np.zeros(1)) for value in (1.0, -2.0, 4.0, 0.0, 0.0, 0.0)]
    middle, radius = discs.middle_eigenvalue(lambda *entries: np.median(entries[:3], axis=0))(*entries)
    assert middle[0] == 1.0
    assert 1e-4 * 7.0 <= radius[0] <= 2e-4 * 7.0


@pytest.mark.parametrize(("part", "is_proved"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("root", [2.0, -2.0])
def test_roots_are_proved_as_far_as_newtons_map_is_a_contraction(part, is_proved, root, monkeypatch):
    """Of t^3 + a t + b at 2: 12 w + 3 w^2 < s for w = 2 r / s, with an error r of b and the slope s.

    An error e of a is one of 2 e and reduces the slope by e: then w = 4 e / (s - e).
    """
    monkeypatch.setattr(discs, "_ROUNDING", 0.0)
    for slope in (0.1, 1.0, 5.0):
        a, b = np.array([slope - 12.0]), np.sign(root) * np.array([16.0 - 2 * slope])
        width = np.sqrt(4 + slope / 3) - 2
        radius = discs._real_root((a, np.zeros(1)), (b, np.array([part * slope * width / 2])), np.array([root]))[1]
        assert np.isfinite(radius[0]) == is_proved
        if is_proved:
            assert radius[0] == pytest.approx(part * width, rel=1e-9)
        largest = brentq(lambda w, s=slope: 12 * w + 3 * w**2 - 4 * s / (4 + w), 0, 2)
        error = part * largest * slope / (4 + largest)
        radius = discs._real_root((a, np.array([error])), (b, np.zeros(1)), np.array([root]))[1]
        assert np.isfinite(radius[0]) == is_proved


@pytest.mark.parametrize(("part", "is_known"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("shift", [0.0, 1.0, -2.0])
def test_gaps_of_eigenvalues_are_less_by_the_root_of_rounding(part, is_known, shift, monkeypatch):
    """Middle eigenvalues half a unit from another: their gap is a root of differences of squares."""
    monkeypatch.setattr(discs, "_ROUNDING", 1e-4)
    values = np.array([-1.0, 0.5, 1.0]) + shift
    moved = (0.5 - 1e-2 * np.abs(values).sum()) / 2 * part
    entries = [(np.array([value]), np.zeros(1)) for value in (*values, 0.0, 0.0, 0.0)]
    entries[0] = entries[0][0], np.array([moved])
    middle, radius = discs.middle_eigenvalue(lambda *entries: np.median(entries[:3], axis=0))(*entries)
    assert middle[0] == values[1]
    assert np.isfinite(radius[0]) == is_known


def test_real_parts_of_squares_attain_their_bounds_on_circles():
    middle, radius = np.array([0.0, 0.5, 1.0, 1.9, 2.1, -2.1]), np.ones(6)
    points = middle[:, None] + np.exp(1j * np.linspace(0, 2 * np.pi, 3001))
    lowest = (points**2).real.min(axis=1)
    assert discs.square_above((middle, radius), np.inf) == pytest.approx(lowest, abs=1e-4)


#: signs that operands may have without a change of the value but for its sign
SIGNS = {
    "+": [(-1, -1)],
    "-": [(-1, -1)],
    "*": [(-1, 1), (1, -1)],
    "/": [(-1, 1), (1, -1)],
    "atan2": [(-1, 1)],
    "imaginary_root": [(1, -1)],
    "middle_eigenvalue": [(-1,) * 6],
} | {name: [(-1,)] for name in ("abs", "sign", "sin", "cos", "tan", "asin", "atan", "sinh", "cosh", "tanh")}


@pytest.mark.parametrize("name", SIGNS)
def test_radii_of_odd_and_even_functions_do_not_depend_on_signs(name, monkeypatch):
    """Rounding, which is a part of magnitudes, doesn't either."""
    monkeypatch.setattr(discs, "_ROUNDING", COARSE)
    rng = np.random.default_rng(13)
    operands = [(middle, 0.1 * radius) for middle, radius in (random_discs(rng) for _ in range(EVERY[name].arity))]
    radius = EVERY[name].disc(*operands)[1]
    assert np.isfinite(radius).mean() > 0.05
    for signs in SIGNS[name]:
        turned = [(sign * own[0], own[1]) for sign, own in zip(signs, operands, strict=True)]
        np.testing.assert_allclose(EVERY[name].disc(*turned)[1], radius, rtol=1e-9)


def test_whole_powers_are_as_wide_for_negative_numbers():
    middle, radius = random_discs(np.random.default_rng(14))
    for exponent in (2.0, 3.0, 4.0, -1.0, -3.0):
        wanted = discs.power((middle, radius), discs.number(exponent))[1]
        np.testing.assert_allclose(discs.power((-middle, radius), discs.number(exponent))[1], wanted, rtol=1e-9)
        at_zero = discs.power((0 * middle, radius), discs.number(exponent))[1]
        np.testing.assert_allclose(at_zero, radius**exponent if exponent > 0 else np.inf, rtol=1e-9)


def test_discs_that_touch_a_pole_or_a_jump_are_infinite():
    at_zero = np.ones(1), np.ones(1)
    for found in (
        discs.over(discs.number(1.0), at_zero),
        discs.power(at_zero, discs.number(0.5)),
        discs.logarithm(at_zero),
        discs.absolute(at_zero),
        discs.sign(at_zero),
        discs.angle(at_zero, (np.full(1, -2.0), np.zeros(1))),
        discs.root_above(at_zero, np.zeros(1)),
    ):
        assert np.isinf(found[1]).all()
