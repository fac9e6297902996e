"""The sides of elements, faces or in a plane edges, as functions on elements: normals and heights above them.

The side of a point is the side nearest to it in the reference shape.  With the function lambda that is 0 on the side
and 1 at the far end of the element, the outward normal is -grad lambda / |grad lambda|; the height of the element above
the side is 1 / |grad lambda|; on straight elements with parallel layers this is the thickness of the layer.  They are
defined only on sides and NaN elsewhere.
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.mapping.margins import facets, heights
from elvis.core.shapes import Shape

SIDES = ("nx", "ny", "nz", "face_height")
#: gradients of the reference coordinates in the world, by coordinate and axis: zero for those that a shape lacks
DUALS = tuple(f"xi{i}_{axis}" for i in (1, 2, 3) for axis in "xyz")
#: largest lambda of points that lie on a side
NEAR = 1e-4


def side_gradients(shape: Shape, points: Floats, duals: Floats) -> Floats:
    """(n, 3) gradients of lambda in the world at reference points (n, D), NaN off the sides.

    duals  (n, 3, D) of the map there, see `elvis.core.mapping.tangents`
    """
    own = points[:, : shape.dimension]
    above = heights(shape, own)
    nearest = above.argmin(axis=1)
    slopes = facets(shape)[0][nearest]
    gradients = np.einsum("nci,ni->nc", duals[:, :, : shape.dimension], slopes)
    is_on = above.min(axis=1) <= NEAR
    return np.asarray(np.where(is_on[:, None], gradients, np.nan))


def of_side(name: str, gradients: Floats) -> Floats:
    """(n,) one of SIDES, from gradients of lambda (n, 3)."""
    with np.errstate(all="ignore"):
        lengths = np.linalg.norm(gradients, axis=1)
        if name == "face_height":
            return np.asarray(1 / lengths)
        return np.asarray(-gradients[:, "xyz".index(name[1])] / lengths)


def places_on_sides(shape: Shape) -> Floats:
    """(k, d) some reference points on each side: its middle, and points near to its corners."""
    found = []
    for column in heights(shape, shape.vertices).T:
        corners = shape.vertices[column == 0]
        middle = corners.mean(axis=0)
        found += [middle[None], middle + 0.999 * (corners - middle)]
    return np.concatenate(found)
