"""Extrema of functions of a single field, such as exp(-u^2), from the field's own extrema.

Such a function has only as many dimensions as the field has values: one.  Its maximum over the range of the field is
enclosed by interval arithmetic on parts of that range.  Each element takes all values between two of its own, so that
a point with the best value is found on a line between two points of an element.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.bounds.extrema import Extremum
from elvis.core.mapping import pointwise
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node, fold, leaves

#: parts of the range of a field at first, parts examined at most, and bisections
_PARTS, _MOST_PARTS, _BISECTIONS = 256, 1 << 12, 60
#: the tolerated gap relative to the value
_CLOSE = 1e-14
#: elements whose values are compared at once, and bisections of lines
_ELEMENTS, _LINE_BISECTIONS = 1 << 12, 60


def single_field(root: Node) -> Node | None:
    """The only field of an expression that contains nothing else but numbers; None for other expressions."""
    found = leaves(root)
    is_single = len(found) == 1 and found[0].op == "field" and not found[0].axes
    return found[0] if is_single and root is not found[0] else None


@dataclass(frozen=True)
class Point:
    """A point of the data with a value of the field."""

    value: float
    position: tuple[float, float, float]
    element: int


@dataclass(frozen=True)
class Best:
    """The value of a field with the largest value of a function, that value, and an upper bound of the function."""

    argument: float
    value: float
    bound: float


def best_argument(root: Node, ends: tuple[Extremum, Extremum], sign: int) -> Best | None:
    """Where ``sign`` times a function of one field is largest on the field's range; None if this can't be decided."""
    least, greatest = ends
    if not np.isfinite([least.bound, greatest.bound]).all():
        return None
    edges = np.linspace(least.bound, greatest.bound, _PARTS + 1)
    low, high = edges[:-1], edges[1:]
    best, bound = Best(np.nan, -np.inf, -np.inf), -np.inf
    for _ in range(_BISECTIONS):
        # values that the field takes, at the ends of the parts
        places = np.clip(np.concatenate([low, high]), least.value, greatest.value)
        best = _improved(best, places, sign * values(root, places))
        upper = _upper(root, (low, high), sign)
        is_open = upper > best.value + _CLOSE * abs(best.value)
        if is_open.sum() > _MOST_PARTS:
            is_open &= upper > np.partition(upper, -_MOST_PARTS)[-_MOST_PARTS]
        bound = max(bound, float(upper[~is_open].max(initial=-np.inf)))
        low, high, upper = low[is_open], high[is_open], upper[is_open]
        if not len(low):
            break
        middle = (low + high) / 2
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    else:
        bound = max(bound, float(upper.max()))
    return Best(best.argument, best.value, max(bound, best.value)) if np.isfinite(best.value) else None


def _improved(best: Best, places: Floats, found: Floats) -> Best:
    """The largest of one value and of values (n,) at places (n,); NaN is ignored."""
    found = np.where(np.isfinite(found), found, -np.inf)
    number = int(found.argmax())
    return Best(float(places[number]), float(found[number]), 0.0) if found[number] > best.value else best


def _upper(root: Node, part: Interval, sign: int) -> Floats:
    """(n,) upper bounds of ``sign`` times a function on parts of the range; -inf where it has no values."""

    def leaf(node: Node) -> Interval:
        return (np.float64(node.value),) * 2 if node.op == "number" else part

    with np.errstate(all="ignore"):
        low, high = fold(root, leaf, lambda node, parts: function(node).interval(*parts))
    upper = np.broadcast_to(high if sign > 0 else -low, len(part[0]))
    return np.where(np.isnan(upper), -np.inf, upper)


def values(root: Node, arguments: Floats) -> Floats:
    """(n,) a function of one field at its values (n,)."""

    def leaf(node: Node) -> Floats | float:
        return node.value if node.op == "number" else arguments

    with np.errstate(all="ignore"):
        found = fold(root, leaf, lambda node, parts: function(node).numpy(*parts))
    return np.broadcast_to(found, len(arguments))


def point_with_value(held: Sequence[Patch], value: float) -> Point | None:
    """A point where the first field of patches has a value: in the element with the smallest id that surely does."""
    found: list[tuple[int, Patch, int, Floats]] = []
    for patch in held:
        corners = np.vstack([patch.shape.vertices, patch.shape.centre])
        for part in chunks(len(patch), _ELEMENTS):
            rows = np.arange(len(patch))[part]
            points = np.tile(corners, (len(rows), 1))
            at_points = pointwise.values(patch, 0, np.repeat(rows, len(corners)), points).reshape(len(rows), -1)
            is_between = (at_points.min(axis=1) <= value) & (value <= at_points.max(axis=1))
            ids = patch.element_ids[rows[is_between]]
            if len(ids):
                row = np.flatnonzero(is_between)[ids.argmin()]
                ends = corners[[at_points[row].argmin(), at_points[row].argmax()]]
                found.append((int(ids.min()), patch, int(rows[row]), ends))
    if not found:
        return None
    element, patch, row, ends = min(found, key=lambda each: each[0])
    return _on_line(element, patch, row, ends, value)


def _on_line(element: int, patch: Patch, row: int, ends: Floats, value: float) -> Point:
    """The point between two points (2, d) of an element, with values below and above, where the field has a value."""
    rows = np.array([row])

    def at(share: float) -> Floats:
        return (1 - share) * ends[:1] + share * ends[1:]

    def miss(share: float) -> float:
        return float(pointwise.values(patch, 0, rows, at(share))[0]) - value

    share = _root(miss)
    x, y, z = map(float, pointwise.positions(patch, rows, at(share))[0])
    return Point(value + miss(share), (x, y, z), element)


def _root(miss: Callable[[float], float]) -> float:
    """A zero in [0, 1] of a function that is at most 0 at 0 and at least 0 at 1, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(_LINE_BISECTIONS):
        middle = (low + high) / 2
        if miss(middle) <= 0:
            low = middle
        else:
            high = middle
    return min((low, high), key=lambda share: abs(miss(share)))
