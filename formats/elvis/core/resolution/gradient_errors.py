"""Errors of gradients, estimated by recovered gradients on each element.

    eta^2 = integral of |G u - grad u|^2 over the element,    G u the recovered gradient

Zienkiewicz and Zhu 1987, A simple error estimator and adaptive procedure for practical engineering analysis.  For
smooth fields, G u has one order more than grad u, and the quotient of eta and the true error tends to 1.  Next to
shocks and corners it does not.
"""

from __future__ import annotations

from math import comb

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping import tangents
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch, patches
from elvis.core.numbers.norms import stretch_factors
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.quantities.derived import RECOVERED, derived_name
from elvis.core.resolution.modal_bases import exact_rule
from elvis.core.resolution.recovery import MORE, raised

#: numbers in a table of values at quadrature points
_BATCH = 1 << 20


def gradient_errors(dataset: Dataset, name: str) -> tuple[Ints, Floats]:
    """Ids (n,) of the elements that have a field, and the estimated L2 norms (n,) of the error of its gradient.

    NaN for elements with coefficients that are not finite.  Raises ElvisError for fields that cannot be recovered, and
    for a single element, of which neighbours say nothing.
    """
    if sum(map(len, dataset.field(name).blocks)) == 1:
        raise ElvisError(f"recovered_error({name}): expected elements with neighbours, found a single element")
    names = [derived_name(RECOVERED, name, (axis,)) for axis in range(dataset.mesh.dimension)]
    ids, errors = [np.empty(0, np.int64)], [np.empty(0)]
    for patch in patches(dataset, [name, *names]):
        if patch.fields[0] is None:
            continue
        ids.append(patch.element_ids)
        errors.append(_on_patch(patch) if patch.fields[1] is not None else np.full(len(patch), np.nan))
    return np.concatenate(ids), np.concatenate(errors)


def work_of(dataset: Dataset, name: str) -> int:
    """Numbers in the tables of polynomials at points that the recovery of a field makes, about."""
    total = 0
    for block in dataset.field(name).blocks:
        shape, modes = block.expansion.shape, max(block.expansion.modes)
        polynomials = comb(modes - 1 + MORE + shape.dimension, shape.dimension)
        total += len(block) * len(shape.vertices) * (modes + 1) ** shape.dimension * polynomials
    return total


def _on_patch(patch: Patch) -> Floats:
    """(n,) errors on the elements of a patch, whose first field is meant; its recovered derivatives are the others."""
    expansion, coefficients = patch.fields[0], patch.coefficients[0]
    assert expansion is not None
    assert coefficients is not None
    points, weights = exact_rule(raised(expansion))
    found = np.empty(len(patch))
    for part in chunks(len(patch), max(1, _BATCH // (9 * len(points)))):
        _, jacobians = evaluate_with_gradients(patch.geometry, patch.geometry_coefficients[part], points)
        _, slopes = evaluate_with_gradients(expansion, coefficients[part], points)
        measure = weights * stretch_factors(jacobians)
        dimension = slopes.shape[-1]

        # grad u = sum over the reference directions i of du/dxi_i grad xi_i
        duals = tangents.duals(np.swapaxes(jacobians, 1, 2).reshape(-1, 3, dimension))
        gradients = (duals * slopes.reshape(-1, 1, dimension)).sum(axis=2).reshape(*measure.shape, 3)
        squares = np.zeros(measure.shape)
        for axis, (own, values) in enumerate(zip(patch.fields[1:], patch.coefficients[1:], strict=True)):
            assert own is not None
            assert values is not None
            squares += (evaluate(own, values[part], points) - gradients[..., axis]) ** 2
        found[part] = np.sqrt((squares * measure).sum(axis=1))
    return found
