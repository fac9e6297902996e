"""Enclosures operation by operation, on the device (discs) and on the host (intervals): what they promise of every box.

Boxes are ordinary, wide, huge, tiny, next to poles and zeros, and no numbers at all.  Truth is arithmetic with 64 bits
(long doubles) at points of the boxes.  Values that aren't finite are not skipped: where a function lacks one, the
enclosure says that it may.
"""

from pathlib import Path

import numpy as np
import pytest

from elvis.core.quantities.functions import FUNCTIONS, OPERATORS
from elvis.core.quantities.functions import partials as partials_of
from elvis.core.quantities.tree import call, field, leaves, ordered

LONG = np.longdouble
pytestmark = pytest.mark.skipif(np.finfo(LONG).nmant < 63, reason="long doubles are no longer than doubles here")


def defined(function, where):
    """A function that is not a number unless a condition holds."""

    def of(a, b):
        return np.where(where(a, b), function(a, b), np.nan)

    return of


def power(a, b):
    return np.where((a > 0) | ((a == 0) & (b >= 0)) | ((a < 0) & (b == np.round(b))), np.power(a, b), np.nan)


#: in the order of operations_check.slang: what is true of complex numbers too, then of real ones alone
ANALYTIC = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "3.7 *": lambda a, b: LONG(3.7) * a,
    "/": defined(lambda a, b: a / b, lambda a, b: b != 0),
    "^": None,
    "^0": lambda a, b: a**0,
    "^2": lambda a, b: a**2,
    "^5": lambda a, b: a**5,
    "^-1": defined(lambda a, b: 1 / a, lambda a, b: a != 0),
    "^-4": defined(lambda a, b: 1 / a**4, lambda a, b: a != 0),
    "sqrt": lambda a, b: np.sqrt(a),
    "exp": lambda a, b: np.exp(a),
    "log": defined(lambda a, b: np.log(a), lambda a, b: a != 0),
    "sin": lambda a, b: np.sin(a),
    "cos": lambda a, b: np.cos(a),
    "tan": lambda a, b: np.tan(a),
    "asin": lambda a, b: np.arcsin(a),
    "acos": lambda a, b: np.arccos(a),
    "atan": lambda a, b: np.arctan(a),
    "atan2": None,
    "sinh": lambda a, b: np.sinh(a),
    "cosh": lambda a, b: np.cosh(a),
    "tanh": lambda a, b: np.tanh(a),
    "abs": None,
    "min": None,
    "max": None,
    "sign": None,
    "step": None,
    "min(sqrt)": None,
}
REAL = {
    "^": power,
    "atan2": np.arctan2,
    "abs": lambda a, b: np.abs(a),
    "min": np.minimum,
    "max": np.maximum,
    "sign": lambda a, b: np.sign(a),
    "step": lambda a, b: np.where(a < b, LONG(1), LONG(0)),
    "min(sqrt)": lambda a, b: np.minimum(np.sqrt(a), b),
}
NAMES = list(ANALYTIC)
COUNT, POINTS = 300, 24
MOST = LONG(np.finfo(np.float64).max)
SPECIAL = [0.0, 1.0, -1.0, 0.5, 2.0, 3.0, np.pi / 2, np.pi, 1e6, 745.0, -745.0, 709.0]


