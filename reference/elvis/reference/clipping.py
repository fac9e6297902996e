"""Points removed by clips, for reference and baseline."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.reference.surfaces import levels
from elvis.scene import Clip, Implicit

#: points nearer to the surface of a clip than this share of the scene's size, or of an expression's maximum, are on it
#: and stay
_ON = 1e-11


def is_clipped(clips: Sequence[Clip], points: Floats, values: Callable[[str], Floats], size: float) -> Bools:
    """(n,) whether each of the world points (n, 3) is removed by clips; NaN points are not.

    values  of an expression at the points, by its text
    size    of the scene in world units
    """
    return _is_taken_away(clips, points, values, size, 1.0)


def unsure(clips: Sequence[Clip], points: Floats, values: Callable[[str], Floats], size: float) -> Bools:
    """(n,) which of the points lie so near to where they would be taken away, or stay, that either may be so."""
    least, most = (_is_taken_away(clips, points, values, size, part) for part in (-2.0, 2.0))
    on = (
        _is_taken_away(clips, points, values, size, 0.01)
        if not any(isinstance(c.surface, Implicit) for c in clips)
        else least
    )
    return on & ~most


def _is_taken_away(
    clips: Sequence[Clip], points: Floats, values: Callable[[str], Floats], size: float, part: float
) -> Bools:
    """`is_clipped` with the tolerance for points on a surface multiplied by ``part``."""
    gone = np.zeros(len(points), bool)
    for clip in clips:
        own, scale = clip.surface, size
        outside = values(own.expression) if isinstance(own, Implicit) else levels(own, points)
        if isinstance(own, Implicit):
            scale = float(np.abs(outside).max(initial=0.0, where=np.isfinite(outside)))
        gone |= (-outside if clip.away == "inside" else outside) > part * _ON * scale
    return gone
