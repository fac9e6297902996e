"""Differences of two solutions: norms of the difference of their fields, on one mesh or on two.

pairing       comparison of meshes, and datasets that hold both solutions
greatest      the maximum difference, certified on one mesh, otherwise from points
overlaps      the maximum on two meshes with its bound, over all pairs of elements that may meet
compositions  differences on such pairs as nets, with the rounding of all their terms
prepared      the elements of either dataset, prepared for the bounds
difference    all norms in one call
convergence   the order of convergence of a family of datasets to its last member
"""

from __future__ import annotations

from elvis.core.differences.convergence import Family, family
from elvis.core.differences.difference import Difference, Differences, diff

__all__ = ["Difference", "Differences", "Family", "diff", "family"]
