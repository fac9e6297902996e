"""Whether two datasets have one mesh, so that fields of both are polynomials on the same elements."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset, Homogeneous
from elvis.core.geometry import GeometryBlock, geometry
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.grouping import grouped

#: how far maps of the same element may differ, in parts of the size of coordinates
_SAME = 1e-14


def are_on_one_mesh(first: Dataset, second: Dataset) -> bool:
    """Whether elements of two datasets have the same ids, maps (to rounding) and Fourier series."""
    if _series(first) != _series(second):
        return False
    if first.mesh is second.mesh and not (first.map_names or second.map_names):
        return True
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


def _series(dataset: Dataset) -> set[Homogeneous]:
    """The Fourier series along straight directions that fields have."""
    found = (block.expansion.homogeneous for one in dataset.solution for block in one.blocks)
    return {series for series in found if series is not None}
