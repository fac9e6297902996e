"""Faces cut into patches whose projected maps are nearly linear, so that a pixel's ray meets each of them at most once.

Screen nets (5, count, n) contain homogeneous control points of the projected maps: column, row and weight as by
View.to_pixel, depth times w, and w.  NumPy is fast only along long axes, so patches are the last axis.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.mapping.orientation import chunks
from elvis.plugins.faces.nets import FaceSpace
from elvis.renderer.device.drafts import is_draft
from elvis.renderer.raster.ball_bounds import is_in_picture
from elvis.scene.cameras.view import View
from elvis.scene.model.time_limit import check_time

#: largest relative change b of a tame map's Jacobian J: from any point to any other J^-1 J' - 1 is 2 b / (1 - b) = 2/3
TAME = 0.25
#: pixels below which a patch counts as a point, or as a line where it is that thin, unless rounding leaves more open
THIN = 1e-6
#: how often a face is bisected at most
_LEVELS = 96
#: the same in drafts: most patches need fewer, and each one takes as long as for many patches
_LEVELS_OF_DRAFTS = 8
#: share of the reach below which a patch counts as a line: folds are not refined further for pixels next to them
_THIN_BESIDE = 0.25
#: columns of pixels up to which thin patches are examined closely
_COLUMNS = 8
#: margin in pixels around a patch within which it is still tested, in addition to its rounding
_BESIDE = 0.01
#: patches worked on at once
_CHUNK = 1 << 14


@dataclass(frozen=True, eq=False)
class FacePatches:
    """Patches of faces in a view.

    face    (n,)       number of the face
    place   (n, 3, 2)  origin and axes of the patch in face coordinates
    bounds  (2, n, 4)  minimum and maximum x, y, x + y and x - y of the pixels (x, y) that it may cover
    beside  (k, 3, n)  a, b and c of lines a x + b y = c along its k sides, beyond which no such pixel lies
    near    (n,)       no point of it has a smaller depth
    noise   (n,)       uncertainty through rounding, in coordinates of the patch
    """

    face: Ints
    place: Floats
    bounds: Ints
    beside: Floats
    near: Floats
    noise: Floats

    def within(self, view: View) -> FacePatches:
        """Patches with pixels in a window of the picture."""
        if view.part_of is None:
            return self
        return self.some(np.flatnonzero(is_in_picture(view, *self.bounds)))

    def some(self, chosen: Ints) -> FacePatches:
        """Some of the patches."""
        bounds, beside = self.bounds[:, chosen], self.beside[..., chosen]
        return FacePatches(self.face[chosen], self.place[chosen], bounds, beside, self.near[chosen], self.noise[chosen])


@dataclass(frozen=True, eq=False)
class Edges:
    """Patches that are seen as points or lines: folds of faces, and faces that are seen edge-on.

    ends    (2, n, 2)  in pixels
    depth   (2, n)     minimum and maximum
    radius  (n,)       pixels within which a ray may meet the patch though it seems to pass the line between the ends
    """

    ends: Floats
    depth: Floats
    radius: Floats


def face_patches(space: FaceSpace, nets: Floats, view: View, reach: float = 0.0) -> tuple[FacePatches, Edges]:
    """Everything of faces with ``nets`` (n, count, 4) that may cover the centre of a pixel of the view.

    view   a whole picture: what depends on its pixels is the same in all windows of it
    reach  or come as near to it as this, in columns and in rows
    """
    rounding = _rounding(nets, view)
    found = _Batch.concatenate(space, _batches(space, nets, view, rounding, reach))
    patches = found.some(np.flatnonzero(~found.line))
    lines = found.some(np.flatnonzero(found.line))
    return _surfaces(space, patches, view, rounding, reach), _edges(lines, view, rounding)


def _batches(space: FaceSpace, nets: Floats, view: View, rounding: float, reach: float) -> Iterator[_Batch]:
    """The patches of all faces, some faces at a time."""
    # column, row and weight, depth and w are linear in homogeneous coordinates
    depth = np.append(view.camera.basis()[2], view.depth_of(np.zeros(3)))
    w = np.array([0.0, 0.0, 0.0, 1.0])
    rows = np.concatenate([view.to_pixel, [depth], [w]])

    numbers = np.arange(len(nets))
    for some in chunks(len(nets), _CHUNK):
        screen = np.tensordot(rows, nets[some].T, 1)
        faces = _Batch.of(space, numbers[some], screen)
        for batch in _divide(space, faces, view, rounding, reach):
            yield batch
            check_time()


def _surfaces(space: FaceSpace, batch: _Batch, view: View, rounding: float, reach: float) -> FacePatches:
    """Patches that are seen as surfaces."""
    place = np.moveaxis(batch.place, -1, 0)
    bounds = batch.pixels.transpose(0, 2, 1)
    near = batch.depth.min(axis=0)
    slack = _slack(batch.screen[2], rounding, view) + reach + _BESIDE
    return FacePatches(batch.face, place, bounds, _beside(space, batch, slack), near, rounding * batch.spread)


def _beside(space: FaceSpace, batch: _Batch, slack: Floats) -> Floats:
    """(k, 3, n) lines as in FacePatches: those between the corners, moved outwards until no control point lies beyond.

    slack  (n,) pixels within which these are known
    """
    x, y = batch.screen[:2] / batch.screen[2]
    last, row = space.count - 1, space.degree
    corners = [0, row, last] if len(space.halves) == 3 else [0, row, last, last - row]
    across, down = x[np.roll(corners, -1)] - x[corners], y[np.roll(corners, -1)] - y[corners]
    turned = across[0] * down[1] < down[0] * across[1]
    a, b = np.where(turned, -down, down), np.where(turned, across, -across)
    most = (a[:, None] * x + b[:, None] * y).max(axis=1)
    return np.stack([a, b, most + slack * (np.abs(a) + np.abs(b))], axis=1)


def _edges(batch: _Batch, view: View, rounding: float) -> Edges:
    """Patches that are seen as points or lines."""
    weight = batch.screen[2]
    slack = _slack(weight, rounding, view)
    ends, width = _ends(batch.screen[:2] / weight, slack)
    depth = np.stack([batch.depth.min(axis=0), batch.depth.max(axis=0)])
    return Edges(ends.transpose(0, 2, 1), depth, width + 3.0 * slack)


@dataclass(eq=False)
class _Batch:
    """Patches that are worked on at once.

    face    (n,)           number of the face
    place   (3, 2, n)      as in FacePatches
    screen  (5, count, n)  nets
    pixels  (2, 4, n)      as the bounds of FacePatches, where it is in front of the eye
    line    (n,)           whether it is as thin as a line or a point
    spread  (n,)           see _linearity
    """

    face: Ints
    place: Floats
    screen: Floats
    pixels: Ints
    line: Bools
    spread: Floats

    @staticmethod
    def of(space: FaceSpace, face: Ints, screen: Floats) -> _Batch:
        """Whole faces."""
        count = len(face)
        origin_and_axes = np.vstack([np.zeros(2), np.eye(2)])
        place = np.repeat(origin_and_axes[..., None], count, axis=-1)
        pixels = np.zeros((2, 4, count), np.int64)
        return _Batch(face, place, screen, pixels, np.zeros(count, bool), np.zeros(count))

    @staticmethod
    def concatenate(space: FaceSpace, batches: Iterable[_Batch]) -> _Batch:
        """Several as one; there may be none."""
        none = _Batch.of(space, np.arange(0), np.empty((5, space.count, 0)))
        every = [none.parts(), *(batch.parts() for batch in batches)]
        return _Batch(*(np.concatenate(arrays, axis=-1) for arrays in zip(*every, strict=True)))

    @property
    def depth(self) -> Floats:
        """(count, n) depths of the control points."""
        return np.asarray(self.screen[3] / self.screen[4])

    def parts(self) -> tuple[Any, ...]:
        """All arrays; patches are the last axis of each."""
        return self.face, self.place, self.screen, self.pixels, self.line, self.spread

    def some(self, which: Ints) -> _Batch:
        """The patches with these numbers."""
        return _Batch(*(part.take(which, axis=-1) for part in self.parts()))


def _rounding(nets: Floats, view: View) -> float:
    """Error of X - i W and Y - j W that rounding makes."""
    places = np.abs(nets[..., :3] / nets[..., 3:])
    size = np.append(places.max(axis=(0, 1), initial=0.0), 1.0)

    # magnitudes of the terms whose sums X, Y and W are
    across, down, weight = np.abs(view.to_pixel) @ size
    greatest = max(across, down) + max(view.width, view.height) * weight
    return float(16 * np.finfo(float).eps * greatest)


def _slack(weight: Floats, rounding: float, view: View) -> Floats:
    """Sizes (n,) in pixels below which rounding dominates patches in front of the eye, with weights (count, n).

    So a patch that rounding may move onto a pixel's centre is retained, and no patch is subdivided into noise.
    """
    with np.errstate(divide="ignore", over="ignore"):
        own = rounding / weight.min(axis=0, initial=np.inf)
    return np.asarray(own.clip(THIN, _extent(view)))


def _extent(view: View) -> float:
    """Pixels beyond which all is as far away, and more than from one side of the picture to another."""
    return 2.0 * (view.width + view.height)


def _divide(space: FaceSpace, batch: _Batch, view: View, rounding: float, reach: float) -> Iterator[_Batch]:
    """Patches with nearly linear maps, and patches that are points or lines.

    Other patches are bisected along their longest side, unless they cover no centre.  Drafts stop after a few
    bisections and take what is left as surfaces, at whose folds Newton's method may miss a pixel.
    rounding  see _rounding
    reach     see face_patches
    """
    last = _LEVELS_OF_DRAFTS if is_draft() else _LEVELS
    stack = [(0, batch)]
    while stack:
        level, batch = stack.pop()
        batch, front = _visible_patches(batch, view, rounding, reach)
        tame, direction, batch.spread = _linearity(space, batch, front, view)
        done = front & (tame | batch.line | (level == last))
        batch.line |= ~tame & (level < last or last == _LEVELS)
        yield batch.some(np.flatnonzero(done))
        if level == last or done.all():
            continue
        rest = batch.some(np.flatnonzero(~done))
        halves = _halve(space, direction[~done], rest)
        numbers = np.arange(len(halves.face))
        for some in chunks(len(numbers), _CHUNK):
            stack.append((level + 1, halves.some(numbers[some])))


def _halve(space: FaceSpace, direction: Ints, batch: _Batch) -> _Batch:
    """Two patches for each, cut in this direction."""
    # sort patches by their direction of bisection
    order = np.argsort(direction, kind="stable")
    batch = batch.some(order)
    ends = np.searchsorted(direction[order], np.arange(len(space.halves) + 1))

    # all first halves, then all second ones
    halves = _Batch(*(np.concatenate([part, part], axis=-1) for part in batch.parts()))
    for cut in range(len(space.halves)):
        own = slice(ends[cut], ends[cut + 1])
        for half in range(2):
            before = half * len(direction)
            new = slice(ends[cut] + before, ends[cut + 1] + before)
            halves.screen[..., new] = space.cuts[cut, half] @ batch.screen[..., own]
            halves.place[..., new] = np.tensordot(space.halves[cut, half], batch.place[1:, :, own], 1)
            halves.place[0, :, new] += batch.place[0, :, own]
    return halves


def _visible_patches(batch: _Batch, view: View, rounding: float, reach: float) -> tuple[_Batch, Bools]:
    """The patches that may cover the centre of a pixel, and (n,) whether they are in front of the eye.

    Patches beyond a side of the picture or behind the eye are dropped.  For patches in front, pixels and thinness are
    stored.
    """
    batch = batch.some(np.flatnonzero(_is_in_picture(batch.screen, view, rounding, reach)))

    # points that rounding can't distinguish from the eye may be anywhere: they become a point in the middle, with a
    # weight that marks this
    least = rounding / _extent(view)
    at_eye = batch.screen[2].max(axis=0) <= least
    batch.screen[:3, :, at_eye] = least * np.append(0.5 * (view.first + view.last), 1.0)[:, None, None]
    front = batch.screen[2].min(axis=0) > 0.0
    weight = batch.screen[2].compress(front, axis=-1)
    flat = batch.screen[:2].compress(front, axis=-1) / weight
    slack = _slack(weight, rounding, view)
    pixels = _pixels(flat, slack, view, reach)
    batch.pixels[..., front] = pixels
    ends, width = _ends(flat, slack)
    batch.line[:] = False
    batch.line[front] = width < np.maximum(slack, _THIN_BESIDE * reach)

    # drop patches in front of the eye that cover no centre of a pixel
    has_pixels = (pixels[1] >= pixels[0]).all(axis=0)
    kept = ~front
    kept[front] = has_pixels & ((reach > 0.0) | _may_hold(flat, ends, width, slack))
    return batch.some(np.flatnonzero(kept)), front[kept]


def _is_in_picture(screen: Floats, view: View, rounding: float, reach: float) -> Bools:
    """(n,) whether nets (5, count, n) may reach into the picture, ``reach`` pixels wider, and before the eye."""
    x, y, w, depth = screen[:4]
    seen = np.isfinite(screen).all(axis=(0, 1)) & (depth.max(axis=0) > 0.0)
    beside = np.maximum(THIN * w, rounding) + reach * np.abs(w)
    for side, near, far in zip((x, y), view.first, view.last, strict=True):
        after_first = (side - near * w + beside).max(axis=0) > 0.0
        before_last = (far * w + beside - side).max(axis=0) > 0.0
        seen &= after_first & before_last
    return np.asarray(seen)


def _may_hold(points: Floats, ends: Floats, width: Floats, slack: Floats) -> Bools:
    """(n,) whether hulls (2, count, n) may hold the centre of a pixel: thin ones hold few, however long they are.

    ends, width  see _ends
    slack        (n,) pixels within which the hulls are known
    """
    # x and y change places where hulls are steep
    across, down = np.abs(ends[1] - ends[0])
    steep = down > across
    places = np.where(steep, points[1], points[0])
    x0, x1 = np.where(steep, ends[:, 1], ends[:, 0])
    y0, y1 = np.where(steep, ends[:, 0], ends[:, 1])

    # the columns that they reach over
    first = np.ceil(places.min(axis=0) - slack)
    last = np.floor(places.max(axis=0) + slack)
    is_long = last - first >= _COLUMNS

    # in each of these, how far the line is from the nearest centre
    derivative = np.divide(y1 - y0, x1 - x0, out=np.zeros_like(x0), where=x1 != x0)
    x = first + np.arange(_COLUMNS)[:, None]
    y = y0 + derivative * (x - x0)
    distance = np.abs(y - np.rint(y))
    held = (distance <= 1.5 * width + 2 * slack) & (x <= last)
    return np.asarray(held.any(axis=0) | is_long)


def _pixels(points: Floats, slack: Floats, view: View, reach: float) -> Ints:
    """(2, 4, n) minimum and maximum x, y, x + y and x - y of the pixels of the view that hulls (2, count, n) may cover.

    reach  see face_patches
    None where the smallest ones exceed the largest.
    """
    extent = _extent(view)
    x, y = points
    every = (x, y, x + y, x - y)
    low = np.stack([side.min(axis=0) for side in every]).clip(-extent, extent)
    high = np.stack([side.max(axis=0) for side in every]).clip(-extent, extent)

    # whole pixels of the picture
    slack = slack + reach * np.array([[1.0], [1.0], [2.0], [2.0]])
    least = np.ceil(low - slack)
    most = np.floor(high + slack)
    least[:2] = least[:2].clip(view.first[:, None], None)
    most[:2] = most[:2].clip(None, view.last[:, None])
    return np.stack([least, most]).astype(np.int64)


def _ends(points: Floats, slack: Floats) -> tuple[Floats, Floats]:
    """(2, 2, n) two points of each hull (2, count, n) far apart, and (n,) how far others lie from the line between.

    slack  (n,) hulls no longer than this are points
    """
    # the first point, and the one that is farthest from it
    x, y = points - points[:, :1]
    number = (x * x + y * y).argmax(axis=0)
    every = np.arange(points.shape[2])
    far_x, far_y = x[number, every], y[number, every]
    length = np.hypot(far_x, far_y)

    # a point's distance from the line is its cross product with the line, divided by the length
    crosses = np.abs(x * far_y - y * far_x)
    across = crosses.max(axis=0)
    width = np.divide(across, length, out=np.zeros_like(across), where=length > slack)
    return np.stack([points[:, 0], points[:, number, every]]), width


def _linearity(space: FaceSpace, batch: _Batch, front: Bools, view: View) -> tuple[Bools, Ints, Floats]:
    """(n,) whether X - i W and Y - j W change nearly linearly, where patches look longest, and their spread:

    how far roots move in the patch where X - i W and Y - j W change by 1, to first order.
    All pixels (i, j) within the bounds of a patch are meant.  With the matrix M that inverts the mean Jacobian for the
    middle pixel, b is the largest row sum of M J - 1, which the derivatives' nets bound, and g what other pixels add.
    """
    picture = np.stack([view.first, view.last])[..., None]
    low, high = np.where(front, batch.pixels[:, :2], picture)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    derivatives = [matrix @ batch.screen[[0, 1, 2, 4]] for matrix in space.derivatives]
    planes = [derivative[:2] - middle[:, None] * derivative[2] for derivative in derivatives]
    (xs, ys), (xt, yt) = (plane.mean(axis=1) for plane in planes)
    weights = [derivative[2].mean(axis=0) for derivative in derivatives]

    with np.errstate(all="ignore"):
        # M, times vectors; the sums of its effect on all changes
        inverse = 1.0 / (xs * yt - xt * ys)
        first, second = np.stack([yt, -xt]) * inverse, np.stack([-ys, xs]) * inverse
        b, g = np.zeros((2, 2, len(xs)))
        for row, (u, v) in enumerate((first, second)):
            bent = np.abs(u) * half[0] + np.abs(v) * half[1]
            for plane, derivative, weight, mean in zip(planes, derivatives, weights, ((xs, ys), (xt, yt)), strict=True):
                own = np.abs(u * (plane[0] - mean[0]) + v * (plane[1] - mean[1]))
                b[row] += (own + bent * np.abs(derivative[2] - weight)).max(axis=0)
                g[row] += bent * np.abs(weight)
        change = b.max(axis=0) + _weight_change(batch.screen[4], [derivative[3] for derivative in derivatives])
        tame = front & ((change <= TAME * (1.0 - g.max(axis=0))) | (change <= 1e-9))

    # the largest speed along each side, for any pixel
    speeds = [(*plane, *(half[:, None] * derivative[2])) for plane, derivative in zip(planes, derivatives, strict=True)]
    if len(space.halves) == 3:
        speeds.append(tuple(t - s for s, t in zip(*speeds, strict=True)))
    direction = np.argmax([sum(part * part for part in side).max(axis=0) for side in speeds], axis=0)
    return tame, direction, np.maximum(np.abs(first).sum(axis=0), np.abs(second).sum(axis=0))


def _weight_change(w: Floats, derivatives: list[Floats]) -> Floats:
    """(n,) what dividing by the weights w (count, n) of rational maps adds to the change of their Jacobians."""
    least = w.min(axis=0)
    total = 2.5 * sum(np.abs(derivative).max(axis=0) for derivative in derivatives) + 0.5 * (w.max(axis=0) - least)
    return np.asarray(total / least)
