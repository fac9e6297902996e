"""Depths of a picture in few bytes, from which a page shows it from another camera until a draft arrives."""

from __future__ import annotations

import zlib
from base64 import b64encode
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from elvis.scene.frame import Frame

#: pixels of the depths in each direction, at most
MAX_SIDE = 400
#: depths are stored as parts of their range, from 1; 0 stands for nothing
STEPS = 65534


def depths_of(frame: Frame) -> dict[str, Any]:
    """Depths at every n-th pixel: size, smallest and largest depth, and 16-bit parts of this range as base64."""
    height, width = frame.element.shape
    step = -(-max(height, width) // MAX_SIDE)
    depth = frame.depth[::step, ::step]
    seen = np.isfinite(depth) & frame.seen[::step, ::step]
    low, high = (float(depth[seen].min()), float(depth[seen].max())) if seen.any() else (0.0, 0.0)
    parts = np.zeros(depth.shape, "<u2")
    parts[seen] = 1 + np.rint(STEPS * (depth[seen] - low) / ((high - low) or 1.0))
    data = b64encode(zlib.compress(parts.tobytes(), 1)).decode()
    return {"size": [depth.shape[1], depth.shape[0]], "step": step, "low": low, "high": high, "data": data}
