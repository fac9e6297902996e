"""Planes across an axis, written as people say them: ``z=0.2``."""

from __future__ import annotations

import re

_AXES = {"x": "1,0,0", "y": "0,1,0", "z": "0,0,1"}
_PLANE = re.compile(r"\s*([xyz])\s*=\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?=:|$)")


def point_and_normal(text: str) -> str:
    """``0,0,0.2:0,0,1`` in place of a ``z=0.2`` that the text begins with; other texts unchanged.

    What follows after a colon stays.
    """
    found = _PLANE.match(text)
    if found is None:
        return text
    axis, place = found.groups()
    point = ",".join(place if other == axis else "0" for other in _AXES)
    return f"{point}:{_AXES[axis]}{text[found.end() :]}"


def with_normals(text: str) -> str:
    """The text of a surface or of seeds with a point and a normal in place of the ``z=0.2`` of ``plane:z=0.2``."""
    kind, colon, rest = text.partition(":")
    return f"plane:{point_and_normal(rest)}" if colon and kind.strip() == "plane" else text
