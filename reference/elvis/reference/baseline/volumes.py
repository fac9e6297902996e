"""Volumes of linear meshes: along a ray the quantity is linear in every tetrahedron, whose ways are summed up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elvis.formats.arrays import Floats
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.composing import Fog
from elvis.reference.scenes.rasters import barycentric_gradients, boxed
from elvis.reference.scenes.volumes import integrated, lengths, points_along
from elvis.reference.scenes.ways import Ways
from elvis.renderer.scene import Transfer
from elvis.renderer.view import View

#: parts of the way through a tetrahedron, of two Gauss points each
_PARTS = 8


def fogs(mesh: LinearMesh, name: str, transfer: Transfer, view: View, cuts: Sequence[Floats]) -> list[Fog]:
    """What a volume adds along rays, in pieces between the depths (n,) of surfaces.

    transfer  with its colours
    """
    found, places = [], points_along(_PARTS)
    for ways in _ways(mesh, name, view):
        parted = ways.between(cuts)
        values = parted.first + places * (parted.last - parted.first)
        color, alpha = integrated([values], lengths(parted, view), [transfer])
        shown = alpha > 0
        depth = 0.5 * (parted.near + parted.far)
        found.append(Fog(parted.pixel[shown], depth[shown], color[shown], alpha[shown]))
    return found


def _ways(mesh: LinearMesh, name: str, view: View) -> Iterator[Ways]:
    """The ways of rays through tetrahedra, some at a time, with the values (k, 1) at both ends."""
    corners, values = mesh.points[mesh.simplices], mesh.values[name][mesh.simplices]
    gradients = barycentric_gradients(corners)
    for cell, pixel in boxed(view, corners):
        row, column = np.divmod(pixel, view.width)
        origins, directions = view.rays(column.astype(np.float64), row.astype(np.float64))
        base = 1.0 * (np.arange(4) == 0) + np.einsum("nki,ni->nk", gradients[cell], origins - corners[cell, 0])
        slope = np.einsum("nki,ni->nk", gradients[cell], directions)

        # barycentric coordinates along the ray are base + depth slope, each positive inside
        with np.errstate(invalid="ignore", divide="ignore"):
            zero = -base / slope
        near = np.maximum(np.where(slope > 0, zero, -np.inf).max(axis=1), 0.0)
        far = np.where(slope < 0, zero, np.inf).min(axis=1)
        here = np.flatnonzero((near < far) & np.isfinite(far))
        ends = [base[here] + depth[here, None] * slope[here] for depth in (near, far)]
        first, last = (np.einsum("nk,nk->n", end, values[cell[here]])[:, None] for end in ends)
        yield Ways(pixel[here], cell[here], near[here], far[here], first, last)
