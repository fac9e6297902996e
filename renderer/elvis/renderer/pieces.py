"""Faces cut into pieces whose projected maps are nearly linear, so that a pixel's ray meets each of them once at most.

Screen nets (n, count, 5) hold homogeneous control points of the projected maps: column, row and weight as by
View.to_pixel, depth times w, and w.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Bools, Floats, Ints
from elvis.formats.mapping.orientation import chunks
from elvis.plugins.faces.nets import FaceSpace
from elvis.renderer.view import View

#: greatest relative change b of a tame map's Jacobian J: from any point to any other J^-1 J' - 1 is 2 b / (1 - b) = 1/2
TAME = 0.2
#: pixels below which a piece counts as a point, or as a line where it is that thin
THIN = 1e-6
#: how often a face is halved at most
_LEVELS = 96
#: columns of pixels up to which thin pieces are looked at closely
_COLUMNS = 8
#: pieces worked on at once
_CHUNK = 1 << 14


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of faces as a view sees them.

    face    (n,)       number of the face
    place   (n, 3, 2)  origin and axes of the piece in face coordinates
    bounds  (2, n, 4)  least and greatest x, y, x + y and x - y of the pixels (x, y) that it may cover
    near    (n,)       no point of it has a smaller depth
    noise   (n,)       what rounding leaves undecided, in coordinates of the piece
    """

    face: Ints
    place: Floats
    bounds: Ints
    near: Floats
    noise: Floats


@dataclass(frozen=True, eq=False)
class Edges:
    """Pieces that are seen as points or lines: folds of faces, and faces that are seen edge-on.

    ends   (2, n, 2)  in pixels
    depth  (2, n)     least and greatest
    """

    ends: Floats
    depth: Floats


def pieces_of(space: FaceSpace, nets: Floats, view: View) -> tuple[Pieces, Edges]:
    """Everything of faces with ``nets`` (n, count, 4) that may cover the centre of a pixel of the view."""
    forward = np.append(view.camera.basis()[2], view.depth_of(np.zeros(3)))
    rows = np.concatenate([view.to_pixel, forward[None], [[0.0, 0.0, 0.0, 1.0]]])
    found = [_none(space)]
    for start in range(0, len(nets), _CHUNK):
        some = nets[start : start + _CHUNK]
        found += _divided(space, some @ rows.T, start + np.arange(len(some)), view)
    face, place, screen, tame, spread = (np.concatenate(parts) for parts in zip(*found, strict=True))
    depth, line = screen[..., 3] / screen[..., 4], ~tame
    bounds, noise = _pixels(_bounds(screen[tame]), view), _rounding(nets, view) * spread[tame]
    pieces = Pieces(face[tame], place[tame], bounds, depth[tame].min(axis=1), noise)
    return pieces, Edges(_ends(_flat(screen[line]))[0], np.stack([depth[line].min(axis=1), depth[line].max(axis=1)]))


_Batch: TypeAlias = tuple[Ints, Floats, Floats, Bools, Floats]


def _none(space: FaceSpace) -> _Batch:
    return np.empty(0, np.int64), np.empty((0, 3, 2)), np.empty((0, space.count, 5)), np.empty(0, bool), np.empty(0)


def _rounding(nets: Floats, view: View) -> float:
    """Error of X - i W and Y - j W that rounding makes."""
    size = np.append(np.abs(nets[..., :3] / nets[..., 3:]).max(axis=(0, 1), initial=0.0), 1.0)
    across, down, weight = np.abs(view.to_pixel) @ size
    return float(16 * np.finfo(float).eps * (max(across, down) + max(view.width, view.height) * weight))


def _divided(space: FaceSpace, screen: Floats, face: Ints, view: View) -> Iterator[_Batch]:
    """Numbers, places and screen nets of pieces, whether they are tame, and their spread (see _examined).

    The others are points or lines; what is neither is halved where it looks longest, unless it covers no centre.
    """
    stack = [(0, face, np.tile(np.vstack([np.zeros(2), np.eye(2)]), (len(face), 1, 1)), screen)]
    while stack:
        level, face, place, screen = stack.pop()
        seen = _seen(screen, view)
        face, place, screen = face[seen], place[seen], screen[seen]
        front, last = _least(screen[..., 2]) > 0.0, level == _LEVELS
        thin = np.zeros(len(face), bool)
        thin[front] = _ends(_flat(screen[front]))[1] < THIN
        tame, way, spread = _examined(space, screen, front, view)
        done = front & (tame | thin | last)
        yield face[done], place[done], screen[done], (tame & ~thin)[done], spread[done]
        if not (last or done.all()):
            face, place, screen = _halved(space, way[~done], face[~done], place[~done], screen[~done])
            stack += [(level + 1, face[k], place[k], screen[k]) for k in chunks(len(face), _CHUNK)]


