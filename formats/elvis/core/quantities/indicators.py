"""The smoothed indicator of a closed shape: FieldConvert's phifile, for Nektar++'s smoothed profile method.

phi = (1 - tanh(d/s))/2 at the distance d from the shape, negative inside: 1 inside, 0 outside, 1/2 on the surface
(Luo, Maxey and Karniadakis 2009, Smoothed profile method for particulate flows; Nektar++, ProcessPhiFromFile).
"""

from __future__ import annotations

from elvis.core.base.errors import ElvisError
from elvis.core.distances.sides import is_closed
from elvis.core.distances.triangle_files import SUFFIXES, triangles_of
from elvis.core.quantities.tree import Node, call, number


def indicator(distance: Node, target: str, scale: float) -> Node:
    """The indicator from a distance; ElvisError unless the target is a file with a closed surface."""
    if not scale > 0:
        raise ElvisError(f"indicator: expected a positive scale, found {scale:g}")
    if not target.lower().endswith(SUFFIXES):
        raise ElvisError(f"indicator: expected a file of triangles in quotes, found the boundary {target}")
    if not is_closed([triangles_of(target)[1]]):
        raise ElvisError(f"indicator: expected a closed surface, found open edges in {target}")
    smooth = call("tanh", call("/", distance, number(scale)))
    return call("/", call("-", number(1.0), smooth), number(2.0))