def boxes(rng, kind, count=COUNT):
    """(n,) middles and radii."""
    sign = rng.choice([-1.0, 1.0], count)
    small = 10.0 ** rng.uniform(-17.0, 0.0, count)
    if kind == "ordinary":
        return rng.uniform(-3.0, 3.0, count), 10.0 ** rng.uniform(-16.0, 0.5, count)
    if kind == "wide":
        return rng.uniform(-30.0, 800.0, count), 10.0 ** rng.uniform(0.0, 3.0, count)
    if kind == "huge":
        size = 10.0 ** rng.uniform(4.0, 308.0, count)
        return sign * size, size * small
    if kind == "tiny":
        size = 10.0 ** rng.uniform(-323.0, -4.0, count)
        return sign * size, size * small * 10.0 ** rng.uniform(0.0, 2.0, count)
    if kind == "beside zero":
        size = 10.0 ** rng.uniform(-8.0, 4.0, count)
        return sign * size, size * np.clip(1.0 + sign * small, 0.0, None)
    if kind == "beside one":
        radius = 10.0 ** rng.uniform(-9.0, -0.2, count)
        return sign * (1.0 - radius * (1.0 + small * rng.choice([-1.0, 0.0, 1.0], count))), radius
    if kind == "special":
        return rng.choice(SPECIAL, count), rng.choice([0.0, 1e-300, 1e-16, 1e-3, 1.0], count)
    assert kind == "no numbers"
    middle = rng.choice([np.nan, np.inf, -np.inf, 1.0], count)
    return middle, rng.choice([np.nan, np.inf, 0.5, 0.0], count)


KINDS = ("ordinary", "wide", "huge", "tiny", "beside zero", "beside one", "special")


def every_pair(rng):
    """Boxes of all kinds with boxes of all kinds: (4, n) middles and radii of both."""
    pairs = []
    for first in KINDS:
        for second in ("ordinary", first, KINDS[rng.integers(len(KINDS))]):
            pairs.append(np.stack([*boxes(rng, first), *boxes(rng, second)]))
    return np.concatenate(pairs, axis=1)


def inside(rng, middle, radius):
    """(n, points) numbers of 64-bit floats within boxes, many at the ends."""
    part = np.clip(rng.uniform(-1.5, 1.5, (len(middle), POINTS)), -1.0, 1.0)
    with np.errstate(all="ignore"):
        found = middle[:, None] + part * radius[:, None]
    is_in = np.abs(found.astype(LONG) - middle[:, None].astype(LONG)) <= radius[:, None].astype(LONG)
    return np.where(is_in, found, middle[:, None])


def as_doubles(values):
    """Infinite where doubles are: nobody promises more."""
    return np.where(np.abs(values) > MOST, np.inf * np.sign(values), values)


def truth(name, a, b):
    with np.errstate(all="ignore"):
        return as_doubles((ANALYTIC[name] or REAL[name])(a.astype(LONG), b.astype(LONG)))


@pytest.fixture(scope="module")
def made(renderer):
    """(n, 4) discs that become of pairs of discs (n, 3), and values (n, points) of pairs of points."""
    device = renderer("vulkan").device
    folders = list(device._folders)
    device.include(Path(__file__).parent / "shaders")
    kernel = device.kernel("operations_check")
    device.include(folders[-1])

    def make(name, first, second, a=None, b=None):
        a, b = (
            np.tile(each[:, :1], POINTS) if points is None else points for each, points in ((first, a), (second, b))
        )
        pairs = np.zeros(len(first), kernel.dtype("pairs"))
        pairs["first"][:, :3], pairs["second"][:, :3] = first, second
        pairs["function"] = NAMES.index(name)
        found, values = device.empty(np.float64, 4 * len(first)), device.empty(np.float64, a.size)
        points = np.ascontiguousarray(np.stack([a, b], axis=2))
        buffers = {
            "pairs": device.buffer(pairs),
            "points": device.buffer(points.reshape(-1)),
            "found": found,
            "element_constants": device.buffer(np.zeros(1)),
        }
        kernel(len(first), {**buffers, "values": values})
        read = device.read(found, np.float64)[: 4 * len(first)].reshape(-1, 4)
        return read, device.read(values, np.float64)[: a.size].reshape(a.shape)

    return make


