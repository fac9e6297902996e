"""Sizes of elements, and the composites that hold them: one number for each element."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.quantities.elements.points import Lattice
from elvis.core.shapes import Shape

#: elements whose measures are found together
_TOGETHER = 1 << 12


def sizes(dataset: Dataset) -> tuple[Ints, Floats]:
    """Ids of elements, and for each the d-th root of its length, area or volume.

    If the map has degree n in each of the coordinates eta, its determinant has degree d n, and the factor of the
    collapse adds two.  A Gauss rule for this degree is exact unless the determinant changes its sign.
    """
    from elvis.core.integrals.reference_cells import box_rule, whole_elements

    ids, found = [np.empty(0, np.int64)], [np.empty(0)]
    for piece in whole_elements(patches(dataset, ())):
        shape = piece.patch.shape
        degrees = box_degrees(bernstein_space(piece.patch.geometry))
        nodes, weights = box_rule(tuple((shape.dimension * degree + 2) // 2 + 1 for degree in degrees))
        for first in range(0, len(piece), _TOGETHER):
            rows = piece.rows[first : first + _TOGETHER]
            jacobians = Lattice(piece.patch, rows, piece.points(nodes)).jacobians
            measures = piece.measures(jacobians, np.tile(nodes, (len(rows), 1))).reshape(len(rows), -1) @ weights
            ids.append(piece.patch.element_ids[rows])
            found.append(measures ** (1 / shape.dimension))
    return np.concatenate(ids), np.concatenate(found)


def composites(dataset: Dataset) -> tuple[Ints, Floats]:
    """Ids of elements, and of each the id of the first composite that holds it; none for those in no composite."""
    mesh = dataset.mesh
    tags = {shape.tag for shape in Shape.of_dimension(mesh.dimension)} | {1: {"E"}, 2: {"F"}, 3: set()}[mesh.dimension]
    ids, found = [np.empty(0, np.int64)], [np.empty(0)]
    for composite in mesh.composites:
        for tag, members in composite.parts:
            if tag in tags:
                ids.append(members)
                found.append(np.full(len(members), float(composite.id)))
    every, first = np.unique(np.concatenate(ids), return_index=True)
    return every, np.concatenate(found)[first]
