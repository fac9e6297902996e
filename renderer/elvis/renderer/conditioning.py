"""How far depths may be from the true ones: rounding of places over how steeply rays meet a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Bools, Floats, Ints
from elvis.renderer.frame import Status
from elvis.renderer.view import PlaneView, View

EPSILON = float(np.finfo(np.float64).eps)
#: roundings of coordinates that places are computed with
_ROUNDINGS = 8
#: part of a depth up to which it may be uncertain and yet certain, as in shaders/iso.slang
MOST = 1e-8


def misplaced(view: View, reach: float) -> float:
    """How far places may be from where they are computed to be, in world units.

    reach  the greatest coordinate of the data, in magnitude
    """
    return _ROUNDINGS * EPSILON * (reach + float(np.abs(view.camera.eye).max()))


def uncertainties(view: View, pixel: Ints, depth: Floats, normal: Floats, reach: float) -> Floats:
    """(n,) how far the depths (n,) of hits in pixels (n,) may be from those of the surface, whose normals (n, 3) are
    given: a place beside it is that much over the cosine farther along the ray.  Without a normal the cosine is 1."""
    directions = view.rays(pixel % view.width, pixel // view.width)[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.abs(np.einsum("ni,ni->n", directions, normal)) / np.linalg.norm(directions, axis=1)
        own = misplaced(view, reach) / np.where(np.isnan(cosine), 1.0, cosine)
    return np.asarray(own + EPSILON * np.abs(depth))


def doubted(status: NDArray[np.uint8], uncertain: Bools) -> NDArray[np.uint8]:
    """The statuses (n,), of hits that are uncertain (n,) no longer certain."""
    return np.where(uncertain & (status == Status.CERTAIN), np.uint8(Status.AMBIGUOUS), status)


def is_slanted(view: PlaneView, reach: float) -> bool:
    """Whether rays run so nearly along a plane, or the eye is so near to it, that depths are uncertain at all pixels.

    The relative error is the same for all rays: from an eye at the height h over the plane, rounding over h.
    """
    eye = np.asarray(view.camera.eye, dtype=np.float64)
    height = abs(float((eye - view.plane.point) @ view.across))
    if view.perspective:
        return misplaced(view, reach) > MOST * height
    slope = abs(float(view.camera.basis()[2] @ view.across))
    return misplaced(view, reach) > MOST * max(height, slope)
