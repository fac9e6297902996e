"""How strongly the maps of elements bend, and whether Newton's method can be trusted with them.

Let J be the Jacobian in parts of the one at the centre, b the greatest change of J over the element and m the greatest
change by unit of length (maximum norms).  A step of Newton's method misses the root, d away, by at most k d with
k = m d / (2 (1 - b)), so from a step of length l < 1/4 the root is at most k l / (1 - k) away from where it ends.  The
kernels call a point outside for good once it is outside by 2 l (judge, shaders/invert.slang); facets of simplices are
three times as steep as coordinates.  Both hold together for k <= 0.4, that is for b + m / 2 <= 1, nearly.  The Jacobian
of a pyramid depends on the direction at the apex, however little it changes, unless the map is affine.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from elvis.formats.arrays import Bools, Floats, Ints, frozen_floats, frozen_ints
from elvis.formats.mapping.orientation import chunks
from elvis.formats.mapping.tangents import duals
from elvis.formats.patch import Patch
from elvis.formats.polynomials.expansion import values_and_gradients
from elvis.formats.shapes import Shape

#: greatest b of a map that counts as affine
_AFFINE = 1e-9
#: the element is looked at a little beyond its border
_BEYOND = 1.25
#: elements at once
_CHUNK = 256


def bends(patch: Patch, rows: Ints) -> Bools:
    """(n,) whether elements bend so strongly that Newton's method may miss a root; true where a Jacobian is singular.

    The changes are measured between the centre, vertices and middles of edges and faces, not bounded.
    """
    result = np.empty(len(rows), bool)
    for part in chunks(len(rows), _CHUNK):
        change, slope = _changes(patch, rows[part])
        result[part] = ~(change <= _AFFINE if patch.shape is Shape.PYRAMID else change + slope / 2 <= 1)
    return result


def _changes(patch: Patch, rows: Ints) -> tuple[Floats, Floats]:
    """b and m (n,)."""
    places = _places(patch.shape)
    coefficients = patch.geometry_coefficients[rows]
    slopes = values_and_gradients(patch.geometry, places)[1]
    with np.errstate(invalid="ignore", over="ignore"):
        jacobians = np.einsum("ncm,sdm->nscd", coefficients, slopes)
        parts = np.einsum("nci,nscd->nsid", duals(jacobians[:, 0]), jacobians)
        change = np.abs(parts - np.eye(patch.shape.dimension)).sum(axis=3).max(axis=(1, 2))
        first, second = _pairs(len(places))
        distance = np.abs(places[first] - places[second]).max(axis=1)
        between = np.abs(parts[:, first] - parts[:, second]).sum(axis=3).max(axis=2) / distance
    return change, between.max(axis=1)


@cache
def _places(shape: Shape) -> Floats:
    """(k, d) the centre, then points around it."""
    middles = [shape.vertices[list(part)].mean(axis=0) for part in (*shape.edges, *shape.faces)]
    centre = shape.vertices.mean(axis=0, keepdims=True)
    around = centre + _BEYOND * (np.unique(np.concatenate([shape.vertices, middles]), axis=0) - centre)
    apart = np.abs(around - centre).max(axis=1) > 0.1
    return frozen_floats(np.concatenate([centre, around[apart]]))


@cache
def _pairs(count: int) -> tuple[Ints, Ints]:
    """All pairs of different numbers below ``count``."""
    first, second = np.triu_indices(count, 1)
    return frozen_ints(first), frozen_ints(second)
