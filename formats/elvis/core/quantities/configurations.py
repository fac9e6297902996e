"""Derivatives in the configuration before a deformation, as expressions of derivatives in the deformed one.

Elements know their coordinates before the deformation, X, as fields.  With x for the deformed ones,

    df/dX_j = sum_k df/dx_k F_kj,    F = dx/dX = (dX/dx)^-1,

the chain rule, with the deformation gradient F of continuum mechanics.
"""

from __future__ import annotations

from collections.abc import Sequence

from elvis.core.quantities.tree import ONE, ZERO, Node, call, dot, field, world_derivative


def derivative_before(root: Node, axis: int, coordinates: Sequence[str], is_height: bool = False) -> Node:
    """The derivative of an expression along a coordinate before a deformation.

    coordinates  names of the fields that hold these; none without a deformation, and for a coordinate that is not among
                 them: then it is the derivative along the coordinate of the map
    is_height    whether the map is a surface in space over two coordinates
    """
    if is_height and coordinates:
        return _derivative_in_plane(root, axis, coordinates)
    if axis >= len(coordinates):
        return world_derivative(root, axis)
    gradients = [[field(name, (k,)) for k in range(len(coordinates))] for name in coordinates]
    total = ZERO
    for k in range(len(coordinates)):
        slope = world_derivative(root, k)
        if slope is not ZERO:
            total = call("+", total, call("*", slope, _cofactor(gradients, axis, k)))
    return total if total is ZERO else call("/", total, _determinant(gradients))


def _derivative_in_plane(root: Node, axis: int, coordinates: Sequence[str]) -> Node:
    """The derivative in the plane of a function on a surface over it; zero along the height.

    With the gradients on the surface, which lie in its tangent planes, grad f = G^T df/dX and G = grad X, so that
    df/dX = (G G^T)^-1 G grad f.
    """
    if axis >= len(coordinates):
        return ZERO
    gradients = [[field(name, (k,)) for k in range(3)] for name in coordinates]
    slopes = [world_derivative(root, k) for k in range(3)]
    metric = [[dot(one, other) for other in gradients] for one in gradients]
    along = [dot(own, slopes) for own in gradients]
    other = 1 - axis
    top = call("-", call("*", metric[other][other], along[axis]), call("*", metric[axis][other], along[other]))
    return top if top is ZERO else call("/", top, _determinant(metric))


def _cofactor(matrix: Sequence[Sequence[Node]], row: int, column: int) -> Node:
    """The signed minor: the inverse has it, over the determinant, in the row ``column`` and the column ``row``."""
    rest = [[own for k, own in enumerate(line) if k != column] for i, line in enumerate(matrix) if i != row]
    minor = _determinant(rest)
    return call("-", ZERO, minor) if (row + column) % 2 else minor


def _determinant(matrix: Sequence[Sequence[Node]]) -> Node:
    """The determinant, expanded along the first row; 1 for an empty matrix."""
    if not matrix:
        return ONE
    total = ZERO
    for k, own in enumerate(matrix[0]):
        rest = [[*line[:k], *line[k + 1 :]] for line in matrix[1:]]
        total = call("-" if k % 2 else "+", total, call("*", own, _determinant(rest)))
    return total
