"""Positions and values of a patch at reference points, an element for each point.

rows    (n,)    rows of the patch
points  (n, D) reference coordinates: the shape's, then one zeta in [-1, 1] for each homogeneous direction

World coordinates of homogeneous directions follow from the lengths: z = LZ (1 + zeta)/2, with two of them also
y = LY (1 + zeta)/2 (format notes 3).
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Expansion
from elvis.core.mapping import tangents
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.evaluation import evaluate_at, evaluate_at_with_gradients
from elvis.core.polynomials.expansion import dimension


def positions(patch: Patch, rows: Ints, points: Floats) -> Floats:
    """(n, 3) world coordinates."""
    plane = np.asarray(points, np.float64)[:, : patch.shape.dimension]
    world = evaluate_at(patch.geometry, patch.geometry_coefficients, rows, plane)
    for i, (axis, length) in enumerate(patch.periods):
        world[:, axis] = length * (1 + points[:, patch.shape.dimension + i]) / 2
    return world


def jacobians(patch: Patch, rows: Ints, points: Floats) -> Floats:
    """(n, 3, D) derivatives of the world coordinates in the reference coordinates."""
    return positions_and_jacobians(patch, rows, points)[1]


def positions_and_jacobians(patch: Patch, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
    """World coordinates (n, 3) and their derivatives in the reference coordinates (n, 3, D)."""
    own = patch.shape.dimension
    plane = np.asarray(points, np.float64)[:, :own]
    world, jacobians = evaluate_at_with_gradients(patch.geometry, patch.geometry_coefficients, rows, plane)
    result = np.zeros((*jacobians.shape[:2], patch.dimension))
    result[:, :, :own] = jacobians
    for i, (axis, length) in enumerate(patch.periods):
        world[:, axis] = length * (1 + points[:, own + i]) / 2
        result[:, axis, own + i] = length / 2
    return world, result


def determinants(patch: Patch, rows: Ints, points: Floats) -> Floats:
    """(n,) Jacobian determinant; signed for volumes and for elements of a plane, else length or area."""
    matrix = jacobians(patch, rows, points)
    if patch.dimension == 3 or not patch.is_flat:
        return tangents.determinants(matrix)
    return matrix[:, 0, 0] if patch.dimension == 1 else np.linalg.det(matrix[:, :2])


def values(patch: Patch, field: int, rows: Ints, points: Floats) -> Floats:
    """(n,) values of field number ``field`` of the patch; raises ElvisError if the patch lacks it."""
    expansion, coefficients = _field(patch, field)
    return evaluate_at(expansion, coefficients, rows, points[:, : dimension(expansion)])


def gradients(patch: Patch, field: int, rows: Ints, points: Floats) -> Floats:
    """(n, 3) gradient of a field in world coordinates, tangential to a curve or surface.

    Not finite where the Jacobian is singular; raises ElvisError if the patch lacks the field.
    """
    own = reference_gradients(patch, field, rows, points)
    duals = tangents.duals(jacobians(patch, rows, points))[:, :, : own.shape[1]]
    return np.asarray(np.einsum("nci,ni->nc", duals, own))


def reference_gradients(patch: Patch, field: int, rows: Ints, points: Floats) -> Floats:
    """(n, d) derivatives of a field in the reference coordinates that it depends on.

    Raises ElvisError as for `gradients`.
    """
    expansion, coefficients = _field(patch, field)
    own = points[:, : dimension(expansion)]
    return evaluate_at_with_gradients(expansion, coefficients, rows, own)[1]


def _field(patch: Patch, field: int) -> tuple[Expansion, Floats]:
    expansion, coefficients = patch.fields[field], patch.coefficients[field]
    if expansion is None or coefficients is None:
        raise ElvisError(f"expected a patch with field {field}, found none for element {patch.element_ids[0]}")
    return expansion, coefficients
