"""Which pixels balls, and all that lies between them, may be seen in."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.scene.cameras.view import View

#: pixels by which bounds are wider than they were computed
_ROOM = 1e-3


def bounds_of_balls(view: View, centres: Floats, radii: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Bounds in the picture of n hulls of k balls, with centres (n, k, 3) and radii (n, k).

    Minimum depth (n,); minimum and maximum x, y, x + y and x - y in pixels (n, 4); twice the maximum radius (n,).
    A ball of radius R about a point at depth z, t the tangent of its angle from the axis, is visible within
    R (1 + t^2)^(1/2) / (z - R) of the point's image at depth 1.  Parts behind the eye may be anywhere.
    """
    depth = view.depth_of(centres)
    near = (depth - radii).min(axis=1)
    step = float(np.linalg.norm(view.column))
    placed = view.projected(centres)
    with np.errstate(divide="ignore", invalid="ignore"):
        image = placed[..., :2] / placed[..., 2:]
        if view.perspective:
            across = np.linalg.norm(
                centres - np.asarray(view.camera.eye) - depth[..., None] * view.camera.basis()[2], axis=2
            )
            around = radii * np.sqrt(1.0 + (across / depth) ** 2) / (depth - radii) / step
        else:
            around = radii / step
    both = np.stack([image[..., 0], image[..., 1], image.sum(axis=2), image[..., 0] - image[..., 1]], axis=2)
    wide = around[..., None] * [1.0, 1.0, np.sqrt(2.0), np.sqrt(2.0)] + _ROOM
    low, high = (both - wide).min(axis=1), (both + wide).max(axis=1)
    if view.perspective:
        anywhere = ~(near > 0.0)
        low[anywhere], high[anywhere], around[anywhere] = -np.inf, np.inf, 1.0
        # hulls completely behind the eye are not visible
        hidden = (depth + radii).max(axis=1) <= 0.0
        low[hidden], high[hidden] = np.inf, -np.inf
    return near, low, high, 2.0 * around.max(axis=1)


def is_in_picture(view: View, low: Floats, high: Floats) -> Bools:
    """(n,) whether bounds (n, 4) overlap the picture."""
    seen: Bools = (high[:, :2] >= view.first).all(axis=1) & (low[:, :2] <= view.last).all(axis=1)
    return seen


def pixels_within(view: View, low: Floats, high: Floats) -> tuple[Ints, Ints]:
    """Minimum and maximum (n, 4) of the picture's pixels in bounds (n, 4)."""
    (left, top), (right, bottom) = view.first, view.last
    starts = np.array([left, top, left + top, left - bottom], np.float64)
    ends = np.array([right, bottom, right + bottom, right - top], np.float64)
    least = np.ceil(np.clip(low, starts, ends)).astype(np.int64)
    most = np.floor(np.clip(high, starts, ends)).astype(np.int64)
    return least, np.maximum(most, least)
