"""Two solutions in one dataset: fields of both on the same elements, or the other as what expressions name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset, Field
from elvis.core.geometry import GeometryBlock, geometry
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.grouping import grouped
from elvis.core.quantities.tree import Node, field, other

#: how far maps of the same element may differ, in parts of the size of coordinates
_SAME = 1e-14
#: before the names of fields of the other solution, which no field's own name begins with
_OTHER = "\0other "
#: the other solution in expressions
REFERENCE = "reference"


def common_fields(first: Dataset, second: Dataset) -> list[str]:
    """The names of fields that both have, in the order of the first."""
    known = {one.name for one in second.solution}
    return [one.name for one in first.solution if one.name in known]


def are_on_one_mesh(first: Dataset, second: Dataset) -> bool:
    """Whether two datasets have elements of the same ids with the same maps, to rounding."""
    ours, theirs = geometry(first), geometry(second)
    if not ours or not np.array_equal(_ids(ours), _ids(theirs)):
        return False
    size = max(float(np.abs(block.coefficients).max()) for block in ours)
    for group in grouped(_ids(ours), [ours, theirs]):
        one, two = group.expansions
        if one is None or two is None or one.shape is not two.shape:
            return False
        # polynomials that agree at as many points as either has coefficients are the same
        degrees = np.maximum(box_degrees(bernstein_space(one)), box_degrees(bernstein_space(two)))
        lines = [np.cos(np.linspace(0.05, np.pi - 0.05, degree + 1)) for degree in degrees]
        eta = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, one.shape.dimension)
        points = uncollapse(one.shape, eta)
        places = [evaluate(own, _of(c), points) for own, c in zip((one, two), group.coefficients, strict=True)]
        if np.abs(places[0] - places[1]).max() > _SAME * max(size, 1e-300):
            return False
    return True


def _of(coefficients: Floats | None) -> Floats:
    assert coefficients is not None
    return coefficients


def _ids(blocks: tuple[GeometryBlock, ...]) -> Ints:
    """The ids of all elements, ascending."""
    return np.sort(np.concatenate([np.empty(0, np.int64), *(block.element_ids for block in blocks)]))


def paired(first: Dataset, second: Dataset, is_same_mesh: bool) -> Dataset:
    """The first dataset, in which fields of the second may be named as `theirs` does."""
    if not is_same_mesh:
        return first.beside(**{REFERENCE: second})
    further = tuple(Field(_OTHER + one.name, one.blocks, one.continuous) for one in second.solution)
    return replace(first, fields=(*first.fields, *further))


def theirs(name: str, is_same_mesh: bool) -> Node:
    """A field of the second dataset in one that `paired` made."""
    return field(_OTHER + name) if is_same_mesh else other(REFERENCE, f'"{name}"')
