"""Pixels whose rays pass a triangle, or pass it within some pixels: candidates in object order, in double precision.

Embree would trace in single precision, and only the first hit; here all hits are requested, and none may be lost.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.scene.cameras.view import View
from elvis.scene.model.time_limit import check_time

#: pairs of a triangle and a pixel that are treated together
_AT_ONCE = 1 << 17
#: pixels by which all candidates are wider
_WIDER = 0.05


def on_screen(view: View, points: Floats) -> tuple[Floats, Bools]:
    """Columns and rows (…, 2) of world points (…, 3), and whether they lie in front of the eye."""
    homogeneous = view.projected(points)
    weight = homogeneous[..., 2:]
    least = 1e-12 * np.abs(homogeneous).max(initial=1.0)
    front = weight[..., 0] > least
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(homogeneous[..., :2] / weight), front


def pixels_near(view: View, corners: Floats, slack: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of a triangle (k,) and a pixel (k,): all pixels whose rays pass within ``slack`` (m,) of the triangles.

    corners  (m, 3, 3) world coordinates; the slack is a length in the world, to which a part of a pixel is added

    With u = column times weight, and v and w defined in the same way, the ray of the pixel (i, j) is u - i w = v - j w
    = 0.  The triangle's corners in these two coordinates are its image along the ray, even if some are behind the eye.
    A step of length 1 moves points in it by at most the norms of the coordinates' gradients.
    """
    linear = view.to_pixel[:, :3]
    homogeneous = view.projected(corners)
    reach = slack * np.linalg.norm(linear[2])
    least, most = homogeneous[..., 2].min(axis=1) - reach, homogeneous[..., 2].max(axis=1) + reach

    # distance on the screen for the slack, if all of the triangle is before the eye
    size = np.array([[view.whole.width], [view.whole.height]])
    steepest = np.linalg.norm(np.abs(linear[:2]) + size * np.abs(linear[2]))
    before = least > 1e-12 * np.abs(homogeneous).max(initial=1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        around = np.where(before, slack * steepest / least, np.inf) + _WIDER
        screen = homogeneous[..., :2] / homogeneous[..., 2:]
    low = np.where(before[:, None], screen.min(axis=1), -np.inf) - around[:, None]
    high = np.where(before[:, None], screen.max(axis=1), np.inf) + around[:, None]
    here = np.flatnonzero(most > 0)
    for number, pixel in pixels_between(view, low[here], high[here]):
        triangle = here[number]
        place = np.column_stack(view.places(pixel))
        along = homogeneous[triangle, :, :2] - place[:, None] * homogeneous[triangle, :, 2:]
        gradients = linear[:2] - place[..., None] * linear[2]
        radius = slack[triangle] * np.sqrt((gradients**2).sum(axis=(1, 2))) + _WIDER * np.maximum(most[triangle], 0.0)
        near = _holds_ray(along, radius)
        yield triangle[near], pixel[near]


def boxed(view: View, corners: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of a simplex (k,) and a pixel (k,): all pixels in the boxes around the pictures of corners (m, v, 3)."""
    screen, front = on_screen(view, corners)
    low, high = screen.min(axis=1), screen.max(axis=1)

    # a triangle partly behind the eye may be anywhere; one entirely behind it is nowhere
    reaches_behind = ~front.all(axis=1)
    low[reaches_behind] = -np.inf
    high[reaches_behind] = np.inf
    here = np.flatnonzero(front.any(axis=1))
    for simplex, pixel in pixels_between(view, low[here], high[here]):
        yield here[simplex], pixel


def pixels_between(view: View, low: Floats, high: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of a rectangle (k,) and a pixel (k,) in it: those between columns and rows (m, 2), whole or not."""
    # whole pixels of the picture from first to last; none if first is beyond last
    first = np.clip(np.ceil(np.nan_to_num(low)), view.first, view.last + 1).astype(np.int64)
    last = np.clip(np.floor(np.nan_to_num(high, nan=-1)), view.first - 1, view.last).astype(np.int64)
    sides = last - first + 1
    counts = np.maximum(sides, 0).prod(axis=1)

    # all pairs are numbered through, rectangle by rectangle and row by row
    ends = np.cumsum(counts)
    starts = ends - counts
    total = int(ends[-1]) if len(ends) else 0
    for start in range(0, total, _AT_ONCE):
        check_time()
        pair = np.arange(start, min(start + _AT_ONCE, total))
        own = np.searchsorted(ends, pair, side="right")
        down, across = np.divmod(pair - starts[own], sides[own, 0])
        yield own, view.numbers(first[own, 0] + across, first[own, 1] + down)


def among(table: Ints, numbers: Ints) -> Bools:
    """(n,) which numbers are in a sorted table."""
    place = np.searchsorted(table, numbers)
    is_within = place < len(table)
    entry = table[np.minimum(place, len(table) - 1)]
    return np.asarray(is_within & (entry == numbers))


def _holds_ray(corners: Floats, radius: Floats) -> Bools:
    """(k,) triangles (k, 3, 2) that the origin is in, or not farther than the radius (k,) outside of any side of."""
    near = np.ones(len(corners), bool)
    a, b, c = (corners[:, i] for i in range(3))
    for start, end, other in ((a, b, c), (b, c, a), (c, a, b)):
        # twice the area of the triangle and of that with the origin, of one sign where the origin is inside of the side
        side = end - start
        normal = np.column_stack([-side[:, 1], side[:, 0]])
        length = np.linalg.norm(side, axis=1)
        height = np.einsum("ni,ni->n", other - start, normal)
        inwards = -np.einsum("ni,ni->n", start, normal) * np.sign(height)
        is_outside = inwards < -radius * length
        is_flat = np.abs(height) < 1e-9 * length**2
        near &= ~is_outside | is_flat
    return near


def barycentric_gradients(corners: Floats) -> Floats:
    """(m, 4, 3) gradients of the barycentric coordinates in tetrahedra (m, 4, 3)."""
    # rows of the inverse of the matrix with the columns a, b and c, by cofactors
    a, b, c = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    determinant = np.einsum("mi,mi->m", a, cofactors[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        found = cofactors / determinant[:, None, None]

    # all four coordinates sum to one
    first = -found.sum(axis=1, keepdims=True)
    return np.concatenate([first, found], axis=1)
