"""Which pixels' rays pass a triangle, or pass it within some pixels: candidates in object order, in double precision.

Embree would trace in single precision, and only the first hit; here all hits are wanted, and none may be lost.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.scene.time_limit import check_time
from elvis.scene.view import View

#: pairs of a triangle and a pixel that are looked at together
_AT_ONCE = 1 << 17


def on_screen(view: View, points: Floats) -> tuple[Floats, Bools]:
    """Columns and rows (…, 2) of world points (…, 3), and whether they lie in front of the eye."""
    placed = view.projected(points)
    front = placed[..., 2] > 1e-12 * np.abs(placed).max(initial=1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(placed[..., :2] / placed[..., 2:]), front


def covered(view: View, corners: Floats, slack: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of a triangle (k,) and a pixel (k,): all pixels within ``slack`` (m,) pixels of the triangles' pictures.

    corners  (m, 3, 3) world coordinates.  Triangles that reach behind the eye may be anywhere.
    """
    screen, front = on_screen(view, corners)
    for triangle, pixel in boxed(view, corners, slack):
        row, column = np.divmod(pixel, view.width)
        near = _near(screen, front, slack, triangle, np.column_stack([column, row]))
        yield triangle[near], pixel[near]


def boxed(view: View, corners: Floats, slack: Floats | float = 0.0) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of a simplex (k,) and a pixel (k,): all pixels in the boxes around the pictures of corners (m, v, 3)."""
    screen, front = on_screen(view, corners)
    around = np.broadcast_to(np.asarray(slack, np.float64), len(corners))[:, None]
    low, high = screen.min(axis=1) - around, screen.max(axis=1) + around
    low[~front.all(axis=1)], high[~front.all(axis=1)] = -np.inf, np.inf
    here = np.flatnonzero(front.any(axis=1))
    for simplex, pixel in pixels_between(view, low[here], high[here]):
        yield here[simplex], pixel


def pixels_between(view: View, low: Floats, high: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of a rectangle (k,) and a pixel (k,) in it: those between columns and rows (m, 2), whole or not."""
    last = np.array([view.width, view.height]) - 1
    first = np.clip(np.ceil(np.nan_to_num(low)), 0, last + 1).astype(np.int64)
    sides = np.clip(np.floor(np.nan_to_num(high, nan=-1)), -1, last).astype(np.int64) - first + 1
    counts = np.maximum(sides, 0).prod(axis=1)
    ends = np.cumsum(counts)
    for start in range(0, int(ends[-1]) if len(ends) else 0, _AT_ONCE):
        check_time()
        pair = np.arange(start, min(start + _AT_ONCE, int(ends[-1])))
        own = np.searchsorted(ends, pair, side="right")
        place = pair - (ends - counts)[own]
        across = sides[own, 0]
        column, row = first[own, 0] + place % across, first[own, 1] + place // across
        yield own, row * view.width + column


def among(table: Ints, numbers: Ints) -> Bools:
    """(n,) which numbers are in a sorted table."""
    place = np.searchsorted(table, numbers)
    return np.asarray((place < len(table)) & (table[np.minimum(place, len(table) - 1)] == numbers))


def _near(screen: Floats, front: Bools, slack: Floats, triangle: Ints, pixel: Ints) -> Bools:
    """(k,) pixels that are not farther than the slack outside of any side of their triangle."""
    near = np.ones(len(triangle), bool)
    corners = screen[triangle]
    (a, b, c), whole = (corners[:, i] for i in range(3)), front[triangle].all(axis=1)
    for start, end, other in ((a, b, c), (b, c, a), (c, a, b)):
        side = end - start
        normal = np.column_stack([-side[:, 1], side[:, 0]])
        length = np.linalg.norm(side, axis=1)
        height = np.einsum("ni,ni->n", other - start, normal)
        inwards = np.einsum("ni,ni->n", pixel - start, normal) * np.sign(height)
        near &= ~(inwards < -slack[triangle] * length) | (np.abs(height) < 1e-9 * length**2) | ~whole
    return near


def barycentric_gradients(corners: Floats) -> Floats:
    """(m, 4, 3) gradients of the barycentric coordinates in tetrahedra (m, 4, 3)."""
    a, b, c = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = rows / np.einsum("mi,mi->m", a, rows[:, 0])[:, None, None]
    return np.concatenate([-found.sum(axis=1, keepdims=True), found], axis=1)
