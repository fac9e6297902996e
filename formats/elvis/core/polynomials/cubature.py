"""Quadrature on the reference shapes: the points at which solvers hold fields, and their weights (format notes 3, 7).

Rules are products in collapsed coordinates; weights contain the collapse |dxi/deta|.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import prod

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Expansion, ExpansionRule
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.quadrature import Rule, fourier_evenly_spaced, gauss, gll, radau_minus, radau_plus
from elvis.core.shapes import Shape

_GAUSS, _GLL, _GRM10, _GRM20 = (
    "GaussGaussLegendre",
    "GaussLobattoLegendre",
    "GaussRadauMAlpha1Beta0",
    "GaussRadauMAlpha2Beta0",
)
_FOURIER = "FourierEvenlySpaced"

#: points of a rule in a direction; a file may ask for any number in a few characters
MAX_COUNT = 1_200
#: points of a rule in all
MAX_POINTS = 1 << 22


@dataclass(frozen=True, eq=False)
class Cubature:
    """A rule on a shape: points xi (n, d), the first direction fastest, and weights (n,)."""

    points: Floats
    weights: Floats


#: one-dimensional rules by PointsType name: power of (1 - z)/2 in the weights, and the rule
_LINE: Mapping[str, tuple[int, Callable[[int], Rule]]] = {
    _GAUSS: (0, gauss),
    _GLL: (0, gll),
    "GaussRadauMLegendre": (0, radau_minus),
    "GaussRadauPLegendre": (0, radau_plus),
    _GRM10: (1, lambda count: radau_minus(count, 1, 0)),
    _GRM20: (2, lambda count: radau_minus(count, 2, 0)),
    _FOURIER: (0, lambda count: (fourier_evenly_spaced(count), np.full(count, 2 / count))),
}

#: power of (1 - eta)/2 in |dxi/deta|, for each direction
COLLAPSE: Mapping[Shape, tuple[int, ...]] = {
    Shape.SEGMENT: (0,),
    Shape.TRIANGLE: (0, 1),
    Shape.QUADRILATERAL: (0, 0),
    Shape.TETRAHEDRON: (0, 1, 2),
    Shape.PYRAMID: (0, 0, 2),
    Shape.PRISM: (0, 0, 1),
    Shape.HEXAHEDRON: (0, 0, 0),
}

_RADAU = {0: _GLL, 1: _GRM10, 2: _GRM20}


@bounded_cache
def cubature(shape: Shape, families: tuple[str, ...], counts: tuple[int, ...]) -> Cubature:
    """The product of rules of the given PointsType names and numbers of points, one for each direction.

    Raises FormatError if a family has no quadrature rule, or for too many points.
    """
    if max(counts) > MAX_COUNT or prod(counts) > MAX_POINTS:
        found = " x ".join(map(str, counts))
        raise FormatError(f"expected at most {MAX_POINTS} quadrature points in an element, found {found}")
    nodes, weights = [], []
    for family, count, power in zip(families, counts, COLLAPSE[shape], strict=True):
        if family not in _LINE:
            raise FormatError(f"expected a quadrature among {', '.join(_LINE)}, found {family}")
        own, rule = _LINE[family]
        z, w = rule(count)
        nodes.append(z)
        weights.append(w / 2**own * ((1 - z) / 2) ** (power - own))
    return Cubature(frozen_floats(uncollapse(shape, _grid(nodes))), frozen_floats(_grid(weights).prod(axis=1)))


def _grid(axes: Sequence[Floats]) -> Floats:
    """(n, d) all combinations, the first axis fastest."""
    mesh = np.meshgrid(*axes[::-1], indexing="ij")
    return np.stack([part.reshape(-1) for part in mesh[::-1]], axis=1)


def field_cubature(expansion: Expansion) -> Cubature:
    """The rule with which a field of this expansion is integrated once it is read; its homogeneous part apart.

    One point more than modes, but not on hexahedra and in collapsed directions.
    """
    counts, families = [], []
    for basis, modes, power in zip(expansion.bases, expansion.modes, COLLAPSE[expansion.shape], strict=True):
        fourier = basis is Basis.FOURIER
        more = power == 0 and not fourier and expansion.shape is not Shape.HEXAHEDRON
        counts.append(max(2, modes + more))
        families.append(_FOURIER if fourier else _RADAU[power])
    return cubature(expansion.shape, tuple(families), tuple(counts))


def rule_cubature(shape: Shape, rule: ExpansionRule) -> Cubature:
    """The rule that an entry of EXPANSIONS gives to elements of a shape."""
    powers, kind = COLLAPSE[shape], rule.kind.upper()
    modes = rule.modes if len(rule.modes) == len(powers) else (max(rule.modes),) * len(powers)
    if rule.points and rule.point_types:
        if len(rule.points) != len(powers) or len(rule.point_types) != len(powers):
            found = f"{len(rule.point_types)} and {len(rule.points)}"
            raise FormatError(f"expected {len(powers)} point types and numbers of points, found {found}")
        return cubature(shape, rule.point_types, rule.points)
    if kind.startswith("GAUSS_LAGRANGE") and not any(powers):
        return cubature(shape, (_GAUSS,) * len(powers), modes)
    if kind == "FOURIER":
        return cubature(shape, (_FOURIER,) * len(powers), modes)

    # one point more than modes, but in collapsed directions only on pyramids
    more = {"MODIFIEDQUADPLUS1": 1, "MODIFIEDQUADPLUS2": 2}.get(kind, 0)
    line = 0 if kind == "GLL_LAGRANGE_SEM" else 1
    counts = [n + more + (line if p == 0 or shape is Shape.PYRAMID else 0) for n, p in zip(modes, powers, strict=True)]
    families = [_RADAU[min(power, 1) if kind == "MODIFIEDGLLRADAU10" else power] for power in powers]
    return cubature(shape, tuple(families), tuple(max(2, count) for count in counts))
