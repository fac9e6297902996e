"""The mappings of Trixi's structured meshes, which its files hold as a text of Julia.

A text defines ``mapping``, from [-1, 1] in each direction to space, by a formula or by one of the two functions here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import permutations, product
from typing import Any

import numpy as np

from elvis.converters.trixi.julia import definitions, evaluated
from elvis.core.base.arrays import Floats
from elvis.core.base.errors import FormatError

#: the name that the text defines
_NAME = "mapping"


class Mapping:
    """The mapping of a text in Julia, from points (n, d) of [-1, 1]^d.

    dimension  of the points
    extra      a text of definitions that the other one lacks
    Raises FormatError if the text makes no formula of known names.
    """

    def __init__(self, code: str, dimension: int, extra: str = "") -> None:
        if not code.strip():
            raise FormatError(
                "expected the mapping as a text, found none: Trixi could not find its source; give mapping_as_string "
                "where the mesh is made, or the option mapping"
            )
        known = {"coordinates2mapping": _box, "transfinite_mapping": _transfinite}
        scope = definitions(f"{extra}\n{code}", known)
        if not callable(scope.get(_NAME)):
            raise FormatError(f"expected a function {_NAME}, found none")
        self._function, self._dimension = scope[_NAME], dimension
        self.is_affine = "coordinates2mapping" in code and not extra

    def at(self, points: Floats) -> Floats:
        """(n, d) places of points (n, d)."""
        parts = evaluated(self._function, list(points.T))
        if len(parts) != self._dimension:
            raise FormatError(f"expected {self._dimension} coordinates of the mapping, found {len(parts)}")
        return np.stack(parts, axis=-1)


def _between(s: Floats, low: Floats, high: Floats) -> Floats:
    """The linear function of s with ``low`` at -1 and ``high`` at 1."""
    return 0.5 * ((1 - s) * low + (1 + s) * high)


def _box(low: Any, high: Any) -> Callable[..., tuple[Floats, ...]]:
    """The mapping to a box between two corners."""
    lows, highs = (tuple(corner) if isinstance(corner, tuple) else (corner,) for corner in (low, high))
    if len(lows) != len(highs):
        raise FormatError(f"expected two corners of a box, found {len(lows)} and {len(highs)} coordinates")

    def mapping(*points: Floats) -> tuple[Floats, ...]:
        return tuple(_between(s, *ends) for s, *ends in zip(points, lows, highs, strict=True))

    return mapping


def _transfinite(faces: Any) -> Callable[..., tuple[Floats, ...]]:
    """The mapping whose faces are given: their Boolean sum (Gordon and Hall, 1973).

    faces  2 d functions of d - 1 coordinates: at -1 and at 1 of the first direction, of the second, of the third
    """
    if not isinstance(faces, tuple) or len(faces) not in (2, 4, 6):
        raise FormatError("expected two, four or six faces of a mapping, found others")

    def mapping(*points: Floats) -> tuple[Floats, ...]:
        dimension = len(faces) // 2
        if len(points) != dimension:
            raise FormatError(f"expected {dimension} coordinates, found {len(points)}")

        # faces are summed; they count edges twice and corners three times, so linear terms between these are subtracted
        total = sum(_across(faces, axis, points) for axis in range(dimension))
        for axis, other in permutations(range(dimension), 2):
            ends = [_across(faces, other, _fixed(points, {axis: end})) for end in (-1.0, 1.0)]
            total = total - 0.5 * _between(points[axis], *ends)
        if dimension == 3:
            total = total + _trilinear(faces, points)
        return tuple(np.asarray(total))

    return mapping


def _across(faces: Sequence[Any], axis: int, points: Sequence[Floats]) -> Floats:
    """(d, n) places that are linear between the two faces of an axis."""
    others = [*points[:axis], *points[axis + 1 :]]
    low, high = (_on_face(faces[2 * axis + end], others, points[0].shape) for end in (0, 1))
    return _between(points[axis], low, high)


def _on_face(face: Any, points: Sequence[Floats], shape: tuple[int, ...]) -> Floats:
    """(d, n) places on a face."""
    found = face(*points)
    parts = found if isinstance(found, tuple) else (found,)
    return np.stack([np.broadcast_to(np.asarray(part, np.float64), shape) for part in parts])


def _trilinear(faces: Sequence[Any], points: Sequence[Floats]) -> Floats:
    """(3, n) trilinear positions between the corners, taken from the first two faces."""
    total = np.zeros((3, *points[0].shape))
    for signs in product((-1.0, 1.0), repeat=3):
        corner = _across(faces, 0, _fixed(points, dict(enumerate(signs))))
        weights = [(1 + sign * s) / 2 for sign, s in zip(signs, points, strict=True)]
        total += corner * np.prod(weights, axis=0)
    return total


def _fixed(points: Sequence[Floats], values: dict[int, float]) -> list[Floats]:
    """Coordinates of points with some of them replaced."""
    return [np.full_like(own, values[axis]) if axis in values else own for axis, own in enumerate(points)]
