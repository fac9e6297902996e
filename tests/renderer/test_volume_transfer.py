"""Polynomials along rays, their first roots, and transfer functions of them: against NumPy's own roots and values."""

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of
from numpy.polynomial import Polynomial

COUNT, DEGREE = 240, 3
FOUND = {
    "part": 4,
    "at": 2,
    "changes": 1,
    "steepness": 1,
    "level": 1,
    "within": 1,
    **dict.fromkeys(["place", "steep", "from", "to"], 1),
    **dict.fromkeys(["most", "risk", "end", "interval", "density"], 1),
    "color": 3,
}
#: from Bernstein coefficients to those of powers
TO_POWERS = np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1.0]])
BREAKPOINTS = 5


class Lines:
    """Cubic polynomials (n, 4), with transfer functions of five breakpoints each."""

    def __init__(self, rng):
        self.nets = rng.uniform(-1, 1, (COUNT, 4))
        self.nets[::4] = np.sort(self.nets[::4], axis=1) * rng.choice([-1, 1], (COUNT // 4, 1))
        # straight ones, some of which begin at 0
        straight = rng.uniform(-1, 1, (COUNT, 2))
        straight[::8, 0] = 0.0
        line = straight[:, :1] + np.arange(4) / 3 * (straight[:, 1:] - straight[:, :1])
        self.nets[1::4] = line[1::4]
        self.nets[::16, 0] = 0.0
        self.a, width = rng.uniform(0, 0.5, COUNT), rng.uniform(0.1, 0.5, COUNT)
        self.b = self.a + width
        self.radius = rng.choice([0.0, 0.05, 0.5], COUNT)
        self.nets[2], self.radius[2] = [0.5, -0.5, 0.5, -0.5], 0.5
        self.accuracy = rng.uniform(0, 1e-6, (COUNT, 3)) * [1e3, 1, 1e-3]
        self.known = (self.nets[:, 0] == 0) & (np.arange(COUNT) % 2 == 0)
        self.values = np.sort(rng.uniform(-1, 1, (COUNT, BREAKPOINTS)), axis=1)
        self.densities, self.colors = (
            rng.uniform(0, 2, (COUNT, BREAKPOINTS)),
            rng.uniform(0, 1, (COUNT, BREAKPOINTS, 3)),
        )
        self.gate = rng.choice([0, 0, 1], COUNT)
        steep = np.abs(np.diff(self.densities) / np.diff(self.values)).max(axis=1)
        self.steepest, self.densest = steep, self.densities.max(axis=1)
        self.low, self.off = rng.uniform(-1.2, 1, COUNT), rng.choice([0.0, 1e-3, 0.1, 2.0], COUNT)
        self.high = self.low + rng.uniform(0, 1, COUNT)
        self.polynomials = [Polynomial(TO_POWERS @ net) for net in self.nets]

    def rows(self):
        own = [self.a, self.b, self.radius, self.accuracy, self.known]
        medium = [np.arange(COUNT) * BREAKPOINTS, np.full(COUNT, BREAKPOINTS), self.gate, self.steepest, self.densest]
        columns = [self.nets, *own, *medium, self.low, self.high, self.off]
        return rows_of(COUNT, columns)

    def density(self, k, values):
        return np.interp(values, self.values[k], self.densities[k])


@pytest.fixture(scope="module")
def lines():
    return Lines(np.random.default_rng(13))


@pytest.fixture(scope="module")
def found(functions, lines):
    kernel = functions("volume_transfer")
    given = {"values": lines.values, "densities": lines.densities, "colors": lines.colors}
    (found,) = parted(kernel(lines.rows(), width_of([FOUND]), **given), [FOUND])
    return found


def roots_of(polynomial):
    """Real roots in [0, 1], ascending."""
    roots = polynomial.trim(1e-13).roots()
    real = roots[np.abs(np.imag(roots)) < 1e-9].real
    return np.sort(real[(real > -1e-9) & (real < 1 + 1e-9)])


def test_parts_and_values_of_nets_are_those_of_their_polynomials(lines, found):
    for k, polynomial in enumerate(lines.polynomials):
        part = polynomial(Polynomial([lines.a[k], lines.b[k] - lines.a[k]]))
        assert TO_POWERS @ found["part"][k] == pytest.approx(np.pad(part.coef, (0, 4 - len(part.coef))), abs=1e-13)
        assert found["at"][k] == pytest.approx([polynomial(lines.a[k]), polynomial.deriv()(lines.a[k])], abs=1e-13)


def test_sign_changes_and_slopes_bound_all_polynomials_within_the_radius(lines, found):
    """Coefficients that are off by the radius, each its own way: as many changes as any has, the least slope of all."""
    ways = np.array(np.meshgrid(*4 * [[-1, 0, 1]])).reshape(4, -1).T
    for k in range(COUNT):
        nets = lines.nets[k] + lines.radius[k] * ways
        # a coefficient of 0 may have either sign
        signs = np.sign(lines.nets[k] + max(lines.radius[k], 1e-12) * ways)
        changes = [np.count_nonzero(np.diff(row[row != 0])) for row in signs]
        assert found["changes"][k] == max(changes)
        slopes = 3 * np.diff(nets, axis=1)
        steady = max(slopes.min(), -slopes.max(), 0)
        assert found["steepness"][k] == pytest.approx(steady, rel=1e-12, abs=1e-14)
    assert np.array_equal(found["level"], np.abs(lines.nets).max(axis=1) <= lines.radius)
    assert found["level"].any()
    # T_3 grows most outside of the interval on which values are known
    grown = lines.accuracy[:, 1] * np.polynomial.chebyshev.chebval(1 + 2 * (lines.b - lines.a), [0, 0, 0, 1])
    within = np.minimum(lines.accuracy[:, 0], grown) + lines.accuracy[:, 2]
    assert found["within"] == pytest.approx(within, rel=1e-12, abs=0)


def test_first_roots_are_found_with_the_least_slope_around_them(lines, found):
    proved = 0
    for k, polynomial in enumerate(lines.polynomials):
        roots = roots_of(polynomial)
        if lines.known[k]:
            roots = roots[roots > 1e-9]
        place, steep = found["place"][k], found["steep"][k]
        if place < 0:
            assert not len(roots)
        elif steep > 0:
            assert place == pytest.approx(roots[0], abs=1e-9)
            assert found["from"][k] - 1e-12 <= place <= found["to"][k] + 1e-12
            line = np.linspace(found["from"][k], found["to"][k], 50)
            slopes = np.abs(polynomial.deriv()(line))
            assert slopes.min() >= steep * (1 - 1e-9)
            assert slopes.min() <= 100 * steep
            proved += 1
        else:
            # nothing is proved only next to double roots and ends
            near = np.abs(polynomial(np.array([found["from"][k], found["to"][k]])))
            assert near.min() < 1e-3
    assert proved > COUNT / 3


def test_densities_are_piecewise_linear_and_largest_at_breakpoints_or_ends(lines, found):
    for k in range(COUNT):
        assert found["density"][k] == pytest.approx(lines.density(k, lines.low[k]), rel=1e-9, abs=0)
        color = [np.interp(lines.low[k], lines.values[k], lines.colors[k, :, c]) for c in range(3)]
        assert found["color"][k] == pytest.approx(color, rel=1e-9, abs=0)
        inside = lines.values[k][(lines.values[k] > lines.low[k]) & (lines.values[k] < lines.high[k])]
        ends = np.array([lines.low[k], lines.high[k], *inside])
        assert found["most"][k] == pytest.approx(lines.density(k, ends).max(), rel=1e-9, abs=0)


def test_risks_of_volumes_bound_their_change_within_what_quantities_are_off(lines, found):
    """By the steepest part, and never more than the largest density there; a gate, where the quantity is near 0."""
    line = np.linspace(0, 1, 2001)
    nearest = []
    for k, polynomial in enumerate(lines.polynomials):
        off, values = lines.off[k], polynomial(line)
        if lines.gate[k]:
            share = lines.densest[k] * (np.abs(values) <= off).mean()
            assert share <= found["risk"][k] + 2e-3
            nearest.append(share / found["risk"][k] if 0 < off < 1 and found["risk"][k] > 0.01 else 0)
            continue
        changes = [np.abs(lines.density(k, values + way * off) - lines.density(k, values)).max() for way in (-1, 1)]
        assert max(changes) <= found["risk"][k] + 1e-12
        most = lines.nets[k].max() + off, lines.nets[k].min() - off
        ends = [*most, *lines.values[k][(lines.values[k] < most[0]) & (lines.values[k] > most[1])]]
        limit = min(lines.steepest[k] * off, lines.density(k, np.array(ends)).max())
        assert found["risk"][k] == pytest.approx(limit if off > 0 else 0, rel=1e-9, abs=0)
    assert max(nearest) > 0.9
    assert (found["risk"][lines.gate > 0] == 0).any()


def test_parts_of_rays_end_where_quantities_reach_a_breakpoint(lines, found):
    for k, polynomial in enumerate(lines.polynomials):
        values = polynomial(np.linspace(0, found["end"][k], 200)[1:-1])
        number = int(found["interval"][k])
        low = -np.inf if number == 0 else lines.values[k][number - 1]
        high = np.inf if number == BREAKPOINTS else lines.values[k][number]
        assert (values >= low - 1e-9).all()
        assert (values <= high + 1e-9).all()
        # a monotone quantity reaches it there
        if found["end"][k] < 1 and (np.diff(lines.nets[k]) > 0).all():
            assert polynomial(found["end"][k]) == pytest.approx(high, abs=1e-9)
        if found["end"][k] < 1 and (np.diff(lines.nets[k]) < 0).all():
            assert polynomial(found["end"][k]) == pytest.approx(low, abs=1e-9)
