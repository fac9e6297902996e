"""Values of expressions at reference points, an element for each point, as in `elvis.core.mapping.pointwise`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.errors import ElvisError
from elvis.core.mapping import pointwise, tangents
from elvis.core.patch import Patch
from elvis.core.polynomials.curvature import hessians_at
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.functions import function
from elvis.core.quantities.tree import Node, folded

#: points at once
_BATCH = 1 << 15


def values(
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
            result[part] = folded(expression.root, leaf, lambda node, parts: function(node).numpy(*parts))
    return result


def _leaves(
    names: Sequence[str], attributes: Attributes, patch: Patch, rows: Ints, points: Floats
) -> Callable[[Node], Floats | float]:
    """What the leaves of expressions are at some points; what several of them share is made once."""

    @cache
    def place() -> Floats:
        return pointwise.positions(patch, rows, points)

    @cache
    def moved(name: str, order: int) -> Floats:
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
        return moved(node.name, len(node.axes)).T[node.axes[::-1]] if node.axes else moved(node.name, 0)

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
    slopes = pointwise.gradients(patch, field, rows, points)
    inverse = tangents.duals(pointwise.jacobians(patch, rows, points))[:, :, :d]
    with np.errstate(invalid="ignore"):
        bent = bent - np.einsum("nc,ncij->nij", slopes, maps)
        return np.asarray(np.einsum("nai,nij,nbj->nab", inverse, bent, inverse))


_DERIVATIVES = (pointwise.values, pointwise.gradients, hessians)
