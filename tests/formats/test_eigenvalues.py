"""The functions of expressions that vortices are found by: eigenvalues, equal and nearly equal ones too."""

import numpy as np
import pytest

from elvis.core.quantities.functions import FUNCTIONS, imaginary_root, middle_eigenvalue

UNIT = np.finfo(np.float64).eps


def turned(eigenvalues, count=2000, seed=1):
    """Symmetric matrices (n, 3, 3) with these eigenvalues, and their entries."""
    rotations = np.linalg.qr(np.random.default_rng(seed).normal(size=(count, 3, 3)))[0]
    found = rotations @ (np.asarray(eigenvalues)[:, None] * rotations.transpose(0, 2, 1))
    return (found + found.transpose(0, 2, 1)) / 2


def entries(matrices):
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    return matrices[:, rows, columns].T


@pytest.mark.parametrize("gap", [0.0, 1e-15, 1e-12, 1e-8, 1e-4, 0.5])
@pytest.mark.parametrize("shape", [(1, 1, -3), (1, 1, 1), (-1e6, 1, 1), (0, 0, 1), (-1, -1, 1e-9)])
def test_middle_eigenvalues_are_accurate_near_others(shape, gap):
    wanted = np.array(shape, float) * (1 + gap * np.array([0, 1, 2]))
    middle = np.sort(wanted)[1]
    assert np.abs(middle_eigenvalue(*entries(turned(wanted))) - middle).max() < 12 * UNIT * np.abs(wanted).max()


def test_middle_eigenvalues_match_lapack_at_every_magnitude():
    matrices = np.random.default_rng(4).normal(size=(5000, 3, 3))
    matrices = matrices + matrices.transpose(0, 2, 1)
    truth = np.linalg.eigvalsh(matrices)[:, 1]
    for size in (1e-150, 1.0, 1e150):
        assert np.abs(middle_eigenvalue(*entries(size * matrices)) / size - truth).max() < 1e-14 * 8
    assert middle_eigenvalue(*np.zeros(6)) == 0.0
    assert middle_eigenvalue(2.0, 2.0, 2.0, 0.0, 0.0, 0.0) == 2.0
    assert np.isnan(middle_eigenvalue(1.0, 2.0, np.nan, 0.0, 0.0, 0.0))


def test_squares_of_imaginary_roots_are_right_to_rounding():
    """Roots are chosen and the cubic is made of them: r and -r/2 +- i s, real ones for s = 0."""
    rng = np.random.default_rng(5)
    r, s = rng.normal(size=4000), np.abs(rng.normal(size=4000)) * rng.choice([1.0, 1e-4, 1e-8], 4000)
    a, b = s * s - 0.75 * r * r, -r * (0.25 * r * r + s * s)
    found = imaginary_root(a, b)
    size = np.abs(a) + np.cbrt(np.abs(b)) ** 2
    assert np.abs(found**2 - s * s).max() < 20 * (UNIT * size).max()
    # three real roots that are apart
    first, second = rng.uniform(0.2, 1, (2, 4000))
    roots = np.stack([first, first + second, -2 * first - second])
    pairs = roots[0] * roots[1] + roots[0] * roots[2] + roots[1] * roots[2]
    assert (imaginary_root(pairs, -roots.prod(axis=0)) == 0).all()
    assert (imaginary_root(np.array([0.0, 4.0, -4.0]), np.zeros(3)) == [0, 2, 0]).all()
    assert np.isnan(imaginary_root(np.nan, 1.0))


@pytest.mark.parametrize("name", ["middle_eigenvalue", "imaginary_root"])
def test_bounds_shrink_with_their_boxes(name):
    """In proportion to the operands, where eigenvalues are apart; infinite ones bound nothing."""
    function, widths = FUNCTIONS[name], []
    place = np.random.default_rng(3).uniform(1, 2, (function.arity, 300))
    for size in (1e-2, 1e-4):
        low, high = function.interval(*((own - size, own + size) for own in place))
        values = function.numpy(*place)
        assert ((low <= values) & (values <= high)).all()
        widths.append((high - low).max())
    assert widths[1] < 0.02 * widths[0]
    with np.errstate(all="ignore"):
        low, high = function.interval(*[(np.full(2, -np.inf), np.full(2, np.inf))] * function.arity)
    assert (low <= 0).all()
    assert (high == np.inf).all()
