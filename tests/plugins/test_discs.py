"""Discs hold what functions make of complex numbers in them, and of real ones that are computed with errors."""

from pathlib import Path

import numpy as np
import pytest

FUNCTIONS = {
    "plus": lambda a, b: a + b,
    "minus": lambda a, b: a - b,
    "times": lambda a, b: a * b,
    "over": lambda a, b: a / b,
    "cube": lambda a, b: a**3,
    "inverse square": lambda a, b: a**-2,
    "power": lambda a, b: np.exp(b * np.log(a)),
    "sqrt": lambda a, b: np.sqrt(a),
    "exp": lambda a, b: np.exp(a),
    "log": lambda a, b: np.log(a),
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
}
REAL = {
    "atan2": np.arctan2,
    "abs": lambda a, b: np.abs(a),
    "min": np.minimum,
    "max": np.maximum,
    "sign": lambda a, b: np.sign(a),
    "step": lambda a, b: np.where(a < b, 1.0, 0.0),
}
COUNT, POINTS = 400, 40
NAMES = list(FUNCTIONS)


@pytest.fixture(scope="module")
def kernel_of(renderer):
    """The device, and a kernel of the tests' own."""
    device = renderer("vulkan").device

    def load(stage):
        folders = list(device._folders)
        device.include(Path(__file__).parent / "shaders")
        kernel = device.kernel(stage)
        device.include(folders[-1])
        return device, kernel

    return load


@pytest.fixture(scope="module")
def made(kernel_of):
    """Pairs of discs, and what becomes of them: (n, 8) middle, radius, error, whether smooth, slope and rest."""
    device, kernel = kernel_of("discs_check")

    def make(name, first, second, slopes=(0.0, 0.0)):
        pairs = np.zeros(len(first), kernel.dtype("pairs"))
        pairs["first"][:, :3], pairs["second"][:, :3] = first, second
        pairs["first_slope"], pairs["second_slope"] = slopes
        pairs["function"] = NAMES.index(name)
        found = device.empty(np.float64, 8 * len(first))
        kernel(len(first), {"pairs": device.buffer(pairs), "found": found})
        return device.read(found, np.float64)[: 8 * len(first)].reshape(-1, 8)

    return make


def random_discs(rng, error=0.0):
    middle = rng.uniform(-2.0, 3.0, COUNT)
    radius = 10.0 ** rng.uniform(-6.0, 0.3, COUNT)
    return np.stack([middle, radius, np.full(COUNT, error)], axis=1)


def inside(rng, discs, real):
    """(n, points) random points of discs, on their borders mostly."""
    angle = rng.uniform(0.0, 2.0 * np.pi, (len(discs), POINTS))
    part = np.minimum(1.0, rng.uniform(0.0, 2.0, angle.shape))
    offset = part * np.where(rng.random(angle.shape) < 0.5, -1.0, 1.0) if real else part * np.exp(1j * angle)
    return discs[:, :1] + discs[:, 1:2] * offset


def check(rows, values, known):
    """Values (n, points) lie in discs, whose radius is something where ``known``."""
    tiny = 1e-13 * (1.0 + np.abs(values))
    room = np.where(np.isfinite(rows[:, 1:2]), rows[:, 1:2], np.inf)
    assert (np.abs(values - rows[:, :1]) <= room + tiny)[known].all()
    assert known.mean() > 0.1


@pytest.mark.parametrize("name", [name for name, function in FUNCTIONS.items() if function])
def test_complex_values_lie_in_the_discs_of_analytic_functions(made, name):
    """Of functions that are analytic on their operands' discs."""
    rng = np.random.default_rng(NAMES.index(name))
    first, second = random_discs(rng), random_discs(rng)
    if name in ("asin", "acos"):
        first[:, 0] *= 0.3
    rows = made(name, first, second)
    smooth = (rows[:, 3] != 0) & np.isfinite(rows[:, 1])
    with np.errstate(all="ignore"):
        values = FUNCTIONS[name](inside(rng, first, False).astype(complex), inside(rng, second, False).astype(complex))
    check(rows, values, smooth)


