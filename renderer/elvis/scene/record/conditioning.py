"""How far depths may be from the true ones: rounding of places over how steeply rays meet a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.scene.cameras.view import PlaneView, View
from elvis.scene.record.frame import Status

EPSILON = float(np.finfo(np.float64).eps)
#: roundings of coordinates that places are computed with
_ROUNDINGS = 8
#: part of a depth up to which it may be uncertain and yet certain, as in iso.slang
MOST = 1e-8
#: cosines, and heights relative to the maximum coordinate, above which no ray runs along a plane
_NEAR = 1e-6


def misplaced(view: View, extent: float) -> float:
    """How far places may be from where they are computed to be, in world units.

    extent  the largest coordinate of the data, in magnitude
    """
    return _ROUNDINGS * EPSILON * (extent + float(np.abs(view.camera.eye).max()))


def uncertainties(view: View, pixel: Ints, depth: Floats, normal: Floats, extent: float) -> Floats:
    """Uncertainties (n,) of the depths (n,) of hits in pixels (n,) on surfaces with normals (n, 3).

    A displacement d of the surface moves the hit by d over the cosine along the ray.  Without a normal the cosine is 1.
    """
    directions = view.rays_of(pixel)[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.abs(np.einsum("ni,ni->n", directions, normal)) / np.linalg.norm(directions, axis=1)
        own = misplaced(view, extent) / np.where(np.isnan(cosine), 1.0, cosine)
    return np.asarray(own + EPSILON * np.abs(depth))


def doubt(status: NDArray[np.uint8], uncertain: Bools) -> NDArray[np.uint8]:
    """The statuses (n,), of hits that are uncertain (n,) no longer certain."""
    return np.where(uncertain & (status == Status.CERTAIN), np.uint8(Status.AMBIGUOUS), status)


def slanted(view: PlaneView, extent: float) -> Bools | None:
    """Pixels (n,) whose rays run so nearly along the plane that hits on it are uncertain; None if there are none.

    From an eye away from the plane, such rays meet it at a great distance.
    """
    greatest = extent + float(np.abs(view.camera.eye).max())
    height = abs(float(np.subtract(view.camera.eye, view.plane.point) @ view.across))
    tilt = abs(float(view.camera.basis()[2] @ view.across))
    if (height > _NEAR * greatest) if view.perspective else (tilt > _NEAR):
        return None
    directions = view.every_ray()[1]
    cosine = np.abs(directions @ view.across) / np.linalg.norm(directions, axis=1)
    return np.asarray(misplaced(view, extent) > MOST * greatest * cosine)
