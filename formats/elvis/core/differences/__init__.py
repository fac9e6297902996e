"""What separates two solutions: norms of the difference of their fields, on one mesh or on two.

pairing       whether meshes are the same, and datasets that hold both solutions
greatest      the greatest difference, certified on one mesh, and from points else
overlaps      that on two meshes with its bound, over all pairs of elements that may meet
compositions  differences on such pairs as nets, with the rounding of all that they are made of
prepared      the elements of either dataset, prepared for that
difference    all norms in one call
convergence   the order that differences of a family to the last of it show
"""

from __future__ import annotations

from elvis.core.differences.convergence import Family, family
from elvis.core.differences.difference import Difference, Differences, diff

__all__ = ["Difference", "Differences", "Family", "diff", "family"]
