"""Rays through boxes, and volumes of even density."""

import numpy as np

from elvis import Camera, Transfer

SIZE = (36, 30)
VIEWS = {
    "parallel": Camera((3.0, -4.0, 2.5), (0.5, 0.55, 0.55), height=1.9),
    "perspective": Camera((1.6, -1.1, 1.3), (0.5, 0.5, 0.5), fov=60.0),
}
WHITE = (1.0, 1.0, 1.0)
EVEN = Transfer((0.0,), (1.0,), (WHITE,))


def box_ends(view, low=(0.0, 0.0, 0.0), high=(1.0, 1.0, 1.0)):
    """(n,) depths at which rays enter and leave a box, and whether they meet it."""
    origins, ways = view.every_ray()
    with np.errstate(divide="ignore"):
        first, second = (np.array(low) - origins) / ways, (np.array(high) - origins) / ways
    enter, leave = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
    return enter, leave, leave > np.maximum(enter, 0)


def chord(view, **box):
    """(n,) length of rays in a box."""
    enter, leave, met = box_ends(view, **box)
    return np.where(met, (leave - np.maximum(enter, 0)) * np.linalg.norm(view.every_ray()[1], axis=1), 0.0)