@pytest.mark.parametrize("name", ["plus", "minus", "times", "over", "cube", "inverse square", "exp"])
def test_linear_parts_are_those_of_values(made, name):
    """Operands that depend on the same t, |t| <= 1, and on something small besides: so do values."""
    rng = np.random.default_rng(300 + NAMES.index(name))
    first, second = random_discs(rng), random_discs(rng)
    slopes = 10.0 ** rng.uniform(-6.0, 0.0, (2, COUNT, 3)) * rng.choice([-1.0, 1.0], (2, COUNT, 3))
    rows = made(name, first, second, slopes)
    angle = rng.uniform(0.0, 2.0 * np.pi, (COUNT, POINTS, 3))
    t = np.minimum(1.0, rng.uniform(0.0, 2.0, angle.shape)) * np.exp(1j * angle)
    a, b = (np.einsum("npk,nk->np", t, slope) for slope in slopes)
    with np.errstate(all="ignore"):
        values = FUNCTIONS[name](inside(rng, first, False) + a, inside(rng, second, False) + b)
        linear = np.einsum("npk,nk->np", t, rows[:, 4:7])
    known = (rows[:, 3] != 0) & np.isfinite(rows[:, 1])
    check(rows, values, known)
    check(np.stack([rows[:, 0], rows[:, 7]], axis=1), values - linear, known)
    if name in ("plus", "times"):
        assert (np.abs(rows[:, 4:7]).sum(axis=1) > rows[:, 7]).mean() > 0.05


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("power",)])
def test_real_values_lie_in_the_discs_of_all_functions(made, name):
    """Also where they have kinks, jumps or other branches; where a function isn't defined nothing is said."""
    rng = np.random.default_rng(100 + NAMES.index(name))
    first, second = random_discs(rng), random_discs(rng)
    rows = made(name, first, second)
    function = FUNCTIONS[name] or REAL[name]
    with np.errstate(all="ignore"):
        values = function(inside(rng, first, True), inside(rng, second, True))
    defined = np.isfinite(values).all(axis=1) & np.isfinite(rows[:, 1])
    check(rows, values, defined)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("sign", "step")])
def test_errors_of_operands_become_errors_of_results(made, name):
    """Operands that are off by as much as they say make values that are off by no more than the result says."""
    rng = np.random.default_rng(200 + NAMES.index(name))
    error = 1e-6
    first, second = random_discs(rng, error), random_discs(rng, error)
    first[:, 1], second[:, 1] = 1e-2, 1e-2
    rows = made(name, first, second)
    function = FUNCTIONS[name] or REAL[name]
    a, b = inside(rng, first, True), inside(rng, second, True)
    shift, other = (rng.choice([-error, error], a.shape) for _ in range(2))
    with np.errstate(all="ignore"):
        moved = np.abs(function(a + shift, b + other) - function(a, b))
    known = np.isfinite(moved).all(axis=1) & np.isfinite(rows[:, 2])
    assert (moved <= 1.001 * rows[:, 2:3] + 1e-13)[known].all()
    assert known.mean() > 0.1


def test_radii_are_those_of_the_derivative_where_discs_are_small(made):
    """Tight: a disc's radius is at most 1.01 times that of the linear map."""
    rng = np.random.default_rng(5)
    first = random_discs(rng)
    first[:, 0], first[:, 1] = rng.uniform(0.2, 0.8, COUNT), 1e-6
    steep = {"sqrt": lambda a: 0.5 / np.sqrt(a), "exp": np.exp, "log": lambda a: 1 / a, "sinh": np.cosh}
    for name, derivative in steep.items():
        rows = made(name, first, first)
        bound = 1e-6 * derivative(first[:, 0])
        assert (rows[:, 1] <= (1.01 if name != "sinh" else 1.5) * bound).all(), name


def test_signs_of_eigenvalues_are_those_of_all_matrices_in_discs(kernel_of):
    """1: the second is never 0; -1: the first is below 0, the third above.  Told wherever discs are small enough."""
    rng = np.random.default_rng(6)
    spread = 10.0 ** rng.uniform(-4.0, 0.0, COUNT)
    turns = np.linalg.qr(rng.normal(size=(COUNT, 3, 3)))[0]
    ends = np.sort(rng.uniform(-1.0, 1.0, (COUNT, 3)), axis=1)
    ends[::2, 1] *= 0.1
    middles = np.einsum("nik,nk,njk->nij", turns, ends, turns)
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    slopes = spread[:, None, None] * rng.normal(size=(COUNT, 6, 3))
    rest = 0.1 * spread[:, None] * rng.uniform(size=(COUNT, 6))

    device, kernel = kernel_of("eigenvalues_check")
    entries = np.concatenate([middles[:, rows, columns][..., None], slopes, rest[..., None]], axis=2)
    verdicts = device.empty(np.float64, COUNT)
    kernel(COUNT, {"entries": device.buffer(entries.reshape(-1)), "verdicts": verdicts})
    verdict = device.read(verdicts, np.float64)[:COUNT]

    t = rng.choice([-1.0, 1.0, 0.3], (COUNT, POINTS, 3))
    values = entries[:, None, :, 0] + np.einsum("nek,npk->npe", slopes, t)
    values += rest[:, None] * rng.uniform(-1.0, 1.0, values.shape)
    matrices = np.zeros((COUNT, POINTS, 3, 3))
    matrices[..., rows, columns] = matrices[..., columns, rows] = values
    found = np.linalg.eigvalsh(matrices)
    assert (np.abs(np.sign(found[..., 1]).sum(axis=1)) == POINTS)[verdict == 1].all()
    assert ((found[..., 0] < 0) & (found[..., 2] > 0)).all(axis=1)[verdict == -1].all()
    known = 8 * spread < np.max([np.abs(ends[:, 1]), np.minimum(-ends[:, 0], ends[:, 2])], axis=0)
    assert (verdict[known] != 0).mean() > 0.98
    assert min((verdict == 1).sum(), (verdict == -1).sum()) > COUNT / 10
