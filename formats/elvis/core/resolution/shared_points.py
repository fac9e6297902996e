"""Points that elements share: on one vertex, edge or face of the mesh, and at one position."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints

#: direction along which the points of an entity are sorted: no two points of a lattice have the same place along it
_ALONG = np.array([0.7548776662466927, 0.5698402909980532, 0.3247179572447460])
#: distance, relative to the size of an element, up to which points of two elements are the same: more than the rounding
#: of maps in single precision, less than the distance of nodes
_SAME = 1e-4


def groups_of_points(positions: Floats, entity: Ints, lengths: Floats) -> Ints:
    """(n,) numbers, equal for points of one entity at one position.

    positions  (n, 3)
    entity     (n, 4) vertices, ascending, of the entity that holds each; -1 if there are fewer
    lengths    (n,) sizes of their elements, to which distances are relative
    """
    # points of one entity, sorted along a direction, are next to their counterparts in other elements
    order = np.lexsort([positions @ _ALONG, *entity.T])
    is_same = (entity[order][1:] == entity[order][:-1]).all(axis=1)
    distance = np.linalg.norm(np.diff(positions[order], axis=0), axis=1)
    is_same &= distance <= _SAME * lengths[order][1:]
    group = np.empty(len(positions), np.int64)
    group[order[:1]] = 0
    group[order[1:]] = np.cumsum(~is_same)
    return group
