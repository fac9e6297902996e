"""Planes across an axis, written as people say them: ``z=0.2``, and ``z`` through the middle of the data."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats
    from elvis.core.data.dataset import Dataset

#: function that gives the corners (2, 3) of the box of data, which only planes through the middle need
Corners: TypeAlias = "Callable[[], Floats]"

_AXES = {"x": "1,0,0", "y": "0,1,0", "z": "0,0,1"}
_PLANE = re.compile(r"\s*([xyz])\s*=\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?=:|$)")
_MIDDLE = re.compile(r"\s*([xyz])\s*(?=:|$)")
#: kinds of surfaces whose parts may be an axis
_KINDS = ("plane", "middle")


def box_of(dataset: Dataset) -> Floats:
    """(2, 3) lowest and highest coordinates of vertices and of points of curves.

    Fourier directions extend over their lengths.  For a part of data, this is the box of the part.
    """
    corners = dataset.mesh.corners.copy()
    for block in (block for field in dataset.fields for block in field.blocks):
        lengths = block.expansion.homogeneous.lengths if block.expansion.homogeneous else ()
        for axis, length in enumerate(lengths, 3 - len(lengths)):
            corners[1, axis] = max(corners[1, axis], corners[0, axis] + length)
    return corners


def is_across_axis(text: str) -> bool:
    """Whether a text, or its part before a colon, is ``z=0.2`` or ``z``."""
    return _PLANE.match(text) is not None or _MIDDLE.match(text) is not None


def point_and_normal(text: str, corners: Corners | None = None) -> str:
    """Text whose leading ``z=0.2`` is written as ``0,0,0.2:0,0,1``; other texts are unchanged.

    The part after a colon is unchanged.
    corners  of the box whose middle a leading ``z`` goes through; None leaves such texts unchanged
    """
    found = _PLANE.match(text)
    if found is not None:
        axis, place = found.groups()
    else:
        found = _MIDDLE.match(text) if corners is not None else None
        if found is None:
            return text
        assert corners is not None
        axis = found[1]
        place = repr(float(corners()[:, "xyz".index(axis)].mean()))
    point = ",".join(place if other == axis else "0" for other in _AXES)
    return f"{point}:{_AXES[axis]}{text[found.end() :]}"


def with_normals(text: str, corners: Corners | None = None) -> str:
    """Text of a surface or of seeds whose ``plane:z=0.2`` or ``plane:z`` is written with a point and a normal."""
    kind, colon, rest = text.partition(":")
    return f"plane:{point_and_normal(rest, corners)}" if colon and kind.strip() in _KINDS else text


def middle_axis(text: str) -> str:
    """The axis of a plane through the middle of the data, ``z``, ``plane:z`` or ``middle:z``; empty for other texts."""
    found = re.fullmatch(rf"\s*(?:(?:{'|'.join(_KINDS)})\s*:)?\s*([xyz])\s*", text)
    return found[1] if found else ""


def needs_box(text: str) -> bool:
    """Whether a plane goes through the middle of the data: ``z`` or ``plane:z``, also after ``outside:``."""
    return re.fullmatch(r"(?:.*:)?\s*[xyz]\s*", text) is not None
