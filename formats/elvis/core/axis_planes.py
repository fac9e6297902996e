"""Planes across an axis, written as people say them: ``z=0.2``."""

from __future__ import annotations

import re

_AXES = {"x": "1,0,0", "y": "0,1,0", "z": "0,0,1"}
_PLANE = re.compile(r"\s*([xyz])\s*=\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?=:|$)")


def point_and_normal(text: str) -> str:
    """Text whose leading ``z=0.2`` is written as ``0,0,0.2:0,0,1``; other texts are unchanged.

    The part after a colon is unchanged.
    """
    found = _PLANE.match(text)
    if found is None:
        return text
    axis, place = found.groups()
    point = ",".join(place if other == axis else "0" for other in _AXES)
    return f"{point}:{_AXES[axis]}{text[found.end() :]}"


def with_normals(text: str) -> str:
    """Text of a surface or of seeds whose ``plane:z=0.2`` is written with a point and a normal."""
    kind, colon, rest = text.partition(":")
    return f"plane:{point_and_normal(rest)}" if colon and kind.strip() == "plane" else text