@pytest.mark.parametrize("name", NAMES)
def test_discs_contain_true_values_and_errors_of_computed_ones(made, name):
    """True values of the real box are within radius + error of the middle; computed ones, of operands that are off by
    as much as they say, within the error of the true one.  Where there may be none, it isn't total, nor smooth."""
    rng = np.random.default_rng(NAMES.index(name))
    middle, radius, other, width = every_pair(rng)
    size = np.abs(np.stack([middle, other]))
    with np.errstate(all="ignore"):
        errors = size * 10.0 ** rng.uniform(-17.0, -1.0, size.shape)
    errors *= rng.choice([0.0, 1.0], size.shape)
    a, b = inside(rng, middle, radius), inside(rng, other, width)
    exact = truth(name, a, b)
    with np.errstate(all="ignore"):
        moved = [x + rng.choice([-0.99, 0.0, 0.99], x.shape) * e[:, None] for x, e in zip((a, b), errors, strict=True)]
    off = [np.abs(x.astype(LONG) - y.astype(LONG)) for x, y in zip((a, b), moved, strict=True)]
    moved = [np.where(d <= e[:, None], y, x) for x, y, d, e in zip((a, b), moved, off, errors, strict=True)]
    first, second = (np.stack(each, axis=1) for each in ((middle, radius, errors[0]), (other, width, errors[1])))
    discs, computed = made(name, first, second, *moved)

    centre, room, error, flags = discs.T
    is_smooth, is_total = flags % 2 == 1, flags >= 2
    most = room * (1 + 1e-9) + error
    is_known = most < 1e300
    there = np.isfinite(exact)
    with np.errstate(all="ignore"):
        beyond = np.abs(exact - centre[:, None]) > most[:, None]
        far = np.abs(computed - exact) > error[:, None]
    assert not (beyond & there)[is_known].any()
    assert not (far & there & np.isfinite(computed))[is_known].any()

    # nothing is known where values are too large, and all are there where that is said
    assert not np.isinf(exact[is_known]).any()
    assert there[is_known & is_total].all()
    assert np.isfinite(computed[is_known & is_total]).all()
    assert is_total[is_known & is_smooth].all()
    assert is_known.mean() > 0.2


@pytest.mark.parametrize("name", [name for name, function in ANALYTIC.items() if function])
def test_smooth_discs_contain_complex_values(made, name):
    rng = np.random.default_rng(100 + NAMES.index(name))
    middle, radius, other, width = every_pair(rng)
    exact = [np.stack([*each, np.zeros(len(middle))], axis=1) for each in ((middle, radius), (other, width))]
    discs, _ = made(name, *exact)
    centre, room, error, flags = discs.T
    is_smooth = (flags % 2 == 1) & (room + error < 1e300)

    def around(middle, radius):
        part = np.clip(rng.uniform(0.0, 2.0, (len(middle), POINTS)), 0.0, 1.0)
        turn = np.exp(1j * rng.uniform(0.0, 2 * np.pi, part.shape)).astype(np.clongdouble)
        centre, most = middle[:, None].astype(LONG), radius[:, None].astype(LONG)
        found = centre + part * turn * most
        return np.where(np.abs(found - centre) <= most, found, centre)

    with np.errstate(all="ignore"):
        values = ANALYTIC[name](around(middle, radius), around(other, width))
        far = ~(np.abs(values - centre[:, None]) <= (room * (1 + 1e-9) + error)[:, None])
    # products of complex numbers lose what is less than doubles hold, sums of huge ones overflow on the way
    assert not far[is_smooth & (np.abs(middle) < 1e140)].any()
    assert is_smooth.sum() > 500


