"""Nodes are roots to the last place; rules are exact to the degree they claim."""

from fractions import Fraction
from math import comb, gamma

import numpy as np
import pytest

from elvis.core.base.errors import FormatError
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.polynomials.quadrature import (
    FAMILIES,
    gauss,
    gll,
    grm10,
    grm20,
    jacobi_roots,
    line_nodes,
    lobatto,
    radau_minus,
    radau_plus,
)

WEIGHTS = [(0, 0), (1, 0), (2, 0), (0, 1), (0, 2), (1, 1), (-0.5, -0.5)]
RULES = {
    gauss: (1, -1),
    radau_minus: (1, -2),
    radau_plus: (1, -2),
    lobatto: (2, -3),
}  # smallest count, 2 count + ... = degree
COUNTS = [1, 2, 3, 4, 5, 8, 13, 20, 27, 40]
CASES = [(rule, n) for rule in RULES for n in COUNTS if n >= RULES[rule][0]]


@pytest.mark.sampled(least=40)
@pytest.mark.parametrize(("a", "b"), WEIGHTS)
@pytest.mark.parametrize(("rule", "count"), CASES)
def test_rules_have_their_stated_degree(rule, count, a, b):
    nodes, weights = rule(count, a, b)
    degree = 2 * count + RULES[rule][1]
    table = jacobi(degree, a, b, np.append(nodes, [-1, 1]))
    total = 2 ** (a + b + 1) * gamma(a + 1) * gamma(b + 1) / gamma(a + b + 2)
    expected = total * (np.arange(degree + 1) == 0)
    assert (np.abs(table[:, :-2] @ weights - expected) <= 1e-14 * total * np.abs(table).max(axis=1)).all()
    assert (weights > 0).all()


@pytest.mark.sampled(least=40)
@pytest.mark.parametrize(("a", "b"), WEIGHTS)
@pytest.mark.parametrize(("rule", "count"), CASES)
def test_nodes_ascend_and_include_their_stated_ends(rule, count, a, b):
    nodes = rule(count, a, b)[0]
    assert len(nodes) == count
    assert (np.diff(nodes) > 0).all()
    assert (nodes[0] == -1) == (rule in (radau_minus, lobatto))
    assert (nodes[-1] == 1) == (rule in (radau_plus, lobatto))


@pytest.mark.parametrize(("a", "b"), [pair for pair in WEIGHTS if pair[0] >= 0])
@pytest.mark.parametrize("count", [1, 2, 7, 20, 40])
def test_an_exact_root_lies_within_rounding_of_each_node(count, a, b):
    def exact(x):
        low, high = (x - 1) / 2, (x + 1) / 2
        return sum(
            comb(count + a, count - s) * comb(count + b, s) * low**s * high ** (count - s) for s in range(count + 1)
        )

    for z in jacobi_roots(count, a, b):
        here, width = Fraction(float(z)), Fraction(3, 2**54)
        assert exact(here - width) * exact(here + width) <= 0


@pytest.mark.parametrize("count", [2, 3, 9, 40])
def test_collapsed_rules_absorb_the_collapse(count):
    for rule, power in ((gll, 0), (grm10, 1), (grm20, 2)):
        nodes, weights = rule(count)
        # the integral over [-1, 1] of ((1 - z)/2)^power is 2/(power + 1)
        assert weights.sum() == pytest.approx(2 / (power + 1), rel=1e-14)
        assert nodes[0] == -1
        assert not nodes.flags.writeable


def test_known_rules():
    assert gll(3)[0] == pytest.approx([-1, 0, 1], abs=0)
    assert gll(3)[1] == pytest.approx([1 / 3, 4 / 3, 1 / 3], rel=1e-15)
    assert gauss(2)[0] == pytest.approx([-(3**-0.5), 3**-0.5], rel=1e-15)
    assert radau_minus(2)[0] == pytest.approx([-1, 1 / 3], rel=1e-15)
    assert radau_minus(2)[1] == pytest.approx([0.5, 1.5], rel=1e-15)


@pytest.mark.parametrize("count", range(3, 21))
def test_chebyshev_nodes_are_cosines(count):
    k = np.arange(count)
    known = {
        "GaussGaussChebyshev": -np.cos(np.pi * (2 * k + 1) / (2 * count)),
        "GaussRadauMChebyshev": -np.cos(2 * np.pi * k / (2 * count - 1)),
        "GaussRadauPChebyshev": np.cos(2 * np.pi * k / (2 * count - 1))[::-1],
        "GaussLobattoChebyshev": -np.cos(np.pi * k / (count - 1)),
    }
    for family, expected in known.items():
        assert np.abs(line_nodes(family, count) - expected).max() < 1e-15


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_has_nodes_on_the_line(family):
    for count in (2, 5, 16):
        nodes = line_nodes(family, count)
        assert nodes.shape == (count,)
        assert np.abs(nodes).max() <= 1


def test_unknown_families_and_counts_are_rejected():
    with pytest.raises(FormatError, match="found NodalTriElec"):
        line_nodes("NodalTriElec", 4)
    with pytest.raises(FormatError, match="at least 2 GaussLobattoLegendre nodes, found 1"):
        line_nodes("GaussLobattoLegendre", 1)
