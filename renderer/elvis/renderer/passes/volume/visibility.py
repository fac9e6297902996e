"""Visible parts of volumes along rays behind clips.  Needs no device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.renderer.passes.solids.hits import Hits, hits, outside, ray_depths
from elvis.scene import Clip, Plane, TriangleMesh, unit
from elvis.scene.cameras.view import View
from elvis.scene.model.surfaces import Solid


class Visibility:
    """The clips of a view whose surfaces rays meet without data: all but implicit ones.

    most  stops of a ray: depths at which it leaves or enters what a clip takes away
    """

    def __init__(self, clips: Sequence[Clip], view: View) -> None:
        every = [(clip.surface, clip.away == "inside") for clip in clips]
        self.view, self.clips = view, [(own, inside) for own, inside in every if isinstance(own, Solid)]
        meshes = {own for own, _ in self.clips if isinstance(own, TriangleMesh)}
        self.meshes = {mesh: _by_pixel(hits(mesh, view), view.count) for mesh in meshes}
        self.most = sum(
            len(self.meshes[own]) if isinstance(own, TriangleMesh) else 1 if isinstance(own, Plane) else 2
            for own, _ in self.clips
        )

    def along(self, pixel: Ints) -> tuple[Ints, Floats, Ints]:
        """Clips along rays: the number that hides the ray at the eye; positions of changes, and the changes.

        pixel  (m,) row by row from the top
        Returns (m,), (most, m) and (most, m); depths are unsorted, infinite for missing ones.  One point between two
        hits of a surface decides on which side of it they all are.
        """
        origins, directions = self.view.rays_of(pixel)
        count, depths, changes = (
            np.zeros(len(pixel), np.int64),
            [np.empty((0, len(pixel)))],
            [np.empty((0, len(pixel)))],
        )
        for own, inside in self.clips:
            met = self.meshes[own][:, pixel] if isinstance(own, TriangleMesh) else ray_depths(own, origins, directions)
            met = np.sort(np.where(met > 0.0, met, np.inf), axis=0)
            ends = np.vstack([np.zeros(len(pixel)), met])
            after = np.vstack([met, np.full(len(pixel), np.inf)])
            with np.errstate(invalid="ignore"):
                middle = np.where(np.isfinite(after), 0.5 * (ends + after), ends + np.maximum(ends, 1.0))
            middle = np.where(np.isfinite(ends), middle, 0.0)
            gone = np.array([_is_taken_away(own, inside, origins + depth[:, None] * directions) for depth in middle])
            count += gone[0]
            depths.append(met)
            changes.append(np.where(np.isfinite(met), np.diff(gone.astype(np.int64), axis=0), 0))
        return count, np.concatenate(depths), np.concatenate(changes).astype(np.int64)

    def hides(self, boxes: NDArray[np.float32]) -> Bools:
        """Flags (n,) of boxes (n, 6) that a single plane hides."""
        gone, half = np.zeros(len(boxes), bool), 0.5 * (boxes[:, 3:] - boxes[:, :3]).astype(np.float64)
        for own, inside in self.clips:
            if isinstance(own, Plane):
                distance = outside(own, boxes[:, :3] + half)
                half_width = half @ np.abs(unit(own.normal, "the normal of the plane"))
                gone |= (distance + half_width < 0.0) if inside else (distance - half_width > 0.0)
        return gone


def _is_taken_away(surface: Solid, inside: bool, points: Floats) -> Bools:
    """(n,) points (n, 3) on the side of a surface that is taken away."""
    distance = outside(surface, points)
    return np.asarray(distance < 0.0 if inside else distance > 0.0)


def _by_pixel(found: Hits, count: int) -> Floats:
    """(k, count) depths of hits, one column a pixel, infinite where it has fewer than others."""
    rank = np.arange(len(found.pixel)) - np.searchsorted(found.pixel, found.pixel)
    depths = np.full((int(rank.max(initial=-1)) + 1, count), np.inf)
    depths[rank, found.pixel] = found.depth
    return depths
