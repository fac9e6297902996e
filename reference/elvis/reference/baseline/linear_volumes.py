"""Volumes of linear meshes: along a ray the quantities are linear in each tetrahedron; their segments are summed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.clipping import is_clipped
from elvis.reference.composing import Fragments
from elvis.reference.scenes.cuts import surface_hits
from elvis.reference.scenes.rasters import barycentric_gradients, boxed
from elvis.reference.scenes.ray_integrals import Light, RayIntegral
from elvis.reference.scenes.segments import Segments, lengths, points_of
from elvis.reference.scenes.volumes import Medium, depths_by_pixel
from elvis.scene import Clip, Implicit, Transfer
from elvis.scene.cameras.view import View


def volume_fragments(
    mesh: LinearMesh, media: Sequence[Medium], clips: Sequence[Clip], view: View, cuts: Sequence[Floats]
) -> list[Fragments]:
    """Fragments of blended volumes along rays outside clips, between the depths (n,) of surfaces.

    media  quantity and transfer function, with colours, of each volume
    """
    found = []
    surfaces = [clip.surface for clip in clips]
    names = [*(name for name, _ in media), *(own.expression for own in surfaces if isinstance(own, Implicit))]
    walls = [
        depth
        for own in surfaces
        if not isinstance(own, Implicit)
        for depth in depths_by_pixel(*surface_hits(own, view)[:2], view.count)
    ]
    emitting = ~np.all([_dark(mesh.values[name][mesh.simplices], transfer) for name, transfer in media], axis=0)
    for segments in _segments(mesh.part(emitting), names, view):
        parted = segments.between([*cuts, *walls])
        for column in range(len(media), len(names)):
            parted = _split_at_level(parted, column)
        parted = parted.part(~_is_taken_away(parted, clips, names, view, mesh.size))
        for column, (_, transfer) in enumerate(media):
            for level in transfer.values:
                parted = _split_at_level(parted, column, level)
        light = _light(parted, [transfer for _, transfer in media], lengths(parted, view))
        color, alpha = light.color, light.alpha
        shown = alpha > 0
        depth = 0.5 * (parted.near + parted.far)
        found.append(Fragments(parted.pixel[shown], depth[shown], color[shown], alpha[shown]))
    return found


def _dark(values: Floats, transfer: Transfer) -> Bools:
    """(m,) which simplices with values (m, 4) at their corners neither send out nor take up light."""
    nodes, bright = np.asarray(transfer.values), np.flatnonzero(np.asarray(transfer.densities) > 0)
    low, high = values.min(axis=1), values.max(axis=1)
    begins, ends = np.concatenate([[-np.inf], nodes[:-1]])[bright], np.concatenate([nodes[1:], [np.inf]])[bright]
    lit = np.zeros(len(values), bool)
    for begin, end in zip(begins, ends, strict=True):
        lit |= (high > begin) & (low < end)
    return ~lit


def _light(segments: Segments, transfers: Sequence[Transfer], length: Floats) -> Light:
    """The light of segments between which values are linear; ``length`` (k,) in world units."""

    def values(which: Ints, shares: Floats) -> list[Floats]:
        first, last = segments.first[which, :, None], segments.last[which, :, None]
        every = first + shares[:, None] * (last - first)
        return [every[:, column] for column in range(len(transfers))]

    rounding = np.zeros((len(segments), len(transfers)))
    return RayIntegral(values, transfers, length, rounding, 1).light()


def _split_at_level(segments: Segments, column: int, level: float = 0.0) -> Segments:
    """Segments parted where one of their values passes a level."""
    first, last = segments.first[:, column] - level, segments.last[:, column] - level
    which = np.flatnonzero((first < 0) != (last < 0))
    share = (first[which] / (first - last)[which])[:, None]
    middle = segments.first[which] + share * (segments.last - segments.first)[which]
    return segments.split_at(which, segments.near[which] + share[:, 0] * (segments.far - segments.near)[which], middle)


def _is_taken_away(segments: Segments, clips: Sequence[Clip], names: Sequence[str], view: View, size: float) -> Bools:
    """(k,) which segments clips take away: those whose middle they do."""
    middle = 0.5 * (segments.first + segments.last)
    points = points_of(view, segments.pixel, 0.5 * (segments.near + segments.far))
    return is_clipped(clips, points, lambda name: middle[:, names.index(name)], size)


def _segments(mesh: LinearMesh, names: Sequence[str], view: View) -> Iterator[Segments]:
    """The segments of rays through tetrahedra, some at a time, with the values (k, names) at both ends."""
    corners = mesh.points[mesh.simplices]
    values = np.stack([mesh.values[name][mesh.simplices] for name in names], axis=2)
    gradients = barycentric_gradients(corners)
    for cell, pixel in boxed(view, corners):
        origins, directions = view.rays_of(pixel)
        base = 1.0 * (np.arange(4) == 0) + np.einsum("nki,ni->nk", gradients[cell], origins - corners[cell, 0])
        rate = np.einsum("nki,ni->nk", gradients[cell], directions)

        # barycentric coordinates along the ray are base + depth rate, each positive inside
        with np.errstate(invalid="ignore", divide="ignore"):
            zero = -base / rate
        near = np.maximum(np.where(rate > 0, zero, -np.inf).max(axis=1), 0.0)
        far = np.where(rate < 0, zero, np.inf).min(axis=1)
        here = np.flatnonzero((near < far) & np.isfinite(far))
        ends = [base[here] + depth[here, None] * rate[here] for depth in (near, far)]
        first, last = (np.einsum("nk,nkv->nv", end, values[cell[here]]) for end in ends)
        yield Segments(pixel[here], cell[here], near[here], far[here], first, last)
