"""Depths and lines of a picture in few bytes, from which a page shows it from another camera until a draft arrives."""

from __future__ import annotations

import zlib
from base64 import b64encode
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from elvis.core.base.arrays import Floats
    from elvis.scene.record.frame import Frame
    from elvis.scene.record.strokes import Segments

#: pixels of the depths of a sharp picture in each direction, at most
MAX_SIDE = 400
#: the same of drafts, which move little, and of lean ones
MAX_SIDE_OF_DRAFTS = 240
MAX_SIDE_OF_LEAN_DRAFTS = 120
#: depths are stored as parts of their range, from 1; 0 stands for nothing
STEPS = 65534
#: positions of lines are stored in these parts of a pixel; pixels around the picture that lines may reach
PARTS_OF_PIXEL, MARGIN = 16, 16
Table = dict[str, Any]


def depths_of(frame: Frame) -> Table:
    """Depths at every n-th pixel: size, smallest and largest depth, and 16-bit parts of this range as base64.

    Lines of the domain follow in the form of `motion_of`, with the colours of the pixels below them.
    """
    facts, parts = _parts_of(_finite_depth(frame), MAX_SIDE, [] if frame.domain is None else [frame.domain])
    found = {**facts, "data": _packed(parts)}
    if frame.domain is None or frame.scene.is_clear:
        return found
    numbers, colors = frame.below_domain
    below = {"numbers": _packed(numbers.astype("<u4").view("<u2")), "colors": _packed(colors.astype("<u2"))}
    return {**found, **_facts_of_lines([frame.domain]), **below, "ends": _packed(_numbers_of(frame.domain, facts))}


def _packed(numbers: NDArray[np.uint16]) -> str:
    """16-bit numbers as compressed base64."""
    return b64encode(zlib.compress(numbers.astype("<u2").tobytes(), 1)).decode()


def motion_of(frame: Frame, is_lean: bool = False) -> tuple[Table, bytes]:
    """Facts and compressed 16-bit numbers, with which a page moves a draft and draws its lines.

    The numbers are the depths, as differences along rows; each line style adds six rows: columns, rows and depths of
    starts, then the differences to the ends.  A style with more lines than pixels is left out: it covers a surface, as
    the contour of an isosurface's own value does.
    """
    depth = _finite_depth(frame)
    lines = [] if frame.drawing is None else [own for own in frame.drawing.segments if len(own.starts) <= depth.size]
    facts, parts = _parts_of(depth, MAX_SIDE_OF_LEAN_DRAFTS if is_lean else MAX_SIDE_OF_DRAFTS, lines)
    numbers = [np.diff(parts, axis=1, prepend=np.uint16(0)), *(_numbers_of(own, facts) for own in lines)]
    return {**facts, **_facts_of_lines(lines)}, zlib.compress(
        b"".join(own.astype("<u2").tobytes() for own in numbers), 1
    )


def _facts_of_lines(lines: Sequence[Segments]) -> Table:
    """Styles and numbers of lines, and how their positions are stored."""
    styles = [
        {"count": len(own.starts), "width": own.width, "color": list(own.color), "opacity": own.opacity}
        for own in lines
    ]
    return {"parts_of_pixel": PARTS_OF_PIXEL, "margin": MARGIN, "lines": styles}


def _finite_depth(frame: Frame) -> Floats:
    """Depths (h, w) of a picture, infinite where nothing is visible."""
    return np.where(np.isfinite(frame.depth), frame.depth, np.inf)


def _parts_of(depth: Floats, side: int, lines: Sequence[Segments]) -> tuple[Table, NDArray[np.uint16]]:
    """Size, step between pixels, smallest and largest depth, also of lines; depths (h, w) as parts of this range."""
    step = -(-max(depth.shape) // side)
    depth = depth[::step, ::step]
    seen = np.isfinite(depth)
    known = np.concatenate([depth[seen], *(own.depths.ravel() for own in lines)])
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    parts = np.zeros(depth.shape, "<u2")
    parts[seen] = _scaled(depth[seen], low, high)
    return {"size": [depth.shape[1], depth.shape[0]], "step": step, "low": low, "high": high}, parts


def _scaled(depth: Floats, low: float, high: float) -> Floats:
    """Parts of a range of depths, from 1."""
    return np.asarray(1 + np.rint(STEPS * (np.clip(depth, low, high) - low) / ((high - low) or 1.0)))


def _numbers_of(lines: Segments, facts: Table) -> NDArray[np.uint16]:
    """Six rows of numbers (6, n) of lines, in an order in which they compress well."""
    places = np.concatenate([lines.starts, lines.ends], axis=1)
    limit = np.iinfo(np.uint16).max
    places = np.clip(np.rint(PARTS_OF_PIXEL * (places + MARGIN)), 0, limit).astype(np.uint16)
    order = np.lexsort(places.T)
    depths = _scaled(lines.depths[order], facts["low"], facts["high"]).astype(np.uint16)
    starts = np.concatenate([places[order, :2], depths[:, :1]], axis=1)
    ends = np.concatenate([places[order, 2:], depths[:, 1:]], axis=1)
    return np.concatenate([starts, ends - starts], axis=1).T
