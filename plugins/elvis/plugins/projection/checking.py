"""Points at which a conversion is checked: random reference points not used by any fit, inside and on the border."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.shapes import Shape

#: points inside, in all and at least and at most an element
_IN_ALL, _LEAST, _MOST = 1 << 15, 12, 1000

#: distance from a vertex, as a share of the way to a point inside, at which the field is checked
_NEAR_VERTEX = (1e-3, 3e-2)

#: distance below the apex of a pyramid at which its field is checked
_BELOW_APEX = 1e-2


def inside_count(elements: int) -> int:
    """How many points inside each of this many elements are checked."""
    return int(np.clip(_IN_ALL // max(1, elements), _LEAST, _MOST))


@bounded_cache
def check_points(shape: Shape, inside: int, is_collapsed: bool = False) -> Floats:
    """(n, d) reference points: ``inside`` evenly distributed ones first, then half as many on faces, then some on the
    edges of solids, points near the vertices, and the vertices.

    The same ones every time.  In hexahedra that stand for pyramids (``is_collapsed``) none lies on the upper face, for
    a field with jumps has as many values at an apex as there are directions to come from.
    """
    rng = np.random.default_rng(20261120)
    points = [_scatter(shape, inside, rng)]
    for local in shape.faces if shape.dimension == 3 else shape.edges if shape.dimension == 2 else ():
        kind = {2: Shape.SEGMENT, 3: Shape.TRIANGLE, 4: Shape.QUADRILATERAL}[len(local)]
        t = (1 + _scatter(kind, 1 + inside // (2 * len(shape.faces) or 2), rng)) / 2
        corners = shape.vertices[list(local)]
        axes = corners[[1, 3]] if kind is Shape.QUADRILATERAL else corners[1:]
        points.append(corners[0] + t @ (axes - corners[0]))
    if shape.dimension == 3:
        points += [_on_edge(shape.vertices[list(ends)], rng) for ends in shape.edges]
    points += [_near(vertex, points[0], rng) for vertex in shape.vertices]
    own = np.concatenate([*points, shape.vertices])
    if is_collapsed:
        own[:, 2] = np.minimum(own[:, 2], 1 - _BELOW_APEX)
    return frozen_floats(own)


def _on_edge(ends: Floats, rng: np.random.Generator) -> Floats:
    """(1, d) a point on an edge from its ends (2, d)."""
    t = rng.random()
    return np.asarray((1 - t) * ends[:1] + t * ends[1:])


def _near(vertex: Floats, inside: Floats, rng: np.random.Generator) -> Floats:
    """(2, d) points near a vertex (d,), on the ways to two of those inside (n, d)."""
    targets = inside[rng.integers(len(inside), size=2)]
    return np.asarray(vertex + np.array(_NEAR_VERTEX)[:, None] * (targets - vertex))


def _scatter(shape: Shape, count: int, rng: np.random.Generator) -> Floats:
    """(count, d) points of even density."""
    u = rng.random((count, shape.dimension))
    c = u ** (1 / (1 + np.array(COLLAPSE[shape])))
    return uncollapse(shape, 1 - 2 * c)
