"""Lines of the domain over a picture, where nothing is seen in front of them."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.scene.cameras.view import View
from elvis.scene.figure.rulers import is_hidden, seen_of
from elvis.scene.record.strokes import Segments

#: width of the lines in pixels, and their colour
WIDTH = 1.2
GREY = (0.45, 0.45, 0.45)
#: pixels of a piece of a line, at most, and pieces of one line
PIECE, MAX_PIECES = 4.0, 4000


def domain_lines(view: View, depth: Floats, lines: Floats) -> Segments:
    """The visible pieces of lines (n, 2, 3) in the world.

    depth  (h, w) of the picture, infinite where nothing is visible
    """
    with np.errstate(invalid="ignore"):
        places = np.stack([seen_of(view, lines[:, end]) for end in (0, 1)], axis=1)
        low, high = places.min(axis=1), places.max(axis=1)
        is_near = (high > -PIECE).all(axis=1) & (low < [view.width + PIECE, view.height + PIECE]).all(axis=1)
    lines, places = lines[is_near], places[is_near]

    # pieces of equal length in the world; in the picture they are about as long
    length = np.linalg.norm(places[:, 1] - places[:, 0], axis=1)
    count = np.clip(np.ceil(length / PIECE), 1, MAX_PIECES).astype(np.int64)
    line = np.repeat(np.arange(len(lines)), count)
    number = np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)
    along = lines[:, 1] - lines[:, 0]
    starts, middles, ends = (
        lines[line, 0] + ((number + part) / count[line])[:, None] * along[line] for part in (0.0, 0.5, 1.0)
    )
    is_seen = ~is_hidden(view, depth, middles)
    starts, ends = starts[is_seen], ends[is_seen]
    depths = np.stack([view.depth_of(starts), view.depth_of(ends)], axis=1)
    return Segments(seen_of(view, starts), seen_of(view, ends), depths, WIDTH, GREY, 1.0)
