"""Faces cut into patches whose projected maps are nearly linear, so that a pixel's ray meets each of them once at most.

Screen nets (5, count, n) hold homogeneous control points of the projected maps: column, row and weight as by
View.to_pixel, depth times w, and w.  NumPy goes quickly along long axes alone, so patches are the last axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.mapping.orientation import chunks
from elvis.plugins.faces.nets import FaceSpace
from elvis.scene.time_limit import check_time
from elvis.scene.view import View

#: greatest relative change b of a tame map's Jacobian J: from any point to any other J^-1 J' - 1 is 2 b / (1 - b) = 2/3
TAME = 0.25
#: pixels below which a patch counts as a point, or as a line where it is that thin, unless rounding leaves more open
THIN = 1e-6
#: how often a face is halved at most
_LEVELS = 96
#: columns of pixels up to which thin patches are looked at closely
_COLUMNS = 8
#: patches worked on at once
_CHUNK = 1 << 14


@dataclass(frozen=True, eq=False)
class FacePatches:
    """Patches of faces as a view sees them.

    face    (n,)       number of the face
    place   (n, 3, 2)  origin and axes of the patch in face coordinates
    bounds  (2, n, 4)  least and greatest x, y, x + y and x - y of the pixels (x, y) that it may cover
    near    (n,)       no point of it has a smaller depth
    noise   (n,)       what rounding leaves undecided, in coordinates of the patch
    """

    face: Ints
    place: Floats
    bounds: Ints
    near: Floats
    noise: Floats


@dataclass(frozen=True, eq=False)
class Edges:
    """Patches that are seen as points or lines: folds of faces, and faces that are seen edge-on.

    ends    (2, n, 2)  in pixels
    depth   (2, n)     least and greatest
    radius  (n,)       pixels within which a ray may meet the patch though it seems to pass the line between the ends
    """

    ends: Floats
    depth: Floats
    radius: Floats


def face_patches(space: FaceSpace, nets: Floats, view: View) -> tuple[FacePatches, Edges]:
    """Everything of faces with ``nets`` (n, count, 4) that may cover the centre of a pixel of the view."""
    forward = np.append(view.camera.basis()[2], view.depth_of(np.zeros(3)))
    rows = np.concatenate([view.to_pixel, forward[None], [[0.0, 0.0, 0.0, 1.0]]])
    rounding = _rounding(nets, view)
    found = [_Batch.of(space, np.arange(0), np.empty((5, space.count, 0)))]
    for some in chunks(len(nets), _CHUNK):
        number = np.arange(len(nets))[some]
        for batch in _divide(space, _Batch.of(space, number, np.tensordot(rows, nets[some].T, 1)), view, rounding):
            found.append(batch)
            check_time()
    face, place, screen, pixels, line, spread = (
        np.concatenate(parts, axis=-1) for parts in zip(*map(_Batch.parts, found), strict=True)
    )
    depth = screen[3] / screen[4]
    noise = rounding * spread[~line]
    bounds, near = pixels[..., ~line].transpose(0, 2, 1), depth.min(axis=0)
    patches = FacePatches(face[~line], np.moveaxis(place[..., ~line], -1, 0), bounds, near[~line], noise)

    weight, between = screen[2][:, line], np.stack([near[line], depth[:, line].max(axis=0)])
    slack = _slack(weight, rounding, view)
    ends, width = _ends(screen[:2, :, line] / weight, slack)
    return patches, Edges(ends.transpose(0, 2, 1), between, width + 3.0 * slack)


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
        place = np.repeat(np.vstack([np.zeros(2), np.eye(2)])[..., None], count, axis=-1)
        return _Batch(face, place, screen, np.zeros((2, 4, count), np.int64), np.zeros(count, bool), np.zeros(count))

    def parts(self) -> tuple[Any, ...]:
        """All arrays; patches are the last axis of each."""
        return self.face, self.place, self.screen, self.pixels, self.line, self.spread

    def some(self, which: Ints) -> _Batch:
        """The patches with these numbers."""
        return _Batch(*(part.take(which, axis=-1) for part in self.parts()))


def _rounding(nets: Floats, view: View) -> float:
    """Error of X - i W and Y - j W that rounding makes."""
    size = np.append(np.abs(nets[..., :3] / nets[..., 3:]).max(axis=(0, 1), initial=0.0), 1.0)
    across, down, weight = np.abs(view.to_pixel) @ size
    return float(16 * np.finfo(float).eps * (max(across, down) + max(view.width, view.height) * weight))


def _slack(weight: Floats, rounding: float, view: View) -> Floats:
    """(n,) pixels below which rounding leaves no shape to patches in front of the eye, that have weights (count, n).

    So a patch that rounding may move onto a pixel's centre is kept, and no patch is halved into noise.
    """
    with np.errstate(divide="ignore", over="ignore"):
        own = rounding / weight.min(axis=0, initial=np.inf)
    return np.asarray(own.clip(THIN, _extent(view)))


def _extent(view: View) -> float:
    """Pixels beyond which all is as far away, and more than from one side of the picture to another."""
    return 2.0 * (view.width + view.height)


def _divide(space: FaceSpace, batch: _Batch, view: View, rounding: float) -> Iterator[_Batch]:
    """Patches that are tame, and those that are points or lines.

    What is neither is halved where it looks longest, unless it covers no centre.
    rounding  see _rounding
    """
    stack = [(0, batch)]
    while stack:
        level, batch = stack.pop()
        batch, front = _seen(batch, view, rounding)
        tame, direction, batch.spread = _linearity(space, batch, front, view)
        done = front & (tame | batch.line | (level == _LEVELS))
        batch.line |= ~tame
        yield batch.some(np.flatnonzero(done))
        if level < _LEVELS and not done.all():
            halves = _halve(space, direction[~done], batch.some(np.flatnonzero(~done)))
            stack += [
                (level + 1, halves.some(np.arange(len(halves.face))[k])) for k in chunks(len(halves.face), _CHUNK)
            ]


def _halve(space: FaceSpace, direction: Ints, batch: _Batch) -> _Batch:
    """Two patches for each, cut in this direction."""
    batch = batch.some(order := np.argsort(direction, kind="stable"))
    ends = np.searchsorted(direction[order], np.arange(len(space.halves) + 1))
    halves = _Batch(*(np.concatenate([part, part], axis=-1) for part in batch.parts()))
    for cut in range(len(space.halves)):
        for half in range(2):
            own, new = slice(ends[cut], ends[cut + 1]), slice(*(ends[cut : cut + 2] + half * len(direction)))
            halves.screen[..., new] = space.cuts[cut, half] @ batch.screen[..., own]
            halves.place[..., new] = np.tensordot(space.halves[cut, half], batch.place[1:, :, own], 1)
            halves.place[0, :, new] += batch.place[0, :, own]
    return halves


def _seen(batch: _Batch, view: View, rounding: float) -> tuple[_Batch, Bools]:
    """The patches that may cover the centre of a pixel, and (n,) whether they are in front of the eye.

    Not those beyond a side of the picture or behind the eye.  Of those in front pixels and thinness are noted.
    """
    (x, y, w, depth), size = batch.screen[:4], np.array([view.width - 1.0, view.height - 1.0])
    seen = np.isfinite(batch.screen).all(axis=(0, 1)) & (depth.max(axis=0) > 0.0)
    beside = np.maximum(THIN * w, rounding)
    for side, far in zip((x, y), size, strict=True):
        seen &= ((side + beside).max(axis=0) > 0.0) & ((far * w + beside - side).max(axis=0) > 0.0)
    batch = batch.some(np.flatnonzero(seen))

    # what rounding can't tell from the eye itself may be anywhere: a point in the middle, of the weight that says so
    least = rounding / _extent(view)
    at_eye = batch.screen[2].max(axis=0) <= least
    batch.screen[:3, :, at_eye] = least * np.append(0.5 * size, 1.0)[:, None, None]
    front = batch.screen[2].min(axis=0) > 0.0
    weight = batch.screen[2].compress(front, axis=-1)
    flat, slack = batch.screen[:2].compress(front, axis=-1) / weight, _slack(weight, rounding, view)
    batch.pixels[..., front] = pixels = _pixels(flat, slack, view)
    ends, width = _ends(flat, slack)
    batch.line[:] = False
    batch.line[front] = width < slack
    kept = ~front
    kept[front] = (pixels[1] >= pixels[0]).all(axis=0) & _may_hold(flat, ends, width, slack)
    return batch.some(np.flatnonzero(kept)), front[kept]


def _may_hold(points: Floats, ends: Floats, width: Floats, slack: Floats) -> Bools:
    """(n,) whether hulls (2, count, n) may hold the centre of a pixel: thin ones hold few, however long they are.

    ends, width  see _ends
    slack        (n,) pixels within which the hulls are known
    """
    steep = np.abs(ends[1] - ends[0])[1] > np.abs(ends[1] - ends[0])[0]
    turned = np.where(steep, points[1], points[0])
    (x0, x1), (y0, y1) = np.where(steep, ends[:, 1], ends[:, 0]), np.where(steep, ends[:, 0], ends[:, 1])

    # the columns that they reach over, rows where they are steep
    first, last = np.ceil(turned.min(axis=0) - slack), np.floor(turned.max(axis=0) + slack)
    derivative = np.divide(y1 - y0, x1 - x0, out=np.zeros_like(x0), where=x1 != x0)
    x = first + np.arange(_COLUMNS)[:, None]
    y = y0 + derivative * (x - x0)
    held = (np.abs(y - np.rint(y)) <= 1.5 * width + 2 * slack) & (x <= last)
    return np.asarray(held.any(axis=0) | (last - first >= _COLUMNS))


def _pixels(points: Floats, slack: Floats, view: View) -> Ints:
    """(2, 4, n) least and greatest x, y, x + y and x - y of the pixels of the view that hulls (2, count, n) may cover.

    None where the least ones exceed the greatest.
    """
    extent, (x, y) = _extent(view), points
    every = (x, y, x + y, x - y)
    least = np.stack([side.min(axis=0) for side in every]).clip(-extent, extent)
    most = np.stack([side.max(axis=0) for side in every]).clip(-extent, extent)
    least, most = np.ceil(least - slack), np.floor(most + slack)
    least[:2] = least[:2].clip(0.0, None)
    most[:2] = most[:2].clip(None, [[view.width - 1.0], [view.height - 1.0]])
    return np.stack([least, most]).astype(np.int64)


def _ends(points: Floats, slack: Floats) -> tuple[Floats, Floats]:
    """(2, 2, n) two points of each hull (2, count, n) far apart, and (n,) how far others lie from the line between.

    slack  (n,) hulls no longer than this are points
    """
    x, y = points - points[:, :1]
    number, every = (x * x + y * y).argmax(axis=0), np.arange(points.shape[2])
    far_x, far_y = x[number, every], y[number, every]
    length, across = np.hypot(far_x, far_y), np.abs(x * far_y - y * far_x).max(axis=0)
    width = np.divide(across, length, out=np.zeros_like(across), where=length > slack)
    return np.stack([points[:, 0], points[:, number, every]]), width


def _linearity(space: FaceSpace, batch: _Batch, front: Bools, view: View) -> tuple[Bools, Ints, Floats]:
    """(n,) whether X - i W and Y - j W change nearly linearly, where patches look longest, and their spread:

    how far roots move in the patch where X - i W and Y - j W change by 1, to first order.
    All pixels (i, j) within the bounds of a patch are meant.  With the matrix M that inverts the mean Jacobian for the
    middle pixel, b is the greatest row sum of M J - 1, which the derivatives' nets bound, and g what other pixels add.
    """
    size = np.array([[view.width - 1.0], [view.height - 1.0]])
    low, high = np.where(front, batch.pixels[:, :2], np.stack([0.0 * size, size]))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    derivatives = [matrix @ batch.screen[[0, 1, 2, 4]] for matrix in space.derivatives]
    planes = [derivative[:2] - middle[:, None] * derivative[2] for derivative in derivatives]
    (xs, ys), (xt, yt) = (plane.mean(axis=1) for plane in planes)
    weights = [derivative[2].mean(axis=0) for derivative in derivatives]

    with np.errstate(all="ignore"):
        # M, times vectors; the sums of what it makes of all changes
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

    # the greatest speed along each side, for any pixel
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
