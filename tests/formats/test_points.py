"""Families of nodes: numbers, names and places."""

import json
from pathlib import Path

import numpy as np
import pytest

from elvis.core.base.errors import FormatError
from elvis.core.polynomials.points import PointsType, nodes, triangle_nodes

TABLE = Path(__file__).parents[2] / ".." / "shared" / "data" / "nektar" / "nodal-tri-points.json"
LINE = [family for family in PointsType if family in range(1, 13) or family in (17, 18)]
REPEATED = (PointsType.TRIANGLE_FEKETE, 11)  # the published table has one node twice and another not at all
TRIANGLE = [family for family in PointsType if family.is_triangular]


def test_labels_round_trip_and_number_as_in_binary_files():
    assert [PointsType.from_label(family.label) for family in PointsType] == list(PointsType)
    assert len(PointsType) == 34
    known = {4: "GaussLobattoLegendre", 12: "GaussRadauMAlpha2Beta0", 17: "PolyEvenlySpaced", 22: "NodalTriElec"}
    known |= {23: "NodalTriFekete", 24: "NodalTriEvenlySpaced", 33: "NodalHexElec", 0: "NoPointsType"}
    assert {number: PointsType(number).label for number in known} == known
    with pytest.raises(KeyError):
        PointsType.from_label("Nonsense")


@pytest.mark.sampled(least=40)
@pytest.mark.parametrize("family", LINE)
@pytest.mark.parametrize("count", range(3, 21))
def test_nodes_ascend_in_the_interval(family, count):
    found = nodes(family, count)
    assert found.shape == (count,)
    assert np.all(np.diff(found) > 0)
    assert found[0] >= -1
    assert found[-1] <= 1
    assert (found[0] == -1) == any(word in family.label for word in ("RadauM", "Lobatto", "Evenly"))
    assert (found[-1] == 1) == any(word in family.label for word in ("RadauP", "Lobatto", "PolyEvenly"))


@pytest.mark.parametrize("count", range(2, 21))
def test_chebyshev_nodes_have_their_closed_forms(count):
    k = np.arange(count)
    gauss = -np.cos((2 * k + 1) * np.pi / (2 * count))
    lobatto = -np.cos(k * np.pi / (count - 1))
    radau = -np.cos(2 * k * np.pi / (2 * count - 1))
    np.testing.assert_allclose(nodes(PointsType.GAUSS_CHEBYSHEV, count), gauss, atol=1e-15)
    np.testing.assert_allclose(nodes(PointsType.LOBATTO_CHEBYSHEV, count), lobatto, atol=1e-15)
    np.testing.assert_allclose(nodes(PointsType.RADAU_M_CHEBYSHEV, count), radau, atol=1e-15)
    np.testing.assert_allclose(nodes(PointsType.RADAU_P_CHEBYSHEV, count), -radau[::-1], atol=1e-15)


def test_known_legendre_nodes():
    np.testing.assert_allclose(nodes(PointsType.LOBATTO_LEGENDRE, 4), [-1, -(0.2**0.5), 0.2**0.5, 1], atol=1e-15)
    np.testing.assert_allclose(nodes(PointsType.GAUSS_LEGENDRE, 3), [-(0.6**0.5), 0, 0.6**0.5], atol=1e-15)
    np.testing.assert_allclose(nodes(PointsType.RADAU_M_LEGENDRE, 2), [-1, 1 / 3], atol=1e-15)
    np.testing.assert_allclose(nodes(PointsType.RADAU_M_ALPHA1_BETA0, 2), [-1, 0], atol=1e-15)


@pytest.mark.parametrize(("family", "count"), [(f, n) for f in TRIANGLE for n in range(2, 15) if (f, n) != REPEATED])
def test_triangle_nodes_follow_the_order_of_files(family, count):
    found = triangle_nodes(family, count)
    assert found.shape == (count * (count + 1) // 2, 2)
    np.testing.assert_array_equal(found[:3], [[-1, -1], [1, -1], [-1, 1]])

    # inner nodes of the edges walk round the triangle, the rest lies strictly inside
    low, hypotenuse, left = np.split(found[3 : 3 * count - 3], 3)
    np.testing.assert_allclose(low[:, 1], -1)
    np.testing.assert_allclose(hypotenuse.sum(axis=1), 0, atol=1e-15)
    np.testing.assert_allclose(left[:, 0], -1)
    assert np.all(np.diff(low[:, 0]) > 0)
    assert np.all(np.diff(hypotenuse[:, 1]) > 0)
    assert np.all(np.diff(left[:, 1]) < 0)
    inside = found[3 * count - 3 :]
    assert np.all(inside > -1)
    assert np.all(inside.sum(axis=1) < 0)


def test_triangle_nodes_match_those_of_the_library():
    if not TABLE.is_file():
        pytest.skip("no shared data here")
    for label, by_count in json.loads(TABLE.read_text())["points"].items():
        for count, points in by_count.items():
            if (PointsType.from_label(label), int(count)) == REPEATED:
                assert len(np.unique(points, axis=0)) < len(points)
                continue
            found = triangle_nodes(PointsType.from_label(label), int(count))
            np.testing.assert_allclose(found, points, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("family", "count"),
    [
        (PointsType.LOBATTO_LEGENDRE, 1),
        (PointsType.GAUSS_LEGENDRE, 0),
        (PointsType.POLY_EVENLY_SPACED, 1),
        (PointsType.BOUNDARY_LAYER, 4),
        (PointsType.TRIANGLE_FEKETE, 4),
    ],
)
def test_other_nodes_of_a_line_are_rejected(family, count):
    with pytest.raises(FormatError, match=family.label):
        nodes(family, count)


@pytest.mark.parametrize(
    ("family", "count"),
    [
        (PointsType.TRIANGLE_FEKETE, 15),
        REPEATED,
        (PointsType.TRIANGLE_EVENLY_SPACED, 1),
        (PointsType.TRIANGLE_SPI, 4),
        (PointsType.LOBATTO_LEGENDRE, 4),
    ],
)
def test_other_nodes_of_a_triangle_are_rejected(family, count):
    with pytest.raises(FormatError, match=family.label):
        triangle_nodes(family, count)
