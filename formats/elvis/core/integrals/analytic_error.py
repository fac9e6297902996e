"""Bounds of the error of Gauss rules on boxes of eta, from ranges of integrands on complex neighbourhoods.

An analytic F with |F| <= M inside the Bernstein ellipse of parameter rho (foci -1 and 1, sum of the half axes rho) has
Chebyshev coefficients |a_k| <= 2 M rho^-k.  A Gauss rule of n points is exact up to degree 2 n - 1.  Its error is 0 for
an odd T_k, and at most 2 + 2/(k^2 - 1) for an even one.  The error is therefore at most

    4 (1 + 1/(4 n^2 - 1)) M rho^-2n / (1 - rho^-2)

(Petras 2002, Self-validating integration and approximation of piecewise analytic functions; Trefethen 2008, Is Gauss
quadrature better than Clenshaw-Curtis?).  A polynomial of degree 2 n - 1 may be subtracted from F first.  The product
of rules in d directions has at most the sum of the errors in each direction, with real values in all others.

M comes from discs (`box_discs`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.rows import Rows
from elvis.core.integrals.box_discs import RHOS, BoxDiscs
from elvis.core.integrals.tree_discs import integral_between
from elvis.core.quantities import discs
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node

#: additional points of rules in a direction for which bounds are computed
FURTHER = (0, 1, 2, 3, 5, 7, 9, 13)


def gauss_factors(counts: Sequence[int], rhos: Floats = RHOS) -> Floats:
    """(counts, rhos) what M is multiplied by to bound the error of a Gauss rule on [-1, 1]."""
    n = np.asarray(counts, np.float64)[:, None]
    return np.asarray(4 * (1 + 1 / (4 * n * n - 1)) * rhos ** (-2 * n) / (1 - rhos**-2))


@dataclass(frozen=True, eq=False)
class Bounds(Rows):
    """Bounds for the integrals of e expressions over n boxes, independent of rules.

    errors     (n, e, d, s) contribution of a direction to the error of rules with FURTHER[s] additional points; inf:
               unknown
    low, high  (n, e) bounds of the integrals
    moved      (n, e) maximum change of the integrals by rounding that moves surfaces
    """

    errors: Floats
    low: Floats
    high: Floats
    moved: Floats

    def error(self, value: Floats, steps: Sequence[int]) -> Floats:
        """(n, e) bounds of the errors of values (n, e) by rules with FURTHER[step] points more in each direction."""
        analytic = sum(self.errors[:, :, axis, step] for axis, step in enumerate(steps))
        within = np.maximum(self.high - value, value - self.low)
        return np.asarray(np.fmin(analytic, np.maximum(within, 0.0)))


def bounds(found: BoxDiscs, roots: Sequence[Node], measures: Floats) -> Bounds:
    """Bounds of the integrals of expressions over boxes with measures (n,) by the rule of `BoxDiscs.counts`."""
    is_exact = found.rules.measure_is_exact(found.counts)
    factors = np.stack([gauss_factors([count + more for more in FURTHER]) for count in found.counts])
    with np.errstate(all="ignore"):
        errors = [_analytic(found, root, is_exact, factors, found.boxes.volumes) for root in roots]
        ends = [_enclosure(found, root, is_exact, found.boxes.volumes, measures) for root in roots]
    low, high = (np.stack(column, axis=1) for column in zip(*ends, strict=True))
    return Bounds(np.stack(errors, axis=1), low, high, np.zeros_like(low))


def _analytic(found: BoxDiscs, root: Node, is_exact: bool, factors: Floats, volumes: Floats) -> Floats:
    """(n, d, s) contribution of each direction to the error of f D, with D the measure.

    If rules integrate D exactly, they also integrate c D exactly, so |f - c| |D| bounds the rest.  If f differs from an
    analytic function on the box, the difference is added.
    """
    d, (own, slack), measure = len(found.counts), found.disc(root), found.measure
    most = own[1] * (np.abs(measure[0]) + measure[1]) if is_exact else discs.times(own, measure)[1]
    on_ellipses = most[:, 1:].reshape(-1, d, 1, len(RHOS))
    errors = np.where(np.isfinite(on_ellipses), on_ellipses * factors, np.inf)
    analytic = errors.min(axis=3) * (2.0 ** (d - 1) * volumes)[:, None, None]

    # the integral and the rule have the slack as often as the measure is large
    largest = np.broadcast_to(np.abs(measure[0]) + measure[1], (len(slack), measure[1].shape[-1]))[:, 0]
    return np.asarray(analytic + (2 * slack * largest * 2.0**d * volumes / d)[:, None, None])


def _enclosure(found: BoxDiscs, root: Node, is_exact: bool, volumes: Floats, measures: Floats) -> Interval:
    """Bounds (n,) of integrals, from the bounds of the integrand on real boxes."""
    low, high = found.interval(root)
    if is_exact:
        least, most = measures, measures
    else:
        volume = 2.0 ** len(found.counts) * volumes
        middle, radius = (np.broadcast_to(part, (len(low), part.shape[1]))[:, 0] for part in found.measure)
        least, most = volume * np.maximum(middle - radius, 0.0), volume * (np.abs(middle) + radius)
    return integral_between((low, high), least, most)
