"""Families of nodes: their numbers and names in files, and where the nodes are (format notes 1.5, 1.8)."""

from __future__ import annotations

import json
from enum import IntEnum
from functools import cache
from importlib.resources import files

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import FormatError
from elvis.core.polynomials.quadrature import line_nodes


class PointsType(IntEnum):
    """A family of nodes; binary files use these numbers, text files use the names ``family.label``."""

    NONE = 0
    GAUSS_LEGENDRE = 1
    RADAU_M_LEGENDRE = 2
    RADAU_P_LEGENDRE = 3
    LOBATTO_LEGENDRE = 4
    GAUSS_CHEBYSHEV = 5
    RADAU_M_CHEBYSHEV = 6
    RADAU_P_CHEBYSHEV = 7
    LOBATTO_CHEBYSHEV = 8
    RADAU_M_ALPHA0_BETA1 = 9
    RADAU_M_ALPHA0_BETA2 = 10
    RADAU_M_ALPHA1_BETA0 = 11
    RADAU_M_ALPHA2_BETA0 = 12
    KRONROD_LEGENDRE = 13
    RADAU_KRONROD_M_LEGENDRE = 14
    RADAU_KRONROD_M_ALPHA1_BETA0 = 15
    LOBATTO_KRONROD_LEGENDRE = 16
    POLY_EVENLY_SPACED = 17
    FOURIER_EVENLY_SPACED = 18
    FOURIER_SINGLE_MODE_SPACED = 19
    BOUNDARY_LAYER = 20
    BOUNDARY_LAYER_REVERSED = 21
    TRIANGLE_ELECTROSTATIC = 22
    TRIANGLE_FEKETE = 23
    TRIANGLE_EVENLY_SPACED = 24
    TETRAHEDRON_EVENLY_SPACED = 25
    TETRAHEDRON_ELECTROSTATIC = 26
    PRISM_EVENLY_SPACED = 27
    PRISM_ELECTROSTATIC = 28
    TRIANGLE_SPI = 29
    TETRAHEDRON_SPI = 30
    PRISM_SPI = 31
    QUADRILATERAL_ELECTROSTATIC = 32
    HEXAHEDRON_ELECTROSTATIC = 33

    @property
    def label(self) -> str:
        """The name in XML files, e.g. ``PolyEvenlySpaced``."""
        return _LABELS[self]

    @classmethod
    def from_label(cls, label: str) -> PointsType:
        """The family that files call ``label``; raises KeyError if there is none."""
        return _FROM_LABEL[label]

    @property
    def is_triangular(self) -> bool:
        """Whether the nodes lie on a triangle."""
        return self in (self.TRIANGLE_ELECTROSTATIC, self.TRIANGLE_FEKETE, self.TRIANGLE_EVENLY_SPACED)


#: names in files, by number
_LABELS = (
    "NoPointsType",
    "GaussGaussLegendre",
    "GaussRadauMLegendre",
    "GaussRadauPLegendre",
    "GaussLobattoLegendre",
    "GaussGaussChebyshev",
    "GaussRadauMChebyshev",
    "GaussRadauPChebyshev",
    "GaussLobattoChebyshev",
    "GaussRadauMAlpha0Beta1",
    "GaussRadauMAlpha0Beta2",
    "GaussRadauMAlpha1Beta0",
    "GaussRadauMAlpha2Beta0",
    "GaussKronrodLegendre",
    "GaussRadauKronrodMLegendre",
    "GaussRadauKronrodMAlpha1Beta0",
    "GaussLobattoKronrodLegendre",
    "PolyEvenlySpaced",
    "FourierEvenlySpaced",
    "FourierSingleModeSpaced",
    "BoundaryLayerPoints",
    "BoundaryLayerPointsRev",
    "NodalTriElec",
    "NodalTriFekete",
    "NodalTriEvenlySpaced",
    "NodalTetEvenlySpaced",
    "NodalTetElec",
    "NodalPrismEvenlySpaced",
    "NodalPrismElec",
    "NodalTriSPI",
    "NodalTetSPI",
    "NodalPrismSPI",
    "NodalQuadElec",
    "NodalHexElec",
)
_FROM_LABEL = {label: PointsType(number) for number, label in enumerate(_LABELS)}


@bounded_cache
def nodes(family: PointsType, count: int) -> Floats:
    """(count,) nodes of a family on the line, ascending in [-1, 1].

    Raises FormatError for a family that isn't on the line or isn't supported, and if it has no rule of so few nodes.
    """
    return frozen_floats(line_nodes(family.label, count))


@bounded_cache
def triangle_nodes(family: PointsType, count: int) -> Floats:
    """(count (count + 1) / 2, 2) nodes xi on the reference triangle for ``count`` nodes an edge.

    In the order of files: vertices; inner nodes of edges v0v1, v1v2, v2v0; interior.  Raises FormatError for other
    families and if the tables have no entry (2 to 14 nodes an edge, ten digits; no Fekete nodes for 11, where the
    published table repeats a node); evenly spaced nodes exist for every count >= 2.
    """
    if family is PointsType.TRIANGLE_EVENLY_SPACED and count > 1:
        return frozen_floats(_evenly_spaced_triangle(count))
    table = _triangle_tables().get(family.label, {}) if family.is_triangular else {}
    if str(count) not in table:
        raise FormatError(f"expected a known family of triangle nodes, found {count} nodes an edge of {family.label}")
    return frozen_floats(table[str(count)])


def _evenly_spaced_triangle(count: int) -> Floats:
    line = np.arange(count)
    last = count - 1
    inner, back = line[1:-1], line[-2:0:-1]
    none = np.zeros_like(inner)

    # vertices, the three edges one way round, rows of the interior from edge v0v1 upwards
    corners = [[0, 0], [last, 0], [0, last]]
    edges = [np.stack(pair, axis=1) for pair in ((inner, none), (back, inner), (none, back))]
    rows = [[i, j] for j in range(1, last) for i in range(1, last - j)]
    lattice = np.concatenate([corners, *edges, np.reshape(np.array(rows, np.int64), (-1, 2))])
    return 2.0 * lattice / last - 1.0


@cache
def _triangle_tables() -> dict[str, dict[str, list[list[float]]]]:
    text = (files("elvis.core") / "data" / "nodal-triangle-points.json").read_text("utf-8")
    tables: dict[str, dict[str, list[list[float]]]] = json.loads(text)
    return tables
