"""Sides without area or length."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Bools, Floats, frozen_floats, numbered
from elvis.core.interfaces.crowded_sides import POINTS_AT_ONCE
from elvis.core.interfaces.side_groups import COLLAPSED, SideSet
from elvis.core.mapping.orientation import chunks


def are_collapsed(sides: SideSet) -> Bools:
    """(n,) whether sides have no area, or no length."""
    every = numbered(len(sides))
    greatest, sizes = np.zeros((2, len(sides)))
    extent = NOWHERE
    for part in chunks(len(sides), POINTS_AT_ONCE):
        which, points = sides.samples(every[part], 0)
        np.maximum.at(greatest[part], which, sides.factors(points, every[part][which]))
        box = sides.boxes(every[part])
        sizes[part] = np.linalg.norm(box[:, 3:] - box[:, :3], axis=1)
        extent = widened(extent, box)
    scale = float((extent[1] - extent[0]).max()) if len(sides) else 0.0
    flat = np.repeat([group.corners > 2 for group in sides.groups], [len(group) for group in sides.groups])
    return np.asarray((greatest <= COLLAPSED * np.where(flat, sizes**2, scale)) | (sizes <= COLLAPSED * scale))


#: the extent of no boxes
NOWHERE = frozen_floats(np.stack([np.full(3, np.inf), np.full(3, -np.inf)]))


def widened(extent: Floats, boxes: Floats) -> Floats:
    """(2, 3) smallest and largest coordinates of an extent (2, 3) and of boxes (n, 6)."""
    points = boxes.reshape(-1, 3)
    return np.stack([np.minimum(extent[0], points.min(axis=0)), np.maximum(extent[1], points.max(axis=0))])