@pytest.mark.parametrize("name", NAMES)
def test_nan_is_unbounded(made, name):
    rng = np.random.default_rng(200 + NAMES.index(name))
    middle, radius = boxes(rng, "no numbers")
    wrong = np.isnan(middle) | np.isnan(radius) | np.isinf(radius)
    first = np.stack([middle, radius, np.zeros(COUNT)], axis=1)
    second = np.tile([0.7, 0.1, 0.0], (COUNT, 1))
    both = "^0" not in name and name in ("+", "-", "*", "/", "^", "atan2", "min", "max", "step")
    for one, two in ((first, second), (second, first))[: 1 + both]:
        _, room, error, flags = made(name, one, two)[0].T
        # but of functions that have no other values
        is_known = room * (1 + 1e-9) + error < 1e300
        has_values = name in ("^0", "tanh", "sign", "step")
        assert has_values or not (is_known & (flags % 2 == 1))[wrong].any()


TIGHT = {"^-4": 1.1, "atan2": 1.1}


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("^0", "sign", "step")])
def test_radii_of_small_discs_are_nearly_minimal(made, name):
    """A hundredth wide: times the distance from the middle of the farthest value at the ends."""
    rng = np.random.default_rng(300 + NAMES.index(name))
    middle, other = rng.uniform(0.3, 0.8, (2, COUNT))
    radius = np.full(COUNT, 0.01)
    first, second = (np.stack([each, radius, 0 * each], axis=1) for each in (middle, other))
    a = middle[:, None] + radius[:, None] * np.array([-1, -1, 1, 1])
    b = other[:, None] + radius[:, None] * np.array([-1, 1, -1, 1])
    discs, _ = made(name, first, second)
    least = np.abs(truth(name, a, b) - truth(name, middle[:, None], other[:, None])).max(axis=1)
    ratio = np.median(discs[:, 1] / least)
    assert 0.99 < ratio < TIGHT.get(name, 1.03)


@pytest.mark.parametrize("name", ["min", "max"])
def test_discs_of_the_smaller_or_larger_are_their_range(made, name):
    """Of operands that overlap."""
    rng = np.random.default_rng(400 + NAMES.index(name))
    middle = rng.uniform(0.3, 0.8, COUNT)
    other, (radius, width) = middle + rng.uniform(-0.01, 0.01, COUNT), rng.uniform(0.01, 0.02, (2, COUNT))
    first, second = (np.stack([own, room, 0 * own], axis=1) for own, room in ((middle, radius), (other, width)))
    discs, _ = made(name, first, second)
    ends = [REAL[name](middle + sign * radius, other + sign * width) for sign in (-1, 1)]
    assert discs[:, 0] - discs[:, 1] == pytest.approx(ends[0], abs=1e-14)
    assert discs[:, 0] + discs[:, 1] == pytest.approx(ends[1], abs=1e-14)


@pytest.mark.parametrize(("part", "is_known"), [(0.99, True), (1.0, False)])
def test_jumps_and_the_smaller_operand_are_known_beyond_all_errors(made, part, is_known):
    """Of each operand at either side: a value at the end may be the jump itself."""
    for sign in (1, -1):
        own = np.array([[sign * 1.0, 0.75, part * 0.25]])
        _, room, _, _ = made("sign", own, own)[0][0]
        assert room == pytest.approx(0 if is_known else 1, abs=1e-14)
    near, far = np.array([[1.0, 0.5, 0.25]]), np.array([[2.25, 0.25, part * 0.25]])
    for name, side in (("min", 1), ("max", -1)):
        for pair in ((near, far), (far, near)):
            middle, room, error, _ = made(name, *(own * [side, 1, 1] for own in pair))[0][0]
            assert (middle, room) == pytest.approx((side * 1.0, 0.5), rel=1e-14)
            assert (error < 0.3) == is_known


# on the host


def test_every_operation_of_expressions_is_tried():
    names = {"^" if name == "pow" else name for name in (*OPERATORS, *FUNCTIONS)}
    assert names - {"imaginary_root", "middle_eigenvalue"} <= set(NAMES)


