"""Planes, spheres and cylinders, given as text, as expressions that are zero on them and negative inside."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.axis_planes import Corners, with_normals
from elvis.core.quantities.tree import Node, call, coordinate, number


def quadric(name: str, corners: Corners | None = None) -> Node | None:
    """The expression that is zero on ``KIND:PARTS``, one of `_KINDS`.

    corners  of the box whose middle ``plane:z`` goes through
    None for other kinds; raises ElvisError for invalid parts.

    A plane gives the height above it, for any length of its normal; a sphere or cylinder gives the squared distance
    from the centre or axis, minus the squared radius.
    """
    kind, colon, rest = with_normals(name, corners).partition(":")
    # without a colon it may be the name of a boundary
    if not colon or kind not in _KINDS:
        return None
    form, example, build = _KINDS[kind]
    try:
        parts = [np.array([float(value) for value in part.split(",")]) for part in rest.split(":")]
        if len(parts) != form.count(":") or not all(np.isfinite(part).all() for part in parts):
            raise ValueError
        return build(parts)
    except ValueError:
        raise ElvisError(f"expected {form}, such as {example}, found {name!r}") from None


def _plane(parts: Sequence[Floats]) -> Node:
    point, normal = _vector(parts[0]), _direction(parts[1])
    return _along(point, normal)


def _sphere(parts: Sequence[Floats]) -> Node:
    centre, radius = _vector(parts[0]), _radius(parts[1])
    return call("-", _square_from(centre), number(radius**2))


def _cylinder(parts: Sequence[Floats]) -> Node:
    point, axis, radius = _vector(parts[0]), _direction(parts[1]), _radius(parts[2])
    along = _along(point, axis)
    return call("-", call("-", _square_from(point), call("*", along, along)), number(radius**2))


def _along(point: Floats, direction: Floats) -> Node:
    """Distances of places from a point along a unit vector."""
    total = number(-float(np.dot(point, direction)))
    for axis, part in enumerate(direction.tolist()):
        total = call("+", total, call("*", number(part), coordinate(axis)))
    return total


def _square_from(point: Floats) -> Node:
    """The squared distance from a point."""
    total = number(0.0)
    for axis, place in enumerate(point.tolist()):
        away = call("-", coordinate(axis), number(place))
        total = call("+", total, call("*", away, away))
    return total


def _vector(part: Floats) -> Floats:
    """(3,) from two or three numbers, ValueError from others."""
    if len(part) not in (2, 3):
        raise ValueError
    return np.append(part, 0.0)[:3]


def _direction(part: Floats) -> Floats:
    """(3,) of unit length; ValueError without a length."""
    vector = _vector(part)
    size = float(np.linalg.norm(vector))
    if not 0 < size < np.inf:
        raise ValueError
    return np.asarray(vector / size)


def _radius(part: Floats) -> float:
    """A positive number, else ValueError."""
    (radius,) = part.tolist()
    if radius <= 0:
        raise ValueError
    return float(radius)


#: by kind the form of the text, an example and what makes the expression
_KINDS: dict[str, tuple[str, str, Callable[[Sequence[Floats]], Node]]] = {
    "plane": ("plane:POINT:NORMAL", "plane:0,0,0.5:0,0,1", _plane),
    "sphere": ("sphere:CENTRE:RADIUS", "sphere:0,0,0:0.5", _sphere),
    "cylinder": ("cylinder:POINT:AXIS:RADIUS", "cylinder:0,0,0:0,0,1:0.5", _cylinder),
}