def _halved(space: FaceSpace, way: Ints, face: Ints, place: Floats, screen: Floats) -> tuple[Ints, Floats, Floats]:
    """Two pieces for each, cut the way that it says."""
    places, cuts = space.halves[way] @ place[:, None, 1:], space.cuts[way] @ screen[:, None]
    places[:, :, 0] += place[:, None, 0]
    return np.repeat(face, 2), places.reshape(-1, 3, 2), cuts.reshape(-1, *screen.shape[1:])


def _seen(screen: Floats, view: View) -> Bools:
    """(n,) whether pieces may cover the centre of a pixel: not those beyond a side of the picture or behind the eye."""
    x, y, w = screen[..., 0], screen[..., 1], screen[..., 2]
    sides = (
        x + THIN * w,
        (view.width - 1 + THIN) * w - x,
        y + THIN * w,
        (view.height - 1 + THIN) * w - y,
        screen[..., 3],
    )
    seen = np.isfinite(_most(_most(np.abs(screen), 2), 1))
    for side in sides:
        seen &= _most(side) > 0.0
    front = np.flatnonzero(seen & (_least(w) > 0.0))
    least, most = _pixels(_bounds(screen[front]), view)
    seen[front] = _least(most - least) >= 0
    front = front[seen[front]]
    seen[front] = _may_hold(_flat(screen[front]))
    return np.asarray(seen)


def _may_hold(points: Floats) -> Bools:
    """(n,) whether hulls (n, count, 2) may hold the centre of a pixel: thin ones hold few, however long they are."""
    (start, end), width = _ends(points)
    steep = np.abs(end - start)[:, 1] > np.abs(end - start)[:, 0]
    turned = np.where(steep[:, None, None], points[..., ::-1], points)[..., 0]
    (x0, y0), (x1, y1) = (np.where(steep[:, None], some[:, ::-1], some).T for some in (start, end))

    # the columns that they reach over, rows where they are steep
    first, last = np.ceil(_least(turned) - THIN), np.floor(_most(turned) + THIN)
    x = first[:, None] + np.arange(_COLUMNS)
    slope = np.divide(y1 - y0, x1 - x0, out=np.zeros_like(x0), where=x1 != x0)
    y = y0[:, None] + slope[:, None] * (x - x0[:, None])
    held = (np.abs(y - np.rint(y)) <= 1.5 * width[:, None] + 2 * THIN) & (x <= last[:, None])
    return np.asarray(_most(held) | (last - first >= _COLUMNS))


def _flat(screen: Floats) -> Floats:
    """(n, count, 2) control points in pixels, of pieces in front of the eye."""
    return np.asarray(screen[..., :2] / screen[..., 2:3])


def _bounds(screen: Floats) -> Floats:
    """(2, n, 4) least and greatest x, y, x + y and x - y of pieces in front of the eye."""
    x, y = np.moveaxis(_flat(screen), -1, 0)
    every = np.stack([x, y, x + y, x - y], axis=-1)
    return np.stack([_least(every), _most(every)])


def _pixels(bounds: Floats, view: View) -> Ints:
    """(2, n, 4) the pixels of the view within bounds, none where the least ones exceed the greatest."""
    reach = 2.0 * (view.width + view.height)
    pixels = np.stack([np.ceil(bounds[0].clip(-reach, reach) - THIN), np.floor(bounds[1].clip(-reach, reach) + THIN)])
    pixels[0, :, :2] = pixels[0, :, :2].clip(0.0, None)
    pixels[1, :, :2] = pixels[1, :, :2].clip(None, [view.width - 1, view.height - 1])
    return pixels.astype(np.int64)


