"""Estimated deviation of quantities of converted data from the source, based on the estimated errors of fields.

The leaves of an expression become intervals at a point: a field f becomes f +- its error, a derivative is widened by
the error's derivative, a coordinate by the error of the map.  Interval arithmetic yields the radius of the expression.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.conversion_errors import ConversionErrors, Loss
from elvis.core.quantities.derived import original_of
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node, fold


def radius_at(
    errors: ConversionErrors,
    expression: Expression,
    names: Sequence[str],
    leaf: Callable[[Node], Floats | float],
    places: ElementPoints,
) -> Floats:
    """(n,) deviation of the values of an expression at points from the source; infinite if unknown.

    names  of the fields of the patch of the points
    leaf   values of the leaves of the expression there
    """

    def interval(node: Node) -> Interval:
        value, radius = leaf(node), _radius_of(node, errors, names, places)
        return value - radius, value + radius

    with np.errstate(all="ignore"):
        low, high = fold(expression.root, interval, lambda node, parts: function(node).interval(*parts))
        value = fold(expression.root, leaf, lambda node, parts: function(node).numpy(*parts))
        radius = np.maximum(high - value, value - low)
    # undefined values have no error
    found = np.where(np.isfinite(value), np.nan_to_num(radius, nan=np.inf, posinf=np.inf), 0.0)
    return np.broadcast_to(found, len(places))


def _radius_of(node: Node, errors: ConversionErrors, names: Sequence[str], places: ElementPoints) -> Floats | float:
    """The error of a field, of a derivative, of a coordinate; infinite for others that are not exact."""
    place = errors.place
    if node.op == "coordinate":
        return place.value
    if node.op == "field":
        own = loss_of(errors, node.name)
        if len(node.axes) == 1 and place.slope < 1:
            # the map's error turns the gradient g into (1 + grad e)^-T g
            gradients = places.derivative(names.index(node.name), 1)
            turned = place.slope / (1 - place.slope)
            return np.asarray(own.slope * (1 + turned) + turned * np.linalg.norm(gradients, axis=-1))
        return own.value if not node.axes else np.inf
    if node.op == "attribute":
        # a unit normal turns by as much as tangents do
        return 2 * place.slope if node.name in SIDES[:3] else np.inf if place.value else 0.0
    return 0.0


def loss_of(errors: ConversionErrors, name: str) -> Loss:
    """The error of a field, exact or not; unknown for a field that is derived from one with an error."""
    original = original_of(name)
    if original in errors.fields and original != name:
        return Loss(inf, inf, inf)
    return errors.fields.get(name, Loss())


def sentence(names: Sequence[str], radii: Sequence[float]) -> str | None:
    """A message about the deviation of quantities from the source; None if no conversion was lossy."""
    known = [f"{name} by up to {radius:.2g}" for name, radius in zip(names, radii, strict=True) if 0 < radius < np.inf]
    unknown = [name for name, radius in zip(names, radii, strict=True) if radius == np.inf]
    parts = [f"values may be off by the error of the conversion (an estimate): {', '.join(known)}"] if known else []
    parts += [f"the error of the conversion of {', '.join(unknown)} is not known"] if unknown else []
    return "; ".join(parts) or None
