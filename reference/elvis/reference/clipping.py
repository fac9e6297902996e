"""What clips take away, for reference and baseline."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from elvis.formats.arrays import Bools, Floats
from elvis.reference.surfaces import levels
from elvis.renderer.scene import Clip, Implicit

#: what is nearer to the surface of a clip than this part of the scene's size lies on it, and stays
_ON = 1e-11


def clipped(clips: Sequence[Clip], points: Floats, values: Callable[[str], Floats], size: float) -> Bools:
    """(n,) which of the world points (n, 3) lie where nothing is to be shown; those that aren't numbers don't.

    values  of an expression at the points, by its text
    size    of the scene in world units
    """
    gone = np.zeros(len(points), bool)
    for clip in clips:
        own = clip.surface
        outside = values(own.expression) if isinstance(own, Implicit) else levels(own, points)
        gone |= (-outside if clip.away == "inside" else outside) > _ON * size
    return gone
