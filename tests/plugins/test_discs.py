"""Linear parts of discs, how close discs are, and signs of eigenvalues of matrices in discs."""

from itertools import product
from pathlib import Path

import mpmath
import numpy as np
import pytest

#: in the order of discs_check.slang; tests/plugins/test_operations.py has all functions, without linear parts
FUNCTIONS = {
    "plus": lambda a, b: a + b,
    "minus": lambda a, b: a - b,
    "times": lambda a, b: a * b,
    "over": lambda a, b: a / b,
    "cube": lambda a, b: a**3,
    "inverse square": lambda a, b: a**-2,
    "exp": lambda a, b: np.exp(a),
    "sqrt": lambda a, b: np.sqrt(a),
    "log": lambda a, b: np.log(a),
    "sinh": lambda a, b: np.sinh(a),
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


def random_discs(rng):
    middle = rng.uniform(-2.0, 3.0, COUNT)
    radius = 10.0 ** rng.uniform(-6.0, 0.3, COUNT)
    return np.stack([middle, radius, np.zeros(COUNT)], axis=1)


def inside(rng, discs):
    """(n, points) random complex points of discs, on their borders mostly."""
    angle = rng.uniform(0.0, 2.0 * np.pi, (len(discs), POINTS))
    part = np.minimum(1.0, rng.uniform(0.0, 2.0, angle.shape))
    return discs[:, :1] + discs[:, 1:2] * part * np.exp(1j * angle)


def check(rows, values, known):
    """Values (n, points) lie in discs, whose radius is something where ``known``."""
    tiny = 4e-15 * (1.0 + np.abs(values))  # rounding of the values themselves
    room = np.where(np.isfinite(rows[:, 1:2]), rows[:, 1:2], np.inf)
    assert (np.abs(values - rows[:, :1]) <= room + tiny)[known].all()
    assert known.mean() > 0.1


@pytest.mark.parametrize("name", NAMES[:7])
def test_linear_parts_match_values(made, name):
    """Operands that depend on the same t, |t| <= 1, and on something small besides: so do values."""
    rng = np.random.default_rng(300 + NAMES.index(name))
    first, second = random_discs(rng), random_discs(rng)
    slopes = 10.0 ** rng.uniform(-6.0, 0.0, (2, COUNT, 3)) * rng.choice([-1.0, 1.0], (2, COUNT, 3))
    rows = made(name, first, second, slopes)
    angle = rng.uniform(0.0, 2.0 * np.pi, (COUNT, POINTS, 3))
    t = np.minimum(1.0, rng.uniform(0.0, 2.0, angle.shape)) * np.exp(1j * angle)
    a, b = (np.einsum("npk,nk->np", t, slope) for slope in slopes)
    with np.errstate(all="ignore"):
        values = FUNCTIONS[name](inside(rng, first) + a, inside(rng, second) + b)
        linear = np.einsum("npk,nk->np", t, rows[:, 4:7])
    known = (rows[:, 3] != 0) & np.isfinite(rows[:, 1])
    check(rows, values, known)
    check(np.stack([rows[:, 0], rows[:, 7]], axis=1), values - linear, known)
    if name in ("plus", "times"):
        assert (np.abs(rows[:, 4:7]).sum(axis=1) > rows[:, 7]).mean() > 0.05


def test_radii_of_small_discs_follow_the_derivative(made):
    """Tight: a disc's radius is at most 1.01 times that of the linear map."""
    rng = np.random.default_rng(5)
    first = random_discs(rng)
    first[:, 0], first[:, 1] = rng.uniform(0.2, 0.8, COUNT), 1e-6
    steep = {"sqrt": lambda a: 0.5 / np.sqrt(a), "exp": np.exp, "log": lambda a: 1 / a, "sinh": np.cosh}
    for name, derivative in steep.items():
        rows = made(name, first, first)
        bound = 1e-6 * derivative(first[:, 0])
        assert (rows[:, 1] <= (1.01 if name != "sinh" else 1.5) * bound).all(), name


def test_signs_of_eigenvalues_match_those_of_all_matrices_in_discs(kernel_of):
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


def test_numbers_without_all_digits_have_room(made):
    """Products below the smallest normal number vanish on devices, and what is divided by a small one counts."""
    quotient = made("over", [[1e-307, 0.0, 0.0]], [[1e-100, 1e-101, 0.0]])[0]
    wanted = 1e-307 / 0.9e-100 - 1e-207
    assert quotient[1] >= wanted
    assert quotient[7] >= wanted
    lost = made("plus", [[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], ([[1.0, 0.0, 0.0]], [[1e-17, 0.0, 0.0]]))[0]
    assert lost[4] == 1.0
    assert lost[7] >= 1e-17
    # twenty times the smallest number, and a little more
    lost = made("over", [[1e-307, 0.0, 0.0]], [[1e-100, 1e-115, 0.0]])[0]
    assert lost[1] >= 1e-222
    assert lost[7] >= 1e-222


def test_radii_of_logarithms_have_room_for_the_rounding_of_quotients(made):
    """|log z - log m| is -log(1 - r/m) at most, here with 50 digits."""
    rng = np.random.default_rng(8)
    middle = rng.uniform(1.0, 2.0, COUNT)
    first = np.stack([middle, middle * rng.uniform(2e-3, 4e-3, COUNT), 0 * middle], axis=1)
    found = made("log", first, first)[:, 1]
    with mpmath.workdps(50):
        exact = [-mpmath.log(1 - mpmath.mpf(radius) / mpmath.mpf(own)) for own, radius in first[:, :2].tolist()]
        assert all(mpmath.mpf(own) >= bound for own, bound in zip(found.tolist(), exact, strict=True))


def test_roots_of_discs_that_touch_zero_are_not_smooth(made):
    touching = made("sqrt", [[1.0, 1.0, 0.0]], [[0.0, 0.0, 0.0]])[0]
    assert touching[3] == 0
    assert touching[0] + touching[1] >= np.sqrt(2.0)
    assert np.isfinite(touching[2])


@pytest.mark.parametrize("name", NAMES)
def test_errors_of_operands_move_values_by_no_more_than_is_stated(made, name):
    """Values at ends of discs, from operands at the ends of their errors; the bound of roots is twice as large."""
    rng = np.random.default_rng(400 + NAMES.index(name))
    first, second = (rng.uniform([1.0, 0.01, 0.05], [2.0, 0.1, 0.2], (COUNT, 3)) for _ in range(2))
    error = made(name, first, second)[:, 2]
    found = np.zeros(COUNT)
    for signs in product([-1, 1], repeat=4):
        a, b = first[:, 0] + signs[0] * first[:, 1], second[:, 0] + signs[1] * second[:, 1]
        moved = FUNCTIONS[name](a + signs[2] * first[:, 2], b + signs[3] * second[:, 2])
        found = np.maximum(found, np.abs(moved - FUNCTIONS[name](a, b)))
    assert (found <= error * (1 + 1e-12)).all()
    assert (found / error).max() > 0.45
