"""Bounds of how far an expression is from the polynomial that has its values at a lattice of a cell.

Inside the Bernstein ellipse of parameter rho, an analytic f differs from a number by at most M.  Some polynomial of
degree n then differs from f by at most 2 M rho^-n / (rho - 1) on [-1, 1], and the one through the nodes by at most
1 + L times that, with the Lebesgue constant L of the nodes (Trefethen 2013, Approximation theory and approximation
practice, theorems 8.2 and 15.1).  On a cube the errors of the three directions add up, the second one times L and the
third one times L^2; on a square there are two of them.

M follows by complex discs from discs of coordinates, fields and derivatives, which are polynomials on the cell: the sum
of their Chebyshev coefficients but for the first, times the largest value of each term on the ellipse.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.mapping.patch import Patch
from elvis.core.quantities import discs
from elvis.core.quantities.cleared import Cleared, cleared_on, jacobian_degrees
from elvis.core.quantities.discs import Disc
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.expression_nets import places_of
from elvis.core.quantities.functions import function
from elvis.core.quantities.tree import Node, fold

#: parameters of the ellipses, of which the best one counts
_RHOS = 1.3 * 1.25 ** np.arange(14)
#: points between the nodes at which the Lebesgue constant is sought, and a factor for what lies between those
_FINE, _BETWEEN = 4001, 1.01


class Interpolated(Protocol):
    """An expression on the elements of a patch."""

    @property
    def evaluator(self) -> Evaluator: ...  # noqa: D102

    @property
    def level(self) -> Expression: ...  # noqa: D102

    @property
    def patch(self) -> Patch: ...  # noqa: D102

    @property
    def is_affine(self) -> bool: ...  # noqa: D102


def interpolation_errors(of: Interpolated, rows: Ints, in_cell: Callable[[Floats], Floats], degree: int) -> Floats:
    """(n,) bounds of the error of the interpolation of an expression on cells of elements ``rows`` (n,).

    in_cell  reference points (k^d, d) of the lattice of places (k,) in [0, 1] of a cell
    degree   of the polynomials, through values at `places_of` it

    Infinite if a leaf is not a polynomial, or no disc is known.
    """

    def leaf(node: Node) -> Disc:
        if node.op == "number":
            return discs.number(node.value)
        known = cleared_on(Expression(of.level.text, node), of.evaluator, of.patch, of.is_affine)
        return _UNKNOWN if known is None else _leaf_discs(of, node, rows, in_cell, known)

    with np.errstate(all="ignore"):
        _, radius = fold(of.level.root, leaf, lambda node, parts: function(node).disc(*parts))
    d = of.patch.shape.dimension
    radius = np.broadcast_to(radius, (len(rows), d, len(_RHOS)))
    largest = _lebesgue(degree)
    best = np.where(np.isfinite(radius), 2 * radius * _RHOS**-degree / (_RHOS - 1), np.inf).min(axis=2)
    return np.asarray((1 + largest) * best @ largest ** np.arange(d))


#: the disc of everything
_UNKNOWN: Disc = (0.0, np.inf)


def _leaf_discs(of: Interpolated, node: Node, rows: Ints, in_cell: Callable[[Floats], Floats], known: Cleared) -> Disc:
    """Discs of a polynomial on cells, or of a derivative: the quotient of a polynomial and det J."""
    d = of.patch.shape.dimension
    lattice = Lattice(of.patch, rows, in_cell(places_of(max(1, known.degree))))
    values = np.broadcast_to(of.evaluator.leaves_at(lattice)(node), len(lattice))
    if not known.power:
        return _discs(values, len(rows), d)

    numerator = _discs(values * np.linalg.det(lattice.jacobians[:, :d]), len(rows), d)
    lattice = Lattice(of.patch, rows, in_cell(places_of(jacobian_degrees(of.patch)[1])))
    return discs.over(numerator, _discs(np.linalg.det(lattice.jacobians[:, :d]), len(rows), d))


def _discs(values: Floats, elements: int, d: int) -> Disc:
    """Discs from values at the lattices of cells: (n, 1, 1) middles, and radii (n, d, parameters) by direction."""
    count = round((len(values) / elements) ** (1 / d))
    coefficients = values.reshape(elements, *(count,) * d)
    inverse = np.linalg.inv(chebyshev.chebvander(2 * places_of(count - 1) - 1, count - 1))
    for _ in range(d):
        # each direction in turn is the last one, and becomes the first one
        coefficients = np.moveaxis(coefficients @ inverse.T, -1, 1)
    middle = coefficients.reshape(elements, -1)[:, 0]
    sizes = np.ascontiguousarray(np.abs(coefficients))
    sizes.reshape(elements, -1)[:, 0] = 0.0

    # the largest value of each Chebyshev polynomial on each ellipse
    powers = np.arange(count)[:, None]
    growth = (_RHOS**powers + _RHOS**-powers) / 2
    axes = range(1, d + 1)
    along = [sizes.sum(axis=tuple(other for other in axes if other != axis)) @ growth for axis in axes]
    return middle[:, None, None], np.stack(along, axis=1)


@bounded_cache
def _lebesgue(degree: int) -> float:
    """The Lebesgue constant of the nodes of `places_of`: the largest sum of magnitudes of Lagrange polynomials."""
    nodes = 2 * places_of(degree) - 1
    fine = np.linspace(-1.0, 1.0, _FINE)
    lagrange = chebyshev.chebvander(fine, degree) @ np.linalg.inv(chebyshev.chebvander(nodes, degree))
    return _BETWEEN * float(np.abs(lagrange).sum(axis=1).max())
