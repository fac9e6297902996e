"""Values of quantities: at reference points, at known places in elements, and at world points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location, Locator
from elvis.core.mapping.patch import Patch, patches
from elvis.core.numbers.sampling import Samples
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.conversion_radius import radius_at
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.functions import function
from elvis.core.quantities.tree import Node, direction_of, fold, target_of, whole_exponent

#: points at once
_BATCH = 1 << 15
#: relative radius of a disc at which functions are linear
_SLOPE = 2.0**-40


class Evaluator:
    """Expressions of one dataset, ready to be evaluated.

    expressions  as given
    names        names of their fields, each once
    patches      the elements of the domain, with these fields
    """

    def __init__(self, dataset: Dataset, expressions: Sequence[Expression]) -> None:
        self.expressions = tuple(expressions)
        self.names = tuple(dict.fromkeys(name for each in expressions for name in each.fields))
        self.patches = patches(dataset, self.names)
        self.attributes = Attributes(dataset)
        self.errors = ConversionErrors.of(dataset.metadata)

    def radius_at(self, expression: Expression, places: ElementPoints) -> Floats:
        """(n,) estimated deviation of values at points from the source of converted data."""
        if not self.errors:
            return np.zeros(len(places))
        return radius_at(self.errors, expression, self.names, self.leaves_at(places), places)

    def values(self, expression: Expression, patch: Patch, rows: Ints, points: Floats) -> Floats:
        """(n,) values on elements ``rows`` (n,) of a patch at reference points (n, D); NaN if there are none."""
        return reference_values(expression, self.names, self.attributes, patch, rows, points)

    def values_at(self, expressions: Sequence[Expression], places: ElementPoints) -> Iterator[Floats | float]:
        """(n,) values of some of its expressions at points, or one number; NaN for undefined values."""
        leaf = self.leaves_at(places)
        return (_folded(expression, leaf) for expression in expressions)

    def sizes_at(self, expressions: Sequence[Expression], places: ElementPoints) -> Iterator[Floats | float]:
        """(n,) magnitudes of what expressions are added up from at points: in proportion to these they are rounded."""
        leaf = _leaves(self.names, self.attributes, places)

        def sized(node: Node) -> _Sized:
            value = leaf(node)
            # parts of a unit vector are right to its length
            if node.name in SIDES or direction_of(node.name) is not None:
                return value, 1.0
            # a distance is one between coordinates, near the surface also
            is_distance = node.op == "attribute" and target_of(node.name) is not None
            farthest = np.abs(places.positions).max(axis=1) if is_distance else 0.0
            return value, np.abs(value) + farthest

        with np.errstate(all="ignore"):
            yield from (fold(expression.root, sized, _sized)[1] for expression in expressions)

    def leaves_at(self, places: ElementPoints) -> Callable[[Node], Floats | float]:
        """The values of the leaves of its expressions at points: (n,) values, or one number."""
        return cache(_leaves(self.names, self.attributes, places))

    def at(self, expression: Expression, element_ids: Ints, reference: Floats) -> Floats:
        """(n,) values in elements with these ids (n,) at reference points (n, 3).

        Coordinates in the element come first.
        """
        result = np.full(len(element_ids), np.nan)
        for patch in self.patches:
            order = np.argsort(patch.element_ids, kind="stable")
            place = np.searchsorted(patch.element_ids, element_ids, sorter=order).clip(0, len(patch) - 1)
            rows = order[place]
            here = np.flatnonzero(patch.element_ids[rows] == element_ids)
            result[here] = self.values(expression, patch, rows[here], reference[here, : patch.dimension])
        return result


class Sampler:
    """Expressions of a dataset ready to be sampled at world points, for many calls."""

    def __init__(self, dataset: Dataset, expressions: Sequence[Expression]) -> None:
        self.evaluator = Evaluator(dataset, expressions)
        self.locator = Locator(self.evaluator.patches)

    def sample(self, points: Floats, all: bool = False) -> Samples:
        """Values at the world points (n, 3); with ``all`` from every element that holds a point."""
        location = self.locator.locate(points, all)
        expressions = self.evaluator.expressions
        found = np.full((len(location), len(expressions)), np.nan)
        errors = np.zeros_like(found)
        for number, patch in enumerate(self.evaluator.patches):
            here = np.flatnonzero((location.status == Status.INSIDE) & (location.patch == number))
            rows, reference = _places(location, here, patch)
            for column, expression in enumerate(expressions):
                found[here, column] = self.evaluator.values(expression, patch, rows, reference)
                errors[here, column] = self.evaluator.radius_at(expression, ElementPoints(patch, rows, reference))
        names = tuple(expression.text for expression in expressions)
        return Samples(names, np.asarray(points, np.float64)[location.point], location, found, errors)


def _places(location: Location, here: Ints, patch: Patch) -> tuple[Ints, Floats]:
    return location.row[here], location.reference[here, : patch.dimension]


def reference_values(
    expression: Expression, names: Sequence[str], attributes: Attributes, patch: Patch, rows: Ints, points: Floats
) -> Floats:
    """(n,) values on elements ``rows`` (n,) of a patch at reference points (n, D); NaN for undefined values.

    names  names of the patch's fields, in order; fields that the patch lacks are NaN
    Raises ElvisError for second derivatives of fields on surfaces and curves in space, and of quasi-3D fields.
    """
    result = np.empty(len(rows))
    for first in range(0, len(rows), _BATCH):
        part = slice(first, first + _BATCH)
        points_there = ElementPoints(patch, rows[part], points[part])
        result[part] = _folded(expression, _leaves(names, attributes, points_there))
    return result


def _folded(expression: Expression, leaf: Callable[[Node], Floats | float]) -> Floats | float:
    with np.errstate(all="ignore"):
        return fold(expression.root, leaf, _evaluated)


def _evaluated(node: Node, parts: list[Floats | float]) -> Floats | float:
    found: Floats | float = function(node).numpy(*parts)
    return found


#: values, and magnitudes of their terms
_Sized = tuple[Any, Any]


def _sized(node: Node, parts: list[_Sized]) -> _Sized:
    """The value of an operation and its size: the operation applied to sizes; for functions, slope times sizes."""
    values, sizes = zip(*parts, strict=True)
    value = _evaluated(node, list(values))
    if node.op in ("+", "-"):
        return value, sizes[0] + sizes[1]
    if node.op == "*" or whole_exponent(node) is not None:
        return value, np.abs(_evaluated(node, list(sizes)))

    # the radius of a disc is the slope's share where it is small, and infinite at kinks and poles
    radius = function(node).disc(*((own, _SLOPE * size) for own, size in parts))[1]
    known = np.abs(value) + radius / _SLOPE
    return value, np.where(np.isfinite(known), known, np.abs(_evaluated(node, list(sizes))))


def _leaves(names: Sequence[str], attributes: Attributes, places: ElementPoints) -> Callable[[Node], Floats | float]:
    """The values of the leaves of expressions at some points."""

    def leaf(node: Node) -> Floats | float:
        if node.op == "number":
            return node.value
        if node.op == "coordinate":
            return np.asarray(places.positions[:, node.axes[0]])
        if node.op == "attribute" and places.normals is not None and node.name in SIDES[:3]:
            return np.asarray(places.normals[:, SIDES.index(node.name)])
        if node.op == "attribute":
            return attributes.at(node.name, places.patch, places.rows, places.points)
        derivative = places.derivative(names.index(node.name), len(node.axes))
        return derivative.T[node.axes[::-1]] if node.axes else derivative

    return leaf
