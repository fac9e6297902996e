"""Rays against surfaces in space: where they meet the surface follows from formulas; the points are located."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.inverse import Status as InverseStatus
from elvis.core.mapping.locate import Location
from elvis.core.mapping.margins import TOLERANCE
from elvis.reference.baseline.tracing import Tracer
from elvis.reference.locating import Locator
from elvis.reference.places import owners, polish, within_periods
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.surfaces import gradients, triangles
from elvis.scene import Cone, Cylinder, Plane, Sphere, Surface, TriangleMesh, unit
from elvis.scene.cameras.view import View
from elvis.scene.model.errors import SceneError
from elvis.scene.record.frame import Status

#: hits of one ray with a triangle mesh, at most
_MOST = 64


def cut_crossings(locator: Locator, surface: Surface, view: View) -> Crossings:
    """All hits of rays with the part of a surface that lies in the elements."""
    pixel, depth, normal = surface_hits(surface, view)
    origins, directions = view.rays_of(pixel)
    points = origins + depth[:, None] * directions
    possible = within_periods(locator.patches, points)
    pixel, depth, normal, points = pixel[possible], depth[possible], normal[possible], points[possible]
    found = owners(locator, points)
    polish(locator.patches, found, points)
    return Crossings.concatenate([_locate_points(found, pixel, depth, normal)])


def _locate_points(found: Location, pixel: Ints, depth: Floats, normal: Floats) -> Crossings:
    """The points that lie in elements; uncertain ones are marked as failed."""
    here = np.flatnonzero(np.isin(found.status, (InverseStatus.INSIDE, InverseStatus.FAILED)))
    known = found.status[here] == InverseStatus.INSIDE
    certain = np.where(found.margin[here] > TOLERANCE, Status.CERTAIN, Status.AMBIGUOUS)
    status = np.where(known, certain, Status.FAILED).astype(np.uint8)
    reference = np.zeros((len(here), 3))
    reference[:, : found.reference.shape[1]] = found.reference[here]
    columns = (pixel[here], depth[here], found.patch[here], found.row[here], reference, normal[here], status)
    return Crossings(*columns, np.full(len(here), np.nan))


def surface_hits(surface: Surface, view: View) -> tuple[Ints, Floats, Floats]:
    """Pixels (k,), depths (k,) and normals (k, 3) of all hits in front of the eye.

    Raises SceneError for a surface that isn't drawn this way.
    """
    if isinstance(surface, TriangleMesh):
        return _triangle_hits(surface, view)
    origins, directions = view.every_ray()
    depths = ray_depths(surface, origins, directions)
    pixel, which = np.nonzero(np.isfinite(depths) & (depths > 0))
    depth = depths[pixel, which]
    return pixel, depth, gradients(surface, origins[pixel] + depth[:, None] * directions[pixel])


def ray_depths(surface: Surface, origins: Floats, directions: Floats) -> Floats:
    """(n, 1 or 2) depths at which rays meet a surface, NaN if they don't.

    A sphere, cylinder or cone is the set |w|^2 = r^2, where w is x - c without its component along the axis; for a
    cone, r is that component times the tangent of its angle.
    """
    if isinstance(surface, Plane):
        normal = unit(surface.normal, "the normal of the plane")
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = ((np.asarray(surface.point) - origins) @ normal) / (directions @ normal)
        return np.where(np.isfinite(depth), depth, np.nan)[:, None]
    if not isinstance(surface, (Sphere, Cylinder, Cone)):
        raise SceneError(f"the reference cuts no elements by {type(surface).__name__}")
    weights, center, radius = _round(surface)

    # about the point of the ray that is nearest to the centre
    shift = np.einsum("ni,ni->n", center - origins, directions) / np.einsum("ni,ni->n", directions, directions)
    start = origins + shift[:, None] * directions - center
    square, mixed, rest = (
        np.einsum("ni,ij,nj->n", u, weights, v)
        for u, v in ((directions, directions), (directions, start), (start, start))
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(mixed**2 - square * (rest - radius**2))
        far = -(mixed + np.where(mixed < 0, -root, root))
        depths = np.column_stack([far / square, (rest - radius**2) / far])
    if isinstance(surface, Cone):
        along = (start @ unit(surface.axis, "the axis"))[:, None]
        along = along + depths * (directions @ unit(surface.axis, "the axis"))[:, None]
        depths[~(along >= 0)] = np.nan
    return np.where(np.isfinite(depths), depths + shift[:, None], np.nan)


def _round(surface: Sphere | Cylinder | Cone) -> tuple[Floats, Floats, float]:
    """Matrix, centre and radius of a quadric of revolution."""
    if isinstance(surface, Sphere):
        return np.eye(3), np.asarray(surface.center, np.float64), surface.radius
    axis = unit(surface.axis, "the axis")
    across = np.eye(3) - np.outer(axis, axis)
    if isinstance(surface, Cylinder):
        return across, np.asarray(surface.point, np.float64), surface.radius
    steep = np.tan(np.deg2rad(surface.angle)) ** 2
    return across - steep * np.outer(axis, axis), np.asarray(surface.apex, np.float64), 0.0


def _triangle_hits(surface: TriangleMesh, view: View) -> tuple[Ints, Floats, Floats]:
    """Hits with the triangles of a file, one behind the other, proposed by Embree."""
    tracer, found, beyond = Tracer(triangles(surface.file)), [], None
    for _ in range(_MOST):
        hits = tracer.first(view, beyond)
        here = np.flatnonzero(hits.seen)
        if not len(here):
            break
        found.append((here, hits.depth[here], hits.normal[here]))
        beyond = hits.depth
    empty = (np.empty(0, np.int64), np.empty(0), np.empty((0, 3)))
    pixel, depth, normal = (np.concatenate(parts) for parts in zip(empty, *found, strict=True))
    return pixel, depth, normal
