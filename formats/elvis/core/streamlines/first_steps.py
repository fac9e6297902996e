"""Width of the first step of a line, from bounds of the velocity and the map over its whole element.

With the map's inverse Jacobian A at the seed, X = A x has the Jacobian B, nearly the identity, and a line follows
dxi/dt = f = B^-1 g with g = A v.  In the maximum norm |B - I| <= e < 1 gives (Golub and Van Loan, Matrix Computations,
2.3.4)

    |f| <= |g| / (1 - e),        L = |df/dxi| <= (|dg/dxi| + |d2X/dxi2| |f|) / (1 - e)

with all magnitudes on the right bounded by Bernstein coefficients over the element.  A step of order 8 from a solution
that changes at the rate L errs by about |f| / L (L h)^9.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Floats, Ints, rows_by_number
from elvis.core.mapping import tangents
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients, bernstein_space, differentiate
from elvis.core.shapes import Shape
from elvis.core.streamlines.velocity import Motion, Velocity

#: the order of a step's error
_ORDER = 9
#: the first step where no bound is known, in reference coordinates: it grows as its errors allow
BLIND = 1e-3
#: lines treated together
_AT_ONCE = 1 << 10


def first_widths(velocity: Velocity, patch: Ints, row: Ints, motion: Motion, tolerance: float) -> Floats:
    """(n,) widths of the first steps of lines in elements (n,), where what moves them is known.

    tolerance  error of a step, in the world
    """
    widths = np.empty(len(patch))
    for number, every in rows_by_number(patch):
        for part in chunks(len(every), _AT_ONCE):
            here = every[part]
            own = Motion(motion.velocity[here], motion.reference[here], motion.jacobians[here])
            with np.errstate(all="ignore"):
                widths[here] = _widths(velocity, number, row[here], own, tolerance)
    return widths


def _widths(velocity: Velocity, number: int, rows: Ints, motion: Motion, tolerance: float) -> Floats:
    """(n,) those in elements of one patch."""
    blind = BLIND / np.abs(motion.reference[:, : motion.jacobians.shape[2]]).max(axis=1)
    speed, rate = _bounds(velocity, number, rows, motion.jacobians)
    size = np.linalg.norm(motion.jacobians, axis=(1, 2)) * speed
    width = (tolerance / size) ** (1 / _ORDER) * rate ** (1 / _ORDER - 1)
    return np.where(np.isfinite(rate), width, blind)


def _bounds(velocity: Velocity, number: int, rows: Ints, jacobians: Floats) -> tuple[Floats, Floats]:
    """(n,) bounds of |f| and L in elements with Jacobians (n, 3, d) at the seeds; inf if none is known."""
    patch, fields = velocity.patches[number], velocity.component_fields(number)
    unknown = np.full(len(rows), np.inf)
    maps = patch.geometry_coefficients[rows]
    # nets of pyramids are not in reference coordinates; surfaces in space turn their tangents
    d = patch.shape.dimension
    if fields is None or patch.shape is Shape.PYRAMID or patch.periods or not patch.is_flat:
        return unknown, unknown

    # g = A v, its largest value and the largest sum of its derivatives
    duals = tangents.duals(jacobians)
    expansion = patch.fields[fields[0]]
    assert expansion is not None
    nets = bernstein_coefficients(expansion, np.stack(_coefficients(patch, fields, rows), axis=1))
    moving = np.einsum("nci,ncm->nim", duals[:, : len(fields)], nets)
    speed = np.abs(moving).max(axis=(1, 2))
    change = np.sum([_greatest(net) for _, net in _derivatives(bernstein_space(expansion), moving)], axis=0).max(axis=1)

    # X = A x, how far its Jacobian is from the identity, and how much it bends
    space = bernstein_space(patch.geometry)
    places = np.einsum("nci,ncm->nim", duals, bernstein_coefficients(patch.geometry, maps))
    turned, bend = np.zeros((2, len(rows), d))
    for axis, (lower, net) in enumerate(_derivatives(space, places)):
        turned += _greatest(net - np.eye(d)[:, axis, None])
        bend += np.sum([_greatest(second) for _, second in _derivatives(lower, net)], axis=0)
    apart = turned.max(axis=1)
    inverse = np.where(apart < 1.0, 1.0 / (1.0 - apart), np.inf)
    fastest = inverse * speed
    return fastest, inverse * (change + bend.max(axis=1) * fastest)


def _coefficients(patch: Patch, fields: Sequence[int], rows: Ints) -> list[Floats]:
    """(n, m) coefficients of fields in elements (n,)."""
    every = [patch.coefficients[field] for field in fields]
    return [own[rows] for own in every if own is not None]


def _derivatives(space: BernsteinSpace, nets: Floats) -> list[tuple[BernsteinSpace, Floats]]:
    """Space and net of the derivative in each direction of nets (n, d, count)."""
    return [differentiate(space, nets, axis) for axis in range(space.shape.dimension)]


def _greatest(nets: Floats) -> Floats:
    """(n, d) bounds of the magnitudes of polynomials with nets (n, d, count)."""
    return np.asarray(np.abs(nets).max(axis=2))