def intervals_of(rng, arity):
    """Intervals (n,) of each operand, of every kind, and points (n, points) in each."""
    columns = [[] for _ in range(arity)]
    for kind in KINDS:
        for column in columns:
            column.append(np.stack(boxes(rng, kind)))
    for column in columns:
        order = rng.permutation(len(KINDS) * COUNT)
        column[:] = [np.concatenate(column, axis=1)[:, order]]
    ends, points = [], []
    for ((middle, radius),) in columns:
        with np.errstate(all="ignore"):
            ends.append((middle - radius, middle + radius))
        part = np.clip(rng.uniform(-0.2, 1.2, (len(middle), POINTS)), 0.0, 1.0)
        low, high = (end[:, None] for end in ends[-1])
        with np.errstate(all="ignore"):
            points.append(np.clip(low + part * (high - low), low, high))
    return ends, points


HOST = [name for name in (*OPERATORS, *FUNCTIONS) if name not in ("imaginary_root", "middle_eigenvalue")]


def holds(interval, values):
    """Whether values (n, points) lie in intervals (n,), to rounding of their ends, infinite ones too."""
    low, high = (np.broadcast_to(end, len(values))[:, None] for end in interval)
    with np.errstate(all="ignore"):
        slack = 1e-15 * np.maximum(np.abs(low), np.abs(high)) + 1e-307
        slack = np.where(np.isfinite(slack), slack, 0.0)
        return np.isnan(values) | ((low - slack <= values) & (values <= high + slack))


@pytest.mark.parametrize("name", HOST)
def test_intervals_contain_values_of_every_box(name):
    """Exponents that are not constant, too; what isn't defined is left out, what is infinite is not."""
    function = {**FUNCTIONS, **OPERATORS}[name]
    ends, points = intervals_of(np.random.default_rng(400 + HOST.index(name)), function.arity)
    if name in ("^", "pow"):
        # whole exponents, some of which no rounding hides
        for row, exponent in enumerate(np.resize([2.0, 3.0, -1.0, 0.0, 7.0], 400)):
            ends[1][0][row] = ends[1][1][row] = points[1][row] = exponent
    with np.errstate(all="ignore"):
        found = function.interval(*ends)
        values = function.numpy(*points)
    assert holds(found, values).all()
    assert (np.isfinite(found[0]) & np.isfinite(found[1])).mean() > 0.05


@pytest.mark.parametrize("exponent", [2.0, 3.0, -1.0, -2.0, 0.5, -0.5, 2.7, 0.0, 1e300, -1e300])
def test_intervals_of_constant_powers_contain_values_of_every_box(exponent):
    (base,), (points,) = intervals_of(np.random.default_rng(5), 1)
    with np.errstate(all="ignore"):
        found = OPERATORS["^"].interval(base, (np.float64(exponent),) * 2)
        values = OPERATORS["^"].numpy(points, exponent)
    assert holds(found, values).all()


@pytest.mark.parametrize("name", HOST)
def test_intervals_contain_derivatives_of_every_box(name):
    """Of every operation in each operand, by the rules that derivatives of expressions are made with."""
    function = {**FUNCTIONS, **OPERATORS}[name]
    ends, points = intervals_of(np.random.default_rng(500 + HOST.index(name)), function.arity)
    operands = [field(letter, ()) for letter in "ab"[: function.arity]]
    for rule in partials_of(call("^" if name == "pow" else name, *operands)):
        root, bounds, values = rule(), {}, {}
        for leaf, own, place in zip(operands, ends, points, strict=True):
            bounds[leaf], values[leaf] = own, place
        for node in ordered(root):
            if node.op == "number":
                bounds[node], values[node] = (np.float64(node.value),) * 2, np.float64(node.value)
            elif node not in values:
                with np.errstate(all="ignore"):
                    own = {**FUNCTIONS, **OPERATORS}[node.op]
                    bounds[node] = own.interval(*(bounds[each] for each in node.operands))
                    values[node] = own.numpy(*(values[each] for each in node.operands))
        if leaves(root):
            assert holds(bounds[root], np.broadcast_to(values[root], points[0].shape)).all()
