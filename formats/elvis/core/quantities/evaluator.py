"""Values of quantities: at reference points, at known places in elements, and at world points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.mapping import pointwise, tangents
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location, Locator
from elvis.core.patch import Patch, patches
from elvis.core.polynomials.curvature import hessians_at
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.functions import function
from elvis.core.quantities.tree import Node, fold
from elvis.core.sampling import Samples

#: points at once
_BATCH = 1 << 15


class Evaluator:
    """Expressions of one dataset, ready to be evaluated.

    expressions  as given
    names        of the fields that they are made of, each once
    patches      the elements of the domain, with these fields
    """

    def __init__(self, dataset: Dataset, expressions: Sequence[Expression]) -> None:
        self.expressions = tuple(expressions)
        self.names = tuple(dict.fromkeys(name for each in expressions for name in each.fields))
        self.patches = patches(dataset, self.names)
        self.attributes = Attributes(dataset)

    def values(self, expression: Expression, patch: Patch, rows: Ints, points: Floats) -> Floats:
        """(n,) values on elements ``rows`` (n,) of a patch at reference points (n, D); NaN where there are none."""
        return reference_values(expression, self.names, self.attributes, patch, rows, points)

    def at(self, expression: Expression, element_ids: Ints, reference: Floats) -> Floats:
        """(n,) values in elements with these ids (n,) at reference points (n, 3); those of the element come first."""
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
        for number, patch in enumerate(self.evaluator.patches):
            here = np.flatnonzero((location.status == Status.INSIDE) & (location.patch == number))
            rows, reference = _places(location, here, patch)
            for column, expression in enumerate(expressions):
                found[here, column] = self.evaluator.values(expression, patch, rows, reference)
        names = tuple(expression.text for expression in expressions)
        return Samples(names, np.asarray(points, np.float64)[location.point], location, found)


def _places(location: Location, here: Ints, patch: Patch) -> tuple[Ints, Floats]:
    return location.row[here], location.reference[here, : patch.dimension]


def reference_values(
    expression: Expression, names: Sequence[str], attributes: Attributes, patch: Patch, rows: Ints, points: Floats
) -> Floats:
    """(n,) values on elements ``rows`` (n,) of a patch at reference points (n, D); NaN where there is no value.

    names  of the patch's fields, in order; NaN stands for fields that the patch lacks
    ElvisError for second derivatives of fields on surfaces and curves in space, and of quasi-3D fields.
    """
    result = np.empty(len(rows))
    for first in range(0, len(rows), _BATCH):
        part = slice(first, first + _BATCH)
        leaf = _leaves(names, attributes, patch, rows[part], points[part])
        with np.errstate(all="ignore"):
            result[part] = fold(expression.root, leaf, lambda node, parts: function(node).numpy(*parts))
    return result


def _leaves(
    names: Sequence[str], attributes: Attributes, patch: Patch, rows: Ints, points: Floats
) -> Callable[[Node], Floats | float]:
    """What the leaves of expressions are at some points; what several of them share is made once."""

    @cache
    def place() -> Floats:
        return pointwise.positions(patch, rows, points)

    @cache
    def derivatives(name: str, order: int) -> Floats:
        field = names.index(name)
        if patch.fields[field] is None:
            return np.full((len(rows), *(3,) * order), np.nan)
        return _DERIVATIVES[order](patch, field, rows, points)

    def leaf(node: Node) -> Floats | float:
        if node.op == "number":
            return node.value
        if node.op == "coordinate":
            return np.asarray(place()[:, node.axes[0]])
        if node.op == "attribute":
            return attributes.at(node.name, patch, rows, points)
        return derivatives(node.name, len(node.axes)).T[node.axes[::-1]] if node.axes else derivatives(node.name, 0)

    return leaf


def hessians(patch: Patch, field: int, rows: Ints, points: Floats) -> Floats:
    """(n, 3, 3) second derivatives of a field in world coordinates; not finite where the Jacobian is singular.

    From u(x(xi)): u_xixi = J^T H J + sum_c g_c x_c,xixi, with the gradient g and the Jacobian J.
    """
    expansion, coefficients = patch.fields[field], patch.coefficients[field]
    d = patch.shape.dimension
    if patch.homogeneous or not patch.is_flat or expansion is None or coefficients is None:
        raise ElvisError("expected second derivatives of 2D fields in the plane or of 3D fields, found other ones")
    bent = hessians_at(expansion, coefficients, rows, points)
    maps = hessians_at(patch.geometry, patch.geometry_coefficients, rows, points)
    gradients = pointwise.gradients(patch, field, rows, points)
    inverse = tangents.duals(pointwise.jacobians(patch, rows, points))[:, :, :d]
    with np.errstate(invalid="ignore"):
        bent = bent - np.einsum("nc,ncij->nij", gradients, maps)
        return np.asarray(np.einsum("nai,nij,nbj->nab", inverse, bent, inverse))


_DERIVATIVES = (pointwise.values, pointwise.gradients, hessians)
