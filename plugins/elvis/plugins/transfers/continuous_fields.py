"""Fields made continuous: the L2 projection on the whole mesh, and the change that it makes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Field
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.resolution.continuous_space import ContinuousSpace, continuous_projection
from elvis.plugins.conversion.report import Measure, is_rounding
from elvis.plugins.data.added_quantities import recorded_facts, with_errors
from elvis.plugins.data.common_blocks import on_common_blocks


@dataclass(frozen=True, eq=False)
class ContinuousFields:
    """A dataset with continuous fields, and how far each of these is from its original."""

    dataset: Dataset
    measures: tuple[Measure, ...]


def continuous(dataset: Dataset, length: float = 0.0) -> Dataset:
    """The dataset with continuous fields, as ``elvis convert --continuous`` makes them (see `continuous_fields`).

    Parameters
    ----------
    dataset : Dataset
        Data without Fourier directions, on a conforming mesh.
    length : float
        Length of smoothing: waves of the length l become smaller by the factor 1/(1 + (length/l)^2).

    Returns
    -------
    Dataset
        The same mesh; each field is the L2 projection onto continuous ones of its highest order.

    Raises
    ------
    ElvisError
        With Fourier directions, for values that are not finite, and on non-conforming meshes.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> elvis.continuous(ds)
    <Dataset 2D: 1 triangle; fields u, v of order 1>
    """
    return continuous_fields(dataset, length).dataset


def continuous_fields(dataset: Dataset, length: float = 0.0) -> ContinuousFields:
    """The dataset with each field of the solution replaced by its continuous L2 projection, of its highest order.

    Differences are measured at points of a quadrature and of elements' borders; recorded errors of an earlier
    conversion are added to them.  Integrals of fields stay unchanged.  A length smooths the fields in addition.

    Raises ElvisError with Fourier directions, for values that are not finite, and on non-conforming meshes.
    """
    solution = {field.name for field in dataset.solution}
    fields, measures = list[Field](), list[Measure]()
    earlier = recorded_facts(dataset.metadata)["fields"]
    for field in dataset.fields:
        if field.name in solution:
            space, found = continuous_projection(dataset, field, field.name, length)
            measures.append(_with_earlier(_measure(space, field, found), earlier.get(field.name, {})))
            fields.append(found)
        else:
            fields.append(field)
    if not measures:
        raise ElvisError("--continuous: expected fields, found none")
    bare = on_common_blocks(replace(dataset, fields=tuple(fields), expansions=()))
    return ContinuousFields(replace(bare, metadata=with_errors(bare, measures)), tuple(measures))


def _with_earlier(measure: Measure, earlier: Mapping[str, Any]) -> Measure:
    """A measure with the errors of an earlier conversion added: the triangle inequality; None is an infinite one."""
    if earlier.get("exact", True):
        return measure
    most, l2 = (np.inf if earlier.get(key) is None else float(earlier[key]) for key in ("max", "L2"))
    return replace(measure, max=measure.max + most, l2=measure.l2 + l2, is_exact=False, slope=np.inf)


def _measure(space: ContinuousSpace, field: Field, found: Field) -> Measure:
    """The difference of a continuous field from its original, at points of the quadrature and of elements' borders."""
    squares, worst, element = 0.0, 0.0, -1
    low, high = np.inf, -np.inf
    for part, block in zip(space.parts, found.blocks, strict=True):
        expansion, coefficients = part.patch.fields[0], part.patch.coefficients[0]
        assert expansion is not None
        assert coefficients is not None
        points = np.concatenate([part.points, part.boundary])
        for rows in part.batches:
            original = evaluate(expansion, coefficients[rows], points)
            change = np.abs(evaluate(block.expansion, block.coefficients[rows], points) - original)
            squares += float((part.weights[rows] * change[:, : len(part.points)] ** 2).sum())
            largest = change.max(axis=1)
            if largest.max() > worst:
                worst, element = float(largest.max()), int(block.element_ids[rows][largest.argmax()])
            low, high = min(low, float(original.min())), max(high, float(original.max()))
    magnitude = max(abs(low), abs(high))
    order = max(max(block.expansion.modes) for block in found.blocks) - 1
    is_exact = is_rounding(worst, high - low, magnitude, 0.0)
    slope = 0.0 if is_exact else np.inf
    return Measure(field.name, order, worst, squares**0.5, high - low, magnitude, 0.0, element, is_exact, True, slope)
