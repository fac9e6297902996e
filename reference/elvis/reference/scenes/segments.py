"""Segments of rays through elements: between neighbouring hits of their faces, and the places along them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.mapping.patch import Patch
from elvis.reference.locating import Locator
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.faces import face_crossings
from elvis.reference.scenes.newton import inverses
from elvis.reference.solids import faces_of, map_points, margins_of
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Status

_STEPS = 12
#: share of a ray that segments may have in common by rounding, relative to the scene's size
_SHARED = 1e-9


@dataclass(frozen=True, eq=False)
class Segments(Rows):
    """Segments of rays through elements of one patch.

    pixel        (k,)    row by row from the top
    row          (k,)    of the elements
    near, far    (k,)    depths of both ends
    first, last  reference coordinates of both ends, or other quantities that are linear between them
    """

    pixel: Ints
    row: Ints
    near: Floats
    far: Floats
    first: Floats
    last: Floats

    def and_also(self, other: Segments) -> Segments:
        """These segments and others."""
        return Segments(**{name: np.concatenate([own, getattr(other, name)]) for name, own in vars(self).items()})

    def between(self, cuts: Sequence[Floats] | Floats) -> Segments:
        """The segments, parted at depths (n,) by pixel."""
        made = self
        for cut in cuts:
            at = cut[made.pixel]
            crossed = np.flatnonzero((at > made.near) & (at < made.far))
            part = ((at - made.near) / (made.far - made.near))[crossed, None]
            made = made.split_at(crossed, at[crossed], made.first[crossed] + part * (made.last - made.first)[crossed])
        return made

    def split_at(self, which: Ints, depth: Floats, middle: Floats) -> Segments:
        """The segments, with numbers (k,) split at depths (k,), where the reference coordinates are (k, …)."""
        far, last = self.far.copy(), self.last.copy()
        far[which], last[which] = depth, middle
        beyond = Segments(self.pixel[which], self.row[which], depth, self.far[which], middle, self.last[which])
        return Segments(self.pixel, self.row, self.near, far, self.first, last).and_also(beyond)

    def cut(self, own: Ints, low: Floats, high: Floats) -> Segments:
        """Parts (m,) of segments of numbers ``own``, each from one share of its segment to another."""
        near, far = (self.near[own] + end * (self.far - self.near)[own] for end in (low, high))
        first, last = (self.first[own] + end[:, None] * (self.last - self.first)[own] for end in (low, high))
        return Segments(self.pixel[own], self.row[own], near, far, first, last)

    def at(self, shares: Floats) -> Floats:
        """(k, m) depths at shares (k, m) of the segments."""
        return np.asarray(self.near[:, None] + shares * (self.far - self.near)[:, None])


def segments_through(
    number: int, patch: Patch, view: View, size: float, begun: Crossings, wanted: Ints | None = None
) -> Segments:
    """The segments of all rays through the elements of a patch: between neighbouring hits of faces, where inside.

    begun   starts of rays within elements
    wanted  (n,) sorted numbers row * pixels + pixel of pairs of an element and a pixel; only these are examined
    """
    rows = np.unique(wanted // view.count) if wanted is not None else np.arange(len(patch))
    chosen = np.zeros((len(patch), len(faces_of(patch))), bool)
    chosen[rows] = True
    hits = face_crossings(number, patch, chosen, view, size, wanted)
    hits = Crossings.concatenate([hits, begun.part(begun.patch == number)])
    hits = hits.part(np.lexsort([hits.depth, hits.row, hits.pixel]))
    pairs = np.flatnonzero((np.diff(hits.pixel) == 0) & (np.diff(hits.row) == 0))
    found = _pair(hits, pairs)
    middle = 0.5 * (found.near + found.far)
    start, points = 0.5 * (found.first + found.last), points_of(view, found.pixel, middle)
    return found.part(margins_of(patch, followed(patch, found.row, start, points)) > -1e-9)


def without_overlaps(parts: Sequence[Segments], size: float) -> list[Segments]:
    """The segments of several patches.

    The part of a ray that two share, in the face between them, belongs to the first.

    size  of the scene in world units
    """
    pixel, near, far = (np.concatenate([getattr(part, name) for part in parts]) for name in ("pixel", "near", "far"))
    order = np.lexsort([far, near, pixel])
    rank = np.arange(len(order)) - np.searchsorted(pixel[order], pixel[order])

    # depth up to which each ray is covered, by turns of its segments
    begin, reached = near.copy(), np.full(int(pixel.max(initial=0)) + 1, -np.inf)
    for turn in range(int(rank.max(initial=-1)) + 1):
        own = order[rank == turn]
        before = reached[pixel[own]]
        begin[own] = np.where(before > near[own] + _SHARED * size, before, near[own])
        reached[pixel[own]] = np.maximum(before, far[own])
    with np.errstate(invalid="ignore", divide="ignore"):
        low = np.nan_to_num((begin - near) / (far - near))
    found = []
    for part, some in zip(parts, np.split(low, np.cumsum([len(part) for part in parts])[:-1]), strict=True):
        left = np.flatnonzero(some < 1.0)
        found.append(part.cut(left, some[left], np.ones(len(left))))
    return found


def beginnings(locator: Callable[[], Locator], view: View, box: Floats) -> Crossings:
    """Starts of rays within elements, as hits; all elements lie in a box (2, 3)."""
    origins, _ = view.every_ray()
    pixel = np.flatnonzero(((origins >= box[0]) & (origins <= box[1])).all(axis=1))
    if not len(pixel):
        return Crossings.none()
    asked = origins[pixel[:1] if view.perspective else pixel]
    found = locator().locate(asked, all=True)
    held = np.flatnonzero(found.patch >= 0)

    # in perspective all rays begin at the eye
    pixel = np.repeat(pixel, len(held)) if view.perspective else pixel[found.point[held]]
    held = np.tile(held, len(pixel) // len(held)) if len(held) and view.perspective else held
    reference = np.zeros((len(held), 3))
    reference[:, : found.reference.shape[1]] = found.reference[held]
    status = np.full(len(held), Status.CERTAIN, np.uint8)
    columns = (pixel, np.zeros(len(held)), found.patch[held], found.row[held], reference, reference, status)
    return Crossings(*columns, np.full(len(held), np.nan))


def _pair(hits: Crossings, pairs: Ints) -> Segments:
    after = pairs + 1
    ends = (hits.depth[pairs], hits.depth[after], hits.reference[pairs], hits.reference[after])
    return Segments(hits.pixel[pairs], hits.row[pairs], *ends)


def places(segments: Segments, patch: Patch, view: View, shares: Floats) -> tuple[Floats, Floats]:
    """Reference coordinates and world points (k * m, 3) at shares (k, m) of segments."""
    start = segments.first[:, None] + shares[..., None] * (segments.last - segments.first)[:, None]
    rows, pixel = (np.repeat(column, shares.shape[1]) for column in (segments.row, segments.pixel))
    points = points_of(view, pixel, segments.at(shares).ravel())
    return followed(patch, rows, start.reshape(-1, start.shape[-1]), points), points


def points_of(view: View, pixel: Ints, depth: Floats) -> Floats:
    """(k, 3) world points of rays at some depths."""
    origins, directions = view.rays_of(pixel)
    return np.asarray(origins + depth[:, None] * directions)


def followed(patch: Patch, rows: Ints, start: Floats, points: Floats, enough: float = 1e-9) -> Floats:
    """(n, 3) reference points of world points (n, 3) in elements (n,), from near ones, by Newton's method.

    enough  length of a step that ends the iteration; the remaining error has the order of its square
    """
    reference, active = start.copy(), np.arange(len(rows))
    for _ in range(_STEPS):
        world, jacobians = map_points(patch, rows[active], reference[active])
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            step = np.einsum("nij,nj->ni", inverses(jacobians), points[active] - world)
        length = np.linalg.norm(step, axis=1)
        good = np.isfinite(length)
        part = np.minimum(1.0, 0.5 / np.maximum(length, 1e-300))
        reference[active[good]] += part[good, None] * step[good]
        active = active[good & (length > enough)]
        if not len(active):
            break
    return reference


def lengths(segments: Segments, view: View) -> Floats:
    """(k,) lengths of segments in world units."""
    directions = view.rays_of(segments.pixel)[1]
    return np.asarray(np.linalg.norm(directions, axis=1) * (segments.far - segments.near))