def _ends(points: Floats) -> tuple[Floats, Floats]:
    """(2, n, 2) two points of each hull (n, count, 2) far apart, and (n,) how far others lie from the line between."""
    offsets = points - points[:, :1]
    farthest = np.take_along_axis(
        offsets, (offsets[..., 0] ** 2 + offsets[..., 1] ** 2).argmax(axis=1)[:, None, None], axis=1
    )
    length = np.hypot(*farthest[:, 0].T)
    across = _most(np.abs(offsets[..., 0] * farthest[..., 1] - offsets[..., 1] * farthest[..., 0]))
    width = np.divide(across, length, out=np.zeros_like(across), where=length > THIN)
    return np.stack([points[:, 0], points[:, 0] + farthest[:, 0]]), width


def _examined(space: FaceSpace, screen: Floats, front: Bools, view: View) -> tuple[Bools, Ints, Floats]:
    """(n,) whether X - i W and Y - j W change nearly linearly, which way the pieces look longest, and their spread:

    how far roots move in the piece where X - i W and Y - j W change by 1, to first order.
    All pixels (i, j) within the bounds of a piece are meant.  With the matrix M that inverts the mean Jacobian for the
    middle pixel, b is the greatest row sum of M J - 1, which the derivatives' nets bound, and g what other pixels add.
    """
    size = np.array([view.width - 1.0, view.height - 1.0])
    low, high = np.zeros((len(screen), 2)), np.tile(size, (len(screen), 1))
    low[front], high[front] = _bounds(screen[front])[..., :2].clip(0.0, size)
    middle, half = 0.5 * (low + high)[:, None], 0.5 * (high - low)[:, None]
    slopes = np.stack([matrix @ screen[..., [0, 1, 2, 4]] for matrix in space.slopes])
    plane = slopes[..., :2] - middle * slopes[..., 2:3]
    mean, weight = _mean(plane), _mean(slopes[..., 2:3])

    with np.errstate(all="ignore"):
        # M, and the row sums of what it makes of all changes
        (xs, ys), (xt, yt) = np.moveaxis(mean, -1, 1)
        inverse = np.stack([np.stack([yt, -ys], -1), np.stack([-xt, xs], -1)], 1) / (xs * yt - xt * ys)[:, None, None]
        own = np.abs((plane - mean[:, :, None]) @ inverse)
        other = half * np.abs(slopes[..., 2:3] - weight[:, :, None]) @ np.abs(inverse)
        b = _most(_most(own + other, 2).sum(axis=0))
        g = (half[:, 0] * np.abs(weight))[:, :, None] @ np.abs(inverse)
        b += _weighted(screen[..., 4], slopes[..., 3])
        tame = front & ((b <= TAME * (1.0 - _most(g.sum(axis=(0, 2))))) | (b <= 1e-9))

    # the greatest speed along each side, for any pixel
    speeds = np.concatenate([plane, half * slopes[..., 2:3]], axis=-1)
    sides = [*speeds, speeds[1] - speeds[0]] if len(space.halves) == 3 else [*speeds]
    way = np.argmax([_most(sum(np.moveaxis(np.square(side), 2, 0))) for side in sides], axis=0)
    return tame, way, _most(np.abs(inverse).sum(axis=1))


def _weighted(w: Floats, slopes: Floats) -> Floats:
    """(n,) what dividing by the weights w (n, count) of rational maps adds to the change of their Jacobians."""
    least = _least(w)
    total = 2.5 * _most(np.abs(slopes), 2).sum(axis=0) + 0.5 * (_most(w) - least)
    return np.asarray(total / least)


# NumPy goes slowly along short axes: these go along the long ones.


def _most(values: NDArray[Any], axis: int = 1) -> NDArray[Any]:
    """The greatest along an axis."""
    return np.asarray(reduce(np.maximum, np.moveaxis(values, axis, 0)))


def _least(values: NDArray[Any], axis: int = 1) -> NDArray[Any]:
    """The least along an axis."""
    return np.asarray(reduce(np.minimum, np.moveaxis(values, axis, 0)))


def _mean(values: Floats) -> Floats:
    """The mean along the third axis."""
    return np.asarray(reduce(np.add, np.moveaxis(values, 2, 0)) / values.shape[2])
